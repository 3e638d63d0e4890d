//! Statistics of the distinct requests of a bus: how often each is sent, how often it times out, and under which
//! circumstances.

use std::collections::{BTreeMap, VecDeque};

use serde_json::{json, Value as Json};

use super::duration_json;
use super::request_indices::RequestIndices;
use crate::durations::Durations;
use crate::pairing::PendingTransaction;
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Distinct requests that are counted. The limit keeps a scanner that asks for every address from filling the memory.
const MAX_REQUESTS: usize = 1024;

/// Unanswered requests that a late response may still belong to.
const MAX_UNANSWERED: usize = 64;

/// Requests of the poll cycle that are listed.
const MAX_LISTED_POLLS: usize = 100;

/// A request that was sent so often counts for the poll cycle.
const MIN_POLLS: u64 = 3;

/// Unit, function, address and quantity, in which two requests of a poll cycle differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct RequestKey(u8, u8, Option<(u16, u16)>);

impl RequestKey {
    /// The key of a transaction's request. Writes of a single value have quantity 1.
    pub(crate) fn of(functions: &Functions, transaction: &PendingTransaction) -> Self {
        let body = transaction.request.pdu().get(1..).unwrap_or(&[]);
        let u16_at = |at: usize| Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let range = functions.row(transaction.function, body).and_then(|row| {
            let address = u16_at(row.offsets.address.or(row.offsets.write_address)?)?;
            Some((address, row.offsets.quantity.or(row.offsets.write_quantity).map_or(Some(1), u16_at)?))
        });
        Self(transaction.unit, transaction.function, range)
    }

    /// The key of a plain read or write.
    pub(crate) fn plain(unit: u8, function: u8, address: u16, quantity: u16) -> Self {
        Self(unit, function, Some((address, quantity)))
    }

    /// The key as one number.
    #[inline]
    fn number(self) -> u64 {
        let (address, quantity) = self.2.unwrap_or_default();
        let head = u16::from_be_bytes([self.0, self.1]);
        let shifted = |part: u16, words: u32| u64::from(part) << (16 * words);
        shifted(head, 3) | shifted(address, 2) | shifted(quantity, 1) | u64::from(self.2.is_some())
    }

    pub(super) fn unit(self) -> u8 {
        self.0
    }

    pub(super) fn function(self) -> u8 {
        self.1
    }
}

/// The counters of one distinct request.
#[derive(Clone, Debug)]
struct RequestCounts {
    key: RequestKey,
    /// How often it was sent.
    sent: u64,
    unanswered: u64,
    /// Of those unanswered: after which a damaged frame or noise was seen.
    unanswered_with_damage: u64,
    late_responses: u64,
    /// How long after the master's timeout the late responses came.
    late_by: Durations,
    /// Of those unanswered: how many came after a transaction of this unit and status.
    preceded_by: BTreeMap<(u8, Status), u64>,
    /// When it was last polled, if no retry came since.
    last_start: Option<Ns>,
    /// The time from its starts to the ends of its responses, or to the ends of waiting for them.
    taken: Ns,
    /// From one poll to the next.
    cycle: Durations,
}

/// The distinct requests of one bus.
#[derive(Clone, Debug, Default)]
pub(super) struct RequestTable {
    counts: Vec<RequestCounts>,
    indices: RequestIndices,
    /// How long the master waited for responses that did not come.
    waited: Durations,
    /// The last unanswered requests: transaction, key, and how long the master waited.
    recent_unanswered: VecDeque<(u64, RequestKey, Option<Ns>)>,
    /// Unit and status of the last transaction with an intact request.
    previous: Option<(u8, Status)>,
    /// Number of the last frame that was damaged, or noise.
    last_damaged_frame: u64,
}

impl RequestTable {
    /// Notes a frame that arrived damaged, or noise.
    pub fn note_damaged_frame(&mut self, number: u64) {
        self.last_damaged_frame = number;
    }

    /// Counts a closed transaction: a late response with the request that it belongs to, and its own request as sent, if it has
    /// an intact one. Of a request without response (`Status::NoResponse`), also what `count_unanswered` says.
    ///
    /// A retry counts as sent, but does not mark the beginning of a cycle (`add_retry`). A request for which there is no room
    /// (`MAX_REQUESTS`) is not counted in this table.
    pub fn record_transaction(&mut self, functions: &Functions, transaction: &PendingTransaction) {
        if let Some(txn) = transaction.late_response_to {
            self.count_late_response(txn, transaction.late_response);
        }
        if !transaction.request.is_present() || transaction.status == Status::BadRequest {
            return;
        }
        let key = RequestKey::of(functions, transaction);
        let previous = self.previous.replace((transaction.unit, transaction.status));
        let Some(at) = self.find_or_add(key) else { return };
        self.counts[at].taken += time_taken(transaction);
        if transaction.retry_of.is_none() {
            self.counts[at].add_poll(transaction.request.start);
        } else {
            self.counts[at].add_retry();
        }
        if transaction.status == Status::NoResponse {
            self.count_unanswered(at, transaction, previous);
        }
    }

    /// Counts that the request at this index in `counts` got no response: how long the master waited, whether a damaged frame or
    /// noise has come since the request, and which unit and status the transaction before (`previous`) had. The transaction is
    /// remembered for a late response, the oldest of more than `MAX_UNANSWERED` is forgotten.
    fn count_unanswered(&mut self, at: usize, transaction: &PendingTransaction, previous: Option<(u8, Status)>) {
        let counts = &mut self.counts[at];
        counts.unanswered += 1;
        counts.unanswered_with_damage += u64::from(self.last_damaged_frame > transaction.request.number);
        if let Some(before) = previous {
            *counts.preceded_by.entry(before).or_default() += 1;
        }
        if let Some(waited) = transaction.waited {
            self.waited.add(waited);
        }
        if self.recent_unanswered.len() == MAX_UNANSWERED {
            self.recent_unanswered.pop_front();
        }
        self.recent_unanswered.push_back((transaction.txn, counts.key, transaction.waited));
    }

    /// Counts a request of the fast path, which was answered.
    #[inline]
    pub fn record_exchange(&mut self, key: RequestKey, start: Option<Ns>, taken: Option<Ns>) {
        self.note_answered(key);
        if let Some(at) = self.find_or_add(key) {
            self.record_exchange_at(at, key, start, taken);
        }
    }

    /// Notes that the last request was answered.
    #[inline]
    pub fn note_answered(&mut self, key: RequestKey) {
        self.previous = Some((key.0, Status::Ok));
    }

    /// Counts a request of the fast path, which was refused; with the times of request and response, where there is a clock.
    pub fn record_refusal(&mut self, key: RequestKey, times: Option<[Ns; 2]>) {
        self.record_exchange(key, times.map(|[asked, _]| asked), times.map(|[asked, refused]| refused - asked));
        self.previous = Some((key.0, Status::Exception));
    }

    /// Counts an answered request at this index of `counts`.
    #[inline]
    pub fn record_exchange_at(&mut self, at: usize, key: RequestKey, start: Option<Ns>, taken: Option<Ns>) {
        self.count_at(at, start, taken);
        self.note_answered(key);
    }

    /// The same without noting it as the last one.
    #[inline]
    pub fn count_at(&mut self, at: usize, start: Option<Ns>, taken: Option<Ns>) {
        let counts = &mut self.counts[at];
        counts.add_poll(start);
        counts.taken += taken.unwrap_or(0);
    }

    /// The index in `counts` of a request, which is added if it is new; `None` if there is no room for it.
    #[inline]
    pub fn find_or_add(&mut self, key: RequestKey) -> Option<usize> {
        let known = self.indices.find(key.number(), |at| self.counts[at].key.number());
        known.or_else(|| (self.counts.len() < MAX_REQUESTS).then(|| self.add(key)))
    }

    fn add(&mut self, key: RequestKey) -> usize {
        self.counts.push(RequestCounts::new(key));
        self.indices.add(self.counts.len(), |at| self.counts[at].key.number());
        self.counts.len() - 1
    }

    /// The requests sorted by key, so that the order of output does not depend on the order of the traffic.
    fn sorted(&self) -> Vec<&RequestCounts> {
        let mut counts: Vec<&RequestCounts> = self.counts.iter().collect();
        counts.sort_by_key(|counts| counts.key);
        counts
    }

    /// Counts the late response to the transaction `txn`, which came `after` ns from the end of its request, if that is among
    /// the last unanswered ones. How late it came is counted where it is known how long the master had waited.
    fn count_late_response(&mut self, txn: u64, after: Option<Ns>) {
        let Some(&(_, key, waited)) = self.recent_unanswered.iter().find(|(number, ..)| *number == txn) else { return };
        let Some(at) = self.indices.find(key.number(), |at| self.counts[at].key.number()) else { return };
        let counts = &mut self.counts[at];
        counts.late_responses += 1;
        if let Some((after, waited)) = after.zip(waited) {
            counts.late_by.add((after - waited).max(0));
        }
    }

    /// The poll cycle: the times between polls of one request, of all that were sent at least three times; `requests` says how
    /// many these are. Null without any. A master asks for some things in every cycle and for others in every tenth one, so
    /// requests count by how often they were polled: the one chosen has the median cycle of all polls.
    pub fn cycle(&self) -> Json {
        let polled = self.sorted().into_iter().filter(|counts| counts.sent >= MIN_POLLS && counts.cycle.count > 0);
        let mut cycles: Vec<&Durations> = polled.map(|counts| &counts.cycle).collect();
        // The median of a histogram takes a pass over it, so it is computed once for each.
        cycles.sort_by_cached_key(|cycle| cycle.percentile(0.5));
        let polls: u64 = cycles.iter().map(|cycle| cycle.count).sum();
        let mut up_to = 0;
        let median = cycles.iter().find(|cycle| {
            up_to += cycle.count;
            2 * up_to >= polls
        });
        let Some(median) = median else { return Json::Null };
        let mut found = duration_json::summary(median);
        found["requests"] = cycles.len().into();
        found
    }

    /// The requests of the poll cycle with how often they come again and the time that they take, those that take the most
    /// first; how many more there are than are listed.
    pub fn polls(&self, functions: &Functions) -> Json {
        let mut polled: Vec<&RequestCounts> = self.counts.iter().filter(|counts| counts.sent > 0).collect();
        polled.sort_by_key(|counts| (std::cmp::Reverse((counts.taken, counts.sent)), counts.key));
        let listed = polled.len().min(MAX_LISTED_POLLS);
        let rows: Vec<Json> = polled[..listed].iter().map(|counts| counts.poll_json(functions)).collect();
        json!({"requests": rows, "more": polled.len() - listed})
    }

    /// The requests that were not answered, the most frequent first; null where all were answered.
    pub fn timeouts(&self, functions: &Functions) -> Json {
        let mut unanswered: Vec<&RequestCounts> = self.counts.iter().filter(|counts| counts.unanswered > 0).collect();
        if unanswered.is_empty() {
            return Json::Null;
        }
        unanswered.sort_by_key(|counts| (std::cmp::Reverse(counts.unanswered), counts.key));
        let rows: Vec<Json> = unanswered.iter().map(|counts| counts.timeout_json(functions)).collect();
        json!({"waited": duration_json::summary(&self.waited), "requests": rows})
    }
}

impl RequestCounts {
    fn new(key: RequestKey) -> Self {
        Self {
            key,
            sent: 0,
            unanswered: 0,
            unanswered_with_damage: 0,
            late_responses: 0,
            late_by: Durations::default(),
            preceded_by: BTreeMap::new(),
            last_start: None,
            taken: 0,
            cycle: Durations::default(),
        }
    }

    /// Counts a request that is not a retry, and the time since the one before, if both starts are known and the clock has
    /// not gone back.
    #[inline]
    fn add_poll(&mut self, start: Option<Ns>) {
        self.sent += 1;
        if let Some((last, start)) = self.last_start.zip(start).filter(|(last, start)| start > last) {
            self.cycle.add(start - last);
        }
        self.last_start = start.or(self.last_start);
    }

    /// Counts a retry. The time to the next poll then is that of a cycle with waiting in it, or, where a unit is silent for
    /// long, of many cycles, so it is not counted.
    fn add_retry(&mut self) {
        self.sent += 1;
        self.last_start = None;
    }

    /// A request of the poll cycle; `count` is how often it was sent. The time taken is null where there was no clock.
    fn poll_json(&self, functions: &Functions) -> Json {
        let RequestKey(unit, function, range) = self.key;
        let has_times = self.last_start.is_some() || self.taken > 0;
        json!({
            "unit": unit, "function": function, "address": range.map(|(address, _)| address),
            "quantity": range.map(|(_, quantity)| quantity),
            "register_type": functions.row(function, &[]).and_then(|row| row.register_type.clone()),
            "count": self.sent, "interval": duration_json::summary(&self.cycle),
            "taken_us": has_times.then(|| self.taken as f64 / 1000.0),
        })
    }

    /// A request that was not always answered; `count` is how often it was not, `asked` how often it was sent.
    fn timeout_json(&self, functions: &Functions) -> Json {
        let RequestKey(unit, function, range) = self.key;
        let mut before: Vec<(&(u8, Status), &u64)> = self.preceded_by.iter().collect();
        before.sort_by_key(|(transaction, count)| (std::cmp::Reverse(**count), **transaction));
        let before: Vec<Json> =
            before.iter().map(|((unit, status), count)| json!({"unit": unit, "status": status.text(), "count": count})).collect();
        json!({
            "unit": unit, "function": function, "address": range.map(|(address, _)| address),
            "quantity": range.map(|(_, quantity)| quantity),
            "register_type": functions.row(function, &[]).and_then(|row| row.register_type.clone()),
            "count": self.unanswered, "asked": self.sent, "late": self.late_responses, "late_by": duration_json::summary(&self.late_by),
            "damaged": self.unanswered_with_damage, "before": before,
        })
    }
}

/// From the start of a request to the end of its response, or to the end of waiting for it; 0 where that is not known.
fn time_taken(transaction: &PendingTransaction) -> Ns {
    let request = &transaction.request;
    let end = if transaction.response.is_present() {
        transaction.response.end
    } else {
        request.end.zip(transaction.waited).map(|(end, waited)| end + waited)
    };
    request.start.zip(end).map_or(0, |(start, end)| (end - start).max(0))
}
