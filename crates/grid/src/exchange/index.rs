//! Which maps were made when?

use std::path::{Component, Path, PathBuf};

use fremen::{Error, ErrorKind, Result, Time};

/// The most bytes of an index.
const MAX_BYTES: u64 = 1 << 28;

/// A line of an index.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IndexEntry {
    /// When it was made.
    pub time: Time,
    /// The file, below the folder of the index.
    pub path: PathBuf,
    /// Who made it; empty where the index does not say.
    pub observer: String,
}

/// Reads an `index.csv` with the columns `time` (RFC 3339, or seconds since 1970), `path`
/// (relative to the index, inside of its folder) and perhaps `observer`.
///
/// # Errors
/// [`ErrorKind::Format`] where a column or value is missing or a path leaves the folder,
/// [`ErrorKind::Time`] where a time is none.
pub fn read_index(path: impl AsRef<Path>) -> Result<Vec<IndexEntry>> {
    let path = path.as_ref();
    let text = fremen::file::read_text(path, MAX_BYTES)?;
    parse(&text, path.parent().unwrap_or(Path::new(""))).map_err(|error| error.with_path(path))
}

fn parse(text: &str, folder: &Path) -> Result<Vec<IndexEntry>> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let broken = |cause: csv::Error| Error::new(ErrorKind::Format, cause.to_string());
    let headers = reader.headers().map_err(broken)?.clone();
    let column = |name: &str| headers.iter().position(|it| it.eq_ignore_ascii_case(name));
    let required = |name: &str| {
        column(name).ok_or_else(|| {
            Error::new(ErrorKind::Format, format!("there is no column {name}"))
                .with_help("an index has the columns time and path")
        })
    };
    let (time, file, observer) = (required("time")?, required("path")?, column("observer"));
    let mut entries = Vec::new();
    for record in reader.records() {
        let record = record.map_err(broken)?;
        let line = record.position().map_or(0, csv::Position::line);
        let place = |error: Error| error.with_place(format!("line {line}"));
        let field = |at: usize| record.get(at).unwrap_or_default();
        let relative = Path::new(field(file));
        let mut parts = relative.components();
        if field(file).is_empty()
            || !parts.all(|it| matches!(it, Component::Normal(_) | Component::CurDir))
        {
            let text = fremen::error::printable(field(file));
            let message = format!("path \"{text}\" is not in the folder of the index");
            return Err(place(Error::new(ErrorKind::Format, message)));
        }
        entries.push(IndexEntry {
            time: parse_time(field(time)).map_err(place)?,
            path: folder.join(relative),
            observer: observer.map_or_else(String::new, |at| field(at).to_owned()),
        });
    }
    Ok(entries)
}

fn parse_time(text: &str) -> Result<Time> {
    match text.parse::<f64>() {
        Ok(s) if s.is_finite() && s.abs() < 9e12 => Ok(Time::from_us((s * 1e6).round() as i64)),
        _ => Time::parse(text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name_and_paths_stay_inside() -> Result<()> {
        let text = "path,place,time\na/m.yaml,x,2024-05-06T08:00:00Z\nb.yaml,x,12.5\n";
        let entries = parse(text, Path::new("maps"))?;
        assert_eq!(entries[0].time, Time::parse("2024-05-06T08:00:00Z")?);
        assert_eq!(entries[0].path, Path::new("maps/a/m.yaml"));
        assert_eq!(entries[1].time, Time::from_us(12_500_000));
        for (text, expected) in [
            ("time\n0\n", "there is no column path"),
            ("time,path\n0,../m.yaml\n", "is not in the folder"),
            ("time,path\n0,\n", "is not in the folder"),
            ("time,path\nsoon,m.yaml\n", "line 2"),
            ("time,path\nnan,m.yaml\n", "line 2"),
            ("time,path\n0\n", "line: 2"),
        ] {
            let error = parse(text, Path::new("")).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
        Ok(())
    }
}
