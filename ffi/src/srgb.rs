//! Linear values as 8-bit sRGB, without a power for each.

use std::sync::LazyLock;

use engine::photo::Encoding;

/// Parts of [0, 1] for each of which the table has a byte to begin with: none is wider than the
/// steps of sRGB are in the dark.
const PARTS: usize = 4096;

struct Table {
    /// The smallest linear value that rounds to each byte.
    least: [f32; 256],
    /// The byte of each part's beginning.
    first: [u8; PARTS + 1],
}

static TABLE: LazyLock<Table> = LazyLock::new(|| {
    let mut least = [0.0; 256];
    for (byte, least) in least.iter_mut().enumerate().skip(1) {
        *least = Encoding::Srgb.decode((byte as f64 - 0.5) / 255.0) as f32;
    }
    let of_part = |part: usize| {
        let begins = part as f32 / PARTS as f32;
        (least.partition_point(|least| *least <= begins).max(1) - 1) as u8
    };
    let mut first = [0; PARTS + 1];
    for (part, first) in first.iter_mut().enumerate() {
        *first = of_part(part);
    }
    Table { least, first }
});

/// The nearest byte; values beyond [0, 1] are clipped, NaN is 0.
pub(crate) fn byte(linear: f32) -> u8 {
    let table = &*TABLE;
    let linear = linear.clamp(0.0, 1.0);
    // NaN becomes 0.
    let mut byte = table.first[(linear * PARTS as f32) as usize];
    while byte < 255 && linear >= table.least[usize::from(byte) + 1] {
        byte += 1;
    }
    byte
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_those_of_the_closed_form() {
        for i in 0..=1_000_000 {
            let linear = i as f32 / 1e6;
            let exact = 255.0 * Encoding::Srgb.encode(f64::from(linear));
            // Only the middle between two bytes may go either way: single precision.
            let off = (exact - f64::from(byte(linear))).abs();
            assert!(off < 0.5 + 1e-4, "{linear}: {exact}");
        }
        for (linear, expected) in [(-1.0, 0), (f32::NAN, 0), (7.0, 255), (f32::INFINITY, 255)] {
            assert_eq!(byte(linear), expected, "{linear}");
        }
    }
}
