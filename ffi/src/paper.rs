//! The printed sheet and the sample's height.

use engine::session::Session;

use crate::status::{entry, svbrdf_status};
use crate::versioned::{self, defaults, versioned};

/// The printed sheet and the sample on it, as used. The print is as planned and the sample lies in the
/// board's plane, unless two or more photos clearly contradict that.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct svbrdf_paper {
    /// Size of this struct.
    pub size: usize,
    /// 1 when the other fields are known: in a session of a board.
    pub known: u32,
    /// 0.
    pub reserved: u32,
    /// Scale of the print along Y relative to that along X, which is as planned.
    pub aspect: f64,
    /// Its standard deviation.
    pub aspect_sigma: f64,
    /// Rise of the board's left and right edges above its middle, then of its upper and lower edges,
    /// mm.
    pub bow_mm: [f64; 2],
    /// Their standard deviations, mm.
    pub bow_sigma_mm: [f64; 2],
    /// Height of the sample's surface above the board's plane, mm.
    pub elevation_mm: f64,
    /// Its standard deviation, mm; 0 where the height was given.
    pub elevation_sigma_mm: f64,
}

defaults!(svbrdf_paper { aspect: 1.0 });
versioned!(svbrdf_paper, size_of::<svbrdf_paper>());

impl svbrdf_paper {
    pub(crate) fn of(session: &Session) -> Self {
        let (Some(sheet), Some(elevation)) = (session.paper(), session.elevation()) else {
            return Self::default();
        };
        let [aspect_sigma, x, y] = sheet.sigma;
        Self {
            known: 1,
            aspect: sheet.paper.aspect,
            aspect_sigma,
            bow_mm: sheet.paper.bow_mm,
            bow_sigma_mm: [x, y],
            elevation_mm: elevation.mm,
            elevation_sigma_mm: elevation.sigma_mm,
            ..Self::default()
        }
    }
}

/// Fills a paper with that of a plan: pass sizeof(svbrdf_paper).
///
/// # Safety
/// `paper` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn svbrdf_paper_init(paper: *mut svbrdf_paper, size: usize) -> svbrdf_status {
    // SAFETY: as the caller vouches.
    entry(|| unsafe { versioned::init(paper, size) })
}
