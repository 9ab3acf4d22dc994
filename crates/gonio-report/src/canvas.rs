//! Draws text and panels in pictures of linear display values, with dark colours.

use std::sync::LazyLock;

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};
use glam::Vec3;
use gonio::picture::Plane;

/// Colour of the background.
pub const PAPER: Vec3 = Vec3::new(0.0080, 0.0091, 0.0110);
/// Colour of text.
pub const INK: Vec3 = Vec3::new(0.791, 0.791, 0.768);
/// Colour of secondary text.
pub const QUIET: Vec3 = Vec3::new(0.361, 0.397, 0.440);
/// Side of a colour square in a legend, in pixels.
pub const SWATCH: usize = 12;
/// Height of a line of text, in pixels.
pub const LINE: usize = 24;
/// Font heights of text, headings and large text: pixels from descender to ascender.
const TEXT: f32 = 18.5;
const HEADING: f32 = 21.0;
const LARGE: f32 = 34.0;
/// Typeface of pictures and pages: the Latin letters of Inter (`font/OFL.txt`).
pub(crate) const REGULAR_FILE: &[u8] = include_bytes!("../font/Inter-Regular.ttf");
/// Semi-bold typeface, for headings.
pub(crate) const SEMIBOLD_FILE: &[u8] = include_bytes!("../font/Inter-SemiBold.ttf");
/// Colour of the outline of an object.
pub const OUTLINE: Vec3 = Vec3::new(0.10, 0.85, 0.75);

/// Returns an empty sheet.
pub fn sheet(width: usize, height: usize) -> Plane<Vec3> {
    Plane::from_fn(width, height, |_, _| PAPER)
}

/// Copies a picture to a position of its top left corner; parts that do not fit are cut off.
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

/// Puts a picture on a sheet of at least `width` pixels, with a legend of colours and labels below.
pub fn with_legend(picture: &Plane<Vec3>, width: usize, lines: &[(Vec3, String)]) -> Plane<Vec3> {
    let wide = lines.iter().map(|(_, line)| 3 * SWATCH + width_of(line)).max().unwrap_or(0);
    let mut out = sheet(picture.width().max(width).max(wide), picture.height() + SWATCH + lines.len() * LINE);
    place(&mut out, 0, 0, picture);
    for (n, (colour, line)) in lines.iter().enumerate() {
        legend(&mut out, SWATCH, picture.height() + SWATCH + n * LINE, *colour, line);
    }
    out
}

/// Draws a line of a legend: a colour square and its label.
pub fn legend(out: &mut Plane<Vec3>, left: usize, top: usize, colour: Vec3, line: &str) {
    fill(out, (left, top + 3), (SWATCH, SWATCH), colour);
    text(out, left + SWATCH + 8, top, line);
}

/// Height of a line of large text, in pixels.
pub const LARGE_LINE: usize = 44;

/// Writes a line of large text, for pictures that are often shown small.
pub fn large(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, LARGE, INK, line);
}

/// Writes a line of large secondary text.
pub fn large_note(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, LARGE, QUIET, line);
}

/// Writes a line of text from its top left corner; parts that do not fit are cut off.
pub fn text(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, TEXT, INK, line);
}

/// Writes a line of secondary text.
pub fn note(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &REGULAR, TEXT, QUIET, line);
}

/// Writes a heading.
pub fn heading(out: &mut Plane<Vec3>, left: usize, top: usize, line: &str) {
    write(out, (left, top), &SEMIBOLD, HEADING, INK, line);
}

/// Returns the width of a line of text, in pixels.
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
    // A baseline on whole pixels makes all lines look alike.
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
    fn draws_text_and_cuts_it_off_at_the_edges() {
        let mut out = sheet(200, LINE);
        text(&mut out, 2, 0, "Halfway θ = 80°");
        let inked = |x: usize| (0..LINE).any(|y| out[(x, y)] != PAPER);
        let last = (0..200).rev().find(|x| inked(*x)).unwrap();
        assert!(last.abs_diff(2 + width_of("Halfway θ = 80°")) < 4, "{last}");
        assert!((0..20).any(inked) && out.as_slice().iter().any(|p| p.x > 0.7));
        text(&mut sheet(3, 3), 2, 2, "cut off");
    }

    #[test]
    fn typefaces_contain_all_used_characters() {
        for letter in "ABCxyz0123456789 %°²·×±≈–—’“”äéñ→αθφ()[]|;:,./".chars() {
            for face in [&*REGULAR, &*SEMIBOLD] {
                assert_ne!(face.glyph_id(letter).0, 0, "{letter:?}");
            }
        }
    }
}
