//! Every task id that the reference packages register: it means the same world here, or is refused with the reason.
//! The loops are those of each package's registration; counts pin that they are complete.

use envs::lbf::Rules;
use envs::{task, UnknownTask};

/// Canonical name and sizes of an id that is accepted.
fn accepted(id: &str) -> envs::Task {
    task(id).unwrap_or_else(|error| panic!("{error}"))
}

fn refused(id: &str) -> String {
    task(id).map(|task| task.name().to_owned()).expect_err(id).to_string()
}

/// One id of level-based foraging, which must be accepted with these numbers, or must not fit on its grid.
struct Foraging {
    side: u16,
    players: u16,
    foods: u16,
    coop: bool,
    sight: u16,
    rules: Rules,
}

impl Foraging {
    fn id(&self, kind: &str) -> String {
        let Foraging { side, players, foods, coop, sight, rules } = *self;
        let sight = if sight == side { String::new() } else { format!("-{sight}s") };
        let coop = if coop { "-coop" } else { "" };
        format!("Foraging{kind}{sight}-{side}x{side}-{players}p-{foods}f{coop}-{rules}")
    }

    /// Whether the id was accepted.
    fn check(&self) -> bool {
        let Foraging { side, players, foods, rules, .. } = *self;
        let id = self.id("");
        let name = id.replace("Foraging", "lbf").replace("-v3", "");
        if side == 5 && players > 16 && rules < Rules::V2 {
            let expected = format!(
                "task `{id}` cannot be played: {players} players do not fit on 16 cells, which is where they start on \
                 this grid"
            );
            assert_eq!(refused(&id), expected);
            return false;
        }
        let task = accepted(&id);
        assert_eq!((task.name(), task.rules()), (&*name, rules.name()), "{id}");
        let sizes = task.sizes();
        let (agents, numbers) = (usize::from(players), 3 * usize::from(players + foods));
        assert_eq!((sizes.agents, sizes.episode_limit), (agents, 50), "{id}");
        assert!(sizes.obs_size.iter().all(|&size| size == numbers), "{id}");
        assert!(sizes.n_actions.iter().all(|&n| n == 6), "{id}");
        // Small grids have no room for many foods; from a side of 9 on there is always room for nine.
        assert_eq!(task.warning().is_some(), foods > most_foods(side), "{id}");
        true
    }
}

/// Foods that fit on a square grid, of the nine that ids go up to.
fn most_foods(side: u16) -> u16 {
    match side {
        5 => 2,
        6 => 4,
        7 => 6,
        8 => 8,
        _ => 9,
    }
}

/// `(ids, those that were accepted)` of a release.
fn foraging(
    rules: Rules,
    most_players: u16,
    most_foods: u16,
    sights: impl Fn(u16) -> Vec<u16>,
    check: impl Fn(&Foraging) -> bool,
) -> (usize, usize) {
    let (mut ids, mut good) = (0, 0);
    for side in 5..20 {
        for players in 2..=most_players {
            for foods in 1..=most_foods {
                for coop in [true, false] {
                    for sight in sights(side) {
                        ids += 1;
                        good += usize::from(check(&Foraging { side, players, foods, coop, sight, rules }));
                    }
                }
            }
        }
    }
    (ids, good)
}

#[test]
fn foraging_ids_of_every_release_mean_the_same_levels_sizes_and_limits() {
    let whole_or_2 = |side| vec![2, side];
    let every = |side| (1..=side).collect();
    assert_eq!(foraging(Rules::V0, 4, 9, whole_or_2, Foraging::check), (1_620, 1_620)); // 1.0.14
                                                                                        // 1.0.15: on 5x5, 17 to 19
                                                                                        // players find no place.
    assert_eq!(foraging(Rules::V1, 19, 9, whole_or_2, Foraging::check), (9_720, 9_720 - 3 * 9 * 2 * 2));
    assert_eq!(foraging(Rules::V2, 19, 9, whole_or_2, Foraging::check), (9_720, 9_720)); // 1.0.16
    assert_eq!(foraging(Rules::V2, 19, 9, every, Foraging::check), (58_320, 58_320)); // 1.1.1
    assert_eq!(foraging(Rules::V3, 9, 4, whole_or_2, Foraging::check), (1_920, 1_920)); // 2.0.0
    assert_eq!(foraging(Rules::V3, 9, 9, whole_or_2, Foraging::check), (4_320, 4_320));
    // its newest source
}

#[test]
fn foraging_ids_with_grid_observations_are_refused_with_the_world_that_has_vectors() {
    let every = |side| (1..=side).collect();
    let check = |world: &Foraging| {
        let own = world.id("").replace("Foraging", "lbf").replace("-v3", "");
        let id = world.id("-grid");
        let expected = format!(
            "there is no task `{id}`: its players see the grid as layers of numbers; Rondo has the world with vectors, \
             `{own}`"
        );
        assert_eq!(refused(&id), expected);
        false
    };
    assert_eq!(foraging(Rules::V2, 19, 9, every, check), (58_320, 0)); // 1.1.1
    assert_eq!(foraging(Rules::V3, 9, 4, every, check), (11_520, 0)); // 2.0.0, on request
}

#[test]
fn a_foraging_id_that_no_release_registers_is_refused_with_rondos_own_name() {
    let v3 =
        "v3 ids have square grids of side 5 to 19, 2 to 9 players, 1 to 9 foods, and a sight of `2s` or none";
    for (id, limits, own) in [
        ("Foraging-20x20-2p-2f-v3", v3, "lbf-20x20-2p-2f"),
        ("Foraging-4x4-2p-1f-v3", v3, "lbf-4x4-2p-1f"),
        ("Foraging-5x9-2p-1f-v3", v3, "lbf-5x9-2p-1f"),
        ("Foraging-8x8-10p-2f-v3", v3, "lbf-8x8-10p-2f"),
        ("Foraging-9x9-1p-2f-v3", v3, "lbf-9x9-1p-2f"),
        ("Foraging-12x12-2p-10f-v3", v3, "lbf-12x12-2p-10f"),
        ("Foraging-3s-8x8-2p-2f-v3", v3, "lbf-3s-8x8-2p-2f"),
        ("Foraging-8s-8x8-2p-2f-v3", v3, "lbf-8x8-2p-2f"),
        ("Foraging-08x8-2p-2f-v3", v3, "lbf-8x8-2p-2f"),
        ("lbforaging:Foraging-8x8-10p-2f", v3, "lbf-8x8-10p-2f"),
        (
            "Foraging-8x8-5p-2f-v0",
            "v0 ids have square grids of side 5 to 19, 2 to 4 players, 1 to 9 foods, and a sight of `2s` or none",
            "lbf-8x8-5p-2f-v0",
        ),
        (
            "Foraging-9s-8x8-2p-2f-v2",
            "v2 ids have square grids of side 5 to 19, 2 to 19 players, 1 to 9 foods, and a sight below the side or none",
            "lbf-8x8-2p-2f-v2",
        ),
    ] {
        let without_package = id.trim_start_matches("lbforaging:").to_lowercase();
        let expected = format!(
            "there is no task `{id}`: no release of lbforaging registers `{without_package}` ({limits}); Rondo's own \
             name for these numbers is `{own}`"
        );
        assert_eq!(refused(id), expected);
        assert_eq!(accepted(own).name(), own);
    }
    // Without a version, gymnasium takes the newest.
    assert_eq!(accepted("Foraging-8x8-9p-2f").name(), "lbf-8x8-9p-2f");
    assert_eq!(
        refused("Foraging-8x8-2p-2f-coop-ind-pen-v3"),
        "there is no task `Foraging-8x8-2p-2f-coop-ind-pen-v3`: `-ind` puts every food at level 1, and no name here has \
         that; without it the world is `lbf-8x8-2p-2f-coop`"
    );
    assert!(refused("Foraging-2s-8x8-2p-2f-pen-v3")
        .contains("`-pen` takes 0.1 from each player whose loading fails"));
}

/// What PyMARLzoo+ 1.1.0 registers beside the ids of `lbforaging`, for v3; its v2 has them too.
const OF_PYMARLZOO: [&str; 12] = [
    "8s-25x25-8p-5f",
    "5s-25x25-8p-5f",
    "7s-50x50-8p-5f",
    "7s-30x30-7p-5f",
    "7s-30x30-7p-4f",
    "4s-30x30-8p-5f",
    "7s-20x20-5p-3f",
    "5s-20x20-5p-3f",
    "7s-15x15-5p-3f",
    "6s-12x12-2p-2f",
    "4s-11x11-3p-2f",
    "4s-11x11-4p-3f",
];

#[test]
fn foraging_ids_of_pymarlzoo_are_accepted_only_where_lbforaging_registers_them() {
    let mut refusals = 0;
    for (version, suffix) in [("v2", "-v2"), ("v3", "")] {
        for numbers in OF_PYMARLZOO {
            let id = format!("lbforaging:Foraging-{numbers}-coop-{version}");
            let own = format!("lbf-{numbers}-coop{suffix}");
            // lbforaging 1.1.1 has every sight on grids up to 19x19.
            let side: u32 = numbers.split(['-', 'x']).nth(1).unwrap().parse().unwrap();
            if version == "v2" && side < 20 {
                assert_eq!(accepted(&id).name(), own);
                continue;
            }
            refusals += 1;
            let message = refused(&id);
            assert!(
                message.contains("; PyMARLzoo+ registers it with every player and every food at level 3, which is another world"),
                "{message}"
            );
            assert!(
                message.ends_with(&format!("; Rondo's own name for these numbers is `{own}`")),
                "{message}"
            );
            assert_eq!(accepted(&own).name(), own);
        }
    }
    assert_eq!(refusals, 8 + 12);
    for (id, name) in [
        ("lbforaging:Foraging-2s-11x11-3p-2f-coop-v2", "lbf-2s-11x11-3p-2f-coop-v2"),
        ("lbforaging:Foraging-2s-8x8-3p-2f-coop-v3", "lbf-2s-8x8-3p-2f-coop"),
        ("lbforaging:Foraging-2s-9x9-3p-2f-coop-v3", "lbf-2s-9x9-3p-2f-coop"),
        ("lbforaging:Foraging-2s-12x12-2p-2f-coop-v2", "lbf-2s-12x12-2p-2f-coop-v2"),
    ] {
        assert_eq!(accepted(id).name(), name);
    }
}

const SIZES: [(&str, usize, usize); 4] = [("tiny", 1, 3), ("small", 2, 3), ("medium", 2, 5), ("large", 3, 5)];

/// What a warehouse is built from, and whether it can be played.
struct Warehouse {
    rows: usize,
    columns: usize,
    height: usize,
    robots: usize,
    requests: usize,
    sight: usize,
}

impl Warehouse {
    /// Shelves stand in columns of two, and the middle pair of the lowest row makes room for the goals.
    fn shelves(&self) -> usize {
        2 * self.height * (self.rows * self.columns - 1)
    }

    /// Whether the id is accepted; it is the same world as `own`, or refused with the reason.
    fn check(&self, id: &str, version: &str) -> bool {
        let Warehouse { robots, requests, sight, .. } = *self;
        if requests == 0 {
            let expected = format!(
                "task `{id}` cannot be played: there must be at least 1 request; without requests no robot can earn a reward"
            );
            assert_eq!(refused(id), expected);
            return false;
        }
        let shelves = self.shelves();
        if requests >= shelves {
            let expected = format!(
                "task `{id}` cannot be played: {requests} requests are too many for {shelves} shelves; one at least \
                 must be left to be requested next"
            );
            assert_eq!(refused(id), expected);
            return false;
        }
        let task = accepted(id);
        assert_eq!(task.rules(), version, "{id}");
        let sizes = task.sizes();
        assert_eq!((sizes.agents, sizes.episode_limit), (robots, 500), "{id}");
        let numbers = 8 + 7 * (2 * sight + 1).pow(2);
        assert!(sizes.obs_size.iter().all(|&size| size == numbers), "{id}");
        assert!(sizes.n_actions.iter().all(|&n| n == 5), "{id}");
        true
    }
}

fn difficulties(robots: usize) -> [(&'static str, usize); 3] {
    [("-easy", 2 * robots), ("", robots), ("-hard", robots / 2)]
}

#[test]
fn warehouse_ids_mean_the_same_sizes_and_limits() {
    for version in ["v1", "v2"] {
        let (mut ids, mut good) = (0, 0);
        for (size, rows, columns) in SIZES {
            for robots in 1..20 {
                for (word, requests) in difficulties(robots) {
                    let world = Warehouse { rows, columns, height: 8, robots, requests, sight: 1 };
                    for package in ["", "rware:"] {
                        ids += 1;
                        let id = format!("{package}rware-{size}-{robots}ag{word}-{version}");
                        good += usize::from(world.check(&id, version));
                    }
                }
            }
        }
        // Nothing is requested of 1ag-hard; tiny has 32 shelves, too few for 16 to 19 robots with twice as many.
        assert_eq!((ids, good), (2 * 228, 2 * (228 - 4 - 4)));
    }
}

#[test]
fn warehouse_ids_that_are_registered_on_request_mean_the_same_or_are_refused_with_the_reason() {
    let (mut words, mut numbers) = (0, 0);
    for height in 1..16 {
        for sight in 1..6 {
            let seen = if sight == 1 { String::new() } else { format!("-{sight}s") };
            for robots in 1..20 {
                for (size, rows, columns) in SIZES {
                    for (word, requests) in difficulties(robots) {
                        words += 1;
                        let world = Warehouse { rows, columns, height, robots, requests, sight };
                        let id = format!("rware:rware{seen}-{size}-{height}h-{robots}ag{word}-v2");
                        world.check(&id, "v2");
                    }
                }
                for (rows, columns) in (1..5).flat_map(|rows| [3, 5, 7, 9].map(|columns| (rows, columns))) {
                    for requests in 1..20 {
                        let world = Warehouse { rows, columns, height, robots, requests, sight };
                        for turned in ["", "-Nd"] {
                            numbers += 1;
                            let id = format!(
                                "rware{turned}{seen}-{rows}x{columns}-{height}h-{robots}ag-{requests}req-indiv-v2"
                            );
                            world.check(&id, "v2");
                        }
                    }
                }
            }
        }
    }
    assert_eq!((words, numbers), (4 * 3 * 5 * 19 * 15, 4 * 4 * 15 * 19 * 19 * 5 * 2));
}

#[test]
fn warehouse_ids_with_images_or_other_rewards_are_refused_with_the_reason() {
    let mut ids = 0;
    for (kind, image) in
        [("-img", "img"), ("-img-Nd", "img"), ("-imgdict", "imgdict"), ("-imgdict-Nd", "imgdict")]
    {
        for (size, ..) in SIZES {
            for robots in 1..20 {
                for (word, requests) in difficulties(robots) {
                    ids += 1;
                    let own = format!("rware-{size}-{robots}ag{word}");
                    let id = format!("rware:rware{kind}-{size}-{robots}ag{word}-v2");
                    let message = refused(&id);
                    if requests == 0 || (size == "tiny" && requests >= 32) {
                        assert!(message.starts_with(&format!("task `{id}` cannot be played: ")), "{message}");
                        continue;
                    }
                    let expected = format!(
                        "there is no task `{id}`: its robots see images (`{image}`); Rondo has the warehouse with \
                         vectors, `{own}`"
                    );
                    assert_eq!(message, expected);
                }
            }
        }
    }
    assert_eq!(ids, 4 * 228);
    for (id, reason) in [
        (
            "rware-1x3-8h-2ag-3req-global-v2",
            "`global` pays every robot for every delivery; Rondo pays each for its own, `rware-tiny-2ag-3req`, and the \
             sum of the team's rewards there is what `global` pays",
        ),
        (
            "rware-2s-2x5-9h-3ag-1req-twostage-v1",
            "`twostage` pays half for a delivery and half for bringing the shelf back; Rondo pays for deliveries \
             alone, `rware-2s-medium-9h-3ag-hard-v1`",
        ),
        (
            "rware-img-Nd-3s-4x9-15h-19ag-19req-global-v2",
            "its robots see images (`img`); Rondo has the warehouse with vectors, `rware-3s-4x9-15h-19ag`",
        ),
    ] {
        assert_eq!(refused(id), format!("there is no task `{id}`: {reason}"));
    }
}

#[test]
fn a_warehouse_id_that_no_release_registers_is_refused_with_rondos_own_name() {
    for (id, own) in [
        ("rware:rware-tiny-20ag-v2", "rware-tiny-20ag"),
        ("rware:rware-6x3-8h-2ag-4req-indiv-v2", "rware-6x3-2ag-easy"),
        ("rware:rware-tiny-16h-2ag-v2", "rware-tiny-16h-2ag"),
        ("rware:rware-tiny-2ag-3req-v2", "rware-tiny-2ag-3req"),
        ("rware-Nd-tiny-2ag-v2", "rware-tiny-2ag"),
        ("rware-tiny-2ag-indiv-v1", "rware-tiny-2ag-v1"),
    ] {
        let without_package = id.trim_start_matches("rware:").to_lowercase();
        let expected = format!(
            "there is no task `{id}`: no release of rware registers `{without_package}`; Rondo's own name for these \
             numbers is `{own}`"
        );
        assert_eq!(refused(id), expected);
        assert_eq!(accepted(own).name(), own);
    }
    for id in ["rware:rware-tiny-2ag", "rware-2x5-9h-2ag-3req-indiv"] {
        assert_eq!(accepted(id).rules(), "v2");
    }
}

#[test]
fn particle_ids_mean_the_same_or_are_refused_as_worlds_that_are_not_here() {
    // PettingZoo 1.24.3 and MPE2 1.1.1, by module and by key.
    for (module, name, sizes) in [
        ("simple_speaker_listener_v4", "mpe-simple-speaker-listener", vec![3, 11]),
        ("simple_adversary_v3", "mpe-simple-adversary", vec![10, 10]),
        ("simple_tag_v3", "mpe-simple-tag", vec![16, 16, 16]),
    ] {
        for form in ["{}", "mpe/{}", "mpe2:{}", "pettingzoo.mpe.{}", "mpe2.{}"] {
            let task = accepted(&form.replace("{}", module));
            assert_eq!((task.name(), task.rules()), (name, "current"), "{form} {module}");
            assert_eq!((&task.sizes().obs_size, task.sizes().episode_limit), (&sizes, 25), "{form} {module}");
        }
        let task = accepted(&format!("pz-mpe-{}", module.replace('_', "-")));
        assert_eq!((task.name(), task.rules()), (&*format!("{name}-epymarl"), "epymarl"));
    }
    for (module, game) in [
        ("simple_v3", "simple"),
        ("simple_crypto_v3", "simple-crypto"),
        ("simple_push_v3", "simple-push"),
        ("simple_reference_v3", "simple-reference"),
        ("simple_spread_v3", "simple-spread"),
        ("simple_world_comm_v3", "simple-world-comm"),
        ("simple_formation_v1", "simple-formation"),
        ("simple_line_v1", "simple-line"),
        ("collect_treasure_v1", "collect-treasure"),
    ] {
        for form in ["{}", "mpe/{}", "mpe2:{}", "pettingzoo.mpe.{}", "pz-mpe-{}"] {
            let id = form.replace("{}", module);
            let expected = format!(
                "there is no task `{id}`: `{game}` is a particle world that Rondo does not have; it has \
                 `simple-speaker-listener`, `simple-adversary` and `simple-tag`"
            );
            assert_eq!(refused(&id), expected);
        }
    }
    // The study of 2021 and PyMARLzoo+ 1.1.0.
    for (id, name) in [
        ("SimpleSpeakerListener-v0", "mpe-simple-speaker-listener-2021"),
        ("SimpleAdversary-v0", "mpe-simple-adversary-2021"),
        ("SimpleTag-v0", "mpe-simple-tag-2021"),
    ] {
        for id in [id.to_owned(), format!("mpe:{id}")] {
            assert_eq!(accepted(&id).name(), name);
        }
    }
    for id in [
        "SimpleSpread-v0",
        "SimpleSpread-3-v0",
        "SimpleSpread-4-v0",
        "SimpleSpread-5-v0",
        "SimpleSpread-8-v0",
        "MultiSpeakerListener-v0",
        "SimpleCrypto-v0",
        "SimplePush-v0",
        "SimpleReference-v0",
        "SimpleWorldComm-v0",
        "ClimbingSpread-v0",
        "DoubleSpread-2ag-v0",
        "DoubleSpread-10ag-v0",
    ] {
        for id in [id.to_owned(), format!("mpe:{id}")] {
            assert!(refused(&id).contains("is a particle world that Rondo does not have"), "{id}");
        }
    }
}

/// The maps of SMAClite 0.0.1 and of SMAC.
const MAPS: &str = "3m 8m 25m 5m_vs_6m 8m_vs_9m 10m_vs_11m 27m_vs_30m MMM MMM2 2s3z 3s5z 3s5z_vs_3s6z 3s_vs_3z 3s_vs_4z \
                    3s_vs_5z 1c3s5z 2m_vs_1z corridor 6h_vs_8z 2s_vs_1sc so_many_baneling bane_vs_bane 2c_vs_64zg";

#[test]
fn maps_are_understood_as_smaclite_smac_and_epymarl_spell_them_or_refused_as_missing() {
    let mut played = 0;
    for map in MAPS.split_whitespace() {
        for id in [
            map.to_owned(),
            map.to_lowercase(),
            format!("smaclite/{map}-v0"),
            format!("smaclite:smaclite/{map}-v0"),
            format!("smaclite:{map}"),
            format!("smac-{map}"),
            format!("smac:{map}"),
            format!("SMACLITE-{map}"),
        ] {
            let own = format!("smaclite-{}", map.to_lowercase());
            match task(&id) {
                Ok(task) => assert_eq!(task.name(), own, "{id}"),
                Err(error) => {
                    let expected = format!(
                        "there is no task `{id}`: Rondo has no file for that map of SMAC; there are "
                    );
                    assert!(error.to_string().starts_with(&expected), "{id}: {error}");
                    assert!(matches!(error, UnknownTask::Missing { .. }));
                    assert!(task(&own).is_err());
                }
            }
        }
        played += usize::from(task(map).is_ok());
    }
    assert_eq!(played, 12);
}

#[test]
fn starcraft_itself_is_refused_with_what_there_is_instead() {
    for map in MAPS.split_whitespace() {
        for id in [format!("sc2:{map}"), format!("sc2/{map}"), format!("SC2_{map}"), format!("sc2-{map}")] {
            let text = refused(&id);
            let begin = format!("there is no task `{id}`: that is StarCraft II, which Rondo does not play; ");
            assert!(text.starts_with(&begin), "{text}");
            let end = "results there and results of SMAC cannot be compared";
            assert!(text.ends_with(end), "{text}");
            let offers = text.contains(&format!("`smaclite-{}`", map.to_lowercase()));
            assert_eq!(offers, task(map).is_ok(), "{text}");
        }
    }
    for id in ["sc2", "smac", "smaclite", "smaclite-"] {
        assert!(
            refused(id).contains("smaclite-3s_vs_5z") || refused(id).contains("3s_vs_5z"),
            "{}",
            refused(id)
        );
    }
}

#[test]
fn worlds_of_other_packages_are_refused_as_what_they_are() {
    let mut ids: Vec<(String, &str)> = Vec::new();
    let game = "a game of PettingZoo";
    let games = "atari/basketball_pong_v3 atari/boxing_v2 atari/combat_tank_v2 atari/combat_plane_v2 \
                 atari/double_dunk_v3 atari/entombed_competitive_v3 atari/entombed_cooperative_v3 \
                 atari/flag_capture_v2 atari/foozpong_v3 atari/joust_v3 atari/ice_hockey_v2 atari/maze_craze_v3 \
                 atari/mario_bros_v3 atari/othello_v3 atari/pong_v3 atari/quadrapong_v4 atari/space_invaders_v2 \
                 atari/space_war_v2 atari/surround_v2 atari/tennis_v3 atari/video_checkers_v4 \
                 atari/volleyball_pong_v3 atari/wizard_of_wor_v3 atari/warlords_v3 \
                 butterfly/knights_archers_zombies_v10 butterfly/pistonball_v6 butterfly/cooperative_pong_v5 \
                 classic/chess_v6 classic/rps_v2 classic/connect_four_v3 classic/tictactoe_v3 \
                 classic/leduc_holdem_v4 classic/texas_holdem_v4 classic/texas_holdem_no_limit_v6 \
                 classic/gin_rummy_v4 classic/go_v5 classic/hanabi_v5 sisl/multiwalker_v9 sisl/waterworld_v4 \
                 sisl/pursuit_v4";
    for key in games.split_whitespace() {
        let module = key.split_once('/').unwrap().1;
        let of_epymarl = format!("pz-{}", key.replace(['/', '_'], "-"));
        ids.extend(
            [key.to_owned(), module.to_owned(), of_epymarl, format!("pettingzoo/{key}")].map(|id| (id, game)),
        );
    }
    assert_eq!(ids.len(), 4 * 40);
    for (id, kind) in [
        ("smacv2-terran_5_vs_5", "a task of SMACv2"),
        ("10gen_zerg", "a task of SMACv2"),
        ("Overcooked-v0", "a layout of Overcooked"),
        ("cramped_room", "a layout of Overcooked"),
        ("simple_tomato", "a layout of Overcooked"),
        ("pressureplate-linear-4p-v0", "a task of Pressure Plate"),
        ("CaptureTarget-6x6-1t-2a-v0", "a task of Capture Target"),
        ("BoxPushing-6x6-2a-v0", "a task of Box Pushing"),
        ("matrixgames:penalty-100-nostate-v0", "a matrix game or a task of VMAS"),
        ("vmas-balance", "a matrix game or a task of VMAS"),
    ] {
        ids.push((id.to_owned(), kind));
    }
    for (id, kind) in ids {
        let expected = format!(
            "there is no task `{id}`: it is {kind}, and Rondo does not have that world; `rondo tasks` lists what it has"
        );
        assert_eq!(refused(&id), expected);
        assert!(matches!(task(&id), Err(UnknownTask::Missing { .. })));
    }
}
