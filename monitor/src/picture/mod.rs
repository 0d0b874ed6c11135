//! Pictures of worlds: a [`Scene`] with a text below becomes an SVG, pixels, a film or letters in a terminal.

mod gif;
mod terminal;
mod wrap;

use std::path::Path;

use envs::scene::{Colour, Scene, Shape};

pub use self::gif::write_gif;
pub use self::terminal::{terminal_text, Colours, Terminal};
pub use self::wrap::wrap;
use crate::svg::{Anchor, Stroke, Svg};
use crate::Error;

/// The longest side of a picture in pixels. Far more than a screen has, and still drawn in seconds.
const MAX_SIDE: f64 = 8192.0;
/// Line height, in heights of a letter.
const LINE: f64 = 1.4;
/// Width of a letter of [`Svg::even_text`], in heights.
const LETTER: f64 = 0.602;

/// A scene with the text below it.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    pub scene: Scene,
    /// Text below the picture, after the caption of the scene. Long lines are wrapped.
    pub lines: Vec<String>,
    /// Whether this is the end of an episode, which films show longer.
    pub outcome: bool,
}

impl Frame {
    /// A picture with only the scene and its caption.
    pub fn new(scene: Scene) -> Self {
        Self { scene, lines: Vec::new(), outcome: false }
    }

    /// The text below the picture, wrapped to `columns` letters.
    fn text(&self, columns: usize) -> Vec<String> {
        let said = std::iter::once(&self.scene.caption).chain(&self.lines);
        said.flat_map(|line| wrap(line, columns)).collect()
    }
}

/// A picture in pixels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pixels {
    pub width: u32,
    pub height: u32,
    /// Row by row from the upper left; `width * height` of them.
    pub colours: Vec<Colour>,
}

/// The picture as an SVG document, `width` pixels wide.
///
/// # Errors
/// [`Error::Scene`] if the scene has no area, or the picture would be too large.
pub fn svg(frame: &Frame, width: u32) -> Result<String, Error> {
    Ok(Sheet::new(width, std::slice::from_ref(frame))?.draw(frame).document())
}

/// The picture in pixels, `width` of them wide.
///
/// # Errors
/// As [`svg`].
pub fn pixels(frame: &Frame, width: u32) -> Result<Pixels, Error> {
    rasterise(&Sheet::new(width, std::slice::from_ref(frame))?.draw(frame))
}

/// Writes one picture, `.png` or `.svg` as the name of `out` says. Missing folders are made.
///
/// # Errors
/// As [`svg`]; and [`Error::Extension`] for another kind of file, [`Error::Write`].
pub fn write_still(frame: &Frame, width: u32, out: &Path) -> Result<(), Error> {
    Sheet::new(width, std::slice::from_ref(frame))?.draw(frame).save(out)
}

fn rasterise(svg: &Svg) -> Result<Pixels, Error> {
    let pixmap = svg.rasterise().map_err(Error::Scene)?;
    let colours = pixmap.pixels().iter().map(|p| Colour(p.red(), p.green(), p.blue())).collect();
    Ok(Pixels { width: pixmap.width(), height: pixmap.height(), colours })
}

/// The layout of a picture, in pixels: the scene with a margin around it, and a strip of text below.
struct Sheet {
    width: u32,
    height: u32,
    margin: f64,
    /// Room for the scene, without the margin.
    room: (f64, f64),
    /// Height of the letters below, and how many fit on a line.
    letters: f64,
    columns: usize,
}

impl Sheet {
    /// For a series of pictures of this width: the first decides the shape, the one with most text the height of the
    /// strip.
    fn new(width: u32, frames: &[Frame]) -> Result<Self, Error> {
        let Some(first) = frames.first() else {
            return Err(Error::Empty("there are no pictures".to_owned()));
        };
        let across = f64::from(width);
        let margin = (across / 40.0).floor();
        let letters = (across / 28.0).clamp(9.0, 16.0);
        let columns = ((across - 2.0 * margin) / (LETTER * letters)).max(1.0) as usize;
        let lines = frames.iter().map(|frame| frame.text(columns).len()).max().unwrap_or(0);
        let room = across - 2.0 * margin;
        let room = (room, room * ratio(&first.scene)?);
        let strip = if lines > 0 { (lines as f64 * LINE + 0.6) * letters } else { 0.0 };
        let height = (room.1 + 2.0 * margin + strip).ceil();
        check_side("wide", across)?;
        check_side("high", height)?;
        Ok(Self { width, height: height as u32, margin, room, letters, columns })
    }

    fn draw(&self, frame: &Frame) -> Svg {
        let mut svg = Svg::new(self.width, self.height);
        let (width, strip) = (f64::from(self.width), self.room.1 + 2.0 * self.margin);
        svg.rect((0.0, 0.0), (width, strip), &hex(frame.scene.background), 1.0);
        draw_scene(&mut svg, &frame.scene, (self.margin, self.margin), self.room);
        let first = strip + LINE * self.letters;
        for (k, line) in frame.text(self.columns).iter().enumerate() {
            let at = (self.margin, first + k as f64 * LINE * self.letters);
            svg.even_text(at, self.letters, &hex(Colour::INK), line);
        }
        svg
    }
}

/// Height over width.
fn ratio(scene: &Scene) -> Result<f64, Error> {
    let Scene { width, height, .. } = scene;
    let sound = |side: &f64| side.is_finite() && *side > 0.0;
    if !sound(width) || !sound(height) {
        return Err(Error::Scene(format!("expected a scene with an area, found {width} x {height}")));
    }
    Ok(height / width)
}

fn check_side(direction: &str, pixels: f64) -> Result<(), Error> {
    if (1.0..=MAX_SIDE).contains(&pixels) {
        return Ok(());
    }
    Err(Error::Scene(format!("a picture can be 1 to {MAX_SIDE} pixels {direction}, not {pixels}")))
}

/// Draws the shapes as large as fits `room`, in its middle. Parts outside of the scene are cut off.
fn draw_scene(svg: &mut Svg, scene: &Scene, corner: (f64, f64), room: (f64, f64)) {
    let scale = (room.0 / scene.width).min(room.1 / scene.height);
    let size = (scene.width * scale, scene.height * scale);
    let corner = (corner.0 + (room.0 - size.0) / 2.0, corner.1 + (room.1 - size.1) / 2.0);
    let place = |x: f64, y: f64| (corner.0 + x * scale, corner.1 + y * scale);
    svg.clipped("scene", corner, size, |svg| {
        for shape in &scene.shapes {
            match shape {
                Shape::Rectangle { x, y, width, height, fill } => {
                    svg.rect(place(*x, *y), (width * scale, height * scale), &hex(*fill), 1.0);
                }
                Shape::Circle { x, y, radius, fill } => {
                    svg.circle(place(*x, *y), radius * scale, &hex(*fill));
                }
                Shape::Line { from, to, width, colour } => {
                    let stroke = Stroke { colour: &hex(*colour), width: width * scale, dashes: "" };
                    svg.line(place(from.0, from.1), place(to.0, to.1), stroke);
                }
                Shape::Polygon { corners, fill } => {
                    let corners: Vec<_> = corners.iter().map(|&(x, y)| place(x, y)).collect();
                    svg.polygon(&corners, &hex(*fill), 1.0);
                }
                Shape::Text { x, y, size, text, colour } => {
                    // Digits and capitals of the font are 0.73 of its size high.
                    let base = place(*x, y + 0.365 * size);
                    svg.text(base, size * scale, &hex(*colour), Anchor::Middle, text);
                }
            }
        }
    });
}

fn hex(Colour(red, green, blue): Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// How different two colours are.
fn distance(a: Colour, b: Colour) -> u32 {
    let square = |a: u8, b: u8| u32::from(a.abs_diff(b)).pow(2);
    square(a.0, b.0) + square(a.1, b.1) + square(a.2, b.2)
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const RED: Colour = Colour(200, 0, 0);
    pub(super) const GREEN: Colour = Colour(0, 160, 0);
    pub(super) const BLUE: Colour = Colour(0, 0, 220);

    /// Red and green above, blue and the white background below.
    pub(super) fn quarters() -> Scene {
        let quarter = |x, y, fill| Shape::Rectangle { x, y, width: 1.0, height: 1.0, fill };
        let shapes = vec![quarter(0.0, 0.0, RED), quarter(1.0, 0.0, GREEN), quarter(0.0, 1.0, BLUE)];
        Scene { width: 2.0, height: 2.0, background: Colour::WHITE, shapes, caption: String::new() }
    }

    fn at(pixels: &Pixels, x: u32, y: u32) -> Colour {
        pixels.colours[(y * pixels.width + x) as usize]
    }

    #[test]
    fn shapes_are_where_the_scene_has_them_inside_a_margin() {
        // A margin of 2 pixels, quarters of 38.
        let pixels = pixels(&Frame::new(quarters()), 80).unwrap();
        assert_eq!((pixels.width, pixels.height, pixels.colours.len()), (80, 80, 6400));
        for (x, y, expected) in [
            (1, 40, Colour::WHITE),
            (2, 2, RED),
            (39, 39, RED),
            (40, 39, GREEN),
            (77, 2, GREEN),
            (78, 2, Colour::WHITE),
            (2, 40, BLUE),
            (39, 77, BLUE),
            (40, 40, Colour::WHITE),
            (2, 78, Colour::WHITE),
        ] {
            assert_eq!(at(&pixels, x, y), expected, "{x}, {y}");
        }
    }

    #[test]
    fn all_shapes_are_drawn_and_later_ones_cover_earlier_ones() {
        let mut scene = quarters();
        scene.shapes.extend([
            Shape::Circle { x: 1.5, y: 0.5, radius: 0.4, fill: BLUE },
            Shape::Line { from: (1.0, 1.5), to: (2.0, 1.5), width: 0.5, colour: RED },
            Shape::Polygon { corners: vec![(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], fill: GREEN },
            Shape::Text { x: 0.5, y: 1.5, size: 1.0, text: "-".to_owned(), colour: RED },
            Shape::Circle { x: 2.0, y: 2.0, radius: 0.2, fill: GREEN },
        ]);
        let pixels = pixels(&Frame::new(scene), 80).unwrap();
        assert_eq!(at(&pixels, 59, 21), BLUE, "circle");
        assert_eq!(at(&pixels, 41, 3), GREEN, "beside the circle");
        assert_eq!(at(&pixels, 50, 59), RED, "line");
        assert_eq!((at(&pixels, 10, 10), at(&pixels, 35, 35)), (GREEN, RED), "polygon");
        let dash = (15..27).flat_map(|x| (50..70).map(move |y| (x, y)));
        assert!(dash.into_iter().any(|(x, y)| at(&pixels, x, y) == RED), "text");
        assert_eq!((at(&pixels, 76, 76), at(&pixels, 78, 76)), (GREEN, Colour::WHITE), "cut off at the edge");
    }

    #[test]
    fn what_is_said_stands_in_a_strip_below_and_cannot_break_the_document() {
        let mut frame = Frame::new(quarters());
        frame.scene.caption = "a < b & c".to_owned();
        frame.lines = vec!["return 0.50".to_owned(), String::new()];
        let document = svg(&frame, 280).unwrap();
        assert!(document.contains(">a &lt; b &amp; c</text>"), "{document}");
        assert!(document.contains(">return 0.50</text>"), "{document}");
        // 280 for the scene; letters of 10 on two lines of 14, and 6 to the lower edge.
        let pixels = pixels(&frame, 280).unwrap();
        assert_eq!((pixels.width, pixels.height), (280, 314));
        let strip = |rows: std::ops::Range<u32>| rows.flat_map(|y| (0..280).map(move |x| (x, y)));
        assert!(strip(280..314).any(|(x, y)| at(&pixels, x, y) != Colour::WHITE));
        assert!(strip(309..314).all(|(x, y)| at(&pixels, x, y) == Colour::WHITE));
    }

    #[test]
    fn pictures_without_area_or_end_are_refused() {
        let said = |frame: &Frame, width| pixels(frame, width).unwrap_err().to_string();
        let mut frame = Frame::new(quarters());
        assert_eq!(said(&frame, 0), "cannot draw the world: a picture can be 1 to 8192 pixels wide, not 0");
        assert_eq!(
            said(&frame, 9000),
            "cannot draw the world: a picture can be 1 to 8192 pixels wide, not 9000"
        );
        frame.scene.height = 2000.0;
        assert_eq!(
            said(&frame, 40),
            "cannot draw the world: a picture can be 1 to 8192 pixels high, not 38002"
        );
        frame.scene.height = f64::NAN;
        assert_eq!(said(&frame, 40), "cannot draw the world: expected a scene with an area, found 2 x NaN");
    }

    #[test]
    fn a_still_is_a_png_or_an_svg_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let frame = Frame::new(quarters());
        let out = folder.path().join("new/world.png");
        write_still(&frame, 80, &out).unwrap();
        assert_eq!(std::fs::read(&out).unwrap()[..8], *b"\x89PNG\r\n\x1a\n");
        let out = folder.path().join("world.svg");
        write_still(&frame, 80, &out).unwrap();
        assert_eq!(std::fs::read_to_string(&out).unwrap(), svg(&frame, 80).unwrap());
        assert!(matches!(write_still(&frame, 80, Path::new("world.gif")), Err(Error::Extension { .. })));
    }
}
