//! OpenEXR files of named float channels.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    ReadChannels, ReadLayers, Text, Vec2, WritableImage, read,
};

use crate::photo::MAX_PIXELS;
use crate::{Error, Result};

/// Attribute with width and height of the sample, mm.
const SAMPLE_MM: &str = "sampleSizeMm";

/// Encodes planes of `width * height` floats as the channels of one layer. The attributes `sampleSizeMm` (two
/// floats), `xDensity` (texels per inch) and `pixelAspectRatio` state the size of the sample.
pub fn encode_channels(
    width: usize,
    height: usize,
    planes: Vec<(&str, Vec<f32>)>,
    sample_mm: Option<[f32; 2]>,
) -> Result<Vec<u8>> {
    let channels = planes
        .into_iter()
        .map(|(name, plane)| AnyChannel::new(name, FlatSamples::F32(plane)))
        .collect();
    let mut attributes = LayerAttributes::default();
    if let Some([x, y]) = sample_mm {
        attributes.horizontal_density = Some(25.4 * width as f32 / x);
        let size = AttributeValue::FloatVec2(Vec2(x, y));
        attributes.other.insert(SAMPLE_MM.into(), size);
    }
    let layer = Layer::new(
        (width, height),
        attributes,
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(channels),
    );
    let mut image = Image::from_layer(layer);
    if let Some([x, y]) = sample_mm {
        image.attributes.pixel_aspect = (x / width as f32) / (y / height as f32);
    }
    let mut bytes = Cursor::new(Vec::new());
    // A single thread gives the same bytes every time.
    image
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::Internal(format!("floats could not be encoded: {e}")))?;
    Ok(bytes.into_inner())
}

/// Size and channels of a file.
pub struct Channels {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Planes by name.
    pub planes: HashMap<String, Vec<f32>>,
    /// Width and height of the sample, mm, if stated.
    pub sample_mm: Option<[f32; 2]>,
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
    let sample_mm = match layer.attributes.other.get(&Text::from(SAMPLE_MM)) {
        Some(&AttributeValue::FloatVec2(Vec2(x, y))) => Some([x, y]),
        _ => None,
    };
    Ok(Channels { width: layer.size.width(), height: layer.size.height(), planes, sample_mm })
}
