//! Radiance of the board's squares in one photograph.

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::patches::{patch_value, patch_values};
use crate::Rejection;
use crate::calibration::{Target, TargetKind};
use crate::geometry::{Camera, Pose};
use crate::photo::{Photo, Surround, ToneCurve};
use crate::statistics::median;

/// Narrower squares contain no pixel free of their neighbours, px.
const MIN_SQUARE_PX: f64 = 6.0;
/// Margin to printed edges: reach of optics, demosaicking and JPEG ringing.
const EDGE_PX: f64 = 2.0;
/// The same inside black squares, where stray light weighs sixteen times.
const BLACK_EDGE_PX: f64 = 3.0;
/// The same in standard deviations of a blur, round white and black squares, as a share of a square at most.
const EDGE_BLURS: f64 = 2.0;
const BLACK_EDGE_BLURS: f64 = 3.0;
const EDGE_MOST: f64 = 0.3;
/// The same as a share of a square: tolerance of print and pose.
const EDGE_SHARE: f64 = 0.08;
/// A narrower rim around a marker is blurred everywhere, so its brightest part is used.
const MIN_RIM_PX: f64 = 3.5;
/// Relative spread above which a square is not plain paper (shadow edge, dirt, finger).
const MAX_SPREAD: f32 = 0.12;
/// Share of saturated pixels above which a square's channel is unused.
const MAX_CLIPPED: f32 = 0.01;
/// Least black over white of ink on paper, and largest share of black squares that may be 0 throughout.
const MIN_BLACK: f64 = 0.015;
const MAX_VOID: f32 = 0.3;
/// Deviation of log black over white from that of most photographs, and the fewest other photographs.
const OTHER_BLACK: f64 = 0.3;
const MIN_OTHERS: usize = 2;
/// Largest distance of a white square beside a black one, squares.
const NEIGHBOUR_SQUARES: f64 = 1.6;
/// Fewest squares for a scale that tolerates one outlier.
const MIN_SQUARES: usize = 4;
/// White level (share of full scale) below which 8-bit codes are too coarse.
const MIN_LEVEL: f32 = 0.01;

/// Mean value of a printed square.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Square {
    /// Whether it is white.
    pub white: bool,
    /// Centre of the square, mm, board frame (z = 0).
    pub board_mm: DVec2,
    /// The same in the photograph, px.
    pub px: DVec2,
    /// Linear value over the photo's exposure, per channel; `None` if clipped.
    pub value: [Option<f32>; 3],
    /// Mean of a wide surrounding, in the same units.
    pub surround: [f32; 3],
    /// Surroundings at each scale of local tone mapping, sum of the channels.
    pub around: [f32; Surround::SCALES.len()],
}

/// A square without a single value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Whether it is white.
    pub white: bool,
    /// Centre of the square, mm, board frame (z = 0).
    pub board_mm: DVec2,
    /// First and last decile of the linear values over the photo's exposure, per channel; the
    /// clipping level if all are clipped.
    pub range: [[f32; 3]; 2],
}

/// The squares of one photograph.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Squares {
    /// Squares with at least one usable channel.
    pub squares: Vec<Square>,
    /// The gray patch if printed, visible and unclipped.
    pub gray: Option<Square>,
    /// Linear values of the black, gray and white patch; `None` if out of view, covered, clipped or
    /// not printed.
    pub patches: Option<[[f32; 3]; 3]>,
    /// Relative exposure of the photograph.
    pub exposure: f32,
    /// Share of the visible white squares with a clipped channel.
    pub clipped_share: f32,
    /// Share of the visible black squares without a value above 0.
    pub void_share: f32,
    /// Squares that are not plain: shadow edges, glare, dirt, fingers.
    pub uneven: Vec<Spread>,
    /// Squares clipped in all channels.
    pub clipped: Vec<Spread>,
}

impl Squares {
    /// Whether the values are possible (for saved data).
    pub(crate) fn is_plausible(&self) -> bool {
        let is_positive = |v: &f32| v.is_finite() && *v > 0.0;
        let is_square = |square: &Square| {
            square.board_mm.is_finite()
                && square.px.is_finite()
                && square.value.iter().flatten().all(is_positive)
                && square.surround.iter().chain(&square.around).all(|v| v.is_finite())
        };
        let is_spread = |spread: &Spread| {
            spread.board_mm.is_finite() && spread.range.iter().flatten().all(|v| v.is_finite())
        };
        is_positive(&self.exposure)
            && self.clipped_share.is_finite()
            && self.void_share.is_finite()
            && self.uneven.iter().chain(&self.clipped).all(is_spread)
            && self.squares.iter().chain(&self.gray).all(is_square)
    }

    /// Median of black squares over adjacent white ones, without the tone curve. 0 if most black
    /// squares have no value; `None` if there are too few.
    fn black_over_white(&self, target: &Target, tone: &ToneCurve) -> Option<f64> {
        if self.void_share > MAX_VOID {
            return Some(0.0);
        }
        let value = |square: &Square| {
            let [r, g, b] = square.value;
            let stored = [r?, g?, b?].map(|v| v * self.exposure);
            Some(tone.undone(stored).into_iter().map(f64::from).sum::<f64>())
        };
        let reach = NEIGHBOUR_SQUARES * target.square_mm;
        let ratio = |black: &Square| {
            let near = self
                .squares
                .iter()
                .filter(|s| s.white && s.board_mm.distance_squared(black.board_mm) < reach * reach);
            let (sum, count) =
                near.filter_map(value).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
            (count > 0.0).then_some(())?;
            Some(value(black)? * count / sum)
        };
        let black = self.squares.iter().filter(|s| !s.white);
        let ratios: Vec<f64> = black.filter_map(ratio).collect();
        if ratios.len() >= MIN_SQUARES { median(ratios) } else { None }
    }

    /// Measures every square that lies completely inside the photo; edges have a spread of `blur_px` (one sigma).
    ///
    /// # Errors
    /// [`Rejection::Clipped`], [`Rejection::TooDark`], or [`Rejection::LightNotVisible`] if too few
    /// squares look like evenly lit paper.
    pub fn measure(
        photo: &Photo,
        target: &Target,
        camera: &Camera,
        pose: &Pose,
        blur_px: f64,
    ) -> Result<Self, Rejection> {
        let mut scratch = Scratch::default();
        let surrounds = Surround::at_scales(photo);
        let around = |px: DVec2| {
            surrounds
                .each_ref()
                .map(|s| s.at(px.x as f32, px.y as f32))
                .map(|rgb| rgb.map(|v| v / photo.exposure()))
        };
        let (mut squares, mut levels) = (Vec::new(), Vec::new());
        let (mut uneven, mut lost) = (Vec::new(), Vec::new());
        let (mut visible, mut clipped, mut black, mut void) = (0_usize, 0, 0, 0);
        for row in 0..i64::from(target.rows) {
            for col in 0..i64::from(target.cols) {
                if !target.has_square(row, col) {
                    continue;
                }
                let white = target.is_white(row, col);
                let Some(place) = Placed::new(photo, target, camera, pose, blur_px, [row, col])
                else {
                    continue;
                };
                scratch.collect(photo, target, camera, pose, &place);
                if scratch.values[0].len() < 12 {
                    continue;
                }
                visible += usize::from(white);
                black += usize::from(!white);
                void += usize::from(!white && scratch.is_void());
                let Some(measured) = scratch.channels(photo.saturation(), place.quantile) else {
                    uneven.push(scratch.spread(white, place.centre, photo.exposure()));
                    continue;
                };
                clipped += usize::from(white && measured.clipped);
                if white {
                    levels.push(measured.level);
                }
                if measured.value.iter().any(Option::is_some) {
                    let value = measured.value.map(|v| v.map(|v| v / photo.exposure()));
                    squares.push(Square::new(
                        white,
                        place.centre,
                        place.px,
                        value,
                        around(place.px),
                    ));
                } else {
                    lost.push(scratch.spread(white, place.centre, photo.exposure()));
                }
            }
        }
        let clipped_share = clipped as f32 / visible.max(1) as f32;
        if squares.len() < MIN_SQUARES {
            return Err(if clipped > 0 {
                Rejection::Clipped { share: clipped_share }
            } else {
                Rejection::LightNotVisible
            });
        }
        if let Some(level) = median(levels)
            && level < MIN_LEVEL
        {
            return Err(Rejection::TooDark { level });
        }
        let void_share = void as f32 / black.max(1) as f32;
        let patches = patch_values(photo, target, camera, pose);
        let gray = gray_patch(photo, target, camera, pose, around);
        let patches = patches.map(|each| each.map(|value| value.map(|v| v as f32)));
        let exposure = photo.exposure();
        let clipped = lost;
        Ok(Self { squares, gray, patches, exposure, clipped_share, void_share, uneven, clipped })
    }
}

impl Square {
    fn new(
        white: bool,
        board_mm: DVec2,
        px: DVec2,
        value: [Option<f32>; 3],
        surrounds: [[f32; 3]; Surround::SCALES.len()],
    ) -> Self {
        let [_, surround, _] = surrounds;
        let around = surrounds.map(|rgb| rgb.iter().sum());
        Self { white, board_mm, px, value, surround, around }
    }
}

/// Black over white of a photograph with edited contrast, and the expected ratio. The print fixes
/// the ratio for all photographs, and ink has a least one.
pub(crate) fn edited<'a>(
    photo: &Squares,
    others: impl Iterator<Item = &'a Squares>,
    target: &Target,
    tone: &ToneCurve,
) -> Option<[f32; 2]> {
    if target.black_albedo <= 0.0 {
        return None;
    }
    let own = photo.black_over_white(target, tone)?;
    let others: Vec<f64> =
        others.filter_map(|other| other.black_over_white(target, tone)).collect();
    let known = others.len() >= MIN_OTHERS;
    let usual = median(others)
        .filter(|_| known)
        .unwrap_or_else(|| target.black_albedo / target.white_albedo);
    let differs = known && (own.max(1e-6) / usual.max(1e-6)).ln().abs() > OTHER_BLACK;
    (own < MIN_BLACK || differs).then_some([own as f32, usual as f32])
}

/// The gray patch as a square; `None` if not printed or not visible.
fn gray_patch(
    photo: &Photo,
    target: &Target,
    camera: &Camera,
    pose: &Pose,
    around: impl Fn(DVec2) -> [[f32; 3]; Surround::SCALES.len()],
) -> Option<Square> {
    let [_, gray, _] = target.patches.then(|| target.patches())?;
    let value = patch_value(photo, camera, pose, &gray)?;
    let value = value.map(|v| (v > 0.0).then(|| (v / f64::from(photo.exposure())) as f32));
    let board_mm = gray.centre_mm;
    let px = camera.project(pose.transform(board_mm.extend(0.0)))?;
    Some(Square::new(false, board_mm, px, value, around(px)))
}

/// A square in the photo and its plain part.
struct Placed {
    row: f64,
    col: f64,
    centre: DVec2,
    /// The same in the photograph, px.
    px: DVec2,
    /// Samples along each side, about one per pixel.
    samples: (u32, u32),
    /// Margin to the square's edges, in squares, along columns and rows.
    margin: DVec2,
    /// Half a marker with its margin, in squares; zero without marker.
    marker: DVec2,
    /// Quantile of the values that represents the paper.
    quantile: f32,
}

impl Placed {
    fn new(
        photo: &Photo,
        target: &Target,
        camera: &Camera,
        pose: &Pose,
        blur_px: f64,
        square: [i64; 2],
    ) -> Option<Self> {
        let [row, col] = square.map(|i| i as f64);
        let at = |dr: f64, dc: f64| {
            camera.project(pose.transform(target.grid_mm(row + dr, col + dc).extend(0.0)))
        };
        let corners = [at(0.0, 0.0)?, at(0.0, 1.0)?, at(1.0, 1.0)?, at(1.0, 0.0)?];
        let (right, bottom) = (f64::from(photo.width()) - 1.0, f64::from(photo.height()) - 1.0);
        let inside = |p: &DVec2| p.x >= 0.0 && p.y >= 0.0 && p.x <= right && p.y <= bottom;
        if !corners.iter().all(inside) {
            return None;
        }
        let across = 0.5 * (corners[1] - corners[0] + corners[2] - corners[3]);
        let down = 0.5 * (corners[3] - corners[0] + corners[2] - corners[1]);
        let area = across.perp_dot(down).abs();
        // Width perpendicular to the other sides, which blur reduces.
        let width = DVec2::new(area / down.length(), area / across.length());
        if !width.is_finite() || width.min_element() < MIN_SQUARE_PX {
            return None;
        }
        let white = target.is_white(square[0], square[1]);
        let [sharp, blurs] =
            if white { [EDGE_PX, EDGE_BLURS] } else { [BLACK_EDGE_PX, BLACK_EDGE_BLURS] };
        let edge = DVec2::splat(sharp) / width;
        let soft = (DVec2::splat(blurs * blur_px) / width).min(DVec2::splat(EDGE_MOST));
        let margin = edge.max(soft).max(DVec2::splat(EDGE_SHARE));
        let (mut margin, mut marker, mut quantile) = (margin, DVec2::ZERO, 0.5);
        if let TargetKind::CharucoRing { marker_mm, .. } = &target.kind
            && white
        {
            let rim = 0.5 * (1.0 - marker_mm / target.square_mm);
            let rim_px = rim * width.min_element();
            margin = (DVec2::splat(EDGE_PX) / width).min(DVec2::splat(0.35 * rim));
            marker = DVec2::splat(0.5 - rim) + margin;
            if rim_px < MIN_RIM_PX {
                quantile = 0.75;
            }
        }
        let count = |length: f64| (length.ceil() as u32).clamp(8, 40);
        Some(Self {
            row,
            col,
            centre: target.grid_mm(row + 0.5, col + 0.5),
            px: at(0.5, 0.5)?,
            samples: (count(across.length()), count(down.length())),
            margin,
            marker,
            quantile,
        })
    }

    /// Whether a position, in squares from the upper left corner, is plain paper.
    fn is_paper(&self, p: DVec2) -> bool {
        let from_centre = (p - 0.5).abs();
        from_centre.x <= 0.5 - self.margin.x
            && from_centre.y <= 0.5 - self.margin.y
            && !(from_centre.x < self.marker.x && from_centre.y < self.marker.y)
    }
}

struct Measured {
    /// Robust mean of each usable channel.
    value: [Option<f32>; 3],
    /// Whether a channel is clipped.
    clipped: bool,
    /// Largest channel, share of full scale.
    level: f32,
}

/// Pixel values of a square, reused between squares.
#[derive(Default)]
struct Scratch {
    values: [Vec<f32>; 3],
}

impl Scratch {
    fn collect(
        &mut self,
        photo: &Photo,
        target: &Target,
        camera: &Camera,
        pose: &Pose,
        place: &Placed,
    ) {
        self.values.iter_mut().for_each(Vec::clear);
        let (nx, ny) = place.samples;
        for iy in 0..ny {
            for ix in 0..nx {
                let p = DVec2::new(
                    (f64::from(ix) + 0.5) / f64::from(nx),
                    (f64::from(iy) + 0.5) / f64::from(ny),
                );
                if !place.is_paper(p) {
                    continue;
                }
                let board = target.grid_mm(place.row + p.y, place.col + p.x).extend(0.0);
                let Some(pixel) = camera.project(pose.transform(board)) else { continue };
                let (x, y) = (pixel.x.round(), pixel.y.round());
                if x < 0.0 || y < 0.0 {
                    continue;
                }
                let (x, y) = (x as u32, y as u32);
                if x >= photo.width() || y >= photo.height() {
                    continue;
                }
                let rgb = photo.pixel(x, y);
                if rgb.iter().all(|v| v.is_finite()) {
                    for (list, v) in self.values.iter_mut().zip(rgb) {
                        list.push(v);
                    }
                }
            }
        }
    }

    /// Spread of a square without a value.
    fn spread(&self, white: bool, board_mm: DVec2, exposure: f32) -> Spread {
        let at = |list: &Vec<f32>, q: f32| list[((list.len() - 1) as f32 * q).round() as usize];
        let range = [0.1, 0.9].map(|q| self.values.each_ref().map(|list| at(list, q) / exposure));
        Spread { white, board_mm, range }
    }

    /// Whether most values of a channel are 0.
    fn is_void(&self) -> bool {
        let most = |list: &Vec<f32>| 2 * list.iter().filter(|v| **v <= 0.0).count() > list.len();
        self.values.iter().any(most)
    }

    /// Robust mean of each channel: values within 2.5 robust sigmas of the quantile. `None` if the
    /// square is neither clipped nor evenly lit.
    fn channels(&mut self, saturation: f32, quantile: f32) -> Option<Measured> {
        let mut out = Measured { value: [None; 3], clipped: false, level: 0.0 };
        for (list, value) in self.values.iter_mut().zip(&mut out.value) {
            list.sort_by(f32::total_cmp);
            let at = |q: f32| list[((list.len() - 1) as f32 * q).round() as usize];
            let centre = at(quantile);
            out.level = out.level.max(centre);
            let clipped = list.iter().filter(|v| **v >= saturation).count();
            if clipped as f32 > MAX_CLIPPED * list.len() as f32 {
                out.clipped = true;
                continue;
            }
            if centre <= 0.0 {
                continue;
            }
            // Half the distance between the 16 % and 84 % quantiles is one sigma. On a narrow rim
            // only the upper half is paper.
            let sigma =
                if quantile > 0.5 { at(0.95) - centre } else { 0.5 * (at(0.84) - at(0.16)) };
            if sigma > MAX_SPREAD * centre {
                continue;
            }
            let reach = 2.5 * sigma.max(0.005 * centre);
            let (mut sum, mut count) = (0.0, 0.0);
            for v in list.iter().filter(|v| (**v - centre).abs() <= reach) {
                sum += v;
                count += 1.0;
            }
            *value = Some(sum / count);
        }
        (out.clipped || out.value.iter().any(Option::is_some)).then_some(out)
    }
}
