//! Which files make up this bag?

use std::path::{Path, PathBuf};

use chronotope::dataset::Problem;
use chronotope::error::{Error, ErrorKind, Result};
use chronotope_terminal::yaml::document;
use yaml_rust2::Yaml;

/// What rosbag2 writes beside the files of a bag, once it is closed.
const METADATA: &str = "metadata.yaml";
/// Bytes of it, at most.
const MAX_METADATA_BYTES: u64 = 16 << 20;
/// How the names of bags end.
const ENDINGS: [&str; 4] = [".mcap", ".mcap.zstd", ".db3", ".db3.zstd"];

/// The files of a bag, in order.
pub(super) struct Listed {
    pub(super) files: Vec<PathBuf>,
    /// Whether every message is packed by itself.
    pub(super) packs_messages: bool,
    pub(super) problems: Vec<Problem>,
}

/// Of a folder what its `metadata.yaml` lists; of a file the file.
pub(super) fn list(path: &Path) -> Result<Listed> {
    let found = std::fs::metadata(path).map_err(|cause| Error::io(path, cause))?;
    if !found.is_dir() {
        // The folder around it says whether its messages are packed.
        let beside = path.parent().unwrap_or(Path::new(".")).join(METADATA);
        let packs_messages = match read(&beside) {
            Ok(metadata) => {
                metadata.packs_messages && metadata.files.iter().any(|it| same(it, path))
            }
            Err(_) => false,
        };
        return Ok(Listed {
            files: vec![path.to_owned()],
            packs_messages,
            problems: Vec::new(),
        });
    }
    let metadata = path.join(METADATA);
    if metadata.exists() {
        let listed = read(&metadata)?;
        let (files, missing): (Vec<_>, Vec<_>) =
            listed.files.into_iter().partition(|file| file.exists());
        if files.is_empty() {
            let message = "none of the files that it lists is there";
            return Err(Error::new(ErrorKind::NotFound, message)
                .with_path(&metadata)
                .with_help("copy the whole folder"));
        }
        let problems = missing.iter().map(|file| {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            Problem::new(
                name,
                "the bag's metadata.yaml lists it, but it is not there (help: copy the whole folder)",
            )
        });
        return Ok(Listed {
            packs_messages: listed.packs_messages,
            problems: problems.collect(),
            files,
        });
    }
    let files = all_in(path)?;
    if files.is_empty() {
        return Err(
            Error::new(ErrorKind::Format, "there is no bag in this folder")
                .with_path(path)
                .with_help(
                    "name the folder that `ros2 bag record` has written, or a .mcap or .db3 file",
                ),
        );
    }
    let problem = Problem::new(
        METADATA,
        format!(
            "it is missing, as where a recorder was killed: all {} bags in the folder are read (help: \
             `ros2 bag reindex` writes it)",
            files.len()
        ),
    );
    Ok(Listed {
        files,
        packs_messages: false,
        problems: vec![problem],
    })
}

/// Whether two paths name one file.
fn same(one: &Path, other: &Path) -> bool {
    one.file_name() == other.file_name()
}

/// The bags in a folder, by name; numbers in names count as numbers (`a_2` before `a_10`).
fn all_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let io = |cause| Error::io(folder, cause);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let name = entry.map_err(io)?.file_name();
        let text = name.to_string_lossy().into_owned();
        if ENDINGS.iter().any(|ending| text.ends_with(ending)) {
            names.push((natural(&text), name));
        }
    }
    names.sort();
    Ok(names
        .into_iter()
        .map(|(_, name)| folder.join(name))
        .collect())
}

/// Text and numbers in turn.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest
            .find(|it: char| it.is_ascii_digit())
            .unwrap_or(rest.len());
        let (text, behind) = rest.split_at(digits);
        let end = (behind.find(|it: char| !it.is_ascii_digit())).unwrap_or(behind.len());
        let (number, behind) = behind.split_at(end);
        parts.push((text.to_owned(), number.parse().unwrap_or(u64::MAX)));
        rest = behind;
    }
    parts
}

struct Metadata {
    files: Vec<PathBuf>,
    packs_messages: bool,
}

fn read(path: &Path) -> Result<Metadata> {
    let error = |message: String| {
        Error::new(ErrorKind::Format, message)
            .with_path(path)
            .with_help("`ros2 bag reindex` writes it anew")
    };
    let text = fremen::file::read_text(path, MAX_METADATA_BYTES)?;
    let document = document(&text).map_err(|cause| error(format!("this is no YAML: {cause}")))?;
    let bag = &document["rosbag2_bagfile_information"];
    if bag.is_badvalue() {
        return Err(error("it has no `rosbag2_bagfile_information`".into()));
    }
    let folder = path.parent().unwrap_or(Path::new("."));
    let names = (bag["relative_file_paths"].as_vec())
        .ok_or_else(|| error("it has no list `relative_file_paths`".into()))?;
    let mut files = Vec::new();
    for name in names {
        let name = name
            .as_str()
            .ok_or_else(|| error("`relative_file_paths` holds what is no name".into()))?;
        let relative = Path::new(name);
        let is_inside = relative
            .components()
            .all(|it| matches!(it, std::path::Component::Normal(_)));
        if !is_inside {
            return Err(error(format!("`{name}` is not in the folder of the bag")));
        }
        files.push(folder.join(relative));
    }
    let word = |key: &str| match &bag[key] {
        Yaml::String(word) => word.to_lowercase(),
        _ => String::new(),
    };
    let mode = word("compression_mode");
    let format = word("compression_format");
    if !matches!(mode.as_str(), "" | "none") && !matches!(format.as_str(), "zstd" | "") {
        return Err(error(format!("bags packed with `{format}` are not read"))
            .with_help("zstd is: `ros2 bag convert` packs it so"));
    }
    Ok(Metadata {
        files,
        packs_messages: mode == "message",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["a_10.db3", "a_2.db3", "a_1.db3"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["a_1.db3", "a_2.db3", "a_10.db3"]);
    }
}
