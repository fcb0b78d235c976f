//! Puts the header's declarations in the order of use: functions as `symbols.txt` lists them, each
//! type before the first function that needs it, constants after their type.

use std::collections::{BTreeMap, BTreeSet};

/// A declaration by its kind.
#[derive(Debug, PartialEq)]
enum Item {
    Constant(String),
    Type(String),
    Function(String),
    /// Guards, includes, the opening and closing of `extern "C"`.
    Frame,
}

fn identifiers(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// A block without its comments.
fn code(block: &str) -> String {
    let mut rest = block;
    let mut out = String::new();
    while let Some((before, after)) = rest.split_once("/*") {
        out += before;
        rest = after.split_once("*/").expect("a comment that ends").1;
    }
    out + rest
}

fn item(block: &str) -> Item {
    let code = code(block);
    let code = code.trim();
    let last = |text: &str| identifiers(text).last().unwrap().to_owned();
    if let Some(rest) = code.strip_prefix("#define ") {
        let mut words = rest.split_whitespace();
        let name = words.next().unwrap().to_owned();
        return Item::Constant(name);
    }
    if code.starts_with('#') || code.starts_with('}') || code.is_empty() {
        return Item::Frame;
    }
    match code.strip_prefix("typedef ") {
        // A pointer to a function: its name stands in the first parentheses.
        Some(rest) => match rest.split_once("(*") {
            Some((_, name)) => Item::Type(identifiers(name).next().unwrap().to_owned()),
            None => Item::Type(last(rest)),
        },
        None => Item::Function(last(code.split_once('(').expect("a function").0)),
    }
}

/// Where the declarations go.
struct Arranged<'a> {
    types: BTreeMap<String, &'a str>,
    constants: BTreeMap<&'a str, Vec<&'a str>>,
    placed: BTreeSet<String>,
    out: Vec<String>,
}

impl Arranged<'_> {
    /// The types that a declaration needs, each with its constants.
    fn place_types_of(&mut self, block: &str) {
        for name in identifiers(&code(block)).map(str::to_owned).collect::<Vec<_>>() {
            let Some(&declaration) = self.types.get(&name) else { continue };
            if self.placed.insert(name.clone()) {
                self.place_types_of(declaration);
                self.out.push(declaration.to_owned());
                let constants = self.constants.get(name.as_str());
                self.out.extend(constants.map(|constants| constants.join("\n")));
            }
        }
    }
}

/// The header in the order of `symbols`, a list of functions under headings that begin with `#`.
/// `type_of` names the type of each constant that has one of the header's.
///
/// # Panics
/// When a function is not in the list, or a function of the list not in the header.
pub fn arrange(header: &str, symbols: &str, type_of: &BTreeMap<String, String>) -> String {
    let blocks: Vec<&str> = header.trim_end().split("\n\n").collect();
    let mut functions = BTreeMap::new();
    let mut arranged = Arranged {
        types: BTreeMap::new(),
        constants: BTreeMap::new(),
        placed: BTreeSet::new(),
        out: Vec::new(),
    };
    let (mut frame, mut untyped) = (Vec::new(), Vec::new());
    for block in blocks {
        match item(block) {
            Item::Constant(name) => match type_of.get(&name) {
                Some(of) => arranged.constants.entry(of).or_default().push(block),
                None => untyped.push(block.to_owned()),
            },
            Item::Type(name) => drop(arranged.types.insert(name, block)),
            Item::Function(name) => drop(functions.insert(name, block)),
            Item::Frame => frame.push(block.to_owned()),
        }
    }
    let opening = frame.iter().position(|block| block.contains("extern \"C\" {")).unwrap();
    let closing = frame.split_off(opening + 1);
    let extern_c = frame.pop().unwrap();
    arranged.out = frame;
    arranged.out.append(&mut untyped);
    arranged.out.push(extern_c);
    for line in symbols.lines().filter(|line| !line.is_empty()) {
        if let Some(heading) = line.strip_prefix("# ") {
            let rule = "-".repeat(92_usize.saturating_sub(heading.len()));
            arranged.out.push(format!("/* {heading} {rule} */"));
            continue;
        }
        let block = functions
            .remove(line)
            .unwrap_or_else(|| panic!("ffi/symbols.txt: {line} is not a function of the header"));
        arranged.place_types_of(block);
        arranged.out.push(block.to_owned());
    }
    assert!(functions.is_empty(), "not in ffi/symbols.txt: {:?}", functions.keys());
    let left: Vec<_> = arranged.types.keys().filter(|t| !arranged.placed.contains(*t)).collect();
    assert!(left.is_empty(), "no function needs {left:?}");
    arranged.out.extend(closing);
    arranged.out.join("\n\n") + "\n"
}

/// Comments of one line on one line, where that is not too long.
pub fn with_short_comments(header: &str) -> String {
    let lines: Vec<&str> = header.lines().collect();
    let mut out: Vec<String> = Vec::new();
    let mut i = 0;
    while i < lines.len() {
        let indent = lines[i].len() - lines[i].trim_start().len();
        let text = lines.get(i + 1).and_then(|line| line.trim().strip_prefix("* "));
        let whole = lines[i].trim() == "/**" && lines.get(i + 2).is_some_and(|l| l.trim() == "*/");
        match text.filter(|text| whole && indent + text.len() + 7 <= 100) {
            Some(text) => {
                out.push(format!("{}/** {text} */", " ".repeat(indent)));
                i += 3;
            }
            None => {
                out.push(lines[i].to_owned());
                i += 1;
            }
        }
    }
    out.join("\n") + "\n"
}

#[test]
fn short_comments_take_one_line() {
    let made = with_short_comments("    /**\n     * A.\n     */\nx\n/**\n * B\n * C\n */");
    assert_eq!(made, "    /** A. */\nx\n/**\n * B\n * C\n */\n");
}

#[test]
fn declarations_follow_their_use() {
    let header = "/* About. */\n\n#ifndef H\n#define H\n\n#define VERSION 1\n\n/** A. */\n\
                  typedef uint32_t a;\n\ntypedef struct s {\n    a first;\n} s;\n\n\
                  typedef void (*call)(struct s *);\n\n/** One. */\n#define A_ONE 1\n\n\
                  #ifdef __cplusplus\nextern \"C\" {\n#endif\n\nint second(struct s *x, call y);\n\n\
                  int first(void);\n\n#ifdef __cplusplus\n}\n#endif";
    let type_of = BTreeMap::from([("A_ONE".to_owned(), "a".to_owned())]);
    let made = arrange(header, "# Head\nfirst\n\n# More\nsecond\n", &type_of);
    let order = [
        "About",
        "VERSION",
        "extern",
        "Head",
        "first(",
        "More",
        "typedef uint32_t a",
        "A_ONE",
        "struct s {",
        "(*call)",
        "second(",
        "}\n#endif",
    ];
    let places: Vec<_> = order.iter().map(|text| made.find(text).expect(text)).collect();
    assert!(places.is_sorted(), "{made}");
}
