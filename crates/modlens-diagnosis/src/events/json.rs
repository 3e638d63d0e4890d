//! An event as JSON: what files, brokers, commands and addresses get.

use modlens_protocol::timestamp::time_text;
use serde_json::{json, Value as Json};

use super::{Change, Event, Trouble};
use crate::claim::duration;

impl Event {
    /// The event as a JSON object.
    pub fn json(&self) -> Json {
        let mut document = self.trouble.json();
        let row = document.as_object_mut().expect("an object");
        let mut all = serde_json::Map::new();
        all.insert("time".into(), time_text(self.time).into());
        all.insert("event".into(), self.change.text().into());
        all.append(row);
        all.insert("was".into(), self.was.into());
        all.insert("until".into(), if self.change == Change::End { time_text(self.trouble.until).into() } else { Json::Null });
        all.insert("text".into(), self.text().into());
        all.into()
    }

    /// The event as a line for people.
    fn text(&self) -> String {
        let row = &self.trouble.row;
        match (self.change, self.was) {
            (Change::Begin, _) => format!("trouble: {}", row.sentence),
            (Change::Change, Some(_)) => format!("another cause: {}", row.sentence),
            (Change::Change, None) => {
                format!("now {}: {}", if row.severity.text() == "error" { "severe" } else { "less severe" }, row.sentence)
            }
            (Change::End, _) => format!("over after {}: {}", duration(self.trouble.until - self.trouble.since), row.sentence),
        }
    }
}

impl Trouble {
    /// The trouble as a JSON object.
    pub fn json(&self) -> Json {
        let row = &self.row;
        json!({
            "number": self.number, "bus": row.bus, "unit": row.unit, "client": row.client, "code": row.code,
            "title": crate::table::diagnosis(row.code).map(|known| known.title.as_str()),
            "severity": row.severity.text(), "since": time_text(self.since),
            "failed": self.share.failed, "total": self.share.total, "sentence": row.sentence, "advice": row.advice, "proof": row.proof,
            "examples": row.examples,
        })
    }
}
