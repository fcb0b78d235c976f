//! Forward rendering of maps and its adjoint.
