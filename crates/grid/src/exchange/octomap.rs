//! How does a 3-D map become an `OctoMap` tree that others read, and the reverse?
//!
//! `OctoMap`'s binary files (`.bt`; A. Hornung et al.: `OctoMap`, Autonomous Robots, 2013) hold, after a
//! text header, the inner nodes of an octree depth first, each as two bytes: two bits for each of its
//! eight children, which say *unknown*, *free*, *occupied* or *inner node*. A leaf above the lowest
//! level stands for all voxels below it.

use std::io::Write as _;
use std::path::Path;

use fremen::file::{OutputFile, OutputKind};
use fremen::{Error, ErrorKind, Result};

use crate::cells::{CellState, GridSpec, OccupancyMap, Thresholds};

/// Levels of a tree below its root.
const DEPTH: u32 = 16;
/// The voxel whose lowest corner is at zero.
const CENTER: i64 = 1 << (DEPTH - 1);
/// The most bytes of one file.
const MAX_BYTES: u64 = 1 << 30;
/// By how much of a voxel a grid may be off the raster of a tree.
const MAX_OFFSET: f64 = 1e-3;
const HEADER: &str = "# Octomap OcTree binary file";
const KIND: OutputKind = OutputKind {
    noun: "an OctoMap tree",
    begins: HEADER.as_bytes(),
};

/// A leaf of a tree: its lowest voxel, how many voxels long its sides are, whether it is occupied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Leaf {
    min: [u32; 3],
    side: u32,
    is_occupied: bool,
}

/// Reads an `OctoMap` tree from a `.bt` file: a 3-D map of the box of all known voxels, 1 where
/// occupied, 0 where free, NaN where unknown.
///
/// # Errors
/// [`ErrorKind::Format`] with the byte where the file is no such tree or ends too early;
/// [`ErrorKind::Config`] where it is empty or spans more voxels than a grid may have.
pub fn read_octomap(path: impl AsRef<Path>) -> Result<OccupancyMap> {
    let path = path.as_ref();
    let bytes = fremen::file::read(path, MAX_BYTES)?;
    parse(&bytes).map_err(|error| error.with_path(path))
}

/// Writes the most likely states of a 3-D map as an `OctoMap` tree, in place of an earlier one that is
/// none of `inputs`.
///
/// # Errors
/// [`ErrorKind::Shape`] where the map is 2-D, its voxels do not lie on the raster of a tree, whose
/// origin is at zero, or it reaches out of the 65,536 voxels that a tree has along each axis.
pub fn write_octomap(
    map: &OccupancyMap,
    thresholds: Thresholds,
    path: impl AsRef<Path>,
    inputs: &[&Path],
) -> Result<()> {
    let path = path.as_ref();
    let bytes = encode(map, thresholds).map_err(|error| error.with_path(path))?;
    let mut file = OutputFile::replace(path, KIND, inputs)?;
    file.write_all(&bytes)
        .map_err(|cause| Error::io(path, cause))?;
    file.finish()
}

fn broken(at: usize, message: &str) -> Error {
    Error::new(ErrorKind::Format, message.to_owned())
        .with_place(format!("byte {at}"))
        .with_help("write it again with OctoMap's writeBinary")
}

/// What the lines before the data say, and where the data begin.
fn header(bytes: &[u8]) -> Result<(f64, usize)> {
    if !bytes.starts_with(HEADER.as_bytes()) {
        return Err(broken(0, "this is no binary OctoMap tree")
            .with_help("convert a full tree (.ot) with `convert_octree`"));
    }
    let (mut at, mut resolution_m) = (0, None);
    // Headers have a handful of lines.
    for _ in 0..64 {
        let end = bytes[at..].iter().position(|byte| *byte == b'\n');
        let end = at + end.ok_or_else(|| broken(at, "the header has no line `data`"))?;
        let line = String::from_utf8_lossy(&bytes[at..end]);
        let line = line.trim();
        let start = at;
        at = end + 1;
        match line.split_once(' ') {
            _ if line == "data" => {
                let resolution_m =
                    resolution_m.ok_or_else(|| broken(start, "the header has no `res`"))?;
                return Ok((resolution_m, at));
            }
            Some(("id", id)) if id.trim() != "OcTree" => {
                let message = format!("a tree of kind {}", fremen::error::printable(id));
                return Err(broken(start, &message).with_help("only OcTree is read"));
            }
            Some(("res", text)) => {
                let value: Option<f64> = text.trim().parse().ok();
                let value = value.filter(|it| it.is_finite() && *it > 0.0);
                resolution_m = Some(value.ok_or_else(|| broken(start, "`res` is no size"))?);
            }
            _ => {}
        }
    }
    Err(broken(at, "the header has no line `data`"))
}

fn parse(bytes: &[u8]) -> Result<OccupancyMap> {
    let (resolution_m, start) = header(bytes)?;
    let mut reader = Reader {
        bytes,
        at: start,
        leaves: Vec::new(),
    };
    reader.node([0; 3], DEPTH)?;
    if reader.at != bytes.len() {
        return Err(broken(reader.at, "bytes follow the tree"));
    }
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    for leaf in &reader.leaves {
        for axis in 0..3 {
            low[axis] = low[axis].min(leaf.min[axis]);
            high[axis] = high[axis].max(leaf.min[axis] + leaf.side);
        }
    }
    if reader.leaves.is_empty() {
        return Err(Error::new(ErrorKind::Config, "the tree knows no voxel"));
    }
    let origin_m = low.map(|it| (i64::from(it) - CENTER) as f64 * resolution_m);
    let dims: [u32; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
    let spec = GridSpec::new_3d(origin_m, resolution_m, dims)?;
    let mut map = OccupancyMap::new_unknown(spec);
    let cells = map.probabilities_mut();
    for leaf in &reader.leaves {
        let from: [u32; 3] = std::array::from_fn(|axis| leaf.min[axis] - low[axis]);
        for z in from[2]..from[2] + leaf.side {
            for y in from[1]..from[1] + leaf.side {
                let start = spec.index([from[0], y, z]);
                cells[start..start + leaf.side as usize]
                    .fill(f32::from(u8::from(leaf.is_occupied)));
            }
        }
    }
    Ok(map)
}

/// Goes through the nodes of a tree.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    leaves: Vec<Leaf>,
}

impl Reader<'_> {
    /// An inner node whose lowest voxel is `min`, `level` levels above the voxels.
    fn node(&mut self, min: [u32; 3], level: u32) -> Result<()> {
        let Some(&[low, high]) = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk) else {
            return Err(broken(
                self.at,
                "the tree ends here, in the middle of a node",
            ));
        };
        let at = self.at;
        self.at += 2;
        let children = u16::from_le_bytes([low, high]);
        let mut inner = [None; 8];
        for (child, inner) in inner.iter_mut().enumerate() {
            let min = child_of(min, level, child);
            let mut leaf = |is_occupied| {
                self.leaves.push(Leaf {
                    min,
                    side: 1 << (level - 1),
                    is_occupied,
                });
            };
            match children >> (2 * child) & 3 {
                1 => leaf(false),
                2 => leaf(true),
                3 if level == 1 => {
                    return Err(broken(at, "a node below the voxels"));
                }
                3 => *inner = Some(min),
                _ => {}
            }
        }
        for min in inner.into_iter().flatten() {
            self.node(min, level - 1)?;
        }
        Ok(())
    }
}

/// The lowest voxel of a child: bit 0 of its number is along x, bit 1 along y, bit 2 along z.
fn child_of(min: [u32; 3], level: u32, child: usize) -> [u32; 3] {
    std::array::from_fn(|axis| min[axis] + ((child as u32 >> axis & 1) << (level - 1)))
}

fn encode(map: &OccupancyMap, thresholds: Thresholds) -> Result<Vec<u8>> {
    let spec = *map.spec();
    if spec.is_2d() {
        return Err(Error::new(ErrorKind::Shape, "a 2-D map is no octree")
            .with_help("write it for map_server"));
    }
    let mut min = [0_u32; 3];
    for (axis, min) in min.iter_mut().enumerate() {
        let cells = spec.origin_m()[axis] / spec.resolution_m();
        if (cells - cells.round()).abs() > MAX_OFFSET {
            return Err(Error::new(
                ErrorKind::Shape,
                format!("the origin is {cells:.3} voxels from zero, not whole voxels"),
            )
            .with_help("an OctoMap tree has its raster at zero: choose such an origin"));
        }
        let first = cells.round() as i64 + CENTER;
        let end = first.saturating_add(i64::from(spec.dims()[axis]));
        if first < 0 || end > 2 * CENTER {
            let message = "the map reaches out of an OctoMap tree, 32,768 voxels from zero";
            return Err(Error::new(ErrorKind::Shape, message));
        }
        *min = first as u32;
    }
    let mut writer = Writer {
        map,
        thresholds,
        min,
        nodes: Vec::new(),
        num_nodes: 1,
    };
    let root = writer.node([0; 3], DEPTH);
    let (resolution_m, num_nodes) = (spec.resolution_m(), writer.num_nodes);
    let mut bytes = format!(
        "{HEADER}\n# (feel free to add / change comments, but leave the first line as it is!)\n#\nid \
         OcTree\nsize {num_nodes}\nres {resolution_m}\ndata\n"
    )
    .into_bytes();
    match root {
        Node::Inner => bytes.extend(writer.nodes.iter().rev().flatten()),
        // The root is never a leaf: no map has all voxels of a tree.
        Node::Unknown | Node::Leaf(_) => bytes.extend([0, 0]),
    }
    Ok(bytes)
}

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Node {
    Unknown,
    Leaf(bool),
    Inner,
}

/// Makes the nodes of a tree, from the last to the first.
struct Writer<'a> {
    map: &'a OccupancyMap,
    thresholds: Thresholds,
    /// The voxel of the map's first cell.
    min: [u32; 3],
    nodes: Vec<[u8; 2]>,
    num_nodes: usize,
}

impl Writer<'_> {
    /// A node whose lowest voxel is `min`, `level` levels above the voxels; eight alike leaves are one.
    fn node(&mut self, min: [u32; 3], level: u32) -> Node {
        let dims = self.map.spec().dims();
        let side = 1_u32 << level;
        let is_apart = |axis: usize| {
            min[axis] >= self.min[axis] + dims[axis] || min[axis] + side <= self.min[axis]
        };
        if (0..3).any(is_apart) {
            return Node::Unknown;
        }
        if level == 0 {
            let cell: [u32; 3] = std::array::from_fn(|axis| min[axis] - self.min[axis]);
            let index = self.map.spec().index(cell);
            return match self.map.state(index, self.thresholds) {
                CellState::Unknown => Node::Unknown,
                state => Node::Leaf(state == CellState::Occupied),
            };
        }
        let (nodes_before, num_before) = (self.nodes.len(), self.num_nodes);
        let mut children = [Node::Unknown; 8];
        // Backwards, as `nodes` is.
        for child in (0..8).rev() {
            children[child] = self.node(child_of(min, level, child), level - 1);
        }
        if children.iter().all(|it| *it == children[0]) && children[0] != Node::Inner {
            self.nodes.truncate(nodes_before);
            self.num_nodes = num_before;
            return children[0];
        }
        self.num_nodes += children.iter().filter(|it| **it != Node::Unknown).count();
        let bits = children.iter().enumerate().map(|(child, node)| {
            let bits: u16 = match node {
                Node::Unknown => 0,
                Node::Leaf(false) => 1,
                Node::Leaf(true) => 2,
                Node::Inner => 3,
            };
            bits << (2 * child)
        });
        self.nodes.push(bits.sum::<u16>().to_le_bytes());
        Node::Inner
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn map(origin: [f64; 3], dims: [u32; 3], seed: u64) -> OccupancyMap {
        let spec = GridSpec::new_3d(origin, 0.25, dims).expect("a grid");
        let mut map = OccupancyMap::new_unknown(spec);
        let mut random = Random::stream(seed, &[1]);
        for index in 0..spec.num_cells() {
            let [x, y, z] = spec.cell(index);
            // Blocks that can be put together, and single voxels.
            let p = match (x / 4 + y / 4 + z / 4) % 3 {
                0 => Some(0.0),
                1 => Some(1.0),
                _ => [None, Some(0.0), Some(1.0)][random.below(3)],
            };
            map.set(index, p);
        }
        map
    }

    #[test]
    fn trees_give_their_maps_back() -> Result<()> {
        for (seed, origin, dims) in [
            (1, [-2.0, 0.0, 0.25], [17, 9, 12]),
            (2, [-8192.0, 100.0, 8187.75], [1, 2, 17]),
            (3, [0.0; 3], [64, 64, 64]),
        ] {
            let map = map(origin, dims, seed);
            let back = parse(&encode(&map, Thresholds::default())?)?;
            for index in 0..map.spec().num_cells() {
                let center = map.spec().center(map.spec().cell(index));
                let found = back.spec().cell_at(center).map(|it| back.spec().index(it));
                assert_eq!(
                    found.and_then(|it| back.get(it)),
                    map.get(index),
                    "{center:?}"
                );
            }
            let known =
                |map: &OccupancyMap| map.probabilities().iter().filter(|p| !p.is_nan()).count();
            assert_eq!(known(&map), known(&back));
        }
        Ok(())
    }

    #[test]
    fn what_is_no_tree_is_refused_with_its_place() -> Result<()> {
        let whole = encode(&map([0.0; 3], [9, 9, 9], 4), Thresholds::default())?;
        let start = header(&whole)?.1;
        let message = |bytes: &[u8]| parse(bytes).expect_err("broken").to_string();
        for end in start..whole.len() {
            assert!(message(&whole[..end]).contains("ends here"));
        }
        assert!(message(&[&whole[..], b"x"].concat()).contains("bytes follow"));
        assert!(message(b"P5 1 1").contains("no binary OctoMap tree"));
        assert!(message(HEADER.as_bytes()).contains("no line `data`"));
        let head = |lines: &str| format!("{HEADER}\n{lines}data\n").into_bytes();
        assert!(message(&head("id OcTree\n")).contains("no `res`"));
        assert!(message(&head("res -1\n")).contains("no size"));
        assert!(message(&head("id ColorOcTree\nres 1\n")).contains("kind ColorOcTree"));
        // A root with nothing, and one that knows everything.
        assert!(parse(&[&head("res 1\n")[..], &[0, 0]].concat()).is_err());
        assert!(parse(&[&head("res 1\n")[..], &[0x55, 0x55]].concat()).is_err());
        // Inner nodes without end.
        assert!(parse(&[&head("res 1\n")[..], &[3, 0].repeat(40)].concat()).is_err());
        let wrong = map([0.1, 0.0, 0.0], [2, 2, 2], 5);
        assert!(encode(&wrong, Thresholds::default()).is_err());
        Ok(())
    }
}
