//! How does a file forget generations that nobody will return to?
//!
//! The content of a generation is made of its ancestors' rows, so a row is dropped only if no
//! generation that stays needs it. Of the others, a generation without a branch is merged into the
//! one after it: its rows change their number, and what no longer holds ([`Holds`]) goes.
//! Generations that stay keep their number, content and digest.
//!
//! Everything happens in one transaction, between two readings of the whole file: damage is never
//! given a new checksum.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use fremen::error::{Error, ErrorKind, Result};
use rusqlite::Connection;
use rusqlite::types::{Value, ValueRef};

use crate::fault::Faults;
use crate::generation::{Generation, note_columns};
use crate::kind::Kind;
use crate::table::{Holds, Table};
use crate::transaction::{Reader, Writer, insert};

/// What becomes of the rows of each generation.
struct Plan {
    /// The generations that stay, as they will be, ascending.
    stay: Vec<Generation>,
    /// Where the rows of a generation go; those of none given are deleted.
    target: BTreeMap<u64, u64>,
    /// By a column of the table of generations: the generations that one that stays names there.
    listed: BTreeMap<&'static str, BTreeSet<u64>>,
}

impl Plan {
    /// Keeps generation 0, the newest, those in `keep` and those where their lines part.
    fn new(kind: &Kind, generations: &[Generation], keep: &BTreeSet<u64>) -> Self {
        let parents: BTreeMap<u64, Option<u64>> = generations
            .iter()
            .map(|it| (it.number, it.parent))
            .collect();
        let newest = generations.last().map(|it| it.number);
        let is_kept = |number: u64| number == 0 || Some(number) == newest || keep.contains(&number);
        // From the newest to the oldest: a child has the higher number.
        let mut needed_children: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        let mut target = BTreeMap::new();
        for it in generations.iter().rev() {
            let children = needed_children.remove(&it.number).unwrap_or_default();
            let goes_to = match children[..] {
                [] if !is_kept(it.number) => continue,
                [child] if !is_kept(it.number) => target[&child],
                _ => it.number,
            };
            target.insert(it.number, goes_to);
            if let Some(parent) = it.parent {
                needed_children.entry(parent).or_default().push(it.number);
            }
        }
        let stays = |number: u64| target.get(&number) == Some(&number);
        let moved = |number: u64| target.get(&number).copied().unwrap_or(number);
        let columns: Vec<&'static str> = note_columns(kind.tables_now()[0]).collect();
        let is_reference = |at: usize| kind.references.contains(&columns[at]);
        let mut listed: BTreeMap<&'static str, BTreeSet<u64>> = BTreeMap::new();
        let stay = (generations.iter().filter(|it| stays(it.number)))
            .map(|it| {
                let mut parent = it.parent;
                while let Some(number) = parent.filter(|&number| !stays(number)) {
                    parent = parents.get(&number).copied().flatten();
                }
                let mut notes = it.notes.clone();
                for (at, note) in notes
                    .iter_mut()
                    .enumerate()
                    .filter(|(at, _)| is_reference(*at))
                {
                    listed.entry(columns[at]).or_default().insert(*note);
                    *note = moved(*note);
                }
                Generation {
                    parent,
                    prunes: it.prunes + 1,
                    notes,
                    ..it.clone()
                }
            })
            .collect();
        Self {
            stay,
            target,
            listed,
        }
    }

    /// Where the row of this generation goes, `None` if nowhere.
    fn target_of(&self, table: &Table, generation: u64) -> Option<u64> {
        let is_listed = match table.holds {
            Holds::Listed(column) => {
                (self.listed.get(column)).is_some_and(|listed| listed.contains(&generation))
            }
            _ => true,
        };
        (self.target.get(&generation).copied()).filter(|_| is_listed)
    }
}

/// Drops the generations that neither are in `keep` nor needed, and gives what `read` finds then
/// and how many went; `None` if all of them stay. Inside of the caller's transaction.
pub(crate) fn prune<T>(
    connection: &Connection,
    kind: &'static Kind,
    keep: &BTreeSet<u64>,
    read: impl Fn(&Reader<'_>) -> Result<T>,
    is_same: impl Fn(&T, &T) -> bool,
) -> Result<Option<(T, usize)>> {
    let reader = Reader::new(connection, kind)?;
    let before = read(&reader)?;
    let generations = reader.generations(None, &mut Faults::strict(kind))?;
    if let Some(missing) =
        (keep.iter()).find(|&&it| generations.iter().all(|generation| generation.number != it))
    {
        return Err(kind.no_generation(*missing));
    }
    let plan = Plan::new(kind, &generations, keep);
    let num_dropped = generations.len() - plan.stay.len();
    if num_dropped == 0 {
        return Ok(None);
    }
    Writer::new(connection, kind).migrate()?;
    rewrite(connection, kind, &plan).map_err(|error| kind.sqlite_error(&error))?;
    let after = read(&Reader::new(connection, kind)?)?;
    if !is_same(&before, &after) {
        return Err(Error::new(
            ErrorKind::Format,
            "pruning would change the newest generation, so nothing was changed",
        )
        .with_help(format!("please report this with the {}", kind.noun)));
    }
    Ok(Some((after, num_dropped)))
}

fn rewrite(connection: &Connection, kind: &Kind, plan: &Plan) -> rusqlite::Result<()> {
    let tables = kind.tables_now();
    let generations = tables[0];
    let outdated = Outdated::find(connection, plan, tables)?;
    connection.execute(&format!("DELETE FROM {}", generations.name), [])?;
    for generation in &plan.stay {
        insert(connection, generations, &generation.values(generations))?;
    }
    for table in &tables[1..] {
        rewrite_table(connection, table, plan, &outdated)?;
    }
    Ok(())
}

/// Rows that no generation that stays needs, because something was begun anew since
/// ([`Holds::Since`]): their ids, by table.
struct Outdated(BTreeMap<&'static str, HashSet<i64>>);

impl Outdated {
    /// Reads the numbers of generations as they were before anything is rewritten.
    fn find(
        connection: &Connection,
        plan: &Plan,
        tables: &[&'static Table],
    ) -> rusqlite::Result<Self> {
        let mut all = BTreeMap::new();
        for table in tables {
            let Holds::Since(beginnings, column) = table.holds else {
                continue;
            };
            let of = |table: &Table| {
                let id_column = table.columns[0];
                format!(
                    "SELECT {id_column}, generation, {column} FROM {}",
                    table.name
                )
            };
            // By value and by the generation that the row goes to: the last that begins anew.
            let mut begun: BTreeMap<(i64, u64), u64> = BTreeMap::new();
            for_each_row(connection, &of(beginnings), |_, generation, value| {
                if let Some(&target) = plan.target.get(&generation) {
                    let last = begun.entry((value, target)).or_default();
                    *last = generation.max(*last);
                }
            })?;
            let mut ids = HashSet::new();
            for_each_row(connection, &of(table), |id, generation, value| {
                let begun =
                    (plan.target.get(&generation)).and_then(|&target| begun.get(&(value, target)));
                if begun.is_some_and(|&begun| generation < begun) {
                    ids.insert(id);
                }
            })?;
            all.insert(table.name, ids);
        }
        Ok(Self(all))
    }

    fn contains(&self, table: &Table, id: i64) -> bool {
        let of = match table.holds {
            Holds::With(other) => other,
            _ => table,
        };
        self.0.get(of.name).is_some_and(|ids| ids.contains(&id))
    }
}

/// Hands id, generation and a value of every row to `each`.
fn for_each_row(
    connection: &Connection,
    sql: &str,
    mut each: impl FnMut(i64, u64, i64),
) -> rusqlite::Result<()> {
    let mut statement = connection.prepare(sql)?;
    let mut rows = statement.query([])?;
    while let Some(row) = rows.next()? {
        each(row.get(0)?, row.get::<_, i64>(1)? as u64, row.get(2)?);
    }
    Ok(())
}

/// Gives every row of a generation that goes its new number, or deletes it. O(bytes of such rows).
fn rewrite_table(
    connection: &Connection,
    table: &'static Table,
    plan: &Plan,
    outdated: &Outdated,
) -> rusqlite::Result<()> {
    let id_column = table.columns[0];
    // The number of the generation is the row id in some tables, else the second column.
    let at = table.position("generation").unwrap_or_default();
    // Of these the newest row with the same key holds, so older ones may go.
    let key = match table.holds {
        Holds::Newest => Some("0"),
        Holds::NewestOf(column) => Some(column),
        Holds::All | Holds::Listed(_) | Holds::Since(..) | Holds::With(_) => None,
    };
    let sql = format!(
        "SELECT {id_column}, generation, {} FROM {} ORDER BY {id_column} DESC",
        key.unwrap_or("NULL"),
        table.name
    );
    let rows = connection
        .prepare(&sql)?
        .query_map([], |row| {
            Ok((row.get(0)?, row.get::<_, i64>(1)? as u64, row.get(2)?))
        })?
        .collect::<rusqlite::Result<Vec<(i64, u64, Value)>>>()?;
    let mut select = connection.prepare(&format!(
        "SELECT {} FROM {} WHERE {id_column} = ?1",
        table.columns.join(", "),
        table.name
    ))?;
    let mut delete = connection.prepare(&format!(
        "DELETE FROM {} WHERE {id_column} = ?1",
        table.name
    ))?;
    let mut holding = HashSet::new();
    for (id, generation, value) in rows {
        let target = plan.target_of(table, generation);
        let is_replaced = outdated.contains(table, id)
            || key.is_some()
                && target.is_some_and(|target| !holding.insert((target, format!("{value:?}"))));
        if target == Some(generation) && !is_replaced {
            continue;
        }
        let mut values: Vec<Value> = select.query_row([id], |row| {
            (0..table.columns.len())
                .map(|column| row.get(column))
                .collect()
        })?;
        delete.execute([id])?;
        if let Some(target) = target.filter(|_| !is_replaced) {
            values[at] = Value::Integer(target as i64);
            let values: Vec<ValueRef<'_>> = values.iter().map(ValueRef::from).collect();
            insert(connection, table, &values)?;
        }
    }
    Ok(())
}
