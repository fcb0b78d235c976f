//! Raw photographs.

mod common;
#[allow(dead_code)] // Other tests use the rest.
#[path = "../../tests/common/negatives.rs"]
mod negatives;

use std::fs;
use std::path::Path;

use common::{maps, run, succeed, text};
use glam::{DMat3, DVec3};
use negatives::{Negative, Storage, Values};
use serde_json::Value;
use svbrdf::capture::Capture;
use svbrdf::files::{self, Options};
use svbrdf::photo::{Photo, Primaries, Rotation};

const SIZE: [u32; 2] = [38, 26];
const WHITE: f64 = 16_000.0;
const BLACK: f64 = 256.0;
/// One step of 14 bits and of the 16 that a photograph keeps, and the matrix's rounding.
const STEP: f64 = 1.5e-4;

/// The matrix from linear Rec. 709 to the sensor's values.
fn mixed() -> DMat3 {
    let rows = [[0.35, 0.15, 0.05], [0.2, 0.7, 0.1], [0.05, 0.15, 0.5]];
    DMat3::from_cols_array_2d(&rows).transpose()
}

fn rows(matrix: DMat3) -> Values {
    Values::Millionths(matrix.transpose().to_cols_array().to_vec())
}

/// A picture that changes linearly from pixel to pixel, which demosaicking gives back exactly.
fn ramp(x: u32, y: u32) -> DVec3 {
    let (x, y) = (f64::from(x), f64::from(y));
    DVec3::new(0.2 + 0.006 * x, 0.5 - 0.004 * x + 0.004 * y, 0.3 + 0.005 * y)
}

/// The file of a camera that sees `picture`, behind filters red, green; green, blue.
fn negative(mix: DMat3, picture: impl Fn(u32, u32) -> DVec3) -> Negative {
    let [w, h] = SIZE;
    let samples = (0..w * h).map(|i| {
        let (x, y) = (i % w, i / w);
        let seen = mix * picture(x, y);
        let value = seen[(x % 2 + y % 2) as usize];
        (BLACK + value * (WHITE - BLACK)).round().min(WHITE) as u16
    });
    let xyz_to_camera = mix * Primaries::Rec709.to_xyz().inverse();
    Negative {
        size: SIZE,
        bits: 16,
        channels: 1,
        samples: samples.collect(),
        storage: Storage::Strips(h),
        big_endian: false,
        below: false,
        fields: vec![
            (33421, Values::Shorts(vec![2, 2])),
            (33422, Values::Bytes(vec![0, 1, 1, 2])),
            (50706, Values::Bytes(vec![1, 4, 0, 0])),
            (50714, Values::Longs(vec![BLACK as u32])),
            (50717, Values::Longs(vec![WHITE as u32])),
            (50721, rows(xyz_to_camera)),
            (50728, Values::Millionths((mix * DVec3::ONE).to_array().to_vec())),
            (50778, Values::Shorts(vec![21])),
        ],
    }
}

fn read(negative: &Negative) -> Result<Photo, String> {
    read_bytes(&negative.bytes())
}

fn read_bytes(bytes: &[u8]) -> Result<Photo, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("shot.dng");
    fs::write(&path, bytes).unwrap();
    let options = Options { exposure: Some(1.0), ..Options::default() };
    files::read(&path, &options).map(|d| d.photo).map_err(|fault| fault.to_string())
}

/// Largest difference from a picture without a margin of two pixels, outside of which it is not a ramp. Values are
/// those of the scene.
fn error(photo: &Photo, picture: impl Fn(u32, u32) -> DVec3) -> f64 {
    let mut largest = 0.0f64;
    for y in 2..photo.height() - 2 {
        for x in 2..photo.width() - 2 {
            let seen = photo.pixel(x, y).map(|v| f64::from(v / photo.exposure()));
            let difference = DVec3::from_array(seen) - picture(x, y);
            largest = largest.max(difference.abs().max_element());
        }
    }
    largest
}

/// The same brightness that green has where the camera's white is not 1.
fn green(mix: DMat3) -> f64 {
    (mix * DVec3::ONE).y
}

#[test]
fn every_storage_gives_the_same_photograph() {
    let plain = negative(DMat3::IDENTITY, ramp);
    let known = read(&plain).unwrap();
    let off = error(&known, ramp);
    assert!(off < STEP, "{off}");
    let mut storages = vec![Storage::Strips(5), Storage::Strips(1), Storage::Tiles(16, 16)];
    for predictor in 1..=7 {
        storages.push(Storage::Jpeg(16, 16, predictor, 1));
        storages.push(Storage::Jpeg(48, 32, predictor, 2));
    }
    for storage in storages {
        for (big_endian, below) in [(false, false), (true, false), (false, true), (true, true)] {
            let other = Negative { storage, big_endian, below, ..plain.clone() };
            let photo = read(&other).unwrap();
            let same = photo.to_linear() == known.to_linear();
            assert!(same, "{storage:?}, big endian {big_endian}, below {below}");
        }
    }
}

#[test]
fn values_of_all_widths_are_read() {
    let wide = negative(DMat3::IDENTITY, ramp);
    for bits in [8, 10, 12, 14, 15] {
        let shift = 14 - bits.min(14);
        let samples = wide.samples.iter().map(|v| v >> shift).collect();
        let levels = |v: f64| Values::Longs(vec![v as u32 >> shift]);
        let narrow = Negative { bits, samples, ..wide.clone() };
        let narrow = narrow.set(50714, levels(BLACK)).set(50717, levels(WHITE));
        let packed = read(&narrow).unwrap();
        // Values are cut to a step of so many bits; the filters' weights add up to at most 2.75.
        let off = error(&packed, ramp);
        let most = STEP + 2.75 * f64::from(1 << shift) / (WHITE - BLACK);
        assert!(off < most, "{bits} bits: {off}, at most {most}");
        let jpeg = Negative { storage: Storage::Jpeg(16, 16, 1, 2), ..narrow };
        assert_eq!(read(&jpeg).unwrap().to_linear(), packed.to_linear(), "{bits} bits");
    }
    // Differences of 16 bits, up to the largest there is.
    let mut steep = negative(DMat3::IDENTITY, ramp);
    for (i, value) in steep.samples.iter_mut().enumerate() {
        *value = [0, 65_535, 32_768, 1, 32_767][i * i % 5];
    }
    let known = read(&steep).unwrap().to_linear();
    for predictor in 1..=7 {
        steep.storage = Storage::Jpeg(48, 32, predictor, 1);
        assert_eq!(read(&steep).unwrap().to_linear(), known, "predictor {predictor}");
    }
}

#[test]
fn colours_and_grays_come_out_as_they_were() {
    let mix = mixed();
    let colour = negative(mix, ramp);
    let scaled = |x, y| ramp(x, y) * green(mix);
    // Noise of the steps, as the camera's matrix is undone: its inverse's rows add up to 6.
    let off = error(&read(&colour).unwrap(), scaled);
    assert!(off < 6.0 * STEP, "{off}");

    // The matrix for D65 is taken, wherever it stands.
    let wrong = rows(DMat3::from_diagonal(DVec3::new(1.0, 0.3, 2.0)));
    let right = rows(mix * Primaries::Rec709.to_xyz().inverse());
    let both = colour.clone().set(50722, wrong.clone()).set(50779, Values::Shorts(vec![17]));
    assert!(error(&read(&both).unwrap(), scaled) < 6.0 * STEP);
    let both = colour.clone().set(50721, wrong).set(50778, Values::Shorts(vec![17]));
    let both = both.set(50722, right).set(50779, Values::Shorts(vec![21]));
    assert!(error(&read(&both).unwrap(), scaled) < 6.0 * STEP);

    // Factors that stand in fields of their own.
    let (balance, own) = (DVec3::new(1.25, 1.0, 0.8), DVec3::new(0.9, 1.0, 1.1));
    let rest = DMat3::from_diagonal((balance * own).recip());
    let split = colour.set(50721, rows(rest * mix * Primaries::Rec709.to_xyz().inverse()));
    let split = split.set(50723, rows(DMat3::from_diagonal(own)));
    let split = split.set(50727, Values::Millionths(balance.to_array().to_vec()));
    assert!(error(&read(&split).unwrap(), scaled) < 6.0 * STEP);

    // A gray under warm light is neutral, whatever the matrix says of the light.
    let warm = DVec3::new(1.3, 1.0, 0.55);
    let gray = negative(mix, |_, _| 0.4 * warm);
    let gray = gray.set(50728, Values::Millionths((mix * warm).to_array().to_vec()));
    let level = 0.4 * (mix * warm).y;
    let off = error(&read(&gray).unwrap(), |_, _| DVec3::splat(level));
    assert!(off < 1e-3, "{off}");
}

/// The same camera's file when it has demosaicked the values itself.
fn demosaicked(mix: DMat3, picture: impl Fn(u32, u32) -> DVec3) -> Negative {
    let plain = negative(mix, &picture);
    let [w, h] = SIZE;
    let stored = |v: f64| (BLACK + v * (WHITE - BLACK)).round().min(WHITE) as u16;
    let pixel = |i| (mix * picture(i % w, i / w)).to_array().map(stored);
    let samples = (0..w * h).flat_map(pixel).collect();
    Negative { channels: 3, samples, ..plain }.without(33421).without(33422)
}

#[test]
fn demosaicked_files_are_read() {
    let mix = mixed();
    let scaled = |x, y| ramp(x, y) * green(mix);
    let plain = demosaicked(mix, ramp);
    let known = read(&plain).unwrap();
    assert!(error(&known, scaled) < 6.0 * STEP);
    for storage in [Storage::Strips(5), Storage::Tiles(16, 16), Storage::Jpeg(16, 16, 1, 3)] {
        for (big_endian, below) in [(false, true), (true, false)] {
            let other = Negative { storage, big_endian, below, ..plain.clone() };
            assert!(read(&other).unwrap().to_linear() == known.to_linear(), "{storage:?}");
        }
    }
    // Fewer bits, and a level of darkness for each channel.
    let samples = plain.samples.iter().map(|v| v >> 4).collect();
    let narrow = Negative { bits: 10, samples, ..plain.clone() };
    let narrow = narrow.set(50714, Values::Longs(vec![BLACK as u32 >> 4; 3]));
    let narrow = narrow.set(50717, Values::Longs(vec![WHITE as u32 >> 4; 3]));
    assert!(error(&read(&narrow).unwrap(), scaled) < 6.0 * 16.0 * STEP);
    // Cropped and turned as others are.
    let turned = plain.clone().set(274, Values::Shorts(vec![6]));
    let turned =
        turned.set(50719, Values::Longs(vec![4, 2])).set(50720, Values::Longs(vec![20, 10]));
    let photo = read(&turned).unwrap();
    let expected = known.cropped(4, 2, 20, 10).turned(Rotation::Quarter);
    assert!(photo.to_linear() == expected.to_linear() && photo.width() == 10);
    let bright = demosaicked(DMat3::IDENTITY, |x, _| DVec3::splat(if x < 20 { 0.5 } else { 1.2 }));
    let photo = read(&bright).unwrap();
    assert!(!photo.is_clipped(10, 10) && photo.is_clipped(30, 10));
}

#[test]
fn white_may_be_a_chromaticity_and_matrices_are_interpolated() {
    let mix = mixed();
    let scaled = |x, y| ramp(x, y) * green(mix);
    // D65.
    let by_place = negative(mix, ramp).without(50728);
    let by_place = by_place.set(50729, Values::Millionths(vec![0.312_727, 0.329_023]));
    assert!(error(&read(&by_place).unwrap(), scaled) < 1e-3);

    // CIE's illuminant B, 4874 K, between A (2856 K) and D65 (6504 K): shares in reciprocals.
    let to_camera = |turn: f64| {
        let turned = DMat3::from_diagonal(DVec3::new(1.0 + turn, 1.0, 1.0 - turn));
        turned * mix * Primaries::Rec709.to_xyz().inverse()
    };
    let (a, d65) = (to_camera(0.2), to_camera(0.0));
    let share = (1.0 / 4874.0 - 1.0 / 6504.0) / (1.0 / 2856.0 - 1.0 / 6504.0);
    let between = a * share + d65 * (1.0 - share);
    let white = Values::Millionths(vec![0.348_42, 0.351_61]);
    let base = negative(mix, ramp).without(50728).set(50729, white);
    let single = base.clone().set(50721, rows(between)).without(50778);
    let both = base.set(50721, rows(a)).set(50722, rows(d65));
    let swapped = both.clone().set(50721, rows(d65)).set(50722, rows(a));
    let lights = |n: Negative, first: u16, second: u16| {
        n.set(50778, Values::Shorts(vec![first])).set(50779, Values::Shorts(vec![second]))
    };
    let expected = read(&single).unwrap().to_linear();
    for interpolated in [lights(both.clone(), 17, 21), lights(swapped, 21, 17)] {
        let found = read(&interpolated).unwrap().to_linear();
        let off = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // The temperature comes from a formula good to some kelvin.
        assert!(off < 1e-3, "{off}");
    }
    // Under D65, only the matrix for it counts.
    let day = lights(both, 17, 21).without(50729);
    let day = day.set(50728, Values::Millionths((mix * DVec3::ONE).to_array().to_vec()));
    assert!(error(&read(&day).unwrap(), scaled) < 6.0 * STEP);
    let neither = negative(mix, ramp).without(50728);
    assert!(read(&neither).unwrap_err().contains("neither AsShotNeutral nor AsShotWhiteXY"));
}

#[test]
fn black_white_and_clipped_values_are_told() {
    let levels = [100u32, 300, 500, 700];
    let mut uneven = negative(DMat3::IDENTITY, ramp);
    for (i, value) in uneven.samples.iter_mut().enumerate() {
        let (x, y) = (i as u32 % SIZE[0], i as u32 / SIZE[0]);
        let black = f64::from(levels[(y % 2 * 2 + x % 2) as usize]);
        let seen = ramp(x, y)[(x % 2 + y % 2) as usize];
        *value = (black + seen * (WHITE - black)).round() as u16;
    }
    let uneven =
        uneven.set(50713, Values::Shorts(vec![2, 2])).set(50714, Values::Longs(levels.to_vec()));
    let off = error(&read(&uneven).unwrap(), ramp);
    assert!(off < STEP, "{off}");

    let bright = negative(DMat3::IDENTITY, |x, _| DVec3::splat(if x < 20 { 0.5 } else { 1.2 }));
    let photo = read(&bright).unwrap();
    assert!(!photo.is_clipped(10, 10) && photo.is_clipped(30, 10));
}

#[test]
fn photographs_stand_upright_and_are_cropped() {
    let plain = negative(DMat3::IDENTITY, ramp);
    let known = read(&plain).unwrap();
    for (orientation, rotation) in
        [(3, Rotation::Half), (6, Rotation::Quarter), (8, Rotation::ThreeQuarters)]
    {
        let turned = read(&plain.clone().set(274, Values::Shorts(vec![orientation]))).unwrap();
        let expected = known.cropped(0, 0, SIZE[0], SIZE[1]).turned(rotation);
        assert_eq!((turned.width(), turned.height()), (expected.width(), expected.height()));
        assert_eq!(turned.to_linear(), expected.to_linear());
    }
    // The active area begins with green and red; the crop inside it leaves the patterns as they are.
    let active = plain.set(50829, Values::Longs(vec![2, 3, 24, 37]));
    let active = active.set(33422, Values::Bytes(vec![1, 0, 2, 1]));
    let photo = read(&active).unwrap();
    assert_eq!((photo.width(), photo.height()), (34, 22));
    assert!(error(&photo, |x, y| ramp(x + 3, y + 2)) < STEP);
    let crop = active.set(50719, Values::Longs(vec![5, 3])).set(50720, Values::Longs(vec![20, 12]));
    let photo = read(&crop).unwrap();
    assert_eq!((photo.width(), photo.height()), (20, 12));
    assert!(error(&photo, |x, y| ramp(x + 8, y + 5)) < STEP);
}

#[test]
fn gain_maps_undo_the_shading() {
    // Four maps of 2 x 2 points, one for each place of the pattern, as Android writes them.
    let gain = |x: f64| 1.0 + 0.5 * x / f64::from(SIZE[0]);
    let mut list = 4u32.to_be_bytes().to_vec();
    for place in 0..4u32 {
        let mut body = Vec::new();
        let numbers = [place / 2, place % 2, SIZE[1], SIZE[0], 0, 1, 2, 2, 2, 2];
        numbers.iter().for_each(|v| body.extend(v.to_be_bytes()));
        [1.0f64, 1.0, 0.0, 0.0].iter().for_each(|v| body.extend(v.to_be_bytes()));
        body.extend(1u32.to_be_bytes());
        [1.0f32, 1.5, 1.0, 1.5].iter().for_each(|v| body.extend(v.to_be_bytes()));
        [9, 0x0103_0000, 0, body.len() as u32].iter().for_each(|v| list.extend(v.to_be_bytes()));
        list.extend(body);
    }
    let shaded = negative(DMat3::IDENTITY, |x, y| ramp(x, y) / gain(f64::from(x) + 0.5));
    assert!(error(&read(&shaded).unwrap(), ramp) > 0.1);
    // Steps are stretched by up to 1.5, and by the filters' weights.
    let off = error(&read(&shaded.set(51009, Values::Raw(list))).unwrap(), ramp);
    assert!(off < 2.0 * STEP, "{off}");
}

#[test]
fn faults_are_named() {
    let plain = negative(DMat3::IDENTITY, ramp);
    let longs = |v: &[u32]| Values::Longs(v.to_vec());
    for (bad, expected) in [
        (plain.clone().without(50706), "a raw file of a camera maker"),
        (plain.clone().without(50721), "no colour matrix"),
        (plain.clone().without(50728), "AsShotNeutral"),
        (plain.clone().set(259, Values::Shorts(vec![8])), "compression 8"),
        (plain.clone().set(259, Values::Shorts(vec![34892])), "compression 34892"),
        (plain.clone().set(262, Values::Shorts(vec![34892])), "sees no colours"),
        (plain.clone().set(259, Values::Shorts(vec![52546])), "JPEG XL: "),
        (plain.clone().set(50975, longs(&[27])), "tag 50975 is 27; 1 to 26 fields"),
        (plain.clone().set(33421, Values::Shorts(vec![6, 6])), "colour filters 6 x 6"),
        (plain.clone().set(256, longs(&[4_000_000])).set(257, longs(&[4_000_000])), "4000000 x"),
        (plain.clone().set(256, longs(&[0])), "0 x 26"),
        (plain.clone().set(258, Values::Shorts(vec![32])), "32 bits"),
        (plain.clone().set(274, Values::Shorts(vec![2])), "orientation 2"),
        (plain.clone().set(257, longs(&[400])), "1 blocks of 16"),
        (plain.clone().set(50829, longs(&[0, 0, 400, 400])), "active area"),
        (plain.clone().set(50713, Values::Shorts(vec![0, 9])), "black levels"),
    ] {
        let said = read(&bad).err().unwrap_or_default();
        assert!(said.contains(expected) && said.contains("shot.dng"), "{expected}: {said}");
    }
    let said = read_bytes(b"hello").err().unwrap();
    assert!(said.contains("not a picture") && said.contains("shot.dng"), "{said}");
}

#[test]
fn damaged_files_are_photographs_or_errors() {
    let plain = negative(mixed(), ramp);
    let jpeg = Storage::Jpeg(16, 16, 1, 2);
    for file in [plain.clone(), Negative { storage: jpeg, below: true, ..plain }] {
        let whole = file.bytes();
        for end in (0..whole.len()).step_by(97) {
            // The directories are at the end, so that none of these is a photograph.
            let said = read_bytes(&whole[..end]).err().unwrap();
            assert!(said.contains("shot.dng"), "{end}: {said}");
        }
        let mut state = 1u64;
        let mut random = |below: usize| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % below
        };
        for round in 0..2000 {
            let mut bytes = whole.clone();
            // Half of them in the directories.
            let from = if round % 2 == 0 { 0 } else { whole.len() - 500 };
            for _ in 0..=round % 3 {
                let at = from + random(whole.len() - from);
                bytes[at] ^= 1 << random(8);
            }
            match read_bytes(&bytes) {
                Ok(photo) => assert!(photo.width() > 0 && photo.is_finite()),
                Err(said) => assert!(said.contains("shot.dng"), "{said}"),
            }
        }
    }
}

/// Writes a photograph as a camera with a mixing sensor would, all fields in the first directory as
/// Android has them.
fn save(photo: &Photo, exposure: f32, path: &Path) {
    let mix = mixed();
    let size = [photo.width(), photo.height()];
    let samples = (0..size[0] * size[1]).map(|p| {
        let (x, y) = (p % size[0], p / size[0]);
        let seen = mix * DVec3::from_array(photo.pixel(x, y).map(f64::from));
        // Pixels that are clipped in the picture were clipped on the sensor.
        let value = if photo.is_clipped(x, y) { 1.0 } else { seen[(x % 2 + y % 2) as usize] };
        (BLACK + value * (WHITE - BLACK)).round().min(WHITE) as u16
    });
    let storage = Storage::Jpeg(256, 256, 1, 2);
    let empty = negative(mix, |_, _| DVec3::ZERO);
    Negative { size, samples: samples.collect(), storage, ..empty }
        .set(272, Values::Text("Phone"))
        .set(33434, Values::Millionths(vec![f64::from(exposure) / 50.0]))
        .set(34855, Values::Shorts(vec![100]))
        .set(37385, Values::Shorts(vec![0]))
        .save(path);
}

/// Fits quickly. Returns the messages and the report.
fn fit(inputs: &[&str], out: &Path) -> (String, Value) {
    let fast = ["--resolution", "256", "--method", "classic", "--steps", "2"];
    let fast = [&fast[..], &["--no-report", "--at-once"]].concat();
    let output = run(&[&["fit", "--out", text(out)][..], &fast, inputs].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let report = serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    (said, report)
}

/// Three simulated photographs as PNG and as DNG give the same maps.
#[test]
fn a_fit_of_raw_photographs_is_that_of_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let [capture, raw] = [at("capture"), at("raw")];
    svbrdf::export::write_maps(at("known"), &maps(32), &svbrdf::export::MapsOptions::default())
        .unwrap();
    succeed(&["simulate", text(&at("known")), "--out", text(&capture), "--frames", "3"]);
    fs::create_dir(&raw).unwrap();
    let file = capture.join("capture.json");
    let mut description: Value = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
    for (i, file) in Capture::load(&capture).unwrap().photos.iter().enumerate() {
        let name = format!("{i}.dng");
        save(&file.read().unwrap(), [1.0, 2.0, 0.5][i], &raw.join(&name));
        description["frames"][i]["image"] = name.into();
        description["frames"][i]["encoding"] = "linear".into();
    }

    // Without a description: metadata, and the description that is written.
    let (said, _) = fit(&[text(&raw), "--sample-mm", "100"], &at("loose"));
    assert!(said.contains("the flash did not fire") && !said.contains("no exposure"), "{said}");
    let written = Capture::load(at("loose")).unwrap();
    let exposures: Vec<f32> = written.photos.iter().map(|file| file.exposure).collect();
    assert_eq!(exposures, [1.0, 2.0, 0.5]);

    // Of the same description, the same comes out.
    fs::write(raw.join("capture.json"), description.to_string()).unwrap();
    let (_, known) = fit(&[text(&capture)], &at("maps-png"));
    let (_, found) = fit(&[text(&raw)], &at("maps-raw"));
    let rows = |report: &Value| report["frames"].as_array().unwrap().clone();
    assert_eq!(rows(&found).len(), 3);
    for (raw, png) in rows(&found).iter().zip(rows(&known)) {
        assert_eq!((&raw["status"], &raw["hints"]), (&"accepted".into(), &png["hints"]));
        assert!(!raw["hints"].to_string().contains("not_linear"), "{raw}");
        for axis in 0..3 {
            let place = |row: &Value| row["translation_mm"][axis].as_f64().unwrap();
            let (a, b) = (place(raw), place(&png));
            // Mosaic and demosaicking move corners by hundredths of a pixel, of some 0.1 mm.
            assert!((a - b).abs() < 0.1, "{a} and {b} mm");
        }
    }
    let read = |name: &str| svbrdf::export::read_maps(at(name)).unwrap();
    let (raw, png) = (read("maps-raw"), read("maps-png"));
    for c in 0..3 {
        let channel = svbrdf::svbrdf::channel::DIFFUSE + c;
        let pairs = raw.plane(channel).iter().zip(png.plane(channel));
        let off: f32 = pairs.map(|(a, b)| (a - b).abs()).sum::<f32>();
        let off = off / png.plane(channel).len() as f32;
        // Demosaicking blurs the stripes of 0.2 and 0.6 at their edges only.
        assert!(off < 0.01, "diffuse of channel {c} differs by {off}");
    }

    // Raw values have no curve.
    description["frames"][1]["encoding"] = "gamma2.2".into();
    fs::write(at("raw").join("capture.json"), description.to_string()).unwrap();
    let (status, said) = common::failure(&["fit", text(&at("raw")), "--out", text(&at("none"))]);
    assert!(status != 0 && said.contains("1.dng") && said.contains("`linear`"), "{said}");
}
