//! Untuned captures, generated for one run from its seed.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};
use svbrdf::capture::FILE_NAME;
use svbrdf::export::{MapsOptions, read_maps, write_maps};
use svbrdf::random::Random;
use svbrdf::{Error, Result, Svbrdf};

use super::made::{self, Kind};
use crate::protocol::{SIDE, crop};
use crate::streaming::name;

/// Board captures per seed, and as many rectified ones.
const CAPTURES: usize = 12;
/// Generated materials in every three.
const GENERATED: usize = 1;
/// Photographs of each, and the number predicted.
const FRAMES: usize = 9;
const HELD_OUT: usize = 2;
/// Room light of board captures as a share of the flash, drawn from these.
const ROOMS: [f32; 3] = [0.0, 0.02, 0.05];
/// Share of the materials of `training/` held out from all networks, by a hash of their names
/// (`training/data.py`).
const HELD_OUT_PERCENT: u32 = 6;

/// Default seed: the day.
pub fn seed_of_today() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs() / 86_400)
}

/// Whether a material of `training/` was held out from all networks.
fn is_held_out(name: &str) -> bool {
    let hash = Sha256::digest(name.as_bytes());
    hash.iter().fold(0, |rest, byte| (rest * 256 + u32::from(*byte)) % 100) < HELD_OUT_PERCENT
}

/// Materials held out from all networks: `materials/validation`, and the held-out part of `materials/train`.
fn materials(data: &Path) -> Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for (folder, seen) in [("validation", false), ("train", true)] {
        let folder = data.join("materials").join(folder);
        let entries = std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, e))?;
        let folders = entries.filter_map(|e| Some(e.ok()?.path())).filter(|path| path.is_dir());
        let kept = folders.filter(|path| !seen || is_held_out(&file_name(path)));
        all.extend(kept);
    }
    all.sort();
    if all.is_empty() {
        return Err(Error::argument("data", format!("{}: no materials", data.display())));
    }
    Ok(all)
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

enum Material {
    /// A random crop of a texture.
    Texture(PathBuf),
    Generated(Kind),
}

impl Material {
    fn name(&self) -> String {
        match self {
            Self::Texture(path) => name(path),
            Self::Generated(kind) => kind.name().to_owned(),
        }
    }

    fn maps(&self, random: &mut Random) -> Result<Svbrdf> {
        let path = match self {
            Self::Texture(path) => path,
            Self::Generated(kind) => return Ok(made::maps(*kind, SIDE, random)),
        };
        let maps = read_maps(path)?;
        let (w, h) = (maps.width(), maps.height());
        let side = SIDE.min(w).min(h);
        let mut place = |size: usize| (random.uniform() * (size - side + 1) as f64) as usize;
        crop(&maps, [place(w), place(h)], side)
    }
}

fn shuffle<T>(list: &mut [T], random: &mut Random) {
    for i in 0..list.len() {
        list.swap(i, i + (random.uniform() * (list.len() - i) as f64) as usize);
    }
}

/// Generates the captures of a seed in a folder, boards and rectified ones, each of another
/// material with realistic faults (`svbrdf simulate --real`) and, for boards, in rooms of different
/// brightness. Existing captures are kept.
pub fn captures(data: &Path, seed: u64, folder: &Path) -> Result<[Vec<PathBuf>; 2]> {
    let mut random = Random::new(seed);
    let mut textures = materials(data)?;
    shuffle(&mut textures, &mut random);
    let generated = 2 * CAPTURES * GENERATED / 3;
    let mut materials: Vec<Material> = (0..2 * CAPTURES)
        .map(|i| match i.checked_sub(generated) {
            None => Material::Generated(Kind::ALL[i % Kind::ALL.len()]),
            Some(i) => Material::Texture(textures[i % textures.len()].clone()),
        })
        .collect();
    shuffle(&mut materials, &mut random);
    let mut captures = [Vec::new(), Vec::new()];
    for (i, material) in materials.iter().enumerate() {
        let own = seed.wrapping_mul(100) + i as u64;
        let mut random = Random::new(own);
        let (kind, room) = if i < CAPTURES {
            ("board", Some(ROOMS[(random.uniform() * ROOMS.len() as f64) as usize]))
        } else {
            ("rectified", None)
        };
        let capture = folder.join(format!("{seed}-{i:02}-{kind}-{}", material.name()));
        if !capture.join(FILE_NAME).is_file() {
            let piece = folder.join(format!("maps-{i:02}"));
            write_maps(&piece, &material.maps(&mut random)?, &MapsOptions::default())?;
            simulate(&piece, &capture, own, room)?;
        }
        captures[i / CAPTURES].push(capture);
    }
    Ok(captures)
}

/// Runs `svbrdf simulate`, located beside this program, for a board with the given `room` light or rectified.
fn simulate(maps: &Path, capture: &Path, seed: u64, room: Option<f32>) -> Result<()> {
    let own = std::env::current_exe().map_err(|e| Error::io("svbrdf-eval", e))?;
    let program = own.with_file_name(format!("svbrdf{}", std::env::consts::EXE_SUFFIX));
    let mut command = Command::new(&program);
    command.arg("simulate").arg(maps).arg("--out").arg(capture).arg("--real");
    for (option, value) in [("--frames", FRAMES), ("--held-out", HELD_OUT)] {
        command.arg(option).arg(value.to_string());
    }
    command.arg("--seed").arg(seed.to_string());
    match room {
        Some(share) => command.arg("--ambient").arg(share.to_string()),
        None => command.arg("--rectified"),
    };
    let done = command.output().map_err(|e| Error::io(&program, e))?;
    if done.status.success() {
        return Ok(());
    }
    let message = String::from_utf8_lossy(&done.stderr).trim().to_owned();
    Err(Error::argument("simulate", message))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names held out by `training/data.py`, and others.
    #[test]
    fn held_out_names_are_those_of_the_training() {
        let held_out = ["acg__metal021", "ez__ground03", "tjm__styrofoam004", "re-trak__tile2"];
        assert!(held_out.into_iter().all(is_held_out));
        let seen = ["acg__metal011", "ez__ground08", "tjm__fabric060", "re-trak__tile1"];
        assert!(!seen.into_iter().any(is_held_out));
    }
}
