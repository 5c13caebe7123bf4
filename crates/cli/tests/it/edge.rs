//! `chronotope map edge`.

use crate::fixture::Fixture;

#[test]
fn edges_are_listed_added_and_removed() {
    let fixture = Fixture::with_map();
    let edges = || fixture.run("map edge street.map list --json").lines();
    assert_eq!(edges().len(), 2);
    let add = "map edge street.map add place-02 place-03 --name alley";
    fixture.succeeds(add);
    // What is there already changes nothing.
    fixture.succeeds(add);
    assert_eq!(edges().len(), 3);
    assert_eq!(edges()[2]["name"], "alley");
    let remove = "map edge street.map remove place-00 place-01";
    fixture.fails(&format!("{remove} --name lane"), &["no such edge"]);
    fixture.succeeds(remove);
    assert_eq!(edges().len(), 2);
    fixture.fails(remove, &["no such edge"]);
    fixture.fails("map edge street.map add place-00 nowhere", &["`nowhere`"]);
    fixture.succeeds("map verify street.map");
}
