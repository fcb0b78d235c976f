//! Parts of photographs that contradict the others: sun on a part of the sample, a shadow, a hand, glare.
//!
//! Each photograph is cut into cells. In each, the median of measured over rendered radiance is taken
//! where the maps show little gloss, and the photograph's own median is taken off. A cell that is off
//! while the same cell of the other photographs is not, by far more than cells usually are, is
//! something that only this photograph shows.

use crate::observation::Observation;
use crate::render::render;
use crate::svbrdf::{Svbrdf, channel};

/// Cells along each side.
const CELLS: usize = 8;
/// Photographs without which nothing stands out.
const PHOTOGRAPHS_MIN: usize = 4;
/// Share of a cell's texels that must count.
const SHARE_MIN: f64 = 0.4;
/// Share of the diffuse part in what is rendered: below, misfits of highlights would be told.
const DIFFUSE_MIN: f32 = 0.85;
/// How far a cell must be off: logarithm, and times what cells usually are.
const OFF_MIN: f32 = 0.2;
const OFF_USUAL: f32 = 8.0;
/// Neighbouring cells off in the same direction, at least; and the largest share of all that are.
const TOGETHER_MIN: usize = 2;
const SHARE_MAX: f32 = 0.6;
/// Added to radiances before logarithms are taken, as the objective does.
const FLOOR: f32 = 0.01;

/// A part of a photograph that contradicts the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Share of the sample, 0 to 1.
    pub share: f32,
    /// Its middle: parts of the sample's width from the left and of its height from the top.
    pub centre: [f32; 2],
    /// Measured over what the maps show, relative to the rest of the photograph.
    pub ratio: f32,
}

/// The largest such part of each photograph.
pub(super) fn parts(maps: &Svbrdf, photographs: &[&Observation]) -> Vec<Option<Part>> {
    if photographs.len() < PHOTOGRAPHS_MIN {
        return vec![None; photographs.len()];
    }
    let mut diffuse = maps.clone();
    for c in 0..3 {
        diffuse.plane_mut(channel::SPECULAR + c).fill(0.0);
    }
    let mut planes = [vec![0.0; 3 * maps.texels()], vec![0.0; 3 * maps.texels()]];
    let cells: Vec<Cells> = photographs
        .iter()
        .map(|photograph| {
            let [whole, below] = &mut planes;
            render(maps, &photograph.view, whole);
            render(&diffuse, &photograph.view, below);
            cells(photograph, whole, below)
        })
        .collect();
    let (off, usual) = off(&cells);
    let limit = OFF_MIN.max(OFF_USUAL * usual);
    off.iter().map(|off| largest(off, limit)).collect()
}

/// A value of each cell that tells something.
type Cells = Vec<Option<f32>>;

fn cells(photograph: &Observation, rendered: &[f32], diffuse: &[f32]) -> Cells {
    let (width, height) = (photograph.width(), photograph.height());
    let texels = width * height;
    let mut values: Vec<Vec<f32>> = vec![Vec::new(); CELLS * CELLS];
    // Of saturated values it is not known how bright they were.
    let counts =
        |t: usize| photograph.weight(t) > 0.0 && (0..3).all(|c| photograph.radiance(c, t) >= 0.0);
    for t in (0..texels).filter(|&t| counts(t)) {
        let sum = |plane: &dyn Fn(usize) -> f32| plane(0) + plane(1) + plane(2);
        let whole = sum(&|c| rendered[c * texels + t]);
        if sum(&|c| diffuse[c * texels + t]) < DIFFUSE_MIN * whole {
            continue;
        }
        let measured = sum(&|c| photograph.radiance(c, t));
        let (x, y) = (t % width * CELLS / width, t / width * CELLS / height);
        values[y * CELLS + x].push(((measured / 3.0 + FLOOR) / (whole / 3.0 + FLOOR)).ln());
    }
    let needed = SHARE_MIN * texels as f64 / (CELLS * CELLS) as f64;
    let of_cell = |values: &mut Vec<f32>| {
        let enough = values.len() as f64 >= needed;
        median(values).filter(|v| enough && v.is_finite())
    };
    let cells: Cells = values.iter_mut().map(of_cell).collect();
    let own = median(&mut cells.iter().flatten().copied().collect::<Vec<_>>()).unwrap_or(0.0);
    cells.into_iter().map(|cell| cell.map(|v| v - own)).collect()
}

/// How far each cell is off those of the other photographs, and how far cells usually are.
fn off(photographs: &[Cells]) -> (Vec<Cells>, f32) {
    let mut off = photographs.to_vec();
    let mut all = Vec::new();
    for cell in 0..CELLS * CELLS {
        let mut values: Vec<f32> = photographs.iter().filter_map(|p| p[cell]).collect();
        let enough = values.len() >= PHOTOGRAPHS_MIN;
        let middle = median(&mut values).filter(|_| enough);
        for photograph in &mut off {
            photograph[cell] = photograph[cell].zip(middle).map(|(v, middle)| v - middle);
            all.extend(photograph[cell].map(f32::abs));
        }
    }
    (off, 1.4826 * median(&mut all).unwrap_or(0.0))
}

/// The largest group of neighbouring cells that are off by more than a limit in one direction.
fn largest(off: &Cells, limit: f32) -> Option<Part> {
    let known = off.iter().flatten().count();
    let mut open: Vec<bool> = off.iter().map(|v| v.is_some_and(|v| v.abs() > limit)).collect();
    let mut best: Vec<usize> = Vec::new();
    for start in 0..off.len() {
        let Some(sign) = off[start].filter(|_| open[start]).map(f32::signum) else { continue };
        let (mut group, mut next) = (Vec::new(), vec![start]);
        open[start] = false;
        while let Some(cell) = next.pop() {
            group.push(cell);
            let (x, y) = (cell % CELLS, cell / CELLS);
            let sides = [
                (x > 0).then(|| cell - 1),
                (x + 1 < CELLS).then_some(cell + 1),
                (y > 0).then(|| cell - CELLS),
                (y + 1 < CELLS).then_some(cell + CELLS),
            ];
            for side in sides.into_iter().flatten() {
                if open[side] && off[side].is_some_and(|v| v.signum() == sign) {
                    open[side] = false;
                    next.push(side);
                }
            }
        }
        if group.len() > best.len() {
            best = group;
        }
    }
    let count = best.len() as f32;
    if best.len() < TOGETHER_MIN || count > SHARE_MAX * known as f32 {
        return None;
    }
    let mean = |of: &dyn Fn(usize) -> f32| best.iter().map(|&cell| of(cell)).sum::<f32>() / count;
    let place = |k: usize| (k as f32 + 0.5) / CELLS as f32;
    let ratio = median(&mut best.iter().filter_map(|&cell| off[cell]).collect::<Vec<_>>())?.exp();
    Some(Part {
        share: count / (CELLS * CELLS) as f32,
        centre: [mean(&|cell| place(cell % CELLS)), mean(&|cell| place(cell / CELLS))],
        ratio,
    })
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::{Falloff, View};
    use crate::random::Random;

    const SIDE: usize = 64;

    /// What six photographs show of a bumpy, mostly matt sample, with a change of one of them.
    fn photographs(maps: &Svbrdf, change: impl Fn(usize, usize, usize) -> f32) -> Vec<Observation> {
        let mut random = Random::new(3);
        (0..6)
            .map(|i| {
                let angle = i as f32;
                let camera_mm = [120.0 * angle.cos(), 120.0 * angle.sin(), 300.0];
                let view = View {
                    sample_mm: [100.0; 2],
                    camera_mm,
                    light_mm: camera_mm,
                    falloff: Falloff::InverseSquare { power_mm2: [3e5; 3] },
                    ambient: [0.0; 3],
                    mirrored: 1.0,
                };
                let mut planes = vec![0.0; 3 * SIDE * SIDE];
                render(maps, &view, &mut planes);
                for (k, value) in planes.iter_mut().enumerate() {
                    let (x, y) = (k % SIDE, k / SIDE % SIDE);
                    *value *= change(i, x, y) * (1.0 + 0.05 * (random.uniform() as f32 - 0.5));
                }
                Observation::new(SIDE, SIDE, view, &planes, &vec![1.0; SIDE * SIDE]).unwrap()
            })
            .collect()
    }

    fn sample() -> Svbrdf {
        let mut maps = Svbrdf::new(SIDE, SIDE);
        for t in 0..SIDE * SIDE {
            maps.plane_mut(channel::SLOPE_X)[t] = 0.2 * (t as f32 * 0.3).sin();
            maps.plane_mut(channel::ROUGHNESS)[t] = 0.7;
            maps.plane_mut(channel::DIFFUSE)[t] = if t / 9 % 2 == 0 { 0.2 } else { 0.6 };
        }
        maps
    }

    fn found(maps: &Svbrdf, change: impl Fn(usize, usize, usize) -> f32) -> Vec<Option<Part>> {
        let photographs = photographs(maps, change);
        parts(maps, &photographs.iter().collect::<Vec<_>>())
    }

    #[test]
    fn sun_and_a_hand_on_a_part_are_found_and_nothing_else() {
        let maps = sample();
        assert!(found(&maps, |_, _, _| 1.0).iter().all(Option::is_none));
        // Gains of whole photographs are none of a part.
        assert!(found(&maps, |i, _, _| 1.0 + 0.2 * i as f32).iter().all(Option::is_none));
        let sun = |i: usize, x: usize, y: usize| match (i, x, y) {
            (2, 0..24, 32..) => 1.5,
            _ => 1.0,
        };
        let parts = found(&maps, sun);
        assert!(parts.iter().enumerate().all(|(i, part)| part.is_some() == (i == 2)), "{parts:?}");
        let part = parts[2].unwrap();
        assert!((part.ratio - 1.5).abs() < 0.1 && (part.share - 12.0 / 64.0).abs() < 0.05);
        assert!((part.centre[0] - 0.19).abs() < 0.1 && (part.centre[1] - 0.75).abs() < 0.1);
        let hand = |i: usize, x: usize, _: usize| if i == 4 && x > 44 { 0.5 } else { 1.0 };
        let parts = found(&maps, hand);
        assert!(parts[4].is_some_and(|p| p.ratio < 0.6 && p.centre[0] > 0.8), "{parts:?}");
    }

    #[test]
    fn few_photographs_tell_nothing() {
        let maps = sample();
        let all = photographs(&maps, |i, x, _| if i == 0 && x < 32 { 2.0 } else { 1.0 });
        assert_eq!(parts(&maps, &[&all[0], &all[1], &all[2]]), [None; 3]);
    }
}
