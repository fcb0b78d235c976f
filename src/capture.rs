//! A capture folder: `capture.json` and its photographs.
