//! What the env-server sends is what `docs/protocol.md` shows, byte for byte.

use std::sync::{mpsc, Arc};
use std::thread;
use std::time::{Duration, Instant};

use bus::{Bus, Event, Events, Guard};
use env_server::Closed;
use process::Role;
use proto::codec::{decode, encode};
use proto::config::{AlgoName, Config};
use proto::control::{Join, Seat, Welcome};
use proto::keys::Keys;
use proto::presets::{config, Family};
use proto::{Act, Message, Mode, Observe, WIRE_VERSION};
use store::RunFolder;
use vectors::vectors;

#[path = "../../proto/tests/vectors/mod.rs"]
mod vectors;

const DEADLINE: Duration = Duration::from_secs(20);

/// Three agents, as in the vectors, and little work.
fn small() -> Config {
    let mut config = config("run", "lbf-8x8-3p-1f", 3, AlgoName::Ippo, Family::Lbf);
    (config.t_max, config.world.copies, config.test.episodes) = (1, 2, 3);
    config
}

/// The env-server in a thread, and an agent's side of the bus for each seat.
struct Run {
    hub: bus::MemoryHub,
    keys: Keys,
    config: Config,
    stop: bus::Inbox,
    server: thread::JoinHandle<Result<Closed, process::Failure>>,
    _folder: tempfile::TempDir,
}

impl Run {
    fn start(config: Config) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let run = RunFolder::create(folder.path().join("run"), &config.to_toml()).expect("a new folder");
        let hub = bus::memory();
        let role = run.role("world").expect("a role");
        let role = Role::new(hub.connect(), config.clone(), role, DEADLINE).expect("a good name");
        let (stop, keys) = (role.inbox.clone(), role.keys.clone());
        let server = thread::spawn(move || env_server::run(role, false));
        let run = Self { hub, keys, config, stop, server, _folder: folder };
        let (bus, deadline) = (run.hub.connect(), Instant::now() + DEADLINE);
        let (inbox, events) = bus::inbox();
        let _watch = bus.watch(&run.keys.alive_world(), inbox).expect("a watch");
        // Its token appears when it answers queries.
        let alive = events.recv_timeout(deadline.saturating_duration_since(Instant::now()));
        assert!(matches!(alive, Ok(Event::Alive { .. })), "{alive:?}");
        run
    }

    fn join(&self, nonce: u64) -> Vec<u8> {
        let config_digest = self.config.digest();
        encode(&Join { config_digest, nonce, checkpoints: vec![] }).expect("it fits")
    }

    /// The answer to a request for a seat.
    fn ask(&self, seat: u32, question: &[u8]) -> Vec<u8> {
        let answer = self.hub.connect().ask(&self.keys.join(seat), question, DEADLINE);
        answer.expect("it can ask").expect("an answer")
    }

    /// Joins with all agents.
    fn team(&self) -> Vec<Player> {
        let seats: Vec<Vec<u8>> = thread::scope(|scope| {
            let asking: Vec<_> =
                (0..3).map(|id| scope.spawn(move || self.ask(id, &self.join(id.into())))).collect();
            asking.into_iter().map(|asking| asking.join().expect("it does not panic")).collect()
        });
        (0..).zip(seats).map(|(id, seat)| Player::sit(self, id, seat)).collect()
    }
}

/// An agent played by hand.
struct Player {
    bus: Arc<dyn Bus>,
    act: bus::Publisher,
    events: Events,
    seat: Vec<u8>,
    _guards: Vec<Guard>,
}

impl Player {
    fn sit(run: &Run, id: u32, seat: Vec<u8>) -> Self {
        let bus = run.hub.connect();
        let (inbox, events) = bus::inbox();
        let subscription = bus.subscribe(&run.keys.observe(id), inbox).expect("a subscription");
        let token = bus.announce(&run.keys.alive_agent(id)).expect("a token");
        let act = bus.publisher(&run.keys.act(id)).expect("a publisher");
        Self { bus, act, events, seat, _guards: vec![subscription, token] }
    }

    /// The next tick, as bytes.
    fn tick(&self) -> Vec<u8> {
        match self.events.recv_timeout(DEADLINE) {
            Ok(Event::Message { payload, .. }) => payload,
            other => panic!("{other:?}"),
        }
    }

    /// Answers a tick with the first available actions.
    fn answer(&self, tick: &Observe) {
        let first = |row| tick.available(row).iter().position(|&flag| flag == 1).expect("one") as u16;
        let act = Act {
            mode: tick.mode,
            epoch: tick.epoch,
            round: tick.round,
            tick: tick.tick,
            actions: tick.running().map(first).collect(),
        };
        let mut bytes = Vec::new();
        act.encode(&mut bytes);
        self.act.send(&bytes).expect("its own side works");
    }

    /// Plays until a message closes the run; that message, as bytes.
    fn play(self) -> Vec<u8> {
        loop {
            let (bytes, mut tick) = (self.tick(), Observe::default());
            tick.decode(&bytes).expect("a tick");
            self.answer(&tick);
            if tick.mode.closes_the_run() {
                drop(self.bus);
                return bytes;
            }
        }
    }
}

/// The page's closing message with other counters.
fn closing(mode: Mode, round: u64, t_env: u64) -> Vec<u8> {
    let mut bytes = vectors()["observe-finished"].clone();
    bytes[2] = mode as u8;
    bytes[4..8].copy_from_slice(&0_u32.to_le_bytes());
    bytes[8..16].copy_from_slice(&round.to_le_bytes());
    bytes[32..40].copy_from_slice(&t_env.to_le_bytes());
    bytes
}

fn t_env(tick: &[u8]) -> u64 {
    u64::from_le_bytes(tick[32..40].try_into().expect("eight bytes"))
}

fn play(team: Vec<Player>) -> Vec<Vec<u8>> {
    let playing: Vec<_> = team.into_iter().map(|player| thread::spawn(move || player.play())).collect();
    playing.into_iter().map(|player| player.join().expect("it does not panic")).collect()
}

#[test]
fn the_messages_that_close_a_finished_run_are_those_of_the_page() {
    let run = Run::start(small());
    let team = run.team();
    let seats: Vec<_> = team.iter().map(|player| player.seat.clone()).collect();
    let closings = play(team);
    assert_eq!(run.server.join().expect("it does not panic").expect("it ends well"), Closed::Finished);
    let t_env = t_env(&closings[0]);
    assert!(t_env > 0);
    for (seat, bytes) in seats.iter().zip(&closings) {
        assert_eq!(bytes, &closing(Mode::Finished, 1, t_env));
        // The seat as on the page: one byte for each of these small numbers.
        assert_eq!(seat[..3], vectors()["welcome-seat"][..3], "the frame, and that it is a seat");
        let Ok(Welcome::Seat(Seat { obs_size, n_actions, episode_limit, .. })) = decode(seat) else {
            panic!("{seat:?}")
        };
        let last = [obs_size, n_actions, 2, 3, episode_limit].map(|number| number as u8);
        assert_eq!(seat[3..], [&[0, 0, 0, 3][..], &last].concat());
    }
}

#[test]
fn the_messages_that_stop_a_run_are_those_of_the_page() {
    let run = Run::start(small());
    let team = run.team();
    // A request to stop before the first answer: the round is played to its end.
    run.stop.send(Event::Stop).expect("it listens");
    let closings = play(team);
    assert_eq!(run.server.join().expect("it does not panic").expect("it ends well"), Closed::Stopped);
    let t_env = t_env(&closings[0]);
    for bytes in closings {
        assert_eq!(bytes, closing(Mode::Stopped, 1, t_env));
    }
}

#[test]
fn refusals_are_those_of_the_page() {
    let run = Run::start(small());
    let vectors = vectors();
    let mut other_version = run.join(1);
    other_version[0] = WIRE_VERSION - 1;
    assert_eq!(run.ask(0, &other_version), vectors["welcome-version"]);
    assert_eq!(run.ask(3, &run.join(1)), vectors["welcome-id-out-of-range"]);
    let other_config = [&[WIRE_VERSION, Join::TAG][..], &[0xbb; 32], &[1, 0]].concat();
    let mut expected = vectors["welcome-config"].clone();
    expected[4..36].copy_from_slice(&run.config.digest());
    assert_eq!(run.ask(0, &other_config), expected);
    let malformed = run.ask(0, &[WIRE_VERSION, Join::TAG, 255]);
    assert_eq!(malformed[..4], vectors["welcome-malformed"][..4]);
    assert_eq!(malformed.len(), 5 + usize::from(malformed[4]), "a text and nothing behind it");

    // Two processes request the same seat: one of them waits for the rest of the team.
    let (answers, first) = mpsc::channel();
    for nonce in [1, 2] {
        let (bus, key, question) = (run.hub.connect(), run.keys.join(2), run.join(nonce));
        let answers = answers.clone();
        thread::spawn(move || answers.send(bus.ask(&key, &question, DEADLINE)));
    }
    let first = first.recv_timeout(DEADLINE).expect("one is refused at once");
    assert_eq!(first.expect("it can ask"), Some(vectors["welcome-id-taken"].clone()));
    run.stop.send(Event::Stop).expect("it listens");
    run.server.join().expect("it does not panic").expect_err("nobody else has come");
}
