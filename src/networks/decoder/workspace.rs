//! Buffers of a decoder run.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::graph::Graph;
use super::kernels::{Scratch, Size, block_rows, scratch_needs};
use crate::svbrdf::CHANNELS;
use crate::{Error, Result};

/// Longest side of the maps, texels.
const MAX_TEXELS: usize = 8192;

/// Tensors of a node for later nodes and for the backward pass.
#[derive(Debug)]
pub(super) struct Tensors {
    /// Size of the result.
    pub size: Size,
    /// Coarse rows (of the node's input) per task.
    pub rows: usize,
    /// The result.
    pub value: Vec<f32>,
    /// The result before its activation if a later node adds it; otherwise one unused value per task.
    pub before: Vec<f32>,
    /// Gradient by the node's sums.
    pub gradient: Vec<f32>,
}

/// All buffers of a [`Decoder`](super::Decoder) for one size of the code, allocated once.
///
/// It also holds the activations of the last forward pass for [`Decoder::vjp`](super::Decoder::vjp).
#[derive(Debug)]
pub struct Workspace {
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) nodes: Vec<Tensors>,
    pub(super) encoded: Vec<f32>,
    scratch: ScratchPool,
}

impl Workspace {
    /// Buffers for a graph.
    pub(super) fn of_graph(graph: &Graph, height: usize, width: usize) -> Result<Self> {
        let limit = MAX_TEXELS / graph.stride;
        if !(1..=limit).contains(&height) || !(1..=limit).contains(&width) {
            return Err(Error::argument(
                "code size",
                format!("{height}x{width} given, 1x1 to {limit}x{limit} expected"),
            ));
        }
        let mut coarse = Size { height, width };
        let mut needs = (0, 0);
        let mut nodes = Vec::with_capacity(graph.nodes.len());
        for node in &graph.nodes {
            let size = Size { height: height * node.scale, width: width * node.scale };
            let n = size.height * size.width * node.outputs;
            let rows = block_rows(coarse.height, coarse.width);
            let keep = node.leaky && !node.used_before.is_empty();
            nodes.push(Tensors {
                size,
                rows,
                value: vec![0.0; n],
                before: vec![0.0; if keep { n } else { coarse.height.div_ceil(rows) }],
                gradient: vec![0.0; n],
            });
            let need = scratch_needs(node, coarse);
            needs = (needs.0.max(need.0), needs.1.max(need.1));
            coarse = size;
        }
        let texels = height * width * graph.stride * graph.stride;
        Ok(Self {
            height,
            width,
            nodes,
            encoded: vec![0.0; CHANNELS * texels],
            scratch: ScratchPool::new(needs),
        })
    }

    /// Rows and columns of the code.
    pub fn code_size(&self) -> (usize, usize) {
        (self.height, self.width)
    }

    /// Maps of the last forward pass: nine encoded planes in [-1, 1], see [`crate::svbrdf::encoding`].
    pub fn encoded(&self) -> &[f32] {
        &self.encoded
    }

    /// The parts that a pass borrows simultaneously.
    pub(super) fn parts(&mut self) -> (&mut [Tensors], &mut [f32], &ScratchPool) {
        (&mut self.nodes, &mut self.encoded, &self.scratch)
    }
}

/// One [`Scratch`] per thread of the pool that created the workspace.
#[derive(Debug)]
pub(super) struct ScratchPool(Vec<Mutex<Scratch>>);

impl ScratchPool {
    fn new((window, product): (usize, usize)) -> Self {
        let scratch =
            || Mutex::new(Scratch { window: vec![0.0; window], product: vec![0.0; product] });
        Self((0..rayon::current_num_threads()).map(|_| scratch()).collect())
    }

    /// Buffers of the calling thread. Threads share them (and wait) only in a pool with more
    /// threads. The contents do not outlive a task, so a poisoned lock is harmless.
    pub fn get(&self) -> MutexGuard<'_, Scratch> {
        let index = rayon::current_thread_index().unwrap_or(0) % self.0.len();
        self.0[index].lock().unwrap_or_else(PoisonError::into_inner)
    }
}
