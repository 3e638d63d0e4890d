//! Writes a case as files: a chunk log for `modlens decode`, and the truth as JSON lines.

use std::fmt::Write as _;
use std::io::{self, Write};

use crate::model::{Direction, Labels};
use crate::sim::case::Case;
use crate::sim::truth::TruthFrame;

/// One line per read: `{"t": 1.002345, "hex": "0103..."}`, with `"line": "A"` on two-line taps.
pub fn write_chunk_log(case: &Case, to: &mut impl Write) -> io::Result<()> {
    let mut row = String::new();
    for feed in case.timed_reads() {
        row.clear();
        match feed.time {
            Some(time) => {
                let (seconds, micros) = (time / 1_000_000_000, time % 1_000_000_000 / 1000);
                write!(row, r#"{{"t": {seconds}.{micros:06}, "hex": ""#).expect("text can grow");
            }
            None => row.push_str(r#"{"t": null, "hex": ""#),
        }
        for byte in feed.bytes {
            write!(row, "{byte:02x}").expect("text can grow");
        }
        row.push('"');
        if feed.line > 0 {
            write!(row, r#", "line": "{}""#, line_name(feed.line)).expect("text can grow");
        }
        writeln!(to, "{row}}}")?;
    }
    Ok(())
}

/// One line per frame of the truth, in the order of sending.
pub fn write_truth(case: &Case, to: &mut impl Write) -> io::Result<()> {
    case.truth.iter().try_for_each(|frame| writeln!(to, "{}", truth_row(frame)))
}

/// A frame of the truth as a JSON object; members that are false or empty are left out.
fn truth_row(frame: &TruthFrame) -> String {
    let direction = if frame.direction == Direction::Request { "request" } else { "response" };
    let mut row = format!(
        r#"{{"start": {}, "end": {}, "direction": "{direction}", "unit": {}, "function": {}, "exception": {}, "txn": {}, "valid": {}"#,
        frame.start, frame.end, frame.unit, frame.function, frame.exception, frame.txn, frame.valid,
    );
    if frame.line > 0 {
        write!(row, r#", "line": "{}""#, line_name(frame.line)).expect("text can grow");
    }
    if let Some(old) = frame.alternative_txn {
        write!(row, r#", "alt_txn": {old}"#).expect("text can grow");
    }
    for (key, is_so) in [
        ("lenient", frame.is_unscored),
        ("echo", frame.echo),
        ("unpaired", frame.needs_no_pair),
        ("undecided", frame.is_undecided),
    ] {
        if is_so {
            write!(row, r#", "{key}": true"#).expect("text can grow");
        }
    }
    if frame.overlap_id > 0 {
        write!(row, r#", "episode": {}"#, frame.overlap_id).expect("text can grow");
    }
    for (key, labels) in [("labels", frame.labels), ("maybe", frame.allowed_labels)] {
        if labels != Labels::default() {
            let names: Vec<String> = labels.iter().map(|label| format!(r#""{}""#, label.text())).collect();
            write!(row, r#", "{key}": [{}]"#, names.join(", ")).expect("text can grow");
        }
    }
    row.push('}');
    row
}

fn line_name(line: u8) -> char {
    char::from(b'@' + line)
}
