//! The measured cases: tasks, learners and environment copies, in named suites.

/// Where a case runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Where {
    /// Every role a process, on Unix sockets.
    Processes,
    /// Every role a thread of this process.
    InProcess,
    /// Two runs side by side, each in this process and on one core of its own; their speeds are added.
    PairInProcess,
}

impl Where {
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Processes => "processes",
            Self::InProcess => "in-process",
            Self::PairInProcess => "2 in-process",
        }
    }
}

/// Other work on the machine during the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beside {
    /// None.
    Nothing,
    /// An endless loop on each core, with this nice value.
    Loops { nice: u8 },
    /// A second run of the same kind.
    ARun,
}

impl Beside {
    /// `None` for an idle machine.
    pub fn name(self) -> Option<String> {
        match self {
            Self::Nothing => None,
            Self::Loops { nice: 0 } => Some("loops of equal priority".to_owned()),
            Self::Loops { nice } => Some(format!("loops at nice {nice}")),
            Self::ARun => Some("a second run".to_owned()),
        }
    }
}

/// One line of the table; all other settings are those of `rondo train TASK --algo ALGO`.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub task: &'static str,
    pub algo: &'static str,
    pub copies: u32,
    /// Environment steps of a run: some seconds.
    pub steps: u64,
    pub places: &'static [Where],
    pub beside: &'static [Beside],
}

const BOTH: &[Where] = &[Where::Processes, Where::InProcess];

const fn case(
    task: &'static str,
    algo: &'static str,
    copies: u32,
    steps: u64,
    places: &'static [Where],
) -> Case {
    Case { task, algo, copies, steps, places, beside: &[Beside::Nothing] }
}

/// Idle first, because the others are compared with it.
const BUSY: &[Beside] = &[
    Beside::Nothing,
    Beside::Loops { nice: 19 },
    Beside::Loops { nice: 10 },
    Beside::Loops { nice: 0 },
    Beside::ARun,
];

/// A named list of cases.
pub struct Suite {
    pub name: &'static str,
    pub about: &'static str,
    pub cases: &'static [Case],
}

pub const SUITES: [Suite; 8] = [
    Suite {
        name: "quick",
        about: "one small case, to see whether anything changed",
        cases: &[case("lbf-5x5-2p-1f", "ippo", 10, 60_000, BOTH)],
    },
    Suite {
        name: "lbf",
        about: "foraging: IPPO, GRU 128",
        cases: &[
            case("lbf-8x8-2p-2f-coop", "ippo", 10, 80_000, BOTH),
            case("lbf-8x8-2p-2f-coop", "ippo", 64, 200_000, BOTH),
            case("lbf-15x15-4p-3f", "ippo", 10, 50_000, BOTH),
        ],
    },
    Suite {
        name: "mpe",
        about: "particle worlds: IPPO, FC 128",
        cases: &[
            case("mpe-simple-speaker-listener", "ippo", 10, 200_000, BOTH),
            case("mpe-simple-speaker-listener", "ippo", 64, 300_000, BOTH),
            case("mpe-simple-tag", "ippo", 10, 120_000, BOTH),
            case("mpe-simple-tag", "ippo", 64, 200_000, BOTH),
            case("mpe-simple-tag", "ippo", 10, 120_000, &[Where::PairInProcess]),
        ],
    },
    Suite {
        name: "rware",
        about: "warehouse: IPPO, FC 128",
        cases: &[case("rware-tiny-4ag", "ippo", 10, 80_000, BOTH)],
    },
    Suite {
        name: "q",
        about: "IQL with the reference's schedule: one copy, one update call per episode",
        cases: &[
            case("lbf-8x8-2p-2f-coop", "iql", 1, 30_000, BOTH),
            case("mpe-simple-speaker-listener", "iql", 1, 30_000, BOTH),
            case("rware-tiny-4ag", "iql", 1, 60_000, BOTH),
        ],
    },
    Suite {
        name: "busy",
        about: "a machine with other work: IPPO and IQL beside a loop on each core, and beside a second run",
        cases: &[
            Case { beside: BUSY, ..case("mpe-simple-speaker-listener", "ippo", 10, 100_000, BOTH) },
            Case { beside: BUSY, ..case("mpe-simple-speaker-listener", "iql", 1, 15_000, BOTH) },
        ],
    },
    Suite {
        name: "agents",
        about: "growth with the team: IPPO, 64 copies",
        cases: &[
            case("lbf-15x15-2p-3f", "ippo", 64, 150_000, BOTH),
            case("lbf-15x15-4p-3f", "ippo", 64, 100_000, BOTH),
            case("lbf-15x15-8p-3f", "ippo", 64, 60_000, BOTH),
            case("lbf-15x15-16p-3f", "ippo", 64, 40_000, BOTH),
        ],
    },
    Suite {
        name: "copies",
        about: "growth with the copies: IPPO, 2 agents",
        cases: &[
            case("lbf-8x8-2p-2f-coop", "ippo", 64, 200_000, BOTH),
            case("lbf-8x8-2p-2f-coop", "ippo", 256, 300_000, BOTH),
            case("lbf-8x8-2p-2f-coop", "ippo", 1024, 400_000, BOTH),
            case("mpe-simple-speaker-listener", "ippo", 1024, 600_000, BOTH),
        ],
    },
];
