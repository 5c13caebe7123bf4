//! What do the sources say once comments, strings and test code are taken out?
//!
//! The sources are read as text, which needs no compiler.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The code without what is compiled for tests only.
pub(crate) fn without_tests(code: &str) -> String {
    let mut out = String::new();
    let mut rest = code;
    while let Some(start) = rest.find("#[cfg(test)]") {
        out.push_str(&rest[..start]);
        let item = &rest[start..];
        let brace = item.find('{').unwrap_or(item.len());
        let end = match item.find(';') {
            Some(semicolon) if semicolon < brace => semicolon,
            _ => matching_brace(item, brace),
        };
        rest = item.get(end + 1..).unwrap_or("");
    }
    out.push_str(rest);
    out
}

/// The position of the brace that closes the one at `open`.
pub(crate) fn matching_brace(code: &str, open: usize) -> usize {
    let mut level = 0;
    for (at, byte) in code.bytes().enumerate().skip(open) {
        match byte {
            b'{' => level += 1,
            b'}' => level -= 1,
            _ => {}
        }
        if level == 0 {
            return at;
        }
    }
    code.len()
}

/// The same text with comments, strings and characters made blank, line for line.
pub(crate) fn blank(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(first) = rest.chars().next() {
        // The `r` of `for` starts no raw string.
        let ends_word = first == 'r' && out.bytes().last().is_some_and(is_word);
        let len = if ends_word { 0 } else { opaque_len(rest) };
        if len == 0 {
            // Everything but ASCII can only stand in names that are not searched for.
            out.push(if first.is_ascii() { first } else { '_' });
            rest = &rest[first.len_utf8()..];
            continue;
        }
        let opaque = &rest[..len];
        out.extend(opaque.chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        rest = &rest[len..];
    }
    out
}

/// Bytes of the comment, string or character that `text` starts with; 0 if it starts with code.
pub(crate) fn opaque_len(text: &str) -> usize {
    let until = |end: &str, from: usize| {
        text[from..]
            .find(end)
            .map_or(text.len(), |at| from + at + end.len())
    };
    let quoted = |quote: u8| {
        let bytes = text.as_bytes();
        let mut at = 1;
        while at < bytes.len() && bytes[at] != quote {
            at += if bytes[at] == b'\\' { 2 } else { 1 };
        }
        (at + 1).min(bytes.len())
    };
    if text.starts_with("//") {
        return text.find('\n').unwrap_or(text.len());
    }
    if text.starts_with("/*") {
        return until("*/", 2);
    }
    if text.starts_with('"') {
        return quoted(b'"');
    }
    if let Some(raw) = text.strip_prefix('r') {
        let hashes = raw.bytes().take_while(|&byte| byte == b'#').count();
        if raw[hashes..].starts_with('"') {
            return until(&format!("\"{}", "#".repeat(hashes)), hashes + 2);
        }
    }
    if let Some(character) = text.strip_prefix('\'') {
        let mut chars = character.chars();
        let escaped = chars.next() == Some('\\');
        // `'a` without a closing quote is a lifetime.
        if escaped || chars.next() == Some('\'') {
            return quoted(b'\'');
        }
    }
    0
}

pub(crate) fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
        .filter(|word| !word.is_empty())
}

pub(crate) fn word_at(code: &str, at: usize) -> &str {
    let rest = &code[at..];
    let end = rest.bytes().position(|byte| !is_word(byte));
    &rest[..end.unwrap_or(rest.len())]
}

pub(crate) fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

/// Every Rust file below a folder of the repository: its path from there, and its text.
pub(crate) fn rust_files(folder: &str) -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    let mut folders = vec![root.join(folder)];
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(&folder) else {
            // A published package has no `eval`.
            continue;
        };
        for entry in entries {
            let path: PathBuf = entry.unwrap().path();
            if path.is_dir() {
                // What cargo has built is not ours.
                if path.file_name() != Some("target".as_ref()) {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let name = path.strip_prefix(root).unwrap().to_str().unwrap();
                files.push((name.replace('\\', "/"), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    files.sort_unstable();
    files
}

/// The files below a folder of sources that are compiled outside of tests.
pub(crate) fn library_files(folder: &str) -> Vec<(String, String)> {
    let mut files = rust_files(folder);
    let mut test_files = BTreeSet::new();
    for (path, source) in &files {
        let code = blank(source);
        for (at, attribute) in code.match_indices("#[cfg(test)]") {
            let item = code[at + attribute.len()..].trim_start();
            if let Some(name) = item.strip_prefix("mod ").and_then(|m| m.split_once(';'))
                && words(name.0).count() == 1
                && !name.0.contains('{')
            {
                let folder = Path::new(path).parent().unwrap_or(Path::new(""));
                test_files.insert(folder.join(format!("{}.rs", name.0.trim())));
            }
        }
    }
    files.retain(|(path, _)| !test_files.contains(Path::new(path)));
    files
}
