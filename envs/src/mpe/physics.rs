//! Contact forces and movement (mpe §5). The order of operations is that of the reference, so that equal starts give
//! equal numbers.

use super::game::Body;
use super::Rules;

/// Seconds per step.
pub(crate) const DT: f64 = 0.1;
/// Share of its velocity that a particle loses per step.
pub(crate) const DAMPING: f64 = 0.25;
pub(crate) const CONTACT_FORCE: f64 = 100.0;
/// Softness of contacts, `k` of mpe §5.2.
pub(crate) const CONTACT_MARGIN: f64 = 0.001;

/// Below this `exp` is exactly 0, and so is the contact force.
const EXP_UNDERFLOW: f64 = -746.0;

/// Where an agent is and how fast it moves.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Particle {
    pub pos: [f64; 2],
    pub vel: [f64; 2],
}

/// The vector from `b` to `a`.
pub(super) fn from_to(b: [f64; 2], a: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn squared(d: [f64; 2]) -> f64 {
    d[0] * d[0] + d[1] * d[1]
}

pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    squared(from_to(b, a)).sqrt()
}

/// The contact force of the particle at `b` on the one at `a`, whose radii add up to `touching`; the force on
/// `b` is its negative. `None` where it is exactly 0.
///
/// Coinciding centres push nowhere. In the reference they give NaN, with probability 0.
pub(super) fn contact_force(a: [f64; 2], b: [f64; 2], touching: f64) -> Option<[f64; 2]> {
    let delta = from_to(b, a);
    let dist = squared(delta).sqrt();
    let z = -(dist - touching) / CONTACT_MARGIN;
    if z < EXP_UNDERFLOW || dist == 0.0 {
        return None;
    }
    let penetration = softplus(z) * CONTACT_MARGIN;
    Some(delta.map(|delta| CONTACT_FORCE * delta / dist * penetration))
}

/// `ln(1 + exp(z))` without overflow. Computed in Rust, because a platform's own `exp` may round differently.
fn softplus(z: f64) -> f64 {
    if z == 0.0 {
        std::f64::consts::LN_2
    } else if z > 0.0 {
        z + libm::log1p(libm::exp(-z))
    } else {
        libm::log1p(libm::exp(z))
    }
}

/// Moves a particle by one step under `force`.
pub(super) fn integrate(particle: &mut Particle, force: [f64; 2], body: &Body, rules: Rules) {
    // Before the velocity changes, so an action affects the position one step later; in the study's code after it
    // (mpe §9).
    if rules != Rules::Study2021 {
        drift(particle);
    }
    for (vel, force) in particle.vel.iter_mut().zip(force) {
        *vel = *vel * (1.0 - DAMPING) + force * DT;
    }
    if let Some(most) = body.max_speed {
        let speed = squared(particle.vel).sqrt();
        if speed > most {
            particle.vel = particle.vel.map(|vel| vel / speed * most);
        }
    }
    if rules == Rules::Study2021 {
        drift(particle);
    }
}

fn drift(particle: &mut Particle) {
    for (pos, vel) in particle.pos.iter_mut().zip(particle.vel) {
        *pos += vel * DT;
    }
}
