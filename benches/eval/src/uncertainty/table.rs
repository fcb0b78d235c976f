//! Coverage and rank correlation, as Markdown tables.

use svbrdf::svbrdf::channel;

/// Coordinates of each map.
pub const MAPS: [(&str, std::ops::Range<usize>); 4] = [
    ("normal", channel::SLOPE_X..channel::DIFFUSE),
    ("diffuse", channel::DIFFUSE..channel::SPECULAR),
    ("specular", channel::SPECULAR..channel::ROUGHNESS),
    ("roughness", channel::ROUGHNESS..channel::ROUGHNESS + 1),
];

/// Subject of an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Group {
    pub case: usize,
    pub photos: usize,
    pub matte: bool,
}

/// A texel of a map.
struct Sample {
    group: Group,
    map: usize,
    deviation: f64,
    /// Errors over the deviation.
    ratios: Vec<f64>,
}

/// Stated deviations and errors.
#[derive(Default)]
pub struct Table {
    samples: Vec<Sample>,
}

/// Multiples of the deviation for the coverage table.
const LEVELS: [f64; 5] = [0.5, 1.0, 1.5, 2.0, 3.0];

impl Table {
    /// Adds a texel of a map.
    pub fn add(&mut self, group: Group, map: usize, deviation: f32, errors: &[f32]) {
        let deviation = f64::from(deviation);
        let ratios = errors.iter().map(|e| f64::from(*e) / deviation).collect();
        self.samples.push(Sample { group, map, deviation, ratios });
    }

    /// Prints the shares of errors within one and two deviations (overall, by gloss and by number
    /// of photographs), rank correlations of deviations and errors (of texels and of whole maps),
    /// and the shares within further multiples.
    pub fn print(&self, photos: &[usize]) {
        let numbers: Vec<String> = photos.iter().map(|n| format!("{n} photos |")).collect();
        println!(
            "| map | all | matte | glossy | {} rank, texels | rank, maps |",
            numbers.join(" ")
        );
        println!("|---|---|---|---|{}---|---|", "---|".repeat(photos.len()));
        let names = MAPS.iter().map(|(name, _)| *name).enumerate().map(|(i, n)| (Some(i), n));
        for (map, name) in names.chain([(None, "all maps")]) {
            let of = |is: &dyn Fn(&Group) -> bool| {
                let ratios = self.ratios(map, is);
                format!("{} / {}", percent(&ratios, 1.0), percent(&ratios, 2.0))
            };
            let mut columns = vec![of(&|_| true), of(&|g| g.matte), of(&|g| !g.matte)];
            columns.extend(photos.iter().map(|n| of(&|g| g.photos == *n)));
            columns.push(map.map_or_else(String::new, |map| format!("{:.2}", self.by_texel(map))));
            columns.push(map.map_or_else(String::new, |map| format!("{:.2}", self.by_map(map))));
            println!("| {name} | {} |", columns.join(" | "));
        }
        let levels: Vec<String> = LEVELS.iter().map(|k| format!("{k}")).collect();
        println!("\n| % within deviations | {} |", levels.join(" | "));
        println!("|---|{}", "---|".repeat(LEVELS.len()));
        let expected = LEVELS.map(|k| format!("{:.0}", 100.0 * erf(k / 2.0f64.sqrt())));
        println!("| of a normal distribution | {} |", expected.join(" | "));
        for (map, (name, _)) in MAPS.iter().enumerate() {
            let ratios = self.ratios(Some(map), &|_| true);
            let shares = LEVELS.map(|k| percent(&ratios, k));
            println!("| {name} | {} |", shares.join(" | "));
        }
        println!("\n{} texels", self.samples.len() / MAPS.len());
    }

    fn ratios(&self, map: Option<usize>, is: &dyn Fn(&Group) -> bool) -> Vec<f64> {
        let chosen = |s: &&Sample| map.is_none_or(|map| map == s.map) && is(&s.group);
        self.samples.iter().filter(chosen).flat_map(|s| s.ratios.iter().copied()).collect()
    }

    fn by_texel(&self, map: usize) -> f64 {
        let of = self.samples.iter().filter(|s| s.map == map);
        let pairs: Vec<[f64; 2]> = of.map(|s| [s.deviation, s.error()]).collect();
        rank_correlation(&pairs)
    }

    /// Rank correlation of the RMS values of whole estimates.
    fn by_map(&self, map: usize) -> f64 {
        let mut maps: Vec<(Group, [f64; 2])> = Vec::new();
        for sample in self.samples.iter().filter(|s| s.map == map) {
            // All estimates have the same number of texels, so sums suffice.
            let squares = [sample.deviation.powi(2), sample.error().powi(2)];
            match maps.last_mut().filter(|(group, _)| *group == sample.group) {
                Some((_, sums)) => sums.iter_mut().zip(squares).for_each(|(a, b)| *a += b),
                None => maps.push((sample.group, squares)),
            }
        }
        let pairs: Vec<[f64; 2]> = maps.into_iter().map(|(_, sums)| sums).collect();
        rank_correlation(&pairs)
    }
}

impl Sample {
    /// RMS of the errors.
    fn error(&self) -> f64 {
        let squares: f64 = self.ratios.iter().map(|r| r * r).sum();
        self.deviation * (squares / self.ratios.len() as f64).sqrt()
    }
}

fn percent(ratios: &[f64], deviations: f64) -> String {
    let within = ratios.iter().filter(|r| **r <= deviations).count();
    match ratios.len() {
        0 => "-".into(),
        n => format!("{:.0}", 100.0 * within as f64 / n as f64),
    }
}

/// Spearman's coefficient.
fn rank_correlation(pairs: &[[f64; 2]]) -> f64 {
    let ranks = [0, 1].map(|k| {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|a, b| pairs[*a][k].total_cmp(&pairs[*b][k]));
        let mut ranks = vec![0.0; pairs.len()];
        let mut from = 0;
        while from < order.len() {
            let equal = order[from..].iter().take_while(|i| pairs[**i][k] == pairs[order[from]][k]);
            let to = from + equal.count();
            // Ties share the mean rank.
            order[from..to].iter().for_each(|i| ranks[*i] = 0.5 * (from + to - 1) as f64);
            from = to;
        }
        ranks
    });
    let n = pairs.len() as f64;
    let mean = 0.5 * (n - 1.0);
    let moment = |a: usize, b: usize| -> f64 {
        ranks[a].iter().zip(&ranks[b]).map(|(x, y)| (x - mean) * (y - mean)).sum()
    };
    moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt().max(f64::MIN_POSITIVE)
}

/// Error function, absolute error below 2e-7 (Abramowitz and Stegun 7.1.26).
fn erf(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x);
    let a = [0.254_829_592, -0.284_496_736, 1.421_413_741, -1.453_152_027, 1.061_405_429];
    let p = a.iter().rev().fold(0.0, |p, a| (p + a) * t);
    1.0 - p * (-x * x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_correlate_whatever_the_scale() {
        let up: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), f64::from(i).exp()]).collect();
        assert!((rank_correlation(&up) - 1.0).abs() < 1e-12);
        let down: Vec<[f64; 2]> = up.iter().map(|[a, b]| [-a, *b]).collect();
        assert!((rank_correlation(&down) + 1.0).abs() < 1e-12);
        // 1, 2.5, 2.5, 4 against 1, 2, 3, 4: by hand 4.5 / sqrt(4.5 * 5).
        let tied = [[1.0, 1.0], [2.0, 2.0], [2.0, 3.0], [3.0, 4.0]];
        assert!((rank_correlation(&tied) - (0.9f64).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn shares_of_a_normal_distribution() {
        for (k, share) in [(1.0, 0.682_689), (2.0, 0.954_500), (0.5, 0.382_925)] {
            assert!((erf(k / 2.0f64.sqrt()) - share).abs() < 1e-6);
        }
    }
}
