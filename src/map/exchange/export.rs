//! How does a map become a folder of plain files?

use std::path::Path;

use super::arrays::Arrays;
use super::folder::NewFolder;
use super::layout::{EDGE_COLUMNS, LAYOUT, META_COLUMNS, PLACE_COLUMNS, VISIT_COLUMNS};
use super::npy;
use super::table::Table;
use crate::map::node::Node;
use crate::map::snapshot::Snapshot;
use crate::map::types::{Edge, MapMeta};
use fremen::error::Result;
use fremen::visibility::FeatureState;

impl Snapshot {
    /// Writes the map into `folder`, which must not exist yet or be empty. It is there whole or
    /// not at all.
    pub fn export(&self, folder: impl AsRef<Path>) -> Result<()> {
        let mut folder = NewFolder::begin(folder.as_ref())?;
        let mut table = |name: &str, columns: &[&str], rows: &[Vec<String>]| {
            folder.write(name, &Table::to_csv(columns, rows)?)
        };
        table("map.csv", &META_COLUMNS, &meta_rows(&self.meta))?;
        table("edges.csv", &EDGE_COLUMNS, &edge_rows(&self.edges))?;
        let mut places = Vec::new();
        let mut visits = Vec::new();
        let mut features = Arrays::default();
        let mut appearances = Arrays::default();
        let (mut seen, mut located_by) = (Vec::new(), Vec::new());
        for node in &self.nodes {
            places.push(place_row(node));
            features.push(node.features());
            for (at, visit) in node.visits().iter().enumerate() {
                visits.push(visit_row(node, at));
                let len = node.log().seen_row(at).len();
                seen.extend((0..len).map(|i| match node.log().state(at, i) {
                    Some(FeatureState::Seen) => 1,
                    Some(FeatureState::NotSeen) => 0,
                    Some(FeatureState::NotObservable) | None => u8::MAX,
                }));
                let row = node.experience_log().seen_row(at);
                located_by.extend((0..row.len()).map(|i| u8::from(row.get(i))));
                if let Some(appearance) = &visit.appearance {
                    appearances.push(appearance);
                }
            }
        }
        table("places.csv", &PLACE_COLUMNS, &places)?;
        table("visits.csv", &VISIT_COLUMNS, &visits)?;
        features.write(&mut folder, "")?;
        appearances.write(&mut folder, "appearance_")?;
        folder.write("seen.npy", &npy::encode(npy::I8, 0, &seen))?;
        folder.write("located_by.npy", &npy::encode(npy::U8, 0, &located_by))?;
        for (name, value) in &self.attachments {
            folder.write(&format!("attachments/{name}.bin"), value)?;
        }
        folder.finish()
    }
}

fn meta_rows(meta: &MapMeta) -> Vec<Vec<String>> {
    let crop = meta.crop;
    let size = meta.image_size;
    let number = |number: Option<u32>| number.map(|number| number.to_string());
    [
        ("layout", Some(LAYOUT.to_owned())),
        ("uuid", Some(format!("{:032x}", meta.uuid))),
        ("extractor", Some(meta.extractor.clone())),
        ("image_width", number(size.map(|size| size.0))),
        ("image_height", number(size.map(|size| size.1))),
        ("crop_x", number(crop.map(|crop| crop.x))),
        ("crop_y", number(crop.map(|crop| crop.y))),
        ("crop_width", number(crop.map(|crop| crop.width))),
        ("crop_height", number(crop.map(|crop| crop.height))),
        ("preset", Some(meta.preset.clone())),
        ("zone", meta.zone.clone()),
    ]
    .into_iter()
    .filter_map(|(key, value)| Some(vec![key.to_owned(), value?]))
    .collect()
}

fn edge_rows(edges: &[Edge]) -> Vec<Vec<String>> {
    let row = |edge: &Edge| {
        vec![
            edge.from.to_string(),
            edge.to.to_string(),
            edge.name.clone(),
        ]
    };
    edges.iter().map(row).collect()
}

fn place_row(node: &Node) -> Vec<String> {
    let mut row = vec![
        node.key().to_string(),
        node.visits().len().to_string(),
        node.features().len().to_string(),
    ];
    row.extend(match node.pose() {
        // The shortest digits that read back as the same number.
        Some(pose) => pose.map(|x| x.to_string()),
        None => [const { String::new() }; 3],
    });
    row
}

fn visit_row(node: &Node, at: usize) -> Vec<String> {
    let visit = &node.visits()[at];
    let num_appearance = (visit.appearance.as_ref()).map(|features| features.len().to_string());
    vec![
        node.key().to_string(),
        visit.id.to_string(),
        visit.session.to_string(),
        visit.time.as_us().to_string(),
        visit.source.clone(),
        visit.appearance_use.name().to_owned(),
        node.log().seen_row(at).len().to_string(),
        node.log().hidden_row(at).is_some().to_string(),
        node.experience_log().seen_row(at).len().to_string(),
        num_appearance.unwrap_or_default(),
    ]
}
