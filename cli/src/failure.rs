//! Who is to blame when a command fails.

use svbrdf::Error;

/// Result of a command.
pub type Result<T> = std::result::Result<T, Failure>;

/// Why a command failed.
#[derive(Debug)]
pub enum Failure {
    /// The input is at fault.
    Input(String),
    /// Anything else, e.g. a folder that cannot be written.
    Other(String),
}

impl Failure {
    /// A fault met while reading input.
    pub fn input(error: Error) -> Self {
        match error {
            Error::Internal(_) | Error::Model { .. } | Error::Cancelled => error.into(),
            _ => Self::Input(error.to_string()),
        }
    }

    /// Text for the user.
    pub fn message(&self) -> &str {
        match self {
            Self::Input(message) | Self::Other(message) => message,
        }
    }

    /// Exit status.
    pub fn status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Other(_) => 1,
        }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match error {
            Error::Argument { .. } | Error::Field { .. } => Self::Input(error.to_string()),
            _ => Self::Other(error.to_string()),
        }
    }
}
