//! Forward and backward pass of the decoder over the buffers of a workspace.

use super::container::Container;
use super::graph::{Graph, Node};
use super::kernels::{Finish, Target, backward_block, forward_block};
use super::texels;
use super::workspace::{ScratchPool, Tensors, Workspace};
use crate::parallel;
use crate::svbrdf::CHANNELS;
use crate::{Error, Result};

/// The decoder network.
#[derive(Debug, Clone)]
pub struct Decoder {
    graph: Graph,
}

impl Decoder {
    /// Reads the decoder's file.
    ///
    /// # Errors
    /// [`Error::Model`] if the file is damaged or describes an unsupported network.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Ok(Self { graph: Graph::build(&Container::parse(bytes)?)? })
    }

    /// Channels of the code.
    pub fn code_channels(&self) -> usize {
        self.graph.nodes[0].outputs
    }

    /// Texels per code element along each side.
    pub fn stride(&self) -> usize {
        self.graph.stride
    }

    /// Multiplications and additions of one forward pass for a code of `height * width`. A
    /// vector-Jacobian product needs as many.
    pub fn operations(&self, height: usize, width: usize) -> usize {
        let pair = |nodes: &[Node]| {
            let n = &nodes[1];
            let pixels = height * width * nodes[0].scale * nodes[0].scale;
            2 * pixels * n.forward.iter().map(Vec::len).sum::<usize>()
        };
        self.graph.nodes.windows(2).map(pair).sum()
    }

    /// Decodes `code` (`channels * height * width`, channel planes as in PyTorch) to nine encoded
    /// planes of `stride * height` rows, which remain in `workspace`.
    ///
    /// # Errors
    /// If `code` does not fit the workspace.
    pub fn forward<'w>(&self, code: &[f32], workspace: &'w mut Workspace) -> Result<&'w [f32]> {
        self.check("code", code.len(), workspace, self.code_channels(), 1)?;
        let graph = &self.graph;
        let (nodes, encoded, scratch) = workspace.parts();
        self.input(code, &mut nodes[0]);
        for i in 1..graph.nodes.len() {
            let (done, rest) = nodes.split_at_mut(i);
            self.forward_node(i, done, &mut rest[0], scratch);
        }
        texels::write_maps(&nodes[nodes.len() - 1], graph.block, encoded);
        Ok(&workspace.encoded)
    }

    /// Gradient by the code of the last [`Decoder::forward`], from the gradient by its result (nine
    /// planes). Both buffers are overwritten.
    ///
    /// # Errors
    /// If a slice does not fit the workspace.
    pub fn vjp(
        &self,
        workspace: &mut Workspace,
        gradient: &[f32],
        code_gradient: &mut [f32],
    ) -> Result<()> {
        self.check("gradient", gradient.len(), workspace, CHANNELS, self.stride())?;
        self.check("code gradient", code_gradient.len(), workspace, self.code_channels(), 1)?;
        let graph = &self.graph;
        let (nodes, encoded, scratch) = workspace.parts();
        let last = nodes.len() - 1;
        texels::read_gradient(&mut nodes[last], graph.block, encoded, gradient);
        for i in (1..=last).rev() {
            self.backward_node(i, nodes, scratch);
        }
        let input = &nodes[0];
        let texels = input.size.height * input.size.width;
        let channels = self.code_channels();
        for (c, plane) in code_gradient.chunks_exact_mut(texels).enumerate() {
            for (i, v) in plane.iter_mut().enumerate() {
                *v = input.gradient[i * channels + c];
            }
        }
        Ok(())
    }

    fn check(
        &self,
        argument: &'static str,
        length: usize,
        workspace: &Workspace,
        channels: usize,
        scale: usize,
    ) -> Result<()> {
        let (height, width) = workspace.code_size();
        let expected = channels * height * width * scale * scale;
        let fits = workspace.nodes.len() == self.graph.nodes.len()
            && workspace.encoded.len() == CHANNELS * height * width * self.stride().pow(2)
            && workspace
                .nodes
                .iter()
                .zip(&self.graph.nodes)
                .all(|(t, n)| t.value.len() == height * width * n.scale * n.scale * n.outputs);
        if !fits {
            return Err(Error::argument("workspace", "it was made for another decoder"));
        }
        if length != expected {
            return Err(Error::argument(
                argument,
                format!("{length} values given, {expected} expected"),
            ));
        }
        Ok(())
    }

    /// Converts planes to channels-last, with the operations fused into the input.
    fn input(&self, code: &[f32], tensors: &mut Tensors) {
        let node = &self.graph.nodes[0];
        let texels = tensors.size.height * tensors.size.width;
        let keep = tensors.before.len() == tensors.value.len();
        for (c, plane) in code.chunks_exact(texels).enumerate() {
            for (i, &v) in plane.iter().enumerate() {
                let at = i * node.outputs + c;
                if keep {
                    tensors.before[at] = v;
                }
                tensors.value[at] = if node.leaky { v.max(self.graph.slope * v) } else { v };
            }
        }
    }

    fn forward_node(&self, i: usize, done: &[Tensors], here: &mut Tensors, scratch: &ScratchPool) {
        let node = &self.graph.nodes[i];
        let input = &done[i - 1];
        let slope = if node.leaky { self.graph.slope } else { 1.0 };
        let finish = Finish { bias: &node.bias, slope };
        let add = node.add.map(|saved| {
            let from = &done[saved.node];
            let stored = !saved.activated && self.graph.nodes[saved.node].leaky;
            if stored { from.before.as_slice() } else { from.value.as_slice() }
        });
        let coarse = input.size;
        let rows = here.rows;
        let line = here.size.width * node.outputs;
        let (head, further) = node.kind.task_rows(rows);
        let head = (head * line).min(here.value.len());
        let keep = here.before.len() == here.value.len();
        let parts =
            |values, kept: bool| tasks(values, if kept { (head, further * line) } else { (1, 1) });
        parallel::parts(
            parts(&mut here.value, true).zip(parts(&mut here.before, keep)),
            |task, (out, before)| {
                let start = if task == 0 { 0 } else { head + (task - 1) * further * line };
                let range = start..start + out.len();
                let mut target =
                    Target { out, before: keep.then_some(before), add: add.map(|a| &a[range]) };
                let scratch = &mut *scratch.get();
                let input = &input.value;
                forward_block(node, input, coarse, task, rows, &finish, &mut target, scratch);
            },
        );
    }

    /// Propagates the gradient from node `i`'s sums to those of the node before.
    fn backward_node(&self, i: usize, nodes: &mut [Tensors], scratch: &ScratchPool) {
        let node = &self.graph.nodes[i];
        let before = &self.graph.nodes[i - 1];
        let (early, late) = nodes.split_at_mut(i);
        let late = &*late;
        let Tensors { size: coarse, value, gradient, .. } = &mut early[i - 1];
        let (coarse, value) = (*coarse, &*value);
        let rows = late[0].rows;
        let chunk = rows * coarse.width * node.inputs;
        let slope = if before.leaky { self.graph.slope } else { 1.0 };
        parallel::parts(gradient.chunks_mut(chunk), |block, out| {
            let first = block * rows;
            let range = block * chunk..block * chunk + out.len();
            let scratch = &mut *scratch.get();
            let rows = rows.min(coarse.height - first);
            backward_block(node, &late[0].gradient, coarse, first, rows, out, scratch);
            let add = |out: &mut [f32], users: &[usize]| {
                for &user in users {
                    for (o, &g) in out.iter_mut().zip(&late[user - i].gradient[range.clone()]) {
                        *o += g;
                    }
                }
            };
            add(out, &before.used_after);
            if before.leaky {
                // The result of a leaky ReLU has the sign of its argument. The expression is
                // branch-free to vectorise.
                for (o, &v) in out.iter_mut().zip(&value[range.clone()]) {
                    *o *= f32::from(u8::from(v > 0.0)).max(slope);
                }
            }
            add(out, &before.used_before);
        });
    }
}

impl Workspace {
    /// A workspace for codes of `height` rows and `width` columns.
    ///
    /// # Errors
    /// If a side is zero or the maps would exceed 8192 texels along a side.
    pub fn new(decoder: &Decoder, height: usize, width: usize) -> Result<Self> {
        Self::of_graph(&decoder.graph, height, width)
    }
}

/// The part of the first task, and the parts of the others.
fn tasks(values: &mut [f32], (first, further): (usize, usize)) -> impl Iterator<Item = &mut [f32]> {
    let (head, tail) = values.split_at_mut(first);
    std::iter::once(head).chain(tail.chunks_mut(further))
}
