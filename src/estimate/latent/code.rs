//! The latent code, its fixed detail, and its optimiser.

use super::gains;
use crate::estimate::adam::Adam;
use crate::estimate::options::LatentOptions;
use crate::networks::{Networks, Workspace, encoded_maps};
use crate::observation::Observation;
use crate::parallel;
use crate::render;
use crate::svbrdf::{CHANNELS, RANGE, encoding};
use crate::{Error, Result, Svbrdf};

/// Decay of Adam's moments.
const BETAS: [f32; 2] = [0.9, 0.99];
/// Least expected deviation of slopes from the start's, in encoded units. Otherwise it is their root mean
/// square: start maps that look flat mostly are, and small slopes matter most on polished surfaces.
const MIN_DEVIATION: f32 = 0.01;
/// Least derivative of an albedo by its encoded value in a step: black texels would otherwise stay black.
const MIN_DERIVATIVE: f32 = 0.02;
/// Texels per task of the conversions between encoded and natural parameters.
const CHUNK: usize = 4096;

#[derive(Debug)]
pub(super) struct Code {
    values: Vec<f32>,
    /// Mean of the prior of slopes, two encoded planes.
    anchor: Vec<f32>,
    /// Sigma of the prior of slopes.
    deviation: f32,
    adam: Adam,
    /// Detail of the start that the decoder cannot express, encoded planes.
    detail: Vec<f32>,
    maps: Svbrdf,
    /// Whether the maps are older than the code.
    stale: bool,
    /// Buffers of a step; allocated when needed.
    tools: Option<Box<Tools>>,
}

/// Large buffers.
#[derive(Debug)]
struct Tools {
    gradient: Vec<f32>,
    code_gradient: Vec<f32>,
    workspace: Workspace,
}

impl Tools {
    fn new(networks: &Networks, maps: &Svbrdf, code: usize) -> Result<Box<Self>> {
        let decoder = networks.decoder();
        let stride = decoder.stride();
        let workspace = Workspace::new(decoder, maps.height() / stride, maps.width() / stride)?;
        let gradient = vec![0.0; CHANNELS * maps.texels()];
        Ok(Box::new(Self { gradient, code_gradient: vec![0.0; code], workspace }))
    }
}

impl Code {
    pub fn new(networks: &Networks, start: &Svbrdf) -> Result<Self> {
        let values = networks.encode(start)?;
        let mut anchor = encoded_maps(start);
        anchor.truncate(2 * start.texels());
        let square = anchor.iter().map(|v| v * v).sum::<f32>() / anchor.len() as f32;
        let mut code = Self {
            deviation: square.sqrt().max(MIN_DEVIATION),
            anchor,
            adam: Adam::new(values.len()),
            detail: vec![0.0; CHANNELS * start.texels()],
            maps: start.clone(),
            stale: false,
            tools: None,
            values,
        };
        code.restart(networks, start)?;
        Ok(code)
    }

    /// Continues from other maps of the same size with the current code and moments; the difference becomes
    /// detail.
    pub fn restart(&mut self, networks: &Networks, start: &Svbrdf) -> Result<()> {
        let mut tools = self.take_tools(networks)?;
        let decoded = networks.decoder().forward(&self.values, &mut tools.workspace)?;
        let start = encoded_maps(start);
        for ((detail, start), decoded) in self.detail.iter_mut().zip(start).zip(decoded) {
            *detail = start - decoded;
        }
        self.write_maps(&tools);
        self.tools = Some(tools);
        Ok(())
    }

    fn take_tools(&mut self, networks: &Networks) -> Result<Box<Tools>> {
        match self.tools.take() {
            Some(tools) => Ok(tools),
            None => Tools::new(networks, &self.maps, self.values.len()),
        }
    }

    /// Applies the gains that the photographs determine and continues from the code of the result.
    pub fn apply_gains(&mut self, networks: &Networks, observations: &[Observation]) -> Result<()> {
        let mut maps = self.maps.clone();
        if gains::apply(&mut maps, observations) {
            self.values = networks.encode(&maps)?;
            self.restart(networks, &maps)?;
        }
        Ok(())
    }

    pub fn maps(&self) -> &Svbrdf {
        &self.maps
    }

    /// Updates the maps from the code.
    pub fn refresh(&mut self, networks: &Networks) -> Result<()> {
        if self.stale {
            let mut tools = self.take_tools(networks)?;
            networks.decoder().forward(&self.values, &mut tools.workspace)?;
            self.write_maps(&tools);
            self.tools = Some(tools);
        }
        Ok(())
    }

    /// One step of the optimiser; returns the loss before it.
    pub fn step(
        &mut self,
        networks: &Networks,
        observations: &[Observation],
        rate: f32,
        options: &LatentOptions,
    ) -> Result<f64> {
        let mut tools = self.take_tools(networks)?;
        networks.decoder().forward(&self.values, &mut tools.workspace)?;
        self.write_maps(&tools);
        let loss = render::loss_and_gradient(&self.maps, observations, &mut tools.gradient);
        if !loss.is_finite() {
            return Err(Error::Internal("the loss of the fit is not finite".to_owned()));
        }
        // The first photographs are ambiguous, not only noisy: the prior fades with the square of their
        // number.
        let photographs = observations.len().max(1) as f32;
        let prior_weight = options.prior_weight / (photographs * photographs);
        self.encode_gradient(&mut tools, prior_weight);
        let Tools { gradient, code_gradient, workspace } = &mut *tools;
        networks.decoder().vjp(workspace, gradient, code_gradient)?;
        self.adam.step(&mut self.values, code_gradient, rate, BETAS);
        self.stale = true;
        self.tools = Some(tools);
        Ok(loss)
    }

    /// Natural parameters of `decoded + detail`, within their ranges.
    fn write_maps(&mut self, tools: &Tools) {
        self.stale = false;
        let n = self.maps.texels();
        let (decoded, detail) = (tools.workspace.encoded(), &self.detail);
        parallel::parts(pieces(self.maps.planes_mut(), n), |_, (c, i, out)| {
            let (low, high) = encoded_range(c);
            let at = c * n + i * CHUNK;
            let sums = decoded[at..].iter().zip(&detail[at..]);
            for (o, (d, r)) in out.iter_mut().zip(sums) {
                *o = encoding::decode(c, (d + r).clamp(low, high));
            }
        });
    }

    /// Converts the gradient from natural parameters to the decoder's output and adds the prior's. At a bound
    /// of the range, a gradient that leads outward is 0.
    fn encode_gradient(&self, tools: &mut Tools, prior_weight: f32) {
        let n = self.maps.texels();
        let Tools { gradient, workspace, .. } = tools;
        let (decoded, detail, anchor) = (workspace.encoded(), &self.detail, &self.anchor);
        let pull = prior_weight / (n as f32 * self.deviation * self.deviation);
        parallel::parts(pieces(gradient, n), |_, (c, i, gradient)| {
            let (low, high) = encoded_range(c);
            let at = c * n + i * CHUNK;
            let planes = decoded[at..].iter().zip(&detail[at..]);
            for (g, (d, r)) in gradient.iter_mut().zip(planes) {
                let e = d + r;
                // The derivative of an albedo vanishes at its lower bound.
                *g *= encoding::decode_derivative(c, e.clamp(low, high)).max(MIN_DERIVATIVE);
                let outward = (e <= low && *g > 0.0) || (e >= high && *g < 0.0);
                *g = if outward { 0.0 } else { *g };
            }
            if pull > 0.0 && c < anchor.len() / n {
                let planes = decoded[at..].iter().zip(&detail[at..]).zip(&anchor[at..]);
                for (g, ((d, r), a)) in gradient.iter_mut().zip(planes) {
                    *g += pull * (d + r - a);
                }
            }
        });
    }
}

/// Chunks of planes of `n` values, with plane and index of each.
fn pieces(planes: &mut [f32], n: usize) -> impl Iterator<Item = (usize, usize, &mut [f32])> {
    let of_plane = |(c, plane)| {
        <[f32]>::chunks_mut(plane, CHUNK).enumerate().map(move |(i, piece)| (c, i, piece))
    };
    planes.chunks_mut(n).enumerate().flat_map(of_plane)
}

fn encoded_range(c: usize) -> (f32, f32) {
    let (low, high) = RANGE[c];
    match c {
        // `encode` would clip to the slopes that the networks can express.
        crate::svbrdf::channel::SLOPE_X | crate::svbrdf::channel::SLOPE_Y => {
            (low / encoding::SLOPE_SCALE, high / encoding::SLOPE_SCALE)
        }
        _ => (encoding::encode(c, low), encoding::encode(c, high)),
    }
}
