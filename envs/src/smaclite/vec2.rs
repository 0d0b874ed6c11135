//! Points, velocities and directions in the plane, in double precision.

use std::ops::{Add, Mul, Neg, Sub};

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Vec2 {
    pub x: f64,
    pub y: f64,
}

pub(super) const fn vec2(x: f64, y: f64) -> Vec2 {
    Vec2 { x, y }
}

impl Vec2 {
    pub const ZERO: Vec2 = vec2(0.0, 0.0);

    pub fn dot(self, other: Vec2) -> f64 {
        self.x * other.x + self.y * other.y
    }

    /// Positive where `other` is to the left of `self`.
    pub fn det(self, other: Vec2) -> f64 {
        self.x * other.y - self.y * other.x
    }

    pub fn square(self) -> f64 {
        self.dot(self)
    }

    pub fn length(self) -> f64 {
        self.square().sqrt()
    }

    /// Of length 1; of nothing, to the right: the reference divides by zero there.
    pub fn normalised(self) -> Vec2 {
        let length = self.length();
        if length > 0.0 {
            vec2(self.x / length, self.y / length)
        } else {
            vec2(1.0, 0.0)
        }
    }

    /// Turned right by a right angle.
    pub fn right(self) -> Vec2 {
        vec2(self.y, -self.x)
    }

    /// Turned left by a right angle.
    pub fn left(self) -> Vec2 {
        vec2(-self.y, self.x)
    }
}

impl Add for Vec2 {
    type Output = Vec2;
    fn add(self, other: Vec2) -> Vec2 {
        vec2(self.x + other.x, self.y + other.y)
    }
}

impl Sub for Vec2 {
    type Output = Vec2;
    fn sub(self, other: Vec2) -> Vec2 {
        vec2(self.x - other.x, self.y - other.y)
    }
}

impl Neg for Vec2 {
    type Output = Vec2;
    fn neg(self) -> Vec2 {
        vec2(-self.x, -self.y)
    }
}

impl Mul<Vec2> for f64 {
    type Output = Vec2;
    fn mul(self, other: Vec2) -> Vec2 {
        vec2(self * other.x, self * other.y)
    }
}

/// Whether something `dx` and `dy` away is within `reach` (smaclite §5).
pub(super) fn is_within(dx: f64, dy: f64, reach: f64) -> bool {
    let (dx, dy) = (dx.abs(), dy.abs());
    dx <= reach && dy <= reach && (dx + dy <= reach || dx * dx + dy * dy <= reach * reach)
}
