//! What does a finished recording hold?

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::{Context, Result};
use rerun::external::re_log_encoding::DecoderApp;
use rerun::log::{Chunk, LogMsg};

/// The number of rows of each entity ([`crate::entities`], no slash in front) of the recording at
/// `path`.
///
/// Fails where the file is no recording or is not complete.
pub fn rows(path: &Path) -> Result<BTreeMap<String, usize>> {
    let broken = || format!("{} cannot be read as a recording", path.display());
    let file = File::open(path).with_context(broken)?;
    let mut rows = BTreeMap::new();
    for message in DecoderApp::decode_lazy(BufReader::new(file)) {
        if let LogMsg::ArrowMsg(_, message) = message.with_context(broken)? {
            let chunk = Chunk::from_arrow_msg(&message).with_context(broken)?;
            let entity = chunk.entity_path().to_string();
            *rows
                .entry(entity.trim_start_matches('/').to_owned())
                .or_insert(0) += chunk.num_rows();
        }
    }
    Ok(rows)
}
