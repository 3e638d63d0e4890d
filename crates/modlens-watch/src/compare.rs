//! What differs from what is usual.
//!
//! A difference is stated for the largest thing that explains it: a new client, not each of its requests. Shares, periods and
//! response times differ only where chance is ruled out and the size matters; both bounds are constants here.

use std::collections::{BTreeMap, BTreeSet};

use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::chance::{at_least, chance_of_none, rank_deviation};
use crate::distribution::{above, quantile, rounded};
use crate::usage::{BusUsage, Habit, RequestKey, Usage, Values};
use crate::usual::{Usual, UsualBus, UsualRequest, UsualValues};

/// A poll is missing after so many of its periods, or after so many seconds, whichever is longer.
const MISSING_PERIODS: f64 = 10.0;
const MISSING_SECONDS: f64 = 60.0;

/// A poll: at least so many requests.
const POLL_COUNT: u64 = 10;

/// And it goes on for this share of the time at least.
const POLL_SHARE: f64 = 0.1;

/// A median interval outside of all usual ones by this factor has moved.
const PERIOD_FACTOR: f64 = 1.25;

/// A median response time that differs by this factor, and more often than not, has shifted.
const RESPONSE_FACTOR: f64 = 1.5;

/// The share of response times above (or below) the usual ones that makes a shift; 0.5 is none.
const RESPONSE_SHARE: f64 = 0.75;

/// Response times on each side without which nothing is said.
const RESPONSE_COUNT: u64 = 20;

/// Standard deviations by which ranks have to differ. Comparisons are many: one for each request, each second of a tap.
const RESPONSE_DEVIATIONS: f64 = 5.0;

/// Intervals without which a period has not moved.
const PERIOD_COUNT: u64 = 20;

/// The share of intervals that are longer (or shorter) than all usual ones where a period has moved.
const PERIOD_SHARE: f64 = 0.75;

/// An outcome is as frequent as before if chance brings the difference about more often than this.
const OUTCOME_CHANCE: f64 = 1e-7;

/// And by how much: one in a hundred.
const OUTCOME_SHARE: f64 = 0.01;

/// A value of a few that was never written before is a difference where days that are alike bring it about more rarely.
const VALUE_CHANCE: f64 = 1e-3;

/// And anyhow where it lies outside of the usual ones by more than this many times their range.
const VALUE_DISTANCE: f64 = 1.0;

/// Values of a register with many are a difference where they lie outside of its range by more than this share of it.
const RANGE_SHARE: f64 = 0.5;

/// Changes of a register after which standing still, or samples after which moving, is a difference.
const MOVING_CHANGES: u64 = 20;

/// Compares a recording with what is usual; a list of `{code, bus, client, unit, function, address, quantity, usual, now,
/// count, since_ns, examples, requests}` as JSON. `usual` and `now` are texts; `requests` are the rows of a baseline that the
/// difference is about.
///
/// With `values`, registers that began or stopped to change are listed, too.
pub fn compare(usual: &Usual, seen: &Usage, values: bool) -> Json {
    let mut found = Vec::new();
    // One bus each: the same line, whatever the file was called.
    let is_one_line = usual.buses.len() == 1 && seen.buses.len() == 1;
    let same = |name: &str| usual.buses.get(name).or_else(|| usual.buses.values().next().filter(|_| is_one_line));
    for (name, bus) in &seen.buses {
        match same(name) {
            Some(usual) => Comparison { name, usual, seen: bus, found: &mut found }.run(values),
            None => found.push(json!({"code": "new_bus", "bus": name, "now": requests_text(bus.requests.len())})),
        }
    }
    let times = seen.buses.values().filter_map(|bus| bus.times);
    let times = times.reduce(|one, other| (one.0.min(other.0), one.1.max(other.1)));
    let silent = times.map_or(0.0, |(first, last)| (last - first) as f64 / 1e9);
    let is_late =
        |bus: &UsualBus| bus.requests.values().filter_map(|known| patience(bus, known)).any(|patience| silent >= patience);
    for (name, bus) in usual.buses.iter().filter(|(name, _)| !is_one_line && !seen.buses.contains_key(*name)) {
        if !is_late(bus) {
            continue;
        }
        found.push(json!({"code": "missing_bus", "bus": name, "usual": requests_text(bus.requests.len())}));
    }
    Json::Array(found)
}

/// A request as the rows of a baseline name it: client, unit, function, whether it writes, address, quantity.
fn key_json(key: &RequestKey) -> Json {
    let writes = if key.writes { json!(true) } else { Json::Null };
    json!([key.client, key.unit, key.function, writes, key.range.map(|range| range.0), key.range.map(|range| range.1)])
}

/// For how many seconds a poll can be silent before it is missing; `None` where it is no poll, but what somebody asked for a
/// while.
fn patience(bus: &UsualBus, known: &UsualRequest) -> Option<f64> {
    let longest = known.periods.iter().map(|period| period[1]).reduce(f64::max).filter(|_| known.count >= POLL_COUNT)?;
    let is_poll = known.count as f64 * longest >= POLL_SHARE * bus.hours.unwrap_or(0.0) * 3600.0;
    is_poll.then_some((longest * MISSING_PERIODS).max(MISSING_SECONDS))
}

fn requests_text(count: usize) -> String {
    format!("{count} different request{}", if count == 1 { "" } else { "s" })
}

/// Requests that are one difference: its code, the client, and unit and function where they are the same, else 0.
type Group = (&'static str, Option<String>, u8, u8);

struct Comparison<'a> {
    name: &'a str,
    usual: &'a UsualBus,
    seen: &'a BusUsage,
    found: &'a mut Vec<Json>,
}

impl Comparison<'_> {
    fn run(&mut self, values: bool) {
        let (usual, seen) = (self.usual, self.seen);
        let mut new = Vec::new();
        for (key, habit) in &seen.requests {
            match usual.requests.get(key) {
                None => new.push((key, habit)),
                Some(usual) => self.request(key, usual, habit, values),
            }
        }
        self.new_requests(&new);
        self.missing_requests();
    }

    /// Adds a difference of one request.
    fn push(&mut self, code: &str, key: &RequestKey, habit: Option<&Habit>, usual: &str, now: &str) {
        self.found.push(json!({
            "code": code, "bus": self.name, "client": key.client, "unit": key.unit, "function": key.function,
            "address": key.range.map(|range| range.0), "quantity": key.range.map(|range| range.1),
            "usual": usual, "now": now, "count": habit.map(|habit| habit.count),
            "since_ns": habit.and_then(|habit| habit.times).map(|times| times.0),
            "examples": habit.map_or_else(Vec::new, |habit| vec![habit.first_txn]), "requests": [key_json(key)],
        }));
    }

    fn new_requests(&mut self, new: &[(&RequestKey, &Habit)]) {
        let usual = self.usual;
        let knows = |same: &dyn Fn(&RequestKey) -> bool| usual.requests.keys().any(same);
        let mut groups: BTreeMap<Group, Vec<(&RequestKey, &Habit)>> = BTreeMap::new();
        for (key, habit) in new {
            let group = if !knows(&|known| known.client == key.client) {
                ("new_client", key.client.clone(), 0, 0)
            } else if key.writes && !knows(&|known| known.client == key.client && known.unit == key.unit && known.writes) {
                ("new_writer", key.client.clone(), key.unit, 0)
            } else if !knows(&|known| known.unit == key.unit) {
                ("new_unit", key.client.clone(), key.unit, 0)
            } else if !knows(&|known| known.client == key.client && known.unit == key.unit && known.function == key.function) {
                ("new_function", key.client.clone(), key.unit, key.function)
            } else if key.writes {
                ("new_write_range", key.client.clone(), key.unit, key.function)
            } else {
                ("new_request", key.client.clone(), key.unit, key.function)
            };
            groups.entry(group).or_default().push((key, habit));
        }
        for ((code, client, unit, function), members) in groups {
            let writes: u64 = members.iter().filter(|(key, _)| key.writes).map(|(_, habit)| habit.count).sum();
            let count: u64 = members.iter().map(|(_, habit)| habit.count).sum();
            let units: BTreeSet<u8> = members.iter().map(|(key, _)| key.unit).collect();
            let (first, habit) = members.iter().min_by_key(|(_, habit)| habit.first_txn).expect("a group has a member");
            let since: Option<Ns> = members.iter().filter_map(|(_, habit)| habit.times).map(|times| times.0).min();
            let is_one = members.len() == 1;
            self.found.push(json!({
                "code": code, "bus": self.name, "client": client,
                "unit": if code == "new_client" && units.len() > 1 { Json::Null } else { json!(unit.max(first.unit)) },
                "function": if is_one { json!(first.function) } else if function > 0 { json!(function) } else { Json::Null },
                "address": first.range.filter(|_| is_one).map(|range| range.0),
                "quantity": first.range.filter(|_| is_one).map(|range| range.1),
                "usual": "", "now": now_text(members.len(), count, writes), "count": count, "since_ns": since,
                "examples": [habit.first_txn], "keys": members.len(),
                "requests": members.iter().map(|(key, _)| key_json(key)).collect::<Vec<_>>(),
            }));
        }
    }

    fn missing_requests(&mut self) {
        let (usual, seen) = (self.usual, self.seen);
        let Some((begin, end)) = seen.times else { return };
        for (key, known) in &usual.requests {
            let Some(patience) = patience(usual, known) else { continue };
            let habit = seen.requests.get(key);
            let last = habit.and_then(|habit| habit.times).map_or(begin, |times| times.1);
            let silent = (end - last) as f64 / 1e9;
            if silent < patience {
                continue;
            }
            let usual = format!("every {}", period_text(&known.periods));
            let now = match habit {
                None => String::from("never"),
                Some(_) => format!("not in the last {}", seconds_text(silent)),
            };
            self.push("missing_request", key, habit, &usual, &now);
        }
    }

    fn request(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit, values: bool) {
        self.period(key, usual, habit);
        self.outcomes(key, usual, habit);
        self.response_time(key, usual, habit);
        if key.writes {
            self.written_values(key, usual, habit);
        } else if values {
            self.read_values(key, usual, habit);
        }
    }

    fn period(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit) {
        let share = |share| quantile(&habit.intervals, share);
        let (Some(most), Some(least), Some(median)) = (share(1.0 - PERIOD_SHARE), share(PERIOD_SHARE), share(0.5)) else {
            return;
        };
        if usual.count < POLL_COUNT || habit.intervals.count < PERIOD_COUNT || usual.periods.is_empty() {
            return;
        }
        let is_usual = |period: &[f64; 2]| (period[0] / PERIOD_FACTOR..=period[1] * PERIOD_FACTOR).contains(&median);
        let is_longer = usual.periods.iter().all(|period| most > period[1] * PERIOD_FACTOR || period[0] > median);
        let is_shorter = usual.periods.iter().all(|period| least < period[0] / PERIOD_FACTOR || period[1] < median);
        if !usual.periods.iter().any(is_usual) && is_longer && is_shorter {
            self.push("period_moved", key, Some(habit), &period_text(&usual.periods), &seconds_text(median));
        }
    }

    fn outcomes(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit) {
        let [before, now] = [&usual.outcomes, &habit.outcomes].map(|counts| counts.values().sum::<u64>());
        if before == 0 || now == 0 {
            return;
        }
        let names: BTreeSet<&String> = usual.outcomes.keys().chain(habit.outcomes.keys()).filter(|name| *name != "ok").collect();
        for name in names {
            let count = |counts: &BTreeMap<String, u64>| counts.get(name).copied().unwrap_or(0);
            let (a, b) = (count(&usual.outcomes), count(&habit.outcomes));
            let share = |count: u64, total: u64| count as f64 / total as f64;
            // One more on each side keeps shares of few requests from being certain.
            let expected = share(a + 1, before + 2);
            let chance = at_least(b, now, expected).min(at_least(now - b, now, 1.0 - expected));
            if (share(b, now) - share(a, before)).abs() > OUTCOME_SHARE && chance < OUTCOME_CHANCE {
                self.push("outcome_changed", key, Some(habit), &share_text(name, a, before), &share_text(name, b, now));
            }
        }
    }

    fn response_time(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit) {
        let (count, deciles) = &usual.response_times;
        if *count < RESPONSE_COUNT || habit.responses.count < RESPONSE_COUNT || deciles.len() != 9 {
            return;
        }
        let (before, Some(now)) = (deciles[4], quantile(&habit.responses, 0.5)) else { return };
        let above = above(&habit.responses, deciles);
        if rank_deviation(above, habit.responses.count, *count).abs() < RESPONSE_DEVIATIONS {
            return;
        }
        let is_slower = above > RESPONSE_SHARE && now > before * RESPONSE_FACTOR;
        let is_faster = above < 1.0 - RESPONSE_SHARE && now < before / RESPONSE_FACTOR;
        if is_slower || is_faster {
            let text = |median: f64, count: u64| format!("median {} of {count}", seconds_text(median));
            self.push("response_time_shifted", key, Some(habit), &text(before, *count), &text(now, habit.responses.count));
        }
    }

    fn written_values(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit) {
        for (at, (known, seen)) in usual.values.iter().zip(&habit.values).enumerate() {
            let Some((low, high)) = seen.range else { continue };
            let odd: Vec<i64> = if known.few.is_empty() {
                [low, high].map(i64::from).into_iter().filter(|value| !is_within(known, *value, RANGE_SHARE)).collect()
            } else if seen.is_list() {
                let counts = seen.few.iter().map(|(value, count)| (i64::from(*value), *count));
                let unknown = counts.filter(|(value, _)| !known.few.contains(value));
                let is_odd = |(value, count): &(i64, u64)| {
                    chance_of_none(*count, habit.count, usual.count) < VALUE_CHANCE || !is_within(known, *value, VALUE_DISTANCE)
                };
                unknown.filter(is_odd).map(|(value, _)| value).collect()
            } else {
                vec![i64::from(low), i64::from(high)]
            };
            if !odd.is_empty() {
                let values = odd.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
                self.register("value_never_written", key, at, habit, &values_text(known), &values);
            }
        }
    }

    fn read_values(&mut self, key: &RequestKey, usual: &UsualRequest, habit: &Habit) {
        for (at, (known, seen)) in usual.values.iter().zip(&habit.values).enumerate() {
            if known.changes >= MOVING_CHANGES && seen.changes == 0 && habit.count >= MOVING_CHANGES {
                // The usual number of changes in as many samples as there are now.
                let expected = known.changes as f64 / usual.count as f64 * habit.count as f64;
                if expected >= MOVING_CHANGES as f64 {
                    self.register("register_stopped", key, at, habit, &values_text(known), &now_values(seen));
                }
            } else if known.changes == 0 && usual.count >= MOVING_CHANGES && seen.changes >= MOVING_CHANGES {
                self.register("register_moves", key, at, habit, &values_text(known), &now_values(seen));
            }
        }
    }

    /// A difference of the register at this place of a request's range.
    fn register(&mut self, code: &str, key: &RequestKey, at: usize, habit: &Habit, usual: &str, now: &str) {
        let range = key.range.map(|(address, _)| (address.saturating_add(at as u16), 1));
        self.push(code, &RequestKey { range, ..key.clone() }, Some(habit), usual, now);
        if let Some(found) = self.found.last_mut() {
            found["requests"] = json!([key_json(key)]);
        }
    }
}

/// Whether a value lies in the usual range, widened by a share of it on both sides.
fn is_within(known: &UsualValues, value: i64, share: f64) -> bool {
    known.range.is_none_or(|(low, high)| {
        let slack = ((high - low) as f64 * share) as i64;
        (low - slack..=high + slack).contains(&value)
    })
}

fn now_text(requests: usize, count: u64, writes: u64) -> String {
    let times = if count == 1 { String::from("once") } else { format!("{count} times") };
    let kinds = if requests == 1 { String::new() } else { format!(", {requests} different requests") };
    let writes = match writes {
        0 => String::new(),
        1 if count == 1 => String::from(", a write"),
        all if all == count => String::from(", all writes"),
        some => format!(", {some} of them writes"),
    };
    format!("{times}{kinds}{writes}")
}

fn values_text(known: &UsualValues) -> String {
    match known.range {
        Some((low, high)) if known.few.is_empty() => format!("{low} to {high}"),
        _ => known.few.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    }
}

fn now_values(seen: &Values) -> String {
    match seen.range {
        Some((low, high)) if !seen.is_list() => format!("{low} to {high}"),
        _ => seen.few.keys().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    }
}

fn share_text(name: &str, count: u64, total: u64) -> String {
    format!("{name} {count} of {total}")
}

fn period_text(periods: &[[f64; 2]]) -> String {
    let one = |period: &[f64; 2]| {
        if period[1] < period[0] * PERIOD_FACTOR {
            seconds_text((period[0] * period[1]).sqrt())
        } else {
            format!("{} to {}", seconds_text(period[0]), seconds_text(period[1]))
        }
    };
    periods.iter().map(one).collect::<Vec<_>>().join(" or ")
}

fn seconds_text(seconds: f64) -> String {
    if seconds < 1.0 {
        format!("{} ms", rounded(seconds * 1e3))
    } else if seconds < 120.0 {
        format!("{} s", rounded(seconds))
    } else {
        format!("{} min", rounded(seconds / 60.0))
    }
}
