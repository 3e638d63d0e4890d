//! Counters by unit and function: bounded, whatever the size of the recording.

mod requests;

use std::collections::BTreeMap;

use serde_json::{json, Value as Json};

use crate::pairing::{ObservedFrame, PendingTransaction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

pub(crate) use requests::Key;
use requests::Requests;

/// Times in 32 equal buckets an octave: percentiles within 2 %.
const STEPS_PER_OCTAVE: usize = 1 << STEP_BITS;
const STEP_BITS: u32 = 5;

/// A bounded histogram of times.
#[derive(Clone, Debug, Default)]
struct Times {
    count: u64,
    sum: Ns,
    least: Ns,
    most: Ns,
    buckets: Vec<u64>,
}

/// 2^40 ns are 18 minutes; what is longer counts there.
const BUCKETS: usize = 40 * STEPS_PER_OCTAVE + 1;

impl Times {
    fn add(&mut self, ns: Ns) {
        self.least = if self.count == 0 { ns } else { self.least.min(ns) };
        self.most = self.most.max(ns);
        self.count += 1;
        self.sum += ns;
        if self.buckets.is_empty() {
            self.buckets.resize(BUCKETS, 0);
        }
        self.buckets[bucket(ns)] += 1;
    }

    fn percentile(&self, share: f64) -> Ns {
        let rank = (self.count as f64 * share).ceil() as u64;
        let mut below = 0;
        for (bucket, count) in self.buckets.iter().enumerate() {
            below += count;
            if below >= rank {
                return middle(bucket).clamp(self.least, self.most);
            }
        }
        self.most
    }

    fn json(&self) -> Json {
        if self.count == 0 {
            return Json::Null;
        }
        let us = |ns: Ns| ns as f64 / 1000.0;
        json!({
            "count": self.count, "min_us": us(self.least), "mean_us": us(self.sum) / self.count as f64,
            "p50_us": us(self.percentile(0.5)), "p95_us": us(self.percentile(0.95)), "max_us": us(self.most),
        })
    }
}

/// The octave of a time, and behind it the bits below its highest one: no logarithm is needed.
fn bucket(ns: Ns) -> usize {
    let ns = ns.max(1) as u64;
    let octave = ns.ilog2();
    let step = ((ns << (63 - octave)) >> (63 - STEP_BITS)) as usize & (STEPS_PER_OCTAVE - 1);
    (octave as usize * STEPS_PER_OCTAVE + step).min(BUCKETS - 1)
}

/// The middle of a bucket.
fn middle(bucket: usize) -> Ns {
    let (octave, step) = (bucket / STEPS_PER_OCTAVE, bucket % STEPS_PER_OCTAVE);
    ((1u64 << octave) as f64 * (1.0 + (step as f64 + 0.5) / STEPS_PER_OCTAVE as f64)) as Ns
}

/// The transactions of a function with one unit.
#[derive(Clone, Debug, Default)]
struct Row {
    function: u8,
    statuses: [u64; 8],
    retries: u64,
    exceptions: BTreeMap<u8, u64>,
    response: Times,
}

/// The functions of a unit, which are few.
#[derive(Clone, Debug, Default)]
struct Unit {
    rows: Vec<Row>,
    /// One more than the place of a function in them; 0 where it was not frame.
    places: Vec<u8>,
}

#[derive(Clone, Debug, Default)]
struct BusCounts {
    name: String,
    mode: Option<Mode>,
    frames: [u64; 5],
    bytes: [u64; 5],
    /// By unit.
    units: Vec<Unit>,
    silence: Option<Silence>,
    requests: Requests,
    busy: Ns,
    first: Option<Ns>,
    last: Option<Ns>,
}

/// How often silences alone would have cut otherwise.
#[derive(Clone, Copy, Debug, Default)]
struct Silence {
    t35_ns: Ns,
    frames: u64,
    otherwise: u64,
    /// The last row was a frame that silences alone would have begun there, too.
    open: bool,
}

/// Statistics of a session.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    buses: Vec<BusCounts>,
    /// By finding, in the order of `Finding::ALL`.
    findings: Vec<u64>,
}

impl Stats {
    /// A bus was added; gives its number here.
    pub fn add_bus(&mut self, name: &str) -> usize {
        self.buses.push(BusCounts { name: name.into(), ..BusCounts::default() });
        self.buses.len() - 1
    }

    /// The number of the bus of this name, which is added if it is new.
    pub fn bus_named(&mut self, name: &str) -> usize {
        self.buses.iter().position(|bus| bus.name == name).unwrap_or_else(|| self.add_bus(name))
    }

    /// A bus has got another name.
    pub fn rename_bus(&mut self, bus: usize, name: &str) {
        self.buses[bus].name = name.into();
    }

    /// A frame was decided.
    pub fn frame(&mut self, bus: usize, mode: Mode, frame: &ObservedFrame<'_>) {
        let counts = &mut self.buses[bus];
        counts.mode = Some(mode);
        counts.frames[frame.verdict as usize] += 1;
        counts.bytes[frame.verdict as usize] += frame.wire.len() as u64;
        if !frame.verdict.good() {
            counts.requests.damaged(frame.number);
        }
        counts.on_the_line(frame.start.zip(frame.end));
    }

    /// What a silence of `t35_ns` would have made of this frame: whether one is before it, and whether one is inside.
    pub fn silence(&mut self, bus: usize, t35_ns: Ns, frame: &ObservedFrame<'_>, before: bool, inside: bool) {
        let counts = self.buses[bus].silence.get_or_insert(Silence { t35_ns, ..Silence::default() });
        // What is not cut here goes to the frame before, too.
        counts.otherwise += u64::from(counts.open && !before);
        let good = frame.verdict.good();
        counts.open = good && before && !inside;
        counts.frames += u64::from(good);
        counts.otherwise += u64::from(good && !counts.open);
    }

    /// A transaction was decided.
    pub fn transaction(&mut self, bus: usize, functions: &Functions, transaction: &PendingTransaction) {
        self.buses[bus].requests.transaction(functions, transaction);
        let row = self.buses[bus].row(transaction.unit, transaction.function);
        row.statuses[transaction.status as usize] += 1;
        row.retries += u64::from(transaction.retry_of.is_some());
        if let Some(code) = transaction.exception {
            *row.exceptions.entry(code).or_default() += 1;
        }
        if let Some(time) = transaction.response_time {
            row.response.add(time);
        }
    }

    /// So many requests of which nothing is to be said were decided with their answers, of so many bytes.
    pub(crate) fn run(&mut self, bus: usize, mode: Mode, exchanges: u64, bytes: u64) {
        let counts = &mut self.buses[bus];
        counts.mode = Some(mode);
        counts.frames[Verdict::Ok as usize] += 2 * exchanges;
        counts.bytes[Verdict::Ok as usize] += bytes;
    }

    /// One of them: when it and its answer were on the line, and how long the answer took.
    #[inline]
    pub(crate) fn again(&mut self, bus: usize, key: Key, spans: [Option<(Ns, Ns)>; 2], response_time: Option<Ns>) {
        let counts = &mut self.buses[bus];
        for span in spans {
            counts.on_the_line(span);
        }
        counts.requests.asked(key, spans[0].map(|(start, _)| start));
        let row = counts.row(key.unit(), key.function());
        row.statuses[Status::Ok as usize] += 1;
        if let Some(time) = response_time {
            row.response.add(time);
        }
    }

    /// Something was found.
    pub fn finding(&mut self, finding: Finding) {
        self.findings.resize(Finding::ALL.len(), 0);
        self.findings[finding as usize] += 1;
    }

    /// All counters.
    pub fn json(&self, functions: &Functions) -> Json {
        let mut statuses: BTreeMap<&str, u64> = BTreeMap::new();
        let buses: Vec<Json> = self.buses.iter().map(|bus| bus.json(&mut statuses, functions)).collect();
        let counted = Finding::ALL.iter().zip(&self.findings).filter(|(_, &count)| count > 0);
        let findings: BTreeMap<&str, u64> = counted.map(|(finding, &count)| (finding.doc().code, count)).collect();
        json!({"transactions": statuses, "findings": findings, "buses": buses})
    }
}

impl BusCounts {
    #[inline]
    fn on_the_line(&mut self, span: Option<(Ns, Ns)>) {
        if let Some((start, end)) = span {
            self.busy += (end - start).max(0);
            self.first.get_or_insert(start);
            self.last = Some(end);
        }
    }

    fn row(&mut self, unit: u8, function: u8) -> &mut Row {
        match self.units.get(usize::from(unit)).and_then(|unit| unit.places.get(usize::from(function))) {
            Some(&place @ 1..) => &mut self.units[usize::from(unit)].rows[usize::from(place) - 1],
            _ => self.new_row(unit, function),
        }
    }

    #[cold]
    fn new_row(&mut self, unit: u8, function: u8) -> &mut Row {
        self.units.resize_with(256, Unit::default);
        let Unit { rows, places } = &mut self.units[usize::from(unit)];
        places.resize(256, 0);
        rows.push(Row { function, ..Row::default() });
        // Function codes have seven bits.
        places[usize::from(function)] = rows.len() as u8;
        rows.last_mut().expect("just added")
    }

    /// By unit and function.
    fn rows(&self) -> impl Iterator<Item = (usize, &Row)> {
        self.units.iter().enumerate().flat_map(|(unit, of)| {
            let mut rows: Vec<&Row> = of.rows.iter().collect();
            rows.sort_by_key(|row| row.function);
            rows.into_iter().map(move |row| (unit, row))
        })
    }

    fn json(&self, total: &mut BTreeMap<&str, u64>, functions: &Functions) -> Json {
        let by_verdict = |counts: &[u64; 5]| -> Json {
            Verdict::ALL
                .iter()
                .map(|v| (v.text().to_string(), Json::from(counts[*v as usize])))
                .collect::<serde_json::Map<_, _>>()
                .into()
        };
        let units: Vec<Json> = self
            .rows()
            .map(|(unit, row)| {
                let counted = Status::ALL.iter().map(|status| (status.text(), row.statuses[*status as usize])).filter(|(_, count)| *count > 0);
                let statuses: BTreeMap<&str, u64> = counted.collect();
                for (status, count) in &statuses {
                    *total.entry(status).or_default() += count;
                }
                json!({
                    "unit": unit, "function": row.function, "transactions": row.statuses.iter().sum::<u64>(), "statuses": statuses,
                    "retries": row.retries, "exceptions": row.exceptions.iter().map(|(k, v)| (k.to_string(), *v)).collect::<BTreeMap<_, _>>(),
                    "response_time": row.response.json(),
                })
            })
            .collect();
        let span = self.first.zip(self.last).map(|(first, last)| last - first).filter(|&span| span > 0);
        json!({
            "bus": self.name, "mode": self.mode.map(Mode::text), "frames": by_verdict(&self.frames), "bytes": by_verdict(&self.bytes),
            "duration_us": span.map(|ns| ns as f64 / 1000.0), "busy_us": span.map(|_| self.busy as f64 / 1000.0),
            "silence": self.silence.map(|counts| json!({
                "t35_us": counts.t35_ns as f64 / 1000.0, "frames": counts.frames, "otherwise": counts.otherwise,
            })),
            "load": span.map(|span| self.busy as f64 / span as f64), "units": units,
            "cycle": self.requests.cycle(), "timeouts": self.requests.timeouts(functions),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_stand_in_buckets_of_a_part_of_an_octave() {
        // Behind 2^19 = 524,288 ns in steps of 16,384: number 29 begins at 999,424 and holds a millisecond.
        assert_eq!(bucket(1_000_000), 19 * 32 + 29);
        assert_eq!(middle(19 * 32 + 29), 999_424 + 8_192);
        assert_eq!((bucket(-5), bucket(0), bucket(1)), (0, 0, 0));
        assert_eq!(bucket(Ns::MAX), BUCKETS - 1);
        let mut last = 0;
        for ns in (0..39 * 8).map(|eighth| (f64::from(eighth) / 8.0).exp2() as Ns).filter(|&ns| ns > 32) {
            assert!(bucket(ns) >= last, "{ns}");
            assert!((middle(bucket(ns)) - ns).abs() * 64 <= ns + 64, "{ns}");
            last = bucket(ns);
        }
    }
}
