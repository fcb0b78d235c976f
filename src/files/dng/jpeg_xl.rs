//! Raw values in JPEG XL (ISO/IEC 18181): one codestream, bare or in a container, per block.

use jxl::api::{
    Endianness, Event, JxlDataFormat, JxlDecoder, JxlDecoderOptions, JxlOutputBuffer,
    JxlPixelFormat, ProfileLevel,
};

use crate::files::guard::guarded;

/// Most channels per pixel that are decoded: colours, and extra channels that are dropped.
const MOST_CHANNELS: usize = 5;

/// Decodes a block to integers of `bits` bits, whose full scale is 1 in the codestream. Returns
/// width and values, row by row. The block has one of two sizes.
pub fn decode(
    bytes: &[u8],
    sizes: [[usize; 2]; 2],
    channels: usize,
    bits: u32,
) -> Result<(usize, Vec<u16>), String> {
    guarded("JPEG XL", || block(bytes, sizes, channels, bits))
}

fn block(
    bytes: &[u8],
    sizes: [[usize; 2]; 2],
    channels: usize,
    bits: u32,
) -> Result<(usize, Vec<u16>), String> {
    let [[whole_width, whole_height], _] = sizes;
    let mut options = JxlDecoderOptions::default();
    // The DNG file states the orientation.
    options.adjust_orientation = false;
    options.high_precision = true;
    options.max_profile_level = ProfileLevel::Main10;
    options.sample_limit = Some(MOST_CHANNELS * whole_width * whole_height);
    let mut decoder = JxlDecoder::new(options);
    let mut input = bytes;
    let mut next = |decoder: &mut JxlDecoder, out: Option<&mut [JxlOutputBuffer]>| match decoder
        .process(&mut input, out, None)
    {
        Ok(Event::NeedMoreInput { .. }) => Err("truncated".to_owned()),
        Ok(event) => Ok(event),
        Err(fault) => Err(fault.to_string()),
    };
    while next(&mut decoder, None)? != Event::BasicInfo {}
    let info = decoder.basic_info().ok_or("no header")?;
    let (width, height) = info.size;
    if !sizes.contains(&[width, height]) {
        return Err(format!("{width} x {height} px in a block of {whole_width} x {whole_height}"));
    }
    let others = info.extra_channels.len();
    let colours = decoder.current_pixel_format().ok_or("no header")?.color_type;
    if colours.samples_per_pixel() != channels {
        return Err(format!(
            "{} values a pixel; {channels} are expected",
            colours.samples_per_pixel()
        ));
    }
    let stored = JxlDataFormat::U16 { endianness: Endianness::native(), bit_depth: bits as u8 };
    let format = JxlPixelFormat {
        color_type: colours,
        color_data_format: Some(stored),
        extra_channel_format: vec![None; others],
    };
    decoder.set_pixel_format(format).map_err(|fault| fault.to_string())?;
    let line = 2 * channels * width;
    // Align the values.
    let mut buffer = vec![0u8; line * height + 1];
    let start = buffer.as_ptr().align_offset(2).min(1);
    let out = &mut buffer[start..start + line * height];
    let mut outputs = [JxlOutputBuffer::new(out, height, line)];
    while !matches!(
        next(&mut decoder, Some(&mut outputs))?,
        Event::FrameComplete { .. } | Event::Complete
    ) {}
    let values = buffer[start..start + line * height].as_chunks::<2>().0;
    Ok((width, values.iter().map(|value| u16::from_ne_bytes(*value)).collect()))
}
