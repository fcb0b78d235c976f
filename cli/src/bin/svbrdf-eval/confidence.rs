//! Dump.

use std::io::Write;
use std::path::PathBuf;

use svbrdf::estimate::{Evidence, Method};
use svbrdf::random::Random;
use svbrdf::svbrdf::channel;
use svbrdf::{Error, Result, Svbrdf};

use crate::captures::with_truth;
use crate::experiments::seed;
use crate::protocol::{self, Conditions, crops, photographs};
use crate::streaming::{Setup, Variant, capture_folders, push};

#[derive(clap::Args)]
pub struct Arguments {
    /// Folders with capture.json and the true maps in truth/, or folders of such
    captures: Vec<PathBuf>,
    /// Folder with a folder per material
    #[arg(long)]
    materials: Option<PathBuf>,
    #[arg(long, default_value_t = 1)]
    every: usize,
    #[arg(long, default_value_t = 0)]
    skip: usize,
    #[arg(long, value_delimiter = ',', default_value = "1,2,5,8")]
    photos: Vec<usize>,
    #[arg(long)]
    dump: PathBuf,
}

fn dump(out: &mut impl Write, case: usize, kind: usize, e: &Evidence, truth: &Svbrdf) {
    let n = e.texels;
    let stride = (n / 500).max(1) | 1;
    let mean_residual = e.residual.iter().sum::<f32>() / n as f32;
    let mut means = Vec::new();
    for p in &e.planes {
        means.push((p.iter().map(|v| v * v).sum::<f32>() / n as f32).sqrt());
    }
    let stds: Vec<f32> = [0..2, 2..5, 5..8, 8..9]
        .into_iter()
        .map(|r| {
            let len = r.len();
            let v: f32 = r
                .map(|c| {
                    let p = e.maps.plane(c);
                    let m = p.iter().sum::<f32>() / n as f32;
                    p.iter().map(|v| (v - m).powi(2)).sum::<f32>() / n as f32
                })
                .sum();
            (v / len as f32).sqrt()
        })
        .collect();
    let mut sorted = truth.plane(channel::ROUGHNESS).to_vec();
    sorted.sort_by(f32::total_cmp);
    let rough = sorted[n / 2];
    for t in (stride / 2..n).step_by(stride) {
        let mut row = vec![case as f32, kind as f32, rough, mean_residual];
        row.extend(&e.scalars);
        row.extend(e.shared);
        row.extend(&stds);
        row.extend(&means);
        row.push(e.residual[t]);
        row.extend(e.planes.iter().map(|p| p[t]));
        row.extend((0..9).map(|c| e.maps.plane(c)[t]));
        row.extend((0..9).map(|c| truth.plane(c)[t]));
        let bytes: Vec<u8> = row.iter().flat_map(|v| v.to_le_bytes()).collect();
        out.write_all(&bytes).unwrap();
        if case == 0 && t == stride / 2 {
            eprintln!("{} columns", row.len());
        }
    }
}

pub fn run(arguments: &Arguments, setup: &Setup) -> Result<()> {
    let file = std::fs::File::create(&arguments.dump).map_err(|e| Error::io(&arguments.dump, e))?;
    let mut out = std::io::BufWriter::new(file);
    let mut case = 0;
    let last = arguments.photos.iter().copied().max().unwrap_or(1);
    for folder in capture_folders(&arguments.captures)? {
        let (capture, truth) = with_truth(&folder, 256)?;
        let board = capture.frames.iter().all(|f| f.rectified.is_none());
        let session = setup.session(&capture, Variant::Deep)?;
        let mut accepted = 0;
        for frame in &capture.frames {
            if push(&session, frame)?.is_some() {
                continue;
            }
            accepted += 1;
            session.wait()?;
            if arguments.photos.contains(&accepted) {
                dump(&mut out, case, if board { 2 } else { 3 }, &session.evidence()?, &truth);
            }
            if accepted >= last {
                break;
            }
        }
        case += 1;
        eprintln!("{}", folder.display());
    }
    if let Some(folder) = &arguments.materials {
        let mut of = protocol::Arguments::from(folder.clone());
        of.every = arguments.every;
        for (index, crop) in crops(&of)?.iter().enumerate() {
            let truth = crop.truth.downsampled();
            for kind in 0..2 {
                let conditions = match kind {
                    0 => Conditions::new(0.0),
                    _ => Conditions::random(&mut Random::new(77 + index as u64)),
                };
                let mut estimator = setup.estimator(Method::Deep, true);
                for (i, o) in
                    photographs(&truth, last, seed(index), &conditions).into_iter().enumerate()
                {
                    estimator.add(o)?;
                    estimator.settle()?;
                    if arguments.photos.contains(&(i + 1)) {
                        dump(&mut out, case, kind, &estimator.evidence()?, &truth);
                    }
                }
                case += 1;
            }
            eprintln!("{}", crop.name);
        }
    }
    Ok(())
}
