use super::*;
use crate::loss::{EPSILON, log_l1, log_l1_derivative};
use crate::observation::{Falloff, Observation};
use crate::reflectance::reflect;
use crate::svbrdf::{CHANNELS, LOBES, channel, lobe};
use std::f64::consts::PI;

pub(crate) use crate::test_support::noise;

/// Independent texels over the whole range of materials with roughness from 0.05, with anisotropy and coat for
/// even seeds, and with sheen too for every fourth.
fn random_maps(width: usize, height: usize, seed: u64) -> Svbrdf {
    let mut r = noise(seed);
    let mut maps = Svbrdf::new(width, height);
    for c in 0..CHANNELS {
        for v in maps.plane_mut(c) {
            *v = match c {
                channel::SLOPE_X | channel::SLOPE_Y => 2.0 * r() - 1.0,
                channel::ROUGHNESS => 0.05 + 0.95 * r(),
                _ => r(),
            };
        }
    }
    if seed.is_multiple_of(2) {
        let count = if seed.is_multiple_of(4) { LOBES } else { lobe::SHEEN };
        let planes = (0..count * width * height).map(|i| match i / (width * height) {
            lobe::ANISOTROPY_X | lobe::ANISOTROPY_Y => 2.8 * r() - 1.4,
            lobe::COAT_ROUGHNESS | lobe::SHEEN_ROUGHNESS => 0.1 + 0.8 * r(),
            _ => r(),
        });
        maps.set_lobes(planes.collect()).unwrap();
    }
    maps
}

/// Camera and light above the sample, some of them grazing.
fn random_view(seed: u64) -> View {
    let mut r = noise(seed);
    let mut above = || [400.0 * r() - 200.0, 400.0 * r() - 200.0, 20.0 + 300.0 * r()];
    let (camera_mm, light_mm) = (above(), above());
    let falloff = if r() < 0.5 {
        Falloff::None { power: [3.1, 2.9, 3.3] }
    } else {
        Falloff::InverseSquare { power_mm2: [1.1e5, 1.2e5, 1.0e5] }
    };
    let ambient = [0.02 * r(), 0.02, 0.01];
    let mirrored = 0.3 + 2.0 * r();
    View { sample_mm: [100.0, 80.0], camera_mm, light_mm, falloff, ambient, mirrored }
}

fn random_observation(maps: &Svbrdf, seed: u64) -> Observation {
    let mut r = noise(seed ^ 77);
    let view = random_view(seed);
    let mut radiance = vec![0.0; 3 * maps.texels()];
    render(&random_maps(maps.width(), maps.height(), seed ^ 5), &view, &mut radiance);
    // Every fifth value is saturated.
    for v in &mut radiance {
        if r() < 0.2 {
            *v = -*v;
        }
    }
    let weight: Vec<f32> = (0..maps.texels()).map(|_| (1.5 * r() - 0.25).clamp(0.0, 1.0)).collect();
    Observation::new(maps.width(), maps.height(), view, &radiance, &weight).unwrap()
}

/// Radiance and derivatives of one texel in double precision.
fn texel_oracle(maps: &Svbrdf, view: &View, x: usize, y: usize) -> ([f64; 3], [[f64; 9]; 3]) {
    let (w, h, i) = (maps.width(), maps.height(), y * maps.width() + x);
    let parameters: [f64; 9] = std::array::from_fn(|c| maps.plane(c)[i] as f64);
    let at = [
        view.sample_mm[0] as f64 * ((x as f64 + 0.5) / w as f64 - 0.5),
        view.sample_mm[1] as f64 * (0.5 - (y as f64 + 0.5) / h as f64),
    ];
    let towards = |p: [f32; 3]| {
        let d = [p[0] as f64 - at[0], p[1] as f64 - at[1], p[2] as f64];
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        (d.map(|v| v / length), length)
    };
    let ((light, distance), (camera, _)) = (towards(view.light_mm), towards(view.camera_mm));
    let lobes = maps.lobes_at(i);
    let reflection = reflect(&parameters, &lobes, light, camera);
    let (mut value, mut jacobian) = (reflection.value, reflection.jacobian);
    for c in 0..3 {
        let irradiance = match view.falloff {
            Falloff::None { power } => power[c] as f64,
            Falloff::InverseSquare { power_mm2 } => power_mm2[c] as f64 / (distance * distance),
        };
        let ambient = view.ambient[c] as f64;
        let mirrored = ambient * view.mirrored as f64;
        value[c] =
            value[c] * irradiance + ambient * parameters[2 + c] + mirrored * parameters[5 + c];
        jacobian[c] = jacobian[c].map(|j| j * irradiance);
        jacobian[c][2 + c] += ambient;
        jacobian[c][5 + c] += mirrored;
    }
    (value, jacobian)
}

/// Widths with every size of an incomplete last group of eight, and one texel.
const SIZES: [(usize, usize); 4] = [(32, 9), (13, 5), (7, 3), (1, 1)];

#[test]
fn renderings_agree_with_double_precision() {
    for seed in 0..20 {
        let (w, h) = SIZES[seed as usize % 4];
        let maps = random_maps(w, h, seed);
        let view = random_view(seed + 100);
        let mut out = vec![0.0; 3 * maps.texels()];
        render(&maps, &view, &mut out);
        for (i, &v) in out.iter().enumerate() {
            let (c, x, y) = (i / (w * h), i % w, i / w % h);
            let want = texel_oracle(&maps, &view, x, y).0[c];
            // Roughness 0.05 is a lobe of 0.0025 rad. Rounding of the half vector by 1e-7 changes
            // its flank by up to 4e-7 / 0.0025 = 2e-4.
            assert!((v as f64 - want).abs() < 3e-4 * want + 1e-6, "seed {seed}: {v} for {want}");
        }
    }
}

#[test]
fn narrow_highlights_keep_their_shape_in_single_precision() {
    // The smallest roughness, along the flank of the lobe (half width 0.0004 rad).
    let mut maps = Svbrdf::new(64, 1);
    for i in 0..64 {
        maps.normal_slopes_mut()[0][i] = 4e-5 * i as f32;
        maps.roughness_mut()[i] = 0.02;
    }
    let position = [0.0, 0.0, 1000.0];
    let falloff = Falloff::None { power: [1.0; 3] };
    let view = View {
        sample_mm: [0.0; 2],
        camera_mm: position,
        light_mm: position,
        falloff,
        ..View::default()
    };
    let mut out = vec![0.0; 192];
    render(&maps, &view, &mut out);
    for i in 0..64 {
        let want = texel_oracle(&maps, &view, i, 0).0[0];
        // Slopes of 4e-5 to 2.5e-3, normals rounded to 6e-8: 1e-3 relative.
        assert!((out[i] as f64 / want - 1.0).abs() < 1e-3, "{i}: {} for {want}", out[i]);
    }
}

/// The radiance of a white Lambertian plane under a far light is its albedo with either fall-off.
/// The specular lobe (roughness 1, F0 = 0) adds F(1) / 4 = 4e-5.
#[test]
fn a_lambertian_plane_comes_out_at_its_albedo() {
    let mut maps = Svbrdf::new(8, 8);
    for c in 0..3 {
        maps.diffuse_mut()[c].fill([0.8, 0.5, 0.1][c]);
        maps.specular_mut()[c].fill(0.0);
    }
    maps.roughness_mut().fill(1.0);
    let position = [0.0, 0.0, 300.0];
    let pi = std::f32::consts::PI;
    for falloff in [
        Falloff::None { power: [pi; 3] },
        Falloff::InverseSquare { power_mm2: [pi * 300.0 * 300.0; 3] },
    ] {
        let view = View {
            sample_mm: [1.0, 1.0],
            camera_mm: position,
            light_mm: position,
            falloff,
            ..View::default()
        };
        let mut out = vec![0.0; 192];
        render(&maps, &view, &mut out);
        for (i, v) in out.iter().enumerate() {
            assert!((v - [0.8, 0.5, 0.1][i / 64]).abs() < 5e-5);
        }
    }
}

/// Compares loss and gradient with sums of the double-precision oracle.
#[test]
fn loss_and_gradient_agree_with_double_precision() {
    for seed in 0..12 {
        let (w, h) = SIZES[seed as usize % 4];
        let maps = random_maps(w, h, seed);
        let observations: Vec<_> =
            (0..3).map(|f| random_observation(&maps, 31 * seed + f)).collect();
        let mut gradient = vec![9.0; 9 * maps.texels()];
        let value = loss_and_gradient(&maps, &observations, &mut gradient);
        assert!((value - loss(&maps, &observations)).abs() <= 1e-6 * value);

        let weights: f64 = observations.iter().map(Observation::total_weight).sum();
        let mut want_value = 0.0;
        for y in 0..h {
            for x in 0..w {
                let i = y * w + x;
                let (mut want, mut scale) = ([0.0; 9], 1e-9);
                for o in &observations {
                    let weight = o.weight(i) as f64;
                    let (rendered, jacobian) = texel_oracle(&maps, &o.view, x, y);
                    for c in 0..3 {
                        let observed = o.radiance(c, i) as f64;
                        want_value += weight * log_l1(rendered[c], observed);
                        let slope = weight * log_l1_derivative(rendered[c], observed);
                        for k in 0..9 {
                            want[k] += slope * jacobian[c][k];
                        }
                        scale += weight * jacobian[c].iter().fold(0.0, |a: f64, j| a.max(j.abs()))
                            / (rendered[c] + EPSILON as f64);
                    }
                }
                for k in 0..9 {
                    let got = gradient[k * w * h + i] as f64 * 3.0 * weights;
                    // As for renderings; relative to the sum of absolute values, because photographs cancel.
                    assert!(
                        (got - want[k]).abs() < 5e-4 * scale,
                        "seed {seed}, texel {i}, parameter {k}: {got} for {} (scale {scale})",
                        want[k]
                    );
                }
            }
        }
        let want_value = if weights > 0.0 { want_value / (3.0 * weights) } else { 0.0 };
        assert!((value - want_value).abs() < 1e-5 * want_value + 1e-9, "{value} {want_value}");
    }
}

/// `<gradient, d>` equals the slope of the loss along `d`, a central difference over the whole image.
#[test]
fn the_gradient_is_the_adjoint_of_the_loss() {
    let maps = random_maps(24, 16, 3);
    let observations: Vec<_> = (0..4).map(|f| random_observation(&maps, 40 + f)).collect();
    let mut gradient = vec![0.0; 9 * maps.texels()];
    loss_and_gradient(&maps, &observations, &mut gradient);
    let mut r = noise(8);
    let direction: Vec<f32> = gradient.iter().map(|_| 2.0 * r() - 1.0).collect();
    let along: f64 = gradient.iter().zip(&direction).map(|(&g, &d)| g as f64 * d as f64).sum();
    let h = 1e-4;
    let moved = |h: f32| {
        let mut m = maps.clone();
        for (v, d) in m.planes_mut().iter_mut().zip(&direction) {
            *v += h * d;
        }
        loss(&m, &observations)
    };
    let numeric = (moved(h) - moved(-h)) / (2.0 * h as f64);
    // Tolerance: kinks of the L1 crossed within h, and single precision of the loss (1e-7 / h).
    assert!((numeric - along).abs() < 0.01 * along.abs() + 1e-3, "{numeric} for {along}");
}

#[test]
fn explained_saturation_and_unseen_texels_have_no_gradient() {
    let maps = random_maps(16, 4, 1);
    let observation = random_observation(&maps, 9);
    let mut rendered = vec![0.0; 3 * maps.texels()];
    render(&maps, &observation.view, &mut rendered);
    let unseen = |i: usize| (i % maps.texels()).is_multiple_of(3);
    let observation = observation.changed(|radiance, weight| {
        for (i, (o, r)) in radiance.iter_mut().zip(&rendered).enumerate() {
            *o = if unseen(i) { f32::NAN } else { -0.9 * r };
        }
        for (i, w) in weight.iter_mut().enumerate() {
            *w = if unseen(i) { 0.0 } else { 1.0 };
        }
    });
    let mut gradient = vec![1.0; 9 * maps.texels()];
    let value = loss_and_gradient(&maps, std::slice::from_ref(&observation), &mut gradient);
    assert_eq!(value, 0.0);
    assert!(gradient.iter().all(|&g| g == 0.0));
    // The same measurements above the rendering have a gradient.
    let observation = observation.changed(|radiance, _| {
        for (i, o) in radiance.iter_mut().enumerate() {
            *o = if unseen(i) { f32::NAN } else { -1.2 * rendered[i] - 0.01 };
        }
    });
    let value = loss_and_gradient(&maps, &[observation], &mut gradient);
    assert!(value > 0.05 && gradient.iter().all(|g| g.is_finite()));
    for i in 0..maps.texels() {
        assert_eq!(gradient[channel::DIFFUSE * maps.texels() + i] < 0.0, i % 3 != 0);
    }
}

#[test]
fn no_observation_means_no_loss() {
    let maps = Svbrdf::new(4, 4);
    let mut gradient = vec![1.0; 9 * 16];
    assert_eq!(loss_and_gradient(&maps, &[], &mut gradient), 0.0);
    assert!(gradient.iter().all(|&g| g == 0.0));
    assert_eq!(loss(&maps, &[]), 0.0);
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let maps = random_maps(61, 37, 2);
    let observations: Vec<_> = (0..3).map(|f| random_observation(&maps, 60 + f)).collect();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut gradient = vec![0.0; 9 * maps.texels()];
            let value = loss_and_gradient(&maps, &observations, &mut gradient);
            let mut out = vec![0.0; 3 * maps.texels()];
            render(&maps, &observations[0].view, &mut out);
            (value, loss(&maps, &observations), gradient, out)
        })
    };
    assert_eq!(run(1), run(3));
}

/// Unit of radiance: at irradiance pi, albedo 1 has radiance 1.
#[test]
fn the_reference_renderer_is_reproduced() {
    // One texel computed by hand from the equations in `reflectance`.
    let mut maps = Svbrdf::new(1, 1);
    maps.planes_mut().copy_from_slice(&[0.1, -0.2, 0.3, 0.2, 0.1, 0.04, 0.5, 0.9, 0.4]);
    let view = View {
        sample_mm: [2.0, 2.0],
        camera_mm: [0.3, 0.2, 2.146],
        light_mm: [-0.9, 0.4, 2.146],
        ..View::default()
    };
    let unit = |v: [f64; 3]| {
        let l = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        v.map(|x| x / l)
    };
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let n = unit([0.1, -0.2, 1.0]);
    let (v, l) = (unit([0.3, 0.2, 2.146]), unit([-0.9, 0.4, 2.146]));
    let h = unit([v[0] + l[0], v[1] + l[1], v[2] + l[2]]);
    let (nl, nv, nh, vh) = (dot(n, l), dot(n, v), dot(n, h), dot(v, h));
    let alpha: f64 = 0.16;
    let d = (alpha / (nh * nh * (alpha * alpha - 1.0) + 1.0)).powi(2) / PI;
    let k = alpha / 2.0;
    let g = nl / (nl * (1.0 - k) + k) * nv / (nv * (1.0 - k) + k);
    let power = 2.0_f64.powf((-5.55473 * vh - 6.98316) * vh);
    let mut out = [0.0; 3];
    render(&maps, &view, &mut out);
    for c in 0..3 {
        let (kd, ks) = ([0.3, 0.2, 0.1][c], [0.04, 0.5, 0.9][c]);
        let f = ks + (1.0 - ks) * power;
        let want = PI * nl * (kd / PI + d * g * f / (4.0 * nl * nv));
        assert!((out[c] as f64 - want).abs() < 1e-5 * want); // single precision
    }
}
