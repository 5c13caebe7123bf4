//! Is every file opened and written by the two modules that do so safely?
//!
//! `fremen::file` refuses what would hang or flood the memory, and writes so that nothing is lost
//! (`crates/fremen/src/file/`). The sources are read as text, as in `architecture`.

use crate::source_text::{blank, library_files, without_tests};

/// The modules that may open and write files by the system's own functions.
const DOORS: &str = "crates/fremen/src/file/";

/// What writes a file.
const WRITES: [&str; 7] = [
    "File::create",
    "File::create_new",
    "File::options",
    "fs::write",
    "fs::copy",
    "fs::hard_link",
    "OpenOptions",
];

/// What opens one to be read.
const READS: [&str; 6] = [
    "File::open",
    "fs::read(",
    "fs::read_to_string",
    "read_link",
    "ImageReader::open",
    "image::open",
];

/// Where files are opened otherwise, and why.
const READERS: [(&str, &str); 1] = [(
    "crates/store/src/heal.rs",
    "to synchronise a file that is there",
)];

/// Where files are written otherwise, and why.
const WRITERS: [(&str, &str); 1] = [(
    "eval/",
    "results of measurements, written beside and renamed",
)];

fn sources() -> impl Iterator<Item = (String, String)> {
    let folders = [
        "bindings/c/src",
        "bindings/mcap/src",
        "bindings/python/src",
        "bindings/ros2/src",
        "src",
        "crates/cli/src",
        "crates/explore/src",
        "crates/fleet/src",
        "crates/fremen/src",
        "crates/grid/src",
        "crates/store/src",
        "crates/terminal/src",
        "eval/src",
    ];
    (folders.into_iter().flat_map(library_files))
        .map(|(path, source)| (path, without_tests(&blank(&source))))
}

fn found(words: &[&str], others: &[(&str, &str)]) -> Vec<String> {
    let is_named = |path: &str| {
        path.starts_with(DOORS) || others.iter().any(|(other, _)| path.starts_with(other))
    };
    let mut found = Vec::new();
    for (path, code) in sources().filter(|(path, _)| !is_named(path)) {
        for (number, line) in code.lines().enumerate() {
            if words.iter().any(|word| names(line, word)) {
                found.push(format!("{path}: line {}: {}", number + 1, line.trim()));
            }
        }
    }
    found
}

/// Whether `word` stands in a line, and not as the end of a longer name (`GridFile::open`).
fn names(line: &str, word: &str) -> bool {
    (line.match_indices(word)).any(|(at, _)| !line[..at].ends_with(|it: char| it.is_alphanumeric()))
}

#[test]
fn a_longer_name_is_another_one() {
    assert!(names("let it = std::fs::File::open(path)?;", "File::open"));
    assert!(names("GridFile::open(a); File::open(b)", "File::open"));
    assert!(!names("let it = GridFile::open(path)?;", "File::open"));
}

#[test]
fn only_one_module_writes_files() {
    let found = found(&WRITES, &WRITERS);
    assert!(
        found.is_empty(),
        "write by `fremen::file::OutputFile`:\n{}",
        found.join("\n")
    );
}

#[test]
fn only_one_module_opens_files() {
    let others: Vec<(&str, &str)> = READERS
        .into_iter()
        .chain([("eval/", "measurements")])
        .collect();
    let found = found(&READS, &others);
    assert!(
        found.is_empty(),
        "open by `fremen::file::open`:\n{}",
        found.join("\n")
    );
}

#[test]
fn the_reader_of_sources_finds_what_it_looks_for() {
    let in_doors = sources().filter(|(path, _)| path.starts_with(DOORS));
    let code: String = in_doors.map(|(_, code)| code).collect();
    assert!(code.contains("OpenOptions") && code.contains("File::open"));
    for (path, _) in READERS.into_iter().chain(WRITERS) {
        assert!(
            sources().any(|(it, _)| it.starts_with(path)),
            "{path} is not there"
        );
    }
}
