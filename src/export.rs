//! Maps to files: PNG, EXR, previews.
