//! `rondo tasks`: all tasks in a table, or the description and picture of one.

use std::env;
use std::path::PathBuf;

use console::Term;
use envs::{Sizes, Task};
use monitor::picture::{self, Colours, Frame};
use process::Failure;
use proto::exit;

use super::unusable;
use crate::experiment::read_map;

/// Width of text in letters.
const COLUMNS: usize = 100;
/// Column of a property's value.
const INDENT: usize = 14;
/// The episode of the picture.
const SEED: u64 = 1;
/// Pixels from left to right of the picture in a file.
const WIDTH: u32 = 720;
/// Most rows of a picture in the terminal, so that the text above stays visible.
const MOST_ROWS: u16 = 40;

/// List the tasks, or explain one
#[derive(Debug, Clone, clap::Args)]
#[command(group = clap::ArgGroup::new("which").args(["task", "map"]))]
pub struct Tasks {
    /// The task to explain, for example lbf-8x8-2p-2f-coop
    task: Option<String>,
    /// A battle on a map of your own to explain instead
    #[arg(long, value_name = "FILE", conflicts_with = "task")]
    map: Option<PathBuf>,
    /// Draw the start of an episode into this file, .png or .svg, instead of the terminal
    #[arg(long, value_name = "FILE", requires = "which")]
    out: Option<PathBuf>,
}

impl Tasks {
    pub fn run(&self) -> Result<(), Failure> {
        let task = match (&self.task, &self.map) {
            (Some(name), _) => envs::task(name).map_err(|error| Failure::new(exit::CONFIG, error))?,
            (None, Some(file)) => read_map(file)?,
            (None, None) => {
                print!("{}", table());
                return Ok(());
            }
        };
        let Some(out) = &self.out else {
            print!("{}", explanation(&task));
            return draw_in_terminal(&task);
        };
        // Before any output, so that an error is the only output.
        picture::write_still(&frame(&task), WIDTH, out).map_err(unusable)?;
        print!("{}", explanation(&task));
        println!("\ndrawn in {}", out.display());
        Ok(())
    }
}

fn table() -> String {
    let tasks = envs::tasks();
    let width = tasks.iter().map(|task| task.name.len()).max().unwrap_or(0);
    let mut table = format!("{:width$}  agents  observation  actions  limit  rules\n", "task");
    for task in &tasks {
        let Sizes { agents, obs_size, n_actions, episode_limit } = &task.sizes;
        let list = |sizes: &[usize]| {
            let mut sizes = sizes.to_vec();
            sizes.dedup();
            sizes.iter().map(usize::to_string).collect::<Vec<_>>().join("/")
        };
        table += &format!(
            "{:width$}  {agents:>6}  {:>11}  {:>7}  {episode_limit:>5}  {}\n",
            task.name,
            list(obs_size),
            list(n_actions),
            task.source
        );
    }
    for family in envs::FAMILIES {
        table += &format!("\n{}: {}; rules {}\n", family.title, family.form, family.rules.join(", "));
    }
    table + "\n`rondo tasks TASK` explains one and draws it\n"
}

/// The description of a task.
fn explanation(task: &Task) -> String {
    let (family, sizes) = (task.family(), task.sizes());
    let mut text = format!("{}: {}\n\n", task.name(), family.title);
    for line in picture::wrap(family.about, COLUMNS) {
        text += &line;
        text.push('\n');
    }
    text.push('\n');
    let others: Vec<&str> = family.rules.iter().copied().filter(|rules| *rules != task.rules()).collect();
    let others =
        if others.is_empty() { String::new() } else { format!("; there are also {}", others.join(", ")) };
    let warning = task.warning().map(|warning| ("warning", warning));
    for (property, value) in [
        ("agents", sizes.agents.to_string()),
        ("observation", format!("{} numbers per agent", each(&sizes.obs_size))),
        ("actions", format!("{} per agent", each(&sizes.n_actions))),
        ("step limit", sizes.episode_limit.to_string()),
        ("rules", format!("{}, those of {}{others}", task.rules(), task.source())),
        ("names", family.form.to_owned()),
    ]
    .into_iter()
    .chain(warning)
    {
        let mut label = property;
        for line in picture::wrap(&value, COLUMNS - INDENT) {
            text += &format!("{label:INDENT$}{line}\n");
            label = "";
        }
    }
    text
}

/// One number if all agents have the same, else one for each.
fn each(sizes: &[usize]) -> String {
    match sizes {
        [first, rest @ ..] if rest.iter().all(|size| size == first) => first.to_string(),
        _ => sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(", "),
    }
}

/// The start of an episode.
fn frame(task: &Task) -> Frame {
    let mut world = task.make();
    world.reset(&mut proto::stream::stream(SEED, "tasks", "picture", &[]));
    Frame::new(world.scene())
}

/// Draws if stdout is a terminal, which has a size.
fn draw_in_terminal(task: &Task) -> Result<(), Failure> {
    let Some((rows, columns)) = Term::stdout().size_checked() else { return Ok(()) };
    let colours = Colours::of(env::var("COLORTERM").ok().as_deref());
    let rows = rows.min(MOST_ROWS);
    print!("\n{}", picture::terminal_text(&frame(task), columns, rows, colours).map_err(unusable)?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_a_line_for_each_task_and_each_family() {
        let table = table();
        let line = ["lbf-8x8-2p-2f-coop", "2", "12", "6", "50"];
        let is_it = |found: &&str| found.split_whitespace().take(line.len()).eq(line);
        assert_eq!(table.lines().filter(is_it).count(), 1, "{table}");
        for family in envs::FAMILIES {
            let line = format!("{}: {}; rules {}", family.title, family.form, family.rules.join(", "));
            assert_eq!(table.lines().filter(|found| **found == *line).count(), 1, "{table}");
        }
    }

    #[test]
    fn a_task_is_explained_under_its_canonical_name_on_lines_of_a_hundred_letters() {
        let task = envs::task("Foraging-8x8-2p-2f-coop-v2").unwrap();
        let text = explanation(&task);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[..2], ["lbf-8x8-2p-2f-coop-v2: Level-based foraging", ""]);
        assert!(lines.iter().all(|line| line.chars().count() <= COLUMNS), "{text}");
        let about: Vec<&str> = lines[2..].iter().copied().take_while(|line| !line.is_empty()).collect();
        assert_eq!(about.join(" "), task.family().about);
        let source = task.source();
        let expected = [
            "agents        2",
            "observation   12 numbers per agent",
            "actions       6 per agent",
            "step limit    50",
            &format!("rules         v2, those of {source}; there are also v3, v1, v0"),
            "names         lbf-[{sight}s-]{rows}x{cols}-{players}p-{foods}f[-coop][-v0|-v1|-v2|-v3]",
        ];
        assert_eq!(lines[lines.len() - 6..], expected);
    }

    #[test]
    fn a_world_that_is_not_all_that_its_name_promises_is_explained_with_a_warning() {
        let text = explanation(&envs::task("Foraging-5x5-3p-3f-coop-v2").unwrap());
        assert!(
            text.contains("\nwarning       a reset places at most 2 of the 3 foods: none lies on"),
            "{text}"
        );
        assert!(!explanation(&envs::task("lbf-5x5-3p-2f").unwrap()).contains("warning"));
    }

    #[test]
    fn agents_that_differ_are_listed_one_by_one() {
        assert_eq!(each(&[12, 12]), "12");
        assert_eq!(each(&[12, 14, 12]), "12, 14, 12");
        assert_eq!(each(&[]), "");
    }
}
