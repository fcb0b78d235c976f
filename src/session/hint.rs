//! Hints about accepted photographs.

use std::fmt;

use crate::BoardDifference;
use crate::estimate::Part;

/// A hint about an accepted photograph. Each names an observation with its figure, and a remedy.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Hint {
    /// An earlier photograph has nearly the same view.
    #[error("photo {} has nearly the same view: move the camera", index + 1)]
    NothingNew {
        /// Its number among the accepted ones, from 0.
        index: usize,
    },
    /// The board's grays do not have the ratios of linear values of a print.
    #[error("the pixel values are not linear ({what} is {ratio:.3} of white): {}", remedy(*undone))]
    NotLinear {
        /// The squares or patch concerned: `black` or `gray`.
        what: &'static str,
        /// Its value in the file, relative to white.
        ratio: f32,
        /// Whether a tone curve that explains it was estimated and inverted. The photograph is then nearly as good as a
        /// linear one.
        undone: bool,
    },
    /// The board's brightness does not match the stated exposure.
    #[error(
        "its board is {ratio:.2} times as bright as its exposure states, beside most of the other photos: the \
         brightness was taken from the board; keep exposure and flash the same, or state the exposure"
    )]
    Exposure {
        /// Measured over stated brightness.
        ratio: f32,
    },
    /// The pixels were turned by 180 degrees after the photograph was taken.
    #[error(
        "it was turned by 180 degrees in its pixels, without a tag: the flash lies on its other side; that was \
         undone, but use the photo as the camera wrote it"
    )]
    Turned,
    /// The photograph was cropped off centre.
    #[error(
        "it was cropped: its optical axis lies {px:.0} px from that of the other photos; use the original"
    )]
    Cropped {
        /// Distance of the axes, px.
        px: f32,
    },
    /// A dirty lens scatters light over the photograph.
    #[error("a veil of {:.0} % lies over the photo: wipe the lens; it was taken off as far as it is known", share * 100.0)]
    Veiled {
        /// Share of the light that is scattered.
        share: f32,
    },
    /// Bright and dark stripes run along its rows or columns.
    #[error(
        "bright and dark stripes (of {:.0} %) run across the photo: the light flickers; use the flash instead of \
         the torch, or a longer exposure",
        amplitude * 100.0
    )]
    Flickers {
        /// Relative amplitude of the stripes.
        amplitude: f32,
    },
    /// Black differs from the print: the contrast was changed.
    #[error(
        "the black squares are {black:.3} of white, not {usual:.3} as printed: the contrast was changed; use the photo \
         as the camera wrote it, not an edited one"
    )]
    Edited {
        /// Black over white in the file.
        black: f32,
        /// The usual ratio: that of most photographs, or of the described board.
        usual: f32,
    },
    /// The camera has applied local tone mapping.
    #[error(
        "places with bright surroundings are {} (exponent {exponent:.2}): the camera has tone-mapped the photo \
         place by place; turn HDR and night modes off",
        if *exponent < 0.0 { "brightened" } else { "darkened" }
    )]
    LocalTone {
        /// Exponent of the surroundings' brightness.
        exponent: f32,
    },
    /// The board looks lit by a light that does not move with the camera.
    #[error(
        "the light does not move with the camera (a light that stands still explains the board {times:.1} times as \
         well as a flash): is the flash on?"
    )]
    LightStays {
        /// Ratio of the remaining deviations: with a flash over with a fixed light.
        times: f32,
    },
    /// A part of the board is brighter than the flash explains in every photograph.
    #[error(
        "{:.0} % of the board's white squares ({}) are {ratio:.2} times as bright as the flash explains, in every \
         photo: another light lies on board and sample; draw the curtains, or switch the lamp off",
        share * 100.0,
        place(*centre)
    )]
    OtherLight {
        /// Share of the white squares.
        share: f32,
        /// Measured over expected brightness.
        ratio: f32,
        /// Their middle: part of the board's width from the left, and of its height from the top.
        centre: [f32; 2],
    },
    /// The print reflects the flash.
    #[error(
        "glare on the board: {:.0} % of its squares near the mirrored flash glare; print the board on matt paper",
        share * 100.0
    )]
    GlossyBoard {
        /// Share of the squares there.
        share: f32,
    },
    /// Corners are displaced on the board, by the same amount in all photographs.
    #[error(
        "the corners do not fit a flat board of the layout described: {:.0} % of them lie {mm:.1} mm off in every \
         photo; is the board cut, taped or creased? Print a new one, and lay it flat",
        share * 100.0
    )]
    BoardBent {
        /// Displacement of these corners, mm.
        mm: f32,
        /// Share of the corners.
        share: f32,
    },
    /// The photographs fall into two groups that contradict each other.
    #[error(
        "the photos fall into two groups that contradict each other, {group} and the others: were sample or board \
         moved, turned, or exchanged in between? Fit each group alone"
    )]
    TwoGroups {
        /// One of the groups.
        group: Group,
    },
    /// The photograph contradicts the others.
    #[error(
        "it contradicts the other photos (residual {residual:.3}, usually {usual:.3}): is it mirrored, of another \
         sample, with a hand, a shadow or other light in it, or tone-mapped? Fit again without it"
    )]
    Contradicts {
        /// Its relative residual, and the usual one of a photograph.
        residual: f32,
        /// See `residual`.
        usual: f32,
    },
    /// A region of the photograph contradicts the others and is masked.
    #[error(
        "a part of it ({:.0} % of the sample, {}) is {:.2} times as bright as the other photos explain: {} That \
         part is left out",
        part.share * 100.0,
        place(part.centre),
        part.ratio,
        cause(*height_unknown)
    )]
    PartContradicts {
        /// The region.
        part: Part,
        /// Whether the unknown height of the sample may be the cause.
        height_unknown: bool,
    },
    /// The material is not of the kind that the maps can describe.
    #[error(
        "photos are {from:.2} times as bright as the maps explain where the sample is seen {from_deg:.0} degrees off \
         its normal, and {to:.2} times at {to_deg:.0}, whichever photo it is: the material is not of the kind that \
         the model describes (velvet, holographic, retro-reflective?)"
    )]
    OtherMaterial {
        /// Measured over explained brightness in the views nearest to the normal, and their angle.
        from: f32,
        /// See `from`.
        from_deg: f32,
        /// The same in those farthest from it.
        to: f32,
        /// See `to`.
        to_deg: f32,
    },
    /// Highlights are saturated in all photographs that see them.
    #[error(
        "the highlights are saturated ({:.1} % of the sample has no photo that shows its peak): specular albedo and \
         roughness are not to be trusted there; add a photo two or three stops darker",
        share * 100.0
    )]
    Saturated {
        /// Share of the sample.
        share: f32,
    },
    /// The print differs from the described board and was used as it is.
    #[error("this is not the board described: {0}")]
    BoardDiffers(BoardDifference),
}

/// Photographs, by their numbers among the accepted ones: at most 64.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Group(u64);

impl Group {
    /// The photographs of these numbers, from 0.
    pub fn of(members: impl IntoIterator<Item = usize>) -> Self {
        Self(members.into_iter().filter(|i| *i < 64).fold(0, |bits, i| bits | 1 << i))
    }

    /// Whether a photograph belongs to it.
    pub fn contains(&self, index: usize) -> bool {
        index < 64 && self.0 >> index & 1 == 1
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> =
            (0..64).filter(|i| self.contains(*i)).map(|i| (i + 1).to_string()).collect();
        match numbers.as_slice() {
            [] => f.write_str("none"),
            [one] => write!(f, "photo {one}"),
            [first @ .., last] => write!(f, "photos {} and {last}", first.join(", ")),
        }
    }
}

fn remedy(undone: bool) -> &'static str {
    if undone {
        "the camera's tone curve was estimated and undone"
    } else {
        "no tone curve could be found that explains it; turn tone mapping off, check `encoding`"
    }
}

fn cause(height_unknown: bool) -> &'static str {
    if height_unknown {
        "does the sample stick out of the board's plane? State sample.elevation_mm."
    } else {
        "sun, a shadow, a hand or glare?"
    }
}

/// A place on the sample or the board in words.
fn place([right, down]: [f32; 2]) -> &'static str {
    let third = |v: f32| usize::from(v >= 0.33) + usize::from(v > 0.67);
    let words = [
        ["upper left", "upper", "upper right"],
        ["left", "middle", "right"],
        ["lower left", "lower", "lower right"],
    ];
    words[third(down)][third(right)]
}

impl Hint {
    /// Names of all kinds, see [`Hint::code`].
    pub const CODES: [&'static str; 19] = [
        "nothing_new",
        "not_linear",
        "exposure_differs",
        "turned",
        "cropped",
        "veiled",
        "flickers",
        "edited",
        "local_tone",
        "light_stays",
        "other_light",
        "glossy_board",
        "board_bent",
        "two_groups",
        "contradicts_others",
        "part_contradicts_others",
        "other_material",
        "saturated",
        "board_differs",
    ];

    /// Stable name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::NothingNew { .. } => "nothing_new",
            Self::NotLinear { .. } => "not_linear",
            Self::Exposure { .. } => "exposure_differs",
            Self::Turned => "turned",
            Self::Cropped { .. } => "cropped",
            Self::Veiled { .. } => "veiled",
            Self::Flickers { .. } => "flickers",
            Self::Edited { .. } => "edited",
            Self::LocalTone { .. } => "local_tone",
            Self::LightStays { .. } => "light_stays",
            Self::OtherLight { .. } => "other_light",
            Self::GlossyBoard { .. } => "glossy_board",
            Self::BoardBent { .. } => "board_bent",
            Self::TwoGroups { .. } => "two_groups",
            Self::Contradicts { .. } => "contradicts_others",
            Self::PartContradicts { .. } => "part_contradicts_others",
            Self::OtherMaterial { .. } => "other_material",
            Self::Saturated { .. } => "saturated",
            Self::BoardDiffers(_) => "board_differs",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_and_places_are_named() {
        assert_eq!(Group::of([2]).to_string(), "photo 3");
        assert_eq!(Group::of([0, 4, 1]).to_string(), "photos 1, 2 and 5");
        let part = Part { share: 0.124, centre: [0.2, 0.5], ratio: 0.713, highlight: 0.1 };
        let said = |height_unknown| Hint::PartContradicts { part, height_unknown }.to_string();
        let [sun, height] = [false, true].map(said);
        assert!(sun.contains("(12 % of the sample, left) is 0.71 times"), "{sun}");
        assert!(sun.contains("sun, a shadow") && !height.contains("sun"), "{height}");
        assert!(height.contains("sample.elevation_mm"), "{height}");
    }
}
