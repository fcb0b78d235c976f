//! Figures of a fit, ready to be read.

use serde_json::{Value, json};
use svbrdf::Svbrdf;
use svbrdf::comparison::{delta_e_2000, lab};
use svbrdf::session::Scene;

use super::subject::Subject;

/// A group of figures.
fn group(title: &str, rows: Vec<Option<(&str, String)>>) -> Option<Value> {
    let rows: Vec<Value> = rows.into_iter().flatten().map(|(k, v)| json!([k, v])).collect();
    (!rows.is_empty()).then(|| json!({ "title": title, "rows": rows }))
}

/// Short facts for the head of the page.
pub fn summary(subject: &Subject) -> Vec<String> {
    let rows = subject.report["frames"].as_array().map_or(0, Vec::len);
    let fitted = count(subject, |r| r["status"] == "accepted" && r["held_out"] != true);
    let [w, h] = subject.capture.sample_mm;
    let photographs =
        if fitted == rows { plural(fitted) } else { format!("{fitted} of {}", plural(rows)) };
    let seconds = subject.report["seconds_total"].as_f64().unwrap_or(0.0);
    vec![
        photographs,
        format!("{} × {} texels", subject.maps.width(), subject.maps.height()),
        format!("{w:.0} × {h:.0} mm"),
        format!("{seconds:.1} s"),
    ]
}

fn plural(photographs: usize) -> String {
    if photographs == 1 { "1 photograph".into() } else { format!("{photographs} photographs") }
}

fn count(subject: &Subject, which: impl Fn(&Value) -> bool) -> usize {
    subject.report["frames"].as_array().into_iter().flatten().filter(|r| which(r)).count()
}

/// All groups that apply.
pub fn figures(subject: &Subject) -> Vec<Value> {
    let groups = [
        capture(subject),
        material(subject),
        uncertainty(subject),
        camera(subject),
        light(subject),
        sheet(subject),
    ];
    groups.into_iter().flatten().collect()
}

fn capture(subject: &Subject) -> Option<Value> {
    let report = subject.report;
    let [w, h] = subject.capture.sample_mm;
    let texel = w / subject.maps.width() as f32;
    let held_out = count(subject, |r| r["held_out"] == true);
    let fitted = count(subject, |r| r["status"] == "accepted") - held_out;
    let rejected = count(subject, |r| r["status"] == "rejected");
    let method = if report["method"] == "classic" {
        "inverse rendering"
    } else {
        "latent code + refinement"
    };
    let losses = report["frames"].as_array().into_iter().flatten();
    let loss = losses.filter_map(|r| r["loss_after"].as_f64()).next_back();
    group(
        "Capture",
        vec![
            Some((
                "Photographs",
                format!("{fitted} fitted, {held_out} held out, {rejected} rejected"),
            )),
            Some(("Sample", format!("{w:.1} × {h:.1} mm"))),
            Some(("Texel", format!("{texel:.3} mm"))),
            Some(("Method", method.into())),
            loss.map(|v| ("Residual", format!("{v:.4} (mean |Δ log|)"))),
            report["seconds_total"].as_f64().map(|v| ("Time", format!("{v:.1} s"))),
            report["peak_memory_mib"].as_f64().map(|v| ("Peak memory", format!("{v:.0} MiB"))),
        ],
    )
}

fn material(subject: &Subject) -> Option<Value> {
    let maps = subject.maps;
    let n = maps.texels() as f32;
    let colour = |planes: [&[f32]; 3]| {
        let [r, g, b] = planes.map(|plane| plane.iter().sum::<f32>() / n);
        format!("{r:.3}, {g:.3}, {b:.3}")
    };
    let [x, y] = maps.normal_slopes();
    let tilt = x.iter().zip(y).map(|(p, q)| p.hypot(*q).atan().to_degrees()).sum::<f32>() / n;
    let mut roughness = maps.roughness().to_vec();
    roughness.sort_by(f32::total_cmp);
    let at = |share: f32| roughness[((roughness.len() - 1) as f32 * share) as usize];
    group(
        "Material",
        vec![
            Some(("Mean diffuse", colour(maps.diffuse()))),
            Some(("Mean F0", colour(maps.specular()))),
            Some(("Roughness", format!("{:.2} ({:.2} to {:.2})", at(0.5), at(0.05), at(0.95)))),
            Some(("Mean tilt of normals", format!("{tilt:.1}°"))),
            maps.anisotropy().map(|planes| ("Anisotropy", anisotropy(planes))),
            maps.coat().map(|planes| ("Coat", coat(planes))),
            maps.sheen().map(|[r, g, b, roughness]| {
                ("Sheen", {
                    let weights: Vec<f32> = (0..r.len()).map(|i| r[i] + g[i] + b[i]).collect();
                    let sum = weights.iter().sum::<f32>();
                    let weighted = weights.iter().zip(roughness).map(|(w, r)| w * r).sum::<f32>();
                    format!("{}, roughness {:.2}", colour([r, g, b]), weighted / sum)
                })
            }),
        ],
    )
}

/// Ratio of both alphas in the mean, and the direction, where there is one for most texels.
fn anisotropy([x, y]: [&[f32]; 2]) -> String {
    let mean = |value: &dyn Fn(f32, f32) -> f32| {
        x.iter().zip(y).map(|(x, y)| value(*x, *y)).sum::<f32>() / x.len() as f32
    };
    let size = mean(&f32::hypot);
    let (x, y) = (mean(&|x, _| x), mean(&|_, y| y));
    let direction = if x.hypot(y) > 0.7 * size {
        format!("wider along {:.0}°", 0.5 * y.atan2(x).to_degrees())
    } else {
        "in several directions".into()
    };
    format!("{:.1} : 1, {direction}", size.exp())
}

/// Mean weight of a coat, and its mean roughness by weight.
fn coat([weight, roughness]: [&[f32]; 2]) -> String {
    let sum = weight.iter().sum::<f32>();
    let weighted = weight.iter().zip(roughness).map(|(w, r)| w * r).sum::<f32>();
    format!("weight {:.2}, roughness {:.2}", sum / weight.len() as f32, weighted / sum)
}

/// How far the maps may be off.
fn uncertainty(subject: &Subject) -> Option<Value> {
    let of = |map: &str| subject.report["confidence"][map].as_f64();
    let pair = |lobe: &str| {
        let text = format!("{:.2}, roughness {:.2}", of(lobe)?, of(&format!("{lobe}_roughness"))?);
        Some(text)
    };
    // Mean angle of two tilts with this deviation.
    let angle = |v: f64| (v * (0.5 * std::f64::consts::PI).sqrt()).atan().to_degrees();
    group(
        "Standard deviations",
        vec![
            of("normal").map(|v| {
                let each = v.atan().to_degrees();
                ("Normal, each tilt", format!("{each:.1}° (mean angle {:.1}°)", angle(v)))
            }),
            of("diffuse")
                .map(|v| ("Diffuse", format!("{v:.3} (ΔE00 {:.1})", brighter(subject.maps, v)))),
            of("specular").map(|v| ("F0", format!("{v:.3}"))),
            of("roughness").map(|v| ("Roughness", format!("{v:.3}"))),
            of("anisotropy").map(|v| ("Anisotropy, each ln ratio", format!("{v:.2}"))),
            pair("coat").map(|text| ("Coat", text)),
            pair("sheen").map(|text| ("Sheen", text)),
        ],
    )
}

/// CIEDE2000 of the mean diffuse albedo and one that is brighter by so much.
fn brighter(maps: &Svbrdf, by: f64) -> f64 {
    let mean = |c: usize| {
        let plane = maps.diffuse()[c];
        plane.iter().map(|v| f64::from(*v)).sum::<f64>() / plane.len() as f64
    };
    let colour = [0, 1, 2].map(mean);
    delta_e_2000(lab(colour), lab(colour.map(|v| v + by)))
}

fn camera(subject: &Subject) -> Option<Value> {
    let camera = subject.camera?;
    let given = matches!(subject.capture.scene, Scene::Board { camera: Some(_), .. });
    let sigma = &subject.report["camera_uncertainty"];
    let number = |key: &str, value: f64| match sigma[key].as_f64() {
        Some(s) => format!("{value:.1} ± {s:.1} px"),
        None => format!("{value:.1} px"),
    };
    let distortion: Vec<String> = camera.distortion.iter().map(|v| format!("{v:.4}")).collect();
    group(
        "Camera",
        vec![
            Some(("Intrinsics", if given { "given" } else { "estimated" }.into())),
            Some(("Picture", format!("{} × {} px", camera.width, camera.height))),
            Some(("fx", number("fx", camera.fx))),
            Some(("fy", number("fy", camera.fy))),
            Some(("cx", number("cx", camera.cx))),
            Some(("cy", number("cy", camera.cy))),
            Some(("k1, k2, p1, p2, k3", distortion.join(", "))),
        ],
    )
}

fn light(subject: &Subject) -> Option<Value> {
    let report = subject.report;
    let offset: Option<[f64; 3]> =
        serde_json::from_value(report["flash"]["offset_mm"].clone()).ok();
    let correction: Option<[f64; 3]> =
        serde_json::from_value(report["light"]["offset_mm"].clone()).ok();
    let mm = |[x, y, z]: [f64; 3]| format!("{x:.1}, {y:.1}, {z:.1} mm");
    group(
        "Light",
        vec![
            offset.map(|o| ("Flash beside the lens", mm(o))),
            correction.map(|o| ("Correction of positions", mm(o))),
            report["light"]["exposure_exponent"]
                .as_f64()
                .map(|v| ("Exposure with distance", format!("d^{v:.2}"))),
            report["ambient_fraction"]
                .as_f64()
                .map(|v| ("Room light", format!("{:.1} % of the flash", 100.0 * v))),
        ],
    )
}

fn sheet(subject: &Subject) -> Option<Value> {
    let report = subject.report;
    let (paper, elevation) = (&report["paper"], &report["elevation"]);
    let stretch = paper["aspect"].as_f64().map(|v| {
        let sigma = paper["aspect_sigma"].as_f64().unwrap_or(0.0);
        ("Stretch, Y against X", format!("{:+.2} ± {:.2} %", 100.0 * (v - 1.0), 100.0 * sigma))
    });
    let bow: Option<Vec<f64>> = serde_json::from_value(paper["bow_mm"].clone()).ok();
    let bow = bow.map(|v| {
        let all: Vec<String> = v.iter().map(|v| format!("{v:.2}")).collect();
        ("Rise of the edges", format!("{} mm", all.join(", ")))
    });
    let height = elevation["mm"].as_f64().map(|v| {
        let sigma = elevation["sigma_mm"].as_f64().filter(|s| s.is_finite() && *s > 0.0);
        let sigma = sigma.map_or(String::new(), |s| format!(" ± {s:.2}"));
        ("Sample above the board", format!("{v:.2}{sigma} mm"))
    });
    group("Board", vec![stretch, bow, height])
}
