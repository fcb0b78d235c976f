//! A small deterministic stand-in for a fuzzer, for machines without one: changed seeds.

use std::path::Path;

/// Runs every file of a folder as it is, then `count` changed ones. Of how many something was made;
/// that has to be so of all that are unchanged.
pub fn each(
    folder: &Path,
    count: usize,
    tokens: &[&[u8]],
    mut run: impl FnMut(&[u8]) -> bool,
) -> usize {
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .unwrap_or_else(|e| panic!("{}: {e}", folder.display()))
        .map(|entry| entry.expect("a seed").path())
        .collect();
    paths.sort();
    let seeds: Vec<Vec<u8>> = paths.iter().map(|p| std::fs::read(p).expect("a seed")).collect();
    assert!(!seeds.is_empty(), "{} has no seeds", folder.display());
    for (seed, path) in seeds.iter().zip(&paths) {
        assert!(run(seed), "{} is no good seed", path.display());
    }
    let mut good = seeds.len();
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for _ in 0..count {
        let mut data = seeds[random.below(seeds.len())].clone();
        for _ in 0..1 + random.below(4) {
            change(&mut data, &seeds, tokens, &mut random);
        }
        good += usize::from(run(&data));
    }
    println!("{}: {good} of {} made something", folder.display(), seeds.len() + count);
    good
}

fn change(data: &mut Vec<u8>, seeds: &[Vec<u8>], tokens: &[&[u8]], random: &mut Random) {
    let at = random.below(data.len() + 1);
    let length = random.below(16).min(data.len() - at);
    match random.below(8) {
        0 if at < data.len() => data[at] ^= 1 << random.below(8),
        1 if at < data.len() => data[at] = [0, 1, 0x7F, 0x80, 0xFE, 0xFF][random.below(6)],
        2 => data.truncate(at),
        3 => drop(data.drain(at..at + length)),
        4 => {
            let again = data[at..at + length].to_vec();
            data.splice(at..at, again);
        }
        5 if !tokens.is_empty() => {
            let token = tokens[random.below(tokens.len())];
            data.splice(at..at + length, token.iter().copied());
        }
        6 => {
            let other = &seeds[random.below(seeds.len())];
            let from = random.below(other.len() + 1);
            data.truncate(at);
            data.extend_from_slice(&other[from..]);
        }
        _ => {
            let noise: Vec<u8> =
                (0..1 + random.below(8)).map(|_| random.below(256) as u8).collect();
            data.splice(at..at, noise);
        }
    }
}

/// Xorshift.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 16) % limit as u64) as usize
    }
}
