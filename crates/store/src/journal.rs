//! What would this rollback journal make of this file?
//!
//! A journal holds pages of a file as they were before a commit that did not end, and nothing that
//! says which file that was. So before `SQLite` sees one, what it would do is worked out in memory
//! ([`played`]), by the format that `SQLite` documents: segments, each with a header and records of
//! a page's number, its old content and a checksum.

use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = [0xd9, 0xd5, 0x05, 0xf9, 0x20, 0xa1, 0x63, 0xd7];
/// Of the fields of a header, without what fills its sector.
const HEADER_BYTES: usize = 28;
/// The number of records of a segment that goes on to the end of the journal.
const TO_THE_END: u32 = u32::MAX;
/// Every so many bytes of a page one counts for its checksum.
const CHECKSUM_STEP: usize = 200;
/// The page with this byte is never written: locks lie there.
const LOCK_BYTE: u64 = 1 << 30;

/// `FILE-journal`.
pub(crate) fn journal_of(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push("-journal");
    name.into()
}

/// Whether there is a journal with anything in it.
pub(crate) fn has_journal(path: &Path) -> bool {
    std::fs::metadata(journal_of(path)).is_ok_and(|it| it.len() > 0)
}

/// The header of a segment.
struct Segment {
    num_records: u32,
    nonce: u32,
    /// Pages of the file before the commit.
    num_pages: u32,
    sector_bytes: usize,
    page_bytes: usize,
}

impl Segment {
    fn at(journal: &[u8], at: usize) -> Option<Self> {
        let header = journal.get(at..at.checked_add(HEADER_BYTES)?)?;
        let word = |at: usize| word(header, at);
        let segment = Self {
            num_records: word(8)?,
            nonce: word(12)?,
            num_pages: word(16)?,
            sector_bytes: word(20)? as usize,
            page_bytes: word(24)? as usize,
        };
        let is_size = |bytes: usize| bytes.is_power_of_two() && (32..=65_536).contains(&bytes);
        let is_sound = header.starts_with(&MAGIC)
            && is_size(segment.sector_bytes)
            && is_size(segment.page_bytes)
            && segment.page_bytes >= 512;
        is_sound.then_some(segment)
    }
}

/// The file as it would be once the journal is played; `None` if the journal cannot be one of a
/// file of this page size, or says nothing.
pub(crate) fn played(file: &[u8], journal: &[u8]) -> Option<Vec<u8>> {
    let first = Segment::at(journal, 0)?;
    let page_bytes = first.page_bytes;
    if page_bytes_of(file) != Some(page_bytes) {
        return None;
    }
    let num_bytes = usize::try_from(first.num_pages)
        .ok()?
        .checked_mul(page_bytes)?;
    // No page can be missing that the journal does not hold.
    if num_bytes > file.len() + journal.len() {
        return None;
    }
    let mut image = file.to_vec();
    image.resize(num_bytes, 0);
    let mut at = 0;
    let mut restored = std::collections::HashSet::new();
    while let Some(segment) = Segment::at(journal, at) {
        if segment.page_bytes != page_bytes {
            break;
        }
        let mut record = at + segment.sector_bytes;
        let whole = (journal.len().saturating_sub(record)) / (page_bytes + 8);
        let num_records = match segment.num_records {
            TO_THE_END => whole,
            count => count as usize,
        };
        for _ in 0..num_records {
            let Some(number) = put_back(&mut image, &segment, journal, record, &mut restored)
            else {
                return Some(image);
            };
            restored.insert(number);
            record += page_bytes + 8;
        }
        at = record.next_multiple_of(first.sector_bytes);
    }
    Some(image)
}

/// Whether a journal's first segment holds the first page of a file, which says how often the file
/// was committed to.
pub(crate) fn holds_first_page(journal: &[u8]) -> bool {
    let Some(segment) = Segment::at(journal, 0) else {
        return false;
    };
    let records = journal.get(segment.sector_bytes..).unwrap_or_default();
    (records.chunks_exact(segment.page_bytes + 8)).any(|record| word(record, 0) == Some(1))
}

/// Puts the page of a record back where it was, the first time that it comes; `None` where the
/// journal ends.
fn put_back(
    image: &mut [u8],
    segment: &Segment,
    journal: &[u8],
    at: usize,
    restored: &mut std::collections::HashSet<u32>,
) -> Option<u32> {
    let page_bytes = segment.page_bytes;
    let record = journal.get(at..at.checked_add(page_bytes + 8)?)?;
    let number = word(record, 0)?;
    let page = &record[4..4 + page_bytes];
    let is_of_locks = u64::from(number) == LOCK_BYTE / page_bytes as u64 + 1;
    if number == 0 || is_of_locks || word(record, 4 + page_bytes)? != checksum(segment.nonce, page)
    {
        return None;
    }
    let start = (number as usize - 1).checked_mul(page_bytes)?;
    if let Some(place) = image.get_mut(start..start.checked_add(page_bytes)?)
        && !restored.contains(&number)
    {
        place.copy_from_slice(page);
    }
    Some(number)
}

fn checksum(nonce: u32, page: &[u8]) -> u32 {
    let mut sum = nonce;
    let mut at = page.len().saturating_sub(CHECKSUM_STEP);
    while at > 0 {
        sum = sum.wrapping_add(u32::from(page[at]));
        at = at.saturating_sub(CHECKSUM_STEP);
    }
    sum
}

/// The bytes of a page, as the first page says.
fn page_bytes_of(file: &[u8]) -> Option<usize> {
    match *file.get(16..18)? {
        [0, 1] => Some(65_536),
        [high, low] => Some(usize::from(high) << 8 | usize::from(low)),
        _ => None,
    }
}

/// How often the file was committed to, as its first page says.
pub(crate) fn change_counter(file: &[u8]) -> Option<u32> {
    word(file, 24)
}

/// The big-endian number at a byte.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..at.checked_add(4)?)?;
    bytes.try_into().ok().map(u32::from_be_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rusqlite::Connection;
    use std::fs;

    /// A folder where nothing waits for a disk.
    fn in_memory() -> tempfile::TempDir {
        tempfile::tempdir_in("/dev/shm")
            .or_else(|_| tempfile::tempdir())
            .expect("a folder")
    }

    /// A file in the middle of a commit that has already written to it, and the journal.
    fn interrupted(path: &Path, page_bytes: usize) -> (Vec<u8>, Vec<u8>) {
        let connection = Connection::open(path).expect("a folder");
        let insert = |first: i64, num: i64| {
            let sql = "INSERT INTO t VALUES (?1, ?2)";
            for id in first..first + num {
                let text = format!("row {id}, ").repeat(page_bytes / 20);
                connection.execute(sql, (id, text)).expect("sound");
            }
        };
        connection
            .execute_batch(&format!(
                "PRAGMA page_size = {page_bytes}; \
                 CREATE TABLE t (id INTEGER PRIMARY KEY, text TEXT); BEGIN"
            ))
            .expect("sound");
        insert(0, 40);
        // So small a cache that the commit writes before it ends, a few pages at a time.
        connection
            .execute_batch(
                "COMMIT; PRAGMA cache_size = 4; BEGIN IMMEDIATE; \
                 UPDATE t SET text = replace(text, 'row', 'new') WHERE id % 3 = 0; \
                 DELETE FROM t WHERE id % 7 = 1",
            )
            .expect("sound");
        insert(100, 30);
        connection.cache_flush().expect("sound");
        let found = (
            fs::read(path).expect("there"),
            fs::read(journal_of(path)).expect("there"),
        );
        connection.execute_batch("ROLLBACK").expect("sound");
        found
    }

    /// What `SQLite` makes of a file beside which this journal lies.
    fn played_by_sqlite(path: &Path, file: &[u8], journal: &[u8]) -> Vec<u8> {
        fs::write(path, file).expect("writable");
        fs::write(journal_of(path), journal).expect("writable");
        let connection = Connection::open(path).expect("there");
        // That the result is a sound file is not asked.
        let _ = connection.query_row("PRAGMA schema_version", [], |_| Ok(()));
        drop(connection);
        let found = fs::read(path).expect("there");
        let _ = fs::remove_file(journal_of(path));
        found
    }

    #[test]
    fn a_journal_is_played_as_sqlite_plays_it() {
        let folder = in_memory();
        for page_bytes in [512, 4_096, 65_536] {
            let path = folder.path().join(format!("{page_bytes}.db"));
            let (file, journal) = interrupted(&path, page_bytes);
            let segments = journal.windows(8).filter(|it| **it == MAGIC).count();
            assert!(segments > 1, "{page_bytes}: one segment");
            let again = folder.path().join("again.db");
            let check = |file: &[u8], journal: &[u8], what: &str| {
                let image = played(file, journal).expect(what);
                let expected = played_by_sqlite(&again, file, journal);
                assert!(image == expected, "pages of {page_bytes} bytes, {what}");
            };
            check(&file, &journal, "whole");
            let before = fs::read(&path).expect("there");
            assert!(played(&file, &journal).as_ref() == Some(&before));
            assert!(file != before && file.len() != before.len());
            // A file that is shorter than before: pages that are gone come of the journal.
            let half = before.len() / 2 / page_bytes * page_bytes;
            check(&file[..half], &journal, "cut file");
            for len in (512..journal.len()).step_by(journal.len() / 60) {
                check(&file, &journal[..len], &format!("cut to {len} bytes"));
            }
            // Number of records, nonce; then records of the first segment.
            for at in (8..16).chain((512..512 + 3 * page_bytes).step_by(page_bytes / 29)) {
                let mut damaged = journal.clone();
                damaged[at] ^= 1 << (at % 8);
                check(&file, &damaged, &format!("bit at {at}"));
            }
        }
    }

    #[test]
    fn what_is_no_journal_of_such_a_file_says_nothing() {
        let folder = in_memory();
        let (file, journal) = interrupted(&folder.path().join("a.db"), 512);
        let (other, _) = interrupted(&folder.path().join("b.db"), 1_024);
        assert!(played(&file, &journal).is_some());
        assert!(played(&other, &journal).is_none(), "pages of another size");
        assert!(played(&[], &journal).is_none());
        for len in 0..HEADER_BYTES {
            assert!(played(&file, &journal[..len]).is_none(), "{len} bytes");
        }
        let with = |at: usize, word: u32| {
            let mut damaged = journal.clone();
            damaged[at..at + 4].copy_from_slice(&word.to_be_bytes());
            played(&file, &damaged)
        };
        assert!(with(0, 0).is_none(), "another magic number");
        assert!(with(16, u32::MAX).is_none(), "pages that nobody has");
        for sector_bytes in [0, 16, 513, 1 << 17] {
            assert!(with(20, sector_bytes).is_none(), "{sector_bytes}");
        }
        for page_bytes in [0, 256, 768, 1 << 17] {
            assert!(with(24, page_bytes).is_none(), "{page_bytes}");
        }
    }
}
