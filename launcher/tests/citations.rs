//! Every citation of a section names a document of `docs/spec/` and a section that this document has.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Written as an escape, so that this file cites nothing.
const SIGN: char = '\u{a7}';
/// Files that may cite.
const EXTENSIONS: [&str; 5] = ["rs", "md", "toml", "py", "sh"];
/// Folders that hold nothing of the repository.
const FOREIGN: [&str; 3] = ["target", "runs", "shared"];
/// What stands between two sections of one citation: the second needs no document of its own.
const JOINTS: [&str; 4] = [", ", " and ", " or ", " to "];

/// The sections of each document, by its name in citations.
type Documents = BTreeMap<String, BTreeSet<String>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn documents() -> Documents {
    let folder = root().join("docs/spec");
    let entries = fs::read_dir(&folder).expect("the folder of the specification");
    let paths = entries.map(|entry| entry.expect("a readable folder").path());
    let pages = paths.filter(|path| path.extension().is_some_and(|extension| extension == "md"));
    pages.map(|path| (name(&path), sections(&fs::read_to_string(&path).expect("a page")))).collect()
}

fn name(path: &Path) -> String {
    path.file_stem().expect("a file").to_string_lossy().into_owned()
}

/// The numbers of headings such as `## 3. Reset` and `### 5.1 Order`.
fn sections(page: &str) -> BTreeSet<String> {
    let headings = page
        .lines()
        .filter_map(|line| line.trim_start_matches('#').strip_prefix(' ').filter(|_| line.starts_with("##")));
    let numbers = headings.filter_map(|heading| heading.split(' ').next());
    let numbers = numbers.map(|number| number.trim_end_matches('.')).filter(|number| is_number(number));
    numbers.map(str::to_owned).collect()
}

fn is_number(text: &str) -> bool {
    text.split('.').all(|part| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit()))
}

/// A text in one line, without the marks that begin a line of comment, so that a citation may go over a line's end.
fn in_one_line(text: &str) -> String {
    let lines = text.lines().map(|line| line.trim_start_matches(['/', '!', '#', '*', ' ', '\t']).trim_end());
    lines.collect::<Vec<_>>().join(" ")
}

/// What is wrong with the citations of a text; `own` is the document that it is part of, if it is one.
fn mistakes(text: &str, own: Option<&str>, documents: &Documents) -> Vec<String> {
    let text = in_one_line(text);
    let mut mistakes = Vec::new();
    // The document of the citation before, and where that ended.
    let mut before: Option<(&str, usize)> = None;
    for (at, _) in text.match_indices(SIGN) {
        let rest = &text[at + SIGN.len_utf8()..];
        let length = rest.find(|c: char| c != '.' && !c.is_ascii_digit()).unwrap_or(rest.len());
        let section = rest[..length].trim_end_matches('.');
        let cited = {
            let start = text[..at].char_indices().rev().nth(40).map_or(0, |(start, _)| start);
            format!("{}{SIGN}{section}", &text[start..at])
        };
        let word = text[..at].strip_suffix(' ').map_or("", |text| {
            text.rsplit(|c: char| c != '-' && !c.is_ascii_alphanumeric()).next().unwrap_or_default()
        });
        let continues = |&(_, end): &(&str, usize)| JOINTS.contains(&&text[end..at]);
        let document = match before.filter(continues) {
            _ if documents.contains_key(word) => Some(word),
            Some((document, _)) => Some(document),
            None => own,
        };
        match document {
            None => mistakes.push(format!("`…{cited}` names no document of docs/spec")),
            Some(document) if !documents[document].contains(section) => {
                mistakes.push(format!("`…{cited}`: docs/spec/{document}.md has no such section"));
            }
            Some(_) => {}
        }
        before = document.map(|document| (document, at + SIGN.len_utf8() + section.len()));
    }
    mistakes
}

/// All files of the repository that may cite.
fn files() -> Vec<PathBuf> {
    let mut folders = vec![root()];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("a readable folder") {
            let entry = entry.expect("a readable folder");
            let (path, file_name) = (entry.path(), entry.file_name());
            let file_name = file_name.to_string_lossy();
            let kind = entry.file_type().expect("a file or a folder");
            if kind.is_dir() && !file_name.starts_with('.') && !FOREIGN.contains(&&*file_name) {
                folders.push(path);
            } else if kind.is_file()
                && path.extension().is_some_and(|e| EXTENSIONS.iter().any(|&known| e == known))
            {
                files.push(path);
            }
        }
    }
    files
}

#[test]
fn every_cited_section_exists_in_the_document_that_is_named() {
    let documents = documents();
    let (mut found, mut citations) = (Vec::new(), 0);
    for path in files() {
        let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let page = name(&path);
        let own = path.parent().is_some_and(|folder| folder.ends_with("docs/spec")).then_some(&*page);
        citations += text.matches(SIGN).count();
        let of_file = mistakes(&text, own, &documents).into_iter();
        found.extend(of_file.map(|mistake| format!("{}: {mistake}", path.display())));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
    assert!(citations > 150, "only {citations} citations: are the files read?");
}

#[test]
fn citations_without_a_document_or_of_a_missing_section_are_found() {
    let documents = Documents::from([
        ("lbf".to_owned(), sections("# Title\n## 3. Reset\n### 3.1 Players\ntext\n## 4. Actions\n")),
        ("mpe".to_owned(), sections("## 3. Reset\n")),
    ]);
    let check = |text: &str, own| mistakes(&text.replace('@', "\u{a7}"), own, &documents).len();
    for good in [
        "(lbf @3.1)",
        "`lbf @3`, rule 4",
        "lbf @3, @4 and mpe @3.",
        "/// see lbf\n    /// @3.1: text",
        "lbf @3.1 to @4",
    ] {
        assert_eq!(check(good, None), 0, "{good}");
    }
    for bad in [
        "(@3)",
        "spec @3",
        "lbf @5",
        "lbf @3.2",
        "mpe @4",
        "lbf @3, then @4",
        "mpe @3, @4",
        "lbf @",
        "lbf @@3, 4",
    ] {
        assert!(check(bad, None) > 0, "{bad}");
    }
    assert_eq!(check("(@3) and mpe @3", Some("lbf")), 0);
    assert_eq!(check("mpe @3, then @3.1", Some("lbf")), 0);
    assert_eq!(check("@3.1", Some("mpe")), 1);
}
