//! The page put together from its parts.

use serde_json::{Value, json};

use super::pictures::Snapshot;
use super::shader;
use crate::failure::{Failure, Result};

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("style.css");
const SCRIPTS: [&str; 4] = [
    include_str!("viewer.js"),
    include_str!("charts.js"),
    include_str!("stage.js"),
    include_str!("page.js"),
];

/// The page for data and maps of earlier moments.
pub fn fill(data: &Value, snapshots: &[&Snapshot]) -> Result<String> {
    let mut data = data.clone();
    data["snapshots"] = json!(snapshots);
    let text = serde_json::to_string(&data).map_err(|e| Failure::Other(e.to_string()))?;
    let name = data["name"].as_str().unwrap_or_default();
    let parts = [
        ("title", escape(name)),
        ("style", STYLE.to_owned()),
        ("fragment", shader::fragment()),
        // Nothing inside may end the element.
        ("data", text.replace('<', "\\u003c")),
        ("script", SCRIPTS.concat()),
    ];
    let mut page = String::new();
    let mut rest = PAGE;
    for (name, part) in &parts {
        let mark = format!("{{{{{name}}}}}");
        let (before, after) = rest.split_once(&mark).expect("the page has all marks in order");
        page.push_str(before);
        page.push_str(part);
        rest = after;
    }
    page.push_str(rest);
    Ok(page)
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_data_cannot_break_out_of_their_place() {
        let data = json!({ "name": "</script><b>&{{data}}" });
        let page = fill(&data, &[]).unwrap();
        assert_eq!(page.matches("</script>").count(), PAGE.matches("</script>").count());
        assert!(!page.contains("<b>&"));
        assert!(page.contains("&lt;/script&gt;&lt;b&gt;&amp;{{data}}"));
    }

    #[test]
    fn the_page_loads_nothing() {
        let page = fill(&json!({ "name": "x" }), &[]).unwrap();
        for mark in ["http:", "https:", "@import", "url(", "fetch(", "XMLHttpRequest", "src=\"/"] {
            let count = page.matches(mark).count();
            // The namespace of SVG is a name, not an address.
            let names = page.matches("http://www.w3.org/2000/svg").count();
            let allowed = if mark == "http:" { names } else { 0 };
            assert_eq!(count, allowed, "{mark}");
        }
        assert!(page.contains("default-src 'none'"));
    }
}
