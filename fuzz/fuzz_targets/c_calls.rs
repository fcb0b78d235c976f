//! The C library's own sources, so that they are instrumented like the rest.
#![no_main]
#![allow(non_camel_case_types, dead_code)]

#[path = "../../ffi/src/budget.rs"]
mod budget;
#[path = "../../ffi/src/buffer.rs"]
mod buffer;
#[path = "../../ffi/src/callbacks.rs"]
mod callbacks;
#[path = "../../ffi/src/capture.rs"]
mod capture;
#[path = "../../ffi/src/events.rs"]
mod events;
#[path = "../../ffi/src/export.rs"]
mod export;
#[path = "../../ffi/src/gate.rs"]
mod gate;
#[path = "../../ffi/src/guide.rs"]
mod guide;
#[path = "../../ffi/src/handles.rs"]
mod handles;
#[path = "../../ffi/src/hints.rs"]
mod hints;
#[path = "../../ffi/src/image.rs"]
mod image;
#[path = "../../ffi/src/info.rs"]
mod info;
#[path = "../../ffi/src/live.rs"]
mod live;
#[path = "../../ffi/src/log.rs"]
mod log;
#[path = "../../ffi/src/maps.rs"]
mod maps;
#[path = "../../ffi/src/maps_input.rs"]
mod maps_input;
#[path = "../../ffi/src/models.rs"]
mod models;
#[path = "../../ffi/src/notifier.rs"]
mod notifier;
#[path = "../../ffi/src/options/mod.rs"]
mod options;
#[path = "../../ffi/src/owned_photo.rs"]
mod owned_photo;
#[path = "../../ffi/src/paper.rs"]
mod paper;
#[path = "../../ffi/src/phase.rs"]
mod phase;
#[path = "../../ffi/src/photo_file.rs"]
mod photo_file;
#[path = "../../ffi/src/photo_fit.rs"]
mod photo_fit;
#[path = "../../ffi/src/probe.rs"]
mod probe;
#[path = "../../ffi/src/process.rs"]
mod process;
#[path = "../../ffi/src/queue.rs"]
mod queue;
#[path = "../../ffi/src/reduced.rs"]
mod reduced;
#[path = "../../ffi/src/render.rs"]
mod render;
#[path = "../../ffi/src/reports.rs"]
mod reports;
#[path = "../../ffi/src/saved.rs"]
mod saved;
#[path = "../../ffi/src/session/mod.rs"]
mod session;
#[path = "../../ffi/src/sheet.rs"]
mod sheet;
#[path = "../../ffi/src/status.rs"]
mod status;
#[path = "../../ffi/src/texels.rs"]
mod texels;
#[path = "../../ffi/src/threads.rs"]
mod threads;
#[path = "../../ffi/src/uncertainty.rs"]
mod uncertainty;
#[path = "../../ffi/src/values.rs"]
mod values;
#[path = "../../ffi/src/versioned.rs"]
mod versioned;

#[path = "../shared/c_calls/mod.rs"]
mod c_calls;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    c_calls::run(data);
});
