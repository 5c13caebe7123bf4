//! What is around the sections of every report?

use super::html::{Esc, Words, put};

/// A page of sections (id, name, body), of which the empty ones are left out.
pub(super) fn document(
    title: &str,
    head: &str,
    sections: &[(&str, &str, String)],
    foot: &str,
) -> String {
    let shown = || sections.iter().filter(|(_, _, body)| !body.is_empty());
    let mut html = String::new();
    put!(
        html,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <title>Chronotope, suite {}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n",
        Esc(title)
    );
    put!(html, "<header>{head}<nav aria-label=\"Sections\">");
    for (id, name, _) in shown() {
        put!(html, "<a href=\"#{id}\">{name}</a>");
    }
    html.push_str("</nav></header>\n<main>\n");
    for (id, _, body) in shown() {
        put!(html, "<section id=\"{id}\">\n{body}</section>\n");
    }
    put!(
        html,
        "</main>\n<footer>{foot}</footer>\n<script>{SCRIPT}</script>\n</body>\n</html>\n"
    );
    html
}

const STYLE: &str = include_str!("style.css");

const SCRIPT: &str = include_str!("script.js");

/// Nothing may be loaded: what the file needs, it holds.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The command that gives the same run again; nothing where it is not known.
pub(super) fn run_again(html: &mut String, command: &str) {
    if !command.is_empty() {
        put!(
            html,
            "<p class=\"again\">Run it again: <code>{}</code></p>",
            Words(command)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// `--name:#hex` of a rule of the style sheet.
    fn variables(rule: &str) -> BTreeMap<&str, &str> {
        rule.split(['{', ';', '}'])
            .filter_map(|part| part.trim().strip_prefix("--")?.split_once(":#"))
            .collect()
    }

    /// Relative luminance (WCAG 2).
    fn luminance(hex: &str) -> f64 {
        let hex = if hex.len() == 3 {
            hex.chars().flat_map(|c| [c, c]).collect()
        } else {
            hex.to_owned()
        };
        let channel = |at: usize| {
            let value = f64::from(u8::from_str_radix(&hex[at..at + 2], 16).unwrap()) / 255.0;
            if value <= 0.040_45 {
                value / 12.92
            } else {
                ((value + 0.055) / 1.055).powf(2.4)
            }
        };
        0.2126 * channel(0) + 0.7152 * channel(2) + 0.0722 * channel(4)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn text_and_lines_stand_out_in_light_and_dark() {
        let mut rules = STYLE.split(":root").skip(1);
        let light = variables(rules.next().unwrap().split_once('}').unwrap().0);
        let dark = variables(rules.next().unwrap().split_once('}').unwrap().0);
        for (mode, colours) in [("light", light), ("dark", dark)] {
            for background in ["bg", "card"] {
                for text in ["ink", "muted", "accent", "good", "bad"] {
                    let ratio = contrast(colours[text], colours[background]);
                    assert!(ratio >= 4.5, "{mode}: {text} on {background}: {ratio:.2}");
                }
                for line in 0..8 {
                    let ratio = contrast(colours[format!("c{line}").as_str()], colours[background]);
                    assert!(ratio >= 3.0, "{mode}: c{line} on {background}: {ratio:.2}");
                }
            }
        }
    }
}
