//! Maps and photographs as pages show them.

use svbrdf::Svbrdf;
use svbrdf::photo::{Encoding, Photo};
use svbrdf::svbrdf::gltf::{self, Shown};

/// Longer side of a small picture at most, px.
const SMALL: u32 = 480;

/// Names of the optional lobes that the material shows.
pub fn lobe_names(maps: &Svbrdf) -> Vec<&'static str> {
    let Shown { anisotropy, coat, sheen } = Shown::of(maps);
    let named = [
        (anisotropy.is_some(), "anisotropy"),
        (coat, "coat"),
        (sheen, "sheen"),
        (sheen, "sheen_roughness"),
    ];
    named.into_iter().filter_map(|(shown, name)| shown.then_some(name)).collect()
}

/// A map in 8-bit RGBA; `None` for an unknown name and for a lobe that the material does not show.
pub fn rgba(maps: &Svbrdf, name: &str) -> Option<Vec<u8>> {
    let (diffuse, specular) = (maps.diffuse(), maps.specular());
    let shown = Shown::of(maps);
    let width = maps.width();
    let value: Box<dyn Fn(usize) -> [f32; 3]> = match name {
        "normal" => Box::new(|i| maps.normal(i % width, i / width).map(|v| 0.5 * v + 0.5)),
        "diffuse" => Box::new(|i| diffuse.map(|plane| srgb(plane[i]))),
        "specular" => Box::new(|i| specular.map(|plane| srgb(plane[i]))),
        "roughness" => Box::new(|i| [gltf::roughness(maps, i); 3]),
        "anisotropy" => {
            let mean = shown.anisotropy?;
            Box::new(move |i| {
                let [cos, sin, strength] = gltf::anisotropy(maps, mean, i);
                [0.5 * cos + 0.5, 0.5 * sin + 0.5, strength]
            })
        }
        "coat" if shown.coat => Box::new(|i| {
            let [weight, roughness] = gltf::coat(maps, i);
            [weight, roughness, 0.0]
        }),
        "sheen" if shown.sheen => Box::new(|i| {
            let [r, g, b, _] = gltf::sheen(maps, i);
            [r, g, b].map(srgb)
        }),
        "sheen_roughness" if shown.sheen => Box::new(|i| [gltf::sheen(maps, i)[3]; 3]),
        _ => return None,
    };
    let texel = |i| {
        let [r, g, b] = value(i).map(eight_bits);
        [r, g, b, 255]
    };
    Some((0..maps.texels()).flat_map(texel).collect())
}

/// A texture of the viewer; `None` for an unknown name.
pub fn texture(maps: &Svbrdf, name: &str) -> Option<Vec<f32>> {
    if name == "lobes" {
        let planes = [0, 1, 2, 3].map(|lobe| maps.lobe(lobe));
        let [Some(x), Some(y), Some(coat), Some(roughness)] = planes else { return None };
        let texel = |i| [x[i], y[i], coat[i], roughness[i]];
        return Some((0..maps.texels()).flat_map(texel).collect());
    }
    if name == "sheen" {
        let [r, g, b, roughness] = maps.sheen()?;
        let texel = |i| [r[i], g[i], b[i], roughness[i]];
        return Some((0..maps.texels()).flat_map(texel).collect());
    }
    let [x, y, z] = match name {
        "shape" => {
            let [x, y] = maps.normal_slopes();
            [x, y, maps.roughness()]
        }
        "diffuse" => maps.diffuse(),
        "specular" => maps.specular(),
        _ => return None,
    };
    Some((0..maps.texels()).flat_map(|i| [x[i], y[i], z[i], 1.0]).collect())
}

/// A small version of a photograph, 8-bit RGBA with its width and height: browsers cannot decode
/// every format that is read here. `None` of one that is too narrow.
pub fn small(photo: &Photo) -> Option<([u32; 2], Vec<u8>)> {
    let step = photo.width().max(photo.height()).div_ceil(SMALL);
    if photo.width().min(photo.height()) < step {
        return None;
    }
    let small = photo.reduced(step);
    let linear = small.to_linear();
    let rgba = linear.chunks_exact(3).flat_map(|rgb| {
        let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(|v| eight_bits(srgb(v)));
        [r, g, b, 255]
    });
    Some(([small.width(), small.height()], rgba.collect()))
}

fn srgb(linear: f32) -> f32 {
    Encoding::Srgb.encode(f64::from(linear)) as f32
}

fn eight_bits(value: f32) -> u8 {
    (255.0 * value + 0.5) as u8
}
