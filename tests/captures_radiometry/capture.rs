//! A rendered capture with its truth.

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;
use svbrdf::calibration::photometry::{
    FlashOffset, Lobe, PhotometricCalibrator, Radiometry, Vignetting,
};
use svbrdf::calibration::{Hole, Target, TargetKind, TopLeft};
use svbrdf::geometry::{Camera, Pose};
use svbrdf::photo::{Photo, ToneCurve};

use crate::picture::picture;

use crate::test_data::test_data;

pub(crate) const CAPTURES: [&str; 5] =
    ["bricks-charuco", "leather", "metal-charuco-ambient5", "tile", "tile-linear16"];
pub(crate) const SIZE: usize = 512;

/// The folder of the captures.
pub(crate) fn data() -> Option<PathBuf> {
    test_data("captures/dev")
}

pub(crate) fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("a number expected, found {v}"))
}

pub(crate) fn numbers<const N: usize>(v: &Value) -> [f64; N] {
    std::array::from_fn(|i| number(&v[i]))
}

pub(crate) fn srgb_to_linear(v: f64) -> f64 {
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

pub(crate) struct Capture {
    pub(crate) folder: PathBuf,
    pub(crate) capture: Value,
    pub(crate) truth: Value,
    pub(crate) target: Target,
    pub(crate) camera: Camera,
    pub(crate) offset: DVec3,
    pub(crate) sample_mm: [f32; 2],
}

impl Capture {
    pub(crate) fn open(root: &Path, name: &str) -> Self {
        let folder = root.join(name);
        let read = |file: &str| -> Value {
            let text = std::fs::read_to_string(folder.join(file)).unwrap();
            serde_json::from_str(&text).unwrap()
        };
        let (capture, truth) = (read("capture.json"), read("truth/truth.json"));
        let board = &capture["board"];
        let hole: [f64; 4] = numbers(&board["hole_squares"]);
        let kind = match board["kind"].as_str() {
            Some("charuco-ring") => TargetKind::CharucoRing {
                dictionary: board["dictionary"].as_str().unwrap().into(),
                marker_mm: number(&board["marker_mm"]),
            },
            _ => TargetKind::CheckerboardRing,
        };
        let target = Target {
            kind,
            rows: number(&board["rows"]) as u32,
            cols: number(&board["cols"]) as u32,
            square_mm: number(&board["square_mm"]),
            hole: Hole {
                row_start: hole[0] as u32,
                col_start: hole[1] as u32,
                row_end: hole[2] as u32,
                col_end: hole[3] as u32,
            },
            white_albedo: number(&board["white_albedo"]),
            black_albedo: number(&board["black_albedo"]),
            top_left: if board["top_left"] == "black" { TopLeft::Black } else { TopLeft::White },
            patches: false,
        };
        let camera: Camera = serde_json::from_value(capture["camera"].clone()).unwrap();
        let offset = DVec3::from_array(numbers(&truth["flash"]["offset_camera_mm"]));
        let sample = &capture["sample"];
        let sample_mm = [number(&sample["width_mm"]) as f32, number(&sample["height_mm"]) as f32];
        Self { folder, capture, truth, target, camera, offset, sample_mm }
    }

    pub(crate) fn photos(&self) -> usize {
        self.capture["frames"].as_array().unwrap().len()
    }

    pub(crate) fn pose(&self, frame: usize) -> Pose {
        let f = &self.truth["frames"][frame];
        let rows: [[f64; 3]; 3] = std::array::from_fn(|i| numbers(&f["R"][i]));
        Pose {
            rotation: DMat3::from_cols_array_2d(&rows).transpose(),
            translation: DVec3::from_array(numbers(&f["t"])),
        }
    }

    pub(crate) fn photo(&self, frame: usize) -> Photo {
        let f = &self.capture["frames"][frame];
        let image = picture(self.folder.join(f["image"].as_str().unwrap()));
        let (w, h) = (image.width(), image.height());
        let rgb: Vec<f32> = if f["encoding"] == "linear" {
            image.to_rgb16().into_raw().iter().map(|v| f32::from(*v) / 65535.0).collect()
        } else {
            let table: Vec<f32> =
                (0..256).map(|v| srgb_to_linear(f64::from(v) / 255.0) as f32).collect();
            image.to_rgb8().into_raw().iter().map(|v| table[usize::from(*v)]).collect()
        };
        let exposure = f.get("exposure").map_or(1.0, number) as f32;
        // JPEG rings round clipped areas: 250 of 255 counts as clipped.
        let saturation =
            if f["encoding"] == "linear" { 0.999 } else { srgb_to_linear(250.0 / 255.0) as f32 };
        Photo::from_linear(w, h, rgb, exposure, saturation).unwrap()
    }

    /// Distance of the first photo's light from the sample's centre, mm.
    pub(crate) fn reference_mm(&self) -> f64 {
        self.pose(0).to_board(self.offset).length()
    }

    /// True vignetting at `cos`.
    pub(crate) fn vignetting(&self, cos: f64) -> f64 {
        1.0 - number(&self.truth["vignetting"]["a"]) * (1.0 - cos.powi(4))
    }

    pub(crate) fn lobe_exponent(&self) -> f64 {
        number(&self.truth["flash"]["cos_exponent"])
    }

    /// Value of a white surface of albedo 1 that faces the flash on the axis at the reference.
    pub(crate) fn true_scale(&self) -> f64 {
        let intensity = number(&self.truth["flash"]["radiant_intensity"]);
        let exposure = number(&self.truth["sensor"]["exposure"]);
        exposure * intensity / std::f64::consts::PI / self.reference_mm().powi(2)
    }

    /// Ambient irradiance over the flash's at the reference distance.
    pub(crate) fn true_ambient(&self) -> [f64; 3] {
        let flash = number(&self.truth["flash"]["radiant_intensity"]) / self.reference_mm().powi(2);
        match self.truth["ambient"].get("irradiance_rgb") {
            Some(rgb) => numbers::<3>(rgb).map(|v| v / flash),
            None => [0.0; 3],
        }
    }

    pub(crate) fn true_radiometry(&self, frame: usize) -> Radiometry {
        // The best two-parameter form of the true response, to 0.1 % over the photo.
        let fit = |cos: f64| (-self.vignetting(cos).ln(), -cos.ln());
        let (mut aa, mut ab, mut bb, mut ay, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for i in 1..100 {
            let (y, u) = fit(1.0 - 0.002 * f64::from(i));
            let (a, b) = (u, u * u);
            (aa, ab, bb) = (aa + a * a, ab + a * b, bb + b * b);
            (ay, by) = (ay + a * y, by + b * y);
        }
        let det = aa * bb - ab * ab;
        let power = std::f64::consts::PI * self.reference_mm().powi(2);
        let centre = (self.pose(frame).translation - self.offset).normalize();
        let lobe = centre.z.powf(self.lobe_exponent());
        Radiometry {
            tone: ToneCurve::default(),
            gain: [1.0 / self.true_scale(); 3],
            vignetting: Vignetting {
                exponent: (ay * bb - by * ab) / det,
                curvature: (by * aa - ay * ab) / det,
            },
            lobe: Lobe { exponent: self.lobe_exponent(), ..Lobe::default() },
            flash_offset_mm: self.offset,
            power_mm2: [power as f32; 3],
            ambient: self.true_ambient().map(|v| (v / lobe) as f32),
            log_sigma: 0.0,
            veil: 0.0,
        }
    }

    pub(crate) fn calibrate(&self, photos: usize, flash: FlashOffset) -> PhotometricCalibrator {
        let mut calibrator = PhotometricCalibrator::new(self.target.clone(), flash);
        for i in 0..photos {
            let pushed = calibrator.push(&self.photo(i), &self.camera, &self.pose(i));
            assert!(pushed.is_ok(), "frame {i}: {pushed:?}");
        }
        calibrator
    }

    pub(crate) fn flash(&self) -> FlashOffset {
        FlashOffset::Known(self.offset)
    }
}
