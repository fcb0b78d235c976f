//! Classes of texels as a picture.

use crate::{Error, Result};

/// The picture's name in a folder of maps.
pub const CLASS_FILE: &str = "class.png";
/// Colours that are easy to distinguish; more classes repeat them.
const PALETTE: [[u8; 3]; 8] = [
    [0x99, 0x99, 0x99],
    [0xe6, 0x9f, 0x00],
    [0x56, 0xb4, 0xe9],
    [0x00, 0x9e, 0x73],
    [0xf0, 0xe4, 0x42],
    [0x00, 0x72, 0xb2],
    [0xd5, 0x5e, 0x00],
    [0xcc, 0x79, 0xa7],
];

/// A PNG whose pixels are the numbers of the classes, 8 bits each, with a palette that makes them visible.
///
/// # Errors
/// When `classes` does not hold `width * height` values.
pub fn encode_classes(width: usize, height: usize, classes: &[u8]) -> Result<Vec<u8>> {
    if width == 0 || height == 0 || classes.len() != width * height {
        let found = classes.len();
        let message = format!("{found} values given, {width} x {height} expected");
        return Err(Error::argument("classes", message));
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    let colours = usize::from(*classes.iter().max().unwrap_or(&0)) + 1;
    encoder
        .set_palette(PALETTE.iter().cycle().take(colours).copied().flatten().collect::<Vec<u8>>());
    let write = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(classes)?;
        writer.finish()
    });
    write.map_err(|e| Error::Internal(format!("a picture could not be encoded: {e}")))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_the_numbers_of_classes() {
        let classes = [0, 1, 9, 2, 1, 0];
        let bytes = encode_classes(3, 2, &classes).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
        assert_eq!(reader.info().color_type, png::ColorType::Indexed);
        let palette = reader.info().palette.as_ref().unwrap();
        assert_eq!(palette[..3], palette[24..27], "a ninth class has the colour of the first");
        let mut pixels = [0; 6];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, classes);
        assert!(encode_classes(2, 2, &classes).is_err());
    }
}
