//! The parts of every chart: axes with round ticks, panels with a light grid, a legend in a free corner, and colours
//! that also people with colour blindness can distinguish.

use crate::svg::{Anchor, Stroke, Svg};

pub const WIDTH: u32 = 1200;
pub const HEIGHT: u32 = 800;

pub const INK: &str = "#222222";
pub const GREY: &str = "#666666";
const GRID: &str = "#e4e4e4";
const FRAME: &str = "#9a9a9a";
const TICK_SIZE: f64 = 15.0;
const LABEL_SIZE: f64 = 17.0;
const LEGEND_SIZE: f64 = 15.0;
const LEGEND_ROW: f64 = 25.0;
/// Width of a DejaVu Sans character in font sizes, on the average of mixed text, rounded up.
const CHARACTER: f64 = 0.62;

/// Okabe and Ito's palette without its yellow, which is hard to see as a line on white.
const COLOURS: [&str; 7] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"];
/// After the last colour they repeat with other dashes.
const DASHES: [&str; 3] = ["", "9 6", "2 6"];

/// The stroke of the `index`-th line.
pub fn stroke(index: usize) -> Stroke<'static> {
    let dashes = DASHES[index / COLOURS.len() % DASHES.len()];
    Stroke { colour: COLOURS[index % COLOURS.len()], width: 2.6, dashes }
}

/// A range of values with ticks.
pub struct Axis {
    pub min: f64,
    pub max: f64,
    /// Value and text.
    pub ticks: Vec<(f64, String)>,
    pub label: String,
}

impl Axis {
    /// Covers `min..=max` (in any order), with about `count` round ticks inside. An empty or
    /// unbounded range is widened to one that can be drawn.
    pub fn linear(min: f64, max: f64, count: usize, label: &str) -> Self {
        let (mut min, mut max) = (min.min(max), min.max(max));
        if !(max - min).is_finite() {
            (min, max) = (-1.0, 1.0);
        } else if max - min <= 1e-9 * min.abs().max(max.abs()) {
            let margin = (0.1 * max.abs()).max(0.5);
            (min, max) = (min - margin, max + margin);
        }
        let step = round_step((max - min) / count.max(1) as f64);
        // The small tolerance keeps a tick that rounding puts slightly outside.
        let first = (min / step - 1e-6).ceil() as i64;
        let last = (max / step + 1e-6).floor() as i64;
        let ticks =
            (first..=last).map(|i| i as f64 * step).map(|value| (value, tick_text(value, step))).collect();
        Self { min, max, ticks, label: label.to_owned() }
    }

    /// For values given as powers of ten: `min` and `max` are exponents, every `every`-th is named.
    pub fn powers_of_ten(min: i32, max: i32, every: i32, label: &str) -> Self {
        let exponents = (min..=max).filter(|exponent| exponent % every == 0);
        let ticks = exponents.map(|exponent| (f64::from(exponent), power_text(exponent))).collect();
        Self { min: f64::from(min), max: f64::from(max), ticks, label: label.to_owned() }
    }

    /// The position of `value` between the ends: 0 to 1.
    fn share(&self, value: f64) -> f64 {
        (value - self.min) / (self.max - self.min)
    }
}

/// The smallest of 1, 2, 2.5, 5 times a power of ten that is not below `least`.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let factor = [1.0, 2.0, 2.5, 5.0].into_iter().find(|factor| factor * power >= least * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// `20k`, `1.5M`, `0.25`: as many decimals as the distance between ticks needs.
pub fn tick_text(value: f64, step: f64) -> String {
    let largest = value.abs().max(step);
    let (unit, suffix) = match largest {
        huge if huge >= 1e15 => return format!("{value:.1e}"),
        large if large >= 1e9 => (1e9, "G"),
        large if large >= 1e6 => (1e6, "M"),
        large if large >= 1e3 => (1e3, "k"),
        _ if step < 1e-4 => return format!("{value:.1e}"),
        _ => (1.0, ""),
    };
    if value.abs() < step * 1e-6 {
        return "0".to_owned();
    }
    let step = step / unit;
    let whole = |scaled: f64| (scaled - scaled.round()).abs() < 1e-6 * scaled;
    let decimals = (0..6).find(|decimals| whole(step * 10_f64.powi(*decimals))).unwrap_or(6);
    let digits = format!("{:.*}", decimals as usize, value / unit);
    match suffix {
        "" => digits,
        // `5M` beside `7.5M`, but `1.0` beside `0.5`, as people write them.
        _ if digits.contains('.') => {
            format!("{}{suffix}", digits.trim_end_matches('0').trim_end_matches('.'))
        }
        _ => digits + suffix,
    }
}

fn power_text(exponent: i32) -> String {
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32(0x2070 + digit.to_digit(10).unwrap_or(0)).unwrap_or(digit),
    };
    match exponent {
        0 => "1".to_owned(),
        exponent => format!("10{}", exponent.to_string().chars().map(raised).collect::<String>()),
    }
}

/// A rectangle of the picture with two axes; positions in pixels.
pub struct Panel {
    pub left: f64,
    pub top: f64,
    pub width: f64,
    pub height: f64,
    pub x: Axis,
    pub y: Axis,
}

impl Panel {
    /// The pixel of a pair of values, also of values outside the axes.
    pub fn at(&self, x: f64, y: f64) -> (f64, f64) {
        (self.left + self.x.share(x) * self.width, self.top + (1.0 - self.y.share(y)) * self.height)
    }

    /// Grid, ticks and the names of the axes.
    pub fn draw_axes(&self, svg: &mut Svg) {
        let (right, bottom) = (self.left + self.width, self.top + self.height);
        let grid = Stroke { colour: GRID, width: 1.0, dashes: "" };
        let frame = Stroke { colour: FRAME, width: 1.2, dashes: "" };
        for (value, text) in &self.x.ticks {
            let x = self.at(*value, 0.0).0;
            svg.line((x, self.top), (x, bottom), grid);
            svg.line((x, bottom), (x, bottom + 5.0), frame);
            svg.text((x, bottom + 24.0), TICK_SIZE, INK, Anchor::Middle, text);
        }
        for (value, text) in &self.y.ticks {
            let y = self.at(0.0, *value).1;
            svg.line((self.left, y), (right, y), grid);
            svg.line((self.left - 5.0, y), (self.left, y), frame);
            svg.text((self.left - 11.0, y + 0.36 * TICK_SIZE), TICK_SIZE, INK, Anchor::End, text);
        }
        svg.line((self.left, self.top), (self.left, bottom), frame);
        svg.line((self.left, bottom), (right, bottom), frame);
        svg.text(
            (self.left + self.width / 2.0, bottom + 56.0),
            LABEL_SIZE,
            INK,
            Anchor::Middle,
            &self.x.label,
        );
        svg.vertical_text((self.left - 68.0, self.top + self.height / 2.0), LABEL_SIZE, INK, &self.y.label);
    }

    /// Draws only inside the panel; `id` must be the panel's own.
    pub fn clipped(&self, svg: &mut Svg, id: &str, inner: impl FnOnce(&mut Svg)) {
        // Room for what is drawn on the very edge: half a line, half a dot.
        let room = 5.0;
        let corner = (self.left - room, self.top - room);
        svg.clipped(id, corner, (self.width + 2.0 * room, self.height + 2.0 * room), inner);
    }

    /// A legend in the corner where it covers least of `lines` (pixels).
    pub fn draw_legend(&self, svg: &mut Svg, entries: &[(Stroke, String)], lines: &[Vec<(f64, f64)>]) {
        let characters = entries.iter().map(|(_, text)| text.chars().count()).max().unwrap_or(0);
        let width = 62.0 + characters as f64 * CHARACTER * LEGEND_SIZE;
        let height = 12.0 + entries.len() as f64 * LEGEND_ROW;
        let (near, gap) = ((self.left + 14.0, self.top + 12.0), 12.0);
        let far = (self.left + self.width - width - gap, self.top + self.height - height - gap);
        let corners = [(far.0, far.1), (near.0, near.1), (far.0, near.1), (near.0, far.1)];
        let covered = |corner: &&(f64, f64)| {
            let inside = |(x, y): &(f64, f64)| {
                (corner.0..corner.0 + width).contains(x) && (corner.1..corner.1 + height).contains(y)
            };
            lines.iter().flat_map(|line| dense(line)).filter(inside).count()
        };
        let Some(corner) = corners.iter().min_by_key(covered) else { return };

        svg.rect(*corner, (width, height), "#ffffff", 0.85);
        for (row, (stroke, text)) in entries.iter().enumerate() {
            let y = corner.1 + 6.0 + (row as f64 + 0.5) * LEGEND_ROW;
            svg.line((corner.0 + 10.0, y), (corner.0 + 44.0, y), Stroke { width: 3.0, ..*stroke });
            svg.text((corner.0 + 54.0, y + 0.36 * LEGEND_SIZE), LEGEND_SIZE, INK, Anchor::Start, text);
        }
    }
}

/// The line with points about every four pixels, so that long segments count as what they cover.
fn dense(line: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    for pair in line.windows(2) {
        let (dx, dy) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
        let parts = (dx.hypot(dy) / 4.0).clamp(1.0, 1000.0) as usize;
        points.extend(
            (0..parts).map(|i| i as f64 / parts as f64).map(|s| (pair[0].0 + s * dx, pair[0].1 + s * dy)),
        );
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(min: f64, max: f64, count: usize) -> Vec<String> {
        Axis::linear(min, max, count, "").ticks.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_and_inside_the_range() {
        assert_eq!(texts(0.0, 100_870.0, 6), ["0", "20k", "40k", "60k", "80k", "100k"]);
        assert_eq!(texts(0.0, 2e7, 8), ["0", "2.5M", "5M", "7.5M", "10M", "12.5M", "15M", "17.5M", "20M"]);
        assert_eq!(texts(0.02, 1.04, 6), ["0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts(-76.0, -28.0, 5), ["-70", "-60", "-50", "-40", "-30"]);
        assert_eq!(texts(0.0, 1.0, 4), ["0", "0.25", "0.50", "0.75", "1.00"]);
    }

    #[test]
    fn ranges_that_cannot_be_drawn_are_widened() {
        assert_eq!(texts(0.0, 0.0, 4), ["-0.50", "-0.25", "0", "0.25", "0.50"]);
        for (min, max) in [(1e300, 1e300), (-1e308, 1e308), (f64::NAN, 1.0), (1.0 - 1e-16, 1.0)] {
            let axis = Axis::linear(min, max, 5, "");
            assert!(axis.max > axis.min && axis.ticks.len() < 20, "{min} {max}: {} {}", axis.min, axis.max);
        }
    }

    #[test]
    fn powers_of_ten_are_written_with_raised_digits() {
        let ticks = Axis::powers_of_ten(-12, 4, 4, "").ticks;
        let texts: Vec<_> = ticks.iter().map(|(_, text)| text.as_str()).collect();
        assert_eq!(texts, ["10⁻¹²", "10⁻⁸", "10⁻⁴", "1", "10⁴"]);
    }
}
