//! The viewer's shader.

use std::f32::consts::PI;

use svbrdf::reflectance::{
    COAT_F0, FRESNEL, MIN_COSINE, SHEEN_ALBEDO, SHEEN_MAX_ALBEDO, SHEEN_MIN_SIN2,
};
use svbrdf::svbrdf::{MIN_ROUGHNESS, MIN_SHEEN_ROUGHNESS};

/// The reflection of `svbrdf::reflectance` in GLSL, its constants missing.
const SOURCE: &str = include_str!("reflection.glsl");

/// The fragment shader, with the constants of the library.
pub fn fragment() -> String {
    let constants = [
        ("PI", PI),
        ("MIN_COSINE", MIN_COSINE),
        ("MIN_ROUGHNESS", MIN_ROUGHNESS),
        ("FRESNEL_A", FRESNEL[0]),
        ("FRESNEL_B", FRESNEL[1]),
        ("COAT_F0", COAT_F0),
        ("MIN_SHEEN_ROUGHNESS", MIN_SHEEN_ROUGHNESS),
        ("SHEEN_MIN_SIN2", SHEEN_MIN_SIN2),
        ("SHEEN_MAX_ALBEDO", SHEEN_MAX_ALBEDO),
    ]
    .map(|(name, value)| format!("const float {name} = {value:?};\n"));
    let [top, bottom] = SHEEN_ALBEDO;
    let vectors = [("SHEEN_TOP", top), ("SHEEN_BOTTOM", bottom)].map(|(name, factors)| {
        let [one, c, r, cr, cc, rr] = factors;
        format!(
            "const vec3 {name} = vec3({one:?}, {c:?}, {r:?});\n\
             const vec3 {name}_SQUARES = vec3({cr:?}, {cc:?}, {rr:?});\n"
        )
    });
    SOURCE.replacen("// {{constants}}\n", &(constants.concat() + &vectors.concat()), 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant that the page states itself could differ from the library's one day.
    #[test]
    fn constants_are_the_librarys_and_stated_once() {
        let shader = fragment();
        for line in [
            "const float MIN_COSINE = 0.001;",
            "const float MIN_ROUGHNESS = 0.02;",
            "const float FRESNEL_A = -5.55473;",
            "const float FRESNEL_B = -6.98316;",
            "const float COAT_F0 = 0.04;",
            "const float MIN_SHEEN_ROUGHNESS = 0.07;",
            "const float SHEEN_MIN_SIN2 = 0.0078125;",
        ] {
            assert_eq!(shader.matches(line).count(), 1, "{line}");
        }
        for number in ["0.001", "1e-3", "0.02", "5.55", "6.98", "3.14", "0.04", "0.07", "0.0078"] {
            assert!(!SOURCE.contains(number), "{number} is the library's to say");
        }
        assert!(!shader.contains("{{"));
    }
}
