//! A material, and rectified photographs of it.
#![allow(dead_code)] // each test file uses its part

use std::f32::consts::PI;

use svbrdf::observation::{Falloff, Observation, View};
use svbrdf::photo::Photo;
use svbrdf::session::{RectifiedFalloff, Scene};
use svbrdf::{Svbrdf, render};

/// Texels along each side.
pub const SIZE: usize = 256;
/// Where cameras are, mm.
pub const POSITIONS: [[f32; 3]; 3] = [[0.0, 0.0, 110.0], [-45.0, 50.0, 110.0], [55.0, 20.0, 100.0]];

/// Two glossy colours in squares, with bumps.
pub fn material() -> Svbrdf {
    let mut maps = Svbrdf::new(SIZE, SIZE);
    for y in 0..SIZE {
        for x in 0..SIZE {
            let i = y * SIZE + x;
            let red = (x / 32 + y / 32) % 2 == 0;
            maps.normal_slopes_mut()[0][i] = 0.3 * (x as f32 * 0.2).sin();
            maps.normal_slopes_mut()[1][i] = 0.2 * (y as f32 * 0.15).cos();
            let diffuse = if red { [0.5, 0.1, 0.08] } else { [0.1, 0.3, 0.4] };
            for c in 0..3 {
                maps.diffuse_mut()[c][i] = diffuse[c];
                maps.specular_mut()[c][i] = 0.05;
            }
            maps.roughness_mut()[i] = if red { 0.3 } else { 0.5 };
        }
    }
    maps
}

/// A sample of 100 mm a side, seen and lit from one point, mm.
pub fn view(camera_mm: [f32; 3]) -> View {
    View { sample_mm: [100.0; 2], camera_mm, light_mm: camera_mm, ..View::default() }
}

/// Sessions that take such photographs.
pub fn scene() -> Scene {
    let falloff = RectifiedFalloff::Given(Falloff::None { power: [PI; 3] });
    Scene::Rectified { falloff }
}

fn radiance(maps: &Svbrdf, view: &View) -> Vec<f32> {
    let mut planes = vec![0.0; 3 * maps.texels()];
    render::render(maps, view, &mut planes);
    planes
}

/// An exact photograph, nothing saturated.
pub fn photo(maps: &Svbrdf, camera_mm: [f32; 3]) -> Photo {
    let (planes, n) = (radiance(maps, &view(camera_mm)), maps.texels());
    let rgb = (0..n).flat_map(|i| [planes[i], planes[n + i], planes[2 * n + i]]).collect();
    let (width, height) = (maps.width() as u32, maps.height() as u32);
    Photo::from_linear(width, height, rgb, 1.0, f32::INFINITY).unwrap()
}

/// The same for the fit.
pub fn observation(maps: &Svbrdf, view: View) -> Observation {
    let weight = vec![1.0; maps.texels()];
    Observation::new(maps.width(), maps.height(), view, &radiance(maps, &view), &weight).unwrap()
}
