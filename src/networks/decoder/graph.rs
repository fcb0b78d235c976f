//! Converts the file's list of layers to nodes: convolutions with fused operations.

use super::container::{Container, Layer, channels, fault};
use crate::svbrdf::CHANNELS;
use crate::{Error, Result};

/// Linear part of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// The code (first node only).
    Input,
    /// Stride 1, zero padding.
    Conv { kernel: usize },
    /// 4x4, stride 2, padding 1.
    ConvTranspose,
}

/// A tensor that a later node adds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Saved {
    pub node: usize,
    /// Before or after the node's leaky ReLU.
    pub activated: bool,
}

/// `value = act(kind(previous value) + bias + saved)`.
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub kind: Kind,
    pub inputs: usize,
    pub outputs: usize,
    /// Resolution of the result relative to the code.
    pub scale: usize,
    pub bias: Vec<f32>,
    /// Matrices of the forward pass, one per memory-contiguous group of taps.
    pub forward: Vec<Vec<f32>>,
    /// The same for the vector-Jacobian product.
    pub backward: Vec<Vec<f32>>,
    pub add: Option<Saved>,
    pub leaky: bool,
    /// Nodes that add this one's result before its activation.
    pub used_before: Vec<usize>,
    /// Nodes that add this one's result after its activation.
    pub used_after: Vec<usize>,
}

#[derive(Debug, Clone)]
pub(super) struct Graph {
    pub nodes: Vec<Node>,
    pub stride: usize,
    pub slope: f32,
    /// Side of the blocks of texels in the final rearrangement of channels.
    pub block: usize,
}

impl Graph {
    pub fn build(file: &Container) -> Result<Self> {
        let mut builder = Builder::new(file);
        for (index, layer) in file.layers.iter().enumerate() {
            builder.layer(layer).map_err(|what| match what {
                Refused::Here(what) => fault(format!("layer {index}: {what}")),
                Refused::File(error) => error,
            })?;
        }
        builder.finish()
    }
}

/// Reason for rejecting a layer.
enum Refused {
    /// The layer is invalid at its position.
    Here(&'static str),
    /// The file has a fault.
    File(Error),
}

impl From<Error> for Refused {
    fn from(error: Error) -> Self {
        Self::File(error)
    }
}

/// A partially built graph.
struct Builder<'a> {
    file: &'a Container,
    nodes: Vec<Node>,
    /// Saved tensors without an addition yet.
    saved: Vec<Saved>,
    block: Option<usize>,
    ended: bool,
}

impl<'a> Builder<'a> {
    fn new(file: &'a Container) -> Self {
        let input = Node {
            kind: Kind::Input,
            inputs: file.code_channels,
            outputs: file.code_channels,
            scale: 1,
            bias: Vec::new(),
            forward: Vec::new(),
            backward: Vec::new(),
            add: None,
            leaky: false,
            used_before: Vec::new(),
            used_after: Vec::new(),
        };
        Self { file, nodes: vec![input], saved: Vec::new(), block: None, ended: false }
    }

    fn layer(&mut self, layer: &Layer) -> std::result::Result<(), Refused> {
        let here = self.nodes.len() - 1;
        if self.ended || (self.block.is_some() && !matches!(layer, Layer::Tanh {})) {
            return Err(Refused::Here("nothing may follow the output"));
        }
        match *layer {
            Layer::Conv { kernel, inputs, outputs, weight, bias } => {
                if kernel != 1 && kernel != 3 {
                    return Err(Refused::Here("kernels are 1x1 or 3x3"));
                }
                let kind = Kind::Conv { kernel: kernel as usize };
                let node = &self.nodes[here];
                let node = convolution(self.file, node, kind, inputs, outputs, weight, bias)?;
                self.nodes.push(node);
            }
            Layer::ConvTranspose { inputs, outputs, weight, bias } => {
                let (kind, node) = (Kind::ConvTranspose, &self.nodes[here]);
                let node = convolution(self.file, node, kind, inputs, outputs, weight, bias)?;
                self.nodes.push(node);
            }
            Layer::LeakyRelu {} => {
                if self.nodes[here].leaky {
                    return Err(Refused::Here("two activations in a row"));
                }
                self.nodes[here].leaky = true;
            }
            Layer::Save {} => {
                self.saved.push(Saved { node: here, activated: self.nodes[here].leaky });
            }
            Layer::Add {} => self.add(here).map_err(Refused::Here)?,
            Layer::DepthToSpace { block } => {
                if !(1..=16).contains(&block) {
                    return Err(Refused::Here("blocks are 1 to 16 texels wide"));
                }
                self.block = Some(block as usize);
            }
            Layer::Tanh {} => self.ended = true,
        }
        Ok(())
    }

    /// Adds the tensor saved last to the result of the latest convolution.
    fn add(&mut self, here: usize) -> std::result::Result<(), &'static str> {
        let source = self.saved.pop().ok_or("nothing was saved")?;
        let (from, node) = (&self.nodes[source.node], &self.nodes[here]);
        if source.node == here || node.leaky || node.add.is_some() {
            return Err("an addition must follow a convolution");
        }
        if self.saved.iter().any(|s| s.node == here) {
            return Err("a tensor saved before an addition to it");
        }
        if from.outputs != node.outputs || from.scale != node.scale {
            return Err("the tensors to add differ in size");
        }
        self.nodes[here].add = Some(source);
        let users = &mut self.nodes[source.node];
        if source.activated { &mut users.used_after } else { &mut users.used_before }.push(here);
        Ok(())
    }

    fn finish(self) -> Result<Graph> {
        let Self { file, nodes, saved, block, ended } = self;
        let block = block.unwrap_or(1);
        let last = &nodes[nodes.len() - 1];
        if !ended || last.leaky || nodes.len() < 2 {
            return Err(fault("the last layers must be a convolution and tanh"));
        }
        if !saved.is_empty() {
            return Err(fault("a saved tensor is never added"));
        }
        if last.outputs != CHANNELS * block * block || last.scale * block != file.stride {
            return Err(fault(format!(
                "the result has {} channels in blocks of {block} at {} times the code's \
                 resolution; expected {CHANNELS} maps at {} times",
                last.outputs, last.scale, file.stride
            )));
        }
        Ok(Graph { nodes, stride: file.stride, slope: file.leaky_slope, block })
    }
}

fn convolution(
    file: &Container,
    before: &Node,
    kind: Kind,
    inputs: u32,
    outputs: u32,
    weight: u64,
    bias: u64,
) -> Result<Node> {
    let (inputs, outputs) = (channels(inputs)?, channels(outputs)?);
    if inputs != before.outputs {
        return Err(fault(format!(
            "a layer takes {inputs} channels, the one before gives {}",
            before.outputs
        )));
    }
    let (taps, scale) = match kind {
        Kind::Input => (0, before.scale),
        Kind::Conv { kernel } => (kernel * kernel, before.scale),
        Kind::ConvTranspose => (16, 2 * before.scale),
    };
    if scale > file.stride {
        return Err(fault("the layers enlarge by more than the stride"));
    }
    let weights = file.tensor(weight, taps * inputs * outputs)?;
    let (forward, backward) = match kind {
        Kind::Input => (Vec::new(), Vec::new()),
        Kind::Conv { kernel } => pack_conv(weights, inputs, outputs, kernel),
        Kind::ConvTranspose => pack_conv_transpose(weights, inputs, outputs),
    };
    Ok(Node {
        kind,
        inputs,
        outputs,
        scale,
        bias: file.tensor(bias, outputs)?.to_vec(),
        forward,
        backward,
        add: None,
        leaky: false,
        used_before: Vec::new(),
        used_after: Vec::new(),
    })
}

/// `[out][in][ky][kx]` to one matrix per kernel row (rows (kx, in), columns out), and to the
/// flipped convolution of the gradient (rows (kx, out), columns in).
fn pack_conv(w: &[f32], ci: usize, co: usize, k: usize) -> (Vec<Vec<f32>>, Vec<Vec<f32>>) {
    let at = |o: usize, i: usize, ky: usize, kx: usize| w[((o * ci + i) * k + ky) * k + kx];
    let mut forward = vec![Vec::with_capacity(k * ci * co); k];
    let mut backward = forward.clone();
    for ky in 0..k {
        for kx in 0..k {
            for i in 0..ci {
                forward[ky].extend((0..co).map(|o| at(o, i, ky, kx)));
            }
            for o in 0..co {
                backward[ky].extend((0..ci).map(|i| at(o, i, k - 1 - ky, k - 1 - kx)));
            }
        }
    }
    (forward, backward)
}

/// `[in][out][ky][kx]` to two matrices for the corners between coarse pixels, one per row of pixels
/// around a corner (rows (tx, in), columns (fine row, fine column, out)), and to the four rows of
/// taps of the gradient (rows (kx, out), columns in).
///
/// The corner above and left of pixel (y, x) has the fine rows `2 y - 1 + r`. Coarse row `y - 1 +
/// t` reaches each through kernel row `2 + r - 2 t`. Columns are alike.
fn pack_conv_transpose(w: &[f32], ci: usize, co: usize) -> (Vec<Vec<f32>>, Vec<Vec<f32>>) {
    let at = |i: usize, o: usize, ky: usize, kx: usize| w[((i * co + o) * 4 + ky) * 4 + kx];
    let mut forward: [_; 2] = std::array::from_fn(|_| Vec::with_capacity(8 * ci * co));
    for (ty, matrix) in forward.iter_mut().enumerate() {
        for tx in 0..2 {
            for i in 0..ci {
                for (r, s) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    matrix.extend((0..co).map(|o| at(i, o, 2 + r - 2 * ty, 2 + s - 2 * tx)));
                }
            }
        }
    }
    let mut backward: [_; 4] = std::array::from_fn(|_| Vec::with_capacity(4 * ci * co));
    for ky in 0..4 {
        for kx in 0..4 {
            for o in 0..co {
                backward[ky].extend((0..ci).map(|i| at(i, o, ky, kx)));
            }
        }
    }
    (forward.into(), backward.into())
}
