//! What is to be said about a photograph's file.

use std::fmt;

/// What is to be said about a photograph's file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Remark {
    /// What it says of its colours cannot be used: a clause that says what and why. It was taken as
    /// sRGB.
    ProfileUnusable(String),
    /// It has a gain map (Ultra HDR), which is left out.
    GainMap,
    /// Its orientation tag mirrors it, as front cameras do: what it shows is real only if what was
    /// stored is not.
    Mirrored,
    /// Its end marker is missing, and nothing else.
    EndMissing,
    /// It is gray, and so are the maps.
    Gray,
}

impl Remark {
    /// Its name for programs.
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
