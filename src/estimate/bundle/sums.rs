//! Normal equations of eight texels, summed over the photographs in single precision.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::parameters::Derivative;
use super::problem::Problem;
use super::sample::Photograph;
use super::state::{EightLobes, State, in_lanes};
use crate::estimate::coordinates::{Coordinates, from_coordinates};
use crate::estimate::posterior::{
    Appearance, Line, NormalEquations, PAIRS, Residual, Seen, coordinates_of,
};
use crate::loss::EPSILON;
use crate::reflectance::{ByLight, Directions, Lobes, Material, TexelView};
use crate::simd::{Kernel, LANES, Lanes, dispatch};
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

/// The equations of at most eight texels.
pub(super) struct Sums {
    /// Lower triangle of the matrix, by rows.
    pub matrix: [[f32; LANES]; PAIRS],
    pub gradient: [[f32; LANES]; CHANNELS],
    /// Products of each parameter with the texels' coordinates.
    pub mixed: Vec<[[f32; LANES]; CHANNELS]>,
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

    /// The sums of at most eight texels with these coordinates. Products of parameters go to the reduced
    /// equations, from row `first` on.
    pub(super) fn sums(
        &self,
        texels: Range<usize>,
        coordinates: &[Coordinates],
        lobes: Option<EightLobes>,
        shares: &[[f32; LANES]],
        linear: &[Linear],
        reduced: &mut Reduced,
        first: usize,
    ) -> Sums {
        let mut lanes = [[0.0; LANES]; CHANNELS];
        for (lane, x) in coordinates.iter().enumerate() {
            for (lanes, value) in lanes.iter_mut().zip(x) {
                lanes[lane] = *value as f32;
            }
        }
        dispatch(Block {
            problem: self,
            texels,
            coordinates: lanes,
            lobes,
            shares,
            linear,
            reduced,
            first,
        })
    }
}

struct Block<'a> {
    problem: &'a Problem,
    texels: Range<usize>,
    coordinates: [[f32; LANES]; CHANNELS],
    lobes: Option<EightLobes>,
    /// The texels' shares of each group.
    shares: &'a [[f32; LANES]],
    linear: &'a [Linear<'a>],
    reduced: &'a mut Reduced,
    first: usize,
}

// Loops, because closures may stay calls without the kernel's target features.
impl Kernel for Block<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<V: Lanes>(self) -> Sums {
        let Problem { sample, noise, shared, .. } = self.problem;
        let (n, zero) = (sample.texels(), V::splat(0.0));
        let [x, y] = sample.eight_places::<V>(self.texels.clone());
        let mut coordinates = [zero; CHANNELS];
        for (to, from) in coordinates.iter_mut().zip(self.coordinates) {
            *to = V::from_array(from);
        }
        let material = Material::new(&from_coordinates(&coordinates), in_lanes(&self.lobes));
        let mut equations = NormalEquations::none();
        let mut parameters = Parameters::new(shared.len(), self.linear);
        for linear in self.linear {
            let (view, photograph) = (&linear.view, linear.photograph);
            let directions = Directions::at(view, x, y);
            let appearance = Appearance::new(&material, &directions);
            let weight = V::load(&photograph.weight[self.texels.clone()], 0.0);
            if linear.by_view {
                let by_light = appearance.lobes.by_light(&material, &directions);
                parameters.across = across_light(&by_light, &directions, view, x, y);
            }
            for c in 0..3 {
                let plane = &photograph.radiance[c * n..(c + 1) * n];
                let radiance = V::load(&plane[self.texels.clone()], 0.0);
                let seen = Seen { noise: *noise, radiance, weight };
                let line = appearance.line(&material, view, c, &coordinates, &seen);
                let Residual { value, square_weight, .. } = line.residual;
                equations.add(c, line.by, value, square_weight);
                parameters.find(
                    linear,
                    c,
                    &material,
                    &directions,
                    &appearance.lobes,
                    &line,
                    self.shares,
                );
                parameters.add(linear, c, &line);
            }
            parameters.move_to(linear, self.reduced, self.first);
        }
        let mut sums = Sums {
            matrix: [[0.0; LANES]; PAIRS],
            gradient: [[0.0; LANES]; CHANNELS],
            mixed: vec![[[0.0; LANES]; CHANNELS]; shared.len()],
        };
        for (to, from) in sums.matrix.iter_mut().zip(equations.matrix) {
            *to = from.to_array();
        }
        for (to, from) in sums.gradient.iter_mut().zip(equations.gradient) {
            *to = from.to_array();
        }
        for (to, from) in sums.mixed.iter_mut().flatten().zip(parameters.mixed.iter().flatten()) {
            *to = from.to_array();
        }
        sums
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
        line: &Line<V>,
        shares: &[[f32; LANES]],
    ) {
        let Line { brdf, fresnel, irradiance, residual, .. } = line;
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
    fn add(&mut self, linear: &Linear, c: usize, line: &Line<V>) {
        let Line { residual, by, .. } = line;
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
    fn move_to(&mut self, linear: &Linear, reduced: &mut Reduced, first: usize) {
        let Reduced { matrix, gradient } = reduced;
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
