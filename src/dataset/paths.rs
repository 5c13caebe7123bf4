//! Which files are in a folder, what are they called, what is in them?

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use fremen::error::{Error, Result};

/// File name extensions of images, in order of preference.
const IMAGE_EXTENSIONS: [&str; 10] = [
    "ppm", "png", "webp", "jpg", "jpeg", "bmp", "tiff", "tif", "pgm", "pnm",
];

/// The number that `text` is in decimal digits alone.
pub(super) fn digits(text: &str) -> Option<i64> {
    (!text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit()))
        .then(|| text.parse().ok())
        .flatten()
}

/// Position of the file's extension in [`IMAGE_EXTENSIONS`].
pub(super) fn image_rank(path: &Path) -> Option<usize> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    IMAGE_EXTENSIONS
        .iter()
        .position(|&known| known == extension)
}

pub(super) fn name_of(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

pub(super) fn stem_of(path: &Path) -> String {
    path.file_stem()
        .map(|stem| stem.to_string_lossy().into_owned())
        .unwrap_or_default()
}

/// `path` relative to `root`, with `/` between folders on every system.
pub(super) fn relative(root: &Path, path: &Path) -> String {
    let relative = path.strip_prefix(root).unwrap_or(path);
    let parts: Vec<_> = relative
        .components()
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/")
}

/// What is in a folder: sorted by name without extension, then by preference of extension.
pub(super) fn list(dir: &Path) -> Result<Vec<PathBuf>> {
    let io = |cause: std::io::Error| Error::io(dir, cause);
    let mut paths = fs::read_dir(dir)
        .map_err(io)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<std::io::Result<Vec<_>>>()
        .map_err(io)?;
    paths.sort_by_cached_key(|path| (stem_of(path), image_rank(path), name_of(path)));
    Ok(paths)
}

/// SHA-256 of a file's bytes in hexadecimal.
pub(super) fn file_sha256(path: &Path) -> Result<String> {
    let io = |cause: std::io::Error| Error::io(path, cause);
    let mut file = fremen::file::open(path)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0; 1 << 16];
    loop {
        match std::io::Read::read(&mut file, &mut buffer).map_err(io)? {
            0 => return Ok(hex(&hasher.finalize())),
            length => hasher.update(&buffer[..length]),
        }
    }
}

/// Bytes in hexadecimal.
pub(super) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
