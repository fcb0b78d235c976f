//! Anything as a saved session; also with its length and checksums made right, or nearly nothing would get
//! past them.

use std::sync::{Arc, OnceLock};

use engine::Error;
use engine::initial_estimate::Networks;
use engine::session::{RestoreOptions, Session};

/// Whether something was made of it.
pub fn run(data: &[u8]) -> bool {
    let mut sealed = data.to_vec();
    seal(&mut sealed);
    restore(data) | restore(&sealed)
}

fn restore(data: &[u8]) -> bool {
    static NETWORKS: OnceLock<Arc<Networks>> = OnceLock::new();
    let networks = NETWORKS.get_or_init(|| Arc::new(Networks::embedded().expect("our own")));
    let (threads, memory_limit_bytes) = (Some(1), Some(1 << 30));
    let options = RestoreOptions { threads, memory_limit_bytes, ..Default::default() };
    match Session::restore(data, networks.clone(), options) {
        Ok(session) => {
            session.pause();
            assert_eq!(session.snapshot().is_ok(), session.progress().frames > 0);
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
