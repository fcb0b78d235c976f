//! C ABI over the session of `svbrdf`; `include/svbrdf.h` is made from this crate.
//!
//! * Handles are numbers looked up in a table, never addresses: a stale or foreign one is a
//!   status, not a crash, and a session lives until the last call inside it has returned.
//! * Every entry catches panics; one inside a session makes that session answer `FAILED` from then
//!   on.
//! * Structs begin with their size and are copied byte by byte into a struct of defaults, so that
//!   callers built against another version keep working.
#![allow(non_camel_case_types)]

pub mod budget;
pub mod buffer;
mod callbacks;
pub mod capture;
mod events;
pub mod export;
mod gate;
pub mod guide;
mod handles;
pub mod hints;
pub mod image;
pub mod info;
mod live;
pub mod log;
pub mod maps;
pub mod maps_input;
pub mod models;
mod notifier;
pub mod options;
mod owned_photo;
pub mod paper;
pub mod phase;
pub mod photo_file;
pub mod photo_fit;
pub mod probe;
pub mod process;
mod queue;
pub mod reduced;
pub mod render;
pub mod reports;
pub mod saved;
pub mod session;
pub mod sheet;
pub mod status;
pub mod texels;
pub mod threads;
pub mod uncertainty;
mod values;
mod versioned;
