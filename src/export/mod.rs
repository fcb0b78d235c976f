//! Maps to files and back, and to the formats of other programs: PNG, OpenEXR, previews; glTF,
//! USDZ, MaterialX, Unreal, Unity and Blender ([`export()`]).
//!
//! Files are written atomically, under a temporary name in the same folder.

mod blender;
mod bundle;
mod classes;
mod convert;
mod cut;
mod engines;
mod fft;
mod files;
mod floats;
mod glb;
mod height;
mod lobes;
mod maps;
mod materialx;
mod metalness;
mod occlusion;
mod openpbr;
mod package;
mod poisson;
mod preview;
mod resample;
mod stack;
mod template;
mod temporary;
mod textures;
mod tile;
mod tile_picture;
mod transpose;
mod usdz;

pub use classes::{CLASS_FILE, encode_classes};
pub use files::{
    check_writable, replace_files, write_atomic, write_exr_image, write_files, write_png16_image,
};
pub use height::Height;
pub use maps::{LOBE_FILES, MapsOptions, encode_maps, read_maps, read_sample_mm, write_maps};
pub use occlusion::occlusion;
pub use package::{ExportOptions, Format, Package, export};
pub use preview::{Relit, encode_preview, relit, write_preview};
pub use resample::resized;
pub use textures::TextureFormat;
#[doc(hidden)]
pub use textures::srgb_byte;

#[cfg(test)]
mod tests;
