//! How far the maps may be off.

use crossbeam_channel::bounded;

use super::Session;
use super::worker::Command;
use crate::estimate::Evidence;
use crate::{Error, Result};

impl Session {
    /// Evidence.
    pub fn evidence(&self) -> Result<Evidence> {
        self.usable()?;
        let (reply, answer) = bounded(1);
        let sent = self.commands.send(Command::Evidence(reply)).is_ok();
        match if sent { answer.recv().ok() } else { None } {
            Some(evidence) => evidence,
            None => Err(self.usable().err().unwrap_or(Error::Cancelled)),
        }
    }
}
