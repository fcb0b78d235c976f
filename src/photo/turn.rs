//! Quarter turns of photographs.

use super::pixels::{Photo, Pixels};
use super::plane::Rotation;

impl Rotation {
    /// The clockwise rotation by 0, 90, 180 or 270 degrees.
    pub fn from_degrees(degrees: u32) -> Option<Self> {
        match degrees {
            0 => Some(Self::None),
            90 => Some(Self::Quarter),
            180 => Some(Self::Half),
            270 => Some(Self::ThreeQuarters),
            _ => None,
        }
    }
}

impl Photo {
    /// The photograph turned clockwise.
    pub fn turned(self, rotation: Rotation) -> Self {
        if rotation == Rotation::None {
            return self;
        }
        let (w, h) = (self.width() as usize, self.height() as usize);
        let (width, height) = if rotation == Rotation::Half { (w, h) } else { (h, w) };
        let source = |x: usize, y: usize| match rotation {
            Rotation::None => (x, y),
            Rotation::Quarter => (y, h - 1 - x),
            Rotation::Half => (w - 1 - x, h - 1 - y),
            Rotation::ThreeQuarters => (w - 1 - y, x),
        };
        let pixel = |i: usize| {
            let (x, y) = source(i % width, i / width);
            y * w + x
        };
        let order = (0..w * h).map(pixel);
        let pixels = match &self.pixels {
            Pixels::U8(data, table) => Pixels::U8(gather(data, order), table),
            Pixels::U16(data, table) => Pixels::U16(gather(data, order), table),
            Pixels::F32(data) => Pixels::F32(gather(data, order)),
        };
        self.with_pixels(width as u32, height as u32, pixels)
    }
}

fn gather<T: Copy>(data: &[T], order: impl Iterator<Item = usize>) -> Vec<T> {
    let mut gathered = Vec::with_capacity(data.len());
    let pixels = data.as_chunks::<3>().0;
    order.for_each(|i| gathered.extend(pixels[i]));
    gathered
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::photo::Encoding;

    #[test]
    fn pixels_are_turned_like_a_print() {
        // a b c d e f
        let data: Vec<u8> = (1..=6).flat_map(|v| [v; 3]).collect();
        let photo = Photo::from_rgb8(3, 2, &data, 9, Encoding::Linear, 1.0).unwrap();
        for (degrees, size, expected) in [
            (0, (3, 2), [1, 2, 3, 4, 5, 6]),
            (90, (2, 3), [4, 1, 5, 2, 6, 3]),
            (180, (3, 2), [6, 5, 4, 3, 2, 1]),
            (270, (2, 3), [3, 6, 2, 5, 1, 4]),
        ] {
            let rotation = Rotation::from_degrees(degrees).unwrap();
            for photo in [
                photo.clone(),
                Photo::from_linear(3, 2, photo.to_linear(), 1.0, f32::INFINITY).unwrap(),
            ] {
                let turned = photo.turned(rotation);
                assert_eq!((turned.width(), turned.height()), size, "{degrees}");
                let found: Vec<f32> =
                    turned.to_linear().chunks(3).map(|p| (p[0] * 255.0).round()).collect();
                assert_eq!(found, expected.map(|v| v as f32), "{degrees}");
            }
        }
        assert_eq!(Rotation::from_degrees(45), None);
    }
}
