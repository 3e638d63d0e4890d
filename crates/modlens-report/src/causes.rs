//! What the doctor says: the verdict, and the causes as cards.

use modlens_protocol::visible::visible;
use serde_json::Value as Json;

use crate::cells::has_several_buses;
use crate::layout::{list, text};
use crate::texts::{capitalized, fixed, moment, number, plain};

/// Causes on the first page; the others are in the appendix.
pub const URGENT: usize = 3;

/// The verdicts and what is shown for them; the last one stands for those that are not known.
const VERDICTS: [(&str, &str); 4] =
    [("healthy", "healthy"), ("trouble", "trouble"), ("broken", "broken"), ("unknown", "not enough to judge")];

/// A cause.
pub struct Card {
    pub level: &'static str,
    pub title: String,
    pub code: String,
    /// Name and value.
    pub facts: Vec<(&'static str, String)>,
    /// Heading, which may be empty, and text.
    pub texts: [(&'static str, String); 3],
    /// Transactions of the document that show it.
    pub examples: Vec<u64>,
}

/// The verdict of a document and what is shown for it.
pub fn verdict(document: &Json) -> (&'static str, &'static str) {
    let found = VERDICTS.iter().find(|(word, _)| document["doctor"]["verdict"] == *word);
    *found.unwrap_or(&VERDICTS[VERDICTS.len() - 1])
}

/// The causes, the worst first.
pub fn causes(document: &Json) -> Vec<Card> {
    let several = has_several_buses(document);
    let known: Vec<u64> = list(&document["overview"]["examples"]).iter().filter_map(|row| row["txn"].as_u64()).collect();
    let card = |row: &Json| Card {
        level: ["error", "warning"].into_iter().find(|level| row["severity"] == *level).unwrap_or("info"),
        title: title(row),
        code: visible(text(&row["code"])),
        facts: facts(row, several),
        texts: [
            ("", visible(&sentences(row))),
            ("Check", visible(text(&row["advice"]))),
            ("Proof", visible(text(&row["proof"]))),
        ],
        examples: list(&row["examples"]).iter().filter_map(Json::as_u64).filter(|txn| known.contains(txn)).collect(),
    };
    list(&document["doctor"]["diagnoses"]).iter().map(card).collect()
}

fn sentences(row: &Json) -> String {
    let found = [&row["sentence"], &row["evidence"]].map(text);
    found.into_iter().filter(|text| !text.is_empty()).collect::<Vec<&str>>().join(" ")
}

/// What is wrong, after the unit that it is about.
fn title(row: &Json) -> String {
    let title = [&row["title"], &row["code"]].map(text).into_iter().find(|text| !text.is_empty()).unwrap_or_default();
    if row["unit"].is_null() {
        capitalized(&visible(title))
    } else {
        format!("Unit {}: {}", plain(&row["unit"]), visible(title))
    }
}

fn facts(row: &Json, several: bool) -> Vec<(&'static str, String)> {
    let mut found = Vec::new();
    if several {
        found.push(("bus", plain(&row["bus"])));
    }
    let given = |name: &&'static str| !row[*name].is_null();
    found.extend(["unit", "function", "address", "client"].into_iter().filter(given).map(|name| (name, plain(&row[name]))));
    found.push(("seen in", format!("{} of {}", fixed(number(&row["failed"]), 0), fixed(number(&row["total"]), 0))));
    found.extend(["since", "until"].into_iter().filter(given).map(|name| (name, moment(&plain(&row[name])))));
    let certainty = row["certainty"].as_str().filter(|&word| word != "diagnosed");
    found.extend(certainty.map(|word| ("certainty", visible(word))));
    found
}
