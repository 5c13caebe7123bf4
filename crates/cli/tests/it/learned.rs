//! `chronotope map build --extractor onnx`: features of a network that the tests write.

use crate::fixture::Fixture;

#[cfg(not(feature = "onnx"))]
#[test]
fn a_command_without_networks_says_how_to_have_them() {
    let fixture = Fixture::new();
    fixture.write("eye.onnx", "anything");
    let build = "map build --data data --out street.map --model eye.onnx --extractor";
    fixture.fails(&format!("{build} onnx"), &["--features onnx"]);
    assert!(!fixture.path("street.map.part").exists());
    let words = ["names no extractor", "double quotes"];
    fixture.fails(&format!("{build} onnx:layer=waves"), &words);
}

#[cfg(feature = "onnx")]
#[test]
fn a_map_of_learned_features_is_built_grows_and_locates_with_its_model_only() {
    use crate::fixture::{QUERIES, QUERY_TIME};
    use crate::tiny_network::TinyNetwork;
    use chronotope::feature::ModelDigest;

    let fixture = Fixture::with_map();
    let bytes = TinyNetwork::default().to_bytes();
    let digest = ModelDigest::of(&bytes);
    fixture.write("eye.onnx", &bytes);
    fixture.write("plain.onnx", "no network");
    let other = TinyNetwork {
        gain: 2.0,
        ..TinyNetwork::default()
    };
    fixture.write("other.onnx", other.to_bytes());

    let build = "map build --data data --out learned.map --extractor";
    let eye = "onnx:layer=\"waves\",width=320,height=240";
    fixture.fails(&format!("{build} {eye}"), &["which model?", "--model"]);
    let layers = ["no layer of the network is named", "waves (24 channels"];
    fixture.fails(&format!("{build} onnx --model eye.onnx"), &layers);
    let words = ["plain.onnx: ", "no ONNX model"];
    fixture.fails(&format!("{build} {eye} --model plain.onnx"), &words);
    assert!(!fixture.path("learned.map.part").exists());

    let built = fixture.succeeds(&format!("{build} {eye} --model eye.onnx"));
    built.prints(&["4 places, 24 visits (24 learnt now)"]);
    let shown = &fixture.run("map inspect learned.map --json").lines()[0];
    let id = shown["extractor"].as_str().expect("text");
    assert!(id.contains(&digest.to_string()), "{id}");
    fixture.succeeds("map verify learned.map");
    let update = "map update learned.map --data data --model eye.onnx";
    fixture.succeeds(update).prints(&["(0 learnt now)"]);

    let localize = format!("localize learned.map {QUERIES} --time {QUERY_TIME} --json");
    let with_file = fixture.run(&format!("{localize} --model eye.onnx"));
    let lines = with_file.lines();
    assert_eq!(lines.len(), 4);
    for (place, line) in lines.iter().enumerate() {
        let expected = format!("place-{place:02}");
        assert_eq!(line["best"]["place"], expected.as_str(), "{line}");
    }
    fixture.fails(
        &localize,
        &["learned.map: ", "is not there", "CHRONOTOPE_MODELS"],
    );
    let words = ["other.onnx: ", "another model"];
    fixture.fails(&format!("{localize} --model other.onnx"), &words);
    fixture.write(format!("{digest}.onnx"), &bytes);
    let with_folder = (fixture.command(&localize).env("CHRONOTOPE_MODELS", ".")).output();
    let with_folder = crate::fixture::Ran::from(with_folder.expect("the command starts"));
    assert_eq!(with_folder.stdout, with_file.stdout);
    // A map of BRIEF needs none.
    let words = format!("localize street.map query0.png --time {QUERY_TIME}");
    fixture.succeeds(&words);
}
