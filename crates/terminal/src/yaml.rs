//! What does a small YAML text say that may come from anybody?

use yaml_rust2::parser::{Event, Parser};
use yaml_rust2::{Yaml, YamlLoader};

/// How deep lists and tables may be in each other.
const MAX_DEPTH: usize = 32;

/// The first document of a YAML text. Aliases, which can make a small text huge, are refused, and so
/// is deep nesting.
pub fn document(text: &str) -> std::result::Result<Yaml, String> {
    let mut parser = Parser::new_from_str(text);
    let mut depth = 0;
    loop {
        let (event, marker) = parser.next_token().map_err(|cause| cause.to_string())?;
        let line = marker.line();
        match event {
            Event::StreamEnd => break,
            Event::Alias(_) => return Err(format!("line {line} has an alias, which is not read")),
            Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
            Event::SequenceEnd | Event::MappingEnd => depth -= 1,
            _ => {}
        }
        if depth > MAX_DEPTH {
            return Err(format!("line {line} is nested more than {MAX_DEPTH} deep"));
        }
    }
    let documents = YamlLoader::load_from_str(text).map_err(|cause| cause.to_string())?;
    Ok(documents.into_iter().next().unwrap_or(Yaml::BadValue))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aliases_and_deep_nesting_are_refused() {
        assert!(document("a: &x [1]\nb: *x\n").is_err_and(|it| it.contains("line 2")));
        assert!(document(&"[".repeat(100_000)).is_err());
        let deep = format!("{}1{}", "[".repeat(40), "]".repeat(40));
        assert!(document(&deep).is_err_and(|it| it.contains("nested")));
        assert!(document("a: [1, {b: 2}]\n").is_ok_and(|it| !it["a"].is_badvalue()));
    }
}
