//! Which file uses which, and the rings among them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use crate::source::Crate;

/// Files by name, and the files each one uses.
pub type Imports = BTreeMap<String, BTreeSet<String>>;

/// Every file of a crate and those whose items it names.
pub fn imports(source: &Crate) -> Imports {
    let name = |file: usize| source.files[file].name.clone();
    let mut found: Imports =
        source.files.iter().map(|f| (f.name.clone(), BTreeSet::new())).collect();
    for (path, module) in &source.modules {
        let used = module.uses.iter().map(|u| &u.path).chain(&module.paths);
        let targets = used.filter_map(|p| source.resolve(path, p)).filter(|&f| f != module.file);
        found.get_mut(&name(module.file)).unwrap().extend(targets.map(name));
    }
    found
}

/// A shortest ring through every file that lies on one, each ring once:
/// `["a.rs", "b.rs", "a.rs"]`.
pub fn rings(imports: &Imports) -> Vec<Vec<String>> {
    let mut found: Vec<Vec<String>> = Vec::new();
    for start in imports.keys() {
        let Some(ring) = shortest_ring(imports, start) else { continue };
        let members = |r: &[String]| r.iter().cloned().collect::<BTreeSet<_>>();
        if !found.iter().any(|known| members(known) == members(&ring)) {
            found.push(ring);
        }
    }
    found
}

fn shortest_ring(imports: &Imports, start: &String) -> Option<Vec<String>> {
    let mut came_from: BTreeMap<&String, &String> = BTreeMap::new();
    let mut queue = VecDeque::from([start]);
    while let Some(file) = queue.pop_front() {
        for next in &imports[file] {
            if next == start {
                let mut ring = vec![start.clone(), file.clone()];
                let mut at = file;
                while at != start {
                    at = came_from[at];
                    ring.push(at.clone());
                }
                ring.reverse();
                return Some(ring);
            }
            if !came_from.contains_key(next) {
                came_from.insert(next, file);
                queue.push_back(next);
            }
        }
    }
    None
}
