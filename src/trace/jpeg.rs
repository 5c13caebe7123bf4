//! How does a picture fit into a line of text?

use std::borrow::Cow;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::feature::GrayImage;
use fremen::error::{Error, ErrorKind, Result};

/// 0 to 100; above this a picture only grows.
const JPEG_QUALITY: u8 = 80;

/// A picture as a JPEG file; base64 in JSON.
#[derive(Clone, PartialEq, Eq)]
pub struct Jpeg(pub Vec<u8>);

impl Jpeg {
    /// Encodes a picture as a JPEG file.
    pub fn encode(picture: &GrayImage) -> Result<Self> {
        let mut bytes = Vec::new();
        let (width, height) = picture.size();
        JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
            .write_image(picture.data(), width, height, ExtendedColorType::L8)
            .map_err(|error| {
                Error::new(
                    ErrorKind::Format,
                    format!("no JPEG can be made of it: {error}"),
                )
            })?;
        Ok(Self(bytes))
    }
}

impl std::fmt::Debug for Jpeg {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Jpeg({} bytes)", self.0.len())
    }
}

impl Serialize for Jpeg {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_str(&BASE64.encode(&self.0))
    }
}

impl<'de> Deserialize<'de> for Jpeg {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let text = Cow::<str>::deserialize(deserializer)?;
        let bytes = BASE64.decode(text.as_bytes());
        bytes.map(Self).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_survives_json() {
        let picture = GrayImage::new(8, 8, (0..64).collect()).expect("pixels");
        let jpeg = Jpeg::encode(&picture).expect("encoded");
        let text = serde_json::to_string(&jpeg).expect("text");
        assert_eq!(serde_json::from_str::<Jpeg>(&text).expect("read"), jpeg);
        assert!(serde_json::from_str::<Jpeg>("\"not base64!\"").is_err());
    }
}
