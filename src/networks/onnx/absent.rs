//! Replaces graphs in builds without the feature `networks`.

use crate::{Error, Result};

pub(super) enum Graph {}

impl Graph {
    /// Always an error: this build runs no networks.
    pub fn parse(name: &'static str, _bytes: &[u8], _channels: usize) -> Result<Self> {
        Err(Error::model(name, "this build runs no networks (feature `networks`)"))
    }

    pub fn prepare(&self, _height: usize, _width: usize) -> Result<()> {
        match *self {}
    }

    pub fn run(&self, _height: usize, _width: usize, _input: Vec<f32>) -> Result<Vec<f32>> {
        match *self {}
    }
}
