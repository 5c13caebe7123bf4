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
