//! Anything as a saved session; also with its length and checksums made right, or nearly nothing would get
//! past them. Inputs that begin with `EDIT` change a session with a photograph, which is too long for a seed.

use std::sync::{Arc, OnceLock};

use engine::Error;
use engine::capture::Capture;
use engine::networks::Networks;
use engine::session::{RestoreOptions, Scene, Session, Settings};

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    if let Some(edits) = data.strip_prefix(b"EDIT") {
        let mut bytes = example().to_vec();
        edits.chunks_exact(8).for_each(|edit| change(&mut bytes, edit));
        seal(&mut bytes);
        return restore(&bytes);
    }
    let mut sealed = data.to_vec();
    seal(&mut sealed);
    restore(data) | restore(&sealed)
}

fn networks() -> &'static Arc<Networks> {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    NETWORKS.get_or_init(|| Arc::new(Networks::embedded().expect("our own")))
}

/// A session with a photograph of a board that an unknown camera took.
fn example() -> &'static [u8] {
    static STATE: OnceLock<Vec<u8>> = OnceLock::new();
    STATE.get_or_init(|| {
        let tile = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/captures/tile");
        let tile = tile.replace("/fuzz/", "/");
        let Capture { mut scene, sample_mm, photos, .. } = Capture::load(tile).expect("an example");
        if let Scene::Board { camera, .. } = &mut scene {
            *camera = None;
        }
        let settings = Settings { sample_mm, threads: 1, ..Settings::default() };
        let session =
            Session::with_networks(scene, settings, networks().clone()).expect("a session");
        session.pause();
        let photo = photos[0].read().expect("a photograph");
        session.add_photo(&photo).expect("it is not cancelled");
        session.save().expect("it is not cancelled")
    })
}

/// One change: where (`u32`; near the beginning, which steers, for even kinds), its kind, three bytes.
fn change(bytes: &mut Vec<u8>, edit: &[u8]) {
    let (kind, value) = (edit[4], &edit[5..8]);
    let reach = if kind % 2 == 0 { bytes.len().min(1 << 15) } else { bytes.len() };
    let at = u32::from_le_bytes([edit[0], edit[1], edit[2], edit[3]]) as usize % reach.max(1);
    let end = (at + value.len()).min(bytes.len());
    match kind / 2 % 4 {
        0 => bytes[at..end].copy_from_slice(&value[..end - at]),
        1 => bytes[at..end].iter_mut().zip(value).for_each(|(byte, value)| *byte ^= value),
        2 => drop(bytes.drain(at..end)),
        _ => drop(bytes.splice(at..at, value.iter().copied())),
    }
}

fn restore(data: &[u8]) -> bool {
    let networks = networks();
    let (threads, memory_limit_bytes) = (Some(1), Some(1 << 30));
    let options = RestoreOptions { threads, memory_limit_bytes, ..Default::default() };
    match Session::restore(data, networks.clone(), options) {
        Ok(session) => {
            session.pause();
            assert_eq!(session.snapshot().is_ok(), session.progress().photos > 0);
            let again = session.save().expect("it is not cancelled");
            assert!(Session::restore(&again, networks.clone(), options).is_ok());
            true
        }
        Err(Error::State(_) | Error::MemoryLimit { .. }) => false,
        Err(other) => panic!("{other}"),
    }
}

/// Writes the right length and sums into the header.
fn seal(bytes: &mut [u8]) {
    const HEADER: usize = 26;
    if bytes.len() < HEADER {
        return;
    }
    let (header, content) = bytes.split_at_mut(HEADER);
    header[10..18].copy_from_slice(&(content.len() as u64).to_le_bytes());
    header[18..22].copy_from_slice(&crc32(content).to_le_bytes());
    let sum = crc32(&header[..22]).to_le_bytes();
    header[22..].copy_from_slice(&sum);
}

/// CRC-32 (IEEE 802.3), four bits at a time.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32| (0..4).fold(crc, |crc, _| (crc >> 1) ^ (0xEDB8_8320 * (crc & 1)));
    let table: [u32; 16] = std::array::from_fn(|i| step(i as u32));
    let half = |crc: u32| (crc >> 4) ^ table[(crc & 15) as usize];
    !bytes.iter().fold(u32::MAX, |crc, &byte| half(half(crc ^ u32::from(byte))))
}
