//! Blocked rectangles as half-planes of velocities (smaclite §6): how ground units keep off walls.

use super::solve::HalfPlane;
use super::vec2::{is_within, vec2, Vec2};

/// A rectangle of blocked cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Wall {
    /// Lower left, lower right, upper right, upper left.
    corners: [Vec2; 4],
}

/// Of the edges that begin in the corners.
const EDGES: [Vec2; 4] = [vec2(1.0, 0.0), vec2(0.0, 1.0), vec2(-1.0, 0.0), vec2(0.0, -1.0)];

/// Of what counts as covered by a half-plane that is there already.
const COVERED: f64 = -1e-5;

/// A body among walls.
#[derive(Clone, Copy)]
pub(super) struct Body {
    pub at: Vec2,
    pub velocity: Vec2,
    pub radius: f64,
}

impl Wall {
    pub fn new(x: f64, y: f64, width: f64, height: f64) -> Wall {
        let (right, top) = (x + width, y + height);
        Wall { corners: [vec2(x, y), vec2(right, y), vec2(right, top), vec2(x, top)] }
    }

    pub fn is_near(&self, point: Vec2, reach: f64) -> bool {
        let [low, _, high, _] = self.corners;
        let beyond = |at: f64, low: f64, high: f64| {
            let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
            ((at - middle).abs() - half).max(0.0)
        };
        is_within(beyond(point.x, low.x, high.x), beyond(point.y, low.y, high.y), reach)
    }

    /// Adds the half-planes of all edges that this body is outside of to those of other walls.
    pub fn restrict(&self, body: Body, planes: &mut Vec<HalfPlane>) {
        for i in 0..4 {
            if let Some(plane) = self.edge(i, body, planes) {
                planes.push(plane);
            }
        }
    }

    /// The half-plane of one edge. Corners are seen from the body; velocities reach as far as the body goes in a
    /// second, so both are of one scale.
    fn edge(&self, i: usize, body: Body, planes: &[HalfPlane]) -> Option<HalfPlane> {
        let (before, next) = ((i + 3) % 4, (i + 1) % 4);
        let Body { at, velocity, radius: r } = body;
        let (a, b) = (self.corners[i] - at, self.corners[next] - at);
        let along = b - a;
        if a.det(along) >= 0.0 {
            return None;
        }
        let covers =
            |plane: &HalfPlane, corner: Vec2| (corner - plane.point).det(plane.direction) - r >= COVERED;
        if planes.iter().any(|plane| covers(plane, a) && covers(plane, b)) {
            return None;
        }

        let s = -a.dot(along) / along.square();
        let aside = (-a - s * along).square();
        let r2 = r * r;
        let touching = |direction: Vec2| Some(HalfPlane { direction, point: Vec2::ZERO });
        if s < 0.0 && a.square() < r2 {
            return touching(a.left().normalised());
        }
        if s > 1.0 && b.square() <= r2 {
            return if b.det(EDGES[next]) < 0.0 { None } else { touching(b.left().normalised()) };
        }
        if 0.0 < s && s < 1.0 && aside <= r2 {
            return touching(-EDGES[i]);
        }

        // Where the edge is seen from its end, it is one corner.
        let one_corner = !(0.0..=1.0).contains(&s) && aside <= r2;
        let (start, end) = match (one_corner, s < 0.0) {
            (true, true) => ((a, EDGES[i]), (a, EDGES[i])),
            (true, false) => ((b, EDGES[next]), (b, EDGES[next])),
            (false, _) => ((a, EDGES[i]), (b, EDGES[next])),
        };
        let ((a, edge_of_start), (b, edge_of_end)) = (start, end);
        let (mut left, mut right) = (left_leg(a, r), right_leg(b, r));
        let left_is_foreign = left.det(-EDGES[before]) >= 0.0;
        if left_is_foreign {
            left = -EDGES[before];
        }
        let right_is_foreign = right.det(edge_of_end) <= 0.0;
        if right_is_foreign {
            right = edge_of_end;
        }

        let cut = b - a;
        let t = if one_corner { 0.5 } else { (velocity - a).dot(cut) / cut.square() };
        let (t_left, t_right) = ((velocity - a).dot(left), (velocity - b).dot(right));
        let around = |corner: Vec2| {
            let n = (velocity - corner).normalised();
            Some(HalfPlane { direction: n.right(), point: corner + r * n })
        };
        if (t < 0.0 && t_left < 0.0) || (one_corner && t_left < 0.0 && t_right < 0.0) {
            return around(a);
        }
        if t > 1.0 && t_right < 0.0 {
            return around(b);
        }
        let far =
            |is_far: bool, point: Vec2| if is_far { f64::INFINITY } else { (velocity - point).square() };
        let to_cut = far(!(0.0..=1.0).contains(&t) || one_corner, a + t * cut);
        let to_left = far(t_left < 0.0, a + t_left * left);
        let to_right = far(t_right < 0.0, b + t_right * right);
        let (direction, corner, is_foreign) = if to_cut <= to_left && to_cut <= to_right {
            (-edge_of_start, a, false)
        } else if to_left <= to_right {
            (left, a, left_is_foreign)
        } else {
            (-right, b, right_is_foreign)
        };
        (!is_foreign).then(|| HalfPlane { direction, point: corner + offset(direction, r) })
    }
}

/// The same number in both places, as in the reference; the method that it comes from has `(-y, x)`.
fn offset(direction: Vec2, r: f64) -> Vec2 {
    vec2(-r * direction.y, -r * direction.y)
}

/// The tangent from the body to the left side of a disc around a corner.
fn left_leg(c: Vec2, r: f64) -> Vec2 {
    let (l, square) = tangent(c, r);
    vec2((c.x * l - c.y * r) / square, (c.x * r + c.y * l) / square)
}

fn right_leg(c: Vec2, r: f64) -> Vec2 {
    let (l, square) = tangent(c, r);
    vec2((c.x * l + c.y * r) / square, (-c.x * r + c.y * l) / square)
}

/// Its length, and the squared distance of the corner.
fn tangent(c: Vec2, r: f64) -> (f64, f64) {
    let square = c.square();
    // Less than zero only in the moment of touching.
    ((square - r * r).max(0.0).sqrt(), square)
}
