//! How is a line of text written into a picture, without a font of the system?
//!
//! Capital letters, digits and a few signs of 5 x 7 px, each a row of bits from the top; what there
//! is none for becomes a question mark.

/// Pixels of a sign, and from one to the next.
const WIDTH_PX: usize = 5;
const HEIGHT_PX: usize = 7;
const ADVANCE_PX: usize = WIDTH_PX + 1;
/// Of a line with its margin.
pub(crate) const LINE_PX: usize = HEIGHT_PX + 4;

type Rows = [u8; HEIGHT_PX];

#[rustfmt::skip]
const SIGNS: [(char, Rows); 51] = [
    (' ', [0, 0, 0, 0, 0, 0, 0]),
    ('A', [0b01110, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001]),
    ('B', [0b11110, 0b10001, 0b10001, 0b11110, 0b10001, 0b10001, 0b11110]),
    ('C', [0b01110, 0b10001, 0b10000, 0b10000, 0b10000, 0b10001, 0b01110]),
    ('D', [0b11110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b11110]),
    ('E', [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b11111]),
    ('F', [0b11111, 0b10000, 0b10000, 0b11110, 0b10000, 0b10000, 0b10000]),
    ('G', [0b01110, 0b10001, 0b10000, 0b10111, 0b10001, 0b10001, 0b01111]),
    ('H', [0b10001, 0b10001, 0b10001, 0b11111, 0b10001, 0b10001, 0b10001]),
    ('I', [0b01110, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110]),
    ('J', [0b00111, 0b00010, 0b00010, 0b00010, 0b00010, 0b10010, 0b01100]),
    ('K', [0b10001, 0b10010, 0b10100, 0b11000, 0b10100, 0b10010, 0b10001]),
    ('L', [0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b10000, 0b11111]),
    ('M', [0b10001, 0b11011, 0b10101, 0b10101, 0b10001, 0b10001, 0b10001]),
    ('N', [0b10001, 0b11001, 0b10101, 0b10101, 0b10011, 0b10001, 0b10001]),
    ('O', [0b01110, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110]),
    ('P', [0b11110, 0b10001, 0b10001, 0b11110, 0b10000, 0b10000, 0b10000]),
    ('Q', [0b01110, 0b10001, 0b10001, 0b10001, 0b10101, 0b10010, 0b01101]),
    ('R', [0b11110, 0b10001, 0b10001, 0b11110, 0b10100, 0b10010, 0b10001]),
    ('S', [0b01111, 0b10000, 0b10000, 0b01110, 0b00001, 0b00001, 0b11110]),
    ('T', [0b11111, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100, 0b00100]),
    ('U', [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01110]),
    ('V', [0b10001, 0b10001, 0b10001, 0b10001, 0b10001, 0b01010, 0b00100]),
    ('W', [0b10001, 0b10001, 0b10001, 0b10101, 0b10101, 0b11011, 0b10001]),
    ('X', [0b10001, 0b10001, 0b01010, 0b00100, 0b01010, 0b10001, 0b10001]),
    ('Y', [0b10001, 0b10001, 0b01010, 0b00100, 0b00100, 0b00100, 0b00100]),
    ('Z', [0b11111, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b11111]),
    ('0', [0b01110, 0b10001, 0b10011, 0b10101, 0b11001, 0b10001, 0b01110]),
    ('1', [0b00100, 0b01100, 0b00100, 0b00100, 0b00100, 0b00100, 0b01110]),
    ('2', [0b01110, 0b10001, 0b00001, 0b00110, 0b01000, 0b10000, 0b11111]),
    ('3', [0b11110, 0b00001, 0b00001, 0b01110, 0b00001, 0b00001, 0b11110]),
    ('4', [0b00010, 0b00110, 0b01010, 0b10010, 0b11111, 0b00010, 0b00010]),
    ('5', [0b11111, 0b10000, 0b11110, 0b00001, 0b00001, 0b10001, 0b01110]),
    ('6', [0b01110, 0b10000, 0b10000, 0b11110, 0b10001, 0b10001, 0b01110]),
    ('7', [0b11111, 0b00001, 0b00010, 0b00100, 0b00100, 0b01000, 0b01000]),
    ('8', [0b01110, 0b10001, 0b10001, 0b01110, 0b10001, 0b10001, 0b01110]),
    ('9', [0b01110, 0b10001, 0b10001, 0b01111, 0b00001, 0b00001, 0b01110]),
    ('.', [0, 0, 0, 0, 0, 0b00110, 0b00110]),
    (',', [0, 0, 0, 0, 0b00110, 0b00110, 0b01100]),
    (':', [0, 0b00110, 0b00110, 0, 0b00110, 0b00110, 0]),
    ('-', [0, 0, 0, 0b11111, 0, 0, 0]),
    ('_', [0, 0, 0, 0, 0, 0, 0b11111]),
    ('+', [0, 0b00100, 0b00100, 0b11111, 0b00100, 0b00100, 0]),
    ('=', [0, 0, 0b11111, 0, 0b11111, 0, 0]),
    ('/', [0b00001, 0b00001, 0b00010, 0b00100, 0b01000, 0b10000, 0b10000]),
    ('%', [0b11001, 0b11001, 0b00010, 0b00100, 0b01000, 0b10011, 0b10011]),
    ('@', [0b01110, 0b10001, 0b10111, 0b10101, 0b10111, 0b10000, 0b01110]),
    ('#', [0b01010, 0b01010, 0b11111, 0b01010, 0b11111, 0b01010, 0b01010]),
    ('(', [0b00010, 0b00100, 0b01000, 0b01000, 0b01000, 0b00100, 0b00010]),
    (')', [0b01000, 0b00100, 0b00010, 0b00010, 0b00010, 0b00100, 0b01000]),
    ('?', [0b01110, 0b10001, 0b00001, 0b00110, 0b00100, 0, 0b00100]),
];

fn rows_of(letter: char) -> Rows {
    let large = letter.to_ascii_uppercase();
    let find = |wanted| SIGNS.iter().find(|it| it.0 == wanted).map(|it| it.1);
    find(large).or_else(|| find('?')).unwrap_or_default()
}

/// How wide a text is, px.
pub(crate) fn width_px(text: &str) -> usize {
    ADVANCE_PX * text.chars().count()
}

/// Calls `dot` for each pixel of a text: how far it lies to the right and down.
pub(crate) fn write(text: &str, mut dot: impl FnMut(usize, usize)) {
    for (number, letter) in text.chars().enumerate() {
        for (y, row) in rows_of(letter).into_iter().enumerate() {
            for x in 0..WIDTH_PX {
                if row >> (WIDTH_PX - 1 - x) & 1 == 1 {
                    dot(number * ADVANCE_PX + x, y);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_sign_is_another_one_and_fits_into_its_box() {
        let shapes: BTreeSet<Rows> = SIGNS.iter().map(|it| it.1).collect();
        assert_eq!(shapes.len(), SIGNS.len());
        for (letter, rows) in SIGNS {
            assert!(rows.iter().all(|row| row >> WIDTH_PX == 0), "{letter}");
        }
        assert_eq!(rows_of('a'), rows_of('A'));
        assert_eq!(rows_of('\u{17e}'), rows_of('?'));
    }

    #[test]
    fn a_text_is_drawn_from_left_to_right() {
        let mut dots = BTreeSet::new();
        write("-1", |x, y| assert!(dots.insert((x, y))));
        assert!((0..5).all(|x| dots.contains(&(x, 3))));
        assert!(dots.contains(&(ADVANCE_PX + 2, 0)));
        assert!(
            dots.iter()
                .all(|&(x, y)| x < width_px("-1") && y < HEIGHT_PX)
        );
    }
}
