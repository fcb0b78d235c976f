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
//! This is the renderer of the paper's reference code, so that maps mean the same in both. Where
//! the exact Smith term of GGX divides by `x + sqrt(a² + (1 - a²) x²)`, Schlick's form is a few
//! percent off at grazing angles, is as reciprocal, and needs no root. There is no factor (1 - F)
//! on the diffuse part. All cosines are held at [`MIN_COSINE`] or above, with derivative zero
//! below it; roughness at [`MIN_ROUGHNESS`](crate::svbrdf::MIN_ROUGHNESS) or above, likewise.
//!
//! Two lobes are optional ([`lobe`](crate::svbrdf::lobe)). **Anisotropy** stretches the half vector's part across
//! the normal, (t, b) along tangent and bitangent: NoH² (a² - 1) + 1 becomes NoH² a² + t² / r + r b² for a
//! direction along the tangent and the ratio r of the two alphas, a² being their product. A **coat** of weight w
//! adds w D G F / (4 NoL NoV) of its own with F0 = .04, and lets 1 - w F of everything below it through:
//! the formulas of glTF's `KHR_materials_anisotropy` and `KHR_materials_clearcoat`.
//!
//! [`reflect`] is plain `f64`: the reference for the eight-lane version that `render` and
//! `refinement` use.

mod directions;
mod lanes;
mod microfacets;
mod optional;
mod scalar;

pub(crate) use directions::{Directions, TexelView};
pub(crate) use lanes::{ByLight, Lobes, Material};
pub use scalar::{COAT_F0, FRESNEL, MIN_COSINE, Reflection, reflect};
