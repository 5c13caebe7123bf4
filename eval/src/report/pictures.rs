//! How are live images with their predictions, and mistakes, shown?

use chronotope::Result;

use super::content::{FeatureClass, FeaturePicture, GalleryImage, Mistake};
use super::html::{Esc, Words, data_uri, put};

/// Widest live image that is embedded.
const LIVE_WIDTH: u32 = 1_024;

/// Widest image of the mistakes' gallery.
const GALLERY_WIDTH: u32 = 360;

impl FeatureClass {
    const ALL: [Self; 3] = [Self::Matched, Self::Missing, Self::Unexpected];

    fn class(self) -> &'static str {
        match self {
            Self::Matched => "matched",
            Self::Missing => "missing",
            Self::Unexpected => "unexpected",
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Matched => "predicted and found",
            Self::Missing => "predicted, not found",
            Self::Unexpected => "seen, not predicted",
        }
    }
}

/// The outline of a class: ring, cross or small triangle.
fn outline(class: FeatureClass, x: f64, y: f64, r: f64) -> String {
    match class {
        FeatureClass::Matched => format!(
            "M{:.1} {y:.1}a{r:.1} {r:.1} 0 1 0 {d:.1} 0a{r:.1} {r:.1} 0 1 0 -{d:.1} 0",
            x - r,
            d = 2.0 * r
        ),
        FeatureClass::Missing => {
            let r = 0.8 * r;
            let d = 2.0 * r;
            format!(
                "M{:.1} {:.1}l{d:.1} {d:.1}M{:.1} {:.1}l-{d:.1} {d:.1}",
                x - r,
                y - r,
                x + r,
                y - r
            )
        }
        FeatureClass::Unexpected => {
            let r = 0.55 * r;
            format!(
                "M{x:.1} {:.1}l{:.1} {:.1}h-{:.1}z",
                y - r,
                0.95 * r,
                1.7 * r,
                1.9 * r
            )
        }
    }
}

/// Live images with their predicted features.
pub(super) fn features(pictures: &[FeaturePicture]) -> Result<String> {
    let mut html = String::new();
    if pictures.is_empty() {
        return Ok(html);
    }
    html.push_str(
        "<h2>What did it expect to see?</h2><p class=\"hint\">The live image with the features that \
         the map predicted for this place at this time. Point at a mark to see how probable it was; \
         press a name below to hide its marks.</p>",
    );
    for picture in pictures {
        let (width, height) = (picture.image.width(), picture.image.height());
        let count = |class| picture.features.iter().filter(|f| f.class == class).count();
        let counts: Vec<String> = FeatureClass::ALL
            .iter()
            .map(|&class| format!("{} {}", count(class), class.words()))
            .collect();
        let note = match picture.note.as_str() {
            "" => String::new(),
            note => format!("<p class=\"hint\">{}</p>", Esc(note)),
        };
        put!(
            html,
            "<figure class=\"picture\"><h3>{}</h3>{note}<svg class=\"scene\" viewBox=\"0 0 {width} {height}\" \
             role=\"img\" aria-label=\"{}: {}\"><image width=\"{width}\" height=\"{height}\" \
             href=\"{}\"/>",
            Esc(&picture.title),
            Esc(&picture.title),
            counts.join(", "),
            data_uri(&picture.image, LIVE_WIDTH)?
        );
        // Marks grow with the image, so that they look alike in every report.
        let unit = width as f64 / 100.0;
        // What was predicted lies on top.
        for class in FeatureClass::ALL.into_iter().rev() {
            put!(html, "<g class=\"k-{}\">", class.class());
            for feature in picture.features.iter().filter(|f| f.class == class) {
                // The centre of the upper-left pixel is (0, 0), in SVG it is (0.5, 0.5).
                let (x, y) = (f64::from(feature.x) + 0.5, f64::from(feature.y) + 0.5);
                let r = match class {
                    // There are many of them, and they are not the point.
                    FeatureClass::Unexpected => unit,
                    _ => (f64::from(feature.size) / 2.0).clamp(1.1 * unit, 1.9 * unit),
                };
                let d = outline(class, x, y, r);
                let title = match class {
                    FeatureClass::Unexpected => class.words().to_owned(),
                    _ => format!("{}, p = {:.2}", class.words(), feature.probability),
                };
                put!(
                    html,
                    "<g><title>{title}</title><path class=\"f halo\" d=\"{d}\"/>\
                     <path class=\"f f-{}\" d=\"{d}\"/></g>",
                    class.class()
                );
            }
            html.push_str("</g>");
        }
        html.push_str("</svg><ul class=\"keys\">");
        for class in FeatureClass::ALL {
            let d = outline(class, 20.0, 8.0, 6.0);
            put!(
                html,
                "<li><button type=\"button\" class=\"key\" data-hides=\"{0}\" aria-pressed=\"true\">\
                 <svg viewBox=\"0 0 40 16\" aria-hidden=\"true\"><path class=\"f halo\" d=\"{d}\"/>\
                 <path class=\"f f-{0}\" d=\"{d}\"/></svg><span>{1}</span>\
                 <span class=\"value\">{2}</span></button></li>",
                class.class(),
                class.words(),
                count(class)
            );
        }
        html.push_str("</ul></figure>\n");
    }
    Ok(html)
}

/// Wrong answers next to the right ones.
pub(super) fn mistakes(mistakes: &[Mistake]) -> Result<String> {
    let mut html = String::new();
    if mistakes.is_empty() {
        return Ok(html);
    }
    html.push_str(
        "<h2>Where does it fail?</h2><p class=\"hint\">The worst mistakes: the query image, \
         an image of the true place and one of the place that was answered.</p>",
    );
    for mistake in mistakes {
        put!(
            html,
            "<article class=\"mistake\"><h3>{}</h3><div class=\"trio\">",
            Esc(&mistake.title)
        );
        gallery(&mut html, "Query", "", &mistake.query)?;
        gallery(&mut html, "\u{2713} True place", "ok", &mistake.truth)?;
        gallery(&mut html, "\u{2717} Answered", "no", &mistake.answered)?;
        html.push_str("</div></article>\n");
    }
    Ok(html)
}

fn gallery(html: &mut String, role: &str, class: &str, image: &GalleryImage) -> Result<()> {
    put!(html, "<figure><span class=\"role {class}\">{role}</span>");
    match &image.image {
        Some(pixels) => put!(
            html,
            "<img alt=\"{role}: {}\" loading=\"lazy\" width=\"{}\" height=\"{}\" src=\"{}\">",
            Esc(&image.caption),
            pixels.width(),
            pixels.height(),
            data_uri(pixels, GALLERY_WIDTH)?
        ),
        None => html.push_str("<div class=\"none\">no image to show</div>"),
    }
    put!(
        html,
        "<figcaption>{}</figcaption></figure>",
        Words(&image.caption)
    );
    Ok(())
}
