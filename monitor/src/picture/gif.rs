//! Films of worlds: animated GIFs in an endless loop. They are small because colours are flat and only changes since
//! the last picture are written.

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use envs::scene::{Colour, Shape};
use gif::{DisposalMethod, Encoder, EncodingError, Repeat};

use super::{distance, rasterise, Frame, Pixels, Sheet};
use crate::{svg, Error};

/// Shortest time for which an outcome is shown: long enough to read it.
const OUTCOME: Duration = Duration::from_millis(1500);
/// Number of pictures, spread over the film, whose colours are counted.
const COUNTED: usize = 8;
/// The index of unchanged pixels. The other 255 are colours.
const UNCHANGED: u8 = 0;

/// Writes an endless film, `width` pixels wide, that shows each picture for `delay`, outcomes longer.
///
/// The first picture decides the shape; scenes of other sizes are fitted into it. Missing folders of `out` are
/// made.
///
/// # Errors
/// [`Error::Empty`] without frames, [`Error::Scene`] if a scene has no area or the film would be too large,
/// [`Error::Write`].
pub fn write_gif(
    frames: impl IntoIterator<Item = Frame>,
    width: u32,
    delay: Duration,
    out: &Path,
) -> Result<(), Error> {
    let frames: Vec<Frame> = frames.into_iter().collect();
    svg::write(out, &encode(&frames, width, delay)?)
}

fn encode(frames: &[Frame], width: u32, delay: Duration) -> Result<Vec<u8>, Error> {
    let sheet = Sheet::new(width, frames)?;
    let mut palette = Palette::of(&sheet, frames)?;
    let failed = |error: EncodingError| Error::Scene(error.to_string());
    let side = |pixels: u32| u16::try_from(pixels).expect("sheets are far smaller");
    let (width, height) = (side(sheet.width), side(sheet.height));

    let mut film = Encoder::new(Vec::new(), width, height, &palette.table()).map_err(failed)?;
    film.set_repeat(Repeat::Infinite).map_err(failed)?;
    let mut shown = vec![UNCHANGED; usize::from(width) * usize::from(height)];
    for frame in frames {
        let indices = palette.indices(&draw(&sheet, frame)?);
        let mut picture = change(&shown, &indices, width);
        picture.delay = hundredths(if frame.outcome { delay.max(OUTCOME) } else { delay });
        film.write_frame(&picture).map_err(failed)?;
        shown = indices;
    }
    film.into_inner().map_err(failed)
}

fn draw(sheet: &Sheet, frame: &Frame) -> Result<Pixels, Error> {
    super::ratio(&frame.scene)?;
    rasterise(&sheet.draw(frame))
}

/// GIF counts in hundredths of a second. Browsers replace values below two by ten.
fn hundredths(time: Duration) -> u16 {
    u16::try_from(time.as_millis() / 10).unwrap_or(u16::MAX).max(2)
}

/// The smallest rectangle with all changes; unchanged pixels inside are transparent.
fn change(before: &[u8], after: &[u8], width: u16) -> gif::Frame<'static> {
    let across = usize::from(width);
    let changed = || (0..after.len()).filter(|&i| before[i] != after[i]);
    let (mut left, mut right) = (across, 0);
    for i in changed() {
        (left, right) = (left.min(i % across), right.max(i % across));
    }
    // A picture must have an area, also without changes.
    let top = changed().next().unwrap_or(0) / across;
    let bottom = changed().next_back().unwrap_or(0) / across;
    left = left.min(right);
    let rows = (top..=bottom).map(|row| row * across);
    let buffer: Vec<u8> = rows
        .flat_map(|row| row + left..=row + right)
        .map(|i| if before[i] == after[i] { UNCHANGED } else { after[i] })
        .collect();
    let short = |pixels: usize| u16::try_from(pixels).expect("no more than the picture has");
    gif::Frame {
        left: short(left),
        top: short(top),
        width: short(right - left + 1),
        height: short(bottom - top + 1),
        dispose: DisposalMethod::Keep,
        transparent: Some(UNCHANGED),
        buffer: buffer.into(),
        ..gif::Frame::default()
    }
}

/// The colours of a film. Colours of its scenes are exact. Shades at edges are approximated by the most frequent ones,
/// so an area does not change its colour between pictures.
struct Palette {
    /// At most 255; the index of `colours[k]` is `k + 1`.
    colours: Vec<Colour>,
    /// Indices found so far.
    known: HashMap<Colour, u8>,
}

impl Palette {
    const MOST: usize = 255;

    fn of(sheet: &Sheet, frames: &[Frame]) -> Result<Self, Error> {
        let mut palette = Self { colours: Vec::new(), known: HashMap::new() };
        // Paper and ink of the text, then what the scenes name.
        [Colour::WHITE, Colour::INK].into_iter().for_each(|colour| palette.add(colour));
        for Frame { scene, .. } in frames {
            palette.add(scene.background);
            scene.shapes.iter().for_each(|shape| palette.add(colour(shape)));
        }
        let mut counts: HashMap<Colour, u64> = HashMap::new();
        for frame in frames.iter().step_by(frames.len().div_ceil(COUNTED)) {
            for run in runs(&draw(sheet, frame)?) {
                *counts.entry(run[0]).or_default() += run.len() as u64;
            }
        }
        let mut shades: Vec<(Colour, u64)> = counts.into_iter().collect();
        // Sorted by colour among equals: a film must not depend on the order of a hash map.
        shades.sort_unstable_by_key(|&(colour, count)| (std::cmp::Reverse(count), colour));
        shades.into_iter().for_each(|(colour, _)| palette.add(colour));
        Ok(palette)
    }

    fn add(&mut self, colour: Colour) {
        if self.colours.len() < Self::MOST && !self.known.contains_key(&colour) {
            self.colours.push(colour);
            self.known.insert(colour, self.colours.len() as u8);
        }
    }

    /// As GIF wants it: red, green, blue by index. The colour of [`UNCHANGED`] is never seen.
    fn table(&self) -> Vec<u8> {
        let Colour(red, green, blue) = Colour::WHITE;
        let colours = self.colours.iter().flat_map(|&Colour(red, green, blue)| [red, green, blue]);
        [red, green, blue].into_iter().chain(colours).collect()
    }

    /// Each pixel's colour, or the nearest there is.
    fn indices(&mut self, pixels: &Pixels) -> Vec<u8> {
        let Self { colours, known } = self;
        let mut indices = Vec::with_capacity(pixels.colours.len());
        for run in runs(pixels) {
            let index = known.entry(run[0]).or_insert_with(|| nearest(colours, run[0]) as u8 + 1);
            indices.resize(indices.len() + run.len(), *index);
        }
        indices
    }
}

/// Runs of pixels of one colour: there are far fewer runs than pixels.
fn runs(pixels: &Pixels) -> impl Iterator<Item = &[Colour]> {
    pixels.colours.chunk_by(|a, b| a == b)
}

fn colour(shape: &Shape) -> Colour {
    match shape {
        Shape::Rectangle { fill, .. } | Shape::Circle { fill, .. } | Shape::Polygon { fill, .. } => *fill,
        Shape::Line { colour, .. } | Shape::Text { colour, .. } => *colour,
    }
}

fn nearest(colours: &[Colour], wanted: Colour) -> usize {
    let nearer = |&k: &usize| distance(colours[k], wanted);
    (0..colours.len()).min_by_key(nearer).expect("paper and ink are always there")
}

#[cfg(test)]
mod tests {
    use super::super::tests::{quarters, BLUE, GREEN, RED};
    use super::*;

    const DELAY: Duration = Duration::from_millis(200);

    /// Every picture of a film as it is seen, with its delay in hundredths.
    fn decode(film: &[u8]) -> (u16, u16, Vec<(u16, Vec<Colour>)>) {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(film).unwrap();
        let (width, height) = (decoder.width(), decoder.height());
        let mut seen = vec![Colour(0, 0, 0); usize::from(width) * usize::from(height)];
        let mut pictures = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (k, pixel) in frame.buffer.chunks_exact(4).enumerate() {
                let (row, column) = (k / usize::from(frame.width), k % usize::from(frame.width));
                let place = (row + usize::from(frame.top)) * usize::from(width);
                if pixel[3] != 0 {
                    seen[place + column + usize::from(frame.left)] = Colour(pixel[0], pixel[1], pixel[2]);
                }
            }
            pictures.push((frame.delay, seen.clone()));
        }
        assert_eq!(decoder.repeat(), Repeat::Infinite);
        (width, height, pictures)
    }

    fn film() -> Vec<Frame> {
        let still = Frame::new(quarters());
        let mut moved = still.clone();
        moved.scene.shapes.push(Shape::Rectangle { x: 1.0, y: 1.0, width: 1.0, height: 1.0, fill: BLUE });
        let mut wide = still.clone();
        (wide.scene.width, wide.scene.background) = (4.0, GREEN);
        vec![still.clone(), still, Frame { outcome: true, ..moved }, wide]
    }

    #[test]
    fn a_film_shows_what_its_pictures_show_and_loops_for_ever() {
        let frames = film();
        let (width, height, seen) = decode(&encode(&frames, 80, DELAY).unwrap());
        assert_eq!((width, height), (80, 80));
        assert_eq!(seen.iter().map(|(delay, _)| *delay).collect::<Vec<_>>(), [20, 20, 150, 20]);
        for (frame, (_, colours)) in frames.iter().zip(&seen).take(3) {
            assert_eq!(*colours, super::super::pixels(frame, 80).unwrap().colours);
        }
        // The wide scene is fitted in: 76 pixels for 4 units, centred between green bars.
        let last = &seen[3].1;
        let at = |x: usize, y: usize| last[y * 80 + x];
        assert_eq!((at(10, 10), at(2, 22), at(21, 22), at(40, 22)), (GREEN, RED, GREEN, GREEN));
        assert_eq!(at(2, 58), BLUE);
    }

    #[test]
    fn only_what_changed_is_written() {
        let before = [1, 1, 1, 1, 1, 1];
        let picture = change(&before, &[1, 1, 2, 1, 3, 1], 3);
        assert_eq!((picture.left, picture.top, picture.width, picture.height), (1, 0, 2, 2));
        assert_eq!(*picture.buffer, [UNCHANGED, 2, 3, UNCHANGED]);
        let picture = change(&before, &before, 3);
        assert_eq!((picture.left, picture.top, picture.width, picture.height), (0, 0, 1, 1));
        assert_eq!(*picture.buffer, [UNCHANGED]);
    }

    #[test]
    fn more_colours_than_a_film_can_have_become_the_nearest() {
        let mut scene = quarters();
        scene.width = 300.0;
        scene.shapes.clear();
        for k in 0..300_u16 {
            let (x, fill) = (f64::from(k), Colour((k / 2) as u8, (k % 2) as u8, 0));
            scene.shapes.push(Shape::Rectangle { x, y: 0.0, width: 1.0, height: 2.0, fill });
        }
        let sheet = Sheet::new(320, &[Frame::new(scene.clone())]).unwrap();
        let mut palette = Palette::of(&sheet, &[Frame::new(scene)]).unwrap();
        assert_eq!(palette.table().len(), 256 * 3);
        let wanted = vec![Colour(126, 0, 0), Colour(130, 0, 0)];
        let indices = palette.indices(&Pixels { width: 2, height: 1, colours: wanted });
        let found: Vec<Colour> = indices.iter().map(|&k| palette.colours[usize::from(k) - 1]).collect();
        // White and ink take two places of 255, so that the last named colour is the 253rd.
        assert_eq!(found, [Colour(126, 0, 0), Colour(126, 0, 0)]);
    }

    #[test]
    fn a_film_needs_a_picture_and_scenes_with_an_area() {
        let refused = |frames: &[Frame]| encode(frames, 80, DELAY).unwrap_err().to_string();
        assert_eq!(refused(&[]), "nothing to draw: there are no pictures");
        let mut frames = film();
        frames[1].scene.width = 0.0;
        assert_eq!(refused(&frames), "cannot draw the world: expected a scene with an area, found 0 x 2");
    }

    #[test]
    fn times_are_in_hundredths_and_none_is_too_short_for_browsers() {
        let times = [0, 19, 200, u64::MAX].map(|ms| hundredths(Duration::from_millis(ms)));
        assert_eq!(times, [2, 2, 20, u16::MAX]);
    }
}
