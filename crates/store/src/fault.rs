//! What in a file is not as it was written, and where?

use std::fmt;

use fremen::error::{Error, ErrorKind, Result};

use crate::kind::Kind;

/// Something in a file that is not as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// The table, or `file` for what is below the tables.
    pub table: &'static str,
    /// The row's id: its first column.
    pub row: Option<i64>,
    /// The column.
    pub column: Option<&'static str>,
    /// The byte in that column, from 0 (of an integer or real: in its 8 little-endian bytes).
    pub byte: Option<usize>,
    /// What is wrong.
    pub message: String,
    kind: ErrorKind,
}

impl Fault {
    /// A fault in `table` whose row and column are not known.
    pub fn new(table: &'static str, kind: ErrorKind, message: impl Into<String>) -> Self {
        Self {
            table,
            row: None,
            column: None,
            byte: None,
            message: message.into(),
            kind,
        }
    }

    /// The same fault in this row, column and byte.
    #[must_use]
    pub fn at(self, row: Option<i64>, column: Option<&'static str>, byte: Option<usize>) -> Self {
        Self {
            row,
            column,
            byte,
            ..self
        }
    }

    /// The sort of fault.
    pub fn kind(&self) -> ErrorKind {
        self.kind
    }

    fn place(&self) -> String {
        let table = match self.table {
            "file" => "file".into(),
            table => format!("table {table}"),
        };
        [
            Some(table),
            self.row.map(|row| format!("row {row}")),
            self.column.map(|column| format!("column {column}")),
            self.byte.map(|byte| format!("byte {byte}")),
        ]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join(", ")
    }

    fn into_error(self, kind: &Kind) -> Error {
        Error::new(self.kind, self.message.clone())
            .with_place(self.place())
            .with_help(format!(
                "the file is damaged: restore a copy; `{} verify` lists the faults",
                kind.tool
            ))
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.place(), self.message)
    }
}

/// The faults found so far.
#[derive(Debug)]
pub struct Faults {
    kind: &'static Kind,
    list: Vec<Fault>,
    limit: usize,
}

impl Faults {
    /// The first fault is an error.
    pub fn strict(kind: &'static Kind) -> Self {
        Self::listing(kind, 0)
    }

    /// The first `limit` faults are listed.
    pub fn listing(kind: &'static Kind, limit: usize) -> Self {
        Self {
            kind,
            list: Vec::new(),
            limit,
        }
    }

    /// Lists a fault, or makes it an error where there are too many.
    pub fn add(&mut self, fault: Fault) -> Result<()> {
        if self.list.len() < self.limit {
            self.list.push(fault);
            Ok(())
        } else {
            Err(fault.into_error(self.kind))
        }
    }

    /// Whether rows may be held against each other: once one is missing, the rest cannot agree.
    pub fn is_clean(&self) -> bool {
        self.list.is_empty()
    }

    /// Whether the next fault is an error.
    pub(crate) fn is_full(&self) -> bool {
        self.list.len() >= self.limit
    }

    /// Those that were found, in order of finding.
    pub fn into_list(self) -> Vec<Fault> {
        self.list
    }
}
