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
//! Two lobes are optional ([`lobe`](crate::svbrdf::lobe)), with the formulas of glTF's
//! `KHR_materials_anisotropy` and `KHR_materials_clearcoat`. **Anisotropy** stretches the components (t, b)
//! of the half vector along tangent and bitangent: NoH² (a² - 1) + 1 becomes NoH² a² + t² / r + r b² for a
//! direction along the tangent, where r is the ratio of the two alphas and a² their product. A **coat** of
//! weight w adds its own w D G F / (4 NoL NoV) with F0 = .04, and transmits 1 - w F of all other reflection.
//!
//! [`reflect`] computes in `f64`. It is the reference for the eight-lane version of the kernels.

mod directions;
mod lanes;
mod microfacets;
mod optional;
mod scalar;

pub(crate) use directions::{Directions, TexelView};
pub(crate) use lanes::{ByLight, Lobes, Material};
pub use scalar::{COAT_F0, FRESNEL, MIN_COSINE, Reflection, reflect};
