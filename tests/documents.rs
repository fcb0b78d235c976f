//! Links of all Markdown files lead to files and headings that exist, the book in `docs/` has every page and no
//! more than a reader takes in, and the index of `docs/research/` has every page of it. Nothing is asked of
//! a network.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use markdown::ParseOptions;
use markdown::mdast::Node;

/// Links into the repository from pages that are also shown without it.
const REPOSITORY: [&str; 2] =
    ["https://github.com/svbrdf/svbrdf/blob/main/", "https://github.com/svbrdf/svbrdf/tree/main/"];
/// Made by `docs/build.sh` beside the pages, which checks them.
const GENERATED: [&str; 2] = ["docs/rust/", "docs/c/"];
/// Decisions and experiments, beside the book.
const RESEARCH: &str = "docs/research";
/// Most pages of the book, and of research.
const PAGES: usize = 20;
const RESEARCH_PAGES: usize = 15;
/// Folders without documents of this project.
const ELSEWHERE: [&str; 4] = ["target", "data", ".git", "node_modules"];

/// A Markdown file's anchors and links.
#[derive(Default)]
struct Document {
    anchors: BTreeSet<String>,
    links: Vec<String>,
}

/// The anchor of a heading, as GitHub and mdBook make it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Values of `href` and `src` in HTML.
fn addresses(html: &str) -> impl Iterator<Item = String> {
    let values = ["href=\"", "src=\""].into_iter().flat_map(|key| html.split(key).skip(1));
    values.filter_map(|rest| rest.split_once('"')).map(|(value, _)| value.to_owned())
}

impl Document {
    fn parse(text: &str) -> Self {
        let mut document = Self::default();
        document.visit(&markdown::to_mdast(text, &ParseOptions::gfm()).unwrap());
        document
    }

    fn visit(&mut self, node: &Node) {
        match node {
            Node::Heading(_) => {
                let first = anchor(&node.to_string());
                let again = (1..).map(|i| format!("{first}-{i}"));
                let free = std::iter::once(first.clone()).chain(again);
                let unused = free.into_iter().find(|a| !self.anchors.contains(a));
                self.anchors.insert(unused.unwrap());
            }
            Node::Link(link) => self.links.push(link.url.clone()),
            Node::Image(image) => self.links.push(image.url.clone()),
            Node::Definition(definition) => self.links.push(definition.url.clone()),
            Node::Html(html) => self.links.extend(addresses(&html.value)),
            _ => {}
        }
        node.children().into_iter().flatten().for_each(|child| self.visit(child));
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap();
        let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
        if entry.file_type().unwrap().is_dir() {
            if !ELSEWHERE.contains(&name.as_str()) {
                collect(&path, files);
            }
        } else if name.ends_with(".md") {
            files.push(path);
        }
    }
}

/// All documents by their path from the repository on.
fn documents() -> BTreeMap<PathBuf, Document> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    collect(root, &mut files);
    let parse = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        (path.strip_prefix(root).unwrap().to_owned(), Document::parse(&text))
    };
    files.into_iter().map(parse).collect()
}

/// Without `.` and `..`; none if it leaves the repository.
fn normalised(path: &Path) -> Option<PathBuf> {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::ParentDir => {
                if !out.pop() {
                    return None;
                }
            }
            Component::CurDir => {}
            other => out.push(other),
        }
    }
    Some(out)
}

/// Whether a file of `docs/` belongs to the book: pages and their pictures.
fn in_the_book(path: &Path) -> bool {
    path.starts_with("docs") && !path.starts_with(RESEARCH)
}

/// The fault of a link, if it has one.
fn fault(
    from: &Path,
    link: &str,
    documents: &BTreeMap<PathBuf, Document>,
    exists: &dyn Fn(&Path) -> bool,
) -> Option<&'static str> {
    let inside = REPOSITORY.iter().find_map(|start| link.strip_prefix(start));
    if inside.is_none() && (link.contains("://") || link.starts_with("mailto:")) {
        return None;
    }
    let (path, wanted) =
        inside.unwrap_or(link).split_once('#').unwrap_or((inside.unwrap_or(link), ""));
    let target = match (inside, path) {
        (Some(_), _) => normalised(Path::new(path)),
        (None, "") => Some(from.to_owned()),
        (None, _) => normalised(&from.parent().unwrap().join(path)),
    };
    let Some(target) = target else { return Some("leaves the repository") };
    if GENERATED.iter().any(|folder| target.starts_with(folder)) {
        return None;
    }
    if in_the_book(from) && !in_the_book(&target) && inside.is_none() {
        return Some("is not in the book: name it by its address in the repository");
    }
    if !exists(&target) {
        return Some("names no file");
    }
    match documents.get(&target) {
        Some(document) if !wanted.is_empty() && !document.anchors.contains(wanted) => {
            Some("names no heading")
        }
        _ => None,
    }
}

#[test]
fn links_lead_somewhere() {
    let documents = documents();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let exists = |path: &Path| root.join(path).exists();
    let mut faults = Vec::new();
    let mut checked = 0;
    for (path, document) in &documents {
        for link in &document.links {
            checked += 1;
            if let Some(what) = fault(path, link, &documents, &exists) {
                faults.push(format!("{}: {link} {what}", path.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(checked > 100, "{checked} links");
}

#[test]
fn bad_links_are_seen() {
    let text = "# A `b` (c)\n## A b c\n[x](b.md#there) <img src=\"no.png\">\n\n# There: 1.5 mm";
    let document = Document::parse(text);
    let anchors: Vec<_> = document.anchors.iter().map(String::as_str).collect();
    assert_eq!(anchors, ["a-b-c", "a-b-c-1", "there-15-mm"]);
    assert_eq!(document.links, ["b.md#there", "no.png"]);
    let documents = BTreeMap::from([(PathBuf::from("docs/b.md"), document)]);
    let exists = |path: &Path| [Path::new("docs/b.md"), Path::new("README.md")].contains(&path);
    let from = Path::new("docs/a.md");
    for (link, expected) in [
        ("b.md", None),
        ("b.md#a-b-c-1", None),
        ("./../docs/b.md", None),
        ("https://example.org/nowhere", None),
        ("https://github.com/svbrdf/svbrdf/blob/main/README.md", None),
        ("rust/svbrdf/index.html", None),
        ("b.md#nowhere", Some("names no heading")),
        ("c.md", Some("names no file")),
        ("https://github.com/svbrdf/svbrdf/blob/main/no.md", Some("names no file")),
        ("../../b.md", Some("leaves the repository")),
        ("../README.md", Some("is not in the book: name it by its address in the repository")),
        ("research/noise.md", Some("is not in the book: name it by its address in the repository")),
    ] {
        assert_eq!(fault(from, link, &documents, &exists), expected, "{link}");
    }
}

#[test]
fn the_book_has_every_page_once() {
    let documents = documents();
    let summary = &documents[Path::new("docs/SUMMARY.md")];
    let listed: BTreeSet<_> = summary.links.iter().map(|link| format!("docs/{link}")).collect();
    assert_eq!(listed.len(), summary.links.len(), "a page is listed twice");
    let pages = documents.keys().filter(|path| in_the_book(path));
    let pages = pages.map(|path| path.to_str().unwrap().to_owned());
    let pages: BTreeSet<_> = pages.filter(|path| path != "docs/SUMMARY.md").collect();
    assert_eq!(pages, listed);
    assert!(pages.len() <= PAGES, "{} pages", pages.len());
}

#[test]
fn the_index_of_research_names_every_page() {
    let documents = documents();
    let index = &documents[&Path::new(RESEARCH).join("README.md")];
    let named: BTreeSet<_> = index.links.iter().map(String::as_str).collect();
    let pages: Vec<_> =
        documents.keys().filter_map(|path| path.strip_prefix(RESEARCH).ok()?.to_str()).collect();
    assert!(pages.contains(&"README.md") && pages.contains(&"decisions.md"), "{pages:?}");
    assert!(pages.len() <= RESEARCH_PAGES, "{} pages", pages.len());
    for name in pages.into_iter().filter(|name| *name != "README.md") {
        assert!(named.contains(name), "{name} is not in the index");
    }
}
