//! How bright is a colour?
//!
//! grey = `(9798 R + 19235 G + 3735 B + 2^14) >> 15`, the weights of ITU-R BT.601 in 15 bits, as
//! OpenCV 4 and 5 take them.

/// The grey of every pixel of 8-bit BGR samples.
#[cfg(feature = "opencv")]
pub(super) fn gray_from_bgr(samples: &[u8]) -> Vec<u8> {
    let pixels = samples.as_chunks::<3>().0.iter();
    pixels.map(|p| luma(p[2], p[1], p[0])).collect()
}

/// The grey level of a colour.
pub(super) fn luma(red: u8, green: u8, blue: u8) -> u8 {
    let sum = 9_798 * u32::from(red) + 19_235 * u32::from(green) + 3_735 * u32::from(blue);
    ((sum + (1 << 14)) >> 15) as u8
}
