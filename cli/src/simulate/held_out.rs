//! Photographs without faults, in NumPy's format.

use std::path::Path;

use svbrdf::export::write_atomic;

use super::scene::Scene;
use crate::failure::Result;

/// Texels a side.
const SIDE: usize = 256;

/// Writes the linear radiance of the sample from the top under the flash alone: single precision,
/// `[256, 256, 3]`.
pub fn write(path: &Path, scene: &Scene) -> Result<()> {
    let values: Vec<f32> = scene.ideal(SIDE).as_flattened().iter().map(|&v| v as f32).collect();
    Ok(write_atomic(path, &array(&values))?)
}

/// A file of version 1.0; its header is padded to a multiple of 64 bytes.
fn array(values: &[f32]) -> Vec<u8> {
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({SIDE}, {SIDE}, 3), }}");
    let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).into_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}
