//! Remarks about a photograph's file.

use std::fmt;

/// A remark about a photograph's file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Remark {
    /// The stated colours are unusable, for the reason given as a clause; sRGB was used.
    ProfileUnusable(String),
    /// It has a gain map (Ultra HDR), which is ignored.
    GainMap,
    /// Its orientation tag mirrors it, as front cameras do. The picture is wrong if the stored
    /// pixels are not mirrored.
    Mirrored,
    /// Its end marker is missing; the picture is complete.
    EndMissing,
    /// It is gray, so the maps will be gray.
    Gray,
}

impl Remark {
    /// Stable name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::ProfileUnusable(_) => "profile_unusable",
            Self::GainMap => "gain_map",
            Self::Mirrored => "mirrored",
            Self::EndMissing => "end_missing",
            Self::Gray => "gray",
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ProfileUnusable(what) => write!(f, "{what}; taken as sRGB"),
            Self::GainMap => f.write_str(
                "it has a gain map (Ultra HDR); its base picture is used, which the camera has tone-mapped",
            ),
            Self::Mirrored => f.write_str(
                "its orientation tag mirrors it; if the sample comes out mirrored, the tag is wrong",
            ),
            Self::EndMissing => f.write_str(
                "its end marker is missing; the picture is whole: it may have been copied before it was complete",
            ),
            Self::Gray => f.write_str(
                "it is a gray picture, so the maps will be gray: use the colour photo if there is one",
            ),
        }
    }
}
