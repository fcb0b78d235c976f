//! Cook-Torrance reflection of one texel: value and partial derivatives.
//!
//! With unit vectors n (normal), l (to the light), v (to the camera), h = (l + v) / |l + v|:
//!
//! ```text
//! f  = kd / pi + D F G / (4 NoL NoV)
//! D  = a² / (pi (NoH² (a² - 1) + 1)²)         a = roughness²          (GGX)
//! G  = g(NoL) g(NoV),  g(x) = x / (x (1 - k) + k),  k = roughness² / 2  (Smith, Schlick's form)
//! F  = ks + (1 - ks) 2^((-5.55473 VoH - 6.98316) VoH)                 (Schlick)
//! ```
//!
//! This is the renderer of the paper's reference code, so maps have the same meaning in both. The
//! exact Smith term of GGX divides by `x + sqrt(a² + (1 - a²) x²)`. Schlick's form differs by some
//! per cent at grazing angles, is also reciprocal, and needs no root. The diffuse part has no
//! factor (1 - F). Cosines are limited to at least [`MIN_COSINE`] and roughness to at least
//! [`MIN_ROUGHNESS`](crate::svbrdf::MIN_ROUGHNESS), with zero derivatives below.
//!
//! Three lobes are optional ([`lobe`](crate::svbrdf::lobe)), with the formulas of glTF's
//! `KHR_materials_anisotropy`, `KHR_materials_sheen` and `KHR_materials_clearcoat`. **Anisotropy** stretches the components (t, b)
//! of the half vector along tangent and bitangent: NoH² (a² - 1) + 1 becomes NoH² a² + t² / r + r b² for a
//! direction along the tangent, where r is the ratio of the two alphas and a² their product. A **coat** of
//! weight w adds its own w D G F / (4 NoL NoV) with F0 = .04, and transmits 1 - w F of all other reflection.
//! **Sheen** of colour s lies between base and coat:
//!
//! ```text
//! s D V + base (1 - max(s) E(min(NoL, NoV)))
//! D  = (2 + 1/a) sin(NoH)^(1/a) / (2 pi)          a = roughness of the sheen, squared   (Charlie)
//! V  = 1 / (4 (NoL + NoV - NoL NoV))                          (Neubelt, Ashikhmin)
//! E  = directional albedo of white sheen: the integral of D V NoL, fitted        (charlie.rs)
//! ```
//!
//! The extension allows this V and Charlie's own; this one is that of Filament and three.js, which also limit
//! sin² to at least 1/128. E falls with the cosine, so the smaller cosine stands for the extension's larger
//! dimming of both directions. three.js's fit of E differs by up to 0.16 (cosine .35, roughness .35).
//!
//! [`reflect`] computes in `f64`. It is the reference for the eight-lane version of the kernels.

mod charlie;
mod directions;
mod lanes;
mod microfacets;
mod optional;
mod scalar;
mod sheen;

pub use charlie::{SHEEN_ALBEDO, SHEEN_MAX_ALBEDO, SHEEN_MIN_SIN2, sheen_albedo};
pub(crate) use directions::{Directions, TexelView};
pub(crate) use lanes::{ByLight, Lobes, Material};
pub(crate) use optional::LobeParameters;
pub use scalar::{COAT_F0, FRESNEL, MIN_COSINE, Reflection, reflect};
