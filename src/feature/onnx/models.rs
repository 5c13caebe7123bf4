//! Where is the model that a map was learnt with?
//!
//! A map knows its model by the digest of the file, not by a path: the file may lie elsewhere on
//! the next robot. [`Models`] are the places to look at, and what is found is read whole and
//! compared, so that no other model ever answers.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use fremen::error::{Error, ErrorKind, Result};

/// Larger models than this are not read; those that fit into a robot's time are a tenth of it.
const MAX_BYTES: u64 = 256 << 20;

/// SHA-256 of a model's file; written in hexadecimal.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ModelDigest([u8; 32]);

impl ModelDigest {
    /// Of these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }
}

impl fmt::Display for ModelDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for ModelDigest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ModelDigest({self})")
    }
}

impl FromStr for ModelDigest {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let digit = |digit: u8| char::from(digit).to_digit(16);
        let byte = |pair: &[u8; 2]| Some((digit(pair[0])? << 4 | digit(pair[1])?) as u8);
        let bytes: Option<Vec<u8>> = match text.as_bytes().as_chunks::<2>() {
            (pairs, []) => pairs.iter().map(byte).collect(),
            _ => None,
        };
        let digest = bytes.and_then(|bytes| bytes.try_into().ok());
        digest.map(Self).ok_or_else(|| {
            let message = format!("`{text}` is no digest of a model");
            Error::new(ErrorKind::Config, message)
                .with_help("write the 64 hexadecimal digits that `sha256sum` prints")
        })
    }
}

impl TryFrom<String> for ModelDigest {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<ModelDigest> for String {
    fn from(digest: ModelDigest) -> Self {
        digest.to_string()
    }
}

/// A model's file that was found and read.
pub struct Model {
    /// Where it is.
    pub path: PathBuf,
    /// What it is known by.
    pub digest: ModelDigest,
    /// All of it.
    pub bytes: Vec<u8>,
}

impl Model {
    /// Reads a file of at most 256 MiB.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = fremen::file::read(path, MAX_BYTES)?;
        Ok(Self {
            path: path.to_owned(),
            digest: ModelDigest::of(&bytes),
            bytes,
        })
    }
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Model")
            .field("path", &self.path)
            .field("digest", &self.digest)
            .finish_non_exhaustive()
    }
}

/// Where models are looked for: files that are named, then folders in which a model is called
/// `DIGEST.onnx`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Models {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
}

impl Models {
    /// The environment variable that names a folder of models.
    pub const VARIABLE: &'static str = "CHRONOTOPE_MODELS";

    /// Nowhere yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// In the folder that the environment variable [`VARIABLE`](Self::VARIABLE) names, if it does.
    pub fn from_env() -> Self {
        match std::env::var_os(Self::VARIABLE) {
            Some(folder) if !folder.is_empty() => Self::new().with_folder(folder),
            _ => Self::new(),
        }
    }

    /// Also this file, whatever it is called.
    #[must_use]
    pub fn with_file(mut self, path: impl Into<PathBuf>) -> Self {
        self.files.push(path.into());
        self
    }

    /// Also the models of this folder, each called `DIGEST.onnx`.
    #[must_use]
    pub fn with_folder(mut self, path: impl Into<PathBuf>) -> Self {
        self.folders.push(path.into());
        self
    }

    /// The model with this digest or, if none is wanted, the one file that was named.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::NotFound`] if it is nowhere; [`ErrorKind::Format`] if a file of a folder is not
    /// what its name says, or too large; [`ErrorKind::Config`] if no digest is wanted and not
    /// exactly one file was named; those of reading.
    pub fn find(&self, wanted: Option<ModelDigest>) -> Result<Model> {
        let Some(wanted) = wanted else {
            return match &*self.files {
                [path] => Model::read(path),
                files => Err(Error::new(
                    ErrorKind::Config,
                    format!("which model? {} files are given", files.len()),
                )
                .with_help("give one with --model FILE, or its digest as `model`")),
            };
        };
        let mut others = Vec::new();
        for path in &self.files {
            let model = Model::read(path)?;
            if model.digest == wanted {
                return Ok(model);
            }
            others.push(model);
        }
        for folder in &self.folders {
            let path = folder.join(format!("{wanted}.onnx"));
            let model = match Model::read(&path) {
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                read => read?,
            };
            if model.digest == wanted {
                return Ok(model);
            }
            let message = format!("this model is another one: its digest is {}", model.digest);
            let help = "copy the model again; a file in a folder of models bears its own digest";
            let error = Error::new(ErrorKind::Format, message).with_path(path);
            return Err(error.with_help(help));
        }
        Err(self.missing(wanted, others.first()))
    }

    fn missing(&self, wanted: ModelDigest, other: Option<&Model>) -> Error {
        let help = match &*self.folders {
            [] => format!(
                "give it with --model FILE, or name the folder that has it as {wanted}.onnx in the \
                 environment variable {}",
                Self::VARIABLE
            ),
            folders => {
                let folders: Vec<_> = folders.iter().map(|path| path.to_string_lossy()).collect();
                format!(
                    "give it with --model FILE, or copy it to {wanted}.onnx in {}",
                    folders.join(" or ")
                )
            }
        };
        let error = match other {
            Some(other) => Error::new(
                ErrorKind::NotFound,
                format!("this is another model: {}, not {wanted}", other.digest),
            )
            .with_path(&other.path),
            None => Error::new(
                ErrorKind::NotFound,
                format!("the model {wanted} is not there"),
            ),
        };
        error.with_help(help)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_digest_is_that_of_sha256sum_and_reads_back() {
        let digest = ModelDigest::of(b"abc");
        let text = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest.to_string(), text);
        assert_eq!(text.parse::<ModelDigest>().expect("its own text"), digest);
        for bad in ["", "ba78", &text[1..], &text.replace('b', "g"), "\u{e9}"] {
            let error = bad.parse::<ModelDigest>().expect_err(bad);
            assert!(error.to_string().contains("64 hexadecimal"), "{error}");
        }
    }

    #[test]
    fn a_model_is_found_by_its_digest_and_never_taken_for_another() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("written");
            path
        };
        let (one, two) = (ModelDigest::of(b"one"), ModelDigest::of(b"two"));
        let file = write("eye.onnx", b"one");
        let named = Models::new().with_file(&file);
        assert_eq!(named.find(None).expect("the only one").digest, one);
        assert_eq!(named.find(Some(one)).expect("it").path, file);
        let error = named.find(Some(two)).expect_err("another");
        assert_eq!(error.kind(), ErrorKind::NotFound);
        assert_eq!(error.path(), Some(&*file));
        assert!(error.to_string().contains(&two.to_string()), "{error}");

        let both = named.clone().with_folder(folder.path());
        let error = both.find(Some(two)).expect_err("nowhere");
        assert!(
            error.help().expect("help").contains("copy it to"),
            "{error}"
        );
        let path = write(&format!("{two}.onnx"), b"two");
        assert_eq!(both.find(Some(two)).expect("in the folder").path, path);
        write(&format!("{two}.onnx"), b"three");
        let error = both.find(Some(two)).expect_err("changed");
        assert_eq!(
            (error.kind(), error.path()),
            (ErrorKind::Format, Some(&*path))
        );

        for models in [Models::new(), named.with_file("b.onnx")] {
            let error = models.find(None).expect_err("not one");
            assert_eq!(error.kind(), ErrorKind::Config);
        }
        let error = Models::new().find(Some(one)).expect_err("nowhere");
        assert!(error.to_string().contains(Models::VARIABLE), "{error}");
    }

    #[test]
    fn a_file_too_large_for_a_model_is_not_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("huge.onnx");
        let file = std::fs::File::create(&path).expect("created");
        file.set_len(MAX_BYTES + 1).expect("sparse");
        let error = Model::read(&path).expect_err("too large");
        assert_eq!(
            (error.kind(), error.path()),
            (ErrorKind::Format, Some(&*path))
        );
    }
}
