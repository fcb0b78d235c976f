//! Helpers of unit tests: numbers, a material, views, and photographs of known maps.

use crate::Svbrdf;
use crate::geometry::Pose;
use crate::observation::{Observation, View};
use crate::render::render;
use glam::{DMat3, DVec3};

#[path = "../tests/common/picture.rs"]
mod picture;
pub(crate) use picture::picture;

#[path = "../tests/common/test_data.rs"]
#[allow(dead_code)] // used by tests on reference photographs
pub(crate) mod test_data;

/// Numbers in [0, 1) from a counter (splitmix64).
pub(crate) fn noise(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// A camera tilted by `tilt` towards `azimuth` and rolled, `distance` mm from the board near its centre; radians.
pub(crate) fn pose(tilt: f64, azimuth: f64, roll: f64, distance: f64) -> Pose {
    let facing = DMat3::from_rotation_x(std::f64::consts::PI);
    let axis = DVec3::new(azimuth.cos(), azimuth.sin(), 0.0);
    Pose {
        rotation: DMat3::from_axis_angle(axis, tilt) * DMat3::from_rotation_z(roll) * facing,
        translation: DVec3::new(6.0, -4.0, distance),
    }
}

/// A bumpy material in two tones with different gloss.
pub(crate) fn two_tones(side: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(side, side);
    for i in 0..side * side {
        let [u, v] = [i % side, i / side].map(|n| n as f32 / side as f32 * 12.0);
        let tone = if u.sin() * v.cos() > 0.0 { 0.6 } else { 0.25 };
        maps.normal_slopes_mut()[0][i] = 0.3 * u.cos();
        maps.normal_slopes_mut()[1][i] = 0.3 * v.sin();
        for c in 0..3 {
            maps.diffuse_mut()[c][i] = tone * [1.0, 0.7, 0.4][c];
        }
        maps.roughness_mut()[i] = 0.2 + 0.6 * tone;
    }
    maps
}

/// A sample of 100 mm per side, seen and lit from one point (mm), with uniform irradiance and no
/// ambient light.
pub(crate) fn view_from(at: [f32; 3]) -> View {
    View { sample_mm: [100.0; 2], camera_mm: at, light_mm: at, ..View::default() }
}

/// An exact, unsaturated photograph of known maps.
pub(crate) fn photograph(truth: &Svbrdf, view: View) -> Observation {
    let mut radiance = vec![0.0; 3 * truth.texels()];
    render(truth, &view, &mut radiance);
    let weight = vec![1.0; truth.texels()];
    Observation::new(truth.width(), truth.height(), view, &radiance, &weight).unwrap()
}
