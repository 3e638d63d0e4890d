//! What the joint explanation gains over independent tests, on the same observations.
//!
//! ```text
//! python -m tests.doctor.score --write FOLDER --seeds 1-5
//! cargo run --release -p modlens-diagnosis --example ablation < FOLDER/cases.tsv
//! ```
//!
//! A line of the input: the file, its line settings or nothing, the code that is expected or nothing for a healthy recording,
//! separated by tabs. Each recording is counted once. Then the causes are ordered in four ways: every test by itself, by the
//! requests that it says are spoiled, or by its chance; without those that another cause explains; and as the doctor says it.
//! With `--each` the causes of each recording are printed, too.

use std::io::{BufRead, Write};
use std::sync::Arc;

use modlens_diagnosis::claim::{Claim, View};
use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::kinds;
use modlens_diagnosis::report::Report;
use modlens_engine::session::{Session, WantedTables};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_recording::{Options, Recording};

const WAYS: [&str; 4] = ["independent, by harm", "independent, by chance", "without explained ones", "joint (the doctor)"];

/// How often a way of ordering was right.
#[derive(Clone, Copy, Default)]
struct Score {
    first: usize,
    among_three: usize,
    /// Causes beside the expected one that were named.
    others: usize,
    /// Healthy recordings without any cause.
    clean: usize,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let is_each = std::env::args().any(|word| word == "--each");
    let (mut scores, mut troubled, mut healthy) = ([Score::default(); WAYS.len()], 0, 0);
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let columns = <[&str; 3]>::try_from(line.split('\t').collect::<Vec<_>>());
        let [file, settings, code] = columns.map_err(|_| "three columns are needed")?;
        let contrast = counted(file, settings)?;
        *(if code.is_empty() { &mut healthy } else { &mut troubled }) += 1;
        for ((score, codes), way) in scores.iter_mut().zip(ordered(contrast)).zip(WAYS) {
            if is_each {
                writeln!(std::io::stdout(), "{file}: {code}: {way}: {}", codes.join(" "))?;
            }
            let place = codes.iter().position(|found| *found == code);
            score.first += usize::from(place == Some(0));
            score.among_three += usize::from(place.is_some_and(|place| place < 3));
            score.others += if code.is_empty() { 0 } else { codes.iter().filter(|found| **found != code).count() };
            score.clean += usize::from(code.is_empty() && codes.is_empty());
        }
    }
    let mut out = std::io::stdout().lock();
    let head = format!("{troubled} recordings with one trouble, {healthy} healthy");
    writeln!(out, "| {head} | first | among three | other causes named | healthy clean |")?;
    writeln!(out, "| --- | --- | --- | --- | --- |")?;
    for (way, score) in WAYS.iter().zip(scores) {
        writeln!(out, "| {way} | {} | {} | {} | {} |", score.first, score.among_three, score.others, score.clean)?;
    }
    Ok(())
}

/// The counters of a recording.
fn counted(file: &str, settings: &str) -> Result<Contrast, Box<dyn std::error::Error>> {
    let wanted = WantedTables { frames: true, transactions: true, findings: true };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
    let line = if settings.is_empty() { None } else { Some(settings.parse::<LineSettings>()?) };
    let mut recording = Recording::new(Options { name: file.to_owned(), line, ..Options::default() });
    let refused = |refusal| format!("{file}: {refusal:?}");
    recording.feed(&mut session, &std::fs::read(file)?).map_err(refused)?;
    recording.finish(&mut session).map_err(refused)?;
    let mut contrast = Contrast::default();
    contrast.observe(&session.take());
    Ok(contrast)
}

/// The codes that each way names, the first one first.
fn ordered(contrast: Contrast) -> [Vec<&'static str>; WAYS.len()] {
    let (mut left, mut all): (Vec<Claim>, Vec<Claim>) = (Vec::new(), Vec::new());
    for (_, bus) in contrast.clone().into_buses() {
        let (own, of_all_kinds) = kinds::claims(&View::new(&bus));
        left.extend(own);
        all.extend(of_all_kinds);
    }
    let by_harm = |claims: &[Claim]| {
        let mut claims: Vec<&Claim> = claims.iter().collect();
        claims.sort_by_key(|claim| std::cmp::Reverse(claim.harm));
        codes(claims.iter().map(|claim| claim.code))
    };
    let mut by_chance: Vec<&Claim> = all.iter().collect();
    by_chance.sort_by(|one, other| one.chance.total_cmp(&other.chance));
    let report = Report::of(contrast);
    [
        by_harm(&all),
        codes(by_chance.iter().map(|claim| claim.code)),
        by_harm(&left),
        codes(report.rows().iter().map(|row| row.code)),
    ]
}

/// Each code once.
fn codes(all: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
    let mut seen = Vec::new();
    all.for_each(|code| {
        if !seen.contains(&code) {
            seen.push(code);
        }
    });
    seen
}
