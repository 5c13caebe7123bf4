//! Which shades has the picture of a map?

use std::io::Cursor;
use std::path::Path;

use fremen::{Error, ErrorKind, Result};
use image::codecs::png::{PngDecoder, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, Limits};

/// The most bytes of a picture's file.
const MAX_BYTES: u64 = 1 << 30;
/// The most pixels of a picture.
const MAX_PIXELS: u64 = 1 << 28;

/// Grey shades with an opacity, the highest row first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Whether the file has an opacity for each pixel.
    pub(super) has_alpha: bool,
    /// `[shade, alpha]`, 0 is black, 0 is transparent.
    pub(super) pixels: Vec<[u8; 2]>,
}

impl Picture {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let bytes = fremen::file::read(path, MAX_BYTES)?;
        let picture = match bytes.as_slice() {
            [b'P', b'2' | b'5', ..] => read_pgm(&bytes),
            [0x89, b'P', b'N', b'G', ..] => read_png(&bytes),
            [b'P', b'3' | b'6', ..] => Err(coloured()),
            _ => Err(
                Error::new(ErrorKind::Format, "this is neither a PGM nor a PNG picture")
                    .with_help("save the map as PGM or PNG"),
            ),
        };
        picture.map_err(|error| error.with_path(path))
    }

    /// As binary PGM, without opacity.
    pub(super) fn to_pgm(&self) -> Vec<u8> {
        let mut bytes = format!("P5\n{} {}\n255\n", self.width, self.height).into_bytes();
        bytes.extend(self.pixels.iter().map(|it| it[0]));
        bytes
    }

    /// As grey PNG with opacity.
    pub(super) fn to_png(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let pixels: Vec<u8> = self.pixels.iter().flatten().copied().collect();
        PngEncoder::new(&mut bytes)
            .write_image(&pixels, self.width, self.height, ExtendedColorType::La8)
            .map_err(|cause| Error::new(ErrorKind::Format, cause.to_string()))?;
        Ok(bytes)
    }
}

fn coloured() -> Error {
    Error::new(ErrorKind::Format, "the picture is coloured")
        .with_help("save it in shades of grey: colours do not say what is occupied")
}

fn deep() -> Error {
    Error::new(ErrorKind::Format, "the picture has 16 bits a pixel")
        .with_help("save it with 8 bits a pixel")
}

fn size_error(width: u64, height: u64) -> Error {
    let message = format!("a picture of {width} x {height} pixels");
    Error::new(ErrorKind::Format, message).with_help(format!("maps have 1 to {MAX_PIXELS} pixels"))
}

fn check_size(width: u64, height: u64) -> Result<()> {
    match width.checked_mul(height) {
        // Neither side is longer than the product.
        Some(1..=MAX_PIXELS) => Ok(()),
        _ => Err(size_error(width, height)),
    }
}

/// The header's numbers and text samples, which may be parted by comments.
struct Tokens<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Tokens<'_> {
    fn number(&mut self, what: &str) -> Result<u64> {
        loop {
            match self.bytes.get(self.at) {
                Some(b'#') => {
                    let rest = &self.bytes[self.at..];
                    let line = rest.iter().position(|&it| it == b'\n');
                    self.at += line.unwrap_or(rest.len());
                }
                Some(it) if it.is_ascii_whitespace() => self.at += 1,
                _ => break,
            }
        }
        let rest = &self.bytes[self.at..];
        let len = rest.iter().take_while(|it| it.is_ascii_digit()).count();
        let number = std::str::from_utf8(&rest[..len])
            .ok()
            .and_then(|it| it.parse().ok());
        let at = self.at;
        self.at += len;
        number.ok_or_else(|| {
            let message = if rest.is_empty() {
                format!("the file ends before {what}")
            } else {
                format!("{what} is no number")
            };
            Error::new(ErrorKind::Format, message).with_place(format!("byte {at}"))
        })
    }
}

fn read_pgm(bytes: &[u8]) -> Result<Picture> {
    let is_text = bytes[1] == b'2';
    let mut tokens = Tokens { bytes, at: 2 };
    let width = tokens.number("the width")?;
    let height = tokens.number("the height")?;
    let max = tokens.number("the largest value")?;
    check_size(width, height)?;
    match max {
        1..=255 => {}
        256..=65_535 => return Err(deep()),
        _ => {
            let message = format!("the largest value is {max}, not 1 to 255");
            return Err(Error::new(ErrorKind::Format, message));
        }
    }
    let num_pixels = (width * height) as usize;
    let mut shades = Vec::new();
    if is_text {
        // A sample takes at least two bytes, so the file bounds the memory.
        for _ in 0..num_pixels {
            shades.push(tokens.number("all pixels")?);
        }
    } else {
        // One white space ends the header.
        let samples = bytes.get(tokens.at + 1..).unwrap_or_default();
        if samples.len() < num_pixels {
            let message = format!(
                "the file ends after {} of {width} x {height} pixels",
                samples.len()
            );
            return Err(Error::new(ErrorKind::Format, message)
                .with_help("the file was cut off: write it again"));
        }
        shades.extend(samples[..num_pixels].iter().copied().map(u64::from));
    }
    if let Some(at) = shades.iter().position(|&shade| shade > max) {
        let message = format!("a pixel of {} where {max} is the largest value", shades[at]);
        return Err(Error::new(ErrorKind::Format, message).with_place(format!("pixel {at}")));
    }
    // To 0..=255, rounded.
    let pixel = |shade: u64| [((shade * 255 + max / 2) / max) as u8, u8::MAX];
    Ok(Picture {
        width: width as u32,
        height: height as u32,
        has_alpha: false,
        pixels: shades.into_iter().map(pixel).collect(),
    })
}

fn read_png(bytes: &[u8]) -> Result<Picture> {
    let broken = |cause: image::ImageError| {
        Error::new(
            ErrorKind::Format,
            format!("the PNG cannot be decoded: {cause}"),
        )
        .with_help("the file may be cut off: write it again")
    };
    let mut limits = Limits::default();
    limits.max_alloc = Some(8 * MAX_PIXELS);
    let decoder = PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(broken)?;
    let (width, height) = decoder.dimensions();
    check_size(width.into(), height.into())?;
    if let ExtendedColorType::L16
    | ExtendedColorType::La16
    | ExtendedColorType::Rgb16
    | ExtendedColorType::Rgba16 = decoder.original_color_type()
    {
        return Err(deep());
    }
    let image = DynamicImage::from_decoder(decoder).map_err(broken)?;
    let has_alpha = image.color().has_alpha();
    let pixels = match image {
        DynamicImage::ImageLuma8(image) => image.pixels().map(|it| [it.0[0], u8::MAX]).collect(),
        DynamicImage::ImageLumaA8(image) => image.pixels().map(|it| it.0).collect(),
        // Drawing programs write grey as three equal channels.
        coloured_or_grey => {
            let image = coloured_or_grey.into_rgba8();
            let grey = |[r, g, b, a]: [u8; 4]| (r == g && g == b).then_some([r, a]);
            let pixels: Option<Vec<[u8; 2]>> = image.pixels().map(|it| grey(it.0)).collect();
            pixels.ok_or_else(coloured)?
        }
    };
    Ok(Picture {
        width,
        height,
        has_alpha,
        pixels,
    })
}
