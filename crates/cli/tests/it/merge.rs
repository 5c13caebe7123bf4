//! `chronotope map merge`.

use crate::fixture::Fixture;

#[test]
fn maps_of_two_halves_merge_into_one() {
    let fixture = Fixture::new();
    let whole_index = fixture.index();
    let (head, visits) = whole_index.split_once('\n').expect("a header");
    let visits: Vec<&str> = visits.lines().collect();
    for (name, rows) in [("early", 0..16), ("late", 8..24)] {
        let index: String = std::iter::once(&head)
            .chain(&visits[rows])
            .flat_map(|line| [*line, "\n"])
            .collect();
        fixture.write("data/index.csv", index);
        fixture.succeeds(&format!("map build --data data --out {name}.map"));
    }
    let again = "map merge early.map late.map --out ab.map";
    let merged = fixture.succeeds(again);
    merged.prints(&["24 visits (8 were in more"]);
    fixture.succeeds("map merge late.map early.map --out ba.map");
    let digest = |name| fixture.open(name).digest();
    assert_eq!(digest("ab.map"), digest("ba.map"));
    fixture.succeeds("map verify ab.map");
    assert!(!fixture.path("ab.map.part").exists());
    fixture.fails(again, &["ab.map", "never overwritten"]);
    fixture.fails(
        "map merge early.map late.map --out c.map --relearn",
        &["--keep-appearances all"],
    );
}

#[test]
fn maps_that_have_nothing_in_common_are_not_taken_for_one_world() {
    let fixture = Fixture::new();
    let whole = fixture.index();
    let (head, visits) = whole.split_once('\n').expect("a header");
    let visits: Vec<&str> = visits.lines().collect();
    let build = |name: &str, rows: &[&str], rename: (&str, &str)| {
        let rows = rows.join("\n").replace(rename.0, rename.1);
        fixture.write("data/index.csv", format!("{head}\n{rows}\n"));
        fixture.succeeds(&format!("map build --data data --out {name}.map"));
    };
    // The same places on other days, and other places by the same names.
    build("early", &visits[..12], ("", ""));
    build("late", &visits[12..], ("", ""));
    let only = |place: &str| -> Vec<&str> {
        (visits.iter().copied())
            .filter(|row| row.starts_with(place))
            .collect()
    };
    // Edges and poses of places that a map lacks would be problems.
    for name in ["data/edges.csv", "data/poses.csv"] {
        std::fs::remove_file(fixture.path(name)).expect("there");
    }
    build("here", &only("place-00"), ("place-00", "lamp"));
    build("there", &only("place-01"), ("place-01", "lamp"));
    fixture.succeeds("map merge early.map late.map --out week.map");
    let line = "map merge here.map there.map --out both.map";
    fixture.fails(line, &["there.map", "nothing in common", "--disjoint"]);
    assert!(!fixture.path("both.map").exists());
    fixture.succeeds(&format!("{line} --disjoint"));
}
