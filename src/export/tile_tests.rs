//! Seams of materials without borders, with borders, and with borders that cannot match.

use super::*;
use crate::svbrdf::{LOBES, channel};

/// Hash noise in [0, 1).
fn noise(i: usize) -> f32 {
    let mut v = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0x1234_5678;
    v ^= v >> 29;
    v = v.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((v >> 40) as f32) / (1u64 << 24) as f32
}

/// Blurred noise on a strong gradient, so that borders differ strongly.
fn stains(w: usize, h: usize) -> Svbrdf {
    let mut maps = Svbrdf::new(w, h);
    for i in 0..w * h {
        let (x, y) = (i % w, i / w);
        let mut sum = 0.0;
        for (dx, dy) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
            sum += noise((y + dy) * 1000 + x + dx) / 9.0;
        }
        let ramp = x as f32 / w as f32 + 0.5 * y as f32 / h as f32;
        for c in 0..3 {
            maps.diffuse_mut()[c][i] = 0.1 + 0.4 * sum + 0.3 * ramp;
        }
        maps.normal_slopes_mut()[0][i] = sum - 0.5 + 0.2 * ramp;
        maps.normal_slopes_mut()[1][i] = noise(i) * 0.3 - 0.15;
        maps.roughness_mut()[i] = 0.3 + 0.3 * ramp;
    }
    maps
}

/// Mean difference across the border of a plane relative to the inside, over columns and rows.
fn border(maps: &Svbrdf, c: usize) -> f32 {
    let (w, h) = (maps.width(), maps.height());
    let plane = maps.plane(c);
    let step = |a: usize, b: usize| (plane[a] - plane[b]).abs();
    let column = |x: usize| (0..h).map(|y| step(y * w + x, y * w + (x + 1) % w)).sum::<f32>();
    let row = |y: usize| (0..w).map(|x| step(y * w + x, (y + 1) % h * w + x)).sum::<f32>();
    let columns = (0..w - 1).map(column).sum::<f32>() / (w - 1) as f32;
    let rows = (0..h - 1).map(row).sum::<f32>() / (h - 1) as f32;
    (column(w - 1) / columns).max(row(h - 1) / rows)
}

#[test]
fn seams_vanish_and_sizes_stay() {
    for (w, h) in [(64, 48), (33, 50), (130, 100)] {
        let maps = stains(w, h);
        assert!(border(&maps, channel::DIFFUSE) > 2.0);
        let tiled = seamless(&maps).unwrap();
        assert_eq!((tiled.maps.width(), tiled.maps.height()), (w, h));
        for c in [channel::SLOPE_X, channel::DIFFUSE] {
            let seam = border(&tiled.maps, c);
            assert!(seam <= 1.1, "{w} x {h}, channel {c}: {seam}");
        }
        // The ramp over the whole sample must end somewhere, so the sources disagree along the cuts.
        assert!(tiled.seam <= 1.1 && tiled.cuts <= 1.6, "{} {}", tiled.seam, tiled.cuts);
        // The material is preserved: mean and contrast of the diffuse albedo change little.
        let moments = |maps: &Svbrdf| {
            let plane = maps.diffuse()[0];
            let mean = plane.iter().sum::<f32>() / plane.len() as f32;
            let fine = plane.windows(2).map(|p| (p[1] - p[0]).abs()).sum::<f32>();
            [mean, fine / plane.len() as f32]
        };
        // The ramp's part of the contrast disappears; it is larger on small samples.
        let limits = [0.1, 0.35];
        for ((a, b), limit) in moments(&tiled.maps).into_iter().zip(moments(&maps)).zip(limits) {
            assert!((a / b - 1.0).abs() < limit, "{w} x {h}: {a} {b}");
        }
    }
}

/// A seamless tile is only shifted.
#[test]
fn a_tile_stays_a_tile() {
    let (w, h) = (48, 48);
    let mut maps = Svbrdf::new(w, h);
    for i in 0..w * h {
        // Period 12 along both axes.
        let v = noise(i % w % 12 + 12 * (i / w % 12));
        for c in channel::DIFFUSE..channel::ROUGHNESS {
            maps.plane_mut(c)[i] = 0.2 + 0.6 * v;
        }
    }
    let tiled = seamless(&maps).unwrap();
    let plane = tiled.maps.diffuse()[0];
    for i in 0..w * h {
        let next = i / w * w + (i % w + 12) % w;
        assert!((plane[i] - plane[next]).abs() < 1e-3);
    }
    assert!(tiled.seam <= 1.0 + 1e-3 && tiled.cuts < 1e-3, "{} {}", tiled.seam, tiled.cuts);
}

#[test]
fn uniform_maps_stay_uniform_and_small_ones_are_refused() {
    let maps = Svbrdf::new(20, 17);
    let tiled = seamless(&maps).unwrap();
    for (a, b) in tiled.maps.planes().iter().zip(maps.planes()) {
        assert!((a - b).abs() < 1e-5);
    }
    let fault = seamless(&Svbrdf::new(15, 40)).unwrap_err().to_string();
    assert!(fault.contains("maps") && fault.contains("15 x 40"), "{fault}");
}

/// Lobes are tiled with the maps: they stay with their colours.
#[test]
fn lobes_are_tiled_with_the_maps() {
    let mut maps = stains(64, 48);
    let n = maps.texels();
    let factors: [f32; LOBES] = [0.8, -0.3, 0.5, 0.3, 0.2, 0.1, 0.4, 0.45];
    let lobes = factors.map(|v| maps.roughness().iter().map(|r| v * (1.0 + r)).collect::<Vec<_>>());
    maps.set_lobes(lobes.concat()).unwrap();
    let tiled = seamless(&maps).unwrap();
    assert!(tiled.seam <= 1.1, "{}", tiled.seam);
    assert_eq!(tiled.maps.lobes().len(), LOBES * n);
    // The spreading of steps is linear, so proportional planes stay proportional.
    for (plane, v) in factors.into_iter().enumerate() {
        let pairs = tiled.maps.lobe(plane).unwrap().iter();
        for (found, r) in pairs.zip(tiled.maps.roughness()) {
            assert!((found - v * (1.0 + r)).abs() < 1e-3, "{found} for {}", v * (1.0 + r));
        }
    }
}
