//! Heights known in closed form.

use super::*;

/// Maps of `w` x `h` texels over `mm` with the normals of a height given in mm with its
/// derivatives, sampled at texel centres; and the height.
fn surface(
    (w, h): (usize, usize),
    mm: [f32; 2],
    height: impl Fn(f64, f64) -> [f64; 3],
) -> (Svbrdf, Vec<f64>) {
    let mut maps = Svbrdf::new(w, h);
    let mut values = Vec::new();
    for i in 0..w * h {
        let x = f64::from(mm[0]) * (((i % w) as f64 + 0.5) / w as f64 - 0.5);
        let y = f64::from(mm[1]) * (0.5 - ((i / w) as f64 + 0.5) / h as f64);
        let [z, by_x, by_y] = height(x, y);
        values.push(z);
        maps.normal_slopes_mut()[0][i] = -by_x as f32;
        maps.normal_slopes_mut()[1][i] = -by_y as f32;
    }
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    (maps, values)
}

/// Root-mean-square difference relative to the range.
fn error(found: &Height, known: &[f64]) -> f64 {
    let squares = found.mm.iter().zip(known).map(|(&a, b)| (f64::from(a) - b).powi(2));
    let (low, high) = known.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
    (squares.sum::<f64>() / known.len() as f64).sqrt() / (high - low)
}

/// A bump off centre, a tilt and a ripple; none of them ends at the borders.
fn free(x: f64, y: f64) -> [f64; 3] {
    let (u, v) = (x - 7.0, y + 4.0);
    let bump = 3.0 * (-(u * u + v * v) / 180.0).exp();
    let ripple = (0.4 * x + 0.3 * y).sin();
    let by = 0.2 * (0.4 * x + 0.3 * y).cos();
    [
        bump + 0.1 * x - 0.05 * y + 0.2 * ripple,
        -2.0 * u / 180.0 * bump + 0.1 + 0.4 * by,
        -2.0 * v / 180.0 * bump - 0.05 + 0.3 * by,
    ]
}

#[test]
fn a_known_height_comes_back_from_its_normals() {
    for (texels, mm) in
        [((64, 48), [80.0, 60.0]), ((37, 90), [60.0, 50.0]), ((128, 128), [90.0; 2])]
    {
        let (maps, known) = surface(texels, mm, free);
        let found = Height::of(&maps, mm, false).unwrap();
        let error = error(&found, &known);
        // Fourth order in the texel, which is a tenth of the ripple's wavelength.
        assert!(error < 1e-3, "{texels:?}: {error}");
        assert!(found.unexplained < 1e-4);
    }
}

/// Normals from central differences of a height, as other programs make them.
#[test]
fn heights_come_back_from_central_differences() {
    let (w, h, mm) = (96, 96, [90.0, 90.0]);
    let (mut maps, known) = surface((w, h), mm, free);
    let spacing = 90.0 / 96.0;
    for i in 0..w * h {
        let (x, y) = (i % w, i / w);
        let slope = |a: usize, b: usize, steps: usize| {
            ((known[b] - known[a]) / (steps as f64 * spacing)) as f32
        };
        let (x0, x1) = (x.saturating_sub(1), (x + 1).min(w - 1));
        let (y0, y1) = (y.saturating_sub(1), (y + 1).min(h - 1));
        maps.normal_slopes_mut()[0][i] = -slope(y * w + x0, y * w + x1, x1 - x0);
        maps.normal_slopes_mut()[1][i] = slope(y0 * w + x, y1 * w + x, y1 - y0);
    }
    let found = Height::of(&maps, mm, false).unwrap();
    let error = error(&found, &known);
    assert!(error < 1e-2, "{error}");
}

#[test]
fn a_periodic_height_goes_on_across_its_border() {
    let (w, h, mm) = (60, 45, [80.0, 60.0]);
    let wave = |x: f64, y: f64| {
        let (kx, ky) = (std::f64::consts::TAU / 80.0, std::f64::consts::TAU / 60.0);
        let (a, b) = (2.0 * kx * x + 0.7, ky * y - 0.4);
        [a.sin() * b.cos(), 2.0 * kx * a.cos() * b.cos(), -ky * a.sin() * b.sin()]
    };
    let (maps, known) = surface((w, h), mm, wave);
    let found = Height::of(&maps, mm, true).unwrap();
    assert!(error(&found, &known) < 1e-3);
    let step = |a: usize, b: usize| f64::from(found.mm[a] - found.mm[b]).abs();
    let true_step = |a: usize, b: usize| (known[a] - known[b]).abs();
    let across = |step: &dyn Fn(usize, usize) -> f64| -> f64 {
        (0..h).map(|y| step(y * w, y * w + w - 1)).sum()
    };
    let (found, expected) = (across(&step), across(&true_step));
    assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
}

#[test]
fn invalid_sizes_are_errors() {
    let maps = Svbrdf::new(8, 8);
    for mm in [[0.0, 1.0], [1.0, f32::NAN], [-1.0, 1.0]] {
        let fault = Height::of(&maps, mm, false).unwrap_err().to_string();
        assert!(fault.contains("sample_mm"), "{fault}");
    }
}
