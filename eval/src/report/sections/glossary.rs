//! What do the names of a run mean?

use crate::report::html::put;
use crate::results::{SuiteResults, Variant};

/// The meaning of the presets, methods and scores that the run has.
pub(super) fn words(results: &SuiteResults) -> String {
    const MEANINGS: [(&str, &str); 14] = [
        ("lttl", "preset: the recipe of the published benchmark"),
        ("default", "preset: what this project ships"),
        (
            "static",
            "method: the features seen most often, whatever the time",
        ),
        (
            "fremen",
            "method: the features most likely at the time of the image",
        ),
        (
            "experience",
            "method: an appearance is added to a place when the ones so far fail",
        ),
        (
            "experience-all",
            "method: every visit is kept as an appearance",
        ),
        (
            "freex",
            "method: the appearances that are likely at the time of the image",
        ),
        (
            "fused",
            "method: likely features and likely appearances under one budget",
        ),
        ("count", "score: how many predicted features are matched"),
        (
            "inliers",
            "score: how many matches agree on one displacement",
        ),
        (
            "likelihood",
            "score: how probable matches and misses are at this place",
        ),
        (
            "tracked",
            "score: what is believed after all images of the way so far, as with --track",
        ),
        (
            "kidnapped",
            "score: as tracked, of a robot that is carried elsewhere after every 25 images",
        ),
        (
            "sequence",
            "score: the likelihoods of the latest ten images along the route, as in SeqSLAM",
        ),
    ];
    const OF_MODELS: [(&str, &str); 8] = [
        (
            "likeliest",
            "the likeliest features, whether or not they cover the place\u{2019}s appearances",
        ),
        (
            "covering",
            "features that cover the place\u{2019}s appearances, for a score that goes with the likeliest",
        ),
        (
            "without appearances",
            "it is not used that features seen together are expected together",
        ),
        (
            "without distances",
            "it is not used how near the descriptors of a match are",
        ),
        (
            "without displacement",
            "it is not used how far the camera seems displaced",
        ),
        (
            "without false-rates",
            "it is not used which features are found at other places too",
        ),
        (
            "without repeatability",
            "it is not used at which places features are found again more often",
        ),
        (
            "without strays",
            "it is not used how many matches there are that do not agree with the others",
        ),
    ];
    let variants = results.variants();
    let is_used = |word: &str| {
        let names = |v: &Variant| [v.preset.clone(), v.method.clone(), v.score.clone()];
        variants
            .iter()
            .any(|variant| names(variant).iter().any(|name| name == word))
    };
    let of_models = (OF_MODELS.iter())
        .filter(|(word, _)| variants.iter().any(|variant| variant.model.ends_with(word)));
    let mut html =
        String::from("<details><summary>What the names mean</summary><dl class=\"facts\">");
    for (word, meaning) in (MEANINGS.iter().filter(|(word, _)| is_used(word))).chain(of_models) {
        put!(html, "<dt>{word}</dt><dd>{meaning}</dd>");
    }
    html.push_str("</dl></details>");
    html
}
