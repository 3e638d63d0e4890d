//! Rules: a condition on rows, how many of them make an alert, and within which time.

use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_protocol::Ns;
use modlens_tables::columns::{read_range, write_range, Table, TableKind};
use modlens_tables::predicate::Predicate;
use serde_json::{json, Value as Json};

/// Subjects of one rule that are followed at once: the oldest gives way.
pub const MAX_SUBJECTS: usize = 4096;

/// An alert that goes on after a pause of more than this is another one.
const EPISODE_NS: Ns = 300_000_000_000;

/// Alerts that are kept; with more, the rules report nothing new.
const MAX_ALERTS: usize = 10_000;

/// Transactions named as examples.
const MAX_EXAMPLES: usize = 4;

/// What a rule counts apart, and what it counts once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Field {
    Unit,
    Function,
    Address,
}

impl Field {
    fn from_name(name: &str) -> Result<Self, String> {
        match name {
            "unit" => Ok(Self::Unit),
            "function" => Ok(Self::Function),
            "address" => Ok(Self::Address),
            other => Err(format!("{other:?} is not one of unit, function, address")),
        }
    }

    fn value(self, event: &Event<'_>) -> Option<u32> {
        match self {
            Self::Unit => event.unit.map(u32::from),
            Self::Function => event.function.map(u32::from),
            Self::Address => event.address.map(u32::from),
        }
    }
}

/// A row of the table of rules, compiled.
#[derive(Clone, Debug)]
struct Rule {
    code: String,
    /// The table whose rows it looks at is that of the condition.
    condition: Predicate,
    /// First bytes of the request's PDU; empty for any.
    pdu: Vec<u8>,
    /// Fields by which alerts are kept apart, in addition to bus and client.
    per: Vec<Field>,
    /// Counted once for each value of this field.
    distinct: Option<Field>,
    /// How many make an alert.
    count: usize,
    /// In which time; without one, each is counted by itself.
    within: Option<Ns>,
    /// A subject that asks for the same things again is a poll, not a sweep: no alert then.
    only_once: bool,
}

/// What rules see of a row: a transaction, a frame, or a connection.
struct Event<'a> {
    bus: &'a str,
    client: Option<&'a str>,
    /// Number of the transaction; 0 without one.
    txn: u64,
    /// By the clock, or since the beginning of the recording.
    time: Option<Ns>,
    unit: Option<u8>,
    function: Option<u8>,
    address: Option<u16>,
    /// PDU of the request.
    pdu: &'a [u8],
}

/// Whom an alert is about: bus, client, and the values of the rule's fields.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Subject {
    bus: String,
    client: Option<String>,
    fields: Vec<Option<u32>>,
}

/// What has matched for a subject lately.
#[derive(Debug, Default)]
struct Sighting {
    /// Time, item and transaction of matches within the window.
    recent: VecDeque<(Ns, u32, u64)>,
    /// Items seen at all; bounded by the values of a field.
    items: HashSet<u32>,
    /// When enough was seen, where the rule waits whether things are asked again.
    candidate_since: Option<Ns>,
    /// Those of `recent` that were asked for again.
    repeated: HashSet<u32>,
    /// Index of its latest alert.
    alert: Option<usize>,
}

/// An alert: a rule and a subject, for as long as it goes on.
#[derive(Clone, Debug)]
pub struct Alert {
    code: String,
    subject: Subject,
    per: Vec<Field>,
    count: u64,
    since: Option<Ns>,
    until: Option<Ns>,
    examples: Vec<u64>,
    items: Option<usize>,
}

/// Rules and what they have seen.
#[derive(Debug, Default)]
pub struct Rules {
    table: Vec<Rule>,
    sightings: Vec<HashMap<Subject, Sighting>>,
    alerts: Vec<Alert>,
    lacked_clock: bool,
    /// Alerts that were one too many.
    not_kept: u64,
    /// Alerts that `begun` has returned.
    told: usize,
}

impl Rules {
    /// Compiles rules from JSON: a list of `{code, table, tree, pdu, per, distinct, count, within_s, only_once}`; `tree` is a
    /// filter of that table (transactions by default). The error names the rule and the key.
    pub fn new(rules: &Json) -> Result<Self, String> {
        let rows = rules.as_array().ok_or("rules are a list")?;
        let rules = rows.iter().map(rule).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { sightings: rules.iter().map(|_| HashMap::new()).collect(), table: rules, ..Self::default() })
    }

    /// Looks at all rows of a batch.
    pub fn observe(&mut self, batch: &Arc<Batch>) {
        let mut latest = None;
        for kind in [TableKind::Connections, TableKind::Frames, TableKind::Transactions] {
            if !self.table.iter().any(|rule| rule.condition.kind == kind) {
                continue;
            }
            let table = Table::new(Arc::clone(batch), kind);
            for row in 0..table.len() {
                let event = event(&table, row);
                self.lacked_clock |= event.time.is_none();
                latest = latest.max(event.time);
                for index in 0..self.table.len() {
                    let rule = &self.table[index];
                    if rule.condition.kind == kind && event.pdu.starts_with(&rule.pdu) && rule.condition.holds(&table, row) {
                        self.matched(index, &event);
                    }
                }
            }
        }
        if latest.is_some() {
            self.decide_candidates(latest);
        }
    }

    /// Decides what waits for its window to end. Call at the end of the recordings.
    pub fn finish(&mut self) {
        self.decide_candidates(None);
    }

    /// The alerts so far, as JSON, in the order in which they began.
    pub fn alerts(&self) -> Json {
        self.alerts.iter().map(Alert::json).collect()
    }

    /// The alerts that have begun since the last call, as JSON.
    pub fn begun(&mut self) -> Vec<Json> {
        let found = self.alerts[self.told..].iter().map(Alert::json).collect();
        self.told = self.alerts.len();
        found
    }

    /// How many alerts were not kept because there were too many.
    pub fn not_kept(&self) -> u64 {
        self.not_kept
    }

    /// The codes of the rules that need times, where transactions had none.
    pub fn not_judged(&self) -> Vec<&str> {
        let needs_time = self.table.iter().filter(|rule| rule.within.is_some());
        needs_time.filter(|_| self.lacked_clock).map(|rule| rule.code.as_str()).collect()
    }

    fn matched(&mut self, index: usize, event: &Event<'_>) {
        let rule = &self.table[index];
        let subject = &subject(&rule.per, event);
        let sightings = &mut self.sightings[index];
        if sightings.len() >= MAX_SUBJECTS && !sightings.contains_key(subject) {
            forget_oldest(sightings);
        }
        let sighting = sightings.entry(subject.clone()).or_default();
        let item = rule.distinct.and_then(|field| field.value(event)).unwrap_or(0);
        let Some(within) = rule.within else {
            return self.alert(index, subject, &[(event.time, event.txn)], None);
        };
        let Some(time) = event.time else { return };
        let is_current = |alert: &Alert| alert.until.is_some_and(|until| time - until <= within);
        if !rule.only_once && sighting.alert.is_some_and(|at| is_current(&self.alerts[at])) && rule.distinct.is_none() {
            return self.alert(index, subject, &[(event.time, event.txn)], None);
        }
        let is_known = !sighting.items.insert(item);
        if rule.only_once && is_known {
            if sighting.recent.iter().any(|(_, other, _)| *other == item) {
                sighting.repeated.insert(item);
            }
            return;
        }
        while sighting.recent.front().is_some_and(|(first, ..)| time - first > within) {
            sighting.recent.pop_front();
        }
        if rule.distinct.is_none() || sighting.recent.iter().all(|(_, other, _)| *other != item) {
            sighting.recent.push_back((time, item, event.txn));
        }
        if sighting.recent.len() < rule.count {
            return;
        }
        if rule.only_once {
            sighting.candidate_since.get_or_insert(time);
            return;
        }
        let seen: Vec<(Option<Ns>, u64)> = sighting.recent.drain(..).map(|(time, _, txn)| (Some(time), txn)).collect();
        let items = rule.distinct.map(|_| seen.len());
        self.alert(index, subject, &seen, items);
    }

    /// Turns candidates whose window has ended into alerts, unless their subject asks for the same again and again.
    fn decide_candidates(&mut self, now: Option<Ns>) {
        for index in 0..self.table.len() {
            let Some(within) = self.table[index].within.filter(|_| self.table[index].only_once) else { continue };
            let mut decided = Vec::new();
            for (subject, sighting) in &mut self.sightings[index] {
                let is_over = |since: Ns| now.is_none_or(|now| now - since > within);
                if sighting.candidate_since.is_some_and(is_over) {
                    sighting.candidate_since = None;
                    let seen: Vec<_> = sighting.recent.drain(..).map(|(time, _, txn)| (Some(time), txn)).collect();
                    // Most of a sweep is asked for once; a poll comes back.
                    if sighting.repeated.len() * 4 <= seen.len() {
                        let items = seen.len();
                        decided.push((subject.clone(), seen, items));
                    }
                    sighting.repeated.clear();
                }
            }
            decided.sort_by(|one, other| one.0.cmp(&other.0));
            for (subject, seen, items) in decided {
                self.alert(index, &subject, &seen, Some(items));
            }
        }
    }

    /// Extends the alert of a subject, or begins one.
    fn alert(&mut self, index: usize, subject: &Subject, seen: &[(Option<Ns>, u64)], items: Option<usize>) {
        let Some((first, last)) = seen.first().zip(seen.last()) else { return };
        let sighting = self.sightings[index].entry(subject.clone()).or_default();
        let goes_on = |alert: &Alert| match (alert.until, first.0) {
            (Some(until), Some(time)) => time - until <= EPISODE_NS,
            _ => true,
        };
        if let Some(alert) = sighting.alert.map(|at| &mut self.alerts[at]).filter(|alert| goes_on(alert)) {
            alert.count += seen.len() as u64;
            alert.until = last.0.or(alert.until);
            alert.items = items.max(alert.items);
            let missing = MAX_EXAMPLES.saturating_sub(alert.examples.len());
            alert.examples.extend(seen.iter().map(|(_, txn)| *txn).filter(|txn| *txn > 0).take(missing));
            return;
        }
        if self.alerts.len() >= MAX_ALERTS {
            self.not_kept += 1;
            return;
        }
        sighting.alert = Some(self.alerts.len());
        let rule = &self.table[index];
        self.alerts.push(Alert {
            code: rule.code.clone(),
            subject: subject.clone(),
            per: rule.per.clone(),
            count: seen.len() as u64,
            since: first.0,
            until: last.0,
            examples: seen.iter().map(|(_, txn)| *txn).filter(|txn| *txn > 0).take(MAX_EXAMPLES).collect(),
            items,
        });
    }
}

impl Alert {
    fn json(&self) -> Json {
        let field = |field: Field| {
            let at = self.per.iter().position(|one| *one == field)?;
            self.subject.fields[at]
        };
        json!({
            "code": self.code, "bus": self.subject.bus, "client": self.subject.client, "unit": field(Field::Unit),
            "function": field(Field::Function), "address": field(Field::Address), "count": self.count, "items": self.items,
            "since_ns": self.since, "until_ns": self.until, "examples": self.examples,
        })
    }
}

fn event(table: &Table, row: usize) -> Event<'_> {
    let batch = &*table.batch;
    if let Some(row) = table.transaction(row) {
        let range = write_range(batch, row).or_else(|| read_range(batch, row));
        let (bus, client) = ends(batch, row.bus);
        let (unit, function) = (Some(row.unit), Some(row.function));
        let address = range.map(|range| range.0);
        let (time, pdu) = (row.start.or(row.elapsed), row.request.pdu.of(&batch.arena));
        return Event { bus, client, txn: row.number, time, unit, function, address, pdu };
    }
    if let Some(row) = table.frame(row) {
        let (bus, client) = ends(batch, row.bus);
        let (txn, time) = (row.txn.unwrap_or(0), row.start.or(row.elapsed));
        return Event { bus, client, txn, time, unit: row.unit, function: row.code, address: None, pdu: &[] };
    }
    let row = &batch.connections[row];
    let (bus, client) = (row.server.as_str(), Some(row.client.as_str()));
    Event { bus, client, txn: 0, time: row.begun, unit: None, function: None, address: None, pdu: &[] }
}

/// Name of a bus, and the address of the client where it is a connection.
fn ends(batch: &Batch, bus: u32) -> (&str, Option<&str>) {
    let bus = &batch.buses[bus as usize];
    (&bus.name, bus.network.as_ref().map(|network| network.client.as_str()))
}

fn subject(per: &[Field], event: &Event<'_>) -> Subject {
    Subject {
        bus: event.bus.to_owned(),
        client: event.client.map(str::to_owned),
        fields: per.iter().map(|field| field.value(event)).collect(),
    }
}

fn forget_oldest(sightings: &mut HashMap<Subject, Sighting>) {
    let last = |sighting: &Sighting| sighting.recent.back().map_or(Ns::MIN, |(time, ..)| *time);
    let oldest = sightings.iter().min_by_key(|(subject, sighting)| (last(sighting), *subject));
    if let Some(oldest) = oldest.map(|(subject, _)| subject.clone()) {
        sightings.remove(&oldest);
    }
}

fn rule(row: &Json) -> Result<Rule, String> {
    let code = row["code"].as_str().ok_or("a rule without code")?;
    let wrong = |key: &str, why: String| format!("rule {code}: {key}: {why}");
    let fields = |key: &str| -> Result<Vec<Field>, String> {
        let names = row[key].as_array().map(Vec::as_slice).unwrap_or_default();
        names.iter().map(|name| Field::from_name(name.as_str().unwrap_or_default()).map_err(|why| wrong(key, why))).collect()
    };
    let distinct = row["distinct"].as_str().map(Field::from_name).transpose().map_err(|why| wrong("distinct", why))?;
    let pdu = row["pdu"].as_array().map(Vec::as_slice).unwrap_or_default();
    Ok(Rule {
        code: code.to_owned(),
        condition: Predicate::new(row["table"].as_str().unwrap_or("transactions"), &row["tree"].to_string())
            .map_err(|why| wrong("where", why))?,
        pdu: pdu.iter().filter_map(|byte| byte.as_u64().map(|byte| byte as u8)).collect(),
        per: fields("per")?,
        distinct,
        count: row["count"].as_u64().unwrap_or(1) as usize,
        within: row["within_s"].as_f64().map(|seconds| (seconds * 1e9) as Ns),
        only_once: row["only_once"].as_bool().unwrap_or(false),
    })
}
