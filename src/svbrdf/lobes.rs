//! Optional lobes of maps: anisotropy, a coat, sheen.

use super::{MIN_ROUGHNESS, Svbrdf};
use crate::{Error, Result};

/// Number of parameters of the optional lobes of a texel.
pub const LOBES: usize = 8;

/// Index of each parameter plane of the optional lobes, [`Svbrdf::lobes`].
pub mod lobe {
    /// Anisotropy of the specular lobe: `ln(alpha along / alpha across)` times the cosine of twice
    /// the angle of the direction of the larger alpha, counter-clockwise from X. `roughness²` is
    /// the geometric mean of both alphas.
    pub const ANISOTROPY_X: usize = 0;
    /// The same times the sine.
    pub const ANISOTROPY_Y: usize = 1;
    /// Weight of a coat, 0 to 1: a dielectric of F0 .04 above the other lobes.
    pub const COAT: usize = 2;
    /// Roughness of the coat.
    pub const COAT_ROUGHNESS: usize = 3;
    /// Colour of the sheen, red, linear; green and blue follow. This and the later planes exist only for
    /// materials with sheen.
    pub const SHEEN: usize = 4;
    /// Roughness of the sheen, `alpha = roughness²`.
    pub const SHEEN_ROUGHNESS: usize = 7;
}

/// Parameters of absent lobes.
pub const NO_LOBES: [f64; LOBES] = [0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.5];

/// Smallest roughness of sheen that is rendered.
pub const MIN_SHEEN_ROUGHNESS: f32 = 0.07;

/// Physical range of each parameter of the optional lobes; the ratio of alphas is at most 20.
pub const LOBE_RANGE: [(f32, f32); LOBES] = [
    (-3.0, 3.0),
    (-3.0, 3.0),
    (0.0, 1.0),
    (MIN_ROUGHNESS, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (0.0, 1.0),
    (MIN_SHEEN_ROUGHNESS, 1.0),
];

impl Svbrdf {
    /// The planes of the optional lobes in the order of [`lobe`]: none, the four of anisotropy and coat, or
    /// all eight for a material with sheen.
    pub fn lobes(&self) -> &[f32] {
        &self.lobes
    }

    /// One plane of the optional lobes, see [`lobe`]; `None` if the material does not have it.
    pub fn lobe(&self, lobe: usize) -> Option<&[f32]> {
        self.lobes.chunks_exact(self.texels()).nth(lobe)
    }

    /// The planes [`lobe::ANISOTROPY_X`] and [`lobe::ANISOTROPY_Y`]; `None` if all texels are isotropic.
    pub fn anisotropy(&self) -> Option<[&[f32]; 2]> {
        let planes = [self.lobe(lobe::ANISOTROPY_X)?, self.lobe(lobe::ANISOTROPY_Y)?];
        planes.iter().any(|plane| plane.iter().any(|v| *v != 0.0)).then_some(planes)
    }

    /// The planes [`lobe::COAT`] and [`lobe::COAT_ROUGHNESS`]; `None` without a coat on any texel.
    pub fn coat(&self) -> Option<[&[f32]; 2]> {
        let planes = [self.lobe(lobe::COAT)?, self.lobe(lobe::COAT_ROUGHNESS)?];
        planes[0].iter().any(|v| *v > 0.0).then_some(planes)
    }

    /// Red, green, blue and roughness of the sheen, from [`lobe::SHEEN`] on; `None` without sheen on any
    /// texel.
    pub fn sheen(&self) -> Option<[&[f32]; 4]> {
        let [r, g, b] =
            [self.lobe(lobe::SHEEN)?, self.lobe(lobe::SHEEN + 1)?, self.lobe(lobe::SHEEN + 2)?];
        let planes = [r, g, b, self.lobe(lobe::SHEEN_ROUGHNESS)?];
        planes[..3].iter().any(|plane| plane.iter().any(|v| *v > 0.0)).then_some(planes)
    }

    /// Optional lobes of a texel in the order of [`lobe`]: [`NO_LOBES`] where there are none.
    pub(crate) fn lobes_at(&self, texel: usize) -> [f64; LOBES] {
        let value = |i| self.lobe(i).map_or(NO_LOBES[i], |plane| f64::from(plane[texel]));
        std::array::from_fn(value)
    }

    /// Sets the planes of optional lobes in the order of [`lobe`]: all, or the four of anisotropy and coat
    /// for a material without sheen. An empty vector removes them.
    ///
    /// # Errors
    /// If `planes` holds neither `4 * width * height` nor `8 * width * height` values.
    pub fn set_lobes(&mut self, planes: Vec<f32>) -> Result<()> {
        let allowed = [0, lobe::SHEEN, LOBES].map(|count| count * self.texels());
        if !allowed.contains(&planes.len()) {
            let [_, few, all] = allowed;
            let message = format!("{} values given, {few} or {all} expected", planes.len());
            return Err(Error::argument("lobes", message));
        }
        self.lobes = planes;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_of_sheen_exist_only_for_materials_with_sheen() {
        let mut maps = Svbrdf::new(3, 2);
        assert!(maps.sheen().is_none() && maps.set_lobes(vec![0.5; 5 * 6]).is_err());
        maps.set_lobes(vec![0.5; 4 * 6]).unwrap();
        assert_eq!(maps.lobes().len(), 4 * 6);
        assert!(maps.coat().is_some() && maps.sheen().is_none());
        assert_eq!(maps.lobes_at(1)[lobe::SHEEN..], NO_LOBES[lobe::SHEEN..]);
        let mut planes = vec![0.0; LOBES * 6];
        maps.set_lobes(planes.clone()).unwrap();
        assert!(maps.sheen().is_none(), "black sheen");
        planes[(lobe::SHEEN + 1) * 6 + 4] = 0.3;
        maps.set_lobes(planes).unwrap();
        maps.clamp();
        let [_, green, _, roughness] = maps.sheen().unwrap();
        assert_eq!((green[4], roughness[4]), (0.3, MIN_SHEEN_ROUGHNESS));
    }
}
