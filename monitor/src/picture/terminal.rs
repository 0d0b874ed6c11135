//! Worlds in a terminal: two pixels per letter (an upper half block), texts of the scene as letters, and the text
//! below.

use std::io::{self, Write};

use envs::scene::{Colour, Scene, Shape};

use super::{distance, draw_scene, rasterise, ratio, Frame, Pixels};
use crate::svg::Svg;
use crate::Error;

const HIDE_CURSOR: &str = "\x1b[?25l";
const SHOW_CURSOR: &str = "\x1b[?25h";
const CLEAR_SCREEN: &str = "\x1b[2J";
const HOME: &str = "\x1b[H";
const CLEAR_TO_END_OF_LINE: &str = "\x1b[K";
const CLEAR_BELOW: &str = "\x1b[J";
const PLAIN: &str = "\x1b[0m";

/// Texts of less height in pixels are omitted: as letters they would be far too large.
const SMALLEST_TEXT: f64 = 0.8;
/// Share of its size that a scene may lose so that cells are whole pixels.
const WHOLE_PIXELS: f64 = 0.8;

/// The colours that a terminal supports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colours {
    /// 24 bits.
    All,
    /// The 6x6x6 cube and the greys of xterm's palette.
    Palette256,
}

impl Colours {
    /// From the environment variable `COLORTERM`.
    pub fn of(colorterm: Option<&str>) -> Self {
        match colorterm {
            Some("truecolor" | "24bit") => Colours::All,
            _ => Colours::Palette256,
        }
    }

    /// The end of an escape sequence that chooses a colour.
    fn code(self, Colour(red, green, blue): Colour) -> String {
        match self {
            Colours::All => format!("2;{red};{green};{blue}"),
            Colours::Palette256 => format!("5;{}", xterm(Colour(red, green, blue))),
        }
    }
}

/// A picture as lines of at most `columns - 1` letters (a full line would wrap in some terminals), at most
/// `rows - 1` of them, each ending with a line feed.
///
/// # Errors
/// [`Error::Scene`] if the scene has no area.
pub fn terminal_text(frame: &Frame, columns: u16, rows: u16, colours: Colours) -> Result<String, Error> {
    let text_rows = frame.text(usize::from(columns.max(2)) - 1).len();
    Ok(lines(frame, columns, rows, text_rows, colours)?.iter().map(|line| format!("{line}\n")).collect())
}

/// Shows a series of pictures in the same place. Hides the cursor and restores it when dropped.
pub struct Terminal<W: Write> {
    out: W,
    columns: u16,
    rows: u16,
    colours: Colours,
    begun: bool,
    /// Most lines of text so far: the scene keeps its place if the text changes.
    text_rows: usize,
}

impl<W: Write> Terminal<W> {
    /// For a terminal of that size in letters.
    pub fn new(out: W, columns: u16, rows: u16, colours: Colours) -> Self {
        Self { out, columns, rows, colours, begun: false, text_rows: 0 }
    }

    /// Shows `frame` in place of the one before.
    ///
    /// # Errors
    /// [`Error::Scene`] if the scene has no area, [`Error::Terminal`].
    pub fn show(&mut self, frame: &Frame) -> Result<(), Error> {
        let said = frame.text(usize::from(self.columns.max(2)) - 1).len();
        self.text_rows = self.text_rows.max(said);
        let lines = lines(frame, self.columns, self.rows, self.text_rows, self.colours)?;
        let mut screen = String::new();
        if !self.begun {
            screen += HIDE_CURSOR;
            screen += CLEAR_SCREEN;
        }
        screen += HOME;
        for line in lines {
            screen += &line;
            screen += CLEAR_TO_END_OF_LINE;
            screen += "\r\n";
        }
        screen += CLEAR_BELOW;
        self.begun = true;
        // In one write, so that no incomplete picture is visible.
        self.write(&screen).map_err(Error::Terminal)
    }

    fn write(&mut self, text: &str) -> io::Result<()> {
        self.out.write_all(text.as_bytes())?;
        self.out.flush()
    }
}

impl<W: Write> Drop for Terminal<W> {
    fn drop(&mut self) {
        if self.begun {
            // The terminal may be gone.
            let _ = self.write(&format!("{PLAIN}{SHOW_CURSOR}"));
        }
    }
}

/// The scene, then the text, for which `text_rows` are reserved: at most half of the terminal.
fn lines(
    frame: &Frame,
    columns: u16,
    rows: u16,
    text_rows: usize,
    colours: Colours,
) -> Result<Vec<String>, Error> {
    let (columns, rows) = (usize::from(columns.max(2)) - 1, usize::from(rows.max(3)) - 1);
    let text_rows = text_rows.min(rows / 2);
    let scale = scale(&frame.scene, columns, 2 * (rows - text_rows))?;
    let (pixels, labels) = drawn(&frame.scene, scale)?;
    let mut lines = half_blocks(&pixels, &labels, colours);
    lines.extend(frame.text(columns).into_iter().take(text_rows));
    Ok(lines)
}

/// Pixels for a unit of the scene. With whole pixels, all cells of a grid are alike.
fn scale(scene: &Scene, width: usize, height: usize) -> Result<f64, Error> {
    ratio(scene)?;
    let scale = (width as f64 / scene.width).min(height as f64 / scene.height);
    let grid = scene.width.fract() == 0.0 && scene.height.fract() == 0.0;
    Ok(if grid && scale.floor() >= WHOLE_PIXELS * scale { scale.floor() } else { scale })
}

/// A letter over the pixels.
#[derive(Debug, Clone, Copy)]
struct Label {
    column: usize,
    row: usize,
    letter: char,
    colour: Colour,
}

/// The scene without its texts as pixels, and the texts as letters.
fn drawn(scene: &Scene, scale: f64) -> Result<(Pixels, Vec<Label>), Error> {
    let side = |length: f64| (length * scale).round().max(1.0);
    let size = (side(scene.width), side(scene.height));
    let mut svg = Svg::new(size.0 as u32, size.1 as u32);
    let hidden = |shape: &Shape| matches!(shape, Shape::Text { .. });
    let shapes = scene.shapes.iter().filter(|shape| !hidden(shape)).cloned().collect();
    svg.rect((0.0, 0.0), size, &super::hex(scene.background), 1.0);
    draw_scene(&mut svg, &Scene { shapes, ..scene.clone() }, (0.0, 0.0), size);

    // From the last text to the first. A text over another one hides all of it, so that letters of two texts do not
    // mix.
    let mut labels: Vec<Label> = Vec::new();
    for (k, shape) in scene.shapes.iter().enumerate().rev() {
        let Shape::Text { x, y, size, text, colour } = shape else { continue };
        let covered = scene.shapes[k + 1..].iter().any(|later| covers(later, *x, *y));
        if covered || size * scale < SMALLEST_TEXT {
            continue;
        }
        let first = (x * scale - text.chars().count() as f64 / 2.0).round() as i64;
        let row = (y * scale / 2.0).floor() as i64;
        let place = |column| (usize::try_from(row).ok(), usize::try_from(column).ok());
        let letters = (first..).zip(text.chars()).filter_map(|(column, letter)| match place(column) {
            (Some(row), Some(column)) => Some(Label { column, row, letter, colour: *colour }),
            _ => None,
        });
        let letters: Vec<Label> = letters.filter(|label| !label.letter.is_control()).collect();
        let taken =
            |label: &Label| labels.iter().any(|other| (other.row, other.column) == (label.row, label.column));
        if !letters.iter().any(taken) {
            labels.extend(letters);
        }
    }
    Ok((rasterise(&svg)?, labels))
}

/// Whether an area is painted over this place.
fn covers(shape: &Shape, x: f64, y: f64) -> bool {
    match shape {
        Shape::Rectangle { x: left, y: top, width, height, .. } => {
            (*left..left + width).contains(&x) && (*top..top + height).contains(&y)
        }
        Shape::Circle { x: cx, y: cy, radius, .. } => (x - cx).hypot(y - cy) < *radius,
        Shape::Polygon { corners, .. } => {
            // Inside is where a line to the far right crosses an odd number of sides.
            let ends = corners.iter().zip(corners.iter().cycle().skip(1));
            let crossed = |(&(ax, ay), &(bx, by)): (&(f64, f64), &(f64, f64))| {
                (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax)
            };
            ends.filter(|&side| crossed(side)).count() % 2 == 1
        }
        Shape::Line { .. } | Shape::Text { .. } => false,
    }
}

/// Lines of upper half blocks: each letter's colour is the upper pixel, its background the lower one.
fn half_blocks(pixels: &Pixels, labels: &[Label], colours: Colours) -> Vec<String> {
    let rows: Vec<&[Colour]> = pixels.colours.chunks(pixels.width as usize).collect();
    let line = |(row, pair): (usize, &[&[Colour]])| {
        let mut line = String::new();
        let mut chosen = String::new();
        for (column, &upper) in pair[0].iter().enumerate() {
            let lower = pair.get(1).map(|lower| lower[column]);
            let label = labels.iter().find(|label| (label.row, label.column) == (row, column));
            let (letter, front, back) = match label {
                Some(label) => (label.letter, label.colour, Some(clearer(label.colour, upper, lower))),
                None => ('▀', upper, lower),
            };
            // Below the last pixel of an odd height is the terminal's own background.
            let back = back.map_or("49".to_owned(), |back| format!("48;{}", colours.code(back)));
            let choice = format!("\x1b[38;{};{back}m", colours.code(front));
            if choice != chosen {
                line += &choice;
                chosen = choice;
            }
            line.push(letter);
        }
        line + PLAIN
    };
    rows.chunks(2).enumerate().map(line).collect()
}

/// The pixel behind a letter with the best contrast.
fn clearer(letter: Colour, upper: Colour, lower: Option<Colour>) -> Colour {
    match lower {
        Some(lower) if distance(letter, lower) > distance(letter, upper) => lower,
        _ => upper,
    }
}

/// The number of xterm's colour that is nearest: 16 to 231 are a cube, 232 to 255 greys.
fn xterm(colour: Colour) -> u8 {
    const STEPS: [u8; 6] = [0, 95, 135, 175, 215, 255];
    let step = |value: u8| (0..6).min_by_key(|&k| STEPS[k].abs_diff(value)).expect("there are six steps");
    let (red, green, blue) = (step(colour.0), step(colour.1), step(colour.2));
    let of_cube = Colour(STEPS[red], STEPS[green], STEPS[blue]);
    let grey = |k: u8| Colour(8 + 10 * k, 8 + 10 * k, 8 + 10 * k);
    let k = (0..24).min_by_key(|&k| distance(grey(k), colour)).expect("there are 24 greys");
    if distance(grey(k), colour) < distance(of_cube, colour) {
        232 + k
    } else {
        16 + (36 * red + 6 * green + blue) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{quarters, BLUE, GREEN, RED};
    use super::*;

    fn two_by_two() -> Pixels {
        Pixels { width: 2, height: 2, colours: vec![RED, GREEN, BLUE, Colour::WHITE] }
    }

    #[test]
    fn four_pixels_are_two_half_blocks() {
        let line = "\x1b[38;2;200;0;0;48;2;0;0;220m▀\x1b[38;2;0;160;0;48;2;255;255;255m▀\x1b[0m";
        assert_eq!(half_blocks(&two_by_two(), &[], Colours::All), [line]);
        let line = "\x1b[38;5;160;48;5;20m▀\x1b[38;5;34;48;5;231m▀\x1b[0m";
        assert_eq!(half_blocks(&two_by_two(), &[], Colours::Palette256), [line]);
    }

    #[test]
    fn colours_are_chosen_once_and_an_odd_row_ends_on_the_terminals_own() {
        let pixels = Pixels { width: 2, height: 3, colours: vec![RED; 6] };
        let full = "\x1b[38;2;200;0;0;48;2;200;0;0m▀▀\x1b[0m";
        let half = "\x1b[38;2;200;0;0;49m▀▀\x1b[0m";
        assert_eq!(half_blocks(&pixels, &[], Colours::All), [full, half]);
    }

    #[test]
    fn a_text_is_letters_on_the_pixel_where_they_are_clearer() {
        let label = Label { column: 0, row: 0, letter: '7', colour: Colour::INK };
        let lines = half_blocks(&two_by_two(), &[label], Colours::All);
        assert_eq!(lines, ["\x1b[38;2;40;44;52;48;2;0;0;220m7\x1b[38;2;0;160;0;48;2;255;255;255m▀\x1b[0m"]);
    }

    #[test]
    fn texts_that_are_covered_overwritten_or_too_small_are_left_out() {
        let text = |x, y, size, text: &str| Shape::Text { x, y, size, text: text.to_owned(), colour: RED };
        let mut scene = quarters();
        scene.shapes = vec![
            text(0.5, 0.5, 0.5, "a"),
            text(1.5, 0.5, 0.5, "bc"),
            text(0.5, 1.5, 0.5, "d"),
            text(1.5, 1.5, 0.19, "small"),
        ];
        let seen = |scene: &Scene| -> String {
            let mut seen: Vec<char> = drawn(scene, 4.0).unwrap().1.iter().map(|label| label.letter).collect();
            seen.sort_unstable();
            seen.into_iter().collect()
        };
        assert_eq!(seen(&scene), "abcd");
        scene.shapes.insert(0, text(0.5, 0.5, 0.5, "under a"));
        assert_eq!(seen(&scene), "abcd");
        scene.shapes.push(Shape::Circle { x: 0.5, y: 0.5, radius: 0.1, fill: BLUE });
        assert_eq!(seen(&scene), "bcd");
        scene.shapes.push(Shape::Rectangle { x: 0.0, y: 1.0, width: 1.0, height: 1.0, fill: BLUE });
        assert_eq!(seen(&scene), "bc");
        let triangle =
            |width| Shape::Polygon { corners: vec![(1.0, 0.0), (1.0 + width, 0.0), (1.0, 2.0)], fill: BLUE };
        scene.shapes.push(triangle(0.4));
        assert_eq!(seen(&scene), "bc", "beside the slope");
        scene.shapes.push(triangle(1.0));
        assert_eq!(seen(&scene), "");
    }

    #[test]
    fn a_picture_leaves_room_for_what_is_said() {
        let mut frame = Frame::new(quarters());
        frame.scene.caption = "to the north".to_owned();
        let scene = [
            "\x1b[38;2;200;0;0;48;2;200;0;0m▀▀\x1b[38;2;0;160;0;48;2;0;160;0m▀▀\x1b[0m",
            "\x1b[38;2;0;0;220;48;2;0;0;220m▀▀\x1b[38;2;255;255;255;48;2;255;255;255m▀▀\x1b[0m",
        ];
        let said = |rows| terminal_text(&frame, 9, rows, Colours::All).unwrap();
        // One row stays empty, and one column: eight letters hold "to the", not "to the north".
        assert_eq!(said(5), format!("{}\n{}\nto the\nnorth\n", scene[0], scene[1]));
        // Words take half of the rest at most.
        assert_eq!(said(4), format!("{}\n{}\nto the\n", scene[0], scene[1]));
    }

    #[test]
    fn pictures_follow_each_other_in_place_and_the_cursor_comes_back() {
        let mut frame = Frame::new(quarters());
        let mut written = Vec::new();
        let mut terminal = Terminal::new(&mut written, 80, 2, Colours::All);
        terminal.show(&frame).unwrap();
        frame.scene.shapes.clear();
        terminal.show(&frame).unwrap();
        drop(terminal);
        let written = String::from_utf8(written).unwrap();
        let pictures: Vec<&str> = written.split(HOME).collect();
        assert_eq!(pictures.len(), 3);
        assert_eq!(pictures[0], "\x1b[?25l\x1b[2J");
        assert!(
            pictures[1].starts_with("\x1b[38;2;200;0;0;") && pictures[1].ends_with("\x1b[0m\x1b[K\r\n\x1b[J")
        );
        assert!(pictures[2].ends_with("\x1b[K\r\n\x1b[J\x1b[0m\x1b[?25h"), "{:?}", pictures[2]);
    }

    #[test]
    fn a_terminal_without_24_bits_gets_the_nearest_of_256_colours() {
        assert_eq!(Colours::of(Some("truecolor")), Colours::All);
        assert_eq!(Colours::of(Some("24bit")), Colours::All);
        assert_eq!(Colours::of(Some("yes")), Colours::Palette256);
        assert_eq!(Colours::of(None), Colours::Palette256);
        assert_eq!(xterm(Colour(0, 0, 0)), 16);
        assert_eq!(xterm(Colour(255, 135, 0)), 208);
        assert_eq!(xterm(Colour(118, 118, 118)), 243);
    }
}
