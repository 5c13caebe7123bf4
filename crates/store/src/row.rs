//! Is a row what was written, and what stands in its columns?

use fremen::error::{ErrorKind, Result};
use rusqlite::Connection;
use rusqlite::types::ValueRef;

use crate::fault::{Fault, Faults};
use crate::kind::Kind;
use crate::table::{Table, locate_flip, row_crc};

/// One row whose checksum holds.
#[derive(Debug)]
pub struct Row<'a> {
    table: &'static Table,
    id: i64,
    values: &'a [ValueRef<'a>],
}

impl<'a> Row<'a> {
    /// Its id: the first column.
    pub fn id(&self) -> i64 {
        self.id
    }

    fn check_crc(&self, crc: ValueRef<'_>) -> Result<(), Fault> {
        let computed = row_crc(self.table, self.values);
        let fault = |column, byte, message: String| {
            Fault::new(self.table.name, ErrorKind::Checksum, message).at(
                Some(self.id),
                column,
                byte,
            )
        };
        let stored = match crc {
            ValueRef::Integer(stored) => u32::try_from(stored).ok(),
            _ => None,
        };
        let Some(stored) = stored else {
            return Err(fault(
                Some("crc"),
                None,
                "a checksum is an integer of 32 bits".into(),
            ));
        };
        // A fuzzer cannot guess checksums, and what lies behind them must be sound as well.
        if stored == computed || cfg!(fuzzing) {
            return Ok(());
        }
        let message = format!("the checksum is {computed:08x}, not {stored:08x} as written");
        Err(match locate_flip(self.table, self.values, stored) {
            Some((column, byte)) => fault(
                Some(column.unwrap_or("crc")),
                Some(byte),
                format!("{message}: one bit has flipped"),
            ),
            None => fault(None, None, message),
        })
    }

    /// Something that is wrong with the value in `column`.
    pub fn fault(&self, column: usize, byte: Option<usize>, message: impl Into<String>) -> Fault {
        let column = Some(self.table.columns[column]);
        Fault::new(self.table.name, ErrorKind::Format, message).at(Some(self.id), column, byte)
    }

    /// Why the row cannot follow the rows before it.
    pub fn misfit(&self, column: usize, message: impl Into<String>) -> Fault {
        self.fault(column, None, message)
    }

    fn wrong(&self, column: usize, wanted: &str) -> Fault {
        let found = self.values[column].data_type();
        self.fault(column, None, format!("{wanted} expected, {found} found"))
    }

    /// The integer in `column`.
    pub fn integer(&self, column: usize) -> Result<i64, Fault> {
        match self.values[column] {
            ValueRef::Integer(integer) => Ok(integer),
            _ => Err(self.wrong(column, "an integer")),
        }
    }

    /// The integer in `column`, which is not negative.
    pub fn count(&self, column: usize) -> Result<usize, Fault> {
        let integer = self.integer(column)?;
        usize::try_from(integer).map_err(|_| {
            self.fault(
                column,
                None,
                format!("a count cannot be negative ({integer})"),
            )
        })
    }

    /// The real in `column`, which is finite.
    pub fn real(&self, column: usize) -> Result<f64, Fault> {
        match self.values[column] {
            ValueRef::Real(real) if real.is_finite() => Ok(real),
            _ => Err(self.wrong(column, "a finite real")),
        }
    }

    /// The text in `column`.
    pub fn text(&self, column: usize) -> Result<&'a str, Fault> {
        let ValueRef::Text(text) = self.values[column] else {
            return Err(self.wrong(column, "a text"));
        };
        std::str::from_utf8(text)
            .map_err(|error| self.fault(column, Some(error.valid_up_to()), "this is no UTF-8"))
    }

    /// The blob in `column`.
    pub fn blob(&self, column: usize) -> Result<&'a [u8], Fault> {
        match self.values[column] {
            ValueRef::Blob(blob) => Ok(blob),
            _ => Err(self.wrong(column, "a blob")),
        }
    }

    /// Whether nothing stands in `column`.
    pub fn is_null(&self, column: usize) -> bool {
        self.values[column] == ValueRef::Null
    }

    /// The identity in `column`: 16 bytes, the most significant one first.
    pub fn bits_128(&self, column: usize) -> Result<u128, Fault> {
        let blob = self.blob(column)?;
        let bytes = blob.try_into().map_err(|_| {
            self.fault(
                column,
                Some(blob.len().min(16)),
                format!("{} bytes, where an identity has 16", blob.len()),
            )
        })?;
        Ok(u128::from_be_bytes(bytes))
    }
}

/// What `SQLite` says of a table: a fault, or an error if the file is not to blame.
pub(crate) fn from_sqlite(
    kind: &Kind,
    table: &'static str,
    row: Option<i64>,
    error: &rusqlite::Error,
) -> Result<Fault> {
    use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase, OutOfMemory, SchemaChanged, Unknown};
    match error.sqlite_error_code() {
        // `Unknown` are errors of SQL, such as "no such column", which a damaged schema gives.
        None | Some(DatabaseCorrupt | NotADatabase | OutOfMemory | SchemaChanged | Unknown) => {
            let message = format!("SQLite: {error}");
            Ok(Fault::new(table, ErrorKind::Format, message).at(row, None, None))
        }
        Some(_) => Err(kind.sqlite_error(error)),
    }
}

/// Hands every sound row of `table` with an id above `after` to `each`, in order of id.
pub(crate) fn scan(
    connection: &Connection,
    kind: &Kind,
    table: &'static Table,
    after: i64,
    faults: &mut Faults,
    mut each: impl FnMut(&Row<'_>, &Faults) -> Result<(), Fault>,
) -> Result<()> {
    let mut last = None;
    match scan_rows(connection, table, after, faults, &mut last, &mut each) {
        Ok(stopped) => stopped,
        Err(error) => faults.add(from_sqlite(kind, table.name, last, &error)?),
    }
}

/// The outer error is `SQLite`'s, the inner one that of a fault too many.
fn scan_rows(
    connection: &Connection,
    table: &'static Table,
    after: i64,
    faults: &mut Faults,
    last: &mut Option<i64>,
    each: &mut impl FnMut(&Row<'_>, &Faults) -> Result<(), Fault>,
) -> rusqlite::Result<Result<()>> {
    if let Some(fault) = too_large(connection, table, after)? {
        return Ok(faults.add(fault));
    }
    let id_column = table.columns[0];
    let mut statement = connection.prepare(&format!(
        "SELECT {}, crc FROM {} WHERE {id_column} > ?1 ORDER BY {id_column}",
        table.columns.join(", "),
        table.name
    ))?;
    let mut rows = statement.query([after])?;
    while let Some(row) = rows.next()? {
        let values = (0..table.columns.len())
            .map(|column| row.get_ref(column))
            .collect::<rusqlite::Result<Vec<_>>>()?;
        let crc = row.get_ref(table.columns.len())?;
        // The first column is SQLite's own row id.
        let id = values[0].as_i64()?;
        *last = Some(id);
        let row = Row {
            table,
            id,
            values: &values,
        };
        if let Err(fault) = row.check_crc(crc).and_then(|()| each(&row, faults))
            && let Err(error) = faults.add(fault)
        {
            return Ok(Err(error));
        }
    }
    Ok(Ok(()))
}

/// The first value that is larger than its column allows. Sizes are in the head of a row: nothing
/// too large is ever loaded.
fn too_large(
    connection: &Connection,
    table: &'static Table,
    after: i64,
) -> rusqlite::Result<Option<Fault>> {
    if table.limits.is_empty() {
        return Ok(None);
    }
    let id_column = table.columns[0];
    let too_large: Vec<String> = (table.limits.iter())
        .map(|(column, limit)| format!("octet_length({column}) > {limit}"))
        .collect();
    let mut statement = connection.prepare(&format!(
        "SELECT {id_column}, {} FROM {} WHERE {id_column} > ?1 AND ({})",
        too_large.join(", "),
        table.name,
        too_large.join(" OR ")
    ))?;
    let mut rows = statement.query([after])?;
    while let Some(row) = rows.next()? {
        for (at, (column, limit)) in table.limits.iter().enumerate() {
            if row.get(at + 1)? {
                let message = format!("more than {limit} bytes");
                let fault = Fault::new(table.name, ErrorKind::Format, message);
                let row = Some(row.get(0)?);
                return Ok(Some(fault.at(row, Some(column), Some(*limit))));
            }
        }
    }
    Ok(None)
}
