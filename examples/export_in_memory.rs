//! Turns a folder of maps into files of other programs, in memory.
//!
//! ```sh
//! cargo run --release --example export_in_memory -- examples/captures/tile/truth
//! ```

use std::error::Error;

use svbrdf::export::{ExportOptions, Format, MapsOptions, encode_maps, export, read_maps};

/// Names and bytes of files.
type Files = Vec<(String, Vec<u8>)>;

/// Exports the maps of a folder.
///
/// # Errors
/// When a map cannot be read or a file not be made.
pub fn run(folder: &str) -> Result<Files, Box<dyn Error>> {
    let maps = read_maps(folder)?;
    // The maps themselves, as PNG and OpenEXR.
    let mut files = encode_maps(&maps, &MapsOptions::default())?;
    let options = ExportOptions {
        formats: vec![Format::Glb, Format::Unreal],
        sample_mm: [88.0, 88.0],
        max_size: Some(128),
        ..ExportOptions::default()
    };
    let package = export(&maps, &options)?;
    for remark in &package.remarks {
        println!("{remark}");
    }
    files.extend(package.files);
    for (name, bytes) in &files {
        println!("{name}: {} bytes", bytes.len());
    }
    Ok(files)
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: export_in_memory MAPS")?;
    run(&folder).map(|_| ())
}
