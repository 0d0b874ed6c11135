//! Names of other packages' worlds that Rondo does not have, so that the error names them instead of suggesting a
//! similar name. Missing particle worlds are in `mpe/missing.rs`.

/// Worlds of one package, or of several under the same names.
struct Package {
    /// Kind of the names, for messages: "a map of SMAC".
    kind: &'static str,
    /// Prefixes of names, in the form of [`plain`].
    prefixes: &'static [&'static str],
    /// Whole names, in the form of [`plain`].
    names: &'static [&'static str],
}

static PACKAGES: [Package; 7] = [
    Package {
        kind: "a task of SMACv2",
        prefixes: &[
            "smacv2/", "smacv2:", "smacv2_", "sc2v2/", "sc2v2:", "sc2v2_", "10gen_", "protoss_", "terran_",
            "zerg_",
        ],
        names: &["smacv2", "sc2v2"],
    },
    Package {
        kind: "a game of PettingZoo",
        prefixes: &[
            "atari/",
            "atari.",
            "butterfly/",
            "butterfly.",
            "classic/",
            "classic.",
            "sisl/",
            "sisl.",
            "pz_atari_",
            "pz_butterfly_",
            "pz_classic_",
            "pz_sisl_",
        ],
        names: &[
            "basketball_pong",
            "boxing",
            "combat_plane",
            "combat_tank",
            "double_dunk",
            "entombed_competitive",
            "entombed_cooperative",
            "flag_capture",
            "foozpong",
            "ice_hockey",
            "joust",
            "mario_bros",
            "maze_craze",
            "othello",
            "pong",
            "quadrapong",
            "space_invaders",
            "space_war",
            "surround",
            "tennis",
            "video_checkers",
            "volleyball_pong",
            "warlords",
            "wizard_of_wor",
            "cooperative_pong",
            "knights_archers_zombies",
            "pistonball",
            "chess",
            "connect_four",
            "gin_rummy",
            "go",
            "hanabi",
            "leduc_holdem",
            "rps",
            "texas_holdem",
            "texas_holdem_no_limit",
            "tictactoe",
            "multiwalker",
            "pursuit",
            "waterworld",
        ],
    },
    Package {
        kind: "a layout of Overcooked",
        prefixes: &["overcooked"],
        names: &[
            "asymmetric_advantages",
            "asymmetric_advantages_tomato",
            "bonus_order_test",
            "bottleneck",
            "centre_objects",
            "centre_pots",
            "coordination_ring",
            "counter_circuit",
            "counter_circuit_o_1order",
            "cramped_corridor",
            "cramped_room",
            "cramped_room_o_3orders",
            "cramped_room_single",
            "cramped_room_tomato",
            "five_by_five",
            "forced_coordination",
            "forced_coordination_tomato",
            "inverse_marshmallow_experiment",
            "large_room",
            "long_cook_time",
            "m_shaped_s",
            "marshmallow_experiment",
            "marshmallow_experiment_coordination",
            "mdp_test",
            "multiplayer_schelling",
            "old_dynamics_cook_test",
            "old_dynamics_put_test",
            "pipeline",
            "random0",
            "random3",
            "scenario1_s",
            "scenario2",
            "scenario2_s",
            "scenario3",
            "scenario4",
            "schelling",
            "schelling_s",
            "simple_o",
            "simple_o_t",
            "simple_tomato",
            "small_corridor",
            "soup_coordination",
            "tutorial_0",
            "tutorial_1",
            "tutorial_2",
            "tutorial_3",
            "unident",
            "you_shall_not_pass",
        ],
    },
    Package { kind: "a task of Pressure Plate", prefixes: &["pressureplate"], names: &[] },
    Package { kind: "a task of Capture Target", prefixes: &["capturetarget"], names: &[] },
    Package { kind: "a task of Box Pushing", prefixes: &["boxpushing"], names: &[] },
    Package { kind: "a matrix game or a task of VMAS", prefixes: &["matrixgames", "vmas"], names: &[] },
];

/// The reason for refusing a name of another package's world.
pub(crate) fn why_not_here(name: &str) -> Option<String> {
    let name = plain(name);
    let is_of = |package: &&Package| {
        package.names.contains(&&*name) || package.prefixes.iter().any(|prefix| name.starts_with(prefix))
    };
    let Package { kind, .. } = PACKAGES.iter().find(is_of)?;
    Some(format!("it is {kind}, and Rondo does not have that world; `rondo tasks` lists what it has"))
}

/// In lower case, with `_` for `-`, without `pettingzoo` in front and without the version.
fn plain(name: &str) -> String {
    let name = name.to_ascii_lowercase().replace('-', "_");
    let name =
        name.strip_prefix("pettingzoo").map_or(&*name, |rest| rest.trim_start_matches(['.', '/', ':']));
    match name.rsplit_once("_v") {
        Some((name, version)) if !version.is_empty() && version.bytes().all(|byte| byte.is_ascii_digit()) => {
            name
        }
        _ => name,
    }
    .to_owned()
}
