//! Failures of a command, and their exit status.

use svbrdf::Error;

/// Result of a command.
pub type Result<T> = std::result::Result<T, Failure>;

/// The reason for which a command failed.
#[derive(Debug)]
pub enum Failure {
    /// The input is at fault.
    Input(String),
    /// Anything else, e.g. a folder that cannot be written.
    Other(String),
    /// The user or the system ended the command; the results so far are written.
    Interrupted(String),
}

impl Failure {
    /// A fault met while reading input.
    pub fn input(error: Error) -> Self {
        match error {
            Error::Internal(_) | Error::Model { .. } | Error::Cancelled => error.into(),
            _ => Self::Input(error.to_string()),
        }
    }

    /// Exit status.
    pub fn status(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Other(_) => 1,
            // As shells report a command that SIGINT ended.
            Self::Interrupted(_) => 130,
        }
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Input(message) | Self::Other(message) => write!(f, "error: {message}"),
            Self::Interrupted(message) => write!(f, "interrupted: {message}"),
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
