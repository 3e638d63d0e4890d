//! Whether the data of a transaction are those of another one: an answer to another request, or one step late.

use modlens_protocol::finding::Finding;

use super::super::recent::Answer;
use super::Context;
use crate::observation::{apart, Data, Observation, Outcome, RequestKey, Shift, FAR, MOST_LAG};

/// The last transactions whose data may come again as the answer to another request.
const COMPARED: usize = 12;

/// After a silence, the data of so many transactions are compared with those in front of it.
const BEHIND_SILENCE: u64 = 24;

/// Shorter answers are alike by chance.
const LEAST_COMPARED_BYTES: u16 = 4;

impl Context {
    /// Whether the next transaction stands shortly after a silence.
    #[inline]
    pub fn is_behind_silence(&self) -> bool {
        self.recent.next_number() <= self.behind_silence_until
    }

    /// Compares the data with those of the transactions before.
    pub(super) fn compare(&mut self, seen: &mut Observation) {
        let key = seen.key().filter(|_| seen.data.length > 0);
        if let Some(key) = key {
            seen.is_of_another = self.is_of_another(key, seen.data);
            seen.shift = self.shift(key, seen.data, self.previous_request.map(|before| before.key));
        }
        if seen.findings.has(Finding::ResponseLength) {
            let mut before = self.recent.newest_first().map(|answer| answer.key()).filter(|key| key.unit == seen.unit);
            seen.asked_before = std::array::from_fn(|_| before.next());
        }
        self.recent.push(seen.key().map_or(Answer::default(), |key| Answer::new(key.number(), seen.data)));
        if matches!(seen.outcome, Outcome::Silent | Outcome::NotSeen) {
            self.behind_silence_until = self.recent.count() + 1 + BEHIND_SILENCE;
        }
    }

    /// Whether the data of an exchange that went well may be those of another request, or go on with its values. `own` are the
    /// first registers of the answer before to the same request, `before` is the number of the request before.
    #[inline]
    pub fn may_be_odd(&self, key: RequestKey, data: Data, own: [u16; 2], before: u64) -> bool {
        let is_far = distance(own, data.head) >= FAR;
        (is_far && self.is_like_another(key, data)) || (self.is_behind_silence() && self.may_be_shifted(key, data, before))
    }

    #[inline(never)]
    fn may_be_shifted(&self, key: RequestKey, data: Data, before: u64) -> bool {
        self.shift(key, data, Some(RequestKey::of_number(before))).is_some()
    }

    /// The requests to the unit before the next one, the last one first: that one as it could be read, those before it as they were
    /// sent. An answer that a unit or its modem keeps back waits while others are asked.
    fn earlier(&self, before: RequestKey, unit: u8) -> impl Iterator<Item = RequestKey> + '_ {
        let all = std::iter::once(before).chain(self.recent.newest_first().skip(1).map(|answer| answer.key()));
        all.filter(move |key| key.unit == unit).take(MOST_LAG)
    }

    /// Whether the data are those that another request was answered with a moment ago, and far from its own. Of requests whose
    /// answers were alike before, such as those for the same registers by another function, each goes on like the other.
    fn is_of_another(&self, key: RequestKey, data: Data) -> bool {
        let Some((_, own)) = self.recent.last_of(key).filter(|(_, own)| distance(own.head, data.head) >= FAR) else {
            return false;
        };
        let is_near_own = |answer: &Answer| answer.length > 0 && distance(answer.head, own.head) < FAR;
        let were_alike =
            |other: RequestKey| self.recent.newest_first().any(|answer| answer.key() == other && is_near_own(&answer));
        self.others_like(key, data).any(|other| !were_alike(other))
    }

    /// Whether the data begin as those that another request to the unit was answered with a moment ago.
    fn is_like_another(&self, key: RequestKey, data: Data) -> bool {
        self.others_like(key, data).next().is_some()
    }

    /// The other requests to the unit that were answered a moment ago with data that begin like these. Registers without a value
    /// are alike everywhere.
    fn others_like(&self, key: RequestKey, data: Data) -> impl Iterator<Item = RequestKey> + '_ {
        let is_compared = data.length >= LEAST_COMPARED_BYTES && !data.is_plain() && !data.opens_plain();
        let recent = self.recent.newest_first().take(if is_compared { COMPARED } else { 0 });
        let others = recent.filter(move |others| others.begins_like(data)).map(|others| others.key());
        others.filter(move |other| other.unit == key.unit && *other != key)
    }

    /// Shortly after a silence: whether the values go on as those of an earlier request did in front of it; `before` is the last one.
    fn shift(&self, key: RequestKey, data: Data, before: Option<RequestKey>) -> Option<Shift> {
        let left = self.behind_silence_until.checked_sub(self.recent.next_number())?;
        let since = BEHIND_SILENCE.checked_sub(left)?;
        let in_front = || self.recent.newest_first().skip(since as usize + 1).filter(|answer| answer.length > 0);
        let last_of = |key: RequestKey| in_front().find(|answer| answer.key() == key);
        let own = last_of(key).filter(|own| own.length == data.length && distance(own.head, data.head) >= FAR)?;
        let mut found = None;
        for (lag, earlier) in (1..).zip(self.earlier(before?, key.unit)) {
            let Some(others) = last_of(earlier).filter(|others| earlier != key && others.length == data.length) else { continue };
            if distance(others.head, data.head) * 8 < distance(own.head, data.head) {
                return Some(Shift::ToEarlier { lag, bits: bits(others.head, data) });
            }
            if lag == 1 && distance(others.head, data.head) >= FAR {
                found = Some(Shift::Elsewhere);
            }
        }
        found
    }
}

/// How far the first two registers of two answers are apart.
#[inline]
fn distance(one: [u16; 2], other: [u16; 2]) -> u32 {
    one.iter().zip(other).map(|(one, other)| apart(*one, other)).sum()
}

/// Values so near to each other come about by chance once in 2 to the power of this.
fn bits(one: [u16; 2], other: Data) -> u32 {
    let registers = usize::from(other.length / 2).min(2);
    let near = |at: usize| 16u32.saturating_sub((2 * apart(one[at], other.head[at]) + 1).ilog2());
    (0..registers).map(near).sum()
}
