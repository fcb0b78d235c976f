//! Value and partial derivatives of the BRDF of one texel.
