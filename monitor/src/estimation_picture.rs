//! The analytic example as a picture: the gains of the agents under both schemes of the paper, the convergence of each
//! scheme, and the spectral radius over ω (algorithms §10).

use std::path::Path;

use crate::chart::{stroke, Axis, Panel, GREY, HEIGHT, INK, WIDTH};
use crate::estimation::{spectral_radius, Problem, Scheme};
use crate::svg::{Anchor, Format, Stroke, Svg};
use crate::Error;

/// Updates for which gains are shown; few, because diverging gains soon leave the scale.
const IIBR_UPDATES: usize = 8;
const SIBR_SWEEPS: usize = 6;
const UPDATES: usize = 60;
/// Exponents of ten between which `J − J*` is shown.
const EXPONENTS: (i32, i32) = (-12, 4);
/// Number of points of the line ρ(ω).
const OMEGAS: usize = 200;
/// Agents whose gains are shown one by one: the first of a large team.
const MOST_LINES: usize = 4;

/// Draws four panels into `out` (`.svg` or `.png`, 1200 by 800 pixels).
///
/// # Errors
/// [`Error::Extension`] for another kind of file, [`Error::Write`], [`Error::Raster`].
pub fn estimation_plot(problem: &Problem, out: &Path) -> Result<(), Error> {
    Format::of(out)?;
    let mut svg = Svg::new(WIDTH, HEIGHT);
    let title = format!(
        "{} agents estimate one number (p = {}, q = {}, variance {})",
        problem.agents(),
        problem.p(),
        problem.q(),
        problem.variance()
    );
    svg.text((104.0, 38.0), 22.0, INK, Anchor::Start, &title);
    draw_gains(
        &mut svg,
        problem,
        Place::TopLeft,
        Scheme::IIBR,
        IIBR_UPDATES,
        "IIBR: best responses all at once",
    );
    draw_gains(
        &mut svg,
        problem,
        Place::TopRight,
        Scheme::SIBR,
        SIBR_SWEEPS * problem.agents(),
        "SIBR: one after another",
    );
    draw_excess(&mut svg, problem);
    draw_radius(&mut svg, problem);
    svg.save(out)
}

#[derive(Clone, Copy, PartialEq)]
enum Place {
    TopLeft,
    TopRight,
    BottomLeft,
    BottomRight,
}

/// An empty panel with its heading.
fn panel(svg: &mut Svg, place: Place, heading: &str, x: Axis, y: Axis) -> Panel {
    let left = if matches!(place, Place::TopLeft | Place::BottomLeft) { 104.0 } else { 698.0 };
    let top = if matches!(place, Place::TopLeft | Place::TopRight) { 80.0 } else { 472.0 };
    svg.text((left, top - 14.0), 15.0, GREY, Anchor::Start, heading);
    let panel = Panel { left, top, width: 462.0, height: 248.0, x, y };
    panel.draw_axes(svg);
    panel
}

/// The paper's figure: the gain of every agent after each update, and K*.
fn draw_gains(svg: &mut Svg, problem: &Problem, place: Place, scheme: Scheme, updates: usize, heading: &str) {
    let trajectory = scheme.trajectory(problem, updates);
    let star = problem.fixed_point()[0];
    let all = || trajectory.iter().flatten().copied().chain([star]);
    let (least, most) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
    let (x, y) = (Axis::linear(0.0, updates as f64, 6, "update"), Axis::linear(least, most, 5, "gain K"));
    let panel = panel(svg, place, heading, x, y);
    let optimum = Stroke { colour: GREY, width: 1.4, dashes: "6 5" };
    svg.line(panel.at(0.0, star), panel.at(updates as f64, star), optimum);
    // With simultaneous updates from one start, all agents have the same gain.
    let shown = if scheme == Scheme::IIBR { 1 } else { problem.agents().min(MOST_LINES) };
    let lines: Vec<Vec<_>> = (0..shown)
        .map(|i| trajectory.iter().enumerate().map(|(u, k)| panel.at(u as f64, k[i])).collect())
        .collect();
    let id = if scheme == Scheme::IIBR { "at-once" } else { "in-turn" };
    panel.clipped(svg, id, |svg| {
        lines.iter().enumerate().for_each(|(index, line)| svg.polyline(line, stroke(index)));
    });
    let name = |i| if shown == 1 { "each agent".to_owned() } else { format!("agent {}", i + 1) };
    let mut entries: Vec<_> = (0..shown).map(|i| (stroke(i), name(i))).collect();
    entries.push((optimum, format!("optimum K* = {star:.4}")));
    panel.draw_legend(svg, &entries, &lines);
}

fn draw_excess(svg: &mut Svg, problem: &Problem) {
    let panel = panel(
        svg,
        Place::BottomLeft,
        "distance from the optimum, starting at K = 0",
        Axis::linear(0.0, UPDATES as f64, 6, "update"),
        Axis::powers_of_ten(EXPONENTS.0, EXPONENTS.1, 4, "excess cost J − J*"),
    );
    let w = problem.best_damping();
    let schemes = [
        ("IIBR".to_owned(), Scheme::IIBR),
        ("SIBR".to_owned(), Scheme::SIBR),
        ("two timescales, ω = 0.5".to_owned(), Scheme::multi_timescale(0.5, 1)),
        (format!("all at once, damped {w:.2}"), Scheme::damped(w)),
    ];
    let lines = schemes.each_ref().map(|(_, scheme)| {
        let trajectory = scheme.trajectory(problem, UPDATES);
        // At the optimum the logarithm would be infinite.
        let exponents = trajectory.iter().map(|k| problem.excess_cost(k).max(1e-300).log10());
        exponents.enumerate().map(|(u, exponent)| panel.at(u as f64, exponent)).collect::<Vec<_>>()
    });
    panel.clipped(svg, "trajectories", |svg| {
        lines.iter().enumerate().for_each(|(index, line)| svg.polyline(line, stroke(index)));
    });
    let entries: Vec<_> = schemes.into_iter().enumerate().map(|(i, (name, _))| (stroke(i), name)).collect();
    panel.draw_legend(svg, &entries, &lines);
}

fn draw_radius(svg: &mut Svg, problem: &Problem) {
    let at = |i: usize| i as f64 / OMEGAS as f64;
    let radii: Vec<_> = (0..=OMEGAS).map(|i| (at(i), problem.rho(at(i)))).collect();
    let w = problem.best_damping();
    let damped = spectral_radius(&Scheme::damped(w).sweep_matrix(problem));
    // Larger values show divergence only.
    let most = radii.iter().map(|(_, rho)| *rho).fold(1.25, f64::max).min(2.5);
    let panel = panel(
        svg,
        Place::BottomRight,
        &format!(
            "ω = 0 is SIBR, ω = 1 is IIBR; where ρ of {} updates is below 1, it converges",
            problem.agents()
        ),
        Axis::linear(0.0, 1.0, 5, "ω, weight of the slow agents"),
        Axis::linear(0.0, most, 5, "spectral radius ρ"),
    );
    let line: Vec<_> = radii.iter().map(|(omega, rho)| panel.at(*omega, *rho)).collect();
    let limit = Stroke { colour: GREY, width: 1.4, dashes: "6 5" };
    svg.line(panel.at(0.0, 1.0), panel.at(1.0, 1.0), limit);
    svg.line(panel.at(0.0, damped), panel.at(1.0, damped), Stroke { width: 1.6, ..stroke(3) });
    panel.clipped(svg, "radius", |svg| svg.polyline(&line, Stroke { colour: INK, ..stroke(0) }));

    let (omega, least) = problem.best_omega();
    let mut marks = vec![(omega, least, format!("best: ω = {omega:.4}, ρ = {least:.4}"), stroke(1).colour)];
    if let Some(unstable) = problem.stability_limit() {
        marks.push((unstable, 1.0, format!("unstable from ω = {unstable:.4}"), stroke(2).colour));
    }
    let mut entries = Vec::new();
    for (omega, rho, text, colour) in marks {
        svg.circle(panel.at(omega, rho), 5.5, colour);
        entries.push((Stroke { colour, ..stroke(0) }, text));
    }
    entries.push((stroke(3), format!("all at once, damped: ρ = {damped:.4}")));
    panel.draw_legend(svg, &entries, &[line]);
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::fs;

    use resvg::tiny_skia::Pixmap;

    use super::*;

    #[test]
    fn the_picture_shows_the_gains_the_costs_and_the_radius_with_its_marks() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("estimation.svg");
        estimation_plot(&Problem::PAPER, &out).unwrap();
        let svg = fs::read_to_string(&out).unwrap();
        // One gain at once, three in turn; four costs; one radius.
        assert_eq!(svg.matches("<polyline").count(), 1 + 3 + 4 + 1);
        for text in [
            "3 agents estimate one number (p = 1, q = 1, variance 0.5)",
            "IIBR: best responses all at once",
            "SIBR: one after another",
            "agent 3",
            "two timescales, ω = 0.5",
            "all at once, damped 0.75",
            "all at once, damped: ρ = 0.4219",
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
        estimation_plot(&Problem::PAPER, &out).unwrap();
        let picture = Pixmap::decode_png(&fs::read(&out).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (1200, 800));
        let colours: HashSet<_> = picture.pixels().iter().map(|p| (p.red(), p.green(), p.blue())).collect();
        assert!(colours.len() > 50, "only {} colours", colours.len());
        assert!(matches!(
            estimation_plot(&Problem::PAPER, &folder.path().join("x.gif")),
            Err(Error::Extension { .. })
        ));
    }
}
