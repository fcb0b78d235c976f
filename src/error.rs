//! Faults ([`Error`]) and unusable photographs ([`Rejection`]).

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
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file that should be a picture could not be decoded.
    #[error("{}: not a readable image: {message}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// Message of the decoder.
        message: String,
    },
    /// A field of a file, or of a struct passed in, has no usable value.
    #[error("{}: field `{field}`: {message}; expected {expected}", path.display())]
    Field {
        /// The file that contains the field.
        path: PathBuf,
        /// The field, in dotted notation.
        field: String,
        /// The fault.
        message: String,
        /// The values allowed.
        expected: String,
    },
    /// An argument of a call is out of range.
    #[error("{argument}: {message}")]
    Argument {
        /// Name of the argument.
        argument: &'static str,
        /// The fault and the values allowed.
        message: String,
    },
    /// A network file is damaged or does not fit this version.
    #[error("model {model}: {message}")]
    Model {
        /// Name of the network.
        model: String,
        /// The fault.
        message: String,
    },
    /// A saved session cannot be read.
    #[error("{0}")]
    State(StateFault),
    /// The work would need more memory than [`Settings`](crate::session::Settings) allow.
    #[error("about {} MiB of memory are needed, but only {} MiB are allowed", needed >> 20, limit >> 20)]
    MemoryLimit {
        /// Estimated need of the whole session, bytes.
        needed: u64,
        /// Memory allowed, bytes.
        limit: u64,
    },
    /// No photograph has been accepted yet, so there are no maps.
    #[error("no photograph has been accepted yet")]
    NoMaps,
    /// The work was cancelled by the caller.
    #[error("cancelled")]
    Cancelled,
    /// A fault inside the library. Every later call of the same session returns it again.
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

/// Fault of a saved session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StateFault {
    /// The data are no saved session.
    #[error("not a saved session")]
    Foreign,
    /// The end is missing.
    #[error("the saved session is truncated")]
    Truncated,
    /// The data were changed after they were written.
    #[error("the saved session is damaged: {0}")]
    Damaged(String),
    /// A newer version of the library wrote it.
    #[error(
        "the saved session has format version {found}; this library reads versions up to {known}"
    )]
    Newer {
        /// Format version of the data.
        found: u16,
        /// Latest format version that this library reads.
        known: u16,
    },
}

/// The reason why a photograph was not used. The session is unchanged.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Rejection {
    /// The size of the photograph differs from that of the camera.
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
    /// The photograph shows no target.
    #[error("no board found: show the whole checkerboard ring")]
    BoardNotFound,
    /// Too little of the target is visible for a reliable pose.
    #[error(
        "only {found} of {expected} board corners were found, {needed} are needed: show more of the board; if all of it is there, is it cut, creased or another one?"
    )]
    TooFewCorners {
        /// Corners found.
        found: u32,
        /// Corners the target has.
        expected: u32,
        /// Corners needed.
        needed: u32,
    },
    /// The corners fit several places on the board equally well.
    #[error(
        "{found} board corners fit the board in more than one place: show more of its outline and hole"
    )]
    PlacementAmbiguous {
        /// Corners found.
        found: u32,
    },
    /// The printed board differs from the description.
    #[error("this is not the board described: {0}")]
    BoardDiffers(BoardDifference),
    /// The corners do not fit the given camera, but one with another focal length.
    #[error(
        "the photo was taken with {focal_ratio:.2} times the focal length of the camera: another lens or zoom, or cropped, or is the board cut?"
    )]
    OtherCamera {
        /// Fitted focal length over that of the camera.
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
        /// Direction of the blur in the photograph, degrees clockwise from its x axis, 0 to 180.
        /// `None`: equal in all directions.
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
    /// The view is too oblique.
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
    /// The flash is missing: the white squares show no fall-off, or the light is behind the sample.
    #[error(
        "the flash does not light the board, or other light outshines it: switch it on, and other lights off"
    )]
    LightNotVisible,
    /// Bright and dark stripes run along the rows or columns of the photograph.
    #[error(
        "bright and dark stripes (of {:.0} %) run across the photo: the light flickers; use the flash instead of the torch, or a longer exposure",
        amplitude * 100.0
    )]
    Flickers {
        /// Relative amplitude of the stripes.
        amplitude: f32,
    },
    /// The black squares are not as dark as printed: the contrast was changed.
    #[error(
        "the black squares are {black:.3} of white, not {usual:.3} as printed: the contrast was changed; use the photo as the camera wrote it, not an edited one"
    )]
    Edited {
        /// Black over white in the file.
        black: f32,
        /// The same ratio in most photographs, or of the board described.
        usual: f32,
    },
    /// The photograph contains values that are not finite.
    #[error("the photo contains values that are not finite")]
    NotFinite,
}

/// Difference between a printed board and its description.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardDifference {
    /// Squares are missing along the outline: the description has too many rows or columns.
    #[error(
        "its {side} {} of squares is not printed where {rows} rows and {cols} columns are described: count them anew, with the hole",
        if matches!(side, Side::Top | Side::Bottom) { "row" } else { "column" }
    )]
    SquaresMissing {
        /// Side of the missing squares.
        side: Side,
        /// Rows described.
        rows: u32,
        /// Columns described.
        cols: u32,
    },
    /// The markers belong to other squares: `top_left` or the order of the markers differs.
    #[error(
        "{count} markers name other squares, or stand upside down: check `top_left`, and the dictionary (older OpenCV begins boards of an even number of rows with a white square)"
    )]
    MarkersElsewhere {
        /// Markers that contradict the description.
        count: u32,
    },
    /// The markers belong to another dictionary.
    #[error("its {count} markers are none of the dictionary described")]
    MarkersUnknown {
        /// Markers read.
        count: u32,
    },
    /// White and black squares are exchanged, and their markers too.
    #[error(
        "white and black squares are exchanged (as OpenCV before 4.6 prints boards with markers): it was used as it is; state `top_left`"
    )]
    ColoursExchanged,
    /// The white squares hold markers, but the description has none.
    #[error(
        "its white squares hold markers: it was used by its squares alone; describe it as a `charuco-ring`"
    )]
    MarkersNotDescribed,
    /// The markers belong to a known dictionary, with another size or first number.
    #[error(
        "its markers are of {inner} x {inner} modules and begin with number {first}, not as described: it was used by its squares alone"
    )]
    MarkersShifted {
        /// Id of the first marker.
        first: i32,
        /// Modules along a marker's side without the border.
        inner: u32,
    },
    /// The markers are mirrored.
    #[error("its markers are mirrored: the photo, or the print, was flipped")]
    MarkersMirrored {
        /// Markers that are valid after mirroring.
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
