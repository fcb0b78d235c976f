//! Normal equations of eight texels, summed over the photographs.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::eight::{Column, Eight, in_eights, loaded};
use super::parameters::Derivative;
use super::problem::Problem;
use super::sample::Photograph;
use super::state::{EightLobes, State, in_lanes};
use crate::estimate::coordinates::from_coordinates;
use crate::estimate::posterior::{
    LinearResidual, Measurement, NormalEquations, Residual, Shading, coordinates_of,
};
use crate::loss::EPSILON;
use crate::reflectance::{ByLight, Directions, Lobes, Material, TexelView};
use crate::simd::Lanes;
use crate::svbrdf::CHANNELS;

/// A photograph's corrected view, and its derivatives by the parameters.
pub(super) struct Linear<'a> {
    photograph: &'a Photograph,
    view: TexelView,
    derivatives: Vec<(usize, Derivative)>,
    /// Whether a derivative is by the view.
    by_view: bool,
}

/// The reduced equations of groups, then parameters. Lower triangle.
#[derive(Clone)]
pub(super) struct Reduced {
    pub matrix: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

impl Reduced {
    pub fn zeros(size: usize) -> Self {
        Self { matrix: DMatrix::zeros(size, size), gradient: DVector::zeros(size) }
    }
}

/// At most eight texels of a fit.
pub(super) struct Block<'a> {
    pub problem: &'a Problem,
    pub texels: Range<usize>,
    pub coordinates: Column,
    pub lobes: Option<EightLobes>,
    /// The texels' shares of each group.
    pub shares: Vec<Eight>,
    pub linear: &'a [Linear<'a>],
}

/// The photographs' equations of a block.
pub(super) struct Sums<V> {
    pub texels: NormalEquations<V>,
    /// Products of each parameter with the texels' coordinates.
    pub mixed: Vec<[V; CHANNELS]>,
}

impl Problem {
    pub(super) fn linear(&self, state: &State) -> Vec<Linear<'_>> {
        let photographs = self.photographs().enumerate();
        let linear = photographs.map(|(i, photograph)| {
            let of = |(a, shared): (usize, &super::Shared)| {
                Some((a, shared.parameter.derivative(&photograph.view, i, state)?))
            };
            let derivatives: Vec<_> = self.shared.iter().enumerate().filter_map(of).collect();
            Linear {
                photograph,
                view: TexelView::new(&state.correction.apply(&photograph.view, i), 1, 1),
                by_view: derivatives.iter().any(|(_, d)| matches!(d, Derivative::OfView(_))),
                derivatives,
            }
        });
        linear.collect()
    }

    pub(super) fn block<'a>(
        &'a self,
        texels: Range<usize>,
        state: &State,
        linear: &'a [Linear<'a>],
    ) -> Block<'a> {
        Block {
            problem: self,
            coordinates: in_eights(texels.clone().map(|t| self.coordinates(t, state))),
            lobes: self.eight_lobes(texels.clone(), state),
            shares: self.eight_shares(texels.clone()),
            texels,
            linear,
        }
    }
}

// Loops, because closures may stay calls without the kernel's target features.
impl<V: Lanes> Sums<V> {
    /// The sums of a block. Products of parameters are added to the reduced equations.
    #[inline(always)]
    pub fn new(block: &Block, reduced: &mut Reduced) -> Self {
        let Block { problem, texels, coordinates, lobes, shares, linear } = block;
        let Problem { sample, noise, shared, .. } = problem;
        let n = sample.texels();
        let [x, y] = sample.eight_places::<V>(texels.clone());
        let coordinates: [V; CHANNELS] = loaded(coordinates);
        let material = Material::new(&from_coordinates(&coordinates), in_lanes(lobes));
        let mut equations = NormalEquations::none();
        let mut parameters = Parameters::new(shared.len(), linear);
        for linear in *linear {
            let (view, photograph) = (&linear.view, linear.photograph);
            let directions = Directions::at(view, x, y);
            let shading = Shading::new(&material, &directions);
            let weight = V::load(&photograph.weight[texels.clone()], 0.0);
            if linear.by_view {
                let by_light = shading.lobes.by_light(&material, &directions);
                parameters.across = across_light(&by_light, &directions, view, x, y);
            }
            for c in 0..3 {
                let plane = &photograph.radiance[c * n..(c + 1) * n];
                let radiance = V::load(&plane[texels.clone()], 0.0);
                let seen = Measurement { noise: *noise, radiance, weight };
                let line = shading.line(&material, view, c, &coordinates, &seen);
                let Residual { value, square_weight, .. } = line.residual;
                equations.add(c, line.by, value, square_weight);
                let lobes = &shading.lobes;
                parameters.find(linear, c, &material, &directions, lobes, &line, shares);
                parameters.add(linear, c, &line);
            }
            parameters.move_to(linear, reduced);
        }
        Self { texels: equations, mixed: parameters.mixed }
    }
}

/// The parameters' part of the equations of eight texels.
struct Parameters<V> {
    /// Products of each parameter with the coordinates, over all photographs.
    mixed: Vec<[V; CHANNELS]>,
    /// Derivatives of ln(rendered + 0.01) by a photograph's parameters in one colour.
    by: Vec<V>,
    /// Products of these derivatives in all colours (lower triangle), and their products with residuals.
    products: Vec<V>,
    gradients: Vec<V>,
    /// See [`across_light`].
    across: [[V; 3]; ACROSS],
}

/// Vectors of [`across_light`] for all colours, then one for each colour.
const ACROSS: usize = 7;
const SHARED_ACROSS: usize = 4;

impl<V: Lanes> Parameters<V> {
    #[inline(always)]
    fn new(count: usize, linear: &[Linear]) -> Self {
        let zero = V::splat(0.0);
        let mut most = 0;
        for linear in linear {
            most = most.max(linear.derivatives.len());
        }
        Self {
            mixed: vec![[zero; CHANNELS]; count],
            by: vec![zero; most],
            products: vec![zero; most * (most + 1) / 2],
            gradients: vec![zero; most],
            across: [[zero; 3]; ACROSS],
        }
    }

    /// Computes the derivatives in a colour.
    #[inline(always)]
    fn find(
        &mut self,
        linear: &Linear,
        c: usize,
        material: &Material<V>,
        directions: &Directions<V>,
        lobes: &Lobes<V>,
        line: &LinearResidual<V>,
        shares: &[Eight],
    ) {
        let LinearResidual { brdf, fresnel, irradiance, residual, .. } = line;
        let (diffuse, specular) = (material.diffuse[c], material.specular[c]);
        let lobe = lobes.specular * *irradiance;
        let by_cosine = *brdf * directions.attenuation * V::splat(linear.view.power[c]);
        let by_fresnel = lobe * (V::splat(1.0) - specular);
        let by_lobes = lobes.by_lobes(material, c, (*brdf, *fresnel));
        for (by, (_, derivative)) in self.by.iter_mut().zip(&linear.derivatives) {
            let of_radiance = match derivative {
                Derivative::OfAnisotropy(group, i) => {
                    by_lobes[*i] * *irradiance * V::from_array(shares[*group])
                }
                Derivative::OfLobe(i) => by_lobes[*i] * *irradiance,
                // rendered / (rendered + 0.01).
                Derivative::Factor(factor) => {
                    let whole = V::splat(1.0) - residual.inverse * V::splat(EPSILON);
                    *by = whole * V::splat(*factor as f32);
                    continue;
                }
                Derivative::OfView(change) => {
                    let mut moved = [V::splat(0.0); SHARED_ACROSS + 1];
                    for (i, moved) in moved.iter_mut().enumerate() {
                        let across = if i < SHARED_ACROSS { i } else { SHARED_ACROSS + c };
                        for (across, place) in self.across[across].iter().zip(change.place) {
                            *moved = across.mul_add(V::splat(place), *moved);
                        }
                    }
                    let [cosine, log_specular, power, distance, above] = moved;
                    cosine * by_cosine
                        + log_specular * *fresnel * lobe
                        + above * *irradiance
                        + power * by_fresnel
                        + distance * *brdf * *irradiance
                        + *brdf * lobes.irradiance * V::splat(change.power[c])
                        + diffuse * V::splat(change.ambient[c])
                        + specular * V::splat(change.mirrored[c])
                }
            };
            *by = of_radiance * residual.inverse;
        }
    }

    /// Adds a colour's residual.
    #[inline(always)]
    fn add(&mut self, linear: &Linear, c: usize, line: &LinearResidual<V>) {
        let LinearResidual { residual, by, .. } = line;
        let mut k = 0;
        for (i, (a, _)) in linear.derivatives.iter().enumerate() {
            let weighted = residual.square_weight * self.by[i];
            let mixed = &mut self.mixed[*a];
            for (at, by) in coordinates_of(c).into_iter().zip(by) {
                mixed[at] = weighted.mul_add(*by, mixed[at]);
            }
            self.gradients[i] = weighted.mul_add(residual.value, self.gradients[i]);
            for other in &self.by[..=i] {
                self.products[k] = weighted.mul_add(*other, self.products[k]);
                k += 1;
            }
        }
    }

    /// Moves the sums of a photograph's parameters to the reduced equations.
    #[inline(always)]
    fn move_to(&mut self, linear: &Linear, reduced: &mut Reduced) {
        let Reduced { matrix, gradient } = reduced;
        // Parameters are the last unknowns.
        let first = gradient.len() - self.mixed.len();
        let mut k = 0;
        for (i, (a, _)) in linear.derivatives.iter().enumerate() {
            gradient[first + a] += self.gradients[i].sum();
            for (b, _) in &linear.derivatives[..=i] {
                matrix[(first + a, first + b)] += self.products[k].sum();
                k += 1;
            }
        }
        self.gradients.fill(V::splat(0.0));
        self.products.fill(V::splat(0.0));
    }
}

/// Derivatives by the place of the light, 1/mm: of its cosine, of ln `specular`, of the Fresnel power, of the
/// logarithm of the inverse square, and of each colour's BRDF as far as it is due to coat and sheen.
#[inline(always)]
fn across_light<V: Lanes>(
    by_light: &ByLight<V>,
    directions: &Directions<V>,
    view: &TexelView,
    x: V,
    y: V,
) -> [[V; 3]; ACROSS] {
    let (l, inverse) = (directions.light, Directions::inverse_distance(view, x, y));
    let ByLight { cosine, log_specular, fresnel, above: [red, green, blue] } = *by_light;
    let mut out = [cosine, log_specular, fresnel, l, red, green, blue];
    for (i, of) in out.iter_mut().enumerate() {
        if i == 3 {
            continue;
        }
        let along = of[0].mul_add(l[0], of[1].mul_add(l[1], of[2] * l[2]));
        for i in 0..3 {
            of[i] = (of[i] - along * l[i]) * inverse;
        }
    }
    let fall = V::splat(-2.0 * view.inverse_square) * inverse;
    for of in &mut out[3] {
        *of = *of * fall;
    }
    out
}
