//! `docs/segmentation.md` says what the code says: its tables and its drawing are generated from the sources, and the names
//! in it are names of the engine. `MODLENS_UPDATE=1` writes the generated parts again.

use std::collections::HashSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use modlens_engine::weights::{TABLE, UNITS};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|why| panic!("{path}: {why}"))
}

/// The units that names of weights end in, as a list.
fn units() -> String {
    UNITS.iter().fold(String::new(), |mut text, (ending, meaning)| {
        writeln!(text, "- `{ending}`: {meaning}").unwrap();
        text
    })
}

/// All weights, a table for each group.
fn weights() -> String {
    let mut text = String::new();
    for group in TABLE {
        write!(text, "\n**{}**\n\n| weight | value | reason |\n| --- | --- | --- |\n", group.title).unwrap();
        for weight in group.weights {
            writeln!(text, "| `{}` | {} | {} |", weight.name, weight.value, weight.reason.trim()).unwrap();
        }
    }
    text.trim_start().to_string()
}

/// The drawing of the states, from the page of the module that commits.
fn commit() -> String {
    let page = read("crates/modlens-engine/src/framer/rtu/search/commit/mod.rs");
    let lines = page.lines().map(|line| line.strip_prefix("//!").unwrap_or_default());
    let drawing = lines.skip_while(|line| !line.ends_with("```text")).skip(1).take_while(|line| !line.ends_with("```"));
    drawing.fold(String::from("```\n"), |text, line| text + line + "\n") + "```\n"
}

/// Returns the command that measures accuracy and the table that follows it in the page of figures.
fn accuracy() -> String {
    let page = read("docs/figures.md");
    let command = page.split('`').find(|text| text.contains("modlens-bench -- accuracy")).expect("the page has the command");
    let behind = page.split(command).nth(1).expect("something follows the command");
    let table = behind.lines().skip_while(|line| !line.starts_with('|')).take_while(|line| line.starts_with('|'));
    table.fold(format!("```console\n$ {command}\n```\n\n"), |text, row| text + row + "\n")
}

#[test]
fn generated_parts_are_those_of_the_sources() {
    let path = "docs/segmentation.md";
    let before = read(path);
    let mut after = before.clone();
    for (name, part) in [("units", units()), ("weights", weights()), ("commit", commit()), ("accuracy", accuracy())] {
        let begin = format!("<!-- {name}: generated -->\n");
        let at = after.find(&begin).unwrap_or_else(|| panic!("{path} has no part {name}")) + begin.len();
        let end = at + after[at..].find("<!-- end -->").expect("the part ends");
        after.replace_range(at..end, &format!("\n{part}\n"));
    }
    if std::env::var("MODLENS_UPDATE").is_ok_and(|update| update == "1") {
        std::fs::write(root().join(path), &after).unwrap();
        return;
    }
    let differs = before.lines().zip(after.lines()).find(|(old, new)| old != new);
    assert!(before == after, "{path} differs from the sources, first in {differs:?}; MODLENS_UPDATE=1 writes it again");
}

/// The words of all Rust files below a folder.
fn add_words(folder: &Path, words: &mut HashSet<String>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            add_words(&path, words);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path).unwrap();
            words.extend(text.split(|c: char| !(c.is_alphanumeric() || c == '_')).map(String::from));
            words.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        }
    }
}

#[test]
fn names_in_the_document_are_names_in_the_code() {
    let mut words = HashSet::new();
    for crate_name in ["modlens-engine", "modlens-protocol"] {
        add_words(&root().join("crates").join(crate_name).join("src"), &mut words);
    }
    let document = read("docs/segmentation.md");
    let prose: String = document.split("```").step_by(2).collect();
    let is_name = |text: &&str| text.chars().all(|c| c.is_alphanumeric() || c == '_') && text.len() > 2;
    let names: Vec<&str> = prose.split('`').skip(1).step_by(2).filter(is_name).collect();
    assert!(names.len() > 30, "{names:?}");
    for name in names {
        assert!(words.contains(name) || ["code", "field", "hostile"].contains(&name), "{name} is no name of the code");
    }
}
