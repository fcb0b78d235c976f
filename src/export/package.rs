//! Exports materials to other programs.

use std::path::Path;

use serde_json::{Value, json};

use super::bundle::{Bundle, Files, HEIGHT, number};
use super::files::replace_files;
use super::height::Height;
use super::lobes;
use super::maps::{LOBE_FILES, MapsOptions, check_size, encode_maps};
use super::occlusion::occlusion;
use super::resample::at_most;
use super::textures::TextureFormat;
use super::tile_picture::tile_picture;
use super::{blender, engines, glb, materialx, tile, usdz};
use crate::svbrdf::CHANNELS;
use crate::{Error, Result, Svbrdf};

/// Target of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// `material.glb`: binary glTF 2.0 with `KHR_materials_specular` and `KHR_materials_ior`, and with
    /// `KHR_materials_anisotropy`, `KHR_materials_clearcoat` and `KHR_materials_sheen` where the material has
    /// these lobes.
    Glb,
    /// `material.usdz`: `UsdPreviewSurface` with metalness.
    Usdz,
    /// `materialx/`: MaterialX 1.39, `gltf_pbr` and `open_pbr_surface`.
    MaterialX,
    /// `unreal/`: textures for Unreal's default lit material.
    Unreal,
    /// `unity-hdrp/`: textures for Unity's HDRP Lit shader.
    UnityHdrp,
    /// `unity-urp/`: textures for Unity's URP Lit shader, specular set-up.
    UnityUrp,
    /// `blender/`: a script that builds the nodes.
    Blender,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 7] = [
        Self::Glb,
        Self::Usdz,
        Self::MaterialX,
        Self::Unreal,
        Self::UnityHdrp,
        Self::UnityUrp,
        Self::Blender,
    ];

    /// `glb`, `usdz`, `materialx`, `unreal`, `unity-hdrp`, `unity-urp`, `blender`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Glb => "glb",
            Self::Usdz => "usdz",
            Self::MaterialX => "materialx",
            Self::Unreal => "unreal",
            Self::UnityHdrp => "unity-hdrp",
            Self::UnityUrp => "unity-urp",
            Self::Blender => "blender",
        }
    }

    /// The format of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Parts of the optional lobes that the format cannot represent, if any.
    pub fn leaves_out(self, maps: &Svbrdf) -> Option<String> {
        let mut parts = Vec::new();
        if matches!(self, Self::Usdz | Self::UnityUrp) && maps.anisotropy().is_some() {
            parts.push("no anisotropy: the roughness is the mean of both directions");
        }
        if self == Self::UnityHdrp && maps.coat().is_some() {
            parts.push("no roughness of a coat: the coat is smooth");
        }
        if !matches!(self, Self::Glb | Self::MaterialX | Self::Blender) && maps.sheen().is_some() {
            parts.push("no sheen");
        }
        let but = if self == Self::Usdz { " (except in its OpenPBR network)" } else { "" };
        (!parts.is_empty()).then(|| format!("has {}{but}", parts.join("; ")))
    }
}

/// Options of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportOptions {
    /// Formats to make.
    pub formats: Vec<Format>,
    /// Width and height of the sample, mm.
    pub sample_mm: [f32; 2],
    /// GLB, MaterialX and Blender: use base colour and metalness in place of a specular colour, for
    /// programs without one. `material.json` states the error of this least-squares split. The
    /// other formats have one fixed form.
    pub metallic: bool,
    /// Make the maps seamless first.
    pub tile: bool,
    /// Storage of textures; height always has 16 bits.
    pub texture: TextureFormat,
    /// Largest longer side of the textures, texels, at least 2; `None`: no limit.
    pub max_size: Option<usize>,
    /// Number of photographs of the estimate, if known.
    pub photographs: Option<u32>,
}

impl Default for ExportOptions {
    /// A GLB of a sample of 100 mm.
    fn default() -> Self {
        Self {
            formats: vec![Format::Glb],
            sample_mm: [100.0; 2],
            metallic: false,
            tile: false,
            texture: TextureFormat::default(),
            max_size: None,
            photographs: None,
        }
    }
}

/// Exported files in memory.
#[derive(Debug, Clone, PartialEq)]
pub struct Package {
    /// Names (relative, `/` between folders) and bytes.
    pub files: Vec<(String, Vec<u8>)>,
    /// Parts of the material that formats leave out, one line each.
    pub remarks: Vec<String>,
}

impl Package {
    /// The file of that name.
    pub fn file(&self, name: &str) -> Option<&[u8]> {
        self.files.iter().find(|(n, _)| n == name).map(|(_, bytes)| bytes.as_slice())
    }

    /// Writes all files below a folder, or none. Creates a missing folder.
    ///
    /// # Errors
    /// [`Error::Io`] with the file that cannot be written.
    pub fn write(&self, dir: impl AsRef<Path>) -> Result<()> {
        let gone = LOBE_FILES.map(|name| format!("maps/{name}"));
        let gone: Vec<&str> = gone.iter().map(String::as_str).collect();
        // Lobe files of an earlier material, if this one has such a folder too.
        let gone = if self.file("maps/maps.exr").is_some() { gone.as_slice() } else { &[] };
        replace_files(dir, &self.files, gone)
    }
}

/// Exports maps: `material.glb`, `material.usdz` and a folder for each other format. Adds
/// `material.json` (units, conventions, size and contents of each file; also in every folder),
/// `height.png` (16 bits, range in `material.json`), `height.exr` (mm) and, for seamless maps,
/// `maps/` (see [`write_maps`](super::write_maps)) and `tile.png`, a picture of 3 x 3 tiles.
///
/// # Errors
/// [`Error::Argument`] if no format is given, the size of the sample is not positive, the maps have fewer
/// than two texels along a side (sixteen for seamless maps) or hold values that are not finite.
pub fn export(maps: &Svbrdf, options: &ExportOptions) -> Result<Package> {
    check(maps, options)?;
    let mut maps = at_most(maps, options.max_size.unwrap_or(usize::MAX), 2);
    maps.clamp();
    let (maps, seam) = if options.tile {
        let tile::Tiled { maps, seam, joins, cuts } = tile::seamless(&maps)?;
        (maps, Some([seam, joins, cuts]))
    } else {
        (maps, None)
    };
    let height = Height::of(&maps, options.sample_mm, options.tile)?;
    let occlusion = occlusion(&maps, &height, options.sample_mm, options.tile)?;
    let bundle = Bundle {
        anisotropy: lobes::anisotropy(&maps),
        maps,
        sample_mm: options.sample_mm,
        tileable: options.tile,
        height,
        occlusion,
        texture: options.texture,
        metallic: options.metallic,
    };
    let mut files = Files::new();
    let mut record = record(&bundle, options.photographs);
    if let Some([seam, joins, cuts]) = seam {
        record["tile"] = json!({
            "seam": number(seam),
            "joins": number(joins),
            "cuts": number(cuts),
            "meaning": "seam: mean difference of neighbours across the border against that inside; \
                        joins: the same across the cuts; cuts: how much both sides of the cuts \
                        disagree, in the same unit; of the map for which it is greatest",
        });
        let sized = MapsOptions { sample_mm: Some(bundle.sample_mm), ..MapsOptions::default() };
        let maps = encode_maps(&bundle.maps, &sized)?;
        files.extend(maps.into_iter().map(|(name, bytes)| (format!("maps/{name}"), bytes)));
        files.push(("tile.png".into(), tile_picture(&bundle.maps, bundle.sample_mm)?));
    }
    files.extend(bundle.encode("", &[(HEIGHT, bundle.height_texture())])?);
    files.push((format!("{HEIGHT}.exr"), bundle.height_floats()?));
    let shared = record.clone();
    let mut remarks = Vec::new();
    for &format in &options.formats {
        let (made, mut description) = encode(&bundle, format)?;
        if let Some(left_out) = format.leaves_out(&bundle.maps) {
            description["left_out"] = json!(left_out);
            remarks.push(format!("{} {left_out}", format.name()));
        }
        if made.len() > 1 {
            let mut own = shared.clone();
            own["exports"] = json!({ format.name(): description });
            files.push((format!("{}/material.json", format.name()), pretty(&own)?));
        }
        files.extend(made);
        record["exports"][format.name()] = description;
    }
    files.push(("material.json".into(), pretty(&record)?));
    Ok(Package { files, remarks })
}

/// Files of one format and their description.
fn encode(bundle: &Bundle, format: Format) -> Result<(Files, Value)> {
    let folder = &format!("{}/", format.name());
    match format {
        Format::Glb => {
            let layered = bundle.layered_with_metalness();
            let file = ("material.glb".into(), glb::encode(bundle, &layered)?);
            Ok((vec![file], glb::describe_all(bundle, &layered)))
        }
        Format::Usdz => {
            let (bytes, description) = usdz::encode(bundle)?;
            Ok((vec![("material.usdz".into(), bytes)], description))
        }
        Format::MaterialX => materialx::encode(bundle, &bundle.layered(), folder),
        Format::Unreal => engines::unreal(bundle, folder),
        Format::UnityHdrp => engines::unity_hdrp(bundle, folder),
        Format::UnityUrp => engines::unity_urp(bundle, folder),
        Format::Blender => blender::encode(bundle, &bundle.layered(), folder),
    }
}

fn check(maps: &Svbrdf, options: &ExportOptions) -> Result<()> {
    const NAMES: [&str; CHANNELS] = [
        "slope x",
        "slope y",
        "diffuse red",
        "diffuse green",
        "diffuse blue",
        "specular red",
        "specular green",
        "specular blue",
        "roughness",
    ];
    check_size(options.sample_mm)?;
    if options.formats.is_empty() {
        let names = Format::ALL.map(Format::name).join(", ");
        return Err(Error::argument("formats", format!("none given, some of {names} expected")));
    }
    let (w, h) = (maps.width(), maps.height());
    if w.min(h) < 2 {
        let message = format!("{w} x {h} texels given, at least 2 x 2 expected");
        return Err(Error::argument("maps", message));
    }
    if let Some(given @ 0..2) = options.max_size {
        return Err(Error::argument("max_size", format!("{given} given, at least 2 expected")));
    }
    if let Some(i) = maps.lobes().iter().position(|v| !v.is_finite()) {
        let (value, texel) = (maps.lobes()[i], i % maps.texels());
        let (x, y) = (texel % w, texel / w);
        let message = format!("a lobe is {value} at column {x}, row {y}; finite numbers expected");
        return Err(Error::argument("maps", message));
    }
    if let Some(i) = maps.planes().iter().position(|v| !v.is_finite()) {
        let (plane, texel) = (i / maps.texels(), i % maps.texels());
        let (value, name) = (maps.planes()[i], NAMES[plane]);
        let message = format!(
            "{name} is {value} at column {}, row {}; finite numbers expected",
            texel % w,
            texel / w
        );
        return Err(Error::argument("maps", message));
    }
    Ok(())
}

/// The part of `material.json` common to all formats.
fn record(bundle: &Bundle, photographs: Option<u32>) -> Value {
    let (size, mm) = (bundle.size(), bundle.sample_mm);
    let mut maps = vec!["normal", "diffuse", "specular", "roughness"];
    maps.extend(bundle.anisotropy.is_some().then_some("anisotropy"));
    maps.extend(bundle.maps.coat().is_some().then_some("coat"));
    maps.extend(bundle.maps.sheen().is_some().then_some("sheen"));
    let density = [0, 1].map(|i| number(size[i] as f32 / mm[i]));
    json!({
        "format": "svbrdf-material/1",
        "generator": concat!("svbrdf ", env!("CARGO_PKG_VERSION")),
        "size_mm": mm.map(number),
        "texels": size,
        "texels_per_mm": density,
        "tileable": bundle.tileable,
        "texture": bundle.texture.name(),
        "conventions": {
            "layout": "row 0 is the sample's +Y edge, column 0 its -X edge",
            "brdf": "kd / pi + D F G / (4 NoL NoV); GGX, alpha = roughness^2; Schlick's F with F0",
            "colour": "linear Rec. 709; colour textures are stored with the sRGB curve",
            "normal": "X right, Y up (OpenGL), Z out, as (n + 1) / 2, except where stated",
        },
        "estimated": {
            "photographs": photographs,
            "maps": maps,
            "derived": ["height", "occlusion"],
        },
        "height": {
            "range_mm": bundle.height.range_mm().map(number),
            "png": "16 bits: 0 is the range's low end, 65535 its high end",
            "exr": "mm above the mean",
            "unexplained_share": number(bundle.height.unexplained),
        },
        "occlusion": "from the height: cosine-weighted part of the sky that is seen, within 40 texels",
        "exports": {},
    })
}

fn pretty(value: &Value) -> Result<Vec<u8>> {
    let text = serde_json::to_string_pretty(value).map_err(|e| Error::Internal(e.to_string()))?;
    Ok((text + "\n").into_bytes())
}

#[cfg(test)]
#[path = "package_tests.rs"]
mod tests;
