//! The velocity nearest to the wanted one that no half-plane forbids (smaclite §7).

use super::vec2::Vec2;

/// Allowed are the velocities to the left of a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct HalfPlane {
    /// Of length 1.
    pub direction: Vec2,
    pub point: Vec2,
}

impl HalfPlane {
    /// How far a velocity is on the forbidden side.
    fn violation(&self, v: Vec2) -> f64 {
        self.direction.det(self.point - v)
    }
}

/// What to look for.
#[derive(Clone, Copy)]
enum Aim {
    /// The velocity nearest to this one.
    Point(Vec2),
    /// The velocity farthest in this direction, of length 1.
    Direction(Vec2),
}

/// Lines that are as good as parallel.
const PARALLEL: f64 = 1e-5;

/// The velocity of at most `max_speed` nearest to `wanted`. The first `fixed` half-planes are walls; where not all can
/// be kept, the others give way by as little as possible. `scratch` holds nothing that lasts.
pub(super) fn solve(
    planes: &[HalfPlane],
    fixed: usize,
    max_speed: f64,
    wanted: Vec2,
    scratch: &mut Vec<HalfPlane>,
) -> Vec2 {
    let (mut v, stopped) = plan(planes, max_speed, Aim::Point(wanted));
    let Some(first) = stopped else { return v };
    let mut worst = 0.0;
    for (i, plane) in planes.iter().enumerate().skip(first) {
        if plane.violation(v) <= worst {
            continue;
        }
        scratch.clear();
        scratch.extend_from_slice(&planes[..fixed]);
        scratch.extend(planes[..i].iter().skip(fixed).filter_map(|other| between(plane, other)));
        if let (better, None) = plan(scratch, max_speed, Aim::Direction(plane.direction.left())) {
            v = better;
        }
        worst = plane.violation(v);
    }
    v
}

/// Where two half-planes are violated alike; none where one contains the other.
fn between(plane: &HalfPlane, other: &HalfPlane) -> Option<HalfPlane> {
    let den = plane.direction.det(other.direction);
    let point = if den.abs() > PARALLEL {
        plane.point + other.direction.det(plane.point - other.point) / den * plane.direction
    } else if plane.direction.dot(other.direction) > 0.0 {
        return None;
    } else {
        0.5 * (plane.point + other.point)
    };
    Some(HalfPlane { direction: (other.direction - plane.direction).normalised(), point })
}

/// Takes in one half-plane after the other. Where one cannot be kept: its number, and the velocity before it.
fn plan(planes: &[HalfPlane], max_speed: f64, aim: Aim) -> (Vec2, Option<usize>) {
    let mut v = match aim {
        Aim::Direction(direction) => max_speed * direction,
        Aim::Point(wanted) if wanted.square() > max_speed * max_speed => max_speed * wanted.normalised(),
        Aim::Point(wanted) => wanted,
    };
    for (i, plane) in planes.iter().enumerate() {
        if plane.violation(v) <= 0.0 {
            continue;
        }
        match along(plane, &planes[..i], max_speed, aim) {
            Some(better) => v = better,
            None => return (v, Some(i)),
        }
    }
    (v, None)
}

/// The best velocity on the edge of a half-plane that the others allow.
fn along(plane: &HalfPlane, others: &[HalfPlane], max_speed: f64, aim: Aim) -> Option<Vec2> {
    let HalfPlane { direction, point } = *plane;
    let h = point.dot(direction);
    let k = h * h + max_speed * max_speed - point.square();
    if k < 0.0 {
        return None;
    }
    let (mut low, mut high) = (-h - k.sqrt(), -h + k.sqrt());
    for other in others {
        let den = direction.det(other.direction);
        let num = other.direction.det(point - other.point);
        if den.abs() < PARALLEL {
            if num < 0.0 {
                return None;
            }
            continue;
        }
        let t = num / den;
        if den >= 0.0 {
            high = high.min(t);
        } else {
            low = low.max(t);
        }
        if low > high {
            return None;
        }
    }
    let t = match aim {
        Aim::Direction(aim) if aim.dot(direction) > 0.0 => high,
        Aim::Direction(_) => low,
        // Not `clamp`, which wants to be sure that `low` is a number.
        Aim::Point(wanted) => direction.dot(wanted - point).max(low).min(high),
    };
    Some(point + t * direction)
}
