//! Rectification: the top view of a photograph as an [`Observation`].
//!
//! Each texel is mapped board -> camera -> distorted pixel, where the photo is interpolated
//! (Catmull-Rom). Texels larger than about a pixel are averaged over sub-samples along each axis.
//! Values stay linear; the photo's response ([`Radiometry`]) converts them to radiance.

pub mod elevation;
mod mapping;
mod part;
mod resample;
mod response;
mod sampler;

use crate::Rejection;
use crate::calibration::photometry::Radiometry;
use crate::geometry::{Camera, Pose};
use crate::observation::{self, Falloff, Observation, View, pack_weight};
use crate::parallel;
use crate::photo::Photo;
use crate::svbrdf::bands;

use mapping::{LANES, Mapping, Positions};
pub(crate) use part::Part;
pub use resample::from_rectified;
use response::Response;
use sampler::{Filter, Tile};

/// Flatter views show only coarse relief, not the material.
const MAX_VIEW_DEGREES: f64 = 80.0;
/// From here on the weight fades to 0 at [`MAX_VIEW_DEGREES`].
const FADE_VIEW_DEGREES: f64 = 75.0;
/// Least visible share of the sample.
pub(crate) const MIN_SEEN: f32 = 0.25;
/// Largest share of texels saturated in all channels.
pub(crate) const MAX_CLIPPED: f32 = 0.9;

/// Rectifies a photo of a sample in the board's plane.
///
/// The sample is the rectangle `sample_mm` (width, height) around the board's origin. See [`rectify_raised`].
///
/// # Errors
/// As [`rectify_raised`].
pub fn rectify(
    photo: &Photo,
    camera: &Camera,
    pose: &Pose,
    radiometry: &Radiometry,
    sample_mm: [f32; 2],
    width: usize,
    height: usize,
) -> Result<Observation, Rejection> {
    let top = TopView { sample_mm, height_mm: 0.0, width, height, edge_px: 0.0 };
    rectify_raised(photo, camera, pose, radiometry, top)
}

/// Rectifies a photo of a sample whose surface may lie above or below the board's plane.
///
/// The origin of the result's frame lies on the sample's surface; camera and light are relative to it. The
/// weight is the cosine between the surface's normal and the direction to the camera, faded to 0 at 80
/// degrees and towards the sample's edge (see [`TopView::edge_px`]). It is 0 where a texel's footprint leaves
/// the photo or holds values that are not finite, and where the light is below the surface.
///
/// # Errors
/// [`Rejection::WrongSize`], [`Rejection::TooGrazing`], [`Rejection::LightNotVisible`] (below the
/// surface), [`Rejection::SampleOutside`], [`Rejection::Clipped`].
pub fn rectify_raised(
    photo: &Photo,
    camera: &Camera,
    pose: &Pose,
    radiometry: &Radiometry,
    top: TopView,
) -> Result<Observation, Rejection> {
    rectify_filtered(photo, camera, pose, radiometry, top, Filter::Adaptive)
}

/// Geometry of the top view.
#[derive(Debug, Clone, Copy)]
pub struct TopView {
    /// Width and height of the sample, mm, centred at the board's origin.
    pub sample_mm: [f32; 2],
    /// Height of its surface above the board's plane, mm; may be negative.
    pub height_mm: f32,
    /// Texels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Width of the zone inside the sample's edge that is contaminated by its surroundings, px of
    /// the photo: standard deviation of blur and registration together. The weight rises from its
    /// least value at [`EDGE_SIGMAS`]`[0]` of it to the full value at [`EDGE_SIGMAS`]`[1]`.
    pub edge_px: f32,
}

/// Distances from the sample's edge between which the weight rises, in units of
/// [`TopView::edge_px`]. Of a blurred step, 16 % lie beyond one sigma and 0.13 % beyond three; the
/// latter is 1 % for white paper beside a dark sample.
pub const EDGE_SIGMAS: [f32; 2] = [1.0, 3.0];
/// Factor on the weight at the edge, for texels that no photograph shows better.
const EDGE_LEAST: f32 = 0.01;

impl TopView {
    /// Factor of the sample's edge on a texel's weight; `footprint` is the texel's width and height
    /// in the photo, px.
    fn inside(&self, x: usize, y: usize, footprint: (f64, f64)) -> f32 {
        let nearest = |i: usize, count: usize| i.min(count - 1 - i) as f32 + 0.5;
        let across = nearest(x, self.width) * footprint.0 as f32;
        let along = nearest(y, self.height) * footprint.1 as f32;
        let [zero, full] = EDGE_SIGMAS.map(|sigmas| sigmas * self.edge_px);
        // Without blur, half a texel lies between its centre and the edge.
        ((across.min(along) - zero) / (full - zero).max(f32::MIN_POSITIVE)).clamp(EDGE_LEAST, 1.0)
    }
}

/// View of a photograph.
///
/// # Errors
/// As [`rectify_raised`], for the errors that do not depend on pixels.
fn seen_by(
    photo: &Photo,
    camera: &Camera,
    pose: &Pose,
    radiometry: &Radiometry,
    top: &TopView,
) -> Result<View, Rejection> {
    if (photo.width(), photo.height()) != (camera.width, camera.height) {
        return Err(Rejection::WrongSize {
            found_width: photo.width(),
            found_height: photo.height(),
            width: camera.width,
            height: camera.height,
        });
    }
    let mut eye = pose.camera_centre();
    let mut light = pose.to_board(radiometry.flash_offset_mm);
    eye.z -= f64::from(top.height_mm);
    light.z -= f64::from(top.height_mm);
    let view_degrees = (eye.z / eye.length()).clamp(-1.0, 1.0).acos().to_degrees();
    if view_degrees.is_nan() || view_degrees > MAX_VIEW_DEGREES {
        return Err(Rejection::TooGrazing {
            degrees: view_degrees as f32,
            limit: MAX_VIEW_DEGREES as f32,
        });
    }
    if light.z.is_nan() || light.z <= 0.0 {
        return Err(Rejection::LightNotVisible);
    }
    Ok(View {
        sample_mm: top.sample_mm,
        camera_mm: eye.as_vec3().to_array(),
        light_mm: light.as_vec3().to_array(),
        falloff: Falloff::InverseSquare { power_mm2: radiometry.power_mm2 },
        ambient: radiometry.ambient,
        ..View::default()
    })
}

fn rectify_filtered(
    photo: &Photo,
    camera: &Camera,
    pose: &Pose,
    radiometry: &Radiometry,
    top: TopView,
    filter: Filter,
) -> Result<Observation, Rejection> {
    let (width, height) = (top.width, top.height);
    let view = seen_by(photo, camera, pose, radiometry, &top)?;
    let offset = radiometry.flash_offset_mm;
    let mapping = Mapping::new(camera, pose, offset, top.sample_mm, top.height_mm, width, height);
    let response = Response::new(radiometry, camera);
    let texels = width * height;
    let mut packed = vec![0; 3 * texels];
    let from = Source { photo, mapping, response, view, filter, top };
    let (mut seen, mut clipped) = (0, 0);
    if texels > 0 {
        let band = LANES * width;
        let counts: Vec<(usize, usize)> = parallel::map_parts_with(
            bands::<3, _>(&mut packed, width, height, LANES),
            || (vec![0.0; 4 * band], vec![0; band]),
            |(values, codes), i, packed| {
                let n = packed[0].len();
                let values = &mut values[..4 * n];
                values.fill(0.0);
                let (planes, weights) = values.split_at_mut(3 * n);
                let mut band = Band { planes, weight: weights, row: i * LANES, from: &from };
                band.fill();
                let counts = band.seen_and_clipped();
                for (code, &weight) in codes.iter_mut().zip(&*weights) {
                    *code = pack_weight(weight);
                }
                for (c, packed) in packed.into_iter().enumerate() {
                    observation::pack(&planes[c * n..(c + 1) * n], codes, c, packed);
                }
                counts
            },
        );
        (seen, clipped) = counts.iter().fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    }

    let share = seen as f32 / texels.max(1) as f32;
    if texels > 0 && share < MIN_SEEN {
        return Err(Rejection::SampleOutside { share });
    }
    let share = clipped as f32 / seen.max(1) as f32;
    if share > MAX_CLIPPED {
        return Err(Rejection::Clipped { share });
    }
    let mut observation = Observation::from_packed(width, height, view, packed);
    observation.log_sigma = radiometry.log_sigma;
    Ok(observation)
}

/// Converts an observation to another radiometry of the same photo, e.g. after later photos have
/// improved the estimate: values, light and ambient light; the pose is unchanged.
///
/// # Panics
/// If the observation's planes do not have its size.
pub fn update_radiometry(
    observation: &mut Observation,
    camera: &Camera,
    pose: &Pose,
    height_mm: f32,
    old: &Radiometry,
    new: &Radiometry,
) {
    let (width, height) = (observation.width(), observation.height());
    let texels = width * height;
    if texels == 0 {
        return;
    }
    let mapping = |r: &Radiometry| {
        let sample_mm = observation.view.sample_mm;
        Mapping::new(camera, pose, r.flash_offset_mm, sample_mm, height_mm, width, height)
    };
    let mappings = [mapping(old), mapping(new)];
    let (from, to) = (Response::new(old, camera), Response::new(new, camera));
    let buffers = || (vec![[0.0; 2]; width], vec![0.0; width], vec![0; width]);
    let rows = bands::<3, _>(observation.packed_mut(), width, height, 1);
    parallel::parts_with(rows, buffers, |(relative, values, weights), y, rows| {
        let mut positions = [Positions::default(), Positions::default()];
        for x0 in (0..width).step_by(LANES) {
            for (mapping, positions) in mappings.iter().zip(&mut positions) {
                mapping.project(x0, 0.5, y as f64 + 0.5, positions);
            }
            for lane in 0..LANES.min(width - x0) {
                relative[x0 + lane] =
                    [from.relative(&positions[0], lane), to.relative(&positions[1], lane)];
            }
        }
        for (x, weight) in weights.iter_mut().enumerate() {
            *weight = observation::unpack_weight(std::array::from_fn(|c| rows[c][x]));
        }
        for (c, row) in rows.into_iter().enumerate() {
            observation::unpack(row, values);
            from.update(&to, c, relative, values);
            observation::pack(values, weights, c, row);
        }
    });
    let mut light = pose.to_board(new.flash_offset_mm);
    light.z -= f64::from(height_mm);
    observation.view.light_mm = light.as_vec3().to_array();
    observation.view.falloff = Falloff::InverseSquare { power_mm2: new.power_mm2 };
    observation.view.ambient = new.ambient;
    observation.log_sigma = new.log_sigma;
}

/// A photograph and how it is resampled.
struct Source<'a> {
    photo: &'a Photo,
    mapping: Mapping,
    response: Response,
    view: View,
    filter: Filter,
    top: TopView,
}

/// [`LANES`] rows of the result.
struct Band<'a> {
    /// Three planes.
    planes: &'a mut [f32],
    weight: &'a mut [f32],
    row: usize,
    from: &'a Source<'a>,
}

impl Band<'_> {
    fn fill(&mut self) {
        let mut tile = Tile::default();
        let width = self.from.top.width;
        let rows = self.weight.len() / width;
        for x0 in (0..width).step_by(LANES) {
            self.fill_tile(&mut tile, (x0, 0), (LANES.min(width - x0), rows));
        }
    }

    /// Fills a rectangle of at most `LANES * LANES` texels, in halves while its part of the photo is large.
    fn fill_tile(
        &mut self,
        tile: &mut Tile,
        (x0, y0): (usize, usize),
        (columns, rows): (usize, usize),
    ) {
        let Source { photo, mapping, response, .. } = self.from;
        let Some(bounds) = mapping.bounds(x0, self.row + y0, columns, rows) else { return };
        let Some(area) = bounds.pixels_in(photo) else { return };
        if area.len() > Tile::MAX_PIXELS && columns.max(rows) > 1 {
            let (half_x, half_y) = (columns.div_ceil(2), rows.div_ceil(2));
            for (dy, rows) in [(0, half_y), (half_y, rows - half_y)] {
                for (dx, columns) in [(0, half_x), (half_x, columns - half_x)] {
                    if columns > 0 && rows > 0 {
                        let (corner, size) = ((x0 + dx, y0 + dy), (columns, rows));
                        self.fill_tile(tile, corner, size);
                    }
                }
            }
            return;
        }
        tile.load(photo, area, response);
        for y in y0..y0 + rows {
            self.fill_row(tile, x0, columns, y);
        }
    }

    /// Numbers of texels with weight, and of those saturated in all channels.
    fn seen_and_clipped(&self) -> (usize, usize) {
        let (mut seen, mut clipped, n) = (0, 0, self.weight.len());
        for (i, &weight) in self.weight.iter().enumerate() {
            let here = weight > 0.0;
            seen += usize::from(here);
            clipped += usize::from(here && (0..3).all(|c| self.planes[c * n + i] < 0.0));
        }
        (seen, clipped)
    }

    fn fill_row(&mut self, tile: &Tile, x0: usize, columns: usize, y: usize) {
        let Source { mapping, response, view, filter, top, .. } = self.from;
        let row = (self.row + y) as f64;
        let mut centre = Positions::default();
        mapping.project(x0, 0.5, row + 0.5, &mut centre);
        let footprint = mapping.footprint(x0, columns, row + 0.5);
        let (nx, ny) = filter.sub_samples(footprint);
        let mut sums = [[0.0_f32; 4]; LANES];
        let mut flags = [0_u32; LANES];
        let mut positions = Positions::default();
        for j in 0..ny {
            let sub_y = row + (j as f64 + 0.5) / ny as f64;
            for i in 0..nx {
                mapping.project(x0, (i as f64 + 0.5) / nx as f64, sub_y, &mut positions);
                tile.add_samples(&positions, columns, *filter, &mut sums, &mut flags);
            }
        }

        let per_sample = 1.0 / (nx * ny) as f32;
        let (start, n) = (y * top.width + x0, self.weight.len());
        let weights = Weights::new(view, mapping, row + 0.5);
        for lane in 0..columns {
            let weight = weights.at(x0 + lane) * top.inside(x0 + lane, self.row + y, footprint);
            if flags[lane] & sampler::OUTSIDE != 0 || weight <= 0.0 {
                continue;
            }
            self.weight[start + lane] = weight;
            let scale = per_sample * response.relative(&centre, lane);
            for c in 0..3 {
                // Catmull-Rom undershoots at edges, but a negative sign means saturation.
                let value = sums[lane][c].max(0.0) * scale * response.gain[c];
                let saturated = flags[lane] & (1 << c) != 0;
                self.planes[c * n + start + lane] = if saturated { -value } else { value };
            }
        }
    }
}

/// Foreshortening weights of a row of texels.
struct Weights {
    eye: [f32; 3],
    /// y² + z² of the vector to the eye, constant along a row.
    rest2: f32,
    first_x: f32,
    step_x: f32,
    zero: f32,
    full: f32,
}

impl Weights {
    fn new(view: &View, mapping: &Mapping, row: f64) -> Self {
        let eye = view.camera_mm;
        let y = eye[1] - mapping.y_mm(row) as f32;
        Self {
            eye,
            rest2: y * y + eye[2] * eye[2],
            first_x: mapping.x_mm(0.5) as f32,
            step_x: (mapping.x_mm(1.5) - mapping.x_mm(0.5)) as f32,
            zero: MAX_VIEW_DEGREES.to_radians().cos() as f32,
            full: FADE_VIEW_DEGREES.to_radians().cos() as f32,
        }
    }

    fn at(&self, x: usize) -> f32 {
        let dx = self.eye[0] - (self.first_x + x as f32 * self.step_x);
        let cos = self.eye[2] / (dx * dx + self.rest2).sqrt();
        cos * ((cos - self.zero) / (self.full - self.zero)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests;
