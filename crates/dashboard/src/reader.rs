//! Which localisations does a file or a pipe hold?
//!
//! One line at a time, so that memory does not grow with the session; a line that is too long to be
//! a trace is refused before it is read.

use std::io::{BufRead, Read as _};

use anyhow::{Context, Result, bail, ensure};
use chronotope::trace::{SCHEMA_VERSION, Trace};

/// Lines longer than this are refused: a place of 300 features takes about 20 kB, so this is a map
/// of thousands of places.
pub const MAX_LINE_BYTES: u64 = 256 << 20;

/// Reads traces from lines of JSON; empty lines are skipped.
pub struct TraceReader<R> {
    input: R,
    line: Vec<u8>,
    number: u64,
    max_bytes: u64,
}

impl<R: BufRead> TraceReader<R> {
    /// Reads from `input`.
    pub fn new(input: R) -> Self {
        Self {
            input,
            line: Vec::new(),
            number: 0,
            max_bytes: MAX_LINE_BYTES,
        }
    }

    /// The number of the line that was read last, from 1.
    pub fn line_number(&self) -> u64 {
        self.number
    }

    /// The next localisation; `None` at the end.
    pub fn next_trace(&mut self) -> Result<Option<Trace<'static>>> {
        loop {
            self.line.clear();
            self.number += 1;
            let read = (&mut self.input)
                .take(self.max_bytes + 1)
                .read_until(b'\n', &mut self.line)
                .with_context(|| format!("line {} cannot be read", self.number))?;
            if read == 0 {
                return Ok(None);
            }
            ensure!(
                self.line.len() as u64 <= self.max_bytes,
                "line {} is longer than {} bytes: this is no trace (help: give the output of \
                 `chronotope localize ... --trace FILE`)",
                self.number,
                self.max_bytes
            );
            if self.line.trim_ascii().is_empty() {
                continue;
            }
            return parse(&self.line)
                .with_context(|| format!("line {}", self.number))
                .map(Some);
        }
    }
}

fn parse(line: &[u8]) -> Result<Trace<'static>> {
    let trace: Trace<'static> = serde_json::from_slice(line).context(
        "not a trace (help: give the output of `chronotope localize ... --trace FILE` or of \
         `chronotope-eval run SUITE --trace FILE`)",
    )?;
    if trace.schema_version > SCHEMA_VERSION {
        bail!(
            "its schema version is {}, and this program reads up to {SCHEMA_VERSION} \
             (help: build the dashboard of the same version as the program that wrote it)",
            trace.schema_version
        );
    }
    Ok(trace)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Option<Trace<'static>>> {
        TraceReader::new(text.as_bytes()).next_trace()
    }

    fn refused(text: &str) -> String {
        format!("{:#}", read(text).expect_err("refused"))
    }

    /// A line as the first version of the program wrote it: no stages, no map, no picture.
    const OLD: &str = r#"{"schema_version":1,"image":"a.png","file":"a.png","recipe":"",
        "image_size":[320,240],"time":"2024-01-01T00:00:00Z","time_source":"option","truth":null,
        "map_uuid":"00","map_generation":1,"method":"fremen","score":"likelihood",
        "selection":{"top":50},"places":["a"],"live":[[1,2,3,4]],"predicted":[[[1,2,3,4]]],
        "localization":{"ranking":[{"node":0,"score":1.5,"posterior":0.9,"appearance":null,
        "predicted":[0],"probabilities":[0.5],"matches":[{"rank":0,"live":0,"distance-bits":3,
        "inlier":true}],"num-matches":1,"num-inliers":1,"displacement":{"num-inliers":1,
        "mean":{"dx-px":0,"dy-px":0},"median":{"dx-px":0,"dy-px":0},
        "spread":{"dx-px":0,"dy-px":0}}}],
        "tied":1,"elsewhere":0.1,"decision":{"at":0},"reason":{"best":1.5,"second":null,
        "rule":{"min-score":1}},"pairs-compared":1,"time":0},"duration_ms":3.5}"#;

    #[test]
    fn lines_of_the_first_version_are_read() {
        let line = OLD.replace('\n', "");
        let trace = read(&line).expect("readable").expect("a trace");
        assert!(trace.stages.is_empty() && trace.map.is_none() && trace.jpeg.is_none());
        assert_eq!(trace.localization.ranking[0].matches[0].distance_bits, 3);
    }

    #[test]
    fn bad_lines_are_refused_with_their_number() {
        assert!(refused("\n\n{\"a\": 1}\n").contains("line 3"));
        assert!(refused("what?").contains("line 1"));
        assert!(refused("\u{0}\n").contains("not a trace"));
        let newer = OLD
            .replace('\n', "")
            .replace("\"schema_version\":1", "\"schema_version\":9");
        assert!(refused(&newer).contains("schema version is 9"));
        assert!(read(" \n\n").expect("only empty lines").is_none());
    }

    #[test]
    fn a_line_without_end_is_refused_before_it_is_read() {
        let mut reader = TraceReader::new(std::io::BufReader::new(std::io::repeat(b' ')));
        reader.max_bytes = 1 << 20;
        let error = format!("{:#}", reader.next_trace().expect_err("refused"));
        assert!(error.contains("line 1 is longer"), "{error}");
        assert!(reader.line.capacity() < 4 << 20);
    }
}
