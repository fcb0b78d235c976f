//! Every stage of the path from a photograph to maps, with its counts of work.
//!
//! `cargo bench --bench stages [-- FILTER] [threads=N]`
//!
//! Counts are machine-independent; times (least and median of several runs) compare only within one
//! run. `MB` is the least amount of data that a stage must read and write; `calls`, `allocated` and
//! `largest` (MB) are the allocator's counts for one run. Photographs come from
//! `examples/captures/tile`; the 12-megapixel one is the first of them enlarged.

use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use svbrdf::Svbrdf;
use svbrdf::calibration::photometry::{FlashOffset, PhotometricCalibrator};
use svbrdf::calibration::{LumaImage, detect, estimate_pose};
use svbrdf::capture::Capture;
use svbrdf::estimate::Method;
use svbrdf::estimator::Estimator;
use svbrdf::networks::{Networks, Workspace};
use svbrdf::observation::Observation;
use svbrdf::photo::{Encoding, Photo, Plane, Rotation, YuvMatrix};
use svbrdf::rectification::rectify;
use svbrdf::render;
use svbrdf::session::{Scene, Session, Settings};
use svbrdf::svbrdf::CHANNELS;

#[path = "../tests/common/allocations.rs"]
mod allocations;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;

type Failure = Box<dyn Error + Send + Sync>;

const SIDE: usize = 256;
/// Number of photographs in the fits.
const PHOTOS: usize = 5;
/// Time limit per stage.
const STAGE_TIME: Duration = Duration::from_secs(2);
const MOST_RUNS: usize = 30;

/// Runs stages and prints one line for each.
struct Bench {
    filter: String,
}

/// Work of one run, if known: multiply-adds, bytes.
#[derive(Default)]
struct Work {
    multiply_adds: f64,
    bytes: f64,
}

impl Bench {
    fn run(&self, name: &str, work: Work, mut stage: impl FnMut()) {
        if !name.contains(&self.filter) {
            return;
        }
        stage();
        let allocations::Allocations { calls, bytes, largest } = allocations::during(&mut stage);
        let mut times = Vec::new();
        let begun = Instant::now();
        while times.len() < 3 || (begun.elapsed() < STAGE_TIME && times.len() < MOST_RUNS) {
            let start = Instant::now();
            stage();
            times.push(start.elapsed().as_secs_f64());
        }
        times.sort_by(f64::total_cmp);
        let count = |v: f64, scale: f64| match v {
            0.0 => "-".to_owned(),
            _ => format!("{:.3}", v / scale),
        };
        println!(
            "{name:<34} {:>9.2} {:>9.2} {:>8} {:>8} {:>8} {:>10.2} {:>8.2}",
            1e3 * times[0],
            1e3 * times[times.len() / 2],
            count(work.multiply_adds, 1e9),
            count(work.bytes, 1e6),
            calls,
            bytes as f64 / 1e6,
            largest as f64 / 1e6,
        );
    }
}

fn main() -> Result<(), Failure> {
    let mut filter = String::new();
    let mut threads = std::thread::available_parallelism().map_or(1, |n| n.get().min(4));
    for argument in std::env::args().skip(1).filter(|a| a != "--bench") {
        match argument.strip_prefix("threads=") {
            Some(n) => threads = n.parse()?,
            None => filter = argument,
        }
    }
    println!("{threads} threads, {SIDE}x{SIDE} texels");
    println!(
        "{:<34} {:>9} {:>9} {:>8} {:>8} {:>8} {:>10} {:>8}",
        "stage", "least ms", "median", "GMAC", "MB", "calls", "allocated", "largest"
    );
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
    pool.install(|| stages(&Bench { filter }, threads))
}

/// Probes of pictures, which are judged but not used; on one thread.
fn probes(
    bench: &Bench,
    capture: &Capture,
    networks: &Arc<Networks>,
    large: &Path,
) -> Result<(), Failure> {
    let picture = image::open(&capture.photos[0].path)?.to_rgb8();
    let wide = image::imageops::crop_imm(&picture, 0, 189, 2016, 1134).to_image();
    let filter = image::imageops::FilterType::CatmullRom;
    let preview = image::imageops::resize(&wide, 1280, 720, filter);
    let preview = Photo::from_rgb8(1280, 720, &preview, 3 * 1280, Encoding::Srgb, 1.0)?;
    let large = Photo::read(large, Encoding::Srgb, 1.0)?;
    let Scene::Board { target, flash_offset_mm, elevation_mm, .. } = capture.scene.clone() else {
        return Err("a board is expected".into());
    };
    let unknown = Scene::Board { target, camera: None, flash_offset_mm, elevation_mm };
    let settings = Settings { sample_mm: capture.sample_mm, ..Settings::default() };
    for (scene, what) in [(unknown, "camera unknown"), (capture.scene.clone(), "camera known")] {
        let session = Session::with_networks(scene, settings.clone(), networks.clone())?;
        session.pause();
        if what == "camera known" {
            for file in &capture.photos[..4] {
                session.add_photo(&file.read()?)?;
            }
        }
        for (photo, size) in [(&preview, "1280x720"), (&large, "12 megapixels")] {
            let probe = session.probe(photo)?;
            assert!(probe.rejection.is_none(), "{probe:?}");
            bench.run(&format!("probe {size}, {what}"), Work::default(), || {
                black_box(session.probe(photo)).expect("a good picture");
            });
        }
    }
    let (w, h) = (large.width() as usize, large.height() as usize);
    let bytes = vec![90_u8; 3 * w * h / 2];
    let (luma, chroma) = bytes.split_at(w * h);
    let plane = |data, row_stride, pixel_stride| Plane { data, row_stride, pixel_stride };
    bench.run("copy of YUV, 12 megapixels", Work::default(), || {
        let planes = [plane(luma, w, 1), plane(chroma, w, 2), plane(&chroma[1..], w, 2)];
        let (matrix, rotation) = (YuvMatrix::Bt601Full, Rotation::None);
        let size = [w as u32, h as u32];
        let photo = Photo::from_yuv420(size, planes, matrix, Encoding::Linear, rotation, 1.0);
        black_box(photo).expect("planes that fit");
    });
    Ok(())
}

fn stages(bench: &Bench, threads: usize) -> Result<(), Failure> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/captures/tile");
    let capture = Capture::load(&folder)?;
    let Scene::Board { target, camera: Some(camera), flash_offset_mm: Some(flash), .. } =
        capture.scene.clone()
    else {
        return Err("a board and a known camera are expected".into());
    };

    // A 12-megapixel photograph and its camera.
    let first = &capture.photos[0].path;
    let large = tempfile::Builder::new().suffix(".jpg").tempfile()?;
    let small = image::open(first)?.to_rgb8();
    let (w, h) = small.dimensions();
    let filter = image::imageops::FilterType::CatmullRom;
    image::imageops::resize(&small, 2 * w, 2 * h, filter).save(large.path())?;
    let mut large_camera = camera;
    (large_camera.width, large_camera.height) = (2 * w, 2 * h);
    (large_camera.fx, large_camera.fy) = (2.0 * camera.fx, 2.0 * camera.fy);
    (large_camera.cx, large_camera.cy) = (2.0 * camera.cx + 0.5, 2.0 * camera.cy + 0.5);

    for (path, camera, size) in
        [(first.as_path(), &camera, "3"), (large.path(), &large_camera, "12")]
    {
        let pixels = f64::from(camera.width) * f64::from(camera.height);
        let named = |stage: &str| format!("{stage}, {size} megapixels");
        let moved = |bytes: f64| Work { bytes: bytes * pixels, ..Work::default() };
        let read = || Photo::read(path, Encoding::Srgb, 1.0);
        let photo = read()?;
        bench.run(&named("decode"), moved(3.0), || drop(black_box(read())));
        bench.run(&named("linearise"), moved(3.0 + 4.0), || {
            black_box(LumaImage::from_photo(&photo));
        });
        let luma = LumaImage::from_photo(&photo);
        let detection = detect(&luma, &target)?;
        bench.run(&named("detect"), moved(4.0), || drop(black_box(detect(&luma, &target))));
        let pose = estimate_pose(camera, &target, &detection.corners)?.pose;
        bench.run(&named("pose"), Work::default(), || {
            let _ = black_box(estimate_pose(camera, &target, &detection.corners));
        });
        let calibrator = PhotometricCalibrator::new(target.clone(), FlashOffset::Known(flash));
        let radiometry = calibrator.clone().push(&photo, camera, &pose)?;
        bench.run(&named("photometry"), Work::default(), || {
            let _ = black_box(calibrator.clone().push(&photo, camera, &pose));
        });
        bench.run(&named("rectify"), moved(3.0), || {
            let sample = capture.sample_mm;
            let _ = black_box(rectify(&photo, camera, &pose, &radiometry, sample, SIDE, SIDE));
        });
    }

    let networks = Arc::new(Networks::embedded()?);
    probes(bench, &capture, &networks, large.path())?;
    let mut observations = Vec::new();
    let mut calibrator = PhotometricCalibrator::new(target.clone(), FlashOffset::Known(flash));
    for file in &capture.photos[..PHOTOS] {
        let photo = file.read()?;
        let corners = detect(&LumaImage::from_photo(&photo), &target)?.corners;
        let pose = estimate_pose(&camera, &target, &corners)?.pose;
        let radiometry = calibrator.push(&photo, &camera, &pose)?;
        let sample = capture.sample_mm;
        observations.push(rectify(&photo, &camera, &pose, &radiometry, sample, SIDE, SIDE)?);
    }
    networks_and_optimisers(bench, &networks, &observations)?;
    phases(bench, &networks, &observations)?;

    let photos: Vec<Photo> =
        capture.photos.iter().take(PHOTOS).map(|f| f.read()).collect::<Result<_, _>>()?;
    let settings = Settings { sample_mm: capture.sample_mm, threads, ..Settings::default() };
    let session =
        || Session::with_networks(capture.scene.clone(), settings.clone(), networks.clone());
    let photo = photos[0].clone();
    bench.run("push, first maps", Work::default(), || {
        let pushed = session().and_then(|s| s.add_photo(&photo));
        black_box(pushed).expect("a good photograph");
    });
    let fit = |photos: &[Photo]| -> Result<(), svbrdf::Error> {
        let session = session()?;
        for photo in photos {
            session.add_photo(photo)?;
            session.wait()?;
        }
        Ok(())
    };
    let named = format!("fit, {PHOTOS} photographs one by one");
    bench.run(&named, Work::default(), || fit(&photos).expect("good photographs"));
    let mut settled = None;
    bench.run("push until settled, fifth", Work::default(), || {
        let session = session().expect("good settings");
        for photo in &photos[..PHOTOS - 1] {
            session.add_photo(photo).expect("a good photograph");
        }
        session.wait().expect("a fit");
        let begun = Instant::now();
        session.add_photo(&photos[PHOTOS - 1]).expect("a good photograph");
        session.wait().expect("a fit");
        settled = Some(begun.elapsed().as_secs_f64());
    });
    if let Some(seconds) = settled {
        println!("of which the fifth photograph: {:.2} ms", 1e3 * seconds);
    }
    Ok(())
}

/// Number and mean time of the steps of each phase, for photographs added one by one.
fn phases(
    bench: &Bench,
    networks: &Arc<Networks>,
    observations: &[Observation],
) -> Result<(), Failure> {
    let name = "phases of an estimate";
    if !name.contains(&bench.filter) {
        return Ok(());
    }
    for free_lights in [false, true] {
        let lights = if free_lights { "lights corrected" } else { "lights given" };
        println!("{name}, {lights}: milliseconds of a step (steps), by photographs");
        let mut estimator = Estimator::new(networks.clone(), Method::Deep, true);
        estimator.correct_lights(free_lights);
        for (i, observation) in observations.iter().enumerate() {
            estimator.add(observation.clone())?;
            // Fraction done and time after each step.
            let mut course = Vec::new();
            let start = Instant::now();
            loop {
                let step = estimator.step()?;
                course.push([f64::from(step.fraction), start.elapsed().as_secs_f64()]);
                if step.done {
                    break;
                }
            }
            let total = start.elapsed().as_secs_f64();
            let of_left = |[fraction, elapsed]: &[f64; 2]| {
                elapsed * (1.0 / fraction - 1.0) / (total - elapsed)
            };
            let halfway = course.iter().filter(|[f, _]| (0.1..0.9).contains(f)).map(of_left);
            let shown_left: Vec<f64> = halfway.collect();
            let mean = shown_left.iter().sum::<f64>() / shown_left.len().max(1) as f64;
            let range = shown_left
                .iter()
                .fold([f64::MAX, 0.0], |[a, b]: [f64; 2], v| [a.min(*v), b.max(*v)]);
            let shown = estimator.reports().iter().map(|report| {
                let mean = report.milliseconds / report.steps.max(1) as f32;
                format!("{} {mean:.1} ({})", report.name, report.steps)
            });
            let shown = shown.collect::<Vec<_>>().join(", ");
            println!("{:>3}: {total:.2} s: {shown}", i + 1);
            println!(
                "     time left as shown, in units of what it was: {mean:.2} ({:.2} to {:.2})",
                range[0], range[1]
            );
        }
    }
    Ok(())
}

fn networks_and_optimisers(
    bench: &Bench,
    networks: &Networks,
    observations: &[Observation],
) -> Result<(), Failure> {
    let texels = (SIDE * SIDE) as f64;
    networks.prepare(SIDE, SIDE)?;
    bench.run("plans of photo network and encoder", Work::default(), || {
        // Parse the networks again, because plans are cached.
        let again = Networks::embedded().and_then(|n| n.prepare(SIDE, SIDE));
        black_box(again).expect("embedded networks");
    });
    let maps = networks.photo_maps(&observations[0])?;
    bench.run("photo network", Work::default(), || {
        let _ = black_box(networks.photo_maps(&observations[0]));
    });
    let code = networks.encode(&maps)?;
    bench.run("encoder", Work::default(), || drop(black_box(networks.encode(&maps))));

    let decoder = networks.decoder();
    let side = SIDE / decoder.stride();
    let mut workspace = Workspace::new(decoder, side, side)?;
    let multiply_adds = decoder.operations(side, side) as f64 / 2.0;
    bench.run("decoder", Work { multiply_adds, bytes: 0.0 }, || {
        let _ = black_box(decoder.forward(&code, &mut workspace));
    });
    let gradient = vec![1e-3; CHANNELS * SIDE * SIDE];
    let mut code_gradient = vec![0.0; code.len()];
    bench.run("decoder, VJP", Work { multiply_adds, bytes: 0.0 }, || {
        let _ = black_box(decoder.vjp(&mut workspace, &gradient, &mut code_gradient));
    });

    let mut gradient = gradient;
    let planes = |frames: usize, maps: usize| Work {
        multiply_adds: 0.0,
        bytes: 4.0 * texels * (4 * frames + CHANNELS * maps) as f64,
    };
    bench.run("render + loss + adjoint, 5 photos", planes(PHOTOS, 2), || {
        black_box(render::loss_and_gradient(&maps, observations, &mut gradient));
    });
    let coarse: Svbrdf = maps.downsampled();
    bench.run("maps doubled", planes(0, 1), || drop(black_box(coarse.upsampled())));
    Ok(())
}
