//! What may be read and written within one transaction?

use fremen::error::{ErrorKind, Result};
use rusqlite::Connection;
use rusqlite::types::{ToSqlOutput, ValueRef};

use crate::fault::{Fault, Faults};
use crate::generation::{Generation, Tip, read_generations};
use crate::kind::Kind;
use crate::row::{Row, from_sqlite, scan};
use crate::table::{Table, row_crc};

/// Says whether all rows are what was written, down to the digest of the newest generation. What an
/// interrupted commit has left is healed only where this holds afterwards.
pub type Check = fn(&Reader<'_>) -> Result<()>;

/// A transaction that changes nothing.
#[derive(Debug)]
pub struct Reader<'a> {
    connection: &'a Connection,
    kind: &'static Kind,
    version: u32,
}

impl<'a> Reader<'a> {
    /// Fails if the file says that it has a version that is not known.
    pub(crate) fn new(connection: &'a Connection, kind: &'static Kind) -> Result<Self> {
        let read = connection.query_row("PRAGMA user_version", [], |row| row.get(0));
        let version = read.map_err(|error| kind.sqlite_error(&error))?;
        if !(1..=kind.version).contains(&version) {
            return Err(kind.unknown_version(version));
        }
        Ok(Self {
            connection,
            kind,
            version,
        })
    }

    /// The version that the file has.
    pub fn version(&self) -> u32 {
        self.version
    }

    /// Where the file stands.
    pub fn tip(&self) -> Result<Tip> {
        Tip::read(self.connection, self.kind, self.version)
            .map_err(|error| self.kind.sqlite_error(&error))
    }

    /// The generations after `known`, ascending.
    pub fn generations(&self, known: Option<u64>, faults: &mut Faults) -> Result<Vec<Generation>> {
        read_generations(self.connection, self.kind, self.version, known, faults)
    }

    /// Hands every sound row of `table` with an id above `after` to `each`, in order of id, with
    /// the faults so far.
    pub fn scan(
        &self,
        table: &'static Table,
        after: i64,
        faults: &mut Faults,
        each: impl FnMut(&Row<'_>, &Faults) -> Result<(), Fault>,
    ) -> Result<()> {
        scan(self.connection, self.kind, table, after, faults, each)
    }

    /// Whether the tables are those of the file's version and nothing else is there that could act
    /// on them.
    pub(crate) fn check_schema(&self, faults: &mut Faults) -> Result<()> {
        let version = self.version;
        let tables = (self.kind.tables)(version);
        let read = || -> rusqlite::Result<Vec<(String, Option<String>)>> {
            (self.connection)
                .prepare(
                    "SELECT name, sql FROM sqlite_schema \
                     WHERE name NOT LIKE 'sqlite\\_%' ESCAPE '\\' ORDER BY rowid",
                )?
                .query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?
                .collect()
        };
        let found = match read() {
            Ok(found) => found,
            Err(error) => return faults.add(from_sqlite(self.kind, "file", None, &error)?),
        };
        let format = |table, message: String| Fault::new(table, ErrorKind::Format, message);
        for table in tables {
            match found.iter().find(|(name, _)| name == table.name) {
                None => faults.add(format(table.name, "the table is missing".into()))?,
                Some((_, sql)) if sql.as_deref() != Some(table.create) => faults.add(format(
                    table.name,
                    format!("the table is not declared as in format {version}"),
                ))?,
                Some(_) => {}
            }
        }
        let foreign = found
            .iter()
            .find(|(name, _)| tables.iter().all(|table| table.name != name));
        if let Some((name, _)) = foreign {
            let message = format!("`{}` is no part of format {version}", name.escape_debug());
            faults.add(format("file", message))?;
        }
        Ok(())
    }

    /// `SQLite`'s own check of its pages.
    pub(crate) fn check_structure(&self, pragma: &str, faults: &mut Faults) -> Result<()> {
        let read = || -> rusqlite::Result<Vec<String>> {
            (self.connection)
                .prepare(&format!("PRAGMA {pragma}(16)"))?
                .query_map([], |row| row.get(0))?
                .collect()
        };
        match read() {
            Ok(lines) => lines
                .into_iter()
                .filter(|line| line != "ok")
                .try_for_each(|line| faults.add(Fault::new("file", ErrorKind::Format, line))),
            Err(error) => faults.add(from_sqlite(self.kind, "file", None, &error)?),
        }
    }

    /// The bytes of all pages.
    pub(crate) fn num_page_bytes(&self) -> Result<u64> {
        self.connection
            .query_row(
                "SELECT page_count * page_size FROM pragma_page_count, pragma_page_size",
                [],
                |row| row.get::<_, i64>(0).map(|bytes| bytes as u64),
            )
            .map_err(|error| self.kind.sqlite_error(&error))
    }
}

/// A transaction that writes rows.
#[derive(Debug)]
pub struct Writer<'a> {
    connection: &'a Connection,
    kind: &'static Kind,
}

impl<'a> Writer<'a> {
    pub(crate) fn new(connection: &'a Connection, kind: &'static Kind) -> Self {
        Self { connection, kind }
    }

    /// Writes one row with its checksum; the values are all columns before `crc`.
    pub fn insert(&self, table: &Table, values: &[ValueRef<'_>]) -> Result<()> {
        insert(self.connection, table, values).map_err(|error| self.kind.sqlite_error(&error))
    }

    /// Writes down a generation: last, or nobody would read its rows.
    pub fn insert_generation(&self, generation: &Generation) -> Result<()> {
        let table = self.kind.tables_now()[0];
        self.insert(table, &generation.values(table))
    }

    /// Makes the tables of a new file.
    pub(crate) fn create_tables(&self) -> rusqlite::Result<()> {
        let kind = self.kind;
        (self.connection).pragma_update(None, "application_id", kind.application_id)?;
        (self.connection).pragma_update(None, "user_version", kind.version)?;
        (kind.tables_now().iter())
            .try_for_each(|table| self.connection.execute(table.create, []).map(drop))
    }

    /// Makes a file of an older version one of today's: the table of generations is written anew
    /// where it is another, and tables that are new are made. (A version that changes another table
    /// has to bring its own steps.)
    pub(crate) fn migrate(&self) -> Result<()> {
        let kind = self.kind;
        let version = Reader::new(self.connection, kind)?.version();
        if version == kind.version {
            return Ok(());
        }
        let strict = &mut Faults::strict(kind);
        let generations = read_generations(self.connection, kind, version, None, strict)?;
        let (old, new) = ((kind.tables)(version), kind.tables_now());
        let write = || -> rusqlite::Result<()> {
            if old[0].create != new[0].create {
                (self.connection).execute(&format!("DROP TABLE {}", old[0].name), [])?;
                self.connection.execute(new[0].create, [])?;
                for generation in &generations {
                    insert(self.connection, new[0], &generation.values(new[0]))?;
                }
            }
            let is_new = |table: &&&Table| old.iter().all(|it| it.name != table.name);
            for table in new.iter().filter(is_new) {
                self.connection.execute(table.create, [])?;
            }
            (self.connection).pragma_update(None, "user_version", kind.version)
        };
        write().map_err(|error| kind.sqlite_error(&error))
    }
}

/// Writes one row with its checksum; the values are all columns before `crc`.
pub(crate) fn insert(
    connection: &Connection,
    table: &Table,
    values: &[ValueRef<'_>],
) -> rusqlite::Result<()> {
    let places = vec!["?"; values.len() + 1].join(", ");
    let mut statement = connection.prepare_cached(&format!(
        "INSERT INTO {} ({}, crc) VALUES ({places})",
        table.name,
        table.columns.join(", ")
    ))?;
    let crc = ValueRef::Integer(row_crc(table, values).into());
    let parameters = values
        .iter()
        .chain([&crc])
        .map(|&v| ToSqlOutput::Borrowed(v));
    statement.execute(rusqlite::params_from_iter(parameters))?;
    Ok(())
}
