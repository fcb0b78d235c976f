//! Segments of a JPEG file before its pixels.

/// Signature of a segment with a part of an ICC profile.
const PART: &[u8] = b"ICC_PROFILE\0";
/// Signatures of gain maps: the namespaces of Ultra HDR and of Apple, the name of ISO 21496-1.
const GAIN_MAPS: [&[u8]; 3] = [
    b"http://ns.adobe.com/hdr-gain-map/1.0/",
    b"http://ns.apple.com/HDRGainMap/1.0/",
    b"urn:iso:std:iso:ts:21496:-1",
];

/// Whether the file holds parts of an ICC profile. The decoder does not report missing parts.
pub fn has_parts_of_profile(bytes: &[u8]) -> bool {
    segments(bytes).any(|segment| segment.starts_with(PART))
}

/// Whether the file has a gain map.
pub fn has_gain_map(bytes: &[u8]) -> bool {
    let holds = |segment: &[u8], name: &[u8]| segment.windows(name.len()).any(|part| part == name);
    segments(bytes).any(|segment| GAIN_MAPS.iter().any(|name| holds(segment, name)))
}

/// Contents of the application segments before the pixels.
fn segments(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut at = 2;
    std::iter::from_fn(move || {
        loop {
            let &[0xFF, marker, high, low] = bytes.get(at..)?.first_chunk()? else { return None };
            if marker == 0xDA {
                return None;
            }
            let length = usize::from(u16::from_be_bytes([high, low])).max(2);
            let content = bytes.get(at + 4..at + 2 + length);
            at += 2 + length;
            if (0xE0..=0xEF).contains(&marker) {
                return content;
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_count_in_segments_only() {
        let name = GAIN_MAPS[2];
        let segment = |marker: u8, content: &[u8]| {
            let length = (content.len() as u16 + 2).to_be_bytes();
            [&[0xFF, marker][..], &length, content].concat()
        };
        let file = |parts: &[Vec<u8>]| [&[0xFF, 0xD8][..], &parts.concat()].concat();
        let table = segment(0xDB, &[0; 65]);
        assert!(has_gain_map(&file(&[table.clone(), segment(0xE2, name)])));
        assert!(!has_gain_map(&file(&[segment(0xDA, &[]), segment(0xE2, name)])));
        assert!(has_parts_of_profile(&file(&[segment(0xE2, b"ICC_PROFILE\0\x01\x02")])));
        assert!(!has_parts_of_profile(&file(&[segment(0xE2, b"MPF\0"), table])));
        for end in 0..12 {
            let whole = file(&[segment(0xE2, name)]);
            assert!(!has_gain_map(&whole[..end]));
        }
    }
}
