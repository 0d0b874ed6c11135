//! A small SVG writer, with output as SVG or as PNG. PNG uses embedded fonts, so that a machine without fonts draws
//! the same picture.

use std::fmt::Write;
use std::fs;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use resvg::{tiny_skia, usvg};

use crate::Error;

/// Browsers use the first one available; PNG uses the embedded first one.
const FONTS: &str = "DejaVu Sans, Verdana, Arial, sans-serif";
/// The same for letters of equal width.
const EVEN_FONTS: &str = "DejaVu Sans Mono, Menlo, Consolas, monospace";

/// Parsed once, because a film has many pictures.
static EMBEDDED: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.load_font_data(dejavu::sans_mono::regular().to_vec());
    Arc::new(fonts)
});

/// Alignment of a text at its position.
#[derive(Clone, Copy)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// A drawing in the making; lengths in pixels, y downwards.
pub struct Svg {
    width: u32,
    height: u32,
    body: String,
}

/// How a line is drawn: colour, width in pixels, dashes as in SVG (empty: solid).
#[derive(Clone, Copy)]
pub struct Stroke<'a> {
    pub colour: &'a str,
    pub width: f64,
    pub dashes: &'a str,
}

impl Svg {
    pub fn new(width: u32, height: u32) -> Self {
        let mut svg = Self { width, height, body: String::new() };
        svg.rect((0.0, 0.0), (f64::from(width), f64::from(height)), "#ffffff", 1.0);
        svg
    }

    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), stroke: Stroke) {
        self.push(format_args!(
            r#"<line x1="{:.2}" y1="{:.2}" x2="{:.2}" y2="{:.2}" {}/>"#,
            from.0,
            from.1,
            to.0,
            to.1,
            paint(stroke)
        ));
    }

    pub fn polyline(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        self.push(format_args!(
            r#"<polyline points="{}" fill="none" stroke-linejoin="round" stroke-linecap="round" {}/>"#,
            path(points),
            paint(stroke)
        ));
    }

    pub fn polygon(&mut self, points: &[(f64, f64)], fill: &str, opacity: f64) {
        self.push(format_args!(
            r#"<polygon points="{}" fill="{fill}" fill-opacity="{opacity}"/>"#,
            path(points)
        ));
    }

    pub fn rect(&mut self, corner: (f64, f64), size: (f64, f64), fill: &str, opacity: f64) {
        self.push(format_args!(
            r#"<rect x="{:.2}" y="{:.2}" width="{:.2}" height="{:.2}" fill="{fill}" fill-opacity="{opacity}"/>"#,
            corner.0, corner.1, size.0, size.1
        ));
    }

    pub fn circle(&mut self, centre: (f64, f64), radius: f64, fill: &str) {
        self.push(format_args!(
            r#"<circle cx="{:.2}" cy="{:.2}" r="{radius}" fill="{fill}"/>"#,
            centre.0, centre.1
        ));
    }

    /// `at` is on the text's base line.
    pub fn text(&mut self, at: (f64, f64), size: f64, colour: &str, anchor: Anchor, text: &str) {
        self.place_text(at, size, colour, anchor, text, "");
    }

    /// Like [`Svg::text`] from its start, in letters of equal width: 0.602 of `size`.
    pub fn even_text(&mut self, at: (f64, f64), size: f64, colour: &str, text: &str) {
        let font = format!(r#" font-family="{EVEN_FONTS}""#);
        self.place_text(at, size, colour, Anchor::Start, text, &font);
    }

    /// Reads from the bottom up, centred on `at`.
    pub fn vertical_text(&mut self, at: (f64, f64), size: f64, colour: &str, text: &str) {
        let turn = format!(r#" transform="rotate(-90 {:.2} {:.2})""#, at.0, at.1);
        self.place_text(at, size, colour, Anchor::Middle, text, &turn);
    }

    fn place_text(
        &mut self,
        at: (f64, f64),
        size: f64,
        colour: &str,
        anchor: Anchor,
        text: &str,
        attributes: &str,
    ) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.push(format_args!(
            r#"<text x="{:.2}" y="{:.2}" font-size="{size}" fill="{colour}" text-anchor="{anchor}"{attributes}>{}</text>"#,
            at.0,
            at.1,
            escape(text)
        ));
    }

    /// Draws what `inner` draws, but only inside the rectangle.
    pub fn clipped(&mut self, id: &str, corner: (f64, f64), size: (f64, f64), inner: impl FnOnce(&mut Self)) {
        self.push(format_args!(
            r#"<clipPath id="{id}"><rect x="{:.2}" y="{:.2}" width="{:.2}" height="{:.2}"/></clipPath>"#,
            corner.0, corner.1, size.0, size.1
        ));
        self.push(format_args!(r##"<g clip-path="url(#{id})">"##));
        inner(self);
        self.push(format_args!("</g>"));
    }

    /// The whole SVG document.
    pub fn document(&self) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" \
             viewBox=\"0 0 {w} {h}\" font-family=\"{FONTS}\">\n{}</svg>\n",
            self.body,
            w = self.width,
            h = self.height,
        )
    }

    /// The drawing in pixels, all of them opaque; or the error.
    pub fn rasterise(&self) -> Result<tiny_skia::Pixmap, String> {
        let options = usvg::Options { fontdb: EMBEDDED.clone(), ..usvg::Options::default() };
        let tree = usvg::Tree::from_str(&self.document(), &options).map_err(|error| error.to_string())?;
        let mut pixels = tiny_skia::Pixmap::new(self.width, self.height)
            .ok_or_else(|| format!("a picture cannot have {} x {} pixels", self.width, self.height))?;
        resvg::render(&tree, tiny_skia::Transform::identity(), &mut pixels.as_mut());
        Ok(pixels)
    }

    /// Writes the picture in the format of the extension of `out`. Missing folders are made.
    pub fn save(self, out: &Path) -> Result<(), Error> {
        let bytes = match Format::of(out)? {
            Format::Svg => self.document().into_bytes(),
            Format::Png => self
                .rasterise()
                .and_then(|pixels| pixels.encode_png().map_err(|error| error.to_string()))
                .map_err(|problem| Error::Raster { path: out.to_owned(), problem })?,
        };
        write(out, &bytes)
    }

    fn push(&mut self, element: std::fmt::Arguments) {
        writeln!(self.body, "{element}").expect("writing to a String does not fail");
    }
}

/// Writes a file; missing folders are made.
pub fn write(out: &Path, bytes: &[u8]) -> Result<(), Error> {
    let failed = |source| Error::Write { path: out.to_owned(), source };
    if let Some(folder) = out.parent() {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    fs::write(out, bytes).map_err(failed)
}

/// The format of a file name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Format {
    Svg,
    Png,
}

impl Format {
    pub fn of(out: &Path) -> Result<Self, Error> {
        match out.extension().map(|extension| extension.to_ascii_lowercase()) {
            Some(extension) if extension == "svg" => Ok(Self::Svg),
            Some(extension) if extension == "png" => Ok(Self::Png),
            _ => Err(Error::Extension { path: out.to_owned() }),
        }
    }
}

fn path(points: &[(f64, f64)]) -> String {
    points.iter().map(|(x, y)| format!("{x:.2},{y:.2}")).collect::<Vec<_>>().join(" ")
}

fn paint(stroke: Stroke) -> String {
    let dashes = match stroke.dashes {
        "" => String::new(),
        dashes => format!(r#" stroke-dasharray="{dashes}""#),
    };
    format!(r#"stroke="{}" stroke-width="{}"{dashes}"#, stroke.colour, stroke.width)
}

/// Control characters, which XML does not allow, become spaces.
fn escape(text: &str) -> String {
    let text = text.replace(|c: char| c.is_control(), " ");
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_name_says_the_kind_of_picture() {
        assert_eq!(Format::of(Path::new("a/b.PNG")).unwrap(), Format::Png);
        assert_eq!(Format::of(Path::new("b.svg")).unwrap(), Format::Svg);
        let message = Format::of(Path::new("plots/b.pdf")).unwrap_err().to_string();
        assert_eq!(message, "unknown picture format in plots/b.pdf; end the name in .svg or .png");
        assert!(Format::of(Path::new("svg")).is_err());
    }

    #[test]
    fn texts_cannot_break_the_document() {
        assert_eq!(escape("a<b> & \u{1}c"), "a&lt;b&gt; &amp;  c");
    }
}
