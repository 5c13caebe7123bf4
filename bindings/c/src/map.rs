//! What is in a map, for C?

use std::ffi::{CString, c_char};
use std::sync::Arc;

use engine::map::{Map, Snapshot};

use crate::status::{
    ChronotopeStatus, Failure, boxed, c_text, freed, guarded, shared, text, written,
};

/// A map as it was when it was opened.
#[derive(Debug)]
pub struct ChronotopeMap {
    snapshot: Arc<Snapshot>,
    names: Vec<CString>,
}

/// The names of a map's places, by node.
pub(crate) fn names_of(snapshot: &Snapshot) -> Vec<CString> {
    (snapshot.nodes().iter())
        .map(|node| c_text(node.key().as_str()))
        .collect()
}

/// A name out of a list.
pub(crate) fn name(names: &[CString], node: usize) -> Result<*const c_char, Failure> {
    (names.get(node).map(|name| name.as_ptr())).ok_or(Failure::Argument("there is no such node"))
}

/// Opens a map file; it is only read. Any thread.
///
/// # Safety
///
/// `path` is a text that ends in a zero, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_open(
    path: *const c_char,
    out: *mut *mut ChronotopeMap,
) -> ChronotopeStatus {
    guarded(|| {
        let snapshot = Map::open_read_only(text(path)?)?.snapshot();
        let names = names_of(&snapshot);
        boxed(out, ChronotopeMap { snapshot, names })
    })
}

/// Frees a map; NULL is nothing. Not while another thread uses it.
///
/// # Safety
///
/// `map` is NULL or comes from `chronotope_map_open` and was not freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_free(map: *mut ChronotopeMap) {
    freed(map);
}

/// How many places a map has. Any number of threads at once.
///
/// # Safety
///
/// `map` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_num_places(
    map: *const ChronotopeMap,
    out: *mut usize,
) -> ChronotopeStatus {
    guarded(|| written(out, shared(map)?.names.len()))
}

/// The name of a place, which lives as long as the map. Any number of threads at once.
///
/// # Safety
///
/// `map` is NULL or was not freed, and `out` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_place_name(
    map: *const ChronotopeMap,
    node: usize,
    out: *mut *const c_char,
) -> ChronotopeStatus {
    guarded(|| written(out, name(&shared(map)?.names, node)?))
}

/// Where a place is, in metres, and whether that is known. Any number of threads at once.
///
/// # Safety
///
/// `map` is NULL or was not freed; `xyz` has room for three numbers, and `is_known` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_place_pose(
    map: *const ChronotopeMap,
    node: usize,
    xyz: *mut f64,
    is_known: *mut bool,
) -> ChronotopeStatus {
    guarded(|| {
        let nodes = shared(map)?.snapshot.nodes();
        let node = nodes
            .get(node)
            .ok_or(Failure::Argument("there is no such node"))?;
        written(is_known, node.pose().is_some())?;
        written(xyz.cast::<[f64; 3]>(), node.pose().unwrap_or_default())
    })
}

/// Columns and rows of the images that a map was learnt from; 0 and 0 of an empty map. Any number of
/// threads at once.
///
/// # Safety
///
/// `map` is NULL or was not freed; `width` and `height` can be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn chronotope_map_image_size(
    map: *const ChronotopeMap,
    width: *mut u32,
    height: *mut u32,
) -> ChronotopeStatus {
    guarded(|| {
        let size = shared(map)?.snapshot.meta().image_size.unwrap_or_default();
        written(width, size.0)?;
        written(height, size.1)
    })
}
