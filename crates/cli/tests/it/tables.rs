//! `map export --parquet`, `map import --parquet` and `spectrum FILE.parquet`, or their absence.

use crate::fixture::Fixture;

#[cfg(not(feature = "parquet"))]
#[test]
fn without_parquet_the_command_says_how_to_have_it() {
    let fixture = Fixture::with_map();
    let words = ["built without Parquet", "--features parquet"];
    fixture.fails("map export street.map --parquet --out tables", &words);
    fixture.fails("map import data --parquet --out again.map", &words);
    fixture.write("door.parquet", "PAR1");
    fixture.fails("spectrum door.parquet", &words);
    assert!(!fixture.path("tables").exists());
}

#[cfg(feature = "parquet")]
mod with_parquet {
    use chronotope::map::Snapshot;
    use fremen::visibility::FeatureState;
    use serde_json::Value;

    use super::Fixture;

    /// All states of a map, by place, visit and feature, and how each feature looks.
    fn statements(map: &Snapshot) -> Vec<String> {
        let mut all = Vec::new();
        for node in map.nodes() {
            for (at, visit) in node.visits().iter().enumerate() {
                for feature in 0..node.log().seen_row(at).len() {
                    let state = node.log().state(at, feature);
                    let state = state.unwrap_or(FeatureState::NotObservable);
                    let (key, id, time) = (node.key(), visit.id, visit.time);
                    all.push(format!("{key} {id} {time} {feature} {state:?}"));
                }
            }
            let features = node.features();
            let looks = features.keypoints().iter().zip(features.descriptors());
            all.extend(looks.enumerate().map(|it| format!("{} {it:?}", node.key())));
        }
        all.sort();
        all
    }

    #[test]
    fn tables_of_a_map_make_a_map_that_says_the_same() {
        let fixture = Fixture::with_map();
        fixture.succeeds("map export street.map --parquet --out tables");
        fixture.succeeds("map import tables --parquet --out again.map");
        let (ours, again) = (fixture.open("street.map"), fixture.open("again.map"));
        assert!(statements(&ours).len() > 10_000);
        assert!(statements(&ours) == statements(&again));
        assert_eq!(ours.meta().extractor, again.meta().extractor);
        // Again, the same tables and the same map.
        fixture.succeeds("map export again.map --parquet --out more");
        fixture.succeeds("map import more --parquet --out third.map");
        assert_eq!(fixture.open("third.map").digest(), again.digest());
        fixture.fails(
            "map export street.map --parquet --out tables",
            &["tables", "already"],
        );
        let located =
            fixture.succeeds("localize again.map query1.png --time 2023-11-15T12:00:00Z --json");
        assert_eq!(located.lines()[0]["place"], "place-01");
    }

    #[test]
    fn features_stay_those_of_the_maps_own_extractor() {
        let fixture = Fixture::with_map();
        let extractor = "star-brief:num_features=40";
        fixture.succeeds(&format!(
            "map build --data data --extractor {extractor} --out few.map"
        ));
        fixture.succeeds("map export few.map --parquet --out tables");
        fixture.succeeds("map import tables --parquet --out again.map");
        let (ours, again) = (fixture.open("few.map"), fixture.open("again.map"));
        assert!(again.meta().extractor.contains("num_features=40"));
        assert_eq!(ours.meta().extractor, again.meta().extractor);
    }

    #[test]
    fn tables_that_are_not_whole_are_refused() {
        let fixture = Fixture::with_map();
        fixture.succeeds("map export street.map --parquet --out tables");
        let import = "map import tables --parquet --out again.map";
        let path = |name: &str| fixture.path("tables").join(name);
        let observations = std::fs::read(path("observations.parquet")).expect("written");
        fixture.write(
            "tables/observations.parquet",
            &observations[..observations.len() / 2],
        );
        fixture.fails(import, &["observations.parquet", "footer"]);
        fixture.write("tables/observations.parquet", &observations);
        std::fs::copy(path("observations.parquet"), path("features.parquet")).expect("written");
        fixture.fails(
            import,
            &["features.parquet", "observations/1", "features/1"],
        );
        fixture.fails(
            "map import tables tables --parquet --out again.map",
            &["--parquet takes one folder"],
        );
        std::fs::remove_file(path("_SUCCESS")).expect("there");
        fixture.fails(import, &["tables", "_SUCCESS"]);
        assert!(!fixture.path("again.map").exists());
    }

    #[test]
    fn the_rhythms_of_one_feature_are_shown() {
        let fixture = Fixture::with_map();
        fixture.succeeds("map export street.map --parquet --out tables");
        let table = "spectrum tables/observations.parquet";
        let found = fixture.succeeds(&format!("{table} --place place-01 --feature 3 --json"));
        let found: Value = found.lines()[0].clone();
        let map = fixture.open("street.map");
        let log = map.nodes()[1].log();
        let known = (0..log.num_visits()).filter(|&at| {
            let state = (log.seen_row(at).len() > 3)
                .then(|| log.state(at, 3))
                .flatten();
            state.is_some_and(|it| it != FeatureState::NotObservable)
        });
        assert_eq!(found["num_samples"], known.count());
        fixture.fails(table, &["4 places", "--place"]);
        fixture.fails(
            &format!("{table} --place attic"),
            &["no place `attic`", "place-00"],
        );
        fixture.fails(
            &format!("{table} --place place-01"),
            &["features", "--feature"],
        );
        fixture.fails(
            "spectrum data/index.csv --place a",
            &["index.csv", "--place"],
        );
    }
}
