//! The example transactions, with the bytes of their frames.

use modlens_protocol::visible::visible;
use serde_json::Value as Json;

use crate::causes::URGENT;
use crate::cells::{function, has_several_buses};
use crate::layout::{list, text};
use crate::texts::{milliseconds, moment, number, plain, words};

/// Examples of each of the first causes that are printed.
const PRINTED: usize = 2;

/// A transaction.
pub struct Example {
    pub txn: String,
    pub title: String,
    /// Whether one of the first causes names it: it is printed.
    pub is_named: bool,
    pub findings: String,
    pub frames: Vec<Frame>,
}

/// A frame of an example, block by block.
pub struct Frame {
    pub title: String,
    /// Offset, bytes, field, value, meaning of a block, and whether something is wrong with it.
    pub rows: Vec<([String; 5], bool)>,
}

/// The example transactions; those that the first causes name come first. What is only worth knowing needs no bytes on paper.
pub fn examples(document: &Json) -> Vec<Example> {
    let several = has_several_buses(document);
    let urgent = list(&document["doctor"]["diagnoses"]).iter().filter(|row| row["severity"] != "info").take(URGENT);
    let named: Vec<&Json> = urgent.flat_map(|row| list(&row["examples"]).iter().take(PRINTED)).collect();
    let mut rows: Vec<&Json> = list(&document["overview"]["examples"]).iter().collect();
    rows.sort_by_key(|row| !named.contains(&&row["txn"]));
    let example = |row: &Json| Example {
        txn: plain(&row["txn"]),
        title: title(document, row, several),
        is_named: named.contains(&&row["txn"]),
        findings: list(&row["findings"]).iter().map(plain).collect::<Vec<String>>().join(", "),
        frames: list(&row["frames"]).iter().map(frame).collect(),
    };
    rows.into_iter().map(example).collect()
}

fn title(document: &Json, row: &Json, several: bool) -> String {
    let mut facts = vec![format!("transaction {}", plain(&row["txn"]))];
    if several {
        facts.push(plain(&row["bus"]));
    }
    facts.push(format!("unit {}", plain(&row["unit"])));
    facts.push(format!("function {}", function(document, &row["function"])));
    facts.push(words(text(&row["status"])));
    for (name, title) in [("response_time_us", "answered after"), ("waited_us", "waited")] {
        if !row[name].is_null() {
            facts.push(format!("{title} {} ms", milliseconds(number(&row[name]))));
        }
    }
    if !row["time"].is_null() {
        facts.push(moment(text(&row["time"])));
    }
    facts.join(", ")
}

fn frame(found: &Json) -> Frame {
    let rows = list(&found["pieces"]).iter().map(|piece| (std::array::from_fn(|at| plain(&piece[at])), piece[5] == false));
    Frame { title: visible(text(&found["title"])), rows: rows.collect() }
}
