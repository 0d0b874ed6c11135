//! Learning curves as a picture: for each group the mean over seeds and a band of one standard
//! error to either side, as the paper draws them (algorithms §8.3).

use std::path::Path;

use crate::chart::{stroke, Axis, Panel, GREY, HEIGHT, INK, WIDTH};
use crate::stats::{mean_curve, MeanPoint};
use crate::svg::{Anchor, Format, Svg};
use crate::{Error, Group};

/// Texts and options of the picture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlotOptions {
    pub title: String,
    /// Name of the vertical axis.
    pub metric: String,
    /// Window of the centred moving average in test points; 0 or 1 for none. The paper uses 5.
    pub smooth: usize,
    /// Last environment step to show; everything if `None`.
    pub x_max: Option<f64>,
}

/// Draws `groups`, one line each, into `out` (`.svg` or `.png`, 1200 by 800 pixels).
///
/// Needs no font of the machine. Missing folders of `out` are made.
///
/// # Errors
/// [`Error::Extension`] for another kind of file, [`Error::Empty`] if no group has a point up to
/// `x_max`, [`Error::Write`], [`Error::Raster`].
pub fn plot(groups: &[Group], options: &PlotOptions, out: &Path) -> Result<(), Error> {
    // First, so that a wrong name is reported at once.
    Format::of(out)?;
    let x_max = options.x_max.unwrap_or(f64::INFINITY);
    let curves: Vec<Vec<MeanPoint>> =
        groups.iter().map(|group| mean_curve(&group.curves, options.smooth)).collect();
    let shown = || curves.iter().flatten().filter(|point| point.t_env <= x_max);
    if shown().next().is_none() {
        let limit = options.x_max.map_or(String::new(), |x_max| format!(" up to step {x_max}"));
        return Err(Error::Empty(format!(
            "the {} groups have no point of `{}`{limit}",
            groups.len(),
            options.metric
        )));
    }

    let last = shown().map(|point| point.t_env).fold(0.0, f64::max);
    let low = shown().map(|point| point.mean - error(point)).fold(f64::INFINITY, f64::min);
    let high = shown().map(|point| point.mean + error(point)).fold(f64::NEG_INFINITY, f64::max);
    let panel = Panel {
        left: 104.0,
        top: 92.0,
        width: f64::from(WIDTH) - 104.0 - 40.0,
        height: f64::from(HEIGHT) - 92.0 - 84.0,
        x: Axis::linear(
            0.0,
            options.x_max.filter(|x_max| x_max.is_finite()).unwrap_or(last),
            8,
            "environment steps",
        ),
        y: Axis::linear(low - 0.04 * (high - low), high + 0.04 * (high - low), 7, &options.metric),
    };

    let mut svg = Svg::new(WIDTH, HEIGHT);
    svg.text((panel.left, 42.0), 23.0, INK, Anchor::Start, &options.title);
    svg.text((panel.left, 70.0), 15.0, GREY, Anchor::Start, &subtitle(options.smooth));
    panel.draw_axes(&mut svg);
    let line = |points: &[MeanPoint], side: f64| -> Vec<(f64, f64)> {
        points.iter().map(|point| panel.at(point.t_env, point.mean + side * error(point))).collect()
    };
    panel.clipped(&mut svg, "curves", |svg| {
        for (index, points) in curves.iter().enumerate() {
            let mut outline = line(points, 1.0);
            outline.extend(line(points, -1.0).into_iter().rev());
            if points.iter().any(|point| error(point) > 0.0) {
                svg.polygon(&outline, stroke(index).colour, 0.16);
            }
        }
        for (index, points) in curves.iter().enumerate() {
            let means = line(points, 0.0);
            svg.polyline(&means, stroke(index));
            // A single point is not a line; few points are drawn as dots.
            if points.len() <= 12 {
                means.iter().for_each(|at| svg.circle(*at, 4.0, stroke(index).colour));
            }
        }
    });
    let entries: Vec<_> = (groups.iter().zip(&curves).enumerate())
        .map(|(index, (group, points))| (stroke(index), format!("{} ({})", group.label, seeds(points))))
        .collect();
    let lines: Vec<_> =
        curves.iter().flat_map(|points| [-1.0, 0.0, 1.0].map(|side| line(points, side))).collect();
    panel.draw_legend(&mut svg, &entries, &lines);
    svg.save(out)
}

/// Half the height of the band.
fn error(point: &MeanPoint) -> f64 {
    point.standard_error.unwrap_or(0.0)
}

fn subtitle(smooth: usize) -> String {
    let window = smooth / 2 * 2 + 1;
    let smoothing = if window > 1 { format!("; smoothed over {window} test points") } else { String::new() };
    format!("mean over seeds, band: ± one standard error{smoothing}")
}

/// `5 seeds`, or `3–5 seeds` if some runs are shorter than others.
fn seeds(points: &[MeanPoint]) -> String {
    let counts = || points.iter().map(|point| point.seeds);
    match (counts().min().unwrap_or(0), counts().max().unwrap_or(0)) {
        (1, 1) => "1 seed".to_owned(),
        (least, most) if least == most => format!("{most} seeds"),
        (least, most) => format!("{least}–{most} seeds"),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::fs;

    use resvg::tiny_skia::Pixmap;

    use super::*;
    use crate::runs::tests::curve;

    fn groups() -> Vec<Group> {
        let points = |shift: f64| [(0, shift), (10_000, 1.0 + shift), (20_000, 3.0 - shift)];
        vec![
            Group {
                label: "ippo <1e-4>".to_owned(),
                curves: vec![
                    curve("a", 1, &points(0.0)),
                    curve("a", 2, &points(0.5)),
                    curve("a", 3, &points(0.2)[..2]),
                ],
            },
            Group { label: "mtppo".to_owned(), curves: vec![curve("b", 1, &points(1.0))] },
        ]
    }

    fn options() -> PlotOptions {
        PlotOptions {
            title: "Lärning & more".into(),
            metric: "test_return_mean".into(),
            ..Default::default()
        }
    }

    fn count(text: &str, part: &str) -> usize {
        text.matches(part).count()
    }

    #[test]
    fn the_svg_has_a_line_per_group_a_band_where_there_are_seeds_and_a_legend_that_counts_them() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/folder/curves.svg");
        plot(&groups(), &options(), &out).unwrap();
        let svg = fs::read_to_string(out).unwrap();
        assert_eq!((count(&svg, "<polyline"), count(&svg, "<polygon")), (2, 1));
        for text in
            ["ippo &lt;1e-4&gt; (2–3 seeds)", "mtppo (1 seed)", "Lärning &amp; more", "test_return_mean"]
        {
            assert_eq!(count(&svg, &format!(">{text}</text>")), 1, "{text}");
        }
        assert_eq!(count(&svg, ">environment steps</text>"), 1);
        assert_eq!((count(&svg, ">20k</text>"), count(&svg, ">0</text>")), (1, 2));
        assert!(svg.contains("band: ± one standard error</text>"));
    }

    #[test]
    fn the_png_has_the_stated_size_and_shows_both_colours_and_text() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("curves.png");
        plot(&groups(), &options(), &out).unwrap();
        let picture = Pixmap::decode_png(&fs::read(&out).unwrap()).unwrap();
        assert_eq!((picture.width(), picture.height()), (1200, 800));
        let colour =
            |pixel: &resvg::tiny_skia::PremultipliedColorU8| (pixel.red(), pixel.green(), pixel.blue());
        let colours: HashSet<_> = picture.pixels().iter().map(colour).collect();
        assert!(colours.contains(&(0x00, 0x72, 0xB2)) && colours.contains(&(0xD5, 0x5E, 0x00)));
        // The title is the only thing in its strip, so ink there means that the font was found.
        let title = &picture.pixels()[20 * 1200..45 * 1200];
        assert!(title.iter().filter(|pixel| pixel.red() < 100).count() > 200);
        assert!(colours.len() > 50, "only {} colours", colours.len());
    }

    #[test]
    fn x_max_ends_the_axis_and_what_lies_beyond_does_not_stretch_the_other() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("curves.svg");
        let far = Group {
            label: "far".into(),
            curves: vec![curve("a", 1, &[(0, 0.0), (4_000, 1.0), (9_000, 500.0)])],
        };
        plot(&[far], &PlotOptions { x_max: Some(5_000.0), smooth: 4, ..options() }, &out).unwrap();
        let svg = fs::read_to_string(out).unwrap();
        assert_eq!((count(&svg, ">5k</text>"), count(&svg, ">6k</text>")), (1, 0));
        assert!(svg.contains("smoothed over 5 test points"), "an even window is the next odd one");
    }

    #[test]
    fn more_groups_than_colours_are_told_apart_by_dashes() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("curves.svg");
        let many: Vec<_> = (0..9)
            .map(|i| Group {
                label: format!("g{i}"),
                curves: vec![curve("a", 1, &[(0, f64::from(i)), (10, 1.0)])],
            })
            .collect();
        plot(&many, &options(), &out).unwrap();
        let svg = fs::read_to_string(out).unwrap();
        let lines = || svg.lines().filter(|line| line.starts_with("<polyline"));
        assert_eq!(lines().filter(|line| line.contains("stroke-dasharray=\"9 6\"")).count(), 2);
        let strokes: HashSet<_> = lines().map(|line| &line[line.find("stroke=").unwrap()..]).collect();
        assert_eq!(strokes.len(), 9);
    }

    #[test]
    fn a_picture_of_nothing_or_of_an_unknown_kind_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = plot(&groups(), &options(), &folder.path().join("curves.pdf")).unwrap_err();
        assert!(matches!(error, Error::Extension { .. }), "{error}");
        let out = folder.path().join("curves.png");
        let error = plot(&[], &options(), &out).unwrap_err().to_string();
        assert_eq!(error, "nothing to draw: the 0 groups have no point of `test_return_mean`");
        let error =
            plot(&groups(), &PlotOptions { x_max: Some(-1.0), ..options() }, &out).unwrap_err().to_string();
        assert!(error.ends_with("the 2 groups have no point of `test_return_mean` up to step -1"), "{error}");
        assert!(!out.exists());
    }
}
