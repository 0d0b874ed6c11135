//! The picture of a world as flat coloured shapes. Worlds describe it; `monitor` draws it.

/// A picture in the world's own units: x to the right, y **downwards**, the upper left corner at (0, 0). Shapes
/// are painted in order, later ones over earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    pub width: f64,
    pub height: f64,
    pub background: Colour,
    pub shapes: Vec<Shape>,
    /// In a few words, what the picture does not show: messages, goals, deliveries so far.
    pub caption: String,
}

/// One shape; lengths and places are in the units of its [`Scene`].
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// Upper left corner and size.
    Rectangle {
        x: f64,
        y: f64,
        width: f64,
        height: f64,
        fill: Colour,
    },
    Circle {
        x: f64,
        y: f64,
        radius: f64,
        fill: Colour,
    },
    Line {
        from: (f64, f64),
        to: (f64, f64),
        width: f64,
        colour: Colour,
    },
    Polygon {
        corners: Vec<(f64, f64)>,
        fill: Colour,
    },
    /// Centred on its place; `size` is the height of the letters' line.
    Text {
        x: f64,
        y: f64,
        size: f64,
        text: String,
        colour: Colour,
    },
}

/// Red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    pub const PAPER: Colour = Colour(250, 250, 247);
    pub const GRID: Colour = Colour(214, 214, 206);
    pub const INK: Colour = Colour(40, 44, 52);
    pub const WHITE: Colour = Colour(255, 255, 255);

    /// Colours for agents by number, also for most people with red-green colour blindness; they repeat after eight.
    pub fn of_agent(agent: usize) -> Colour {
        const AGENTS: [Colour; 8] = [
            Colour(0, 114, 178),
            Colour(213, 94, 0),
            Colour(0, 158, 115),
            Colour(204, 121, 167),
            Colour(86, 180, 233),
            Colour(148, 103, 40),
            Colour(110, 80, 160),
            Colour(90, 90, 90),
        ];
        AGENTS[agent % AGENTS.len()]
    }
}
