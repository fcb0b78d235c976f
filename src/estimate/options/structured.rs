//! Options of the structured prior.

use serde::{Deserialize, Serialize};

/// Options of the structured prior: material classes with small
/// deviations of texels, fitted together with exposure and place of the flash.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StructuredOptions {
    /// The prior of too few photographs to leave one out, round the latent estimate, where exposure and flash
    /// are not as given.
    pub few: Widths,
    /// Part of the estimate's own deviation from its class that the mean of that prior keeps. Tuned.
    pub own_share: f64,
    /// Cost with the light as given, relative to that with exposure and flash free, from which on
    /// photographs contradict what was given: of few; and of more, ambient light and with many
    /// directions free in the former, as the other phases correct them. Tuned.
    pub contradiction: [f64; 2],
    /// Mean residual of averaged texels with the light as given, at least: of less no fault of the
    /// light can be seen. Tuned.
    pub visible: f64,
    /// Expected slopes of averaged texels of more photographs, where that is asked. Tuned.
    pub averaged_slope: f64,
    /// Priors that are tried, from one class of a flat sheet to wide ones; the mean of those that predict well is
    /// used.
    pub candidates: Vec<Widths>,
    /// The prior whose residuals show the noise of photographs without a board: relief as it may be,
    /// gloss of classes. Tuned.
    pub noise_widths: Widths,
    /// Scale of log residuals, noise and errors of the model together: highlights' tails are 10 to 15 %
    /// off, alike over a sample.
    pub noise: f64,
    /// Expected logarithm of a photograph's gain.
    pub gain_sigma: f64,
    /// Expected exponent of exposure over distance.
    pub exponent_sigma: f64,
    /// Expected offset of the flash, mm, each coordinate.
    pub offset_sigma_mm: f64,
    /// Texels that count as independent, to weigh those sigmas and the classes' against: errors of the
    /// model are alike all over a sample. Tuned.
    pub independent_texels: f64,
    /// Expected deviations of a class from the mean: root of F0, roughness.
    pub class_sigma: [f64; 2],
    /// Expected root of F0 and roughness of a class.
    pub class_mean: [f64; 2],
}

impl Default for StructuredOptions {
    fn default() -> Self {
        let narrow =
            Widths { classes: 1, slope: 0.01, diffuse: 0.3, specular: 0.002, roughness: 0.001 };
        let classes = Widths { classes: 8, specular: 0.02, roughness: 0.01, ..narrow };
        Self {
            few: Widths { diffuse: 0.1, ..classes },
            own_share: 0.5,
            contradiction: [1.2, 1.3],
            visible: 0.015,
            averaged_slope: 0.03,
            candidates: vec![
                narrow,
                classes,
                Widths { slope: 0.1, ..classes },
                Widths { slope: 0.3, ..classes },
                Widths { slope: 0.1, specular: 0.1, roughness: 0.12, ..classes },
            ],
            noise_widths: Widths { slope: 0.3, ..classes },
            noise: 0.3,
            gain_sigma: 0.05,
            exponent_sigma: 2.0,
            offset_sigma_mm: 30.0,
            independent_texels: 14.0,
            class_sigma: [0.3, 0.4],
            class_mean: [0.2, 0.5],
        }
    }
}

/// How far a texel may be from its prior mean: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Widths {
    /// Classes of gloss.
    pub classes: usize,
    /// Of slopes.
    pub slope: f64,
    /// Of roots of diffuse albedo.
    pub diffuse: f64,
    /// Of roots of specular albedo within a class.
    pub specular: f64,
    /// Of roughness within a class.
    pub roughness: f64,
}
