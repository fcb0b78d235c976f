//! Finds the root cause of a rejection.

use super::camera_estimation::{CameraPrior, estimate_camera};
use super::detector::Corner;
use super::luma::LumaImage;
use super::target::Target;
use crate::Rejection;
use crate::geometry::Camera;
use crate::photo::Photo;
use crate::statistics::median;

/// Narrower squares contain too few pixels free of their neighbours, px.
const SQUARE_MIN_PX: f64 = 9.0;
/// Softer edges, as a part of a square, mix black and white inside it.
const BLUR_MAX_SQUARES: f64 = 0.1;
/// Edges softer than this, px and part of a square, explain uneven squares.
const BLUR_TELLING_PX: f64 = 2.5;
const BLUR_TELLING_SQUARES: f64 = 0.06;
/// Relative difference of focal lengths that focus or rounded metadata can explain.
const OTHER_FOCAL: f64 = 0.05;
/// Largest ratio of the corners' error for the other camera.
const BETTER: f64 = 0.5;

/// Blur of a photograph's edges.
#[derive(Debug, Clone, Copy)]
pub struct Softness {
    blur_px: f64,
    square_px: f64,
}

impl Softness {
    /// Takes the corners and their edge spread.
    ///
    /// # Errors
    /// [`Rejection::SquaresTooSmall`], [`Rejection::Blurred`].
    pub fn new(corners: &[Corner], blur_px: f64) -> Result<Self, Rejection> {
        let square_px = usual_square(corners);
        if square_px < SQUARE_MIN_PX {
            let (square_px, needed_px) = (square_px as f32, SQUARE_MIN_PX as f32);
            return Err(Rejection::SquaresTooSmall { square_px, needed_px });
        }
        let softness = Self { blur_px, square_px };
        if blur_px > BLUR_MAX_SQUARES * square_px { Err(softness.blurred()) } else { Ok(softness) }
    }

    /// Replaces the reason by blur if soft edges explain it: squares then look uneven.
    pub fn explained(&self, rejection: Rejection) -> Rejection {
        let soft = self.blur_px > BLUR_TELLING_PX.max(BLUR_TELLING_SQUARES * self.square_px);
        match rejection {
            Rejection::LightNotVisible if soft => self.blurred(),
            other => other,
        }
    }

    fn blurred(&self) -> Rejection {
        Rejection::Blurred { blur_px: self.blur_px as f32, direction_deg: None }
    }
}

/// Median distance of neighbouring corners, px; infinite without neighbours.
fn usual_square(corners: &[Corner]) -> f64 {
    let sides = corners.iter().flat_map(|a| {
        let right = (a.row, a.col + 1);
        let below = (a.row + 1, a.col);
        let next = move |b: &&Corner| (b.row, b.col) == right || (b.row, b.col) == below;
        corners.iter().filter(next).map(|b| a.px.distance(b.px))
    });
    median(sides).unwrap_or(f64::INFINITY)
}

/// Rejects a photograph whose metadata state another focal length than the first one's.
///
/// # Errors
/// [`Rejection::OtherCamera`].
pub fn same_lens(first: Option<&CameraPrior>, new: &CameraPrior) -> Result<(), Rejection> {
    let focal = |prior: &CameraPrior| prior.is_stated().then_some(prior.camera.fx);
    let ratio = first.and_then(focal).zip(focal(new)).map(|(first, new)| new / first);
    match ratio {
        Some(ratio) if ratio.ln().abs() > OTHER_FOCAL => {
            Err(Rejection::OtherCamera { focal_ratio: ratio as f32 })
        }
        _ => Ok(()),
    }
}

/// Whether a photograph that does not fit the known camera fits another focal length.
pub fn other_camera(
    target: &Target,
    known: &Camera,
    corners: &[Corner],
    rejection: Rejection,
) -> Option<Rejection> {
    let Rejection::PoseUncertain { rms_px } = rejection else { return None };
    let prior = CameraPrior { focal_sigma: 0.5, ..CameraPrior::around(*known) };
    let own = estimate_camera(target, &[corners], &prior, None).ok()?;
    let ratio = own.camera.fx / known.fx;
    let sigma = own.sigma()[0] / own.camera.fx;
    let differs = ratio.ln().abs() > OTHER_FOCAL.max(3.0 * sigma);
    let better = own.rms_px < BETTER * f64::from(rms_px);
    (differs && better).then_some(Rejection::OtherCamera { focal_ratio: ratio as f32 })
}

/// Blocks per side in the search for edges, least contrast of a block (square roots), and number of
/// the sharpest blocks to ignore because they may show something else.
const BLOCKS: usize = 12;
const BLOCK_CONTRAST: f32 = 0.2;
const SHARPEST: usize = 3;
/// Edge spreads above which a missing board is out of focus, px: in all directions, and across one direction if
/// others are sharp, since stripes have no edges along them.
const SOFT_PX: f32 = 3.0;
const SMEARED_PX: f32 = 9.0;
/// The latter if no edge is quite sharp, as after a movement along none of the board's directions, and the spread of
/// such an edge.
const SMEARED_ALL_PX: f32 = 4.2;
const NOT_SHARP_PX: f32 = 2.0;
/// Directions in which a hand may have moved.
const DIRECTIONS: usize = 8;

/// Whether the board was not found for lack of focus or because the camera moved: no edge of the image is sharp, or
/// none across some direction. A step with contrast `c` and steepest slope `g` has a spread of `c / (sqrt(2 pi) g)`.
pub fn too_soft_to_find(luma: &LumaImage, why: &Rejection) -> Option<Rejection> {
    use Rejection::{BoardNotFound, PlacementAmbiguous, TooFewCorners};
    if !matches!(why, BoardNotFound | TooFewCorners { .. } | PlacementAmbiguous { .. }) {
        return None;
    }
    let (w, h) = (luma.width, luma.height);
    let (block_w, block_h) = (w / BLOCKS, h / BLOCKS);
    if block_w.min(block_h) < 16 {
        return None;
    }
    let angle = |k: usize| k as f32 * std::f32::consts::PI / DIRECTIONS as f32;
    let directions: [[f32; 2]; DIRECTIONS] =
        std::array::from_fn(|k| [angle(k).cos(), angle(k).sin()]);
    // Of all edges, and of those across each direction.
    let spreads = |block: usize| {
        let (x0, y0) = (block % BLOCKS * block_w, block / BLOCKS * block_h);
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        let mut slopes = [0.0_f32; 1 + DIRECTIONS];
        for y in y0 + 2..y0 + block_h - 2 {
            for x in x0 + 2..x0 + block_w - 2 {
                let at = |x: usize, y: usize| luma.data[y * w + x];
                let value = at(x, y);
                (low, high) = (low.min(value), high.max(value));
                // Differences over four pixels suppress noise.
                let across = at(x + 2, y) - at(x - 2, y);
                let down = at(x, y + 2) - at(x, y - 2);
                slopes[0] = slopes[0].max(across.hypot(down));
                for (slope, [x, y]) in slopes[1..].iter_mut().zip(directions) {
                    *slope = slope.max((across * x + down * y).abs());
                }
            }
        }
        let contrast = high - low;
        (contrast > BLOCK_CONTRAST && slopes[0] > 0.0).then(|| {
            slopes.map(|slope| 4.0 * contrast / (std::f32::consts::TAU.sqrt() * slope.max(1e-6)))
        })
    };
    let all: Vec<[f32; 1 + DIRECTIONS]> = (0..BLOCKS * BLOCKS).filter_map(spreads).collect();
    let sharpest = |k: usize| {
        let mut spreads: Vec<f32> = all.iter().map(|spreads| spreads[k]).collect();
        spreads.sort_by(f32::total_cmp);
        spreads.get(SHARPEST).copied()
    };
    let sharp_px = sharpest(0)?;
    if sharp_px > SOFT_PX {
        return Some(Rejection::Blurred { blur_px: sharp_px, direction_deg: None });
    }
    let across = (0..DIRECTIONS).filter_map(|k| Some((sharpest(k + 1)?, angle(k).to_degrees())));
    let (blur_px, degrees) = across.max_by(|a, b| a.0.total_cmp(&b.0))?;
    let direction_deg = Some(degrees);
    let limit = if sharp_px > NOT_SHARP_PX { SMEARED_ALL_PX } else { SMEARED_PX };
    (blur_px > limit).then_some(Rejection::Blurred { blur_px, direction_deg })
}

/// Exposure fault that hides the board: nearly everything black, or most of it saturated.
pub fn why_no_board(photo: &Photo) -> Rejection {
    const SAMPLES: u32 = 128;
    let (w, h) = (photo.width(), photo.height());
    let full = if photo.saturation().is_finite() { photo.saturation() } else { 1.0 };
    let across =
        |n: u32| (0..SAMPLES).map(move |i| ((2 * i + 1) * n.div_ceil(2) / SAMPLES).min(n - 1));
    let mut levels: Vec<f32> = across(h)
        .flat_map(|y| across(w).map(move |x| (x, y)))
        .map(|(x, y)| photo.pixel(x, y).into_iter().fold(0.0, f32::max) / full)
        .collect();
    levels.sort_by(f32::total_cmp);
    let share = levels.iter().filter(|&&v| v >= 1.0).count() as f32 / levels.len() as f32;
    let level = levels[levels.len() * 99 / 100];
    if share > 0.5 {
        Rejection::Clipped { share }
    } else if level < 0.02 {
        Rejection::TooDark { level }
    } else {
        Rejection::BoardNotFound
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn corners(side: f64) -> Vec<Corner> {
        let at = |i: u32| Corner {
            row: i / 6,
            col: i % 6,
            px: side * DVec2::new(f64::from(i % 6), f64::from(i / 6)),
        };
        (0..36).map(at).collect()
    }

    #[test]
    fn small_squares_and_soft_edges_are_named() {
        assert!((usual_square(&corners(20.0)) - 20.0).abs() < 1e-9);
        let small = Softness::new(&corners(7.0), 0.7).unwrap_err();
        assert_eq!(small.code(), "squares_too_small");
        assert_eq!(Softness::new(&corners(40.0), 6.0).unwrap_err().code(), "blurred");
        let lit = Rejection::LightNotVisible;
        let soft = Softness::new(&corners(40.0), 3.5).unwrap();
        assert_eq!(soft.explained(lit).code(), "blurred");
        assert_eq!(soft.explained(Rejection::NotFinite), Rejection::NotFinite);
        assert_eq!(Softness::new(&corners(40.0), 0.8).unwrap().explained(lit), lit);
    }

    /// A visible checkerboard without sharp edges or detectable corners.
    #[test]
    fn a_blurred_picture_says_so_though_no_board_is_found() {
        let picture = |blur: f32, contrast: f32| {
            let (width, height) = (600, 450);
            let data = (0..width * height).map(|i| {
                let (x, y) = ((i % width) as f32, (i / width) as f32);
                // Squares of 30 px whose edges are as steep as blurred ones.
                let wave = |v: f32| {
                    let edge = (std::f32::consts::PI * v / 30.0).sin();
                    (edge * 7.6 / blur).tanh()
                };
                0.55 + 0.5 * contrast * wave(x) * wave(y)
            });
            LumaImage { width, height, data: data.collect() }
        };
        let why = Rejection::TooFewCorners { found: 0, expected: 108, needed: 20 };
        for (blur, soft) in [(0.7, false), (1.5, false), (6.0, true), (9.0, true)] {
            let said = too_soft_to_find(&picture(blur, 0.6), &why);
            assert_eq!(said.is_some(), soft, "{blur}: {said:?}");
        }
        // Few soft corners may fit in several places.
        let ambiguous = Rejection::PlacementAmbiguous { found: 37 };
        assert!(too_soft_to_find(&picture(9.0, 0.6), &ambiguous).is_some());
        assert_eq!(too_soft_to_find(&picture(0.7, 0.6), &ambiguous), None);
        // Smeared along a direction, also one between those tested.
        let smeared = |degrees: f32, length: f32| {
            let (width, height) = (600, 450);
            let (s, c) = degrees.to_radians().sin_cos();
            let data = (0..width * height).map(|i| {
                let (x, y) = ((i % width) as f32, (i / width) as f32);
                let value = |t: f32| {
                    let (x, y) = (x + t * c, y + t * s);
                    let even = ((x / 30.0).floor() + (y / 30.0).floor()).rem_euclid(2.0) < 1.0;
                    0.55 + if even { 0.3 } else { -0.3 }
                };
                let count = length as usize;
                (0..count).map(|k| value(k as f32 - 0.5 * length)).sum::<f32>() / length
            });
            LumaImage { width, height, data: data.collect() }
        };
        for degrees in [0.0, 11.0, 90.0] {
            let said = too_soft_to_find(&smeared(degrees, 25.0), &why);
            let Some(Rejection::Blurred { direction_deg: Some(said), .. }) = said else {
                panic!("{degrees}: {said:?}")
            };
            assert!((said - degrees).abs() < 12.0, "{said} {degrees}");
            assert_eq!(too_soft_to_find(&smeared(degrees, 1.0), &why), None, "{degrees}");
        }
        // Oblique to the edges, with noise that looks like edges.
        let oblique = smeared(33.0, 25.0);
        let noise = |i: usize| ((i * 7919 % 1000) as f32 / 1000.0 - 0.5) * 0.1;
        let data = oblique.data.iter().enumerate().map(|(i, v)| v + noise(i)).collect();
        let said = too_soft_to_find(&LumaImage { data, ..oblique }, &why);
        assert!(matches!(said, Some(Rejection::Blurred { .. })), "{said:?}");
        // The picture has no contrast.
        assert_eq!(too_soft_to_find(&picture(6.0, 0.1), &why), None);
        assert_eq!(too_soft_to_find(&picture(9.0, 0.6), &Rejection::NotFinite), None);
    }

    #[test]
    fn metadata_reveal_another_lens() {
        let ordinary = CameraPrior::ordinary(400, 300);
        let stated = |focal| CameraPrior::ordinary(400, 300).with_focal(focal, 0.04);
        assert!(same_lens(None, &stated(300.0)).is_ok());
        assert!(same_lens(Some(&ordinary), &stated(300.0)).is_ok());
        assert!(same_lens(Some(&stated(300.0)), &ordinary).is_ok());
        assert!(same_lens(Some(&stated(300.0)), &stated(305.0)).is_ok());
        let other = same_lens(Some(&stated(300.0)), &stated(390.0));
        assert!(
            matches!(other, Err(Rejection::OtherCamera { focal_ratio }) if (focal_ratio - 1.3).abs() < 1e-3)
        );
    }
}
