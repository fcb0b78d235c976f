//! Classes of texels by colour.

/// Number of classes, and iterations of Lloyd's algorithm.
pub const CLASSES: usize = 6;
const STEPS: usize = 12;
/// Stride of the texels used for the centres.
const STRIDE: usize = 7;

type Colour = [f32; 3];

/// Class of each texel of three planes of linear values.
pub fn classes(diffuse: [&[f32]; 3]) -> Vec<usize> {
    // approximately perceptual
    let colours: Vec<Colour> =
        (0..diffuse[0].len()).map(|i| diffuse.map(|plane| plane[i].max(0.0).sqrt())).collect();
    let sample: Vec<Colour> = colours.iter().step_by(STRIDE).copied().collect();
    let mut centres = scattered(&sample);
    for _ in 0..STEPS {
        let mut sums = vec![([0.0f32; 3], 0.0f32); centres.len()];
        for colour in &sample {
            let (sum, count) = &mut sums[nearest(&centres, colour).0];
            (0..3).for_each(|c| sum[c] += colour[c]);
            *count += 1.0;
        }
        for (centre, (sum, count)) in centres.iter_mut().zip(sums) {
            if count > 0.0 {
                *centre = sum.map(|v| v / count);
            }
        }
    }
    colours.iter().map(|colour| nearest(&centres, colour).0).collect()
}

/// Initial centres: each is the colour farthest from the previous ones.
fn scattered(sample: &[Colour]) -> Vec<Colour> {
    let mut centres = vec![sample[0]];
    while centres.len() < CLASSES {
        let distance = |colour: &&Colour| nearest(&centres, colour).1;
        let farthest = sample.iter().max_by(|a, b| distance(a).total_cmp(&distance(b)));
        centres.extend(farthest.copied());
    }
    centres
}

/// Index of the nearest centre and its squared distance.
fn nearest(centres: &[Colour], colour: &Colour) -> (usize, f32) {
    let square = |centre: &Colour| (0..3).map(|c| (centre[c] - colour[c]).powi(2)).sum::<f32>();
    let squares = centres.iter().map(square).enumerate();
    squares.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six colours with a little noise are six classes.
    #[test]
    fn colours_that_differ_are_classes() {
        let of = |i: usize| [0.1 + 0.15 * (i % 6) as f32, 0.5 - 0.07 * (i % 6) as f32, 0.2];
        let plane = |c: usize| -> Vec<f32> {
            (0..600).map(|i| of(i)[c] + 0.002 * (i * 37 % 11) as f32).collect()
        };
        let planes = [plane(0), plane(1), plane(2)];
        let classes = classes([&planes[0], &planes[1], &planes[2]]);
        assert!((0..600).all(|i| classes[i] == classes[i % 6]));
        let mut six = classes[..6].to_vec();
        six.sort_unstable();
        six.dedup();
        assert_eq!(six.len(), 6);
    }
}
