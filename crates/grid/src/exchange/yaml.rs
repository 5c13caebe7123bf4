//! What does the YAML file of a `map_server` map say?

use std::path::{Component, Path, PathBuf};

use fremen::{Error, ErrorKind, Result};

use super::mode::MapMode;

/// The most bytes that such a file has: it has seven lines.
const MAX_BYTES: u64 = 1 << 16;

/// The description of a map.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Description {
    /// Relative to the folder of the YAML file, and inside of it.
    pub(super) image: PathBuf,
    pub(super) resolution_m: f64,
    pub(super) origin_m: [f64; 2],
    pub(super) negate: bool,
    pub(super) occupied_thresh: f64,
    pub(super) free_thresh: f64,
    pub(super) mode: MapMode,
}

/// A value with the line it stands in.
#[derive(Clone, Debug)]
struct Value {
    line: usize,
    items: Vec<String>,
    is_list: bool,
}

impl Description {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = fremen::file::read_text(path, MAX_BYTES)?;
        Self::parse(&text).map_err(|error| error.with_path(path))
    }

    fn parse(text: &str) -> Result<Self> {
        let mut keys = Keys::parse(text)?;
        let image = inside(&keys.text("image")?)?;
        let resolution_m = keys.number("resolution")?;
        let (origin, line) = keys.numbers("origin")?;
        let [x, y, yaw] = *origin else {
            return Err(format_error(line, "origin is not [x, y, yaw]"));
        };
        if yaw != 0.0 {
            return Err(
                format_error(line, format!("the map is rotated by {yaw} rad"))
                    .with_help("rotate the map so that its yaw is 0"),
            );
        }
        let occupied_thresh = keys.number("occupied_thresh")?;
        let free_thresh = keys.number("free_thresh")?;
        let inside = |value: f64| (0.0..=1.0).contains(&value);
        if !inside(occupied_thresh) || !inside(free_thresh) || free_thresh >= occupied_thresh {
            let message = format!(
                "the thresholds cross: free_thresh {free_thresh}, occupied_thresh \
                 {occupied_thresh}"
            );
            return Err(Error::new(ErrorKind::Format, message)
                .with_help("0 <= free_thresh < occupied_thresh <= 1"));
        }
        let negate = match keys.optional("negate") {
            None => false,
            Some(value) => match value.items[0].to_ascii_lowercase().as_str() {
                "0" | "false" | "no" => false,
                "1" | "true" | "yes" => true,
                other => {
                    return Err(format_error(
                        value.line,
                        format!("negate is {other}, not 0 or 1"),
                    ));
                }
            },
        };
        let mode = match keys.optional("mode") {
            None => MapMode::Trinary,
            Some(value) => MapMode::parse(&value.items[0]).ok_or_else(|| {
                format_error(value.line, format!("there is no mode {}", value.items[0]))
                    .with_help("use trinary, scale or raw")
            })?,
        };
        keys.finish()?;
        Ok(Self {
            image,
            resolution_m,
            origin_m: [x, y],
            negate,
            occupied_thresh,
            free_thresh,
            mode,
        })
    }

    /// The file's text; numbers come back as they are.
    pub(super) fn to_text(&self) -> String {
        let Self {
            resolution_m,
            origin_m: [x, y],
            occupied_thresh,
            free_thresh,
            ..
        } = self;
        format!(
            "image: {}\nmode: {}\nresolution: {resolution_m:?}\norigin: [{x:?}, {y:?}, 0]\n\
             negate: {}\noccupied_thresh: {occupied_thresh:?}\nfree_thresh: {free_thresh:?}\n",
            self.image.display(),
            self.mode.name(),
            u8::from(self.negate),
        )
    }
}

/// A path that stays inside of the folder it is relative to.
fn inside(path: &str) -> Result<PathBuf> {
    let stays = Path::new(path)
        .components()
        .all(|it| matches!(it, Component::Normal(_) | Component::CurDir));
    if stays && !path.is_empty() {
        return Ok(PathBuf::from(path));
    }
    Err(Error::new(
        ErrorKind::Format,
        format!(
            "image {} is not in the folder of this file",
            fremen::error::printable(path)
        ),
    )
    .with_help("put the image beside the YAML file and name it without a folder"))
}

fn format_error(line: usize, message: impl Into<String>) -> Error {
    Error::new(ErrorKind::Format, message).with_place(format!("line {line}"))
}

/// The keys of a file of one level, none of them twice.
struct Keys(Vec<(String, Value)>);

impl Keys {
    fn parse(text: &str) -> Result<Self> {
        let mut keys: Vec<(String, Value)> = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let line = without_comment(line);
            let trimmed = line.trim();
            if trimmed.is_empty() || trimmed == "---" || trimmed == "..." {
                continue;
            }
            if let Some(item) = trimmed.strip_prefix("- ") {
                // An item of the list that the last key begins.
                match keys.last_mut() {
                    Some((_, value)) if value.is_list => value.items.push(unquoted(item)),
                    _ => return Err(format_error(number, "an item of no list")),
                }
                continue;
            }
            let Some((key, value)) = trimmed.split_once(':') else {
                return Err(format_error(number, "this is not `key: value`"));
            };
            if line.starts_with(char::is_whitespace) {
                return Err(format_error(number, "a key is indented"));
            }
            let key = unquoted(key);
            if keys.iter().any(|(other, _)| *other == key) {
                let key = fremen::error::printable(&key).into_owned();
                return Err(format_error(number, format!("{key} is given twice")));
            }
            let value = value.trim();
            let list = value.strip_prefix('[').and_then(|it| it.strip_suffix(']'));
            let items = match list {
                Some(list) => list.split(',').map(unquoted).collect(),
                None if value.is_empty() => Vec::new(),
                None => vec![unquoted(value)],
            };
            let is_list = list.is_some() || value.is_empty();
            keys.push((
                key,
                Value {
                    line: number,
                    items,
                    is_list,
                },
            ));
        }
        Ok(Self(keys))
    }

    fn optional(&mut self, key: &str) -> Option<Value> {
        let at = self
            .0
            .iter()
            .position(|(it, value)| it == key && !value.items.is_empty())?;
        Some(self.0.remove(at).1)
    }

    fn required(&mut self, key: &str) -> Result<Value> {
        self.optional(key).ok_or_else(|| {
            Error::new(ErrorKind::Format, format!("{key} is missing")).with_help(
                "a map has image, resolution, origin, occupied_thresh, free_thresh, and may have \
                 mode and negate",
            )
        })
    }

    fn text(&mut self, key: &str) -> Result<String> {
        let value = self.required(key)?;
        match <[String; 1]>::try_from(value.items) {
            Ok([text]) if !value.is_list => Ok(text),
            _ => Err(format_error(value.line, format!("{key} is a list"))),
        }
    }

    fn numbers(&mut self, key: &str) -> Result<(Vec<f64>, usize)> {
        let value = self.required(key)?;
        let number = |text: &String| {
            text.parse()
                .ok()
                .filter(|it: &f64| it.is_finite())
                .ok_or_else(|| {
                    let text = fremen::error::printable(text);
                    format_error(value.line, format!("{key} is {text}, not a finite number"))
                })
        };
        let numbers: Result<Vec<f64>> = value.items.iter().map(number).collect();
        Ok((numbers?, value.line))
    }

    fn number(&mut self, key: &str) -> Result<f64> {
        match self.numbers(key)? {
            (numbers, _) if numbers.len() == 1 => Ok(numbers[0]),
            (_, line) => Err(format_error(line, format!("{key} is a list"))),
        }
    }

    /// Nothing may be left.
    fn finish(self) -> Result<()> {
        match self.0.first() {
            None => Ok(()),
            Some((key, value)) => {
                let key = fremen::error::printable(key);
                Err(format_error(value.line, format!("a map has no key {key}"))
                    .with_help("remove it, or correct its name"))
            }
        }
    }
}

/// A comment begins at a `#` at the start or behind a space, outside of quotes.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        match quote {
            Some(open) if c == open => quote = None,
            None if c == '"' || c == '\'' => quote = Some(c),
            None if c == '#' && before.is_whitespace() => return &line[..at],
            _ => {}
        }
        before = c;
    }
    line
}

fn unquoted(text: &str) -> String {
    let text = text.trim();
    for quote in ['"', '\''] {
        let inner = text
            .strip_prefix(quote)
            .and_then(|it| it.strip_suffix(quote));
        if let Some(inner) = inner {
            return inner.to_owned();
        }
    }
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: &str = "image: map.pgm\nresolution: 0.05\norigin: [-1.5, 2, 0.0]\nnegate: 0\n\
                         occupied_thresh: 0.65\nfree_thresh: 0.196\n";

    #[test]
    fn forms_that_programs_write_are_read() -> Result<()> {
        let plain = Description::parse(PLAIN)?;
        assert_eq!(plain.origin_m, [-1.5, 2.0]);
        assert_eq!(plain.mode, MapMode::Trinary);
        let block = "---\n# made by hand\nimage: \"map.pgm\" # beside it\nresolution: 5e-2\n\
                     origin:\n- -1.5\n  - 2\n- 0\nnegate: false\nmode: 'trinary'\n\
                     occupied_thresh: 0.65\nfree_thresh: 0.196\n";
        assert_eq!(Description::parse(block)?, plain);
        assert_eq!(Description::parse(&plain.to_text())?, plain);
        Ok(())
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, expected) in [
            ("resolution: 0.05\n", "", "resolution is missing"),
            ("0.05", "x", "line 2: resolution is x, not a finite number"),
            ("0.05", "nan", "resolution is nan"),
            ("negate: 0", "negate: 7", "line 4: negate is 7"),
            (
                "negate: 0",
                "inflation: 0",
                "line 4: a map has no key inflation",
            ),
            ("negate: 0", "mode: fuzzy", "there is no mode fuzzy"),
            ("negate: 0", "image: b.pgm", "line 4: image is given twice"),
            ("negate: 0", "  negate: 0", "line 4: a key is indented"),
            ("negate: 0", "negate", "line 4: this is not `key: value`"),
            ("0.196", "0.7", "the thresholds cross"),
            ("0.65", "1.5", "the thresholds cross"),
            (", 0.0]", ", 0.1]", "line 3: the map is rotated by 0.1 rad"),
            (", 0.0]", "]", "origin is not [x, y, yaw]"),
            ("map.pgm", "../map.pgm", "is not in the folder of this file"),
            (
                "map.pgm",
                "/etc/map.pgm",
                "is not in the folder of this file",
            ),
            ("map.pgm", "[a, b]", "image is a list"),
        ] {
            let text = PLAIN.replacen(from, to, 1);
            let error = Description::parse(&text).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error} for {expected}");
        }
    }
}
