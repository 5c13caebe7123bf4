//! `chronotope dataset check`.

use crate::fixture::{Fixture, Ran};

#[test]
fn a_kernel_that_is_none_is_reported() {
    let fixture = Fixture::new();
    let mut command = fixture.command("dataset check data");
    command.env("CHRONOTOPE_KERNEL", "abacus");
    let ran = Ran::from(command.output().expect("it starts"));
    assert_eq!(ran.code, 2, "{ran:?}");
    ran.notes(&["CHRONOTOPE_KERNEL", "abacus"]);
}
