//! Optimisation of the latent code against all photographs, and the multi-resolution schedule.
