//! Joint draws, the critic's input, and the failure of a learner with infinite numbers or NaN.

use algos::iql::sample_distinct;
use proto::config::{AlgoName, Draws};
use proto::presets::{self, Family};
use store::RunFolder;
use tempfile::TempDir;

use super::off_policy::draws;
use super::*;

const OBS: usize = 2;
const ACTIONS: usize = 3;

/// A learner with a folder, which plays rounds of one episode of two steps.
struct Playing {
    learner: Learner,
    position: Position,
    _tmp: TempDir,
}

impl Playing {
    fn new(name: AlgoName) -> Self {
        Self::with_minibatch(name, 1)
    }

    /// Q-learning draws `batch` episodes for an update call.
    fn with_minibatch(name: AlgoName, batch: u32) -> Self {
        let mut config = presets::config("r", "t", 2, name, Family::Lbf);
        (config.algo.hidden, config.world.copies) = (4, 1);
        if let Some(q) = &mut config.q {
            q.batch = batch;
        }
        let tmp = tempfile::tempdir().unwrap();
        let folder = RunFolder::create(tmp.path().join("run"), &config.to_toml()).unwrap();
        let seat = Seat {
            epoch: 0,
            round: 0,
            t_env: 0,
            agents: 2,
            obs_size: OBS as u32,
            n_actions: ACTIONS as u32,
            copies: 1,
            test_episodes: 1,
            episode_limit: 2,
        };
        let (learner, _) = Learner::start(&config, 1, &seat, &folder.role("agent-1").unwrap()).unwrap();
        Self { learner, position: Position::START, _tmp: tmp }
    }

    /// One round with these rewards. Returns the report of its lesson.
    fn play(&mut self, rewards: [f32; 2]) -> Result<Option<Scalars>, Failure> {
        let mut rng = stream(1, "test", "actions", &[]);
        self.learner.begin_round(1, true);
        for tick in 0..3 {
            let observe = Observe {
                tick,
                copies: vec![0],
                ends: vec![if tick == 2 { End::Terminated } else { End::Running }],
                rewards: vec![if tick == 0 { 0.0 } else { rewards[tick as usize - 1] }],
                obs_size: OBS,
                n_actions: ACTIONS,
                obs: vec![0.5, tick as f32],
                avail: vec![1; ACTIONS],
                ..Observe::default()
            };
            self.learner.tick(&observe, true, &mut rng);
        }
        let learned = self.learner.learn(0, 0, 1e-3);
        self.learner.end_round();
        learned
    }

    fn checkpoint(&mut self) -> Checkpoint {
        self.learner.checkpoint(&Unlogged::default(), self.position).unwrap()
    }

    /// Fills a tensor with this number.
    fn put(&mut self, tensor: &str, number: f32) {
        let mut checkpoint = self.checkpoint();
        let found = checkpoint.tensors.iter_mut().find(|t| t.name == tensor).expect("there is such a tensor");
        found.data.fill(number);
        self.learner.restore(&checkpoint).unwrap();
    }
}

#[test]
fn the_critic_is_shown_the_observation_alone_whatever_the_actor_is_shown() {
    let of = |agent_id, last_action| {
        let mut config = presets::config("r", "lbf-5x5-2p-1f", 2, AlgoName::Ippo, Family::Lbf);
        (config.algo.agent_id_input, config.algo.last_action_input) = (agent_id, last_action);
        let mut learner = Learner::new(&config, 0, (9, 6));
        let checkpoint = learner.checkpoint(&Unlogged::default(), Position::START).unwrap();
        (learner, checkpoint)
    };
    let extra = [((false, false), 0), ((true, false), 2), ((false, true), 6), ((true, true), 8)];
    for ((agent_id, last_action), extra) in extra {
        let (_, checkpoint) = of(agent_id, last_action);
        let rows = |name: &str| checkpoint.tensors.iter().find(|t| t.name == name).map(|t| t.shape[0]);
        assert_eq!(rows("actor.fc1.weight"), Some(9 + extra));
        for critic in ["critic", "target_critic", "adam.critic.m", "adam.critic.v"] {
            assert_eq!(rows(&format!("{critic}.fc1.weight")), Some(9), "{critic}");
        }
    }
    // A checkpoint of another shape is refused with a message, such as one from versions in which the critic had the
    // actor's inputs.
    let (mut learner, mut old) = of(true, false);
    for tensor in
        old.tensors.iter_mut().filter(|t| t.name.contains("critic") && t.name.ends_with("fc1.weight"))
    {
        tensor.data.resize(11 * tensor.shape[1], 0.0);
        tensor.shape[0] = 11;
    }
    let refused = learner.restore(&old).err().expect("it has another shape");
    assert_eq!(refused.code, exit::CONFIG);
    let text = "the checkpoint of round 0 cannot be used: tensor `critic.fc1.weight` has 1408 numbers, this learner needs \
                1152; network or task differ";
    assert!(refused.message.starts_with(text), "{}", refused.message);
}

/// The text of a failure that a retry does not fix.
#[track_caller]
fn ends_for_good(learned: Result<Option<Scalars>, Failure>) -> String {
    let failure = learned.expect_err("the learner has diverged");
    assert_eq!(failure.code, exit::CONFIG);
    failure.message
}

#[test]
fn a_team_draws_the_same_episodes_unless_each_agent_draws_its_own() {
    let drawn = |rule, id, update_call| sample_distinct(32, 5_000, &mut draws(rule, 7, id, update_call));
    for update_call in [0, 1, 1_000] {
        let joint = drawn(Draws::Joint, 0, update_call);
        assert!((1..64).all(|id| drawn(Draws::Joint, id, update_call) == joint));
        assert_ne!(drawn(Draws::Joint, 0, update_call + 1), joint, "another call, other episodes");
        let own = [0, 1, 2].map(|id| drawn(Draws::Independent, id, update_call));
        assert!(own[0] != own[1] && own[1] != own[2] && own[0] != own[2] && !own.contains(&joint));
    }
}

#[test]
fn a_reward_that_is_no_number_stops_the_learner_in_the_update_call_that_it_was_for() {
    for name in [AlgoName::Mtppo, AlgoName::Mtql] {
        for bad in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            let mut playing = Playing::new(name);
            playing.play([1.0, 0.0]).unwrap();
            playing.play([0.0, 1.0]).unwrap();
            let before = playing.checkpoint();
            let text = ends_for_good(playing.play([0.0, bad]));
            let start = format!(
                "agent 1 diverged in update call 2: the reward of step 1 in copy 0 is {bad}; nothing of this update \
                 call is saved, the last checkpoint stays\nhint: "
            );
            assert!(text.starts_with(&start) && text.contains("finite rewards"), "{text}");
            assert_eq!(playing.checkpoint().tensors, before.tensors, "nothing was learned from it");
        }
    }
}

#[test]
fn an_infinite_reward_is_noticed_before_there_is_enough_to_learn_from() {
    let mut playing = Playing::with_minibatch(AlgoName::Iql, 5);
    let text = ends_for_good(playing.play([f32::INFINITY, 0.0]));
    assert!(text.contains("in update call 0: the reward of step 0 in copy 0 is inf"), "{text}");
    let counters = playing.learner.algorithm.counters().unwrap();
    assert_eq!(counters["remembered"], 0, "it is not remembered either");
}

#[test]
fn a_loss_that_is_no_number_is_named_with_the_update_call_and_what_to_lower() {
    for (name, tensor, quantity) in
        [(AlgoName::Ippo, "critic.head.bias", "loss"), (AlgoName::Iql, "q.head.bias", "loss")]
    {
        let mut playing = Playing::new(name);
        playing.play([1.0, 0.0]).unwrap();
        playing.put(tensor, f32::INFINITY);
        let text = ends_for_good(playing.play([1.0, 0.0]));
        assert!(text.starts_with("agent 1 diverged in update call 1: "), "{text}");
        assert!(text.contains(quantity) && text.contains("`--lr-fast`, `--lr-slow`"), "{text}");
    }
}

#[test]
fn a_weight_or_moment_that_is_no_number_is_named_even_where_no_loss_shows_it() {
    for (name, tensor) in [
        (AlgoName::Ippo, "adam.actor.v.fc1.weight"),
        (AlgoName::Ippo, "adam.critic.v.fc1.bias"),
        (AlgoName::Iql, "adam.q.v.fc1.weight"),
    ] {
        let mut playing = Playing::new(name);
        playing.play([1.0, 0.0]).unwrap();
        playing.put(tensor, f32::INFINITY);
        let text = ends_for_good(playing.play([1.0, 0.0]));
        assert!(text.starts_with(&format!("agent 1 diverged in update call 1: {tensor} is inf")), "{text}");
    }
}
