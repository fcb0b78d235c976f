use super::*;

#[test]
fn planes_of_sheen_exist_only_for_materials_with_sheen() {
    let mut maps = Svbrdf::new(3, 2);
    assert!(maps.sheen().is_none() && maps.set_lobes(vec![0.5; 5 * 6]).is_err());
    maps.set_lobes(vec![0.5; 4 * 6]).unwrap();
    assert_eq!(maps.lobes().len(), 4 * 6);
    assert!(maps.coat().is_some() && maps.sheen().is_none());
    assert_eq!(maps.lobes_at(1)[lobe::SHEEN..], NO_LOBES[lobe::SHEEN..]);
    let mut planes = vec![0.0; LOBES * 6];
    maps.set_lobes(planes.clone()).unwrap();
    assert!(maps.sheen().is_none(), "black sheen");
    planes[(lobe::SHEEN + 1) * 6 + 4] = 0.3;
    maps.set_lobes(planes).unwrap();
    maps.clamp();
    let [_, green, _, roughness] = maps.sheen().unwrap();
    assert_eq!((green[4], roughness[4]), (0.3, MIN_SHEEN_ROUGHNESS));
}

#[test]
fn encoding_round_trips_and_its_derivative_is_right() {
    for c in 0..CHANNELS {
        for i in 1..20 {
            let e = -1.0 + 0.1 * i as f32;
            assert!((encoding::encode(c, encoding::decode(c, e)) - e).abs() < 1e-6);
            let h = 1e-2; // decode is at most quadratic: central differences are exact
            let numeric = (encoding::decode(c, e + h) - encoding::decode(c, e - h)) / (2.0 * h);
            assert!((numeric - encoding::decode_derivative(c, e)).abs() < 1e-4);
        }
    }
}

#[test]
fn reduced_maps_are_means_of_squares() {
    let mut maps = Svbrdf::new(8, 4);
    for (i, v) in maps.planes_mut().iter_mut().enumerate() {
        *v = ((i * 37) % 101) as f32 / 101.0;
    }
    for level in 0..3 {
        let side = 1 << level;
        let small = maps.reduced(level).unwrap();
        assert_eq!((small.width(), small.height()), (8 / side, 4 / side));
        for c in 0..CHANNELS {
            for (i, v) in small.plane(c).iter().enumerate() {
                let (x, y) = (i % small.width() * side, i / small.width() * side);
                let square = (0..side * side).map(|k| (x + k % side, y + k / side));
                let sum: f32 = square.map(|(x, y)| maps.plane(c)[y * 8 + x]).sum();
                // Two roundings per level.
                assert!((v - sum / (side * side) as f32).abs() < 1e-6);
            }
        }
    }
    for level in [3, 63, 64, u32::MAX] {
        assert!(maps.reduced(level).unwrap_err().to_string().contains("8x4"));
    }
}

#[test]
fn upsampling_then_averaging_keeps_a_linear_ramp() {
    let mut maps = Svbrdf::new(8, 6);
    for y in 0..6 {
        for x in 0..8 {
            maps.plane_mut(channel::DIFFUSE)[y * 8 + x] = 0.1 * x as f32 - 0.03 * y as f32;
        }
    }
    let back = maps.upsampled().downsampled();
    for y in 1..5 {
        for x in 1..7 {
            let i = y * 8 + x;
            let d = back.plane(channel::DIFFUSE)[i] - maps.plane(channel::DIFFUSE)[i];
            assert!(d.abs() < 1e-6);
        }
    }
}
