//! Where is what a packed file of a bag holds?
//!
//! A file of rosbag2 in compression mode `file` is one zstd stream, which cannot be read from the
//! middle. It is unpacked once into the folder for temporary files and removed with the bag.

use std::io::{ErrorKind as IoErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use chronotope::dataset::Problem;
use chronotope::error::{Error, ErrorKind, Result};
use fremen::file::OutputFile;

use super::types::file_name;

/// Bytes that are unpacked at a time.
const STEP_BYTES: usize = 1 << 16;

/// A file that goes when this does.
#[derive(Debug)]
pub(super) struct Unpacked(PathBuf);

impl Unpacked {
    /// Of a packed file; where that ends early or is damaged, what came before it, and a problem.
    pub(super) fn of(packed: &Path) -> Result<(Self, Option<Problem>)> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("chronotope-bag-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let file = fremen::file::open(packed)?;
        let mut decoder = zstd::Decoder::new(file).map_err(|cause| Error::io(packed, cause))?;
        let mut out = OutputFile::begin_new(&path)?;
        let mut step = vec![0; STEP_BYTES];
        let mut num_bytes = 0_u64;
        let why = loop {
            match decoder.read(&mut step) {
                Ok(0) => break None,
                Ok(len) => {
                    out.write_all(&step[..len]).map_err(|cause| {
                        Error::io(&path, cause)
                            .with_help("TMPDIR names the folder that packed bags are unpacked to")
                    })?;
                    num_bytes += len as u64;
                }
                Err(cause) if cause.kind() == IoErrorKind::Interrupted => {}
                Err(cause) => break Some(cause),
            }
        };
        if num_bytes == 0 {
            let why = why.map_or_else(|| "it is empty".into(), |cause| cause.to_string());
            return Err(
                Error::new(ErrorKind::Format, format!("nothing can be unpacked: {why}"))
                    .with_path(packed)
                    .with_help("copy the bag again"),
            );
        }
        out.finish()?;
        let problem = why.map(|why| {
            Problem::new(
                file_name(packed),
                format!(
                    "the packed file is damaged or cut off: {why}; the {num_bytes} bytes before that \
                     are read (help: copy the bag again)"
                ),
            )
        });
        Ok((Self(path), problem))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Unpacked {
    fn drop(&mut self) {
        // In the folder for temporary files; there is nobody to tell.
        let _ = std::fs::remove_file(&self.0);
    }
}
