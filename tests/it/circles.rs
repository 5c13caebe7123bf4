//! Do the files of a crate depend on each other in one direction only?
//!
//! A file depends on another if it takes a name from it: a function, a type, a constant or a macro
//! that is defined there. `mod x;` takes nothing, and neither does a re-export: a name is taken
//! from the file that defines it, however many `mod.rs` lie between. Files that reach each other by
//! such steps form a circle, and none of them can be understood, tested or moved alone.
//!
//! The sources are read as text, as [`crate::source_text`] has them. Methods are not seen, because
//! their types are not; neither are names that only a macro makes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use crate::source_text::{blank, library_files, without_tests};

/// Folders of sources, and whether the test holds their crate to the rule; `crates` stands for the
/// `src` of every crate in it.
const ROOTS: [(&str, bool); 7] = [
    ("bindings/c/src", true),
    ("bindings/mcap/src", true),
    ("bindings/python/src", true),
    ("bindings/ros2/src", true),
    ("eval/src", true),
    ("src", true),
    ("crates", true),
];

/// The crates that `ROOTS` names, and whether each is held to the rule.
fn crates() -> Vec<(String, bool)> {
    let mut all = Vec::new();
    for (root, is_held) in ROOTS {
        if root != "crates" {
            all.push((root.to_owned(), is_held));
            continue;
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(root);
        // A published package has no other crates.
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut names: Vec<String> = entries
            .map(|entry| format!("{root}/{}/src", entry.file_name().to_string_lossy()))
            .collect();
        names.sort_unstable();
        all.extend(names.into_iter().map(|name| (name, is_held)));
    }
    all
}

#[test]
fn files_form_no_circles() {
    let (mut text, mut num_steps) = (String::new(), 0);
    for (root, is_held) in crates() {
        let sources = library_files(&root);
        let steps = steps(&root, &sources);
        num_steps += steps.len();
        for circle in circles(&steps) {
            let circle = describe(&circle, &steps);
            if is_held {
                text += &circle;
            } else {
                println!("not held to the rule yet: {circle}");
            }
        }
    }
    assert!(num_steps > 200, "the reader finds only {num_steps} steps");
    assert!(text.is_empty(), "{text}");
}

/// From a file to another, the names that the first takes from the second.
type Steps = BTreeMap<(String, String), BTreeSet<String>>;

/// A circle in words, with what ties it.
fn describe(circle: &[String], steps: &Steps) -> String {
    let mut text = format!("{} files form a circle:\n", circle.len());
    for ((from, to), names) in steps {
        if circle.contains(from) && circle.contains(to) {
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let _ = writeln!(text, "  {from} takes from {to}: {}", names.join(", "));
        }
    }
    text
}

/// The steps between the files of the crate whose sources lie in `root`.
fn steps(root: &str, sources: &[(String, String)]) -> Steps {
    let mut tree = Tree::default();
    let mut paths = Vec::new();
    for (file, source) in sources {
        let Some(module) = module_of(root, file) else {
            continue;
        };
        let entry = tree.modules.entry(module.clone()).or_default();
        entry.file.clone_from(file);
        let code = without_tests(&blank(source));
        let found = Reader::new(&code, module).read(&mut tree, file);
        paths.extend(found.into_iter().map(|path| (file.clone(), path)));
    }
    let mut steps = Steps::new();
    for (from, (module, path)) in paths {
        let mut visited = BTreeSet::new();
        if let Some((to, name)) = tree.resolve(&module, &path, &mut visited)
            && to != from
        {
            steps.entry((from, to)).or_default().insert(name);
        }
    }
    steps
}

/// The module that a file is; none for the root of a binary, which no file can name.
fn module_of(root: &str, file: &str) -> Option<Vec<String>> {
    let inside = file.strip_prefix(root)?.trim_start_matches('/');
    if inside == "main.rs" {
        return None;
    }
    let inside = inside.strip_suffix(".rs")?;
    let inside = inside.strip_suffix("/mod").unwrap_or(inside);
    Some(match inside {
        "lib" => Vec::new(),
        _ => inside.split('/').map(str::to_owned).collect(),
    })
}

/// What one module defines and passes on.
#[derive(Default)]
struct Module {
    file: String,
    /// Names that are defined in it.
    items: BTreeSet<String>,
    /// Names that `use` brings into it, with their paths as written.
    imports: BTreeMap<String, Vec<String>>,
    /// Paths of which it passes on every name.
    globs: Vec<Vec<String>>,
}

/// The modules of a crate.
#[derive(Default)]
struct Tree {
    modules: BTreeMap<Vec<String>, Module>,
}

impl Tree {
    /// The file that defines what `path` means in `module`, and the name that is defined there;
    /// none for other crates and for paths that only lead to a module.
    fn resolve(
        &self,
        module: &[String],
        path: &[String],
        visited: &mut BTreeSet<(Vec<String>, Vec<String>)>,
    ) -> Option<(String, String)> {
        let mut at = module.to_vec();
        let mut is_first = true;
        let mut rest = path;
        while let Some((name, behind)) = rest.split_first() {
            match name.as_str() {
                "crate" => at.clear(),
                "self" => {}
                "super" => {
                    at.pop()?;
                }
                _ => {
                    let child: Vec<String> = at.iter().chain([name]).cloned().collect();
                    let known = self.modules.get(&at)?;
                    if self.modules.contains_key(&child) {
                        at = child;
                    } else if known.items.contains(name) {
                        return Some((known.file.clone(), name.clone()));
                    } else if let Some(import) = known.imports.get(name)
                        && visited.insert((at.clone(), import.clone()))
                    {
                        // An import is not looked up through itself, and a glob neither.
                        let further: Vec<String> = import.iter().chain(behind).cloned().collect();
                        return self.resolve(&at, &further, visited);
                    } else if let Some(found) = known.globs.iter().find_map(|glob| {
                        let is_new = visited.insert((at.clone(), glob.clone()));
                        let further: Vec<String> = glob.iter().chain(rest).cloned().collect();
                        is_new.then(|| self.resolve(&at, &further, visited))?
                    }) {
                        return Some(found);
                    } else if is_first {
                        // A crate, a name of the language, or a variable.
                        return None;
                    } else {
                        return Some((known.file.clone(), name.clone()));
                    }
                }
            }
            is_first = false;
            rest = behind;
        }
        None
    }
}

/// A path and the module in which it is written.
type Written = (Vec<String>, Vec<String>);

/// Walks through the code of one file.
struct Reader<'c> {
    tokens: Vec<&'c str>,
    at: usize,
    /// The module of the file, and of the inline modules that are open.
    module: Vec<String>,
    /// Braces that are open, and at how many each inline module began.
    depth: usize,
    inline: Vec<usize>,
}

impl<'c> Reader<'c> {
    fn new(code: &'c str, module: Vec<String>) -> Self {
        Self {
            tokens: tokens(code),
            at: 0,
            module,
            depth: 0,
            inline: Vec::new(),
        }
    }

    fn peek(&self, ahead: usize) -> &'c str {
        self.tokens.get(self.at + ahead).copied().unwrap_or("")
    }

    /// Adds what the file defines to the tree; gives the paths that it uses.
    fn read(mut self, tree: &mut Tree, file: &str) -> Vec<Written> {
        let mut paths = Vec::new();
        let mut is_public = false;
        while self.at < self.tokens.len() {
            let is_at_item_level = self.depth == self.inline.last().map_or(0, |open| open + 1);
            let token = self.peek(0);
            match token {
                "{" => self.depth += 1,
                "}" => {
                    self.depth = self.depth.saturating_sub(1);
                    if self.inline.last() == Some(&self.depth) {
                        self.inline.pop();
                        self.module.pop();
                    }
                }
                "pub" => {
                    is_public = true;
                    if self.peek(1) == "(" {
                        while self.peek(0) != ")" && self.at < self.tokens.len() {
                            self.at += 1;
                        }
                    }
                    self.at += 1;
                    continue;
                }
                "use" => {
                    self.at += 1;
                    let mut leaves = Vec::new();
                    self.use_tree(&mut Vec::new(), &mut leaves);
                    let module = tree.modules.entry(self.module.clone()).or_default();
                    for (path, alias) in leaves {
                        if !is_public {
                            paths.push((self.module.clone(), path.clone()));
                        }
                        match alias {
                            Some(alias) => {
                                module.imports.insert(alias, path);
                            }
                            None => module.globs.push(path),
                        }
                    }
                }
                "mod" if is_at_item_level && is_name(self.peek(1)) => {
                    if self.peek(2) == "{" {
                        self.module.push(self.peek(1).to_owned());
                        self.inline.push(self.depth);
                        let inner = tree.modules.entry(self.module.clone()).or_default();
                        file.clone_into(&mut inner.file);
                    }
                    self.at += 1;
                }
                _ if is_at_item_level && self.defines().is_some() => {
                    let name = self.defines().unwrap_or_default().to_owned();
                    let module = tree.modules.entry(self.module.clone()).or_default();
                    module.items.insert(name);
                    self.at += 1;
                }
                _ if is_name(token) => {
                    let path = self.path();
                    // A lone name that is written small and is not called is a variable or a field.
                    let is_taken = path.len() > 1
                        || path[0].starts_with(char::is_uppercase)
                        || matches!(self.peek(0), "(" | "!");
                    let before = |back: usize| {
                        let at = self.at.checked_sub(2 * path.len() - 1 + back);
                        at.and_then(|at| self.tokens.get(at)).copied().unwrap_or("")
                    };
                    if is_taken && before(1) != "." && before(1) != "::" {
                        paths.push((self.module.clone(), path));
                    }
                    is_public = false;
                    continue;
                }
                _ => {}
            }
            is_public = false;
            self.at += 1;
        }
        paths
    }

    /// The name of the item that begins here.
    fn defines(&self) -> Option<&'c str> {
        let name = match self.peek(0) {
            "fn" | "struct" | "enum" | "trait" | "type" | "union" | "static" => self.peek(1),
            "const" if self.peek(1) != "fn" => self.peek(1),
            "macro_rules" if self.peek(1) == "!" => self.peek(2),
            _ => return None,
        };
        is_name(name).then_some(name)
    }

    /// The path that begins here, behind which the reader then stands.
    fn path(&mut self) -> Vec<String> {
        let mut path = vec![self.peek(0).to_owned()];
        self.at += 1;
        while self.peek(0) == "::" && is_name(self.peek(1)) {
            path.push(self.peek(1).to_owned());
            self.at += 2;
        }
        path
    }

    /// The leaves of a `use` behind `prefix`, with the names that they get; none for `*`.
    fn use_tree(
        &mut self,
        prefix: &mut Vec<String>,
        leaves: &mut Vec<(Vec<String>, Option<String>)>,
    ) {
        let len = prefix.len();
        loop {
            match self.peek(0) {
                "::" => self.at += 1,
                "*" => {
                    self.at += 1;
                    leaves.push((prefix.clone(), None));
                    break;
                }
                "{" => {
                    self.at += 1;
                    while !matches!(self.peek(0), "}" | "") {
                        self.use_tree(prefix, leaves);
                        if self.peek(0) == "," {
                            self.at += 1;
                        }
                    }
                    self.at += 1;
                    break;
                }
                name if is_name(name) && name != "as" => {
                    self.at += 1;
                    // `{self}` is the path so far.
                    if name != "self" || prefix.is_empty() {
                        prefix.push(name.to_owned());
                    }
                    if self.peek(0) != "::" {
                        let mut alias = prefix.last().cloned();
                        if self.peek(0) == "as" {
                            alias = Some(self.peek(1).to_owned());
                            self.at += 2;
                        }
                        leaves.push((prefix.clone(), alias));
                        break;
                    }
                }
                _ => break,
            }
        }
        prefix.truncate(len);
    }
}

/// Words, `::` and single marks.
fn tokens(code: &str) -> Vec<&str> {
    let mut tokens = Vec::new();
    let mut at = 0;
    while let Some(first) = code[at..].chars().next() {
        let rest = &code[at..];
        let len = if first == '_' || first.is_ascii_alphanumeric() {
            let end = |c: char| !(c == '_' || c.is_ascii_alphanumeric());
            rest.find(end).unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            first.len_utf8()
        };
        if !first.is_whitespace() {
            tokens.push(&rest[..len]);
        }
        at += len;
    }
    tokens
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c == '_' || c.is_ascii_alphabetic())
}

/// Sets of files that reach each other.
fn circles(steps: &Steps) -> Vec<Vec<String>> {
    let mut next: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (from, to) in steps.keys() {
        next.entry(from).or_default().push(to);
    }
    let reached = |start: &str| -> BTreeSet<String> {
        let mut reached = BTreeSet::new();
        let mut open = vec![start];
        while let Some(file) = open.pop() {
            for &to in next.get(file).into_iter().flatten() {
                if reached.insert(to.to_owned()) {
                    open.push(to);
                }
            }
        }
        reached
    };
    let reached: BTreeMap<&str, BTreeSet<String>> =
        next.keys().map(|&file| (file, reached(file))).collect();
    let circles: BTreeSet<Vec<String>> = (reached.iter())
        .filter(|(file, from)| from.contains(**file))
        .map(|(file, from)| {
            let returns = |to: &&String| {
                reached
                    .get(to.as_str())
                    .is_some_and(|it| it.contains(*file))
            };
            from.iter().filter(returns).cloned().collect()
        })
        .collect();
    circles.into_iter().collect()
}

#[test]
fn a_circle_is_found_with_what_ties_it() {
    let found = |files: &[(&str, &str)]| -> Vec<String> {
        let sources: Vec<(String, String)> = (files.iter())
            .map(|(file, source)| (format!("x/src/{file}"), (*source).to_owned()))
            .collect();
        let steps = steps("x/src", &sources);
        let circles = circles(&steps);
        circles
            .iter()
            .map(|circle| describe(circle, &steps))
            .collect()
    };
    // Downwards only: re-exports and declarations take nothing, and tests may.
    let street = [
        (
            "lib.rs",
            "pub mod house;\nmod street;\npub use street::Street;",
        ),
        (
            "house/mod.rs",
            "mod door;\npub use door::{Door, open};\nuse crate::street::Street;\n\
             pub fn enter(_: &Street) { open() }",
        ),
        (
            "house/door.rs",
            "pub struct Door;\npub fn open() {}\n\
             #[cfg(test)]\nmod tests { use crate::house::enter; }",
        ),
        ("street.rs", "// crate::house::Door\npub struct Street;"),
    ];
    assert!(found(&street).is_empty(), "{:?}", found(&street));

    // Through a re-export, a group and a second name.
    let mut circle = street;
    circle[3].1 = "use super::{house::{self, Door as Entrance}};\npub struct Street;";
    let texts = found(&circle);
    assert!(texts.is_empty(), "nothing leads back: {texts:?}");
    circle[2].1 = "pub struct Door(crate::Street);\npub fn open() {}";
    let texts = found(&circle);
    assert_eq!(texts.len(), 1, "{texts:?}");
    assert!(
        texts[0].contains("x/src/house/door.rs takes from x/src/street.rs: Street")
            && texts[0].contains("x/src/street.rs takes from x/src/house/door.rs: Door")
            && texts[0].starts_with("2 files"),
        "{texts:?}"
    );

    // A child takes what its parent defines, and the parent what the child defines.
    let mut parent = street;
    parent[2].1 = "use super::enter;\npub struct Door;\npub fn open() { enter() }";
    assert!(found(&parent)[0].contains("house/door.rs takes from x/src/house/mod.rs: enter"));

    // By a path in the code, by the name of a module, by a star, and out of a module inside of a
    // file.
    for source in [
        "pub struct Street(crate::house::Door);",
        "use crate::house;\npub struct Street(house::Door);",
        "use crate::house::*;\npub struct Street(Door);",
        "pub struct Street;\nmod inner { fn f() -> super::super::house::Door { loop {} } }",
    ] {
        let mut written = circle;
        written[3].1 = source;
        assert_eq!(found(&written).len(), 1, "{source}");
    }
}
