//! What is made of rows: tables, and what the doctor says.

use std::sync::Arc;

use modlens_diagnosis::contrast::{Contrast, WINDOW};
use modlens_diagnosis::report::Report;
use modlens_engine::records::Batch;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use modlens_tables::columns::{Table, TableKind};

use super::{parse_script, session, Script, START_NS};

/// The batches of a script: after each so many reads, and at the end.
fn batches(script: &Script<'_>, reads: usize) -> Vec<Batch> {
    let (mut session, bus) = session(script.mode, Clock::Utc, script.live);
    let (mut now, mut batches) = (START_NS, Vec::new());
    for these in script.reads.chunks(reads) {
        for (pause, bytes) in these {
            now += pause;
            session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
        }
        batches.push(session.take());
    }
    session.flush();
    batches.push(session.take());
    batches
}

/// All cells of all tables are written, and JSON lines are JSON: one for each row, with times that may run back.
pub fn tables_hold(data: &[u8]) {
    for batch in batches(&parse_script(data), usize::MAX) {
        let batch = Arc::new(batch);
        for kind in TableKind::ALL {
            let table = Table::new(Arc::clone(&batch), kind);
            let columns: Vec<usize> = (0..kind.columns().len()).collect();
            let (mut lines, mut cells) = (Vec::new(), Vec::new());
            modlens_writers::jsonl::rows(&table, &columns, &mut lines);
            modlens_writers::csv::rows(&table, &columns, &mut cells);
            let lines = std::str::from_utf8(&lines).expect("text");
            let rows = lines.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
            assert_eq!(rows.filter(serde_json::Value::is_object).count(), table.len());
            assert!(table.is_empty() || cells.ends_with(b"\r\n"));
        }
    }
}

/// The doctor says the same of a recording, whether its counters have seen it at once or in two parts, and its words are whole.
pub fn diagnosis_holds(data: &[u8]) {
    let script = parse_script(data);
    let counted = |batches: &[Batch]| {
        let mut contrast = Contrast::default();
        for batch in batches {
            contrast.observe(batch);
        }
        contrast
    };
    let all = batches(&script, 3);
    let (first, second) = all.split_at(all.len() / 2);
    let mut merged = counted(first);
    merged.merge(counted(second));
    let said = Report::of(counted(&all)).json();
    // A part keeps its first rows for the part before it, and no more: what they are judged by has to be among them.
    let mut kept = second.iter().flat_map(|batch| &batch.frames).take(WINDOW);
    if second.iter().all(|batch| batch.frames.is_empty()) || kept.any(|frame| frame.verdict == Verdict::Ok) {
        assert_eq!(Report::of(merged).json(), said, "merged");
    }
    assert!(said["sentence"].as_str().is_some_and(|sentence| !sentence.contains(['{', '}'])), "a place that is not filled");
}
