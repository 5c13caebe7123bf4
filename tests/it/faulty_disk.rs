//! Is a map whole whatever the disk does while it is written?
//!
//! A file system for SQLite that breaks its promises: the tables of functions of the default one,
//! with writing, syncing, deleting and opening replaced. It is the default of a process of its own,
//! which is this program started again, so that nobody else meets it. The n-th operation of a kind
//! goes wrong, for every n until nothing does:
//!
//! - it *fails*: nothing is written, synced or deleted, and that is said;
//! - it is *short*: half of it is written, and the disk is full;
//! - it is *torn*: half of it is written, and the machine stops;
//! - the *power* goes: of every file only what was last synced is there, and a file whose deletion
//!   was not synced is back.
//!
//! The first two happen once or go on until the map is closed. Afterwards the map opens as the old
//! or the new generation, `verify` finds nothing, and what was acknowledged is there.
#![allow(unsafe_code)] // reason: a file system for SQLite is a table of C functions.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicPtr, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use chronotope::map::{Map, Snapshot};
use rusqlite::ffi;

use crate::map::{after_commits, folder, meta, of_generation, start_again};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    WriteFails,
    WriteIsShort,
    SyncFails,
    DeleteFails,
    WriteIsTorn,
    PowerGoes,
}

/// What SQLite does to the disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Operation {
    Write,
    Sync,
    Delete,
}

impl Fault {
    fn concerns(self, operation: Operation) -> bool {
        match self {
            Self::WriteFails | Self::WriteIsShort | Self::WriteIsTorn => {
                operation == Operation::Write
            }
            Self::SyncFails => operation == Operation::Sync,
            Self::DeleteFails => operation == Operation::Delete,
            Self::PowerGoes => true,
        }
    }
}

/// When it goes wrong.
#[derive(Clone, Copy, Debug)]
struct Plan {
    fault: Fault,
    /// Operations of its kind that still go well.
    num_good: u32,
    goes_on: bool,
    has_struck: bool,
}

/// A table of functions.
type Methods = &'static ffi::sqlite3_io_methods;

struct Disk {
    plan: Option<Plan>,
    /// The functions that each open file has by rights, and its path if it has a name, by its
    /// address.
    files: BTreeMap<usize, (Methods, Option<PathBuf>)>,
    /// Ours, by the address of the tables that they replace: a journal's is another one than a
    /// map's.
    replaced: BTreeMap<usize, Methods>,
    /// Where what is synced is copied to.
    synced: Option<PathBuf>,
}

static DISK: Mutex<Disk> = Mutex::new(Disk {
    plan: None,
    files: BTreeMap::new(),
    replaced: BTreeMap::new(),
    synced: None,
});
static REAL: AtomicPtr<ffi::sqlite3_vfs> = AtomicPtr::new(std::ptr::null_mut());

fn disk() -> MutexGuard<'static, Disk> {
    DISK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What goes wrong with this operation, if anything does.
fn strikes(operation: Operation) -> Option<Fault> {
    let mut disk = disk();
    let plan = disk.plan.as_mut()?;
    if !plan.fault.concerns(operation) || plan.has_struck && !plan.goes_on {
        return None;
    }
    if plan.num_good > 0 {
        plan.num_good -= 1;
        return None;
    }
    plan.has_struck = true;
    Some(plan.fault)
}

/// The machine stops: no destructor runs and nothing more is written.
fn stop() -> ! {
    std::process::exit(STOPPED)
}

const STOPPED: i32 = 77;

fn real() -> *mut ffi::sqlite3_vfs {
    REAL.load(Ordering::SeqCst)
}

fn real_methods(file: *mut ffi::sqlite3_file) -> Methods {
    disk().files[&(file as usize)].0
}

unsafe extern "C" fn open(
    _: *mut ffi::sqlite3_vfs,
    name: ffi::sqlite3_filename,
    file: *mut ffi::sqlite3_file,
    flags: c_int,
    out_flags: *mut c_int,
) -> c_int {
    let real = real();
    // SAFETY: `real` is the registered default; the arguments are those that SQLite gave for a file
    // of its size.
    let result = unsafe {
        (*real).xOpen.expect("every file system opens")(real, name, file, flags, out_flags)
    };
    if result != ffi::SQLITE_OK {
        return result;
    }
    // SAFETY: an open file has methods, and they live as long as the program.
    let methods: Methods = unsafe { &*(*file).pMethods };
    let path = (!name.is_null()).then(|| {
        // SAFETY: a name is a C string.
        let name = unsafe { CStr::from_ptr(name) };
        Path::new(OsStr::from_bytes(name.to_bytes())).to_owned()
    });
    let mut disk = disk();
    disk.files.insert(file as usize, (methods, path));
    let address = std::ptr::from_ref(methods) as usize;
    let ours = *disk.replaced.entry(address).or_insert_with(|| {
        Box::leak(Box::new(ffi::sqlite3_io_methods {
            // Without shared memory and mapping, which a map does not use.
            iVersion: 1,
            xWrite: Some(write),
            xSync: Some(sync),
            ..*methods
        }))
    });
    // SAFETY: the functions of the table need nothing of it but that it lives on, and it does.
    unsafe { (*file).pMethods = ours };
    result
}

unsafe extern "C" fn write(
    file: *mut ffi::sqlite3_file,
    bytes: *const c_void,
    len: c_int,
    offset: ffi::sqlite3_int64,
) -> c_int {
    let fault = strikes(Operation::Write);
    let good_len = match fault {
        None => len,
        Some(Fault::WriteIsShort | Fault::WriteIsTorn) => len / 2,
        Some(Fault::PowerGoes) => stop(),
        Some(_) => return ffi::SQLITE_IOERR_WRITE,
    };
    let write = real_methods(file)
        .xWrite
        .expect("every file can be written");
    // SAFETY: SQLite's own arguments, or fewer bytes of them.
    let result = unsafe { write(file, bytes, good_len, offset) };
    match fault {
        None => result,
        Some(Fault::WriteIsTorn) => stop(),
        Some(_) => ffi::SQLITE_FULL,
    }
}

unsafe extern "C" fn sync(file: *mut ffi::sqlite3_file, flags: c_int) -> c_int {
    match strikes(Operation::Sync) {
        None => {}
        Some(Fault::PowerGoes) => stop(),
        Some(_) => return ffi::SQLITE_IOERR_FSYNC,
    }
    let sync = real_methods(file).xSync.expect("every file syncs");
    // SAFETY: SQLite's own arguments.
    let result = unsafe { sync(file, flags) };
    let disk = disk();
    if let (Some(synced), (_, Some(path))) = (&disk.synced, &disk.files[&(file as usize)])
        && let Some(name) = path.file_name()
        && path.parent() == synced.parent()
    {
        std::fs::copy(path, synced.join(name)).expect("writable");
    }
    result
}

unsafe extern "C" fn delete(
    _: *mut ffi::sqlite3_vfs,
    name: *const c_char,
    is_synced: c_int,
) -> c_int {
    match strikes(Operation::Delete) {
        None => {}
        Some(Fault::PowerGoes) => stop(),
        Some(_) => return ffi::SQLITE_IOERR_DELETE,
    }
    let real = real();
    // SAFETY: SQLite's own arguments, for the file system that the file is of.
    let result =
        unsafe { (*real).xDelete.expect("every file system deletes")(real, name, is_synced) };
    // SAFETY: a name is a C string.
    let name = unsafe { CStr::from_ptr(name) };
    let path = Path::new(OsStr::from_bytes(name.to_bytes()));
    if let (Some(synced), Some(name)) = (&disk().synced, path.file_name())
        && is_synced != 0
    {
        let _ = std::fs::remove_file(synced.join(name));
    }
    result
}

/// Makes it the file system of this process.
fn mount() {
    // SAFETY: SQLite's tables live as long as the program, and so does the copy, which is never
    // freed. Nothing else of this process uses SQLite yet.
    unsafe {
        let real = ffi::sqlite3_vfs_find(std::ptr::null());
        assert!(!real.is_null(), "SQLite has a file system");
        REAL.store(real, Ordering::SeqCst);
        let ours = Box::leak(Box::new(*real));
        ours.zName = c"faulty".as_ptr();
        ours.pNext = std::ptr::null_mut();
        ours.xOpen = Some(open);
        ours.xDelete = Some(delete);
        let result = ffi::sqlite3_vfs_register(ours, 1);
        assert_eq!(result, ffi::SQLITE_OK);
    }
}

fn arm(fault: Fault, num_good: u32, goes_on: bool) {
    disk().plan = Some(Plan {
        fault,
        num_good,
        goes_on,
        has_struck: false,
    });
}

/// Everything goes well again; whether something did not.
fn disarm() -> bool {
    let plan = disk().plan.take();
    plan.is_some_and(|plan| plan.has_struck)
}

/// The snapshot that [`after_commits`] gives after the commits that `found` has.
fn expected(start: &Snapshot, found: &Snapshot) -> Snapshot {
    let expected = after_commits(start, start.generation(), found.generation());
    of_generation(expected, found.generation())
}

/// What the map at `path` holds, which must be whole and have at least generation `acknowledged`.
fn reopened(path: &Path, start: &Snapshot, acknowledged: u64, what: &str) -> u64 {
    let map = Map::open(path).unwrap_or_else(|error| panic!("{what}: {error}"));
    let found = map.snapshot();
    let generation = found.generation();
    assert!(
        (acknowledged..=acknowledged + 1).contains(&generation),
        "{what}: {acknowledged} was acknowledged, {generation} is found"
    );
    assert_eq!(*found, expected(start, &found), "{what}");
    let next = after_commits(start, start.generation(), generation + 1);
    assert_eq!(
        map.commit(&next).expect("sound again"),
        generation + 1,
        "{what}"
    );
    let report = Map::verify(path).expect("a map");
    assert!(report.is_clean(), "{what}: {:?}", report.faults);
    generation
}

/// A map with two commits, and its content.
fn small(path: &Path) -> Snapshot {
    let map = Map::create(path, meta()).expect("new");
    let empty = map.snapshot();
    for generation in 1..=2 {
        map.commit(&after_commits(&empty, 0, generation))
            .expect("extends");
    }
    Snapshot::clone(&map.snapshot())
}

#[test]
fn errors_of_the_disk_are_reported_and_lose_nothing() {
    const FILE: &str = "CHRONOTOPE_TEST_FAILING_DISK";
    if let Some(path) = std::env::var_os(FILE) {
        return fail_in_turn(Path::new(&path));
    }
    let (_folder, path) = folder();
    let name = "faulty_disk::errors_of_the_disk_are_reported_and_lose_nothing";
    let (mut child, lines) = start_again(name, FILE, &path);
    for line in lines {
        println!("{line}");
    }
    assert!(child.wait().expect("ours").success());
}

/// Lets every operation of two commits go wrong in turn.
fn fail_in_turn(path: &Path) {
    mount();
    let start = small(path);
    let whole = std::fs::read(path).expect("closed");
    for fault in [
        Fault::WriteFails,
        Fault::WriteIsShort,
        Fault::SyncFails,
        Fault::DeleteFails,
    ] {
        for goes_on in [false, true] {
            let mut num_good = 0;
            let mut num_refused = 0;
            loop {
                std::fs::write(path, &whole).expect("writable");
                let what = format!("{fault:?} after {num_good}, goes on: {goes_on}");
                let map = Map::open(path).expect("sound");
                arm(fault, num_good, goes_on);
                let mut acknowledged = start.generation();
                for generation in [start.generation() + 1, start.generation() + 2] {
                    let before = map.snapshot();
                    let next = after_commits(&start, start.generation(), generation);
                    match map.commit(&next) {
                        Ok(stored) => acknowledged = stored,
                        Err(error) => {
                            assert!(error.to_string().contains("a.map"), "{what}: {error}");
                            assert_eq!(map.snapshot(), before, "{what}");
                            num_refused += 1;
                            break;
                        }
                    }
                }
                drop(map);
                let has_struck = disarm();
                reopened(path, &start, acknowledged, &what);
                assert!(!path.with_extension("map-journal").exists(), "{what}");
                if !has_struck {
                    break;
                }
                num_good += 1;
            }
            assert!(num_good >= 2 && num_refused >= 2, "{fault:?} never struck");
        }
    }
}

#[test]
fn a_torn_write_or_a_power_cut_loses_nothing() {
    const FILE: &str = "CHRONOTOPE_TEST_STOPPING_DISK";
    if let Some(order) = std::env::var_os(FILE) {
        // Started again below: commits and prunes until the disk stops.
        let order = order.to_str().expect("ours");
        let (number, path) = order.split_once(':').expect("ours");
        return commit_until_it_stops(number.parse().expect("ours"), Path::new(path));
    }
    for fault in [Fault::WriteIsTorn, Fault::PowerGoes] {
        let mut num_good = 0;
        loop {
            let (folder, path) = folder();
            let start = small(&path);
            let synced = folder.path().join(SYNCED);
            let mut order = format!("{num_good}:").into_bytes();
            if fault == Fault::PowerGoes {
                std::fs::create_dir(&synced).expect("new");
                std::fs::copy(&path, synced.join("a.map")).expect("writable");
            }
            order.extend(path.as_os_str().as_bytes());
            let name = "faulty_disk::a_torn_write_or_a_power_cut_loses_nothing";
            let (mut child, lines) = start_again(name, FILE, Path::new(OsStr::from_bytes(&order)));
            let said = lines.filter_map(|line| line.strip_prefix("committed ")?.parse().ok());
            let acknowledged = said.last().unwrap_or(start.generation());
            let status = child.wait().expect("ours");
            if fault == Fault::PowerGoes {
                for name in ["a.map", "a.map-journal"] {
                    let _ = std::fs::remove_file(folder.path().join(name));
                    let there = synced.join(name);
                    if there.exists() {
                        std::fs::rename(there, folder.path().join(name)).expect("writable");
                    }
                }
            }
            reopened(
                &path,
                &start,
                acknowledged,
                &format!("{fault:?} after {num_good}"),
            );
            if status.success() {
                break;
            }
            assert_eq!(status.code(), Some(STOPPED));
            num_good += 1;
        }
        println!("{fault:?}: {num_good} times");
        assert!(num_good > 10, "{fault:?} struck {num_good} times only");
    }
}

const SYNCED: &str = "synced";

fn commit_until_it_stops(num_good: u32, path: &Path) {
    use std::io::Write;

    mount();
    let synced = path.with_file_name(SYNCED);
    let fault = if synced.exists() {
        disk().synced = Some(synced);
        Fault::PowerGoes
    } else {
        Fault::WriteIsTorn
    };
    let map = Map::open(path).expect("sound");
    arm(fault, num_good, false);
    for _ in 0..2 {
        let now = map.snapshot();
        let next = after_commits(&now, now.generation(), now.generation() + 1);
        let generation = map.commit(&next).expect("it stops or it is well");
        writeln!(std::io::stdout(), "committed {generation}").expect("heard");
    }
    map.prune(&BTreeSet::new()).expect("it stops or it is well");
}
