//! How does text become safe HTML, and an image a part of it?

use std::fmt;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use chronotope::feature::GrayImage;
use chronotope::{Error, ErrorKind, Result};
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, ImageBuffer, Luma};

/// JPEG quality: features stay visible and a picture of 640 x 480 stays below 100 kB.
const JPEG_QUALITY: u8 = 82;

/// Appends formatted text to a `String`, which cannot fail.
macro_rules! put {
    ($text:expr, $($format:tt)*) => {{
        use std::fmt::Write as _;
        let _ = write!($text, $($format)*);
    }};
}
pub(crate) use put;

/// Shows text with the characters escaped that mean something in HTML, also within attributes.
pub(crate) struct Esc<T>(pub(crate) T);

impl<T: fmt::Display> fmt::Display for Esc<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for c in self.0.to_string().chars() {
            match c {
                '&' => f.write_str("&amp;")?,
                '<' => f.write_str("&lt;")?,
                '>' => f.write_str("&gt;")?,
                '"' => f.write_str("&quot;")?,
                '\'' => f.write_str("&#39;")?,
                c => write!(f, "{c}")?,
            }
        }
        Ok(())
    }
}

/// Text that breaks between words alone, so that neither `--out` nor a date is torn at a hyphen;
/// what is wider than the page still breaks.
pub(crate) struct Words<'a>(pub(crate) &'a str);

impl fmt::Display for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, word) in self.0.split(' ').enumerate() {
            let space = if index > 0 { " " } else { "" };
            write!(f, "{space}<span class=\"word\">{}</span>", Esc(word))?;
        }
        Ok(())
    }
}

/// A signed number of points with a real minus sign.
pub(crate) fn signed(value: f64) -> String {
    let text = format!("{value:+.1}");
    match text.as_str() {
        "+0.0" | "-0.0" => "0.0".to_owned(),
        _ => text.replace('-', "\u{2212}"),
    }
}

/// `image`, at most `max_width` columns wide, as a `data:` URI.
pub(crate) fn data_uri(image: &GrayImage, max_width: u32) -> Result<String> {
    let unfit = |what: String| Error::new(ErrorKind::Format, what);
    let (width, height) = image.size();
    if width == 0 || height == 0 {
        return Err(unfit(format!("a picture of {width} x {height} pixels")));
    }
    let mut pixels = ImageBuffer::<Luma<u8>, _>::from_raw(width, height, image.data().to_vec())
        .ok_or_else(|| unfit("a picture whose size and data differ".to_owned()))?;
    if width > max_width {
        let scaled = f64::from(height) * f64::from(max_width) / f64::from(width);
        let height = (scaled.round() as u32).max(1);
        pixels = imageops::resize(&pixels, max_width, height, FilterType::Triangle);
    }
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY)
        .encode(
            pixels.as_raw(),
            pixels.width(),
            pixels.height(),
            ExtendedColorType::L8,
        )
        .map_err(|error| unfit(error.to_string()))?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_of_the_input_is_markup() {
        let text = Esc(r#"<a href="x" id='y'>&amp;"#).to_string();
        assert_eq!(text, "&lt;a href=&quot;x&quot; id=&#39;y&#39;&gt;&amp;amp;");
    }

    #[test]
    fn numbers_carry_a_real_minus() {
        assert_eq!(
            [-3.25, 0.01, -0.01, 4.0].map(signed),
            ["\u{2212}3.2", "0.0", "0.0", "+4.0"]
        );
    }

    #[test]
    fn a_picture_is_scaled_down_and_decodes() {
        let image = GrayImage::new(40, 20, vec![90; 800]).unwrap();
        let uri = data_uri(&image, 10).unwrap();
        let bytes = STANDARD.decode(uri.split_once(',').unwrap().1).unwrap();
        let decoded = image::load_from_memory(&bytes).unwrap();
        assert_eq!((decoded.width(), decoded.height()), (10, 5));
        assert!(data_uri(&GrayImage::new(0, 0, Vec::new()).unwrap(), 10).is_err());
    }
}
