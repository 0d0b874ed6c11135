//! The seats of a team: which agents may join, the common round to start from, and which agents are present.

use std::time::{Duration, Instant};

use bus::{Event, Query};
use proto::codec::{decode, encode, WireError};
use proto::config::Config;
use proto::control::{Join, Refusal, Seat, Welcome};
use proto::keys::{Key, Keys};

/// The seats of the team, before and during the run.
pub struct Seats {
    digest: [u8; 32],
    seats: Vec<SeatState>,
    /// Rounds that the env-server itself can start from.
    own_rounds: Vec<u64>,
    /// Set once all have joined.
    granted: Option<Vec<Seat>>,
    closing: bool,
}

#[derive(Default)]
struct SeatState {
    nonce: Option<u64>,
    checkpoints: Vec<u64>,
    /// The request of an agent that waits for the others.
    waiting: Option<Query>,
    present: bool,
    gone_since: Option<Instant>,
}

impl Seats {
    /// Empty seats for the configured team. `own_rounds` are those that the env-server can start from.
    pub fn new(config: &Config, own_rounds: Vec<u64>) -> Self {
        let seats = (0..config.world.agents).map(|_| SeatState::default()).collect();
        Self { digest: config.digest(), seats, own_rounds, granted: None, closing: false }
    }

    /// Processes requests to join and changes of agents' tokens. Returns every other event.
    pub fn hear(&mut self, keys: &Keys, event: Event) -> Option<Event> {
        let key = match &event {
            Event::Query(Query { key, .. }) | Event::Alive { key } | Event::Gone { key } => keys.parse(key),
            Event::Message { .. } | Event::Stop => None,
        };
        match (event, key) {
            (Event::Query(query), Some(Key::Join(id))) => self.ask(id, query),
            (Event::Alive { .. }, Some(Key::AliveAgent(id))) => self.came(id),
            (Event::Gone { .. }, Some(Key::AliveAgent(id))) => self.went(id),
            // The other tokens of the run, also the env-server's own.
            (Event::Alive { .. } | Event::Gone { .. }, _) => {}
            (other, _) => return Some(other),
        }
        None
    }

    /// Processes a request to join seat `id`: refuses it, holds it until the team is complete, or answers it.
    fn ask(&mut self, id: u32, query: Query) {
        match self.admit(id, &query.payload) {
            Err(refusal) => {
                tracing::warn!(agent = id, %refusal, "refused a seat");
                answer(query, &Welcome::Refused(refusal));
            }
            Ok(()) => match &self.granted {
                Some(granted) => {
                    let seat = granted[id as usize];
                    answer(query, &Welcome::Seat(seat));
                }
                None => {
                    if self.seats[id as usize].waiting.replace(query).is_none() {
                        tracing::info!(agent = id, "joined");
                    }
                }
            },
        }
    }

    fn admit(&mut self, id: u32, payload: &[u8]) -> Result<(), Refusal> {
        let agents = self.seats.len() as u32;
        let join = decode::<Join>(payload).map_err(|error| match error {
            WireError::Version { ours, theirs } => Refusal::Version { ours, theirs },
            other => Refusal::malformed(other),
        })?;
        if self.closing {
            return Err(Refusal::Closing);
        }
        let seat = self.seats.get_mut(id as usize).ok_or(Refusal::IdOutOfRange { id, agents })?;
        if join.config_digest != self.digest {
            return Err(Refusal::Config { ours: self.digest, theirs: join.config_digest });
        }
        match seat.nonce {
            // The process with this seat is gone. Only the same process may come back.
            Some(nonce) if nonce != join.nonce && seat.gone_since.is_some() => Err(Refusal::Closing),
            Some(nonce) if nonce != join.nonce => Err(Refusal::IdTaken { id }),
            _ => {
                (seat.nonce, seat.checkpoints) = (Some(join.nonce), join.checkpoints);
                Ok(())
            }
        }
    }

    /// Agents in the team.
    pub fn team_size(&self) -> usize {
        self.seats.len()
    }

    /// Seats whose agent has not requested to join.
    pub fn not_joined(&self) -> Vec<usize> {
        (0..self.seats.len()).filter(|&id| self.seats[id].nonce.is_none()).collect()
    }

    /// Seats whose agent's token is absent.
    pub fn absent(&self) -> Vec<usize> {
        (0..self.seats.len()).filter(|&id| !self.seats[id].present).collect()
    }

    /// The latest round that all processes can start from. It is 0, the beginning, for a new run, and after an
    /// incomplete first save: then no process holds more than one checkpoint, and all agents had a seat before.
    ///
    /// # Errors
    /// Which process holds which rounds, if starting at 0 would discard work.
    pub fn common_round(&self) -> Result<u64, String> {
        let everybody = || std::iter::once(&self.own_rounds).chain(self.seats.iter().map(|s| &s.checkpoints));
        let held_by_all = |round: &&u64| everybody().all(|rounds| rounds.contains(round));
        let common = self.own_rounds.iter().filter(held_by_all).max();
        let is_new = everybody().flatten().all(|&round| round == 0);
        let first_save_cut_short = common == Some(&0) && everybody().all(|rounds| rounds.len() <= 2);
        match common {
            Some(&round) if round > 0 => Ok(round),
            _ if is_new || first_save_cut_short => Ok(0),
            _ => Err(self.who_holds_what()),
        }
    }

    /// The rounds of every process, in words.
    fn who_holds_what(&self) -> String {
        let agents =
            self.seats.iter().enumerate().map(|(id, seat)| (format!("agent {id}"), &seat.checkpoints));
        let everybody = std::iter::once(("env-server".to_owned(), &self.own_rounds)).chain(agents);
        let texts = everybody.map(|(name, rounds)| {
            let rounds: Vec<String> = rounds.iter().filter(|&&round| round > 0).map(u64::to_string).collect();
            let rounds = if rounds.is_empty() { "none".to_owned() } else { rounds.join(" and ") };
            format!("{name}: {rounds}")
        });
        texts.collect::<Vec<_>>().join(", ")
    }

    /// Refuses all waiting agents and accepts no more.
    pub fn refuse(&mut self, refusal: &Refusal) {
        for state in &mut self.seats {
            if let Some(query) = state.waiting.take() {
                answer(query, &Welcome::Refused(refusal.clone()));
            }
        }
        self.closing = true;
    }

    /// Grants all seats and answers all waiting agents.
    pub fn grant(&mut self, seats: Vec<Seat>) {
        for (state, seat) in self.seats.iter_mut().zip(&seats) {
            if let Some(query) = state.waiting.take() {
                answer(query, &Welcome::Seat(*seat));
            }
        }
        self.granted = Some(seats);
    }

    /// Accepts no more agents.
    pub fn close(&mut self) {
        self.closing = true;
    }

    /// The token of an agent has appeared.
    fn came(&mut self, id: u32) {
        if let Some(seat) = self.seats.get_mut(id as usize) {
            (seat.present, seat.gone_since) = (true, None);
        }
    }

    /// The token of an agent has vanished.
    fn went(&mut self, id: u32) {
        if let Some(seat) = self.seats.get_mut(id as usize) {
            (seat.present, seat.gone_since) = (false, Some(Instant::now()));
        }
    }

    /// The agent that has been gone for longest among those with `waited_for`, and the end of its `grace`.
    pub fn next_loss(&self, grace: Duration, waited_for: impl Fn(usize) -> bool) -> Option<(usize, Instant)> {
        let gone = self.seats.iter().enumerate().filter(|(id, _)| waited_for(*id));
        gone.filter_map(|(id, seat)| Some((id, seat.gone_since? + grace))).min_by_key(|(_, when)| *when)
    }
}

fn answer(query: Query, welcome: &Welcome) {
    match encode(welcome) {
        Ok(bytes) => query.reply(&bytes),
        Err(error) => tracing::error!(%error, "cannot answer a request to join"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::config::AlgoName;
    use proto::presets::{config, Family};

    fn seats(own: &[u64], theirs: &[&[u64]]) -> Seats {
        let config = config("test", "any", theirs.len() as u32, AlgoName::Ippo, Family::Lbf);
        let mut seats = Seats::new(&config, own.to_vec());
        for (id, rounds) in theirs.iter().enumerate() {
            let join =
                Join { config_digest: config.digest(), nonce: id as u64, checkpoints: rounds.to_vec() };
            seats.admit(id as u32, &encode(&join).expect("fits")).expect("admitted");
        }
        seats
    }

    #[test]
    fn everybody_starts_from_the_latest_round_that_everybody_holds() {
        let both = |theirs: &[u64]| [theirs.to_vec(), theirs.to_vec()];
        let common =
            |own: &[u64], theirs: [Vec<u64>; 2]| seats(own, &[&theirs[0], &theirs[1]]).common_round();
        assert_eq!(common(&[0, 100, 200], both(&[0, 100, 200])), Ok(200));
        assert_eq!(common(&[0, 100, 200], [vec![0, 100, 200], vec![0, 50, 100]]), Ok(100));
        assert_eq!(common(&[0, 100], both(&[0, 100, 200])), Ok(100));
        assert_eq!(common(&[], both(&[])), Ok(0), "a new run");
        assert_eq!(common(&[0], both(&[0])), Ok(0), "ended before the first save");
        assert_eq!(common(&[0], [vec![0], vec![]]), Ok(0), "nothing is lost by a new folder");
    }

    #[test]
    fn a_first_save_that_was_cut_short_starts_from_the_beginning() {
        assert_eq!(seats(&[0, 100], &[&[0], &[0, 100]]).common_round(), Ok(0));
        assert_eq!(seats(&[0], &[&[0, 100], &[0, 100]]).common_round(), Ok(0));
    }

    #[test]
    fn a_start_that_would_throw_work_away_is_refused_and_names_who_holds_what() {
        let refused = |own: &[u64], theirs: &[&[u64]]| seats(own, theirs).common_round().unwrap_err();
        assert_eq!(
            refused(&[0, 17], &[&[0, 17], &[]]),
            "env-server: 17, agent 0: 17, agent 1: none",
            "a new folder is not one that began this run"
        );
        assert_eq!(refused(&[], &[&[0, 17], &[0, 17]]), "env-server: none, agent 0: 17, agent 1: 17");
        assert_eq!(
            refused(&[0, 100, 200], &[&[0, 100, 200], &[0]]),
            "env-server: 100 and 200, agent 0: 100 and 200, agent 1: none"
        );
        assert_eq!(refused(&[200], &[&[200], &[100]]), "env-server: 200, agent 0: 200, agent 1: 100");
    }

    #[test]
    fn a_seat_is_refused_to_another_process_configuration_or_number() {
        let mut seats = seats(&[], &[&[], &[]]);
        let digest = seats.digest;
        let mut ask = |id, nonce, config_digest| {
            let join = Join { config_digest, nonce, checkpoints: vec![] };
            seats.admit(id, &encode(&join).expect("fits"))
        };
        assert_eq!(ask(1, 1, digest), Ok(()), "the same process may ask again");
        assert_eq!(ask(1, 7, digest), Err(Refusal::IdTaken { id: 1 }));
        assert_eq!(ask(2, 7, digest), Err(Refusal::IdOutOfRange { id: 2, agents: 2 }));
        assert_eq!(ask(1, 1, [9; 32]), Err(Refusal::Config { ours: digest, theirs: [9; 32] }));
        assert!(matches!(seats.admit(0, &[proto::WIRE_VERSION, 3, 255]), Err(Refusal::Malformed(_))));
        assert!(matches!(seats.admit(0, &[9, 3, 255]), Err(Refusal::Version { theirs: 9, .. })));
        seats.close();
        assert_eq!(
            seats.admit(
                0,
                &encode(&Join { config_digest: digest, nonce: 0, checkpoints: vec![] }).expect("fits")
            ),
            Err(Refusal::Closing)
        );
    }
}
