//! Hints about light and pixel values, from the squares of the board.

use crate::calibration::photometry::{
    Examination, LitPlaces, Photometry, Squares, edited, examine,
};
use crate::geometry::Pose;
use crate::session::advice;
use crate::session::capture::Board;
use crate::session::hint::Hint;

/// Least gain of a hint: logarithm, and standard deviations.
const GAIN_LOG: f64 = 0.3;
const GAIN_SIGMAS: f64 = 4.0;
/// Least veil of a hint.
const VEIL: f64 = 0.01;
/// Least exponent of local tone mapping of a hint.
const LOCAL: f64 = 0.03;

/// Adds the hints about each photograph.
pub(super) fn tell(board: &Board, hints: &mut [Vec<Hint>]) {
    let Some(known) = &board.photometry else { return };
    let photos: Vec<(Pose, &Squares)> =
        board.photographs.iter().map(|p| (p.pose, &p.measured.squares)).collect();
    let found = examine(&board.target, &photos, known);
    for (i, hints) in hints.iter_mut().enumerate() {
        let squares = photos[i].1;
        let light = found.photos[i];
        let others = photos.iter().map(|photo| photo.1);
        let edited = edited(squares, others, &board.target, &known.tone);
        let edited = edited.map(|[black, usual]| Hint::Edited { black, usual });
        // Stripes fixed to the board are not flicker.
        let stripes = light.stripes.filter(|_| found.lit_places.is_none());
        let stripes = stripes.map(|amplitude| Hint::Flickers { amplitude: amplitude as f32 });
        // Glare and stretched contrast change black as a tone curve does.
        let curved = advice::linearity(squares, &board.target, known)
            .filter(|_| edited.is_none() && found.glare.is_none());
        hints.extend(edited.into_iter().chain(stripes).chain(curved));
        hints.extend(of_photo(known, i).into_iter().chain(of_all(board, known, &found)));
    }
}

/// Hints about one photograph's brightness and orientation.
fn of_photo(known: &Photometry, index: usize) -> Vec<Hint> {
    let [log, sigma] = known.log_gain[index];
    let differs = log.abs() > GAIN_LOG.max(GAIN_SIGMAS * sigma);
    let exposure = differs.then(|| Hint::Exposure { ratio: log.exp() as f32 });
    exposure.into_iter().chain(known.turned[index].then_some(Hint::Turned)).collect()
}

/// Hints about all photographs.
fn of_all(board: &Board, known: &Photometry, found: &Examination) -> Vec<Hint> {
    let stays = found.stands_still.map(|times| Hint::LightStays { times: times as f32 });
    let glare = found.glare.map(|share| Hint::GlossyBoard { share: share as f32 });
    let size = board.target.square_mm;
    let [width, height] = [board.target.cols, board.target.rows].map(|n| f64::from(n) * size);
    // Light on a part of the board resembles a veil.
    let veil = (known.veil > VEIL && found.lit_places.is_none())
        .then_some(Hint::Veiled { share: known.veil as f32 });
    // A fixed light also explains lit places.
    let lit = found.lit_places.filter(|_| stays.is_none());
    let lit = lit.map(|LitPlaces { share, ratio, board_mm, .. }| Hint::OtherLight {
        share: share as f32,
        ratio: ratio as f32,
        centre: [(0.5 + board_mm.x / width) as f32, (0.5 - board_mm.y / height) as f32],
    });
    // Glare and lamps resemble local tone mapping.
    let lamp = stays.is_some() || found.lit_places.is_some_and(|places| places.smooth);
    let local = known.local_tone.abs() > LOCAL && found.glare.is_none() && !lamp;
    let local = local.then_some(Hint::LocalTone { exponent: known.local_tone as f32 });
    veil.into_iter().chain(local).chain(stays).chain(lit).chain(glare).collect()
}
