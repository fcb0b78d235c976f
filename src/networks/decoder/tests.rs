use super::*;
use crate::Error;
use crate::networks::test_vectors::{difference, test_vectors};
use crate::svbrdf::CHANNELS;

const FILE: &[u8] = svbrdf_models::DECODER;
const VECTORS: &[u8] = include_bytes!("../../../models/decoder_test.bin");

/// Reproducible values in [-1, 1].
fn noise(length: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as f32 / u32::MAX as f32 * 2.0 - 1.0
    };
    (0..length).map(|_| next()).collect()
}

fn decoder() -> Decoder {
    Decoder::from_bytes(FILE).unwrap()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&x, &y)| f64::from(x) * f64::from(y)).sum()
}

#[test]
fn maps_and_gradient_are_those_of_the_training_framework() {
    let decoder = decoder();
    let vectors = test_vectors(VECTORS);
    let (shape, code) = &vectors["code"];
    let mut workspace = Workspace::new(&decoder, shape[2], shape[3]).unwrap();
    let maps = decoder.forward(code, &mut workspace).unwrap();
    // f32 sums of up to 1152 products in another order, through six layers
    let error = difference(maps, &vectors["maps"].1);
    assert!(error < 1e-4, "maps differ by {error}");
    let mut gradient = vec![0.0; code.len()];
    decoder.vjp(&mut workspace, &vectors["maps_gradient"].1, &mut gradient).unwrap();
    let error = difference(&gradient, &vectors["code_gradient"].1);
    assert!(error < 1e-4, "gradients differ by {error}");
}

/// A small decoder with every kind of layer and both kinds of residual.
fn small_decoder(seed: u32) -> Vec<u8> {
    let layers = r#"[
        {"op":"save"},
        {"op":"conv","kernel":1,"in":5,"out":5,"weight":0,"bias":25},
        {"op":"add"},
        {"op":"leaky_relu"},
        {"op":"save"},
        {"op":"conv","kernel":3,"in":5,"out":5,"weight":30,"bias":255},
        {"op":"add"},
        {"op":"save"},
        {"op":"leaky_relu"},
        {"op":"conv","kernel":3,"in":5,"out":5,"weight":260,"bias":485},
        {"op":"add"},
        {"op":"leaky_relu"},
        {"op":"conv_transpose","in":5,"out":3,"weight":490,"bias":730},
        {"op":"leaky_relu"},
        {"op":"conv","kernel":3,"in":3,"out":36,"weight":733,"bias":1705},
        {"op":"depth_to_space","block":2},
        {"op":"tanh"}]"#;
    let weights =
        noise(1741, seed).iter().map(|w| half::f16::from_f32(0.6 * w)).collect::<Vec<_>>();
    container(
        &format!(
            r#"{{"format":"svbrdf-decoder/1","code_channels":5,"stride":4,"leaky_slope":0.2,"layers":{layers}}}"#
        ),
        &weights,
    )
}

fn container(header: &str, weights: &[half::f16]) -> Vec<u8> {
    let mut bytes = b"SVBRDFM1".to_vec();
    bytes.extend((header.len() as u32).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(weights.iter().flat_map(|w| w.to_le_bytes()));
    bytes
}

/// The definition of each layer in f64 on planes: an oracle that shares no code with the passes.
fn reference(file: &[u8], code: &[f32], height: usize, width: usize) -> Vec<f64> {
    let length = u32::from_le_bytes(file[8..12].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&file[12..12 + length]).unwrap();
    let weight = |i: usize| {
        let at = 12 + length + 2 * i;
        half::f16::from_le_bytes([file[at], file[at + 1]]).to_f64()
    };
    let (mut h, mut w) = (height, width);
    let mut x: Vec<f64> = code.iter().map(|&v| f64::from(v)).collect();
    let mut stack = Vec::new();
    for layer in header["layers"].as_array().unwrap() {
        let n = |key: &str| layer[key].as_u64().unwrap() as usize;
        match layer["op"].as_str().unwrap() {
            "conv" => {
                let (k, ci, co) = (n("kernel"), n("in"), n("out"));
                let mut y = vec![0.0; co * h * w];
                for (o, oy, ox) in indices(co, h, w) {
                    let mut sum = weight(n("bias") + o);
                    for (i, ky, kx) in indices(ci, k, k) {
                        let (iy, ix) = (oy + ky, ox + kx);
                        let pad = k / 2;
                        if iy >= pad && ix >= pad && iy < h + pad && ix < w + pad {
                            sum += weight(n("weight") + ((o * ci + i) * k + ky) * k + kx)
                                * x[(i * h + iy - pad) * w + ix - pad];
                        }
                    }
                    y[(o * h + oy) * w + ox] = sum;
                }
                x = y;
            }
            "conv_transpose" => {
                let (ci, co) = (n("in"), n("out"));
                let mut y = vec![0.0; co * 4 * h * w];
                for (o, oy, ox) in indices(co, 2 * h, 2 * w) {
                    y[(o * 2 * h + oy) * 2 * w + ox] = weight(n("bias") + o);
                }
                for (i, iy, ix) in indices(ci, h, w) {
                    for (o, ky, kx) in indices(co, 4, 4) {
                        let (oy, ox) = (2 * iy + ky, 2 * ix + kx);
                        if oy >= 1 && ox >= 1 && oy <= 2 * h && ox <= 2 * w {
                            y[(o * 2 * h + oy - 1) * 2 * w + ox - 1] += x[(i * h + iy) * w + ix]
                                * weight(n("weight") + ((i * co + o) * 4 + ky) * 4 + kx);
                        }
                    }
                }
                (h, w, x) = (2 * h, 2 * w, y);
            }
            "leaky_relu" => x.iter_mut().for_each(|v| *v = v.max(0.2 * *v)),
            "save" => stack.push(x.clone()),
            "add" => {
                let saved = stack.pop().unwrap();
                x.iter_mut().zip(saved).for_each(|(v, s)| *v += s);
            }
            "depth_to_space" => {
                let b = n("block");
                let mut y = vec![0.0; x.len()];
                for (c, oy, ox) in indices(x.len() / (b * b * h * w), h * b, w * b) {
                    let channel = c * b * b + (oy % b) * b + ox % b;
                    y[(c * h * b + oy) * w * b + ox] = x[(channel * h + oy / b) * w + ox / b];
                }
                (h, w, x) = (h * b, w * b, y);
            }
            _ => x.iter_mut().for_each(|v| *v = v.tanh()),
        }
    }
    x
}

fn indices(a: usize, b: usize, c: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..a * b * c).map(move |i| (i / (b * c), i / c % b, i % c))
}

#[test]
fn every_layer_and_size_agrees_with_the_plain_definition() {
    for (height, width) in [(1, 1), (1, 7), (4, 6), (13, 3), (21, 40)] {
        let file = small_decoder(7);
        let decoder = Decoder::from_bytes(&file).unwrap();
        let code = noise(5 * height * width, 3);
        let mut workspace = Workspace::new(&decoder, height, width).unwrap();
        let maps = decoder.forward(&code, &mut workspace).unwrap();
        let expected = reference(&file, &code, height, width);
        assert_eq!(maps.len(), expected.len());
        for (found, expected) in maps.iter().zip(&expected) {
            // Tolerance: values of order one, sums of at most 45 terms, a few f32 roundings per layer.
            assert!((f64::from(*found) - expected).abs() < 1e-5);
        }
    }
}

#[test]
fn the_product_is_the_derivative() {
    for (height, width) in [(1, 1), (4, 6), (21, 5)] {
        let file = small_decoder(11);
        let decoder = Decoder::from_bytes(&file).unwrap();
        let code = noise(5 * height * width, 5);
        let gradient = noise(CHANNELS * 16 * height * width, 9);
        let mut workspace = Workspace::new(&decoder, height, width).unwrap();
        decoder.forward(&code, &mut workspace).unwrap();
        let mut found = vec![0.0; code.len()];
        decoder.vjp(&mut workspace, &gradient, &mut found).unwrap();
        // Central differences in f64 of <gradient, maps> by single code values. Kinks of the leaky
        // ReLU within a step spoil a few of them, so the median must be tight, not the worst.
        let value = |code: &[f32]| -> f64 {
            let maps = reference(&file, code, height, width);
            maps.iter().zip(&gradient).map(|(m, &g)| m * f64::from(g)).sum()
        };
        let step = 1e-3;
        let mut errors: Vec<f64> = (0..code.len().min(40))
            .map(|i| {
                let mut moved = code.clone();
                moved[i] = code[i] + step;
                let (up, high) = (value(&moved), f64::from(moved[i]));
                moved[i] = code[i] - step;
                let numeric = (up - value(&moved)) / (high - f64::from(moved[i]));
                (numeric - f64::from(found[i])).abs() / (1.0 + numeric.abs())
            })
            .collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors[errors.len() / 2] < 1e-5, "{errors:?}");
    }
}

#[test]
fn forward_differences_and_product_are_adjoint() {
    // <g, J v> = <J^T g, v> for the exported network, J v by a central difference.
    let decoder = decoder();
    let (height, width) = (4, 6);
    let n = decoder.code_channels() * height * width;
    let (code, v) = (noise(n, 21), noise(n, 22));
    let g = noise(CHANNELS * height * width * 256, 23);
    let mut workspace = Workspace::new(&decoder, height, width).unwrap();
    let h = 2e-3;
    let moved = |s: f32| -> Vec<f32> { code.iter().zip(&v).map(|(c, v)| c + s * v).collect() };
    let up = decoder.forward(&moved(h), &mut workspace).unwrap().to_vec();
    let down = decoder.forward(&moved(-h), &mut workspace).unwrap().to_vec();
    let jv = (dot(&g, &up) - dot(&g, &down)) / (2.0 * f64::from(h));
    decoder.forward(&code, &mut workspace).unwrap();
    let mut jtg = vec![0.0; n];
    decoder.vjp(&mut workspace, &g, &mut jtg).unwrap();
    let expected = dot(&jtg, &v);
    // Tolerance: second-order terms and kinks in the step, some tenths of a per cent of |J^T g|
    // |v|.
    let scale = dot(&jtg, &jtg).sqrt() * dot(&v, &v).sqrt();
    assert!((jv - expected).abs() < 5e-3 * scale, "{jv} {expected} {scale}");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads_or_on_earlier_runs() {
    let decoder = decoder();
    let (height, width) = (9, 5);
    let code = noise(decoder.code_channels() * height * width, 2);
    let gradient = noise(CHANNELS * height * width * 256, 4);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut workspace = Workspace::new(&decoder, height, width).unwrap();
            let mut result = vec![0.0; code.len()];
            for scale in [2.0, 1.0] {
                let code: Vec<f32> = code.iter().map(|c| scale * c).collect();
                decoder.forward(&code, &mut workspace).unwrap();
                decoder.vjp(&mut workspace, &gradient, &mut result).unwrap();
            }
            (workspace.encoded().to_vec(), result)
        })
    };
    let one = run(1);
    assert!(one == run(3) && one == run(1));
}

#[test]
fn damaged_files_are_refused() {
    let file = small_decoder(1);
    for end in 0..file.len() {
        assert!(matches!(Decoder::from_bytes(&file[..end]), Err(Error::Model { .. })), "{end}");
    }
    for end in (0..FILE.len()).step_by(997) {
        assert!(matches!(Decoder::from_bytes(&FILE[..end]), Err(Error::Model { .. })), "{end}");
    }
    // A file with flipped bits that is still valid (a changed weight) must run.
    let header = u32::from_le_bytes(file[8..12].try_into().unwrap()) as usize + 12;
    for position in 0..header {
        for bit in 0..8 {
            let mut damaged = file.clone();
            damaged[position] ^= 1 << bit;
            match Decoder::from_bytes(&damaged) {
                Err(Error::Model { .. }) => {}
                Err(other) => panic!("{other}"),
                Ok(decoder) => {
                    let mut workspace = Workspace::new(&decoder, 1, 2).unwrap();
                    let code = vec![0.5; 2 * decoder.code_channels()];
                    decoder.forward(&code, &mut workspace).unwrap();
                }
            }
        }
    }
}

#[test]
fn invalid_headers_are_refused() {
    let weights = vec![half::f16::ZERO; 4000];
    let conv = |inputs: u64, outputs: u64, weight: u64| {
        format!(
            r#"{{"op":"conv","kernel":3,"in":{inputs},"out":{outputs},"weight":{weight},"bias":0}}"#
        )
    };
    let try_layers = |layers: &str, stride: u32| {
        let header = format!(
            r#"{{"format":"svbrdf-decoder/1","code_channels":4,"stride":{stride},"leaky_slope":0.2,"layers":[{layers}]}}"#
        );
        Decoder::from_bytes(&container(&header, &weights)).map(|_| ())
    };
    let tanh = r#"{"op":"tanh"}"#;
    let good = format!("{},{tanh}", conv(4, 9, 9));
    try_layers(&good, 1).unwrap();
    let bad = [
        String::new(),
        tanh.to_owned(),
        conv(4, 9, 9),
        format!("{},{tanh}", conv(5, 9, 9)),
        format!("{},{tanh}", conv(4, 8, 9)),
        format!("{},{tanh}", conv(4, 4_000_000_000, 9)),
        format!("{},{tanh}", conv(4, 9, u64::MAX - 3)),
        format!("{},{tanh}", conv(4, 9, 3990)),
        format!("{good},{tanh}"),
        format!(r#"{{"op":"add"}},{good}"#),
        format!(r#"{{"op":"save"}},{good}"#),
        format!(r#"{{"op":"save"}},{},{{"op":"add"}},{tanh}"#, conv(4, 9, 9)),
        format!(r#"{},{{"op":"depth_to_space","block":0}},{tanh}"#, conv(4, 9, 9)),
        format!(r#"{},{{"op":"leaky_relu"}},{tanh}"#, conv(4, 9, 9)),
        format!(r#"{{"op":"leaky_relu"}},{{"op":"leaky_relu"}},{good}"#),
    ];
    for layers in &bad {
        assert!(matches!(try_layers(layers, 1), Err(Error::Model { .. })), "{layers}");
    }
    assert!(try_layers(&good, 2).is_err());
}

#[test]
fn wrong_sizes_are_errors() {
    let decoder = decoder();
    assert!(Workspace::new(&decoder, 0, 4).is_err());
    assert!(Workspace::new(&decoder, 4, 1 << 40).is_err());
    let mut workspace = Workspace::new(&decoder, 2, 2).unwrap();
    assert!(decoder.forward(&[0.0; 3], &mut workspace).is_err());
    let other = Decoder::from_bytes(&small_decoder(1)).unwrap();
    assert!(other.forward(&[0.0; 20], &mut workspace).is_err());
    let mut gradient = vec![0.0; 4 * decoder.code_channels()];
    assert!(decoder.vjp(&mut workspace, &[0.0; 5], &mut gradient).is_err());
}
