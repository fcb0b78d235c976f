//! Differences of two sets of maps in values and in appearance.

mod colour_difference;

pub use colour_difference::{delta_e_2000, lab};

use crate::observation::{Observation, View};
use crate::parallel;
use crate::random::Random;
use crate::render::render;
use crate::{Error, Result, Svbrdf};

/// Novel renderings compared.
pub const RENDERINGS: usize = 100;

/// Largest angle of their view and light directions from the sample's normal, degrees.
pub const LIMIT_DEGREES: f64 = 70.0;

/// Distance of camera and light in sizes of the sample: far, so that directions are constant.
const DISTANCE: f64 = 1e3;

/// Differences of two sets of maps: RMS, unless stated otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Differences {
    /// Components of the unit normals.
    pub normal: f64,
    /// Linear diffuse albedo.
    pub diffuse: f64,
    /// Linear specular albedo.
    pub specular: f64,
    /// Roughness.
    pub roughness: f64,
    /// [`RENDERINGS`] pictures under lights and from views drawn uniformly over the hemisphere up
    /// to [`LIMIT_DEGREES`], without fall-off, clipped to [0, 1]. The directions are fixed.
    pub render: f64,
    /// Mean angle between the normals, degrees.
    pub normal_deg: f64,
    /// Mean CIEDE2000 of the diffuse albedo, as colours under D65.
    pub diffuse_delta_e: f64,
    /// Mean CIEDE2000 of the specular albedo.
    pub specular_delta_e: f64,
    /// The two parameters of anisotropy, [`ANISOTROPY_X`](crate::svbrdf::lobe::ANISOTROPY_X) and
    /// [`ANISOTROPY_Y`](crate::svbrdf::lobe::ANISOTROPY_Y); `None` unless both materials are
    /// anisotropic. Roughness is then the geometric mean of both directions.
    pub anisotropy: Option<f64>,
    /// Weight of the coat; `None` unless both materials have a coat.
    pub coat: Option<f64>,
    /// Roughness of the coat, under the same condition.
    pub coat_roughness: Option<f64>,
    /// Linear colour of the sheen; `None` unless both materials have sheen.
    pub sheen: Option<f64>,
    /// Roughness of the sheen, under the same condition.
    pub sheen_roughness: Option<f64>,
}

/// Compares maps of equal size.
///
/// # Errors
/// If the sizes differ.
pub fn compare(a: &Svbrdf, b: &Svbrdf) -> Result<Differences> {
    if (a.width(), a.height()) != (b.width(), b.height()) {
        let (found, expected) = ((a.width(), a.height()), (b.width(), b.height()));
        return Err(Error::argument("maps", format!("{found:?} texels, {expected:?} expected")));
    }
    let anisotropy = a.anisotropy().zip(b.anisotropy());
    let coat = a.coat().zip(b.coat());
    let of_coat =
        |plane: usize| coat.map(|(a, b)| rms(squares(a[plane], b[plane]), a[plane].len()));
    let sheen = a.sheen().zip(b.sheen());
    Ok(Differences {
        normal: normals(a, b),
        diffuse: planes(a.diffuse(), b.diffuse()),
        specular: planes(a.specular(), b.specular()),
        roughness: planes([a.roughness()], [b.roughness()]),
        render: renderings(a, b),
        normal_deg: mean_angle(a, b).to_degrees(),
        diffuse_delta_e: colours(a.diffuse(), b.diffuse()),
        specular_delta_e: colours(a.specular(), b.specular()),
        anisotropy: anisotropy.map(|(a, b)| {
            let sum = a.iter().zip(b).map(|(a, b)| squares(a, b)).sum();
            rms(sum, 2 * a[0].len())
        }),
        coat: of_coat(0),
        coat_roughness: of_coat(1),
        sheen: sheen.map(|([r, g, b, _], [r1, g1, b1, _])| planes([r, g, b], [r1, g1, b1])),
        sheen_roughness: sheen.map(|([.., a], [.., b])| planes([a], [b])),
    })
}

/// Mean angle between the normals, from the distance of their tips, which is accurate for small angles.
fn mean_angle(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let mut sum = 0.0;
    for y in 0..a.height() {
        for x in 0..a.width() {
            let chord = squares(&a.normal(x, y), &b.normal(x, y)).sqrt();
            sum += 2.0 * (0.5 * chord).min(1.0).asin();
        }
    }
    sum / a.texels() as f64
}

/// Mean CIEDE2000 of planes of red, green and blue.
fn colours(a: [&[f32]; 3], b: [&[f32]; 3]) -> f64 {
    let colour = |planes: [&[f32]; 3], i: usize| planes.map(|plane| f64::from(plane[i]));
    colour_difference::mean(a[0].len(), |i| Some([colour(a, i), colour(b, i)]))
}

fn rms(sum: f64, count: usize) -> f64 {
    (sum / count as f64).sqrt()
}

fn squares(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

fn planes<const N: usize>(a: [&[f32]; N], b: [&[f32]; N]) -> f64 {
    let sum = a.iter().zip(b).map(|(a, b)| squares(a, b)).sum();
    rms(sum, N * a[0].len())
}

fn normals(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let mut sum = 0.0;
    for y in 0..a.height() {
        for x in 0..a.width() {
            sum += squares(&a.normal(x, y), &b.normal(x, y));
        }
    }
    rms(sum, 3 * a.texels())
}

fn renderings(a: &Svbrdf, b: &Svbrdf) -> f64 {
    let mut random = Random::new(1);
    let limit = LIMIT_DEGREES.to_radians();
    let mut position = || random.direction(limit).map(|v| (DISTANCE * v) as f32);
    let views: Vec<_> = (0..RENDERINGS).map(|_| (position(), position())).collect();
    let longer = a.width().max(a.height()) as f32;
    let sample_mm = [a.width() as f32 / longer, a.height() as f32 / longer];
    let sums: Vec<f64> = parallel::map_parts_with(
        views.into_iter(),
        || [vec![0.0; 3 * a.texels()], vec![0.0; 3 * a.texels()]],
        |images, _, (camera_mm, light_mm)| {
            let view = View { sample_mm, camera_mm, light_mm, ..View::default() };
            for (maps, image) in [a, b].into_iter().zip(images.iter_mut()) {
                render(maps, &view, image);
                image.iter_mut().for_each(|v| *v = v.clamp(0.0, 1.0));
            }
            squares(&images[0], &images[1])
        },
    );
    rms(sums.iter().sum(), RENDERINGS * 3 * a.texels())
}

/// Encoding for the comparison of predictions, for perceptual differences.
const GAMMA: f32 = 2.2;
/// Largest encoded value in the estimate of the brightness factor, to exclude saturation.
const UNSATURATED: f64 = 0.95;

/// How well maps predict a photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// RMS difference over all visible texels, in gamma 2.2 on [0, 1].
    pub error: f64,
    /// Mean CIEDE2000 over the same texels.
    pub delta_e: f64,
    /// Factor on the predicted radiances that fits the photograph best.
    pub brightness: f64,
    /// The photograph: three planes in gamma 2.2 on [0, 1]; 0 outside the sample.
    pub photograph: Vec<f32>,
    /// The prediction in the same form, with the brightness factor.
    pub predicted: Vec<f32>,
}

/// Predicts a photograph that was not used in the fit. One brightness factor is free, because
/// exposures may differ; it is estimated from unsaturated values.
///
/// # Errors
/// If the sizes differ.
pub fn predict(maps: &Svbrdf, photograph: &Observation) -> Result<Prediction> {
    let (found, expected) =
        ((photograph.width(), photograph.height()), (maps.width(), maps.height()));
    if found != expected {
        return Err(Error::argument(
            "photograph",
            format!("{found:?} texels, {expected:?} expected"),
        ));
    }
    let n = maps.texels();
    let mut predicted = vec![0.0; 3 * n];
    render(maps, &photograph.view, &mut predicted);
    let encode = |v: f32| v.clamp(0.0, 1.0).powf(1.0 / GAMMA);
    predicted.iter_mut().for_each(|v| *v = v.max(0.0).powf(1.0 / GAMMA));
    let seen: Vec<bool> = (0..n).map(|i| photograph.weight(i) > 0.0).collect();
    let measured: Vec<f32> = (0..3 * n)
        .map(|i| if seen[i % n] { encode(photograph.radiance(i / n, i % n).abs()) } else { 0.0 })
        .collect();
    // Least squares in the encoding, where a factor on radiances remains a factor.
    let (mut cross, mut square) = (0.0, 0.0);
    for i in (0..3 * n).filter(|&i| seen[i % n] && photograph.radiance(i / n, i % n) >= 0.0) {
        let (p, m) = (f64::from(predicted[i].min(1.0)), f64::from(measured[i]));
        if m < UNSATURATED {
            (cross, square) = (cross + p * m, square + p * p);
        }
    }
    let factor = if square > 0.0 { cross / square } else { 1.0 };
    let mut sum = 0.0;
    for i in 0..3 * n {
        let p = &mut predicted[i];
        *p = if seen[i % n] { (*p * factor as f32).min(1.0) } else { 0.0 };
        if photograph.radiance(i / n, i % n) < 0.0 {
            // A saturated value is a lower bound, which a brighter prediction does not contradict.
            *p = p.min(measured[i]);
        }
        sum += f64::from(*p - measured[i]).powi(2);
    }
    let count = 3 * seen.iter().filter(|seen| **seen).count();
    let colour = |of: &[f32], i: usize| [0, 1, 2].map(|c| f64::from(of[c * n + i].powf(GAMMA)));
    let delta_e = colour_difference::mean(n, |i| {
        seen[i].then(|| [colour(&predicted, i), colour(&measured, i)])
    });
    Ok(Prediction {
        error: rms(sum, count.max(1)),
        delta_e,
        brightness: factor.powf(f64::from(GAMMA)),
        photograph: measured,
        predicted,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photograph(of: &Svbrdf, factor: f32) -> Observation {
        let view = View {
            sample_mm: [80.0, 80.0],
            camera_mm: [20.0, 0.0, 200.0],
            light_mm: [30.0, 0.0, 200.0],
            ..View::default()
        };
        let n = of.texels();
        let mut radiance = vec![0.0; 3 * n];
        render(of, &view, &mut radiance);
        let mut weight = vec![1.0; n];
        radiance.iter_mut().for_each(|v| *v *= factor);
        // The first texel is unseen, the second saturated in red.
        (weight[0], radiance[0]) = (0.0, 9.0);
        radiance[1] *= -0.5;
        Observation::new(of.width(), of.height(), view, &radiance, &weight).unwrap()
    }

    #[test]
    fn a_prediction_by_the_true_maps_differs_by_brightness_only() {
        let mut maps = flat(0.4);
        for (i, v) in maps.diffuse_mut()[0].iter_mut().enumerate() {
            *v = 0.1 + 0.5 * (i % 7) as f32 / 7.0;
        }
        let found = predict(&maps, &photograph(&maps, 0.7)).unwrap();
        // Radiances are rounded to 0.1 %, i.e. 0.05 % in gamma 2.2.
        assert!(found.error < 3e-4, "{}", found.error);
        assert!((found.brightness - 0.7).abs() < 1e-3, "{}", found.brightness);
        assert_eq!((found.photograph[0], found.predicted[0]), (0.0, 0.0), "not seen");
        assert!(found.predicted[1] <= found.photograph[1] + 1e-6, "saturated");
    }

    /// Albedo 0.2 in the left half and 0.4 in the right, predicted by a uniform one. The best
    /// factor in gamma 2.2 gives the mean of the encoded values, and the error is half their
    /// difference. The light's cosine varies by 1 % over the sample.
    #[test]
    fn a_prediction_by_wrong_maps_errs_as_the_closed_form_says() {
        let (uniform, mut halves) = (flat(0.3), flat(0.2));
        let width = halves.width();
        for plane in halves.diffuse_mut() {
            for (i, v) in plane.iter_mut().enumerate() {
                *v = if i % width < width / 2 { 0.2 } else { 0.4 };
            }
        }
        let error = predict(&uniform, &photograph(&halves, 1.0)).unwrap().error;
        let encoded = |v: f64| v.powf(1.0 / 2.2);
        let expected = 0.5 * (encoded(0.4) - encoded(0.2));
        assert!((error / expected - 1.0).abs() < 0.02, "{error} {expected}");
        assert!(predict(&Svbrdf::new(16, 16), &photograph(&halves, 1.0)).is_err());
    }

    fn flat(diffuse: f32) -> Svbrdf {
        let mut maps = Svbrdf::new(32, 32);
        maps.planes_mut().fill(0.0);
        maps.roughness_mut().fill(0.5);
        for c in 0..3 {
            maps.diffuse_mut()[c].fill(diffuse);
        }
        maps
    }

    #[test]
    fn same_maps_do_not_differ() {
        let d = compare(&flat(0.4), &flat(0.4)).unwrap();
        assert_eq!([d.normal, d.diffuse, d.specular, d.roughness, d.render], [0.0; 5]);
        assert_eq!([d.normal_deg, d.diffuse_delta_e, d.specular_delta_e], [0.0; 3]);
    }

    /// Half of the texels are tilted by 10 degrees, with grays of L* 50 and 60, whose difference
    /// has weight 1 / S_L.
    #[test]
    fn angles_and_colour_differences_are_means() {
        let (a, mut b) = (flat(0.184_187), flat(0.184_187));
        let half = b.texels() / 2;
        b.normal_slopes_mut()[0][..half].fill(10f32.to_radians().tan());
        for c in 0..3 {
            b.diffuse_mut()[c][half..].fill(0.281_233);
        }
        let d = compare(&a, &b).unwrap();
        assert!((d.normal_deg - 5.0).abs() < 1e-4, "{}", d.normal_deg);
        let sl = 1.0 + 0.015 * 25.0 / 45f64.sqrt();
        assert!((d.diffuse_delta_e - 5.0 / sl).abs() < 1e-3, "{}", d.diffuse_delta_e);
        assert_eq!(d.specular_delta_e, 0.0);
    }

    /// Lambertian surfaces differ by their albedos times the cosine of the light, whose mean square
    /// over the cap is (1 - c³) / (3 (1 - c)) with c = cos 70°. 100 draws leave about 4 %.
    #[test]
    fn lambertian_surfaces_differ_as_the_closed_form_says() {
        let d = compare(&flat(0.4), &flat(0.3)).unwrap();
        let c = LIMIT_DEGREES.to_radians().cos();
        let expected = 0.1 * ((1.0 - c.powi(3)) / (3.0 * (1.0 - c))).sqrt();
        assert!((d.diffuse - 0.1).abs() < 1e-6);
        assert!((d.render / expected - 1.0).abs() < 0.08, "{} {expected}", d.render);
        assert_eq!((d.normal, d.specular, d.roughness), (0.0, 0.0, 0.0));
    }

    /// Lobes are compared if both have them, and affect the renderings if one has.
    #[test]
    fn lobes_differ_by_their_parameters() {
        let with = |lobes: &[f32]| {
            let mut maps = flat(0.4);
            let planes = lobes.iter().flat_map(|v| vec![*v; maps.texels()]).collect();
            maps.set_lobes(planes).unwrap();
            maps
        };
        let (brushed, lacquered) = (with(&[0.9, 0.0, 0.0, 0.2]), with(&[0.0, 0.0, 0.8, 0.2]));
        let d = compare(&brushed, &with(&[0.9, 0.3, 0.0, 0.2])).unwrap();
        assert!((d.anisotropy.unwrap() - 0.3 / 2f64.sqrt()).abs() < 1e-6 && d.coat.is_none());
        let d = compare(&lacquered, &with(&[0.0, 0.0, 0.5, 0.3])).unwrap();
        let [weight, roughness] = [d.coat.unwrap(), d.coat_roughness.unwrap()];
        assert!(
            (weight - 0.3).abs() < 1e-6 && (roughness - 0.1).abs() < 1e-6 && d.anisotropy.is_none()
        );
        let d = compare(&lacquered, &flat(0.4)).unwrap();
        assert!(d.render > 1e-3 && d.coat.is_none() && d.diffuse == 0.0);
        let velvet = with(&[0.0, 0.0, 0.0, 0.2, 0.3, 0.1, 0.0, 0.5]);
        let d = compare(&velvet, &with(&[0.0, 0.0, 0.0, 0.2, 0.3, 0.1, 0.3, 0.4])).unwrap();
        assert!((d.sheen.unwrap() - 0.3 / 3f64.sqrt()).abs() < 1e-6 && d.coat.is_none());
        assert!((d.sheen_roughness.unwrap() - 0.1).abs() < 1e-6);
        let d = compare(&velvet, &flat(0.4)).unwrap();
        assert!(d.render > 1e-3 && d.sheen.is_none());
    }

    #[test]
    fn sizes_must_agree() {
        assert!(compare(&flat(0.4), &Svbrdf::new(16, 32)).is_err());
    }
}
