//! How does an array become a file that numpy opens? (format NPY 1.0, little-endian, C order)

use std::path::Path;

use fremen::error::{Error, ErrorKind, Result};

const MAGIC: &[u8] = b"\x93NUMPY";
/// The header is padded so that the data start at a multiple of this.
const ALIGNMENT: usize = 64;

/// A type of numbers: its name in numpy, and its bytes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Type {
    name: &'static str,
    bytes: usize,
}

pub(super) const F32: Type = Type {
    name: "<f4",
    bytes: 4,
};
pub(super) const U8: Type = Type {
    name: "|u1",
    bytes: 1,
};
pub(super) const I8: Type = Type {
    name: "|i1",
    bytes: 1,
};

/// The file of rows of `columns` numbers (0: one number each, and the array has one dimension).
pub(super) fn encode(of: Type, columns: usize, data: &[u8]) -> Vec<u8> {
    let rows = data.len() / (of.bytes * columns.max(1));
    let shape = match columns {
        0 => format!("({rows},)"),
        _ => format!("({rows}, {columns})"),
    };
    let mut header = format!(
        "{{'descr': '{}', 'fortran_order': False, 'shape': {shape}, }}",
        of.name
    );
    let start = MAGIC.len() + 4;
    let len = (start + header.len() + 1).next_multiple_of(ALIGNMENT) - start;
    while header.len() + 1 < len {
        header.push(' ');
    }
    header.push('\n');
    [
        MAGIC,
        &[1, 0],
        &(len as u16).to_le_bytes(),
        header.as_bytes(),
        data,
    ]
    .concat()
}

/// Reads what [`encode`] has made, or numpy with `numpy.save`, from the bytes of the file at
/// `path`.
pub(super) fn decode(path: &Path, mut bytes: Vec<u8>, of: Type, columns: usize) -> Result<Vec<u8>> {
    let (start, rows) = parse_header(&bytes, of, columns).map_err(|error| error.with_path(path))?;
    let row_bytes = of.bytes * columns.max(1);
    let expected = rows
        .checked_mul(row_bytes)
        .and_then(|len| len.checked_add(start));
    if expected != Some(bytes.len()) {
        return Err(format_error(format!(
            "{} bytes follow the header, where {rows} rows of {row_bytes} bytes are announced",
            bytes.len() - start
        ))
        .with_place(format!("byte {start}"))
        .with_path(path));
    }
    bytes.drain(..start);
    Ok(bytes)
}

/// Where the data start, and how many rows there are.
fn parse_header(bytes: &[u8], of: Type, columns: usize) -> Result<(usize, usize)> {
    let short = || format_error("this is no array in the format NPY 1.0".into());
    let version = bytes.strip_prefix(MAGIC).ok_or_else(short)?;
    let [1, 0, low, high, rest @ ..] = version else {
        return Err(short());
    };
    let len = usize::from(u16::from_le_bytes([*low, *high]));
    let header = rest.get(..len).ok_or_else(short)?;
    let header = std::str::from_utf8(header).map_err(|_| short())?;
    let value = |key: &str| {
        let at = header.find(&format!("'{key}':"))?;
        Some(header[at + key.len() + 3..].trim_start())
    };
    let (Some(descr), Some(order), Some(shape)) =
        (value("descr"), value("fortran_order"), value("shape"))
    else {
        return Err(short());
    };
    if !descr.starts_with(&format!("'{}'", of.name)) || !order.starts_with("False") {
        return Err(format_error(format!(
            "numbers of type '{}' in C order are expected, not {}",
            of.name,
            header.trim()
        )));
    }
    let shape = shape.strip_prefix('(').and_then(|it| it.split_once(')'));
    let shape = shape.ok_or_else(short)?.0;
    let dimensions: Vec<usize> = (shape.split(',').map(str::trim))
        .filter(|it| !it.is_empty())
        .map(|it| it.parse().map_err(|_| short()))
        .collect::<Result<_>>()?;
    let rows = match (columns, &dimensions[..]) {
        (0, &[rows]) => rows,
        (1.., &[rows, found]) if found == columns => rows,
        _ => {
            let expected = if columns == 0 {
                "(rows,)".into()
            } else {
                format!("(rows, {columns})")
            };
            return Err(format_error(format!(
                "an array of shape {expected} is expected, not ({shape})"
            )));
        }
    };
    Ok((MAGIC.len() + 4 + len, rows))
}

fn format_error(message: String) -> Error {
    Error::new(ErrorKind::Format, message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_anything_else_is_named() {
        let path = Path::new("a.npy");
        let bytes = encode(F32, 2, &[7; 24]);
        let read = |bytes: &[u8], of, columns| decode(path, bytes.to_vec(), of, columns);
        assert_eq!(bytes.len(), 2 * ALIGNMENT + 24);
        assert!(bytes.starts_with(b"\x93NUMPY\x01\0"));
        assert_eq!(read(&bytes, F32, 2).expect("sound"), [7; 24]);
        for (of, columns, expected) in
            [(U8, 2, "'|u1'"), (F32, 3, "(rows, 3)"), (F32, 0, "(rows,)")]
        {
            let error = read(&bytes, of, columns).expect_err(expected).to_string();
            assert!(
                error.contains(expected) && error.contains("a.npy"),
                "{error}"
            );
        }
        let error = read(&bytes[..bytes.len() - 1], F32, 2).expect_err("short");
        assert!(error.to_string().contains("3 rows of 8 bytes"), "{error}");
        for len in 0..bytes.len() - 24 {
            assert!(read(&bytes[..len], F32, 2).is_err(), "{len}");
        }
    }
}
