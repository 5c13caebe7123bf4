//! Are the rooms of `src/` in order, and do the written rules hold?
//!
//! The sources are read as text: comments and strings are blanked out, test code is taken out, and
//! what is left is searched for the paths that lead from one room to another. That needs no
//! compiler and finds `use` lines as well as paths inside functions.
#![allow(
    clippy::unwrap_used,
    reason = "a source that cannot be read fails the test"
)]

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::source_text::{
    blank, is_word, library_files, matching_brace, rust_files, without_tests, word_at, words,
};

/// The rooms with their numbers: a room may name rooms with a smaller number only.
const ROOMS: [(&str, u32); 12] = [
    // The crate of time, which names nothing of this one.
    ("fremen", 0),
    ("simd", 1),
    ("feature", 2),
    ("matching", 3),
    ("map", 4),
    ("predict", 5),
    ("localize", 6),
    ("trace", 7),
    ("learn", 7),
    ("robot", 8),
    ("dataset", 8),
    ("training", 9),
];

/// What `feature` and `matching` may take from the crate of time: its errors, and how files are
/// opened. Vision knows nothing of time; that time knows nothing of pixels is what makes `fremen` a
/// crate of its own.
const TIMELESS: [&str; 5] = ["error", "Error", "ErrorKind", "Result", "file"];
const VISION: [&str; 2] = ["feature", "matching"];

/// The room that says what rows mean, and no other, may name the crate that keeps them.
const KEPT: &str = "map";

/// Where `unsafe` may stand: vector instructions, the border to C, and the mapping of files into
/// memory.
const UNSAFE_ROOMS: [&str; 3] = ["src/simd/", "bindings/c/src/", "bindings/c/examples/"];
const UNSAFE_MODULE: &str = "crates/store/src/mapped.rs";
/// And in which tests: one counts allocations, one is a file system for SQLite.
const UNSAFE_TESTS: [&str; 2] = ["tests/allocation.rs", "tests/it/faulty_disk.rs"];

/// Folders of sources beside the evaluation's.
const FOLDERS: [&str; 6] = ["bindings", "src", "crates", "tests", "benches", "examples"];

#[test]
fn rooms_name_only_rooms_below_them() {
    let mut found = Vec::new();
    let mut num_paths = 0;
    for (path, source) in library_files("src") {
        let (named, violations) = judge(&path, &source);
        num_paths += named;
        found.extend(violations);
    }
    assert!(num_paths > 50, "the reader found only {num_paths} paths");
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn every_room_is_listed() {
    let mut found: BTreeSet<String> = BTreeSet::new();
    for (path, _) in library_files("src") {
        found.insert(room(&path).to_owned());
    }
    // The list of rooms, which names them all.
    found.remove("lib");
    found.insert("fremen".to_owned());
    let listed: BTreeSet<String> = ROOMS.map(|(name, _)| name.to_owned()).into();
    assert_eq!(found, listed);
}

#[test]
fn a_forbidden_path_is_found() {
    let violations = |path: &str, source: &str| judge(path, source).1.len();
    // The order of rooms.
    assert_eq!(
        violations("src/map/types.rs", "use crate::learn::Learner;"),
        1
    );
    assert_eq!(violations("src/learn/mod.rs", "use crate::map::Map;"), 0);
    assert_eq!(violations("src/simd/mod.rs", "use crate::map::Map;"), 1);
    assert_eq!(violations("src/simd/avx2.rs", "use crate::simd::Bits;"), 0);
    // Not only in `use` lines, not only one at a time, not only by `crate`.
    assert_eq!(
        violations("src/map/mod.rs", "fn f() { crate::learn::g(); }"),
        1
    );
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "use crate::{\n    learn::{Learner, Learnt},\n    localize, simd::Kernel,\n};"
        ),
        2
    );
    assert_eq!(
        violations("src/map/mod.rs", "use super::learn::Learner;"),
        1
    );
    assert_eq!(violations("src/map/types.rs", "use super::learn::x;"), 0);
    assert_eq!(
        violations("src/map/types.rs", "use super::super::learn::Learner;"),
        1
    );
    assert_eq!(violations("src/map/mod.rs", "use crate::helpers::x;"), 1);
    // Vision knows nothing of time.
    for path in [
        "fremen::Time",
        "fremen::spectrum::x",
        "fremen::{Error, Time}",
    ] {
        let source = format!("use {path};");
        assert_eq!(violations("src/feature/mod.rs", &source), 1, "{source}");
        assert_eq!(violations("src/matching/mod.rs", &source), 1, "{source}");
        assert_eq!(violations("src/map/mod.rs", &source), 0, "{source}");
    }
    assert_eq!(
        violations("src/feature/mod.rs", "use fremen::{Error, Result};"),
        0
    );
    // Only the map knows the store.
    let source = "use chronotope_store::Store;";
    assert_eq!(violations("src/map/file/map.rs", source), 0);
    assert_eq!(violations("src/localize/mod.rs", source), 1);
    // What does not count.
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "//! [`x`](crate::learn)\nconst A: &str = \"crate::learn \\\" \"; /* crate::learn */"
        ),
        0
    );
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "#[cfg(test)]\nmod tests {\n    use crate::learn::x;\n    fn f() { {} }\n}\n"
        ),
        0
    );
    // After a test module, the file goes on; a character is no string and a lifetime no character.
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "#[cfg(test)]\nmod tests { const A: char = '}'; }\nuse crate::learn::x;"
        ),
        1
    );
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "const Q: char = '\"'; use crate::learn::x;"
        ),
        1
    );
    assert_eq!(
        violations(
            "src/map/mod.rs",
            "fn f<'a>(x: &'a str) { crate::learn::y(x) }"
        ),
        1
    );
    assert_eq!(
        violations("src/map/mod.rs", "const R: &str = r#\"crate::learn \" \"#;"),
        0
    );
}

#[test]
fn unsafe_code_stands_where_it_is_named_only() {
    let mut num_inside = 0;
    let others = [
        "bindings", "crates", "eval/src", "tests", "benches", "examples",
    ];
    let others = others.into_iter().flat_map(rust_files);
    for (path, source) in library_files("src").into_iter().chain(others) {
        let num_unsafe = words(&blank(&source))
            .filter(|word| *word == "unsafe" || *word == "unsafe_code")
            .count();
        let is_named = path == UNSAFE_MODULE || UNSAFE_TESTS.contains(&&*path);
        if UNSAFE_ROOMS.iter().any(|room| path.starts_with(room)) || is_named {
            num_inside += num_unsafe;
        } else {
            assert_eq!(num_unsafe, 0, "{path} has `unsafe`");
        }
    }
    assert!(num_inside > 0, "the reader finds no `unsafe` at all");
}

#[test]
fn every_file_says_first_what_it_is_for() {
    let mut found = Vec::new();
    for folder in FOLDERS.into_iter().chain(["eval/src"]) {
        for (path, source) in rust_files(folder) {
            let paragraph: Vec<&str> = (source.lines())
                .map_while(|line| line.strip_prefix("//! "))
                .collect();
            let paragraph = paragraph.join(" ");
            if !(paragraph.contains('?') || paragraph.trim_end().ends_with(['.', ':'])) {
                found.push(format!(
                    "{path}: the first line is no `//!` question or statement"
                ));
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn every_lint_that_is_switched_off_says_why() {
    let mut found = Vec::new();
    for folder in FOLDERS.into_iter().chain(["eval"]) {
        for (path, source) in rust_files(folder) {
            let lines: Vec<&str> = source.lines().collect();
            for (at, line) in lines.iter().enumerate() {
                let line = line.trim_start();
                let switched = ["#[allow(", "#![allow(", "#[expect(", "#![expect("]
                    .iter()
                    .any(|attribute| line.starts_with(attribute));
                let near = &lines[at..lines.len().min(at + 4)];
                if switched && !near.iter().any(|line| line.contains("reason")) {
                    found.push(format!("{path}: line {}: no reason", at + 1));
                }
            }
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// `make test` counts the tests that ran on real data by their names.
#[test]
fn tests_on_real_data_say_so_in_their_names() {
    let mut found = Vec::new();
    for (path, source) in rust_files("tests/it")
        .into_iter()
        .chain(rust_files("eval/tests"))
    {
        if path.ends_with("/architecture.rs") {
            continue;
        }
        found.extend(misnamed(&source).map(|name| format!("{path}: {name}")));
    }
    assert!(
        found.is_empty(),
        "tests read CHRONOTOPE_DATA if and only if their names begin with `real_data_`:\n{}",
        found.join("\n")
    );
}

/// Whoever could write to their fields could put logs out of step with visits.
#[test]
fn what_must_be_in_step_stands_in_no_public_field() {
    let sources = rust_files("src/map");
    for name in ["Node", "Snapshot"] {
        let head = format!("pub struct {name} {{");
        let mut fields = sources.iter().filter_map(|(_, source)| {
            let code = blank(source);
            let open = code.find(&head)? + head.len() - 1;
            Some(code[open + 1..matching_brace(&code, open)].to_owned())
        });
        let found = fields.next().unwrap();
        assert!(found.contains(": "), "{name} has fields");
        assert!(
            words(&found.replace("pub(super)", "")).all(|word| word != "pub"),
            "{name} has a field that others can write to: {found}"
        );
    }
}

/// Else what the workspaces build in one folder for their tests would be built more than once (minutes).
#[test]
fn all_lock_files_name_the_same_versions() {
    let locked = |path: &str| -> Vec<(String, String)> {
        let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
        let lock: toml::Table = text.parse().unwrap();
        let text = |package: &toml::Value, key: &str| package[key].as_str().unwrap().to_owned();
        (lock["package"].as_array().unwrap().iter())
            .map(|package| (text(package, "name"), text(package, "version")))
            .collect()
    };
    // Versions that cargo takes for each other: equal up to the first number that is not zero.
    let family = |version: &str| -> Vec<String> {
        let mut is_first = true;
        version
            .split('.')
            .take_while(|number| std::mem::replace(&mut is_first, *number == "0"))
            .map(str::to_owned)
            .collect()
    };
    let ours = locked("Cargo.lock");
    for other in ["bindings", "bindings/python", "crates/dashboard", "fuzz"] {
        let path = format!("{other}/Cargo.lock");
        let differ: Vec<_> = locked(&path)
            .into_iter()
            .filter(|(name, version)| {
                ours.iter()
                    .any(|(n, v)| n == name && v != version && family(v) == family(version))
            })
            .collect();
        assert!(
            differ.is_empty(),
            "{differ:?} of {path} have other versions in Cargo.lock (help: `cargo update --precise`)"
        );
    }
}

#[test]
fn a_misnamed_test_on_real_data_is_found() {
    let source = "fn root() -> Option<PathBuf> {\n    var(\"CHRONOTOPE_DATA\")\n}\n\n\
                  fn door() {\n    root();\n}\n\n\
                  #[test]\nfn real_data_door() {\n    door();\n}\n\n\
                  #[test]\nfn hidden() {\n    door();\n}\n\n\
                  #[test]\nfn real_data_only_by_name() {\n    window();\n}\n\n\
                  #[test]\nfn plain() {\n    window();\n}\n";
    let found: Vec<String> = misnamed(source).collect();
    assert_eq!(found, ["hidden", "real_data_only_by_name"]);
}

/// How many rooms a file names, and a line for each that it must not name.
fn judge(path: &str, source: &str) -> (usize, Vec<String>) {
    let numbers: BTreeMap<&str, u32> = ROOMS.into();
    let own = room(path);
    let own_number = numbers.get(own).copied().unwrap_or(u32::MAX);
    let mut violations = Vec::new();
    let code = without_tests(&blank(source));
    let rooms = named_rooms(&code, depth(path));
    for name in &rooms {
        let Some(number) = numbers.get(name.as_str()) else {
            violations.push(format!("{path} names `crate::{name}`, which is no room"));
            continue;
        };
        // A file of one room names its own room freely.
        if name != own && *number >= own_number {
            violations.push(format!("{path}: room `{own}` must not name room `{name}`"));
        }
    }
    let of_time = names_behind(&code, |code, at| {
        let prefix = "fremen::";
        code[at..].starts_with(prefix).then_some(at + prefix.len())
    });
    if VISION.contains(&own) {
        for name in of_time.iter().filter(|it| !TIMELESS.contains(&&***it)) {
            violations.push(format!(
                "{path}: room `{own}` must not name `fremen::{name}`"
            ));
        }
    }
    if own != KEPT && words(&code).any(|word| word == "chronotope_store") {
        violations.push(format!("{path}: room `{own}` must not name the store"));
    }
    (rooms.len() + of_time.len(), violations)
}

/// The room that a file of `src/` belongs to.
fn room(path: &str) -> &str {
    let inside = path.strip_prefix("src/").unwrap_or(path);
    let end = inside.find('/').unwrap_or(inside.len());
    inside[..end].trim_end_matches(".rs")
}

/// How many `super` lead from a file's module to the crate's root.
fn depth(path: &str) -> usize {
    let inside = path.strip_prefix("src/").unwrap_or(path);
    let parts = inside.split('/').count();
    let is_root = matches!(inside, "lib.rs" | "main.rs");
    parts - usize::from(inside.ends_with("/mod.rs") || is_root)
}

/// The first names of all paths from the crate's root.
fn named_rooms(code: &str, depth: usize) -> Vec<String> {
    names_behind(code, |code, at| from_root(code, at, depth))
}

/// The first names of all paths with a prefix: `behind` says where it ends if it starts at a
/// position.
fn names_behind(code: &str, behind: impl Fn(&str, usize) -> Option<usize>) -> Vec<String> {
    let mut names = Vec::new();
    let bytes = code.as_bytes();
    let mut at = 0;
    while at < code.len() {
        let starts_word = is_word(bytes[at]) && (at == 0 || !is_word(bytes[at - 1]));
        let Some(mut end) = starts_word.then(|| behind(code, at)).flatten() else {
            at += 1;
            continue;
        };
        if bytes.get(end) == Some(&b'{') {
            // A group: the first word of each of its members.
            let close = matching_brace(code, end);
            let (mut level, mut fresh) = (0, true);
            while end < close {
                match bytes[end] {
                    b'{' => level += 1,
                    b'}' => level -= 1,
                    b',' if level == 1 => fresh = true,
                    byte if is_word(byte) && level == 1 && fresh => {
                        let word = word_at(code, end);
                        names.push(word.to_owned());
                        fresh = false;
                        end += word.len() - 1;
                    }
                    _ => {}
                }
                end += 1;
            }
        } else {
            names.push(word_at(code, end).to_owned());
        }
        at = end + 1;
    }
    names.retain(|name| !name.is_empty());
    names
}

/// Behind `crate::`, or behind as many `super::` as lead to the crate's root, if they start at
/// `at`.
fn from_root(code: &str, at: usize, depth: usize) -> Option<usize> {
    let rest = &code[at..];
    if rest.starts_with("crate::") {
        return Some(at + "crate::".len());
    }
    let supers = "super::".repeat(depth);
    (depth > 0 && rest.starts_with(&supers) && !rest[supers.len()..].starts_with("super::"))
        .then_some(at + supers.len())
}

/// The tests of a file that use the real data without saying so, or say so without using them.
fn misnamed(source: &str) -> impl Iterator<Item = String> {
    let functions = functions(source);
    let mut reading: BTreeSet<&str> = BTreeSet::new();
    loop {
        let before = reading.len();
        for function in &functions {
            let body = blank(function.body);
            let calls = words(&body).any(|word| word != function.name && reading.contains(word));
            if calls || function.body.contains("\"CHRONOTOPE_DATA\"") {
                reading.insert(function.name);
            }
        }
        if reading.len() == before {
            break;
        }
    }
    let found: Vec<String> = (functions.iter())
        .filter(|function| function.is_test)
        .map(|function| function.name)
        .filter(|name| name.starts_with("real_data_") != reading.contains(name))
        .map(ToOwned::to_owned)
        .collect();
    found.into_iter()
}

struct Function<'a> {
    name: &'a str,
    is_test: bool,
    body: &'a str,
}

/// The functions that start and end at the beginning of a line, as rustfmt leaves them.
fn functions(source: &str) -> Vec<Function<'_>> {
    let mut functions = Vec::new();
    for (start, _) in source
        .match_indices("\nfn ")
        .chain(source.match_indices("\npub fn "))
    {
        let head = &source[start + 1..];
        let name_at = head.find("fn ").unwrap_or(0) + 3;
        let end = head.find("\n}").unwrap_or(head.len());
        functions.push(Function {
            name: word_at(head, name_at),
            is_test: source[..start].ends_with("#[test]"),
            body: &head[..end],
        });
    }
    if let Some(head) = source.strip_prefix("fn ") {
        functions.push(Function {
            name: word_at(head, 0),
            is_test: false,
            body: &head[..head.find("\n}").unwrap_or(head.len())],
        });
    }
    functions
}
