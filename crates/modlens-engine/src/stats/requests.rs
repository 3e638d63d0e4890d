//! The different requests of a bus: how often each is repeated, how often not answered, and what was about it then.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::hash::{Hash, Hasher};

use foldhash::fast::RandomState;
use serde_json::{json, Value as Json};

use super::Times;
use crate::pairing::PendingTransaction;
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Different requests that are kept; a scanner that asks for every address does not fill the memory.
const MOST: usize = 1024;

/// Unanswered requests that a late answer may belong to.
const REMEMBERED: usize = 64;

/// A request that was repeated so often has a cycle.
const REPEATED: u64 = 3;

/// Unit, function, address, quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Key(u8, u8, Option<(u16, u16)>);

/// All of it in one number.
impl Hash for Key {
    #[inline]
    fn hash<H: Hasher>(&self, state: &mut H) {
        let (address, quantity) = self.2.unwrap_or_default();
        let head = u16::from_be_bytes([self.0, self.1]);
        let of = |part: u16, at: u32| u64::from(part) << (16 * at);
        state.write_u64(of(head, 3) | of(address, 2) | of(quantity, 1) | u64::from(self.2.is_some()));
    }
}

impl Key {
    /// What tells this request from others; single writes ask for one.
    pub(crate) fn of(functions: &Functions, transaction: &PendingTransaction) -> Self {
        let body = transaction.request.pdu().get(1..).unwrap_or(&[]);
        let u16_at = |at: usize| Some(u16::from_be_bytes([*body.get(at)?, *body.get(at + 1)?]));
        let range = functions.row(transaction.function, body).and_then(|row| {
            let address = u16_at(row.roles.address.or(row.roles.write_address)?)?;
            Some((address, row.roles.quantity.or(row.roles.write_quantity).map_or(Some(1), u16_at)?))
        });
        Self(transaction.unit, transaction.function, range)
    }

    /// A request for so many from an address on.
    pub(crate) fn plain(unit: u8, function: u8, address: u16, quantity: u16) -> Self {
        Self(unit, function, Some((address, quantity)))
    }

    pub(super) fn unit(self) -> u8 {
        self.0
    }

    pub(super) fn function(self) -> u8 {
        self.1
    }
}

#[derive(Clone, Debug)]
struct Slot {
    key: Key,
    asked: u64,
    unanswered: u64,
    damaged: u64,
    late: u64,
    late_by: Times,
    before: BTreeMap<(u8, Status), u64>,
    last: Option<Ns>,
    cycle: Times,
}

/// Requests of one bus.
#[derive(Clone, Debug, Default)]
pub(super) struct Requests {
    slots: Vec<Slot>,
    /// Of each: what is asked, and the slot of the request that came after it the last time.
    turns: Vec<(Key, u32)>,
    places: HashMap<Key, usize, RandomState>,
    /// The slot of the last request.
    latest: usize,
    waited: Times,
    missing: VecDeque<(u64, Key, Option<Ns>)>,
    previous: Option<(u8, Status)>,
    last_damaged: u64,
}

impl Requests {
    /// A frame arrived damaged, or as noise.
    pub fn damaged(&mut self, frame: u64) {
        self.last_damaged = frame;
    }

    /// A transaction was decided.
    pub fn transaction(&mut self, functions: &Functions, transaction: &PendingTransaction) {
        if let Some(txn) = transaction.late_for {
            self.answered_late(txn, transaction.late_response);
        }
        if !transaction.request.is_present() || transaction.status == Status::BadRequest {
            return;
        }
        let key = Key::of(functions, transaction);
        let previous = self.previous.replace((transaction.unit, transaction.status));
        let Some(at) = self.place(key) else { return };
        let slot = &mut self.slots[at];
        if transaction.retry_of.is_none() {
            slot.turn(transaction.request.start);
        } else {
            slot.asked += 1;
        }
        if transaction.status != Status::NoResponse {
            return;
        }
        slot.unanswered += 1;
        slot.damaged += u64::from(self.last_damaged > transaction.request.number);
        if let Some(before) = previous {
            *slot.before.entry(before).or_default() += 1;
        }
        if let Some(waited) = transaction.waited {
            self.waited.add(waited);
        }
        if self.missing.len() == REMEMBERED {
            self.missing.pop_front();
        }
        self.missing.push_back((transaction.txn, key, transaction.waited));
    }

    /// A request was answered once more.
    #[inline]
    pub fn asked(&mut self, key: Key, start: Option<Ns>) {
        self.previous = Some((key.0, Status::Ok));
        if let Some(at) = self.place(key) {
            self.slots[at].turn(start);
        }
    }

    /// The slot of a request. A master asks in turn: the request that came next the last time is tried first.
    #[inline]
    fn place(&mut self, key: Key) -> Option<usize> {
        let likely = self.turns.get(self.latest).map_or(0, |turn| turn.1 as usize);
        let at = if self.turns.get(likely).is_some_and(|turn| turn.0 == key) {
            likely
        } else if let Some(&at) = self.places.get(&key) {
            at
        } else if self.slots.len() < MOST {
            self.places.insert(key, self.slots.len());
            self.slots.push(Slot::new(key));
            self.turns.push((key, 0));
            self.slots.len() - 1
        } else {
            return None;
        };
        self.turns[self.latest].1 = at as u32;
        self.latest = at;
        Some(at)
    }

    /// By key: the order of output must not depend on the traffic.
    fn sorted(&self) -> Vec<&Slot> {
        let mut slots: Vec<&Slot> = self.slots.iter().collect();
        slots.sort_by_key(|slot| slot.key);
        slots
    }

    fn answered_late(&mut self, txn: u64, after: Option<Ns>) {
        let Some(&(_, key, waited)) = self.missing.iter().find(|(number, ..)| *number == txn) else { return };
        let Some(slot) = self.places.get(&key).map(|&at| &mut self.slots[at]) else { return };
        slot.late += 1;
        if let Some((after, waited)) = after.zip(waited) {
            slot.late_by.add((after - waited).max(0));
        }
    }

    /// The time between a request and its next turn: that of the request in the middle, of those that come again.
    pub fn cycle(&self) -> Json {
        let slots = self.sorted().into_iter().filter(|slot| slot.asked >= REPEATED && slot.cycle.count > 0);
        let mut repeated: Vec<&Times> = slots.map(|slot| &slot.cycle).collect();
        // To find the middle of a histogram is to go through it.
        repeated.sort_by_cached_key(|times| times.percentile(0.5));
        let Some(middle) = repeated.get(repeated.len() / 2) else { return Json::Null };
        let mut found = middle.json();
        found["requests"] = repeated.len().into();
        found
    }

    /// Requests that were not answered, the most frequent first; null where all were.
    pub fn timeouts(&self, functions: &Functions) -> Json {
        let mut slots: Vec<&Slot> = self.slots.iter().filter(|slot| slot.unanswered > 0).collect();
        if slots.is_empty() {
            return Json::Null;
        }
        slots.sort_by_key(|slot| (std::cmp::Reverse(slot.unanswered), slot.key));
        let rows: Vec<Json> = slots.iter().map(|slot| slot.json(functions)).collect();
        json!({"waited": self.waited.json(), "requests": rows})
    }
}

impl Slot {
    fn new(key: Key) -> Self {
        Self {
            key,
            asked: 0,
            unanswered: 0,
            damaged: 0,
            late: 0,
            late_by: Times::default(),
            before: BTreeMap::new(),
            last: None,
            cycle: Times::default(),
        }
    }

    /// It was asked in its turn.
    #[inline]
    fn turn(&mut self, start: Option<Ns>) {
        self.asked += 1;
        if let Some((last, start)) = self.last.zip(start).filter(|(last, start)| start > last) {
            self.cycle.add(start - last);
        }
        self.last = start.or(self.last);
    }

    fn json(&self, functions: &Functions) -> Json {
        let Key(unit, function, range) = self.key;
        let mut before: Vec<(&(u8, Status), &u64)> = self.before.iter().collect();
        before.sort_by_key(|(who, count)| (std::cmp::Reverse(**count), **who));
        let before: Vec<Json> =
            before.iter().map(|((unit, status), count)| json!({"unit": unit, "status": status.text(), "count": count})).collect();
        json!({
            "unit": unit, "function": function, "address": range.map(|(address, _)| address),
            "quantity": range.map(|(_, quantity)| quantity),
            "register_type": functions.row(function, &[]).and_then(|row| row.register_type.clone()),
            "count": self.unanswered, "asked": self.asked, "late": self.late, "late_by": self.late_by.json(),
            "damaged": self.damaged, "before": before,
        })
    }
}
