//! Hashes of the maps' bits, which must be equal before and after a refactoring, and for any number
//! of threads.

use std::path::PathBuf;

use svbrdf::capture::Capture;
use svbrdf::estimate::Method;
use svbrdf::{Error, Result, Svbrdf};

use crate::experiments::seed;
use crate::protocol::{self, Conditions, photographs};
use crate::streaming::{Setup, Variant, capture_folders, name, push};

/// Arguments of `svbrdf-eval hashes`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Captures, or folders of captures
    captures: Vec<PathBuf>,
    /// Folder of known materials, three of which are photographed synthetically as well
    #[arg(long, value_name = "DIR")]
    materials: Option<PathBuf>,
    /// Numbers of accepted photographs of captures
    #[arg(long, value_delimiter = ',', default_value = "1,2,4,8")]
    photos: Vec<usize>,
    /// Numbers of photographs of materials
    #[arg(long, value_delimiter = ',', default_value = "1,2,5")]
    material_photos: Vec<usize>,
    /// Use the captures and materials whose names contain this only
    #[arg(long)]
    only: Option<String>,
    /// Texels along each side of the maps of captures
    #[arg(long, default_value_t = 256)]
    resolution: usize,
}

/// Materials used: the first, the middle and the last of the selected ones.
const MATERIALS: usize = 3;

/// 64-bit FNV-1a over the bits of all planes, lobes last, little-endian.
fn hash(maps: &Svbrdf) -> u64 {
    let values = maps.planes().iter().chain(maps.lobes());
    fnv1a(values.flat_map(|v| v.to_bits().to_le_bytes()))
}

/// Offset basis and prime of the published function.
fn fnv1a(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

fn print(case: &str, photos: usize, threads: usize, maps: &Svbrdf) {
    let plural = |n: usize| if n == 1 { "" } else { "s" };
    println!(
        "{case:<48} {photos} photograph{} {threads} thread{} {:016x}",
        plural(photos),
        plural(threads),
        hash(maps)
    );
}

/// Runs the command for each number of threads.
pub fn run(arguments: &Arguments, setup: &Setup, threads: &[usize]) -> Result<()> {
    if arguments.captures.is_empty() && arguments.materials.is_none() {
        return Err(Error::argument("captures", "captures or --materials expected"));
    }
    let chosen = |name: &str| arguments.only.as_ref().is_none_or(|part| name.contains(part));
    for &threads in threads {
        let setup = Setup { threads, resolution: arguments.resolution, ..setup.clone() };
        for folder in capture_folders(&arguments.captures)? {
            if chosen(&name(&folder)) {
                capture(&folder, arguments, &setup)?;
            }
        }
        if let Some(folder) = &arguments.materials {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .map_err(|e| Error::Internal(format!("no threads: {e}")))?;
            pool.install(|| materials(folder.clone(), arguments, &setup))?;
        }
    }
    Ok(())
}

fn capture(folder: &std::path::Path, arguments: &Arguments, setup: &Setup) -> Result<()> {
    let capture = Capture::load(folder)?;
    let session = setup.session(&capture, Variant::Deep)?;
    let mut accepted = 0;
    for file in &capture.photos {
        if let Some(reason) = push(&session, file)? {
            println!("{}: {reason}", file.path.display());
            continue;
        }
        session.wait()?;
        accepted += 1;
        if arguments.photos.contains(&accepted) {
            print(&name(folder), accepted, setup.threads, &*session.snapshot()?);
        }
        if arguments.photos.iter().all(|&n| n <= accepted) {
            break;
        }
    }
    Ok(())
}

fn materials(folder: PathBuf, arguments: &Arguments, setup: &Setup) -> Result<()> {
    let selection = protocol::Arguments { only: arguments.only.clone(), ..folder.into() };
    let crops = protocol::crops(&selection)?;
    let last = crops.len() - 1;
    let mut taken: Vec<usize> = (0..MATERIALS).map(|i| i * last / (MATERIALS - 1)).collect();
    taken.dedup();
    let most = arguments.material_photos.iter().copied().max().unwrap_or(0);
    for index in taken {
        let crop = &crops[index];
        let observations = photographs(&crop.truth, most, seed(index), &Conditions::new(0.0));
        let mut estimator = setup.estimator(Method::Deep, true);
        for observation in observations {
            estimator.add(observation)?;
            let maps = estimator.settle()?;
            if arguments.material_photos.contains(&estimator.photos()) {
                print(&crop.name, estimator.photos(), setup.threads, &maps);
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published values.
    #[test]
    fn hashes_are_those_of_fnv_1a() {
        for (text, expected) in [
            ("", 0xcbf2_9ce4_8422_2325),
            ("a", 0xaf63_dc4c_8601_ec8c),
            ("foobar", 0x8594_4171_f739_67e8),
        ] {
            assert_eq!(fnv1a(text.bytes()), expected, "{text}");
        }
    }

    #[test]
    fn one_bit_changes_the_hash() {
        let maps = Svbrdf::new(4, 4);
        let mut other = maps.clone();
        other.planes_mut()[143] = f32::from_bits(other.planes()[143].to_bits() ^ 1);
        assert_eq!(hash(&maps), hash(&maps.clone()));
        assert_ne!(hash(&maps), hash(&other));
    }
}
