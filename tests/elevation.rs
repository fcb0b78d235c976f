//! Rendered captures of samples that stick out of the board's hole.

#[path = "common/raised.rs"]
mod raised;
#[path = "common/test_data.rs"]
mod test_data;

use std::path::PathBuf;
use std::sync::Arc;

use raised::{FLASH_MM, Material, SAMPLE_MM, camera, maps, photograph, poses};
use test_data::test_data;

use svbrdf::Svbrdf;
use svbrdf::calibration::Target;
use svbrdf::capture::Capture;
use svbrdf::comparison::compare;
use svbrdf::export::{read_maps, resized};
use svbrdf::networks::Networks;
use svbrdf::photo::Photo;
use svbrdf::session::{Method, Outcome, RestoreOptions, Scene, Session, Settings};

const ALL: [Material; 5] =
    [Material::Tiles, Material::Leather, Material::Marble, Material::Plaster, Material::Plain];

fn session(elevation_mm: Option<f64>, method: Method) -> Session {
    let scene = Scene::Board {
        target: Target::default(),
        camera: Some(camera()),
        flash_offset_mm: Some(FLASH_MM),
        elevation_mm,
    };
    let settings = Settings { sample_mm: [SAMPLE_MM as f32; 2], method, ..Settings::default() };
    Session::new(scene, settings).unwrap()
}

/// A session that only calibrates.
fn calibrating(elevation_mm: Option<f64>) -> Session {
    let session = session(elevation_mm, Method::Classic);
    session.pause();
    session
}

fn push(session: &Session, photo: &Photo) {
    let outcome = session.add_photo(photo).unwrap();
    assert!(matches!(outcome, Outcome::Accepted(_)), "{outcome:?}");
}

fn photos(maps: &Svbrdf, elevation_mm: f64, count: u32) -> Vec<Photo> {
    let photo = |(k, pose)| photograph(maps, pose, elevation_mm, 20 + k as u64);
    poses(count, 3).iter().enumerate().map(photo).collect()
}

#[test]
fn a_raised_sample_is_measured_and_seen_from_its_own_height() {
    let leather = maps(Material::Leather, 512);
    let photos = photos(&leather, 2.0, 3);
    let (measured, stated) = (calibrating(None), calibrating(Some(2.0)));
    for photo in &photos {
        push(&measured, photo);
        push(&stated, photo);
    }
    let found = measured.elevation().unwrap();
    // 0.02 mm are a twentieth of a texel at 45 degrees.
    assert!((found.mm - 2.0).abs() < 0.02 && found.sigma_mm < 0.05, "{found:?}");
    assert_eq!(stated.elevation().unwrap().mm, 2.0);
    assert_eq!(measured.poses(), stated.poses());
    // The sample's height goes on with a saved session.
    let networks = Arc::new(Networks::embedded().unwrap());
    for session in [&measured, &stated] {
        let saved = session.save().unwrap();
        let restored = Session::restore(&saved, networks.clone(), RestoreOptions::default());
        let restored = restored.unwrap();
        assert_eq!(restored.elevation(), session.elevation());
        assert_eq!(restored.scene(), session.scene());
    }
}

#[test]
fn samples_in_the_plane_and_plain_ones_stay_there() {
    for (material, mm) in [(Material::Tiles, 0.0), (Material::Plain, 2.0)] {
        let session = calibrating(None);
        for photo in photos(&maps(material, 256), mm, 3) {
            push(&session, &photo);
            assert_eq!(session.elevation().unwrap().mm, 0.0, "{material:?}");
        }
    }
}

#[test]
fn a_saved_session_goes_on_to_the_same_height() {
    let photos = photos(&maps(Material::Marble, 512), 1.0, 4);
    let (whole, halved) = (calibrating(None), calibrating(None));
    photos.iter().for_each(|photo| push(&whole, photo));
    photos[..3].iter().for_each(|photo| push(&halved, photo));
    let networks = Arc::new(Networks::embedded().unwrap());
    let saved = halved.save().unwrap();
    let restored = Session::restore(&saved, networks, RestoreOptions::default()).unwrap();
    restored.pause();
    push(&restored, &photos[3]);
    assert_eq!(restored.elevation(), whole.elevation());
}

#[test]
fn samples_of_the_test_data_lie_in_the_plane() {
    let Some(root) = test_data("captures/dev") else { return };
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(root).unwrap().map(|e| e.unwrap().path()).collect();
    folders.sort();
    for folder in folders {
        let capture = Capture::load(&folder).unwrap();
        let settings = Settings {
            sample_mm: capture.sample_mm,
            method: Method::Classic,
            ..Settings::default()
        };
        let session = Session::new(capture.scene.clone(), settings).unwrap();
        session.pause();
        let mut seen = String::new();
        for file in &capture.photos {
            push(&session, &file.read().unwrap());
            let e = session.elevation().unwrap();
            seen += &format!(" {:.2} +- {:.3}", e.mm, e.sigma_mm);
            assert_eq!(e.mm, 0.0, "{}", folder.display());
        }
        println!("{}:{seen}", folder.display());
    }
}

/// All materials, the test data's truths among them.
fn samples() -> Vec<(String, Svbrdf)> {
    let made = ALL.iter().map(|m| (format!("{m:?}").to_lowercase(), maps(*m, 512)));
    let mut all: Vec<(String, Svbrdf)> = made.collect();
    let Some(root) = test_data("captures/dev") else { return all };
    for name in ["bricks-charuco", "leather", "metal-charuco-ambient5", "tile"] {
        all.push((format!("data {name}"), read_maps(root.join(name).join("truth")).unwrap()));
    }
    all
}

/// `ELEVATION_MM` names heights, by default 0, 1, 2, 5 and 10.
#[test]
#[ignore = "a study of some minutes"]
fn heights_of_many_materials() {
    let heights = std::env::var("ELEVATION_MM").unwrap_or("0,1,2,5,10".into());
    println!("material                 truth     after 2 photographs, 4, 8: height +- sigma, mm");
    for (name, maps) in samples() {
        for mm in heights.split(',').map(|v| v.parse().unwrap()) {
            let session = calibrating(None);
            let mut row = format!("{name:24} {mm:5.1}");
            for (k, photo) in photos(&maps, mm, 8).iter().enumerate() {
                push(&session, photo);
                if [1, 3, 7].contains(&k) {
                    let found = session.elevation().unwrap();
                    row += &format!("   {:7.3} +- {:.3}", found.mm, found.sigma_mm);
                }
            }
            println!("{row}");
        }
    }
}

#[test]
#[ignore = "a study of some minutes"]
fn maps_of_a_raised_sample() {
    println!("photos  taken as  height   render  normal  diffuse specular roughness");
    for (name, truth) in samples() {
        if !["leather", "data tile"].contains(&name.as_str()) {
            continue;
        }
        let photos = photos(&truth, 5.0, 4);
        let truth = resized(&truth, 256, 256);
        for (how, given) in [("in plane", Some(0.0)), ("measured", None), ("stated", Some(5.0))] {
            let session = session(given, Method::Deep);
            for (k, photo) in photos.iter().enumerate() {
                push(&session, photo);
                session.wait().unwrap();
                if [1, 3].contains(&k) {
                    let d = compare(&session.snapshot().unwrap(), &truth).unwrap();
                    println!(
                        "{name} {} {how:9} {:6.2}   {:.4}  {:.4}  {:.4}  {:.4}  {:.4}",
                        k + 1,
                        session.elevation().unwrap().mm,
                        d.render,
                        d.normal,
                        d.diffuse,
                        d.specular,
                        d.roughness
                    );
                }
            }
        }
    }
}
