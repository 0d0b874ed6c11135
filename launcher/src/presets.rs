//! `rondo presets`: the published settings as a table, with the source of each, and Rondo's own choices.

use process::Failure;
use proto::config::{AlgoName, Config, Learner, RewardStandardisation};
use proto::presets::{self, Family};

/// Print the published settings
#[derive(Debug, Clone, clap::Args)]
pub struct Presets {}

/// The families whose worlds Rondo has, and the prefixes of their tasks' names.
const FAMILIES: [(Family, &str); 4] =
    [(Family::Lbf, "lbf"), (Family::Rware, "rware"), (Family::Mpe, "mpe"), (Family::Smac, "smaclite")];

impl Presets {
    pub fn run(&self) -> Result<(), Failure> {
        print!("{}", text());
        Ok(())
    }
}

fn text() -> String {
    let mut text = String::from(
        "Settings of the paper (multi-timescale learning, CoLLAs 2023), without parameter sharing. `--paper` takes all \
         of\na column except end_of_batch, which is then epymarl; without it, `rondo train` takes a smaller budget, the \
         newest\nrules and no padding.\n\n",
    );
    for (title, name) in [("mtppo, ippo, sppo", AlgoName::Ippo), ("mtql, iql, sql", AlgoName::Iql)] {
        text += &table(title, name);
        text.push('\n');
    }
    text + OPEN
}

/// One row for each setting: its name, its value in every family, its source.
fn table(title: &str, name: AlgoName) -> String {
    let configs = FAMILIES.map(|(family, _)| presets::config("run", "task", 2, name, family));
    let mut rows = vec![row(title, FAMILIES.map(|(_, begin)| begin.to_owned()), "source")];
    let mut add = |setting: &str, value: &dyn Fn(&Config) -> String, source: &str| {
        rows.push(row(setting, configs.each_ref().map(value), source));
    };
    add("network", &|c| format!("{:?}", c.algo.network).to_lowercase(), "paper, appendix");
    add("hidden", &|c| c.algo.hidden.to_string(), "paper, appendix");
    add("target_update", &|c| c.algo.target_update.to_string(), "paper, appendix");
    add("reward_standardisation", &|c| standardisation(c).to_owned(), "paper; which kind: the profile");
    if name.learner() == Learner::Ppo {
        let of = |c: &Config| c.ppo.clone().expect("PPO's own section");
        add("entropy_coef", &|c| of(c).entropy_coef.to_string(), "paper, appendix");
        add("n_step", &|c| of(c).n_step.to_string(), "paper, appendix");
        add("epochs, clip", &|c| format!("{}, {}", of(c).epochs, of(c).clip), "EPyMARL");
        add("end_of_batch", &|c| of(c).end_of_batch.to_string(), "our choice: by EPyMARL's, teams unlearn");
    } else {
        let of = |c: &Config| c.q.clone().expect("Q-learning's own section");
        add("buffer, batch", &|c| format!("{}, {}", of(c).buffer, of(c).batch), "EPyMARL, in episodes");
        add("draws", &|c| format!("{:?}", of(c).draws).to_lowercase(), "EPyMARL: one minibatch for the team");
        add("epsilon_anneal", &|c| of(c).epsilon_anneal.to_string(), "[OPEN] EPyMARL without sharing");
        add("test_epsilon", &|c| of(c).test_epsilon.to_string(), "[OPEN] EPyMARL");
    }
    add("gamma, max_grad_norm", &|c| format!("{}, {}", c.algo.gamma, c.algo.max_grad_norm), "EPyMARL");
    add("copies", &|c| c.world.copies.to_string(), "EPyMARL");
    add("t_max", &|c| millions(c.t_max), "benchmark");
    add("test.interval", &|c| millions(c.test.interval), "benchmark: 41 tests");
    let grids = FAMILIES.map(|(family, _)| presets::rate_grid(name.learner(), family));
    rows.push(row("rates, from", grids.map(|grid| format!("{:e}", grid[0])), "paper, appendix"));
    rows.push(row(
        "rates, centre",
        grids.map(|grid| format!("{:e}", grid[grid.len() / 2])),
        "paper, appendix",
    ));
    rows.push(row("rates, to", grids.map(|grid| format!("{:e}", grid[grid.len() - 1])), "paper, appendix"));
    let rules = FAMILIES.map(|(_, begin)| {
        let family = envs::FAMILIES.iter().find(|family| family.name == begin);
        family.map_or("–", |family| family.paper_rules).to_owned()
    });
    rows.push(row("rules", rules, "by date of the paper"));
    rows.concat()
}

fn row(setting: &str, [lbf, rware, mpe, smaclite]: [String; 4], source: &str) -> String {
    format!("{setting:24}{lbf:>10}{rware:>10}{mpe:>10}{smaclite:>13}   {source}\n")
}

fn standardisation(config: &Config) -> &'static str {
    match config.algo.reward_standardisation {
        RewardStandardisation::Off => "off",
        _ => "on",
    }
}

fn millions(steps: u64) -> String {
    if steps.is_multiple_of(1_000_000) {
        format!("{} M", steps / 1_000_000)
    } else {
        format!("{} k", steps / 1_000)
    }
}

/// What no source gives (marked [OPEN] in `docs/spec/algorithms.md`), and our choice.
const OPEN: &str = "\
The papers do not say, so this is our choice; each is a key of the configuration:
  rates         mtppo and mtql start at twice the centre c and at c * 2^(-1/(n-1)) for the n-1 others, which keeps
                the geometric mean of the team at c (two agents: 2c and c/2); sppo and sql at c and zero. The best
                pairs are not published, so --paper takes these too
  switch_period 100 update calls, the middle of the published 1 to 10,000
  switch_unit   update calls; for PPO also gradient steps, in multiples of ppo.epochs
  smallest rate 3.75e-5 for Q-learning in foraging, printed as 3.7e-5
  epsilon       1.0 to 0.05 over 50,000 environment steps; 0 in tests
  clip_scope    per agent: processes of their own share no gradient norm (the reference clips the team's)
  frozen_moments at rate 0 Adam's moments follow the gradients, as PyTorch's do
  profile       rondo, the default: running reward statistics, end_of_batch correct; epymarl, which --paper takes:
                the same statistics, end_of_batch epymarl; benchmark2021: the batch's own statistics, end_of_batch
                benchmark2021

What the critic expects where a batch ends (ppo.end_of_batch), for episodes that stop early or at the step limit:
  correct       after the step limit, the target critic's value; after an episode that is over, nothing
  epymarl       the target critic's value at the end of the longest episode, also after episodes that are over: it
                then expects more than there is, and foraging teams unlearn by it
  benchmark2021 the target critic's value one step earlier, in place of the last reward
  no_bootstrap  nothing, not even after the step limit
Where every episode ends at the step limit, correct and epymarl are the same.
";

#[cfg(test)]
mod tests {
    use proto::config::{EndOfBatch, Profile};

    use super::*;

    #[test]
    fn the_table_has_the_papers_numbers() {
        let text = text();
        for line in [
            "hidden                         128       128       128           64   paper, appendix",
            "hidden                          64        64       128           64   paper, appendix",
            "network                        gru        fc        fc           fc   paper, appendix",
            "n_step                           5        10        10           10   paper, appendix",
            "target_update                  200      0.01      0.01         0.01   paper, appendix",
            "t_max                         20 M      40 M      20 M         40 M   benchmark",
            "t_max                          2 M       4 M       2 M          4 M   benchmark",
            "rates, centre                 3e-4      5e-4      5e-4         5e-4   paper, appendix",
            "rules                           v2        v1      2021  smac-limits   by date of the paper",
            "end_of_batch               correct   correct   correct      correct   our choice: by EPyMARL's, teams unlearn",
        ] {
            assert!(text.contains(line), "{line}\nis not in\n{text}");
        }
    }

    #[test]
    fn every_profile_and_every_rule_for_the_end_of_a_batch_is_explained() {
        let text = text();
        for rule in EndOfBatch::ALL {
            assert!(text.contains(&format!("\n  {:14}", rule.as_str())), "{rule} is not in\n{text}");
        }
        let profiles = text.split("\n  profile ").nth(1).and_then(|rest| rest.split("\n\n").next()).unwrap();
        for profile in Profile::ALL {
            assert!(profiles.contains(&format!("{profile}")), "{profile} is not in\n{profiles}");
        }
    }
}
