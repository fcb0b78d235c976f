//! Pinhole camera with OpenCV's radial-tangential distortion.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Intrinsics. Pixel (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Image width, px.
    pub width: u32,
    /// Image height, px.
    pub height: u32,
    /// Focal length along x, px.
    pub fx: f64,
    /// Focal length along y, px.
    pub fy: f64,
    /// Principal point, px.
    pub cx: f64,
    /// Principal point, px.
    pub cy: f64,
    /// k1, k2, p1, p2, k3 (OpenCV).
    #[serde(default)]
    pub distortion: [f64; 5],
}

impl Camera {
    /// The camera for pictures of another size from the same lens and sensor: scaled to the
    /// picture's width or height, with the excess cropped equally on both sides, as in previews.
    /// `None` if one picture is portrait and the other landscape.
    pub fn of_size(&self, width: u32, height: u32) -> Option<Self> {
        if (self.width, self.height) == (width, height) {
            return Some(*self);
        }
        if self.width.cmp(&self.height).is_lt() != width.cmp(&height).is_lt() {
            return None;
        }
        let (from, to) = (
            DVec2::new(self.width.into(), self.height.into()),
            DVec2::new(width.into(), height.into()),
        );
        let scale = (to / from).max_element();
        let centre = (DVec2::new(self.cx, self.cy) + 0.5) * scale - 0.5 - 0.5 * (from * scale - to);
        let (fx, fy) = (scale * self.fx, scale * self.fy);
        Some(Self { width, height, fx, fy, cx: centre.x, cy: centre.y, ..*self })
    }

    /// The camera for pictures reduced by blocks of `step` x `step` pixels, without incomplete blocks.
    pub(crate) fn reduced(&self, step: u32) -> Self {
        let (s, middle) = (f64::from(step), 0.5 * (f64::from(step) - 1.0));
        let (cx, cy) = ((self.cx - middle) / s, (self.cy - middle) / s);
        let (width, height) = (self.width / step, self.height / step);
        Self { width, height, fx: self.fx / s, fy: self.fy / s, cx, cy, ..*self }
    }

    /// Applies distortion to a normalised image position (x/z, y/z).
    pub fn distort(&self, p: DVec2) -> DVec2 {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let xy = p.x * p.y;
        DVec2::new(
            p.x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
            p.y * radial + p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * xy,
        )
    }

    /// Pixel of a point in the camera frame; `None` behind the camera or beyond the fold of the
    /// distortion polynomial.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        if point.z <= 0.0 {
            return None;
        }
        let p = point.truncate() / point.z;
        if !self.is_monotonic_at(p.length_squared()) {
            return None;
        }
        Some(self.to_pixel(self.distort(p)))
    }

    /// Pixel of a distorted normalised position.
    pub fn to_pixel(&self, distorted: DVec2) -> DVec2 {
        DVec2::new(self.fx * distorted.x + self.cx, self.fy * distorted.y + self.cy)
    }

    /// Undistorted normalised position (x/z, y/z) of a pixel, by Newton's method.
    pub fn undistort(&self, pixel: DVec2) -> DVec2 {
        let target = DVec2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        let [k1, k2, p1, p2, k3] = self.distortion;
        let mut p = target;
        for _ in 0..20 {
            let error = self.distort(p) - target;
            if error.length_squared() < 1e-26 {
                break;
            }
            let r2 = p.length_squared();
            let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let slope = k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2); // d radial / d r²
            let dxx = radial + 2.0 * p.x * p.x * slope + 2.0 * p1 * p.y + 6.0 * p2 * p.x;
            let dxy = 2.0 * p.x * p.y * slope + 2.0 * p1 * p.x + 2.0 * p2 * p.y;
            let dyy = radial + 2.0 * p.y * p.y * slope + 6.0 * p1 * p.y + 2.0 * p2 * p.x;
            let det = dxx * dyy - dxy * dxy;
            if det.abs() < 1e-9 {
                break;
            }
            p -= DVec2::new(dyy * error.x - dxy * error.y, dxx * error.y - dxy * error.x) / det;
        }
        p
    }

    /// Whether the radial polynomial increases up to squared radius `r2`.
    fn is_monotonic_at(&self, r2: f64) -> bool {
        let [k1, k2, _, _, k3] = self.distortion;
        let growing = |r2: f64| 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) > 0.0;
        growing(r2) && growing(0.5 * r2)
    }

    /// Fault of the values, if any: the field and the values expected.
    pub fn fault(&self) -> Option<(&'static str, &'static str)> {
        let positive = |v: f64| v.is_finite() && v > 0.0;
        if self.width == 0 || self.height == 0 {
            return Some(("width", "a size of at least 1 x 1 px"));
        }
        if !positive(self.fx) {
            return Some(("fx", "a positive number of pixels"));
        }
        if !positive(self.fy) {
            return Some(("fy", "a positive number of pixels"));
        }
        if !self.cx.is_finite() {
            return Some(("cx", "a finite number of pixels"));
        }
        if !self.cy.is_finite() {
            return Some(("cy", "a finite number of pixels"));
        }
        if !self.distortion.iter().all(|v| v.is_finite()) {
            return Some(("distortion", "five finite numbers: k1, k2, p1, p2, k3"));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undistortion_inverts_distortion() {
        let camera = Camera {
            width: 2016,
            height: 1512,
            fx: 1450.0,
            fy: 1460.0,
            cx: 1000.0,
            cy: 760.0,
            distortion: [0.05, -0.08, 0.001, -0.002, 0.01],
        };
        for i in -3..=3 {
            for j in -2..=2 {
                let p = DVec2::new(0.2 * f64::from(i), 0.25 * f64::from(j));
                let pixel = camera.project(p.extend(1.0) * 300.0).unwrap();
                assert!((camera.undistort(pixel) - p).length() < 1e-12);
            }
        }
    }

    #[test]
    fn pictures_of_another_size_show_the_same_directions() {
        let camera = Camera {
            width: 4032,
            height: 3024,
            fx: 2900.0,
            fy: 2910.0,
            cx: 2010.0,
            cy: 1500.0,
            distortion: [0.05, -0.08, 0.001, -0.002, 0.01],
        };
        let p = DVec3::new(20.0, -30.0, 300.0);
        let px = camera.project(p).unwrap();
        // Blocks of 3 x 3 pixels; the centre of the first is (1, 1).
        let third = camera.reduced(3);
        assert_eq!((third.width, third.height), (1344, 1008));
        assert!((third.project(p).unwrap() * 3.0 + 1.0 - px).length() < 1e-9);
        let scaled = camera.of_size(1344, 1008).unwrap();
        assert!((scaled.project(p).unwrap() - third.project(p).unwrap()).length() < 1e-9);
        // A wide preview lacks an eighth of the height on either side.
        let wide = camera.of_size(1344, 756).unwrap();
        let cut = scaled.project(p).unwrap() - wide.project(p).unwrap();
        assert!((cut - DVec2::new(0.0, 126.0)).length() < 1e-9);
        assert_eq!(camera.of_size(1008, 1344), None);
        assert_eq!(camera.of_size(4032, 3024), Some(camera));
    }

    #[test]
    fn points_behind_or_past_the_fold_of_the_distortion_do_not_project() {
        let mut camera = Camera {
            width: 640,
            height: 480,
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            distortion: [-0.3, 0.0, 0.0, 0.0, 0.0],
        };
        assert!(camera.project(DVec3::new(0.0, 0.0, -1.0)).is_none());
        assert!(camera.project(DVec3::new(2.0, 0.0, 1.0)).is_none());
        camera.distortion = [0.0; 5];
        assert!(camera.project(DVec3::new(2.0, 0.0, 1.0)).is_some());
    }
}
