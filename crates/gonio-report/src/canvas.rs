//! Text and panels in pictures of linear display values.

use font8x8::UnicodeFonts;
use glam::Vec3;
use gonio::picture::Plane;

/// Colour of empty paper.
pub const PAPER: Vec3 = Vec3::new(0.012, 0.013, 0.015);
/// Colour of text.
pub const INK: Vec3 = Vec3::new(0.75, 0.75, 0.72);
/// Width and height of a letter, pixels.
pub const LETTER: usize = 8;
/// Height of a line of text, pixels.
pub const LINE: usize = 2 * LETTER;
/// Colour of the outline of an object.
pub const OUTLINE: Vec3 = Vec3::new(0.10, 0.85, 0.75);

/// Returns an empty sheet.
pub fn sheet(width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |_, _| PAPER)
}

/// Copies a picture to the given position of its top left corner; anything that does not fit is cut
/// off.
pub fn place(out: &mut Plane<Vec3>, left: usize, top: usize, picture: &Plane<Vec3>) {
    for y in 0..picture.height().min(out.height().saturating_sub(top)) {
        for x in 0..picture.width().min(out.width().saturating_sub(left)) {
            out[(left + x, top + y)] = picture[(x, y)];
        }
    }
}

/// Fills a rectangle.
pub fn fill(out: &mut Plane<Vec3>, (left, top): (usize, usize), (width, height): (usize, usize), colour: Vec3) {
    place(out, left, top, &Plane::from_fn(width, height, |_, _| colour));
}

/// Puts a picture on a sheet of at least `width`, and lines below it, each behind a square of its
/// colour.
pub fn with_legend(picture: &Plane<Vec3>, width: usize, lines: &[(Vec3, String)]) -> Plane<Vec3> {
    let mut out = sheet(picture.width().max(width), picture.height() + LETTER + lines.len() * LINE);
    place(&mut out, 0, 0, picture);
    for (n, (colour, line)) in lines.iter().enumerate() {
        let top = picture.height() + LETTER + n * LINE;
        fill(&mut out, (LETTER, top), (LETTER, LETTER), *colour);
        text(&mut out, 3 * LETTER, top, line);
    }
    out
}

/// Writes a line of text in eight by eight letters.
pub fn text(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    for (n, letter) in line.chars().enumerate() {
        let Some(rows) = font8x8::BASIC_FONTS.get(letter) else { continue };
        for (y, row) in rows.iter().enumerate() {
            for x in (0..8).filter(|x| row >> x & 1 == 1) {
                let at = (left + 8 * n + x, top + y);
                if at.0 < out.width() && at.1 < out.height() {
                    out[at] = INK;
                }
            }
        }
    }
}
