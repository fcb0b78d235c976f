//! Last layers of the decoder: blocks of channels to texels of the maps, tanh.

use super::kernels::Size;
use super::workspace::Tensors;
use crate::parallel;
use crate::simd::{Kernel, LANES, Lanes, dispatch};
use crate::svbrdf::{CHANNELS, bands};

/// Rows of the last tensor per task.
const ROWS: usize = 4;

/// Map, row and column in a block of texels of a channel.
#[inline(always)]
fn place(channel: usize, block: usize) -> (usize, usize, usize) {
    let inside = channel % (block * block);
    (channel / (block * block), inside / block, inside % block)
}

/// Converts blocks of channels to planes of texels through tanh.
pub(super) fn write_maps(last: &Tensors, block: usize, encoded: &mut [f32]) {
    let Size { height, width } = last.size;
    let channels = CHANNELS * block * block;
    let source = last.value.chunks(ROWS * width * channels);
    let parts =
        bands::<CHANNELS, _>(encoded, width * block, height * block, ROWS * block).zip(source);
    parallel::parts(parts, |_, (planes, source)| {
        dispatch(WriteBand { source, width, block, planes });
    });
}

struct WriteBand<'a> {
    source: &'a [f32],
    width: usize,
    block: usize,
    planes: [&'a mut [f32]; CHANNELS],
}

impl Kernel for WriteBand<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Lanes>(self) {
        let Self { source, width, block, planes } = self;
        let length = width * block;
        let channels = CHANNELS * block * block;
        for (y, row) in source.chunks_exact(width * channels).enumerate() {
            for channel in 0..channels {
                let (c, dy, dx) = place(channel, block);
                let out = &mut planes[c][(y * block + dy) * length..][..length];
                for x in 0..width {
                    out[x * block + dx] = row[x * channels + channel];
                }
            }
        }
        for plane in planes {
            for part in plane.chunks_mut(LANES) {
                tanh(V::load(part, 0.0)).store(part);
            }
        }
    }
}

/// The transpose of the Jacobian of [`write_maps`] at its last result.
pub(super) fn read_gradient(last: &mut Tensors, block: usize, encoded: &[f32], gradient: &[f32]) {
    let Size { height, width } = last.size;
    let channels = CHANNELS * block * block;
    let length = width * block;
    let texels = height * block * length;
    parallel::parts(last.gradient.chunks_mut(width * channels), |y, row| {
        for channel in 0..channels {
            let (c, dy, dx) = place(channel, block);
            let at = c * texels + (y * block + dy) * length;
            let (encoded, gradient) = (&encoded[at..][..length], &gradient[at..][..length]);
            for x in 0..width {
                let (e, g) = (encoded[x * block + dx], gradient[x * block + dx]);
                row[x * channels + channel] = g * (1.0 - e * e);
            }
        }
    });
}

/// Hyperbolic tangent to within 4e-7: Eigen's rational approximation of degree 13 over 6, on the
/// range outside which `f32` rounds the result to ±1.
#[inline(always)]
fn tanh<V: Lanes>(x: V) -> V {
    const LIMIT: f32 = 7.905_311;
    let x = x.clamp(-LIMIT, LIMIT);
    let x2 = x * x;
    let mut p = V::splat(-2.760_768_5e-16);
    for c in
        [2.000_188e-13, -8.604_672e-11, 5.122_297e-8, 1.485_722_4e-5, 6.372_619e-4, 4.893_524_6e-3]
    {
        p = p.mul_add(x2, V::splat(c));
    }
    let mut q = V::splat(1.198_258_4e-6);
    for c in [1.185_347_1e-4, 2.268_434_6e-3, 4.893_525e-3] {
        q = q.mul_add(x2, V::splat(c));
    }
    x * p / q
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Tanh([f32; LANES]);

    impl Kernel for Tanh {
        type Output = [f32; LANES];

        #[inline(always)]
        fn run<V: Lanes>(self) -> [f32; LANES] {
            tanh(V::from_array(self.0)).to_array()
        }
    }

    #[test]
    fn tanh_is_close_everywhere() {
        for i in -15_000..=15_000 {
            let x: [f32; LANES] = std::array::from_fn(|j| (8 * i + j as i32) as f32 * 1e-4);
            for (x, y) in x.into_iter().zip(dispatch(Tanh(x))) {
                let d = f64::from(y) - f64::from(x).tanh();
                assert!(d.abs() < 4e-7, "{x}: {d}");
            }
        }
        assert!((dispatch(Tanh([f32::MAX; LANES]))[0] - 1.0).abs() < 4e-7);
    }
}
