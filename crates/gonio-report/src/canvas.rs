//! Text and panels in pictures of linear display values, in the colours of a page on a dark screen.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use glam::Vec3;
use gonio::picture::Plane;

/// Colour of empty paper.
pub const PAPER: Vec3 = Vec3::new(0.0080, 0.0091, 0.0110);
/// Colour of text.
pub const INK: Vec3 = Vec3::new(0.791, 0.791, 0.768);
/// Colour of text that explains.
pub const QUIET: Vec3 = Vec3::new(0.361, 0.397, 0.440);
/// Side of the square of colour in a legend, pixels.
pub const SWATCH: usize = 12;
/// Height of a line of text, pixels.
pub const LINE: usize = 24;
/// Height of the letters of text and of headings, pixels from the deepest to the highest.
const TEXT: f32 = 18.5;
const HEADING: f32 = 21.0;
const LARGE: f32 = 34.0;
/// The typeface of pictures and pages: Inter, its Latin letters (`font/OFL.txt`).
pub(crate) const REGULAR_FILE: &[u8] = include_bytes!("../font/Inter-Regular.ttf");
/// Its heavier sister, for headings.
pub(crate) const SEMIBOLD_FILE: &[u8] = include_bytes!("../font/Inter-SemiBold.ttf");
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
    let wide = lines.iter().map(|(_, line)| 3 * SWATCH + width_of(line)).max().unwrap_or(0);
    let mut out = sheet(picture.width().max(width).max(wide), picture.height() + SWATCH + lines.len() * LINE);
    place(&mut out, 0, 0, picture);
    for (n, (colour, line)) in lines.iter().enumerate() {
        legend(&mut out, SWATCH, picture.height() + SWATCH + n * LINE, *colour, line);
    }
    out
}

/// Draws a line of a legend: a square of colour and what it means.
pub fn legend(out: &mut Plane<Vec3>, left: usize, top: usize, colour: Vec3, line: &str) {
    fill(out, (left, top + 3), (SWATCH, SWATCH), colour);
    text(out, left + SWATCH + 8, top, line);
}

/// Height of a line of large text, pixels.
pub const LARGE_LINE: usize = 44;

/// Writes a line of large text, for pictures that are often shown small.
pub fn large(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, LARGE, INK, line);
}

/// Writes a line of large text that explains.
pub fn large_note(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, LARGE, QUIET, line);
}

/// Width of a line of large text, pixels.
pub fn large_width_of(line: &str) -> usize {
    width(LARGE, line)
}

/// Writes a line of text from its top left corner; what does not fit is cut off.
pub fn text(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, TEXT, INK, line);
}

/// Writes a line of text that explains.
pub fn note(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, TEXT, QUIET, line);
}

/// Writes a heading.
pub fn heading(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &SEMIBOLD, HEADING, INK, line);
}

/// Width of a line of text, pixels.
pub fn width_of(line: &str) -> usize {
    width(TEXT, line)
}

fn width(size: f32, line: &str) -> usize {
    let font = REGULAR.as_scaled(PxScale::from(size));
    line.chars().map(|letter| font.h_advance(font.glyph_id(letter))).sum::<f32>().ceil() as usize
}

static REGULAR: LazyLock<FontRef<'static>> = LazyLock::new(|| face(REGULAR_FILE));
static SEMIBOLD: LazyLock<FontRef<'static>> = LazyLock::new(|| face(SEMIBOLD_FILE));

fn face(file: &'static [u8]) -> FontRef<'static> {
    FontRef::try_from_slice(file).expect("the embedded typeface is a font")
}

fn write(out: &mut Plane<Vec3>, (left, top): (usize, usize), face: &FontRef<'_>, size: f32, colour: Vec3, line: &str) {
    let font = face.as_scaled(PxScale::from(size));
    // On whole pixels: lines of text that belong together look alike.
    let baseline = top as f32 + font.ascent().round() - 1.0;
    let mut x = left as f32;
    for letter in line.chars() {
        let id = font.glyph_id(letter);
        if let Some(outline) = font.outline_glyph(id.with_scale_and_position(size, point(x, baseline))) {
            let corner = outline.px_bounds().min;
            outline.draw(|u, v, cover| {
                let at = (corner.x + u as f32, corner.y + v as f32);
                if at.0 >= 0.0 && at.1 >= 0.0 && (at.0 as usize) < out.width() && (at.1 as usize) < out.height() {
                    let pixel = &mut out[(at.0 as usize, at.1 as usize)];
                    *pixel = pixel.lerp(colour, cover.clamp(0.0, 1.0));
                }
            });
        }
        x += font.h_advance(id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_drawn_where_they_fit() {
        let mut out = sheet(200, LINE);
        text(&mut out, 2, 0, "Halfway θ = 80°");
        let inked = |x: usize| (0..LINE).any(|y| out[(x, y)] != PAPER);
        let last = (0..200).rev().find(|x| inked(*x)).unwrap();
        assert!(last.abs_diff(2 + width_of("Halfway θ = 80°")) < 4, "{last}");
        assert!((0..20).any(inked) && out.as_slice().iter().any(|p| p.x > 0.7));
        text(&mut sheet(3, 3), 2, 2, "cut off");
    }

    #[test]
    fn the_typeface_has_what_is_written() {
        for letter in "ABCxyz0123456789 %°²·×±≈–—’“”äéñ→αθφ()[]|;:,./".chars() {
            for face in [&*REGULAR, &*SEMIBOLD] {
                assert_ne!(face.glyph_id(letter).0, 0, "{letter:?}");
            }
        }
    }
}
