//! The analytic example as a picture: how fast each scheme approaches the optimum, and the
//! spectral radius over ω (spec §10).

use std::path::Path;

use crate::chart::{stroke, Axis, Panel, GREY, HEIGHT, INK, WIDTH};
use crate::estimation::{best_omega, excess_cost, rho, stability_limit, Scheme};
use crate::svg::{Anchor, Format, Stroke, Svg};
use crate::Error;

const UPDATES: usize = 60;
/// Exponents of ten between which `J − J*` is shown.
const EXPONENTS: (i32, i32) = (-12, 4);
/// Enough for a smooth line of ρ(ω).
const OMEGAS: usize = 400;

/// Draws both panels into `out` (`.svg` or `.png`, 1200 by 800 pixels).
///
/// # Errors
/// [`Error::Extension`] for another kind of file, [`Error::Write`], [`Error::Raster`].
pub fn estimation_plot(out: &Path) -> Result<(), Error> {
    Format::of(out)?;
    let mut svg = Svg::new(WIDTH, HEIGHT);
    let title = "Three agents estimate one number: best responses at once, in turn, on two timescales";
    svg.text((104.0, 42.0), 22.0, INK, Anchor::Start, title);
    draw_trajectories(&mut svg);
    draw_radius(&mut svg);
    svg.save(out)
}

fn panel(left: f64, x: Axis, y: Axis) -> Panel {
    Panel { left, top: 92.0, width: 462.0, height: f64::from(HEIGHT) - 92.0 - 84.0, x, y }
}

fn draw_trajectories(svg: &mut Svg) {
    let panel = panel(
        104.0,
        Axis::linear(0.0, UPDATES as f64, 6, "update"),
        Axis::powers_of_ten(EXPONENTS.0, EXPONENTS.1, 2, "excess cost J − J*"),
    );
    svg.text((panel.left, 76.0), 15.0, GREY, Anchor::Start, "distance from the optimum, starting at K = 0");
    panel.draw_axes(svg);
    let schemes = [
        ("IIBR: all at once", Scheme::IIBR),
        ("SIBR: one after another", Scheme::SIBR),
        ("two timescales, ω = 0.5", Scheme::multi_timescale(0.5, 1)),
    ];
    let lines = schemes.map(|(_, scheme)| {
        let trajectory = scheme.trajectory(UPDATES);
        let exponents = trajectory.iter().map(|k| excess_cost(k).log10());
        exponents.enumerate().map(|(u, exponent)| panel.at(u as f64, exponent)).collect::<Vec<_>>()
    });
    panel.clipped(svg, "trajectories", |svg| {
        lines.iter().enumerate().for_each(|(index, line)| svg.polyline(line, stroke(index)));
    });
    let entries: Vec<_> =
        schemes.iter().enumerate().map(|(i, (name, _))| (stroke(i), name.to_string())).collect();
    panel.draw_legend(svg, &entries, &lines);
}

fn draw_radius(svg: &mut Svg) {
    let panel = panel(
        f64::from(WIDTH) - 40.0 - 462.0,
        Axis::linear(0.0, 1.0, 5, "ω, weight of the slow agents"),
        Axis::linear(0.0, 2.5, 5, "spectral radius ρ of a sweep"),
    );
    svg.text(
        (panel.left, 76.0),
        15.0,
        GREY,
        Anchor::Start,
        "ω = 0 is SIBR, ω = 1 is IIBR; below 1 it converges",
    );
    panel.draw_axes(svg);
    let line: Vec<_> =
        (0..=OMEGAS).map(|i| i as f64 / OMEGAS as f64).map(|omega| panel.at(omega, rho(omega))).collect();
    let limit = Stroke { colour: GREY, width: 1.4, dashes: "6 5" };
    svg.line(panel.at(0.0, 1.0), panel.at(1.0, 1.0), limit);
    panel.clipped(svg, "radius", |svg| svg.polyline(&line, Stroke { colour: INK, ..stroke(0) }));

    let (omega, least) = best_omega();
    let unstable = stability_limit();
    let marks = [
        (omega, least, format!("best: ω = {omega:.4}, ρ = {least:.4}")),
        (unstable, 1.0, format!("unstable from ω = {unstable:.4}")),
    ];
    for (index, (omega, rho, text)) in marks.into_iter().enumerate() {
        let at = panel.at(omega, rho);
        svg.circle(at, 5.5, stroke(index + 1).colour);
        let (dx, dy) = [(0.0, 30.0), (-12.0, -14.0)][index];
        let anchor = [Anchor::Middle, Anchor::End][index];
        svg.text((at.0 + dx, at.1 + dy), 15.0, INK, anchor, &text);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::fs;

    use resvg::tiny_skia::Pixmap;

    use super::*;

    #[test]
    fn the_picture_shows_three_trajectories_and_the_radius_with_its_marks() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("estimation.svg");
        estimation_plot(&out).unwrap();
        let svg = fs::read_to_string(&out).unwrap();
        assert_eq!(svg.matches("<polyline").count(), 4);
        for text in [
            "IIBR: all at once",
            "SIBR: one after another",
            "two timescales, ω = 0.5",
            "best: ω = 0.6188, ρ = 0.4366",
            "unstable from ω = 0.7842",
            "10⁻¹²",
        ] {
            assert_eq!(svg.matches(&format!(">{text}</text>")).count(), 1, "{text}");
        }
    }

    #[test]
    fn the_png_is_a_full_picture_and_other_kinds_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("estimation.png");
        estimation_plot(&out).unwrap();
        let picture = Pixmap::decode_png(&fs::read(&out).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (1200, 800));
        let colours: HashSet<_> = picture.pixels().iter().map(|p| (p.red(), p.green(), p.blue())).collect();
        assert!(colours.len() > 50, "only {} colours", colours.len());
        assert!(matches!(estimation_plot(&folder.path().join("x.gif")), Err(Error::Extension { .. })));
    }
}
