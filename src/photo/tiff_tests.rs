use super::*;
use crate::photo::{Encoding, Photo};

/// Values of a page.
enum Values {
    Bytes(Vec<u8>),
    Words(Vec<u32>),
    Halves(Vec<half::f16>),
    Doubles(Vec<f64>),
}

struct Sheet {
    size: [u32; 2],
    channels: u32,
    /// `SampleFormat`; `None`: absent.
    format: Option<u16>,
    values: Values,
}

impl Sheet {
    fn stored(&self, big_endian: bool) -> (u32, Vec<u8>) {
        let order = |mut bytes: Vec<u8>| {
            if big_endian {
                bytes.reverse();
            }
            bytes
        };
        match &self.values {
            Values::Bytes(v) => (8, v.clone()),
            Values::Words(v) => {
                (32, v.iter().flat_map(|v| order(v.to_le_bytes().into())).collect())
            }
            Values::Halves(v) => {
                (16, v.iter().flat_map(|v| order(v.to_le_bytes().into())).collect())
            }
            Values::Doubles(v) => {
                (64, v.iter().flat_map(|v| order(v.to_le_bytes().into())).collect())
            }
        }
    }
}

fn number(value: u64, bytes: usize, big_endian: bool) -> Vec<u8> {
    let little = value.to_le_bytes();
    let mut number = little[..bytes].to_vec();
    if big_endian {
        number.reverse();
    }
    number
}

/// A file of uncompressed single-strip pages. With `below`, the last page is a sub-page of the
/// first instead of its successor.
fn file(pages: &[Sheet], big_tiff: bool, big_endian: bool, below: bool) -> Vec<u8> {
    let number = |value: u64, bytes: usize| number(value, bytes, big_endian);
    let offset = if big_tiff { 8 } else { 4 };
    let mut out = if big_endian { b"MM".to_vec() } else { b"II".to_vec() };
    out.extend(number(if big_tiff { 43 } else { 42 }, 2));
    if big_tiff {
        out.extend([number(8, 2), number(0, 2)].concat());
    }
    // Position of the link to the next directory.
    let mut link = out.len();
    out.extend(vec![0; offset]);
    let mut sub = None;
    for (i, page) in pages.iter().enumerate() {
        let (bits, data) = page.stored(big_endian);
        let strip = out.len() as u64;
        out.extend(&data);
        let [w, h] = page.size.map(u64::from);
        let channels = u64::from(page.channels);
        let mut fields = vec![
            (256u16, w),
            (257, h),
            (258, u64::from(bits)),
            (259, 1),
            (262, if page.channels == 1 { 1 } else { 2 }),
            (273, strip),
            (277, channels),
            (278, h),
            (279, data.len() as u64),
        ];
        if below && i == 0 {
            fields.push((330, 0));
        }
        fields.extend(page.format.map(|format| (339, u64::from(format))));
        // Each entry has one 32-bit value, except bits and formats of several channels.
        let mut lists = Vec::new();
        for &(tag, value) in &fields {
            if [258, 339].contains(&tag) && page.channels == 3 {
                lists.push((tag, out.len() as u64));
                out.extend([number(value, 2), number(value, 2), number(value, 2)].concat());
            }
        }
        out.resize(out.len().next_multiple_of(8), 0);
        let at = out.len();
        let is_below = below && i + 1 == pages.len();
        let place = if is_below { sub.unwrap_or(link) } else { link };
        out[place..place + offset].copy_from_slice(&number(at as u64, offset));
        out.extend(number(fields.len() as u64, if big_tiff { 8 } else { 2 }));
        for (tag, value) in fields {
            let list = lists.iter().find(|(t, _)| *t == tag).map(|(_, at)| *at);
            let in_place = list.filter(|_| !big_tiff).or(list.filter(|_| big_tiff));
            out.extend(number(u64::from(tag), 2));
            let (kind, count) = match list {
                Some(_) => (3, 3),
                None if big_tiff && tag == 330 => (16, 1),
                None => (4, 1),
            };
            out.extend(number(kind, 2));
            out.extend(number(count, offset));
            if tag == 330 {
                sub = Some(out.len());
            }
            match in_place {
                // Three short values fit into eight bytes.
                Some(_) if big_tiff => {
                    out.extend(
                        [number(value, 2), number(value, 2), number(value, 2), number(0, 2)]
                            .concat(),
                    );
                }
                Some(at) => out.extend(number(at, 4)),
                None => {
                    out.extend(number(value, 4));
                    out.extend(vec![0; offset - 4]);
                }
            }
        }
        link = out.len();
        out.extend(vec![0; offset]);
    }
    out
}

fn sheet(size: [u32; 2], first: u8) -> Sheet {
    let values = (0..3 * size[0] * size[1]).map(|i| first.wrapping_add(i as u8)).collect();
    Sheet { size, channels: 3, format: None, values: Values::Bytes(values) }
}

#[test]
fn the_largest_page_is_read_at_any_position() {
    for (big_tiff, big_endian) in [(false, false), (false, true), (true, false), (true, true)] {
        for (sizes, below, expected) in [
            (vec![[4, 3]], false, 0),
            (vec![[2, 2], [4, 3]], false, 1),
            (vec![[2, 2], [4, 3], [3, 3]], false, 1),
            (vec![[4, 3], [2, 2], [4, 3]], false, 0),
            (vec![[2, 2], [4, 3]], true, 1),
        ] {
            let pages: Vec<Sheet> =
                sizes.iter().enumerate().map(|(i, size)| sheet(*size, 40 * i as u8)).collect();
            let bytes = file(&pages, big_tiff, big_endian, below);
            let photo = Photo::decode(&bytes, Encoding::Linear, 1.0).unwrap();
            assert_eq!(
                (photo.width(), photo.height()),
                (4, 3),
                "{sizes:?} {big_tiff} {big_endian}"
            );
            assert_eq!(photo.pixel(0, 0)[0], f32::from(40 * expected as u8) / 255.0);
        }
    }
}

#[test]
fn wide_values_are_read() {
    let fractions = [0.0, 0.25, 0.5, 1.0, 0.125, 0.75];
    let words = |full: f64| fractions.map(|v| (v * full) as u32).to_vec();
    let gray = |values| Sheet { size: [3, 2], channels: 1, format: Some(FLOAT), values };
    let halves = fractions.map(half::f16::from_f64).to_vec();
    for (page, tolerance) in [
        (Sheet { format: None, ..gray(Values::Words(words(4_294_967_295.0))) }, 1.0 / 65_535.0),
        (Sheet { format: Some(1), ..gray(Values::Words(words(4_294_967_295.0))) }, 1.0 / 65_535.0),
        // Sixteen bits kept in 32.
        (Sheet { format: Some(1), ..gray(Values::Words(words(65_535.0))) }, 1.0 / 65_535.0),
        (gray(Values::Halves(halves.clone())), 0.0),
        (gray(Values::Doubles(fractions.to_vec())), 0.0),
    ] {
        for (big_tiff, big_endian) in [(false, true), (true, false)] {
            let bytes = file(std::slice::from_ref(&page), big_tiff, big_endian, false);
            let photo = Photo::decode(&bytes, Encoding::Linear, 1.0).unwrap();
            for (i, expected) in fractions.iter().enumerate() {
                let found = photo.pixel(i as u32 % 3, i as u32 / 3);
                assert!(
                    found.iter().all(|v| (f64::from(*v) - expected).abs() <= tolerance),
                    "{found:?}"
                );
            }
        }
    }
    let values = Values::Halves([halves.clone(), halves.clone(), halves].concat());
    let colour = Sheet { size: [3, 2], channels: 3, format: Some(FLOAT), values };
    let photo =
        Photo::decode(&file(&[colour], false, false, false), Encoding::Linear, 1.0).unwrap();
    assert_eq!(photo.pixel(0, 0), [0.0, 0.25, 0.5]);
    assert_eq!(photo.saturation(), f32::INFINITY);
}

#[test]
fn damaged_pages_are_errors() {
    let bytes = file(&[sheet([2, 2], 0), sheet([40, 30], 9)], false, false, true);
    for end in 0..bytes.len() {
        let _ = Photo::decode(&bytes[..end], Encoding::Linear, 1.0);
    }
    // A cyclic chain of pages.
    let mut ring = file(&[sheet([2, 2], 0), sheet([4, 3], 9)], false, false, false);
    let (first, end) = (ring[4..8].to_vec(), ring.len());
    ring[end - 4..].copy_from_slice(&first);
    assert!(Photo::decode(&ring, Encoding::Linear, 1.0).is_ok());
}
