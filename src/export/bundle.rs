//! Common input of all exports: maps of one size, height and occlusion, and their textures.

use super::convert::{Albedos, Interface, MetallicModel, Split};
use super::floats::encode_channels;
use super::height::Height;
use super::lobes;
use super::metalness::Layer;
use super::textures::{Density, Texture, TextureFormat};
use crate::svbrdf::{Anisotropy, gltf};
use crate::{Result, Svbrdf, parallel};

/// Files by name.
pub(super) type Files = Vec<(String, Vec<u8>)>;

/// Maps and derived data.
pub(super) struct Bundle {
    pub maps: Svbrdf,
    pub sample_mm: [f32; 2],
    pub tileable: bool,
    pub height: Height,
    /// One value per texel, 1 = open.
    pub occlusion: Vec<f32>,
    pub texture: TextureFormat,
    /// Whether to use base colour and metalness in place of a specular colour, where the format allows both.
    pub metallic: bool,
    /// Both alphas of every texel, if any texel is anisotropic.
    pub anisotropy: Option<Vec<Anisotropy>>,
}

/// Texels split for a renderer with metalness, and the error of the split.
pub(super) struct Splits {
    pub texels: Vec<Split>,
    /// RMS difference of diffuse albedo and of F0, as that renderer shows them.
    pub rms: [f32; 2],
}

/// Inputs of renderers that follow glTF's layering: a diffuse base under one interface.
pub(super) struct Layered {
    pub base: Texture,
    /// Scales the interface's reflectance; `None` is white.
    pub tint: Option<Texture>,
    /// Occlusion, roughness, metalness.
    pub orm: Texture,
    pub ior: f32,
    /// Error of the metalness split; with a tint, error in renderers that ignore the tint.
    pub rms: Option<[f32; 2]>,
}

impl Bundle {
    /// Width and height, texels.
    pub fn size(&self) -> [usize; 2] {
        [self.maps.width(), self.maps.height()]
    }

    /// Albedos of a texel.
    pub fn albedos(&self, i: usize) -> Albedos {
        Albedos {
            diffuse: self.maps.diffuse().map(|plane| plane[i]),
            specular: self.maps.specular().map(|plane| plane[i]),
        }
    }

    /// The index of refraction for the largest F0 of all texels.
    pub fn interface(&self) -> Interface {
        let specular = self.maps.specular().into_iter().flatten();
        Interface::of(specular.copied().fold(0.0, f32::max))
    }

    /// With anisotropy, the square of the roughness is the geometric mean of both alphas.
    pub fn roughness(&self) -> &[f32] {
        self.maps.roughness()
    }

    /// glTF's roughness; with anisotropy, the roughness across the direction.
    pub fn roughness_across(&self, i: usize) -> f32 {
        gltf::roughness(&self.maps, i)
    }

    /// The texture of glTF's `KHR_materials_anisotropy`: direction and strength.
    pub fn anisotropy_texture(&self) -> Option<Texture> {
        let lobes = self.anisotropy.as_ref()?;
        Some(self.data(|i| {
            let [x, y] = lobes::direction(&lobes[i], 1.0);
            [x, y, lobes[i].strength()]
        }))
    }

    /// The direction of the larger alpha as a tangent-space vector, `(v + 1) / 2`; `up` as in
    /// [`Bundle::normals`].
    pub fn tangents(&self, up: f32) -> Option<Texture> {
        let lobes = self.anisotropy.as_ref()?;
        Some(self.data(|i| {
            let [x, y] = lobes::direction(&lobes[i], up);
            [x, y, 0.5]
        }))
    }

    /// A gray texture of a function of both alphas.
    pub fn of_anisotropy(&self, value: impl Fn(&Anisotropy) -> f32 + Sync) -> Option<Texture> {
        let lobes = self.anisotropy.as_ref()?;
        Some(self.gray(|i| value(&lobes[i])))
    }

    /// The texture of glTF's `KHR_materials_clearcoat`: weight and roughness in red and green.
    pub fn coat_texture(&self) -> Option<Texture> {
        self.of_coat(|[weight, roughness]| [weight, roughness, 0.0])
    }

    /// A texture of a function of the coat's weight and roughness.
    pub fn of_coat(&self, value: impl Fn([f32; 2]) -> [f32; 3] + Sync) -> Option<Texture> {
        let [weight, roughness] = self.maps.coat()?;
        Some(self.data(|i| value([weight[i], roughness[i]])))
    }

    /// The texture of glTF's `KHR_materials_sheen`: colour with the sRGB curve, and roughness as alpha.
    pub fn sheen_texture(&self) -> Option<Texture> {
        let planes = self.maps.sheen()?;
        Some(self.rgba(true, |i| planes.map(|plane| plane[i])))
    }

    /// A linear texture of three channels.
    pub fn data(&self, value: impl Fn(usize) -> [f32; 3] + Sync) -> Texture {
        Texture::data(self.maps.width(), self.maps.height(), value)
    }

    /// A texture of three channels with the sRGB curve.
    pub fn colour(&self, value: impl Fn(usize) -> [f32; 3] + Sync) -> Texture {
        Texture::colour(self.maps.width(), self.maps.height(), value)
    }

    /// A linear texture of one channel.
    pub fn gray(&self, value: impl Fn(usize) -> f32 + Sync) -> Texture {
        Texture::gray(self.maps.width(), self.maps.height(), value)
    }

    /// A texture of four channels; with `colour`, the first three have the sRGB curve.
    pub fn rgba(&self, colour: bool, value: impl Fn(usize) -> [f32; 4] + Sync) -> Texture {
        Texture::rgba(self.maps.width(), self.maps.height(), colour, value)
    }

    /// Normals as `(n + 1) / 2`; green points to +Y for `up` = 1 (OpenGL), to -Y for -1 (DirectX).
    pub fn normals(&self, up: f32) -> Texture {
        let width = self.maps.width();
        self.data(|i| {
            let [x, y, z] = self.maps.normal(i % width, i / width);
            [x, up * y, z].map(|v| 0.5 * v + 0.5)
        })
    }

    /// Splits every texel for a renderer.
    pub fn splits(&self, model: MetallicModel) -> Splits {
        let width = self.maps.width();
        let rows = parallel::map(self.maps.height(), |y| {
            let texels = y * width..(y + 1) * width;
            let mut squares = [0.0f64; 2];
            let splits: Vec<Split> = texels
                .map(|i| {
                    let wanted = self.albedos(i);
                    let split = model.split(&wanted);
                    let shown = model.albedos(&split);
                    for c in 0..3 {
                        squares[0] += f64::from(shown.diffuse[c] - wanted.diffuse[c]).powi(2);
                        squares[1] += f64::from(shown.specular[c] - wanted.specular[c]).powi(2);
                    }
                    split
                })
                .collect();
            (splits, squares)
        });
        let count = 3.0 * self.maps.texels() as f64;
        let rms = [0, 1].map(|k| (rows.iter().map(|r| r.1[k]).sum::<f64>() / count).sqrt() as f32);
        Splits { texels: rows.into_iter().flat_map(|r| r.0).collect(), rms }
    }

    /// Textures for glTF, MaterialX and Blender.
    pub fn layered(&self) -> Layered {
        let occlusion = &self.occlusion;
        let roughness = |i: usize| self.roughness_across(i);
        if self.metallic {
            let splits = self.splits(MetallicModel::GLTF);
            return Layered {
                base: self.colour(|i| splits.texels[i].base),
                tint: None,
                orm: self.data(|i| [occlusion[i], roughness(i), splits.texels[i].metallic]),
                ior: 1.5,
                rms: Some(splits.rms),
            };
        }
        let interface = self.interface();
        Layered {
            base: self.colour(|i| self.albedos(i).base_below_coat()),
            tint: Some(self.colour(|i| interface.tint(self.albedos(i).specular))),
            orm: self.data(|i| [occlusion[i], roughness(i), 0.0]),
            ior: interface.ior,
            rms: None,
        }
    }

    /// As [`Bundle::layered`], for a GLB: with a tint, programs that ignore it also show nearly the material.
    pub fn layered_with_metalness(&self) -> Layered {
        if self.metallic {
            return self.layered();
        }
        let width = self.maps.width();
        let rows = parallel::map(self.maps.height(), |y| {
            let texels = y * width..(y + 1) * width;
            texels.map(|i| Layer::of(&self.albedos(i))).collect::<Vec<_>>()
        });
        let layers: Vec<Layer> = rows.into_iter().flatten().collect();
        let largest = layers.iter().flat_map(|l| l.dielectric).fold(0.0, f32::max);
        let interface = Interface::of(largest);
        let mut squares = [0.0f64; 2];
        for (i, layer) in layers.iter().enumerate() {
            let (wanted, shown) = (self.albedos(i), layer.plain());
            for c in 0..3 {
                squares[0] += f64::from(shown.diffuse[c] - wanted.diffuse[c]).powi(2);
                squares[1] += f64::from(shown.specular[c] - wanted.specular[c]).powi(2);
            }
        }
        let count = 3.0 * layers.len() as f64;
        let occlusion = &self.occlusion;
        let roughness = |i: usize| self.roughness_across(i);
        Layered {
            base: self.colour(|i| layers[i].base),
            tint: Some(self.colour(|i| interface.tint(layers[i].dielectric))),
            orm: self.data(|i| [occlusion[i], roughness(i), layers[i].metallic]),
            ior: interface.ior,
            rms: Some(squares.map(|square| (square / count).sqrt() as f32)),
        }
    }

    /// Height as a texture: 0 is the lowest, 1 the highest value.
    pub fn height_texture(&self) -> Texture {
        let [low, high] = self.height.range_mm();
        let scale = if high > low { (high - low).recip() } else { 0.0 };
        self.gray(|i| (self.height.mm[i] - low) * scale)
    }

    /// Height in mm as OpenEXR, channel `Y`.
    pub fn height_floats(&self) -> Result<Vec<u8>> {
        let [w, h] = self.size();
        encode_channels(w, h, vec![("Y", self.height.mm.clone())], Some(self.sample_mm))
    }

    /// Encodes textures in the export's format; names are folder, stem and extension. Height always
    /// has 16 bits.
    pub fn encode(&self, folder: &str, textures: &[(&str, Texture)]) -> Result<Files> {
        let density = Some(Density::of(self.size(), self.sample_mm));
        let encoded = parallel::map(textures.len(), |i| {
            let (stem, texture) = &textures[i];
            let wanted = if *stem == HEIGHT { TextureFormat::Png16 } else { self.texture };
            let ending = texture.format(wanted).extension();
            Ok((format!("{folder}{stem}.{ending}"), texture.encode(wanted, density)?))
        });
        encoded.into_iter().collect()
    }
}

/// Stem of the height's texture.
pub(super) const HEIGHT: &str = "height";

/// A number in JSON with no more digits than necessary.
pub(super) fn number(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}
