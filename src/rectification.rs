//! The top view of a photograph as an [`Observation`](crate::observation::Observation).
