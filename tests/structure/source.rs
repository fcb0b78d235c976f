//! The files of a crate as the compiler sees them: modules, their definitions, the names that they use, and the
//! lengths of their functions. Code under `#[cfg(test)]` is left out.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use proc_macro2::{LineColumn, TokenStream, TokenTree};
use quote::ToTokens;
use syn::spanned::Spanned;
use syn::visit::{self, Visit};
use syn::{Attribute, Ident, Item, ItemMod, UseTree};

/// Path of a module below the crate's root, e.g. `["calibration", "pose"]`.
pub type ModulePath = Vec<String>;

/// One `use` declaration: path, and the name it gives (`None`: everything inside, `*`).
pub struct Use {
    pub path: Vec<String>,
    pub name: Option<String>,
}

/// A module, a file's or an inline one.
#[derive(Default)]
pub struct Module {
    /// Index of its file in [`Crate::files`].
    pub file: usize,
    /// Names defined in it, modules aside.
    pub items: Vec<String>,
    pub uses: Vec<Use>,
    /// All paths in its code, in segments; single names included.
    pub paths: Vec<Vec<String>>,
}

/// A function and its lines from `fn` to the closing brace.
pub struct Function {
    pub name: String,
    pub lines: usize,
}

pub struct File {
    /// Path below the crate's source folder, with `/`.
    pub name: String,
    /// Lines outside test modules.
    pub lines: usize,
    pub functions: Vec<Function>,
    pub says_unsafe: bool,
}

/// A crate's files and modules, from its root file on.
#[derive(Default)]
pub struct Crate {
    pub files: Vec<File>,
    pub modules: BTreeMap<ModulePath, Module>,
}

impl Crate {
    /// Reads the crate whose root is `root`, e.g. `src/lib.rs`.
    pub fn read(root: &Path) -> Self {
        let mut found = Self::default();
        let base = root.parent().unwrap().to_owned();
        found.file(&base, root, Vec::new(), base.clone());
        found
    }

    /// Reads a file and the files of the modules it declares, which lie in `folder`.
    fn file(&mut self, base: &Path, path: &Path, module: ModulePath, folder: PathBuf) {
        let text = fs::read_to_string(path)
            .unwrap_or_else(|e| panic!("{} cannot be read: {e}", path.display()));
        let syntax = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let tests: usize = syntax.items.iter().filter(|i| is_test(attributes(i))).map(lines).sum();
        let mut functions = Functions::default();
        functions.visit_file(&syntax);
        let index = self.files.len();
        self.files.push(File {
            name: path.strip_prefix(base).unwrap().to_str().unwrap().replace('\\', "/"),
            lines: text.lines().count() - tests,
            functions: functions.found,
            says_unsafe: functions.says_unsafe,
        });
        self.module(base, index, module, syntax.items, &folder);
    }

    fn module(
        &mut self,
        base: &Path,
        file: usize,
        path: ModulePath,
        items: Vec<Item>,
        folder: &Path,
    ) {
        let mut module = Module { file, ..Module::default() };
        for item in items {
            // Items of other crates are checked with those.
            if is_test(attributes(&item)) || is_elsewhere(&item) {
                continue;
            }
            match item {
                Item::Use(item) => leaves(&item.tree, &mut Vec::new(), &mut module.uses),
                Item::Mod(ItemMod { ident, content, .. }) => {
                    let name = ident.to_string();
                    let inner = [&path[..], std::slice::from_ref(&name)].concat();
                    match content {
                        Some((_, items)) => {
                            self.module(base, file, inner, items, &folder.join(&name));
                        }
                        None => self.declared(base, folder, &name, inner),
                    }
                }
                other => {
                    module.items.extend(name(&other).map(ToString::to_string));
                    collect(without_tests(other), &mut module.paths);
                }
            }
        }
        self.modules.insert(path, module);
    }

    /// The file of `mod name;`.
    fn declared(&mut self, base: &Path, folder: &Path, name: &str, path: ModulePath) {
        let inner = folder.join(name);
        let (beside, inside) = (inner.with_extension("rs"), inner.join("mod.rs"));
        let file = if beside.is_file() { beside } else { inside };
        self.file(base, &file, path, inner);
    }

    /// The file that defines the item that `path` names in a module, through re-exports; `None` for other crates and
    /// unknown items.
    pub fn resolve(&self, module: &ModulePath, path: &[String]) -> Option<usize> {
        self.find(module, path, 0)
    }

    fn find(&self, module: &ModulePath, path: &[String], depth: usize) -> Option<usize> {
        // Aliases that lead to each other, and globs in a ring.
        if depth > 20 {
            return None;
        }
        let here = &self.modules[module];
        let Some((first, rest)) = path.split_first() else { return Some(here.file) };
        match first.as_str() {
            "crate" => return self.find(&Vec::new(), rest, depth + 1),
            "self" => return self.find(module, rest, depth + 1),
            "super" => {
                let (_, parent) = module.split_last()?;
                return self.find(&parent.to_vec(), rest, depth + 1);
            }
            _ => {}
        }
        let child = [&module[..], std::slice::from_ref(first)].concat();
        if self.modules.contains_key(&child) {
            return self.find(&child, rest, depth + 1);
        }
        if here.items.contains(first) {
            return Some(here.file);
        }
        let named = |u: &&Use| u.name.as_ref() == Some(first) && u.path != path;
        if let Some(alias) = here.uses.iter().find(named) {
            return self.find(module, &[&alias.path[..], rest].concat(), depth + 1);
        }
        let globs = here.uses.iter().filter(|u| u.name.is_none());
        globs
            .filter(|u| matches!(u.path[0].as_str(), "crate" | "self" | "super"))
            .find_map(|u| self.find(module, &[&u.path[..], path].concat(), depth + 1))
    }
}

/// Whether `#[cfg(test)]` or a combination with it stands before an item.
fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|a| {
        let Ok(list) = a.meta.require_list() else { return false };
        let words: Vec<String> = list.tokens.clone().into_iter().map(|t| t.to_string()).collect();
        a.path().is_ident("cfg") && words.first().is_some_and(|w| w == "test")
    })
}

/// Whether a module has its file where `#[path]` says.
fn is_elsewhere(item: &Item) -> bool {
    matches!(item, Item::Mod(_)) && attributes(item).iter().any(|a| a.path().is_ident("path"))
}

fn attributes(item: &Item) -> &[Attribute] {
    match item {
        Item::Const(i) => &i.attrs,
        Item::Enum(i) => &i.attrs,
        Item::Fn(i) => &i.attrs,
        Item::Impl(i) => &i.attrs,
        Item::Macro(i) => &i.attrs,
        Item::Mod(i) => &i.attrs,
        Item::Static(i) => &i.attrs,
        Item::Struct(i) => &i.attrs,
        Item::Trait(i) => &i.attrs,
        Item::Type(i) => &i.attrs,
        Item::Union(i) => &i.attrs,
        Item::Use(i) => &i.attrs,
        _ => &[],
    }
}

fn name(item: &Item) -> Option<&Ident> {
    Some(match item {
        Item::Const(i) => &i.ident,
        Item::Enum(i) => &i.ident,
        Item::Fn(i) => &i.sig.ident,
        Item::Macro(i) => i.ident.as_ref()?,
        Item::Static(i) => &i.ident,
        Item::Struct(i) => &i.ident,
        Item::Trait(i) => &i.ident,
        Item::Type(i) => &i.ident,
        Item::Union(i) => &i.ident,
        _ => return None,
    })
}

/// An item without the methods that only tests have.
fn without_tests(mut item: Item) -> TokenStream {
    if let Item::Impl(block) = &mut item {
        block.items.retain(|i| !matches!(i, syn::ImplItem::Fn(f) if is_test(&f.attrs)));
    }
    item.into_token_stream()
}

fn lines(item: &impl ToTokens) -> usize {
    let (start, end): (LineColumn, LineColumn) = (item.span().start(), item.span().end());
    end.line - start.line + 1
}

fn leaves(tree: &UseTree, before: &mut Vec<String>, found: &mut Vec<Use>) {
    let mut leaf = |last: Option<&Ident>, name: Option<String>| {
        let mut path = before.clone();
        path.extend(last.filter(|i| *i != "self").map(ToString::to_string));
        found.push(Use { path, name });
    };
    match tree {
        UseTree::Name(n) if n.ident == "self" => leaf(None, before.last().cloned()),
        UseTree::Name(n) => leaf(Some(&n.ident), Some(n.ident.to_string())),
        UseTree::Rename(n) => leaf(Some(&n.ident), Some(n.rename.to_string())),
        UseTree::Glob(_) => leaf(None, None),
        UseTree::Path(p) => {
            before.push(p.ident.to_string());
            leaves(&p.tree, before, found);
            before.pop();
        }
        UseTree::Group(g) => g.items.iter().for_each(|t| leaves(t, before, found)),
    }
}

/// All `a::b::c` of some tokens, macros' arguments and bodies included. Names after a dot are
/// fields and methods.
fn collect(tokens: TokenStream, found: &mut Vec<Vec<String>>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let is =
        |i: usize, c: char| matches!(tokens.get(i), Some(TokenTree::Punct(p)) if p.as_char() == c);
    let mut at = 0;
    while at < tokens.len() {
        let visibility = at > 0 && matches!(&tokens[at - 1], TokenTree::Ident(i) if i == "pub");
        match &tokens[at] {
            // `pub(super)`, `pub(in path)`
            TokenTree::Group(_) if visibility => {}
            TokenTree::Group(group) => collect(group.stream(), found),
            TokenTree::Ident(first)
                if at == 0 || !is(at - 1, '.') || is(at.wrapping_sub(2), '.') =>
            {
                let mut path = vec![first.to_string()];
                while is(at + 1, ':') && is(at + 2, ':') {
                    let Some(TokenTree::Ident(next)) = tokens.get(at + 3) else { break };
                    path.push(next.to_string());
                    at += 3;
                }
                found.push(path);
            }
            _ => {}
        }
        at += 1;
    }
}

#[derive(Default)]
struct Functions {
    found: Vec<Function>,
    says_unsafe: bool,
}

impl Functions {
    fn add(&mut self, signature: &syn::Signature, block: &syn::Block) {
        let first = signature.span().start().line;
        let lines = block.span().end().line - first + 1;
        self.found.push(Function { name: signature.ident.to_string(), lines });
        self.says_unsafe |= signature.unsafety.is_some();
    }
}

impl<'a> Visit<'a> for Functions {
    fn visit_item(&mut self, item: &'a Item) {
        if !is_test(attributes(item)) {
            visit::visit_item(self, item);
        }
    }
    fn visit_item_fn(&mut self, function: &'a syn::ItemFn) {
        self.add(&function.sig, &function.block);
        visit::visit_item_fn(self, function);
    }
    fn visit_impl_item_fn(&mut self, function: &'a syn::ImplItemFn) {
        if !is_test(&function.attrs) {
            self.add(&function.sig, &function.block);
            visit::visit_impl_item_fn(self, function);
        }
    }
    fn visit_trait_item_fn(&mut self, function: &'a syn::TraitItemFn) {
        if let Some(block) = &function.default {
            self.add(&function.sig, block);
        }
        visit::visit_trait_item_fn(self, function);
    }
    fn visit_expr_unsafe(&mut self, block: &'a syn::ExprUnsafe) {
        self.says_unsafe = true;
        visit::visit_expr_unsafe(self, block);
    }
    fn visit_item_impl(&mut self, block: &'a syn::ItemImpl) {
        self.says_unsafe |= block.unsafety.is_some();
        visit::visit_item_impl(self, block);
    }
    fn visit_macro(&mut self, call: &'a syn::Macro) {
        let word = |t: &TokenTree| matches!(t, TokenTree::Ident(i) if i == "unsafe");
        self.says_unsafe |= flat(call.tokens.clone()).iter().any(word);
    }
}

fn flat(tokens: TokenStream) -> Vec<TokenTree> {
    let inner = |tree: TokenTree| match tree {
        TokenTree::Group(group) => flat(group.stream()),
        other => vec![other],
    };
    tokens.into_iter().flat_map(inner).collect()
}
