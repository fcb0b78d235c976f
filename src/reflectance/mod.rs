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
//! [`reflect`] is plain `f64`: the reference for the eight-lane version that `render` and
//! `refinement` use.

mod lanes;
mod scalar;

pub(crate) use lanes::{ByLight, Directions, Lobes, Material, TexelView};
pub use scalar::{FRESNEL, MIN_COSINE, Reflection, reflect};
