//! The class of colour of each texel.

use super::setup::{TEXELS, clusters};
use crate::estimate::bundle::Sample;
use crate::estimate::finer::full_colours;
use crate::estimate::options::EstimateOptions;
use crate::estimate::photographs::Photographs;
use crate::parallel;

/// The class of each texel, row by row; 0 is the largest class.
pub(in crate::estimate) fn classes(
    photographs: &Photographs,
    options: &EstimateOptions,
) -> Vec<u8> {
    let sample = Sample::new(photographs.working(), TEXELS, TEXELS);
    let which: Vec<usize> = (0..photographs.len()).collect();
    let clusters = clusters(&sample.colours(&which), &options.joint);
    let colours = full_colours(photographs);
    let nearest = parallel::values(colours.len(), |t| clusters.nearest(&colours[t]));
    let mut sizes = vec![0_usize; clusters.len()];
    nearest.iter().for_each(|class| sizes[*class] += 1);
    let mut by_size: Vec<usize> = (0..sizes.len()).collect();
    by_size.sort_by_key(|class| std::cmp::Reverse(sizes[*class]));
    let mut rank = vec![0_u8; sizes.len()];
    by_size.iter().zip(0..).for_each(|(class, place)| rank[*class] = place);
    nearest.into_iter().map(|class| rank[class]).collect()
}
