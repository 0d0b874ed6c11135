//! The particle worlds: small bodies that move and push each other on a plane.
//!
//! The rules are in `docs/spec/mpe.md`; comments cite its sections. All randomness is in the reset, unless the opponent
//! acts at random. A step allocates nothing.

mod game;
mod missing;
mod name;
mod network;
mod particles;
pub(crate) mod physics;
mod role;
mod rules;
mod scene;
mod state;
mod team;
mod views;

pub use game::Game;
pub(crate) use game::{Body, Layout, PUSH};
pub use network::{FrozenNetwork, NetworkError};
pub use particles::Particles;
pub use role::{encode, Dense, Role};
pub use rules::Rules;
pub use state::{Agent, State, StateError};
pub use team::{OpponentError, Team};

use name::NameError;

use crate::family::{Family, Made, Refusal, Request};

pub(crate) static FAMILY: Family = Family {
    name: "mpe",
    title: "Particle worlds",
    about: "Bodies push themselves about on a plane, for 25 steps. In Speaker-Listener one agent sees which of three \
            landmarks is the goal and sends one of three words, the other receives it a step later and has to go there. \
            In Adversary two agents know which of two landmarks is the goal; one of them should be there while the \
            opponent, who does not know it, is led away. In Tag three slow predators chase a fast prey, the opponent, \
            between two obstacles, and each is rewarded with 10 for every predator that touches it. Agents see the \
            others relative to themselves and choose between nothing and four directions; the speaker chooses a word.",
    tasks: &["mpe-simple-speaker-listener", "mpe-simple-adversary", "mpe-simple-tag"],
    form: name::FORM,
    rules: &["current", "epymarl", "2021"],
    paper_rules: "2021",
    make,
};

fn make(request: &Request) -> Option<Result<Made, Refusal>> {
    let parsed = name::parse(request.name)?;
    Some(
        parsed
            .map_err(|why| match why {
                NameError::Missing { .. } | NameError::Old { .. } => Refusal::Missing(why.to_string()),
                why => Refusal::Name(why.to_string()),
            })
            .and_then(|(game, rules)| made(game, rules, request)),
    )
}

fn made(game: Game, rules: Rules, request: &Request) -> Result<Made, Refusal> {
    let rules = match request.rules {
        Some(version) => Rules::parse(version).ok_or_else(|| Refusal::Rules(version.to_owned()))?,
        None => rules,
    };
    let world = Team::new(Particles::new(game, rules), request.opponent)
        .map_err(|why| Refusal::Opponent(why.to_string()))?;
    Ok(Made { name: game.name(rules), rules: rules.name(), source: rules.source(), world: Box::new(world) })
}
