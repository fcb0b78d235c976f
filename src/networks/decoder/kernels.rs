//! Convolutions of one block of rows as matrix products over shifted windows.
//!
//! Tensors are row-major `[row][column][channel]`. A block copies its input rows with zero padding
//! into a small buffer, where consecutive rows share one padding pixel (`width + 1` pixels per
//! row). The window of a row of taps is then contiguous, and windows of neighbouring pixels
//! overlap. A block thus needs one matrix product per row of taps, with one unused result per row.

use std::ops::Range;

use super::gemm::{Shape, multiply};
use super::graph::{Kind, Node};

/// Buffers of one thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub window: Vec<f32>,
    pub product: Vec<f32>,
}

/// Coarse rows per task: enough pixels to amortise the packing of the weights, few enough for the
/// buffers to fit the second-level cache.
pub(super) fn block_rows(height: usize, width: usize) -> usize {
    (PIXELS / width).clamp(1, height.div_ceil(2))
}

const PIXELS: usize = 160;

impl Kind {
    /// Rows of the result written by the first task and by each other one, for `rows` of [`block_rows`].
    pub fn task_rows(self, rows: usize) -> (usize, usize) {
        match self {
            Self::Input | Self::Conv { .. } => (rows, rows),
            Self::ConvTranspose => (2 * rows + 1, 2 * rows),
        }
    }

    /// Rows of a task: coarse rows, or for transposed convolutions rows of corners between coarse
    /// pixels (one more).
    fn rows_of_task(self, task: usize, rows: usize, height: usize) -> Range<usize> {
        let (first, end) = (task * rows, (task + 1) * rows);
        match self {
            Self::Input | Self::Conv { .. } => first..end.min(height),
            Self::ConvTranspose => first + usize::from(task > 0)..(end + 1).min(height + 1),
        }
    }
}

/// Size of the coarse tensor of a node (its input) and of the fine one (its result).
#[derive(Debug, Clone, Copy)]
pub(super) struct Size {
    pub height: usize,
    pub width: usize,
}

/// Elements of [`Scratch`] for a node: window, product.
pub(super) fn scratch_needs(node: &Node, coarse: Size) -> (usize, usize) {
    let rows = block_rows(coarse.height, coarse.width);
    let w = coarse.width;
    match node.kind {
        Kind::Input => (0, 0),
        Kind::Conv { .. } => {
            let widest = node.inputs.max(node.outputs);
            (((rows + 2) * (w + 1) + 1) * widest, rows * (w + 1) * widest)
        }
        Kind::ConvTranspose => {
            let forward = ((rows + 2) * (w + 1) + 1) * node.inputs;
            let backward = 2 * (rows + 1) * (2 * w + 2) * node.outputs;
            let product = ((rows + 1) * 4 * node.outputs).max(rows * node.inputs);
            (forward.max(backward), product * (w + 1))
        }
    }
}

/// Copies rows `first - border .. first - border + rows` of a tensor with a zero border. Rows
/// outside the tensor are zero.
fn gather(
    tensor: &[f32],
    size: Size,
    channels: usize,
    first: usize,
    rows: usize,
    border: usize,
    out: &mut [f32],
) {
    let pitch = (size.width + border) * channels;
    for r in 0..rows {
        let row = &mut out[r * pitch..(r + 1) * pitch];
        row[..border * channels].fill(0.0);
        let inside = &mut row[border * channels..];
        match (first + r).checked_sub(border).filter(|&y| y < size.height) {
            Some(y) => {
                let length = size.width * channels;
                inside.copy_from_slice(&tensor[y * length..(y + 1) * length]);
            }
            None => inside.fill(0.0),
        }
    }
    // right border of the last row
    out[rows * pitch..rows * pitch + border * channels].fill(0.0);
}

/// Operations on a pixel's sums before they are stored.
pub(super) struct Finish<'a> {
    pub bias: &'a [f32],
    /// Slope of the leaky ReLU, or 1.
    pub slope: f32,
}

impl Finish<'_> {
    /// Computes `out = act(sums + bias (+ add))`, and stores the value before the activation in `before`.
    fn pixel(
        &self,
        sums: &[f32],
        add: Option<&[f32]>,
        before: Option<&mut [f32]>,
        out: &mut [f32],
    ) {
        for ((o, &s), &b) in out.iter_mut().zip(sums).zip(self.bias) {
            *o = s + b;
        }
        if let Some(add) = add {
            for (o, &a) in out.iter_mut().zip(add) {
                *o += a;
            }
        }
        if let Some(before) = before {
            before.copy_from_slice(out);
        }
        if self.slope != 1.0 {
            for o in out.iter_mut() {
                *o = o.max(self.slope * *o);
            }
        }
    }
}

/// Result rows of one task, and the tensor added to them.
pub(super) struct Target<'a> {
    pub out: &'a mut [f32],
    pub before: Option<&'a mut [f32]>,
    pub add: Option<&'a [f32]>,
}

/// Results of [`Node::kind`] for `input` in a task with `rows` of [`block_rows`].
pub(super) fn forward_block(
    node: &Node,
    input: &[f32],
    coarse: Size,
    task: usize,
    rows: usize,
    finish: &Finish,
    target: &mut Target,
    scratch: &mut Scratch,
) {
    let (ci, co) = (node.inputs, node.outputs);
    let w = coarse.width;
    let range = node.kind.rows_of_task(task, rows, coarse.height);
    let (first, rows) = (range.start, range.len());
    let Scratch { window, product } = scratch;
    match node.kind {
        Kind::Input => {}
        Kind::Conv { kernel } => {
            let border = kernel / 2;
            let pitch = w + border;
            gather(input, coarse, ci, first, rows + 2 * border, border, window);
            let shape = Shape {
                m: (rows - 1) * pitch + w,
                n: co,
                k: kernel * ci,
                a_stride: ci,
                c_stride: co,
            };
            for (ky, matrix) in node.forward.iter().enumerate() {
                multiply(shape, &window[ky * pitch * ci..], matrix, product, ky > 0);
            }
            for y in 0..rows {
                for x in 0..w {
                    store(finish, target, &product[(y * pitch + x) * co..][..co], y * w + x, co);
                }
            }
        }
        Kind::ConvTranspose => {
            // The four results around each corner between coarse pixels are sums over the same
            // window of two by two, so one product computes all of them.
            let pitch = w + 1;
            gather(input, coarse, ci, first, rows + 1, 1, window);
            let shape =
                Shape { m: rows * pitch, n: 4 * co, k: 2 * ci, a_stride: ci, c_stride: 4 * co };
            for (ty, matrix) in node.forward.iter().enumerate() {
                multiply(shape, &window[ty * pitch * ci..], matrix, product, ty > 0);
            }
            let top = (2 * first).saturating_sub(1);
            for (corner, sums) in product[..rows * pitch * 4 * co].chunks_exact(4 * co).enumerate()
            {
                let (y, x) = (2 * (first + corner / pitch), 2 * (corner % pitch));
                for (i, sums) in sums.chunks_exact(co).enumerate() {
                    let (y, x) = (y + i / 2, x + i % 2);
                    // shifted up and left by one; the outermost corners lie on the border
                    if (1..=2 * coarse.height).contains(&y) && (1..=2 * w).contains(&x) {
                        store(finish, target, sums, (y - 1 - top) * 2 * w + x - 1, co);
                    }
                }
            }
        }
    }
}

#[inline]
fn store(finish: &Finish, target: &mut Target, sums: &[f32], pixel: usize, channels: usize) {
    let range = pixel * channels..(pixel + 1) * channels;
    finish.pixel(
        sums,
        target.add.map(|a| &a[range.clone()]),
        target.before.as_deref_mut().map(|b| &mut b[range.clone()]),
        &mut target.out[range],
    );
}

/// Rows `first .. first + rows` of the coarse side: the transpose of [`Node::kind`] applied to
/// `gradient`, which has the size of the node's result.
pub(super) fn backward_block(
    node: &Node,
    gradient: &[f32],
    coarse: Size,
    first: usize,
    rows: usize,
    out: &mut [f32],
    scratch: &mut Scratch,
) {
    let (ci, co) = (node.inputs, node.outputs);
    let w = coarse.width;
    let Scratch { window, product } = scratch;
    let pitch = match node.kind {
        Kind::Input => return,
        Kind::Conv { kernel } => {
            let border = kernel / 2;
            let pitch = w + border;
            gather(gradient, coarse, co, first, rows + 2 * border, border, window);
            let shape = Shape {
                m: (rows - 1) * pitch + w,
                n: ci,
                k: kernel * co,
                a_stride: co,
                c_stride: ci,
            };
            for (ky, matrix) in node.backward.iter().enumerate() {
                multiply(shape, &window[ky * pitch * co..], matrix, product, ky > 0);
            }
            pitch
        }
        Kind::ConvTranspose => {
            // Row of taps `ky` reads fine rows 2 y + ky - 1, all of one parity. With separated
            // parities, one coarse row is a constant step in memory.
            let fine = Size { height: 2 * coarse.height, width: 2 * w };
            let row_length = (2 * w + 2) * co;
            let plane = (rows + 1) * row_length;
            for r in 0..2 * rows + 2 {
                let to = (r % 2) * plane + (r / 2) * row_length;
                let row = &mut window[to..to + row_length];
                match (2 * first + r).checked_sub(1).filter(|&y| y < fine.height) {
                    Some(y) => {
                        let length = fine.width * co;
                        row[..co].fill(0.0);
                        row[co..co + length]
                            .copy_from_slice(&gradient[y * length..(y + 1) * length]);
                        row[co + length..].fill(0.0);
                    }
                    None => row.fill(0.0),
                }
            }
            let pitch = w + 1;
            let shape = Shape {
                m: (rows - 1) * pitch + w,
                n: ci,
                k: 4 * co,
                a_stride: 2 * co,
                c_stride: ci,
            };
            for (ky, matrix) in node.backward.iter().enumerate() {
                let from = (ky % 2) * plane + (ky / 2) * row_length;
                multiply(shape, &window[from..], matrix, product, ky > 0);
            }
            pitch
        }
    };
    for y in 0..rows {
        let length = w * ci;
        out[y * length..(y + 1) * length].copy_from_slice(&product[y * pitch * ci..][..length]);
    }
}
