//! OpenEXR files of named float channels.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, ReadChannels,
    ReadLayers, WritableImage, read,
};

use super::files::{check_planes, write_atomic};
use crate::frame::MAX_PIXELS;
use crate::{Error, Result};

/// Writes planes of `width * height` floats as the channels of one layer.
pub fn write_channels(
    path: &Path,
    width: usize,
    height: usize,
    planes: Vec<(&str, Vec<f32>)>,
) -> Result<()> {
    let channels = planes
        .into_iter()
        .map(|(name, plane)| AnyChannel::new(name, FlatSamples::F32(plane)))
        .collect();
    let layer = Layer::new(
        (width, height),
        LayerAttributes::default(),
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    // One thread: the same bytes every time.
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::Image { path: path.to_owned(), message: e.to_string() })?;
    write_atomic(path, bytes.get_ref())
}

/// Writes three planes (R, G, B) of linear values as a float EXR picture.
///
/// # Errors
/// When the sizes do not fit or the file cannot be written.
pub fn write_exr_image(
    path: impl AsRef<Path>,
    width: usize,
    height: usize,
    rgb: &[f32],
) -> Result<()> {
    check_planes(width, height, rgb)?;
    let planes = ["R", "G", "B"].into_iter().zip(rgb.chunks_exact(width * height));
    let planes = planes.map(|(name, plane)| (name, plane.to_vec())).collect();
    write_channels(path.as_ref(), width, height, planes)
}

/// Size and channels of a file.
pub struct Channels {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Planes by name.
    pub planes: HashMap<String, Vec<f32>>,
}

/// Reads every channel of the first layer.
pub fn read_channels(path: &Path) -> Result<Channels> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, e))?;
    let fault = |message: String| Error::Image { path: path.to_owned(), message };
    let decode = |e: exr::error::Error| fault(e.to_string());
    let meta =
        MetaData::read_from_buffered(Cursor::new(bytes.as_slice()), false).map_err(decode)?;
    for header in &meta.headers {
        let size = header.layer_size;
        if size.area() as u64 > MAX_PIXELS {
            let (width, height) = (size.width(), size.height());
            return Err(fault(format!(
                "{width} x {height} px; at most {MAX_PIXELS} pixels are read"
            )));
        }
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes.as_slice()))
        .map_err(decode)?;
    let layer = image.layer_data;
    let planes = layer.channel_data.list.into_iter();
    let planes =
        planes.map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect();
    Ok(Channels { width: layer.size.width(), height: layer.size.height(), planes })
}
