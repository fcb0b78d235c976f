//! Perceptual colour differences.

use crate::parallel;

/// CIE XYZ (D65) of linear Rec. 709, rows.
const TO_XYZ: [[f64; 3]; 3] = [
    [0.412_456, 0.357_576, 0.180_438],
    [0.212_673, 0.715_152, 0.072_175],
    [0.019_334, 0.119_192, 0.950_304],
];

/// CIE L*a*b* (D65) of linear Rec. 709.
pub fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let root = |t: f64| {
        if t > 216.0 / 24_389.0 { t.cbrt() } else { (24_389.0 / 27.0 * t + 16.0) / 116.0 }
    };
    let [x, y, z] = TO_XYZ.map(|row| {
        let white: f64 = row.iter().sum();
        root(row.iter().zip(rgb).map(|(a, b)| a * b).sum::<f64>() / white)
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// CIEDE2000 of two colours in L*a*b* with unit weights; about 1 is just visible side by side.
pub fn delta_e_2000(first: [f64; 3], second: [f64; 3]) -> f64 {
    let ([l1, a1, b1], [l2, a2, b2]) = (first, second);
    let seventh = |c: f64| (c.powi(7) / (c.powi(7) + 25f64.powi(7))).sqrt();
    let mean_chroma = 0.5 * (a1.hypot(b1) + a2.hypot(b2));
    let stretch = 1.0 + 0.5 * (1.0 - seventh(mean_chroma));
    let (a1, a2) = (stretch * a1, stretch * a2);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    let hue = |a: f64, b: f64| b.atan2(a).to_degrees().rem_euclid(360.0);
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));
    let gray = c1 * c2 == 0.0;
    let turn = match h2 - h1 {
        _ if gray => 0.0,
        d if d > 180.0 => d - 360.0,
        d if d < -180.0 => d + 360.0,
        d => d,
    };
    let (dl, dc) = (l2 - l1, c2 - c1);
    let dh = 2.0 * (c1 * c2).sqrt() * (0.5 * turn).to_radians().sin();
    let (l, c) = (0.5 * (l1 + l2), 0.5 * (c1 + c2));
    let h = match h1 + h2 {
        sum if gray => sum,
        sum if (h1 - h2).abs() <= 180.0 => 0.5 * sum,
        sum if sum < 360.0 => 0.5 * (sum + 360.0),
        sum => 0.5 * (sum - 360.0),
    };
    let cos = |degrees: f64| degrees.to_radians().cos();
    let t = 1.0 - 0.17 * cos(h - 30.0) + 0.24 * cos(2.0 * h) + 0.32 * cos(3.0 * h + 6.0)
        - 0.20 * cos(4.0 * h - 63.0);
    let off = (l - 50.0).powi(2);
    let sl = 1.0 + 0.015 * off / (20.0 + off).sqrt();
    let (sc, sh) = (1.0 + 0.045 * c, 1.0 + 0.015 * c * t);
    let rotation = 60.0 * (-((h - 275.0) / 25.0).powi(2)).exp();
    let rt = -2.0 * seventh(c) * rotation.to_radians().sin();
    let (l, c, h) = (dl / sl, dc / sc, dh / sh);
    (l * l + c * c + h * h + rt * c * h).sqrt()
}

/// Mean CIEDE2000 of `count` pairs of linear colours, without those that are `None`.
pub(super) fn mean(count: usize, pair: impl Fn(usize) -> Option<[[f64; 3]; 2]> + Sync) -> f64 {
    const PART: usize = 4096;
    let sums = parallel::map(count.div_ceil(PART), |part| {
        let pairs = (part * PART..count.min((part + 1) * PART)).filter_map(&pair);
        pairs.fold((0.0, 0usize), |(sum, n), [a, b]| {
            // Shortcut for identical colours, as in most texels of a map compared with itself.
            let difference = if a == b { 0.0 } else { delta_e_2000(lab(a), lab(b)) };
            (sum + difference, n + 1)
        })
    });
    let (sum, n) = sums.into_iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
    sum / n.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published pairs that test each part of the formula.
    #[test]
    fn colour_differences_are_those_of_the_standard() {
        for (a, b, expected) in [
            ([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], 2.0425),
            ([50.0, 2.5, 0.0], [50.0, 3.2592, 0.3350], 1.0),
            ([50.0, 2.5, 0.0], [73.0, 25.0, -18.0], 27.1492),
            ([2.0776, 0.0795, -1.1350], [0.9033, -0.0636, -0.5514], 0.9082),
            ([60.2574, -34.0099, 36.2677], [60.4626, -34.1751, 39.4387], 1.2644),
        ] {
            assert!((delta_e_2000(a, b) - expected).abs() < 1e-4, "{}", delta_e_2000(a, b));
        }
        // 18 % gray; white.
        assert!((lab([0.184_187; 3])[0] - 50.0).abs() < 1e-3);
        assert!((lab([1.0; 3])[0] - 100.0).abs() < 1e-9);
    }

    #[test]
    fn means_ignore_missing_pairs() {
        let pair = |i: usize| {
            i.is_multiple_of(2).then_some([[0.2; 3], [if i == 0 { 0.3 } else { 0.2 }; 3]])
        };
        let one = delta_e_2000(lab([0.2; 3]), lab([0.3; 3]));
        assert!((mean(10_000, pair) - one / 5000.0).abs() < 1e-12);
        assert_eq!(mean(0, pair), 0.0);
    }
}
