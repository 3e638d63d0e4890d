//! The joined rows, and what is counted over them.

use std::collections::BTreeMap;

use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use serde_json::{json, Map, Value as Json};

use super::exchange::{Exchange, Request};
use modlens_engine::durations::Durations;

/// What became of a request, in the words of the column `outcome`, and what is known of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Verdict {
    pub outcome: &'static str,
    /// Age of the values of an answer from the gateway's memory.
    pub cache_age: Option<Ns>,
    /// The request on the network to which the answer belongs, and its transaction on the line.
    pub belongs_to: Option<u64>,
    pub answered_by: Option<u64>,
}

impl Verdict {
    /// A verdict of which no more is known.
    pub fn plain(outcome: &'static str) -> Self {
        Self { outcome, ..Self::default() }
    }
}

/// Rows that are ready, by time on the network, and counts.
#[derive(Debug, Default)]
pub(super) struct Rows {
    ready: BTreeMap<(Ns, u64), Json>,
    made: u64,
    outcomes: BTreeMap<&'static str, u64>,
    /// From the end of the request on the line to the gateway's exception.
    gateway_timeouts: Durations,
    /// From an unanswered request on the network to the client's next one.
    client_timeouts: Durations,
    matched: u64,
}

impl Rows {
    /// Adds a request of the line that no request of the network caused.
    pub fn add_own(&mut self, one: &Exchange, time: Ns, is_covered: bool) {
        let outcome = if is_covered { "own_request" } else { "not_covered" };
        *self.outcomes.entry(outcome).or_default() += 1;
        let mut row = Map::new();
        row.insert("txn".into(), json!(one.number));
        row.insert("time_ns".into(), json!(time));
        row.insert("unit".into(), json!(one.unit));
        row.insert("status".into(), json!(one.status.text()));
        row.insert("outcome".into(), json!(outcome));
        self.push(time, one, row);
    }

    /// Adds a request of the network: a row for each of its requests on the line, or one where there is none.
    pub fn add_request(&mut self, request: &Request, verdict: &Verdict, offset: Ns) {
        *self.outcomes.entry(verdict.outcome).or_default() += 1;
        self.matched += request.attempts.len() as u64;
        self.measure_timeouts(request, offset);
        let Some((last, earlier)) = request.attempts.split_last() else {
            let above = &request.exchange;
            return self.push(above.start, above, upstream(above, verdict));
        };
        for below in earlier {
            *self.outcomes.entry("repeated").or_default() += 1;
            let row = joined(request, below, &Verdict { outcome: "repeated", ..Verdict::default() }, offset);
            self.push(request.exchange.start, below, row);
        }
        self.push(request.exchange.start, last, joined(request, last, verdict, offset));
    }

    fn measure_timeouts(&mut self, request: &Request, offset: Ns) {
        let above = &request.exchange;
        if let (true, Some(end), Some(first)) = (above.is_gateway_exception(), above.end, request.attempts.last()) {
            self.gateway_timeouts.add(end + offset - first.request_end);
        }
        if let (Status::NoResponse, Some(waited)) = (above.status, above.waited) {
            self.client_timeouts.add(waited);
        }
    }

    fn push(&mut self, time: Ns, one: &Exchange, mut row: Map<String, Json>) {
        if one.is_wanted {
            self.made += 1;
            row.extend(one.cells.clone());
            self.ready.insert((time, self.made), Json::Object(row));
        }
    }

    /// Takes the rows before a time; all without one.
    pub fn take(&mut self, until: Option<Ns>) -> Json {
        let later = until.map(|until| self.ready.split_off(&(until, 0))).unwrap_or_default();
        std::mem::replace(&mut self.ready, later).into_values().collect()
    }

    /// What was counted: matched requests, outcomes, timeouts of the gateway and of its clients in milliseconds.
    pub fn counts(&self) -> (u64, &BTreeMap<&'static str, u64>, Option<f64>, Option<f64>) {
        let millis = |times: &Durations, share| times.percentile(share).map(|ns| ns as f64 / 1e6);
        (self.matched, &self.outcomes, millis(&self.gateway_timeouts, 0.5), millis(&self.client_timeouts, 0.0))
    }
}

/// The columns of the request on the network.
fn upstream(above: &Exchange, verdict: &Verdict) -> Map<String, Json> {
    let mut row = Map::new();
    row.insert("time_ns".into(), json!(above.start));
    row.insert("upstream_txn".into(), json!(above.number));
    row.insert("upstream_client".into(), json!(above.client.as_deref()));
    row.insert("upstream_unit".into(), json!(above.unit));
    row.insert("upstream_status".into(), json!(above.status.text()));
    row.insert("outcome".into(), json!(verdict.outcome));
    row.insert("belongs_to".into(), json!(verdict.belongs_to));
    row.insert("cache_age_us".into(), micros(verdict.cache_age));
    row
}

/// The columns of a request on the network and one of its requests on the line.
fn joined(request: &Request, below: &Exchange, verdict: &Verdict, offset: Ns) -> Map<String, Json> {
    let above = &request.exchange;
    let mut row = upstream(above, verdict);
    row.insert("txn".into(), json!(below.number));
    row.insert("unit".into(), json!(below.unit));
    row.insert("status".into(), json!(below.status.text()));
    row.insert("gateway_delay_us".into(), micros(Some(below.start - above.start - offset)));
    let back = above.end.zip(below.end).filter(|_| verdict.outcome == "forwarded");
    row.insert("return_delay_us".into(), micros(back.map(|(above, below)| above + offset - below)));
    row
}

fn micros(duration: Option<Ns>) -> Json {
    duration.map_or(Json::Null, |duration| json!(duration as f64 / 1e3))
}
