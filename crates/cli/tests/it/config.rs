//! The numbers that `--config` takes and `--print-config` prints.

use crate::fixture::Fixture;

#[test]
fn a_printed_configuration_reads_back() {
    let fixture = Fixture::new();
    for preset in ["default", "lttl"] {
        let printed = fixture.succeeds(&format!(
            "map build --print-config --preset {preset} --keep-appearances none"
        ));
        printed.prints(&["keep-appearances = \"none\""]);
        fixture.write("numbers.toml", &printed.stdout);
        for command in ["map build", "localize", "predict"] {
            let again = fixture.run(&format!("{command} --config numbers.toml --print-config"));
            assert_eq!(again.stdout, printed.stdout, "{command:?}: {again:?}");
        }
    }
    let changed = fixture.run("localize --print-config --method static --n 7");
    changed.prints(&["method = \"static\"", "top = 7"]);

    for (text, words) in [
        (
            "[localize]\nmethods = 'static'",
            &["bad.toml: line 2", "methods"][..],
        ),
        (
            "[learn]\nfeatures-per-visit = -3",
            &["bad.toml: line 2", "-3"],
        ),
        (
            "[localize]\nselection = { threshold = nan }",
            &["bad.toml: line 2", "[0, 1]"],
        ),
        ("nonsense", &["bad.toml: line 1"]),
        ("[learnt]", &["bad.toml: line 1", "learnt"]),
    ] {
        fixture.write("bad.toml", text);
        fixture.fails("localize --print-config --config bad.toml", words);
    }
    fixture.fails(
        "localize --print-config --config none.toml",
        &["none.toml", "--print-config"],
    );
}
