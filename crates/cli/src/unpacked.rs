//! What is in this file, packed or not?

use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use fremen::error::{Error, ErrorKind, Result};

/// Bytes of what is read here, unpacked, at most: a small file cannot claim more memory than that.
const MAX_BYTES: u64 = 1 << 27;

/// All of a file, or of stdin (`-`), unpacked if it is packed with gzip.
pub(super) fn unpacked(path: &Path) -> Result<Vec<u8>> {
    let fail = |cause: std::io::Error| Error::io(path, cause);
    let source: Box<dyn Read> = if path == Path::new("-") {
        Box::new(std::io::stdin().lock())
    } else {
        Box::new(fremen::file::open(path)?)
    };
    let mut source = BufReader::new(source);
    let is_packed = source.fill_buf().map_err(fail)?.starts_with(&[0x1F, 0x8B]);
    let mut content: Box<dyn Read> = if is_packed {
        Box::new(flate2::bufread::MultiGzDecoder::new(source))
    } else {
        Box::new(source)
    };
    let mut bytes = Vec::new();
    let len = (content.by_ref().take(MAX_BYTES + 1).read_to_end(&mut bytes)).map_err(|cause| {
        if !is_packed {
            return fail(cause);
        }
        Error::new(ErrorKind::Format, format!("it cannot be unpacked: {cause}"))
            .with_path(path)
            .with_help("copy it or pack it again")
    })?;
    if len as u64 > MAX_BYTES {
        return Err(Error::new(
            ErrorKind::Format,
            format!("more than {MAX_BYTES} bytes of content"),
        )
        .with_path(path)
        .with_help("give a part of it"));
    }
    Ok(bytes)
}
