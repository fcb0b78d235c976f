//! The SVBRDF decoder: forward pass and vector-Jacobian product.
