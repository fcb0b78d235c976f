//! Faults ([`Error`]) apart from photographs that cannot be used ([`Rejection`]).

use std::path::{Path, PathBuf};

/// Result of everything that can fail in this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A fault: the caller, a file or the machine is to blame, not the photograph's content.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A file that should be a picture could not be decoded.
    #[error("{}: not a readable image: {message}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        message: String,
    },
    /// A field of a file (or of a struct handed over) has no usable value.
    #[error("{}: field `{field}`: {message}; expected {expected}", path.display())]
    Field {
        /// The file the field stands in.
        path: PathBuf,
        /// The field, in dotted notation.
        field: String,
        /// What is wrong with it.
        message: String,
        /// What would have been right.
        expected: String,
    },
    /// An argument of a call is out of range.
    #[error("{argument}: {message}")]
    Argument {
        /// Name of the argument.
        argument: &'static str,
        /// What is wrong and what is expected.
        message: String,
    },
    /// A network file is damaged or does not fit this version.
    #[error("model {model}: {message}")]
    Model {
        /// Which network.
        model: String,
        /// What is wrong.
        message: String,
    },
    /// A saved session cannot be read.
    #[error("{0}")]
    State(StateFault),
    /// The work would need more memory than [`Settings`](crate::session::Settings) allow.
    #[error("about {} MiB of memory are needed, but only {} MiB are allowed", needed >> 20, limit >> 20)]
    MemoryLimit {
        /// Estimate of what all of the session would need, bytes.
        needed: u64,
        /// What is allowed, bytes.
        limit: u64,
    },
    /// No photograph has been accepted yet, so there are no maps.
    #[error("no photograph has been accepted yet")]
    NoMaps,
    /// The work was cancelled by the caller.
    #[error("cancelled")]
    Cancelled,
    /// A fault inside the library; the session it happened in answers this from then on.
    #[error("internal fault: {0}")]
    Internal(String),
}

impl Error {
    /// An [`Error::Io`] about `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), source }
    }

    /// An [`Error::Argument`].
    pub fn argument(argument: &'static str, message: impl Into<String>) -> Self {
        Self::Argument { argument, message: message.into() }
    }

    /// An [`Error::Model`].
    pub fn model(model: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Model { model: model.into(), message: message.into() }
    }
}

/// What is wrong with a saved session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateFault {
    /// It is something else.
    #[error("not a saved session")]
    Foreign,
    /// Its end is missing.
    #[error("the saved session is truncated")]
    Truncated,
    /// It is not what was written.
    #[error("the saved session is damaged: {0}")]
    Damaged(String),
    /// It was written in a newer format.
    #[error(
        "the saved session has format version {found}; this library reads versions up to {known}"
    )]
    Newer {
        /// Version of its format.
        found: u16,
        /// Latest one that this version reads.
        known: u16,
    },
}

/// Why a photograph was not used. Nothing of the session changed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Rejection {
    /// The photograph's size is not the camera's.
    #[error("the photo has {found_width}x{found_height} pixels, the camera {width}x{height}")]
    WrongSize {
        /// Width of the photograph, px.
        found_width: u32,
        /// Height of the photograph, px.
        found_height: u32,
        /// Width expected, px.
        width: u32,
        /// Height expected, px.
        height: u32,
    },
    /// Nothing like the target was found.
    #[error("no board found: show the whole checkerboard ring")]
    BoardNotFound,
    /// A part of the target was found, too little for a safe pose.
    #[error(
        "only {found} of {expected} board corners were found, {needed} are needed: show more of the board"
    )]
    TooFewCorners {
        /// Corners found.
        found: u32,
        /// Corners the target has.
        expected: u32,
        /// Corners needed.
        needed: u32,
    },
    /// Several places on the board fit what is seen equally well.
    #[error(
        "{found} board corners fit the board in more than one place: show more of its outline and hole"
    )]
    PlacementAmbiguous {
        /// Corners found.
        found: u32,
    },
    /// What is printed is not the board described.
    #[error("this is not the board described: {0}")]
    BoardDiffers(BoardDifference),
    /// The corners do not fit the board seen by the given camera, but by one of another focal length.
    #[error(
        "the photo was taken with {focal_ratio:.2} times the focal length of the camera: another lens or zoom, or cropped?"
    )]
    OtherCamera {
        /// The focal length that fits over that of the camera.
        focal_ratio: f32,
    },
    /// The board's squares are too small in the photograph.
    #[error(
        "the board's squares are only {square_px:.1} px wide, {needed_px:.0} are needed: come nearer, or take larger photos"
    )]
    SquaresTooSmall {
        /// Median side of a square, px.
        square_px: f32,
        /// Side needed, px.
        needed_px: f32,
    },
    /// The corners do not fit one flat board of the given layout seen by the given camera.
    #[error(
        "the corners do not match the board (RMS error {rms_px:.2} px): check its layout, lay it flat"
    )]
    PoseUncertain {
        /// Reprojection error of the best pose, px.
        rms_px: f32,
    },
    /// Edges of the board are too soft.
    #[error("blurred by {blur_px:.1} px{}", blur_advice(*.direction_deg))]
    Blurred {
        /// Width of the edge spread (one sigma) along `direction_deg`, px.
        blur_px: f32,
        /// Direction in the photograph, degrees clockwise from its x axis, 0 to 180: across those
        /// of the board's edges that are clearly softer than the others. `None`: soft all round.
        direction_deg: Option<f32>,
    },
    /// The white squares are too dark.
    #[error("too dark: the white squares reach only {level:.4} of full scale: expose more")]
    TooDark {
        /// Median level of the white squares, 1 = full scale.
        level: f32,
    },
    /// Too much of the photograph is saturated.
    #[error("{:.0} % of the board or sample is over-exposed: expose less", share * 100.0)]
    Clipped {
        /// Share of saturated pixels, 0 to 1.
        share: f32,
    },
    /// The camera looks too flat across the sample.
    #[error(
        "the camera looks at the sample {degrees:.0} degrees from its normal, at most {limit:.0} are allowed"
    )]
    TooGrazing {
        /// Angle between the sample's normal and the viewing direction, degrees.
        degrees: f32,
        /// Largest angle accepted, degrees.
        limit: f32,
    },
    /// Too little of the sample is inside the photograph.
    #[error("only {:.0} % of the sample is inside the photo: show all of it", share * 100.0)]
    SampleOutside {
        /// Share of the sample seen, 0 to 1.
        share: f32,
    },
    /// The flash is missing: white squares do not show its fall-off, or it is behind the sample.
    #[error("the flash does not light the board: switch it on")]
    LightNotVisible,
    /// Bright and dark stripes run along its rows or columns.
    #[error(
        "bright and dark stripes (of {:.0} %) run across the photo: the light flickers; use the flash instead of the torch, or a longer exposure",
        amplitude * 100.0
    )]
    Flickers {
        /// Relative amplitude of the stripes.
        amplitude: f32,
    },
    /// Black is not what the print has: the contrast was changed.
    #[error(
        "the black squares are {black:.3} of white, not {usual:.3} as printed: the contrast was changed; use the photo as the camera wrote it, not an edited one"
    )]
    Edited {
        /// Black over white as the file has them.
        black: f32,
        /// The same of most photographs, or of the board described.
        usual: f32,
    },
    /// Values that are not numbers.
    #[error("the photo contains values that are not finite")]
    NotFinite,
}

/// What tells a printed board from its description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardDifference {
    /// Squares are missing along its outline: the description has a row or column too many.
    #[error(
        "its {side} {} of squares is not printed where {rows} rows and {cols} columns are described: count them anew, with the hole",
        if matches!(side, Side::Top | Side::Bottom) { "row" } else { "column" }
    )]
    SquaresMissing {
        /// Where they should be.
        side: Side,
        /// Rows described.
        rows: u32,
        /// Columns described.
        cols: u32,
    },
    /// Its markers name other squares: `top_left` or the order of the markers is another.
    #[error(
        "{count} markers name other squares, or stand upside down: check `top_left`, and the dictionary (older OpenCV begins boards of an even number of rows with a white square)"
    )]
    MarkersElsewhere {
        /// Markers that contradict the description.
        count: u32,
    },
    /// Its markers are of another dictionary.
    #[error("its {count} markers are none of the dictionary described")]
    MarkersUnknown {
        /// Markers that were read.
        count: u32,
    },
    /// White and black squares are exchanged, and the markers with them.
    #[error(
        "white and black squares are exchanged (as OpenCV before 4.6 prints boards with markers): it was used as it is; state `top_left`"
    )]
    ColoursExchanged,
    /// Its white squares hold markers, and the description is of a board without.
    #[error(
        "its white squares hold markers: it was used by its squares alone; describe it as a `charuco-ring`"
    )]
    MarkersNotDescribed,
    /// Its markers are those of a dictionary, counted otherwise.
    #[error(
        "its markers are of {inner} x {inner} modules and begin with number {first}, not as described: it was used by its squares alone"
    )]
    MarkersShifted {
        /// Id of its first marker.
        first: i32,
        /// Modules along a marker's side without the border.
        inner: u32,
    },
    /// Its markers are mirrored.
    #[error("its markers are mirrored: the photo, or the print, was flipped")]
    MarkersMirrored {
        /// Markers that are right once they are mirrored.
        count: u32,
    },
}

/// Side of the printed board, upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Row 0.
    Top,
    /// The last row.
    Bottom,
    /// Column 0.
    Left,
    /// The last column.
    Right,
}

impl std::fmt::Display for Side {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Top => "top",
            Self::Bottom => "bottom",
            Self::Left => "left",
            Self::Right => "right",
        })
    }
}

fn blur_advice(direction_deg: Option<f32>) -> String {
    match direction_deg {
        Some(degrees) => format!(" along {degrees:.0} degrees: hold still"),
        None => ": hold still, focus on the sample".into(),
    }
}

impl Rejection {
    /// Stable name for programs, e.g. `board_not_found`.
    pub fn code(&self) -> &'static str {
        match self {
            Self::WrongSize { .. } => "wrong_size",
            Self::BoardNotFound => "board_not_found",
            Self::TooFewCorners { .. } => "too_few_corners",
            Self::PlacementAmbiguous { .. } => "placement_ambiguous",
            Self::BoardDiffers(_) => "board_differs",
            Self::OtherCamera { .. } => "other_camera",
            Self::SquaresTooSmall { .. } => "squares_too_small",
            Self::PoseUncertain { .. } => "pose_uncertain",
            Self::Blurred { .. } => "blurred",
            Self::TooDark { .. } => "too_dark",
            Self::Clipped { .. } => "clipped",
            Self::TooGrazing { .. } => "too_grazing",
            Self::SampleOutside { .. } => "sample_outside",
            Self::LightNotVisible => "light_not_visible",
            Self::Flickers { .. } => "flickers",
            Self::Edited { .. } => "edited",
            Self::NotFinite => "not_finite",
        }
    }
}
