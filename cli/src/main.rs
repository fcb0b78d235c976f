//! Command line of svbrdf.
fn main() {}
