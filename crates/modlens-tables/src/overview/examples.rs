//! Transactions that are kept with their bytes, to be looked at.
//!
//! Which ones a diagnosis will name is known at the end only, when their bytes are gone. The diagnoses choose the transactions
//! whose numbers have the least hashes (`modlens_diagnosis::contrast::tally`), so those with the least hashes are kept here.

use std::collections::BTreeMap;

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::mix::mix;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_protocol::timestamp::time_text;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use super::line::us;

/// Transactions with trouble that are kept until it is known which ones are wanted.
const CANDIDATES: usize = 2048;

/// Examples in the document.
const MOST: usize = 200;

/// One transaction with its bytes.
#[derive(Clone, Debug, PartialEq)]
struct Example {
    bus: String,
    mode: Mode,
    unit: u8,
    function: u8,
    status: Status,
    exception: Option<u8>,
    time: Option<Ns>,
    elapsed: Option<Ns>,
    response_time: Option<Ns>,
    waited: Option<Ns>,
    request: Vec<u8>,
    response: Vec<u8>,
    findings: Vec<Finding>,
}

/// Bus, unit, function and status.
type Kind = (String, u8, u8, &'static str);

/// The transactions that are kept: by hash and number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Examples {
    odd: BTreeMap<(u64, u64), Example>,
    /// Of each kind the one with the least hash: hash, number and transaction.
    of_each_kind: BTreeMap<Kind, (u64, u64, Example)>,
}

/// Kinds of transactions of which an example is kept: those that come first, where there are more.
const KINDS: usize = 1024;

impl Examples {
    /// Keeps a transaction if it is among those with the least hashes. `least`: the least hash so far of its bus, unit,
    /// function and status; lowered to that of this one.
    pub fn add(&mut self, batch: &Batch, row: &Transaction, least: &mut u64) {
        let hash = mix(row.number);
        let is_odd = !matches!(row.status, Status::Ok | Status::Broadcast) || row.findings.length > 0 || row.retry_of.is_some();
        let is_wanted =
            is_odd && (self.odd.len() < CANDIDATES || self.odd.last_key_value().is_some_and(|(last, _)| hash < last.0));
        if hash >= *least && !is_wanted {
            return;
        }
        let example = Example::of(batch, row);
        if hash < *least {
            *least = hash;
            self.keep((example.bus.clone(), row.unit, row.function, row.status.text()), (hash, row.number, example.clone()));
        }
        if is_wanted {
            self.odd.insert((hash, row.number), example);
            if self.odd.len() > CANDIDATES {
                self.odd.pop_last();
            }
        }
    }

    fn keep(&mut self, kind: Kind, one: (u64, u64, Example)) {
        let is_less = self.of_each_kind.get(&kind).map_or(self.of_each_kind.len() < KINDS, |own| one.0 < own.0);
        if is_less {
            self.of_each_kind.insert(kind, one);
        }
    }

    /// Adds those of a later part of the recording.
    pub fn merge(&mut self, later: &Self) {
        self.odd.extend(later.odd.iter().map(|(key, example)| (*key, example.clone())));
        while self.odd.len() > CANDIDATES {
            self.odd.pop_last();
        }
        for (kind, one) in &later.of_each_kind {
            self.keep(kind.clone(), one.clone());
        }
    }

    /// Those that are wanted, then one of each kind, then others with trouble; sorted by number.
    pub fn json(&self, wanted: &[u64]) -> Json {
        let numbered: BTreeMap<u64, &Example> = self.odd.iter().map(|((_, number), example)| (*number, example)).collect();
        let of_each = self.of_each_kind.values().map(|(_, number, example)| (*number, example));
        let named = wanted.iter().filter_map(|number| Some((*number, *numbered.get(number)?)));
        let rest = self.odd.iter().map(|((_, number), example)| (*number, example));
        let mut chosen = BTreeMap::new();
        for (number, example) in named.chain(of_each).chain(rest) {
            if chosen.len() == MOST {
                break;
            }
            chosen.insert(number, example);
        }
        chosen.into_iter().map(|(number, example)| example.json(number)).collect()
    }
}

impl Example {
    fn of(batch: &Batch, row: &Transaction) -> Self {
        let bus = &batch.buses[row.bus as usize];
        Self {
            bus: bus.name.clone(),
            mode: row.mode,
            unit: row.unit,
            function: row.function,
            status: row.status,
            exception: row.exception,
            time: row.start.filter(|_| bus.clock == Clock::Utc),
            elapsed: row.elapsed,
            response_time: row.response_time,
            waited: row.waited,
            request: row.request.wire.of(&batch.arena).to_vec(),
            response: row.response.wire.of(&batch.arena).to_vec(),
            findings: row.findings.of(&batch.codes).to_vec(),
        }
    }

    fn json(&self, number: u64) -> Json {
        let findings: Vec<&str> = self.findings.iter().map(|finding| finding.doc().code).collect();
        json!({
            "txn": number, "bus": self.bus, "mode": self.mode.text(), "unit": self.unit, "function": self.function,
            "status": self.status.text(), "exception": self.exception, "time": self.time.map(time_text),
            "elapsed_us": self.elapsed.map(us), "response_time_us": self.response_time.map(us), "waited_us": self.waited.map(us),
            "request_hex": hex(&self.request), "response_hex": hex(&self.response), "findings": findings,
        })
    }
}

/// The bytes in hex; null without any.
fn hex(bytes: &[u8]) -> Json {
    if bytes.is_empty() {
        Json::Null
    } else {
        modlens_protocol::hex::hex(bytes).into()
    }
}
