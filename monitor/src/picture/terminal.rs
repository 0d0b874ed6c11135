//! Worlds in a terminal: two pixels to a letter (an upper half block), the texts of the scene as letters, and
//! what is said below.

use std::io::{self, Write};

use envs::scene::{Colour, Scene, Shape};

use super::{draw_scene, rasterise, ratio, Frame, Pixels};
use crate::svg::Svg;
use crate::Error;

const HIDE_CURSOR: &str = "\x1b[?25l";
const SHOW_CURSOR: &str = "\x1b[?25h";
const CLEAR_SCREEN: &str = "\x1b[2J";
const HOME: &str = "\x1b[H";
const CLEAR_TO_END_OF_LINE: &str = "\x1b[K";
const CLEAR_BELOW: &str = "\x1b[J";
const PLAIN: &str = "\x1b[0m";

/// Texts that would be lower than this many pixels are left out: their letters would cover their neighbours.
const SMALLEST_TEXT: f64 = 1.0;

/// Which colours a terminal knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colours {
    /// 24 bits.
    All,
    /// The 6x6x6 cube and the greys of xterm's palette.
    Palette256,
}

impl Colours {
    /// As the environment variable `COLORTERM` tells it.
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

/// Shows one picture after the other in the same place. Hides the cursor and gives it back when dropped.
pub struct Terminal<W: Write> {
    out: W,
    columns: u16,
    rows: u16,
    colours: Colours,
    begun: bool,
    /// The most there was to say so far: scenes would jump if each took what is left.
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
        // All at once, so that nobody sees half a picture.
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
            // A terminal that is gone needs no cursor.
            let _ = self.write(&format!("{PLAIN}{SHOW_CURSOR}"));
        }
    }
}

/// The scene, then what is said, where `text_rows` are kept free for the latter: at most half of the terminal.
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

/// Pixels for a unit of the scene. Whole ones, where sides are, keep the cells of a grid alike.
fn scale(scene: &Scene, width: usize, height: usize) -> Result<f64, Error> {
    ratio(scene)?;
    let scale = (width as f64 / scene.width).min(height as f64 / scene.height);
    let whole = scene.width.fract() == 0.0 && scene.height.fract() == 0.0;
    Ok(if whole && scale >= 1.0 { scale.floor() } else { scale })
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

    let mut labels = Vec::new();
    for (k, shape) in scene.shapes.iter().enumerate() {
        let Shape::Text { x, y, size, text, colour } = shape else { continue };
        let covered = scene.shapes[k + 1..].iter().any(|later| covers(later, *x, *y));
        if covered || size * scale < SMALLEST_TEXT {
            continue;
        }
        let first = (x * scale - text.chars().count() as f64 / 2.0).round();
        let row = (y * scale / 2.0).floor();
        for (letter, column) in text.chars().zip(0_u32..).filter(|(letter, _)| !letter.is_control()) {
            let column = first + f64::from(column);
            if row >= 0.0 && column >= 0.0 {
                labels.push(Label { column: column as usize, row: row as usize, letter, colour: *colour });
            }
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
            // Of texts in one place the last one is seen.
            let label = labels.iter().rfind(|label| (label.row, label.column) == (row, column));
            let (letter, front, back) = match label {
                Some(label) => (label.letter, label.colour, Some(mean(upper, lower.unwrap_or(upper)))),
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

fn mean(a: Colour, b: Colour) -> Colour {
    Colour(a.0.midpoint(b.0), a.1.midpoint(b.1), a.2.midpoint(b.2))
}

/// The number of xterm's colour that is nearest: 16 to 231 are a cube, 232 to 255 greys.
fn xterm(Colour(red, green, blue): Colour) -> u8 {
    const STEPS: [u8; 6] = [0, 95, 135, 175, 215, 255];
    let step = |value: u8| (0..6).min_by_key(|&k| STEPS[k].abs_diff(value)).expect("six steps");
    let (r, g, b) = (step(red), step(green), step(blue));
    let grey =
        (0..24_u8).min_by_key(|k| distance([8 + 10 * k; 3], [red, green, blue])).expect("there are 24 greys");
    let of_cube = distance([STEPS[r], STEPS[g], STEPS[b]], [red, green, blue]);
    if distance([8 + 10 * grey; 3], [red, green, blue]) < of_cube {
        232 + grey
    } else {
        16 + (36 * r + 6 * g + b) as u8
    }
}

fn distance(a: [u8; 3], b: [u8; 3]) -> u32 {
    a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum()
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
    fn a_text_is_letters_on_the_mean_of_its_pixels() {
        let label = Label { column: 0, row: 0, letter: '7', colour: Colour::INK };
        let lines = half_blocks(&two_by_two(), &[label], Colours::All);
        assert_eq!(lines, ["\x1b[38;2;40;44;52;48;2;100;0;110m7\x1b[38;2;0;160;0;48;2;255;255;255m▀\x1b[0m"]);
    }

    #[test]
    fn texts_that_are_covered_or_too_small_are_left_out() {
        let text = |x, y, size, text: &str| Shape::Text { x, y, size, text: text.to_owned(), colour: RED };
        let mut scene = quarters();
        scene.shapes = vec![
            text(0.5, 0.5, 0.5, "a"),
            text(1.5, 0.5, 0.5, "bc"),
            text(0.5, 1.5, 0.5, "d"),
            text(1.5, 1.5, 0.2, "small"),
        ];
        let seen = |scene: &Scene| -> String {
            drawn(scene, 4.0).unwrap().1.iter().map(|label| label.letter).collect()
        };
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
