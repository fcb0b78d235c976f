//! The log-L1 loss: value and gradient.
