//! Per-texel refinement: maximum a posteriori, Levenberg-Marquardt.
