use super::*;
use crate::calibration::{Hole, TargetKind, TopLeft};

fn boards() -> Vec<Target> {
    let charuco = |rows, cols, square_mm, hole: [u32; 4], marker_mm, dictionary: &str| {
        let [row_start, col_start, row_end, col_end] = hole;
        Target {
            kind: TargetKind::CharucoRing { dictionary: dictionary.into(), marker_mm },
            rows,
            cols,
            square_mm,
            hole: Hole { row_start, col_start, row_end, col_end },
            ..Target::default()
        }
    };
    vec![
        Target::default(),
        charuco(17, 16, 11.5, [3, 3, 14, 13], 0.72 * 11.5, "DICT_4X4_250"),
        charuco(10, 9, 15.0, [3, 3, 7, 6], 9.0, "DICT_5X5_100"),
    ]
}

/// CRC-32 of files that were printed and measured. Boards in use must not change by a byte.
#[test]
fn sheets_stay_as_they_were_printed() {
    let expected = [
        ("ring, A4, pdf", 0x41f1_f948),
        ("ring, A4, svg", 0xd6aa_e280),
        ("ring, Letter, pdf", 0x3565_9c8d),
        ("ring, Letter, svg", 0xe7c4_22e6),
        ("charuco, A4, pdf", 0x5115_a07d),
        ("charuco, A4, svg", 0x02cd_7a4f),
        ("charuco, Letter, pdf", 0x0eb2_2407),
        ("charuco, Letter, svg", 0x7ef2_9816),
        ("charuco of 5x5, A4, pdf", 0x4fa9_54fa),
        ("charuco of 5x5, A4, svg", 0x5ccb_1cf2),
        ("charuco of 5x5, Letter, pdf", 0x04bf_da7c),
        ("charuco of 5x5, Letter, svg", 0xc36c_646f),
    ];
    let mut sums = expected.iter();
    for target in boards() {
        for paper in [Paper::A4, Paper::Letter] {
            let sheet = BoardSheet::new(&target, paper).unwrap();
            for format in [SheetFormat::Pdf, SheetFormat::Svg] {
                let sum = crc32fast::hash(&sheet.encode(format).unwrap());
                let (name, expected) = sums.next().unwrap();
                assert_eq!(sum, *expected, "{name}: {sum:#010x}");
            }
        }
    }
}

#[test]
fn boards_that_cannot_be_printed_say_why() {
    let refused = |target: Target, paper| BoardSheet::new(&target, paper).unwrap_err().to_string();
    let large = Target { square_mm: 13.0, ..Target::default() };
    assert!(refused(large.clone(), Paper::A4).contains("too large"));
    assert!(refused(Target { rows: 2, ..large }, Paper::A4).contains("rows"));
    let mut few = boards().swap_remove(1);
    few.kind = TargetKind::CharucoRing { dictionary: "DICT_4X4_50".into(), marker_mm: 8.0 };
    assert!(refused(few, Paper::A4).contains("DICT_4X4_250"));
    // 240 mm of squares and the parts below them exceed a sheet of 279.4 mm.
    let long = Target { rows: 19, cols: 14, square_mm: 12.6, ..Target::default() };
    assert!(refused(long.clone(), Paper::Letter).contains("too large"));
    assert!(BoardSheet::new(&Target { patches: false, ..long }, Paper::Letter).is_ok());
}

#[test]
fn colours_and_patches_are_those_of_the_board() {
    let svg = |target: &Target| {
        let sheet = BoardSheet::new(target, Paper::A4).unwrap();
        String::from_utf8(sheet.encode(SheetFormat::Svg).unwrap()).unwrap()
    };
    let black = Target::default();
    let squares = |svg: &str| svg.matches("width=\"11.500\" height=\"11.500\"").count();
    // A square of 184 mm centred on 210 mm.
    let top_left = "x=\"13.000\" y=\"20.000\" width=\"11.500\"";
    assert!(svg(&black).contains(top_left) && svg(&black).contains("fill=\"#808080\""));
    let white = Target { top_left: TopLeft::White, patches: false, ..black };
    let printed = svg(&white);
    assert!(!printed.contains(top_left) && !printed.contains("fill=\"#808080\""));
    assert_eq!(squares(&printed), (17 * 16 - 11 * 10) / 2);
}
