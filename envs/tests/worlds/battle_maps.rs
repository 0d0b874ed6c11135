//! Maps of one's own: what is read, and what is refused with the line.

use envs::{task, task_of_map, End};

/// A good map, a line each.
const GOOD: [&str; 15] = [
    r#"name = "mine""#,
    "limit = 30",
    "size = [20, 16]",
    "blocked = [[0, 0, 20, 2], [9, 2, 1, 3]]",
    "attack = [5, 8]",
    "[[allies]]",
    "at = [5, 8]",
    r#"units = [["stalker", 2], ["tank", 1]]"#,
    "[[enemies]]",
    "at = [15, 8]",
    r#"units = [["zealot", 3]]"#,
    "[units.tank]",
    r#"health = 175"#,
    r#"damage = 15"#,
    r#"range = 7
speed = 3.15
size = 1.75
cooldown = 0.74
hits = ["ground"]"#,
];

fn with(line: usize, text: &str) -> String {
    let mut lines = GOOD.to_vec();
    lines[line - 1] = text;
    lines.join("\n")
}

fn refusal(text: &str) -> String {
    task_of_map(text).expect_err("no map").to_string()
}

#[test]
fn a_map_of_ones_own_is_played_with_units_of_its_own() {
    let task = task_of_map(&GOOD.join("\n")).unwrap();
    assert_eq!((task.name(), task.rules()), ("smaclite-mine", "smaclite"));
    // Three types, of which the allies have two; both sides have shields.
    let (others, enemies) = (2 * (4 + 2 + 3), 3 * (4 + 2 + 3));
    assert_eq!(task.sizes().obs_size, vec![4 + enemies + others + 2 + 3; 3]);
    assert_eq!((task.sizes().n_actions[0], task.sizes().episode_limit), (6 + 3, 30));
    let limits = task.with_rules("SMAC-limits").unwrap();
    assert_eq!((limits.name(), limits.sizes().episode_limit), ("smaclite-mine-smac-limits", 30));
    assert_eq!(envs::named_task_of_map(limits.name(), limits.map().unwrap()).unwrap().name(), limits.name());
    let mut world = task.make();
    let mut chance = rand_chacha::rand_core::SeedableRng::seed_from_u64(1);
    let chance: &mut rand_chacha::ChaCha8Rng = &mut chance;
    world.reset(chance);
    let mut rewards = [0.0; 3];
    let steps = (1..).find(|_| world.step(&[1; 3], chance, &mut rewards) != End::Running);
    assert!(steps.is_some_and(|steps| steps <= 30), "{steps:?}");
    let other = envs::named_task_of_map("smaclite-yours", task.map().unwrap()).unwrap_err().to_string();
    assert_eq!(other, "the map is that of `smaclite-mine`, not of `smaclite-yours`");
}

#[test]
fn a_bad_map_is_refused_with_the_line() {
    for (line, text, expected) in [
        (1, "name = \"my map\"", "line 1: expected a name of 1 to 40 letters, digits and `_`, found `my map`"),
        (1, "name = \"\"", "line 1: expected a name of 1 to 40 letters"),
        (1, "name = \"3s5z\"", "line 1: `3s5z` is the name of a map of SMAC: give yours a name of its own"),
        (1, "name = \"25m\"", "line 1: `25m` is the name of a map of SMAC"),
        (1, "name = 3", "line 1: invalid type: integer `3`, expected a string"),
        (1, "", "line 1: missing field `name`"),
        (2, "limit = 0", "line 2: expected a limit of 1 to 100000 steps, found 0"),
        (2, "limit = -3", "line 2: invalid value: integer `-3`, expected u32"),
        (2, "limit = 30\nfog = true", "line 3: unknown field `fog`, expected one of "),
        (2, "limit = 30\nsmac_limit = 1000000", "line 3: expected a limit of 1 to 100000 steps, found 1000000"),
        (2, "limit = ", "line 2: "),
        (3, "size = [3, 16]", "line 3: expected a size of 4 to 256 cells each way, found 3 x 16"),
        (3, "size = [20, 257]", "line 3: expected a size of 4 to 256 cells each way, found 20 x 257"),
        (3, "size = [20]", "line 3: invalid length 1"),
        (4, "blocked = [[0, 0, 20, 2], [9, 2, 12, 3]]", "line 4: expected blocked cells within the map of 20 x 16 cells, found 12 x 3 cells from (9, 2) on"),
        (4, "blocked = [[0, 0, 20, 2],\n[9, 2, 0, 3]]", "line 5: expected blocked cells within the map of 20 x 16 cells, found 0 x 3"),
        (4, "blocked = [[4294967295, 0, 20, 2]]", "line 4: expected blocked cells within the map"),
        (4, "blocked = [[0.5, 0, 20, 2]]", "line 4: invalid type: floating point `0.5`, expected u32"),
        (4, "blocked = [[4, 6, 2, 4]]", "line 8: a stalker would start at ("),
        (5, "attack = [20, 8]", "line 5: expected a point on the map, found [20.0, 8.0]"),
        (5, "attack = [nan, 8]", "line 5: expected a point on the map, found [NaN, 8.0]"),
        (5, "attack = [inf, 8]", "line 5: expected a point on the map, found [inf, 8.0]"),
        (7, "at = [-1, 8]", "line 7: expected a point on the map, found [-1.0, 8.0]"),
        (7, "at = [nan, 8]", "line 7: expected a point on the map, found [NaN, 8.0]"),
        (7, "at = [0, 8]", "line 8: a stalker would start at (-"),
        (8, "units = [[\"stalkr\", 2]]", "line 8: unknown unit `stalkr`: expected one of baneling, colossus, marauder, marine, medivac, stalker, zealot, zergling, or one that the map describes in `[units.stalkr]`"),
        (8, "units = []", "line 8: expected units in this group, found none"),
        (8, "units = [[\"stalker\", 0]]", "line 8: expected at least one, and at most 128 units on the map: found 0 more with room for 128"),
        (8, "units = [[\"marine\", 129]]", "line 8: expected at least one, and at most 128 units on the map: found 129 more with room for 128"),
        (8, "units = [[\"marine\", 4294967295]]", "line 8: expected at least one, and at most 128"),
        (8, "units = [[\"stalker\", 2]]\n[[allies]]\nat = [5, 8]\nunits = [[\"zealot\", 1]]", "line 11: a zealot would start at (5, 8), over a stalker that starts there too"),
        (10, "at = [6, 8]", "line 11: a zealot would start at ("),
        (9, "[[foes]]", "line 9: unknown field `foes`"),
        (13, "health = 0", "line 12: expected a health from above 0 to 10000, found 0"),
        (13, "health = nan", "line 12: expected a health from above 0 to 10000, found NaN"),
        (14, "damage = -1", "line 12: expected a damage from 0 to 10000, found -1"),
        (14, "damage = 15\nattacks = 0", "line 12: expected 1 to 100 attacks at once, found 0"),
        (15, "range = 7\nspeed = 3\nsize = inf\nhits = [\"ground\"]", "line 12: expected a size from 0.01 to 8, found inf"),
        (15, "range = 7\nspeed = 3\nsize = 1\nhits = []", "line 12: expected `ground`, `air` or both in `hits`, found nothing"),
        (15, "range = 7\nspeed = 3\nsize = 1\nhits = [\"sea\"]", "line 18: unknown variant `sea`, expected `ground` or `air`"),
        (15, "range = 7\nspeed = 3\nsize = 1", "line 12: missing field `hits`"),
    ] {
        let message = refusal(&with(line, text));
        assert!(message.starts_with(expected), "line {line} as {text:?}:\n{message}\n{expected}");
    }
    let no_allies: Vec<&str> = [&GOOD[..5], &GOOD[8..]].concat();
    assert_eq!(
        refusal(&no_allies.join("\n")),
        "line 1: map mine has no allies: expected a group `[[allies]]`"
    );
    let no_enemies: Vec<&str> = [&GOOD[..8], &GOOD[11..]].concat();
    assert_eq!(
        refusal(&no_enemies.join("\n")),
        "line 1: map mine has no enemies: expected a group `[[enemies]]`"
    );
    for nothing in ["", "\0", "name", "[", "= 1"] {
        assert!(refusal(nothing).starts_with("line 1: "), "{nothing:?}");
    }
}

#[test]
fn a_battle_has_no_opponent_and_the_rules_that_it_has() {
    for task in [task("smaclite-3m").unwrap(), task_of_map(&GOOD.join("\n")).unwrap()] {
        let error = task.with_opponent(&envs::Opponent::Random).unwrap_err().to_string();
        assert_eq!(error, format!("task `{}`: a battle has no opponent to choose", task.name()));
        assert!(task.with_opponent(&envs::Opponent::Builtin).is_ok());
        let error = task.with_rules("v3").unwrap_err().to_string();
        assert!(error.ends_with("has no rules `v3`; there are smaclite, smac-limits"), "{error}");
    }
    for (map, limit) in [("MMM2", 180), ("3s5z", 150), ("3s_vs_5z", 250), ("2c_vs_64zg", 400), ("3m", 60)] {
        let usual = task(map).unwrap();
        let limits = usual.with_rules("smac-limits").unwrap();
        assert_eq!((usual.sizes().episode_limit, limits.sizes().episode_limit), (150, limit), "{map}");
        assert_eq!(limits.name(), format!("smaclite-{}-smac-limits", map.to_lowercase()));
        assert_eq!(task(limits.name()).unwrap().sizes(), limits.sizes());
        assert_eq!(limits.with_rules("smaclite").unwrap().name(), usual.name());
    }
}
