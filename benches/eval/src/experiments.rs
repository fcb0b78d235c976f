//! Experiments; every row of a table is a mean over all crops.

use std::time::Instant;

use svbrdf::comparison::compare;
use svbrdf::estimate::Method;
use svbrdf::export::resized;
use svbrdf::observation::Observation;
use svbrdf::{Result, Svbrdf};

use crate::protocol::{Arguments, Conditions, Crop, gain_of_share, photographs, whole};
use crate::report::Report;
use crate::streaming::Setup;

/// Seed of positions and noise of a crop's photographs.
pub fn seed(index: usize) -> u64 {
    1000 + index as u64
}

/// Maps of all photographs at once.
fn fitted(setup: &Setup, observations: &[Observation]) -> Result<Svbrdf> {
    let mut estimator = setup.estimator(Method::Deep, true);
    for observation in observations {
        estimator.add(observation.clone())?;
    }
    estimator.settle()
}

pub fn photos(
    arguments: &Arguments,
    setup: &Setup,
    crops: &[Crop],
    counts: &[usize],
    baseline: bool,
) -> Result<()> {
    let mut report = Report::new(arguments.verbose);
    let most = counts.iter().copied().max().unwrap_or(1);
    for (index, crop) in crops.iter().enumerate() {
        let observations =
            photographs(&crop.truth, most, seed(index), &Conditions::new(arguments.noise));
        let mut add = |row: String, maps: &Svbrdf| -> Result<()> {
            report.add(&crop.name, &row, &compare(maps, &crop.truth)?);
            Ok(())
        };
        let start = setup.networks.photo_maps(&observations[0])?;
        add("1, first maps".to_owned(), &start)?;
        let mut deep = setup.estimator(Method::Deep, true);
        let mut rough = setup.estimator(Method::Deep, false);
        let mut seen = 0;
        for &count in counts {
            for observation in &observations[seen..count] {
                deep.add(observation.clone())?;
                rough.add(observation.clone())?;
                // As in a capture, the fit settles before the next photograph.
                if count <= 5 {
                    deep.settle()?;
                    rough.settle()?;
                }
            }
            seen = count;
            add(format!("{count}, deep"), &deep.settle()?)?;
            add(format!("{count}, without refinement"), &rough.settle()?)?;
            if baseline {
                let mut classic = setup.estimator(Method::Classic, true);
                for observation in &observations[..count] {
                    classic.add(observation.clone())?;
                }
                add(format!("{count}, classic"), &classic.settle()?)?;
            }
        }
    }
    report.print(None);
    Ok(())
}

pub fn disturbances(
    arguments: &Arguments,
    setup: &Setup,
    crops: &[Crop],
    count: usize,
) -> Result<()> {
    let clean = Conditions::new(arguments.noise);
    let mut rows = vec![("clean".to_owned(), clean)];
    for light_degrees in [1.0, 5.0, 10.0] {
        let row = format!("light {light_degrees}° off");
        rows.push((row, Conditions { light_degrees, ..clean }));
    }
    for ambient in [0.01, 0.05, 0.1] {
        let row = format!("ambient {} %", 100.0 * ambient);
        rows.push((row, Conditions { ambient, ..clean }));
    }
    let mut report = Report::new(arguments.verbose);
    for (index, crop) in crops.iter().enumerate() {
        for (row, conditions) in &rows {
            let observations = photographs(&crop.truth, count, seed(index), conditions);
            let maps = fitted(setup, &observations)?;
            report.add(&crop.name, row, &compare(&maps, &crop.truth)?);
        }
    }
    report.print(Some("clean"));
    Ok(())
}

pub fn exposure(arguments: &Arguments, setup: &Setup, crops: &[Crop], count: usize) -> Result<()> {
    let clean = Conditions { levels: Some(255.0), ..Conditions::new(arguments.noise) };
    let mut report = Report::new(arguments.verbose);
    for (index, crop) in crops.iter().enumerate() {
        let mut add = |row: String, conditions: &Conditions| -> Result<()> {
            let observations = photographs(&crop.truth, count, seed(index), conditions);
            let maps = fitted(setup, &observations)?;
            report.add(&crop.name, &row, &compare(&maps, &crop.truth)?);
            Ok(())
        };
        let hdr = Conditions { levels: None, ..clean };
        add("HDR".to_owned(), &hdr)?;
        add("8 bits".to_owned(), &clean)?;
        for share in [0.05, 0.1, 0.2, 0.4] {
            let gain = gain_of_share(&crop.truth, count, seed(index), share);
            let row = format!("8 bits, {} % saturated", 100.0 * share);
            add(row, &Conditions { gain, ..clean })?;
        }
        for stops in [1, 2, 4, 6] {
            let gain = 0.5f32.powi(stops);
            add(format!("8 bits, -{stops} stops"), &Conditions { gain, ..clean })?;
        }
    }
    report.print(Some("HDR"));
    Ok(())
}

pub fn start(arguments: &Arguments, setup: &Setup, crops: &[Crop], counts: &[usize]) -> Result<()> {
    let mut report = Report::new(arguments.verbose);
    let most = counts.iter().copied().max().unwrap_or(1);
    for (index, crop) in crops.iter().enumerate() {
        let clean = Conditions::new(arguments.noise);
        for (name, conditions) in [("top", clean), ("45°", Conditions { oblique: true, ..clean })]
        {
            let observations = photographs(&crop.truth, most, seed(index), &conditions);
            let start = setup.networks.photo_maps(&observations[0])?;
            let mut starts = vec![("", start.clone())];
            if name == "top" {
                starts.push(("bad", spoiled(&start)));
                let code = setup.networks.encode(&crop.truth)?;
                starts.push(("encoded truth", setup.networks.decode(&code, SIDE_OF_CODE)?));
            }
            for (kind, start) in starts {
                let row = format!("{name}{}{kind}", if kind.is_empty() { "" } else { ", " });
                report.add(&crop.name, &format!("{row}: start"), &compare(&start, &crop.truth)?);
                for &count in counts {
                    let mut estimator = setup.estimator(Method::Deep, true);
                    estimator.start_from(start.clone());
                    for observation in &observations[..count] {
                        estimator.add(observation.clone())?;
                    }
                    let maps = estimator.settle()?;
                    let row = format!("{row}: {count} photos");
                    report.add(&crop.name, &row, &compare(&maps, &crop.truth)?);
                }
            }
        }
    }
    report.print(None);
    Ok(())
}

pub fn resolution(
    arguments: &Arguments,
    setup: &Setup,
    sides: &[usize],
    count: usize,
) -> Result<()> {
    let largest = sides.iter().copied().max().unwrap_or(0);
    let materials = whole(arguments, largest.min(LEAST_SIDE))?;
    let mut report = Report::new(arguments.verbose);
    let mut seconds = vec![[0.0; 2]; sides.len()];
    for (index, material) in materials.iter().enumerate() {
        for (&side, seconds) in sides.iter().zip(&mut seconds) {
            let truth = resized(&material.truth, side, side);
            let conditions = Conditions::new(arguments.noise);
            let observations = photographs(&truth, count, seed(index), &conditions);
            let start = Instant::now();
            let mut estimator = setup.estimator(Method::Deep, true);
            for observation in observations {
                estimator.add(observation)?;
                seconds[0] +=
                    if estimator.photos() == 1 { start.elapsed().as_secs_f64() } else { 0.0 };
                estimator.settle()?;
            }
            let maps = estimator.settle()?;
            seconds[1] += start.elapsed().as_secs_f64();
            report.add(&material.name, &side.to_string(), &compare(&maps, &truth)?);
        }
    }
    report.print(None);
    println!("\n| texels a side | first maps, s | all photographs, one by one, s |\n|---|---|---|");
    for (side, seconds) in sides.iter().zip(seconds) {
        let [first, all] = seconds.map(|s| s / materials.len().max(1) as f64);
        println!("| {side} | {first:.2} | {all:.1} |");
    }
    Ok(())
}

/// Least texels per side of materials in the comparison of resolutions.
const LEAST_SIDE: usize = 1024;

/// Height and width of the code of a crop.
const SIDE_OF_CODE: [usize; 2] = [16, 16];

/// The bad start of the paper's Figure 16: much too rough, too little specular.
fn spoiled(maps: &Svbrdf) -> Svbrdf {
    let mut maps = maps.clone();
    maps.roughness_mut().iter_mut().for_each(|r| *r = (*r + 0.4).min(1.0));
    for c in 0..3 {
        maps.specular_mut()[c].iter_mut().for_each(|s| *s *= 0.3);
    }
    maps
}
