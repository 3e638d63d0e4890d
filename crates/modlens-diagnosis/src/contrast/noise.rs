//! Bytes that are no frame: how they look, and whether the same runs come again.

use std::collections::BTreeMap;

use modlens_protocol::framing::Verdict;
use modlens_protocol::oddity::is_of_driver;
use modlens_protocol::Ns;

use super::sample::Sample;
use super::tally::{mix_bytes, Tally};
use super::writes::AfterWrites;
use crate::observation::FrameObservation;
use crate::protocols;
use modlens_engine::durations::Durations;

/// Different runs that are counted one by one.
const MAX_RUNS: usize = 256;

/// Different first two bytes that are counted one by one.
const MAX_HEADS: usize = 128;

/// Different runs with the same beginning that are distinguished.
const MAX_WHOLES: usize = 4;

/// The beginning of a run of noise.
pub type NoiseKey = Vec<u8>;

/// Bytes of a run by which it is known again.
const KEY_BYTES: usize = 3;

/// One run that comes again and again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoiseCounts {
    /// How often it came.
    pub seen: Tally,
    /// Its bytes in all.
    pub bytes: u64,
    /// From one to the next.
    pub period: Durations,
    /// Some of the different runs that begin like this, by their hashes.
    pub wholes: Sample<u64, u64, MAX_WHOLES>,
    first: Option<Ns>,
    last: Option<Ns>,
}

/// All runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoiseRuns {
    /// Runs of three bytes or more; those that end in 00.
    pub ends_in_zero: Tally,
    /// Runs of one or two bytes, those of 00, FF and what a driver leaves when it is switched.
    pub strays: Tally,
    /// Bytes 00; FF; with high bits set and low ones not (FE, FC, F8, F0, E0, C0, 80); printable; others.
    kinds: [u64; 5],
    /// Runs of four bytes or more that are no answer.
    pub compared: u64,
    /// These by how they begin.
    pub runs: Sample<NoiseKey, NoiseCounts, MAX_RUNS>,
    /// These by their first two bytes.
    pub heads: Sample<[u8; 2], NoiseCounts, MAX_HEADS>,
    /// These by the place of their protocol among those that are known by more than their beginning.
    pub protocols: BTreeMap<usize, NoiseCounts>,
    /// The first bursts between two silences.
    pub bursts: Bursts,
    /// Between how many good frames there was more than strays: elsewhere, and after writes.
    pub by_write: [u64; 2],
    /// The latter, and good frames, by what is written.
    pub after_writes: AfterWrites,
}

/// Bursts that are kept, and the bytes of each.
const MAX_BURSTS: usize = 64;
const MAX_BURST_BYTES: usize = 256;

/// The first bursts of a bus: rows without a silence between them are one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bursts {
    /// Their bytes.
    pub kept: Vec<Vec<u8>>,
    /// Whether each came right after a request.
    pub answers: Vec<bool>,
    begun: usize,
    /// The first row goes on with what was in front of it.
    goes_on: bool,
}

impl Bursts {
    fn count(&mut self, bytes: &[u8], goes_on: bool, is_answer: bool) {
        if self.begun == 0 {
            self.goes_on = goes_on;
        }
        if goes_on && self.begun > 0 {
            self.extend(bytes);
        } else {
            self.begin(bytes, is_answer);
        }
    }

    fn begin(&mut self, bytes: &[u8], is_answer: bool) {
        self.begun += 1;
        if self.begun <= MAX_BURSTS {
            self.kept.push(bytes.to_vec());
            self.answers.push(is_answer);
        }
    }

    fn extend(&mut self, bytes: &[u8]) {
        if let (1..=MAX_BURSTS, Some(last)) = (self.begun, self.kept.last_mut()) {
            last.extend_from_slice(bytes);
            last.truncate(MAX_BURST_BYTES);
        }
    }

    fn merge(&mut self, later: &Self) {
        if self.begun == 0 {
            self.clone_from(later);
            return;
        }
        let joined = usize::from(later.begun > 0 && later.goes_on);
        if joined == 1 {
            self.extend(&later.kept[0]);
        }
        for (burst, is_answer) in later.kept.iter().zip(&later.answers).skip(joined) {
            self.begin(burst, *is_answer);
        }
        self.begun += later.begun - later.kept.len();
    }
}

impl NoiseRuns {
    /// All bytes.
    pub fn bytes(&self) -> u64 {
        self.kinds.iter().sum()
    }

    /// Bytes as a driver leaves them that is switched, or a line that nobody drives.
    pub fn of_driver(&self) -> u64 {
        self.kinds[..PRINTABLE].iter().sum()
    }

    /// Bytes of text.
    pub fn printable(&self) -> u64 {
        self.kinds[PRINTABLE]
    }

    /// Counts a run; one right after a request is its damaged answer and not compared with others.
    pub(super) fn count(&mut self, seen: &FrameObservation, is_answer: bool) {
        if seen.length >= 3 {
            // The last byte is known only where the run is not longer than what is kept of it.
            if seen.bytes.len() == seen.length as usize {
                self.ends_in_zero.count(seen.bytes.last() == Some(&0), seen.place);
            }
        } else if seen.verdict == Verdict::Noise {
            self.strays.count(seen.bytes.iter().all(|byte| is_of_driver(*byte)), seen.place);
        }
        self.bursts.count(&seen.bytes, seen.gap.is_none() && seen.place.time.is_some(), is_answer);
        for byte in &seen.bytes {
            self.kinds[kind(*byte)] += 1;
        }
        if seen.length >= 4 && !is_answer {
            self.compared += 1;
            if let Some(protocol) = protocols::known(&seen.bytes) {
                self.protocols.entry(protocol).or_default().count(seen);
            }
            if let [first, second, ..] = *seen.bytes.as_slice() {
                if let Some(counts) = self.heads.entry(mix_bytes(&[first, second]), [first, second]) {
                    counts.count(seen);
                }
            }
            let key = seen.bytes[..seen.bytes.len().min(KEY_BYTES)].to_vec();
            if let Some(counts) = self.runs.entry(mix_bytes(&key), key) {
                counts.count(seen);
            }
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.ends_in_zero.merge(&later.ends_in_zero);
        self.strays.merge(&later.strays);
        self.kinds.iter_mut().zip(later.kinds).for_each(|(own, more)| *own += more);
        self.compared += later.compared;
        self.runs.merge(later.runs.clone(), NoiseCounts::merge);
        self.heads.merge(later.heads.clone(), NoiseCounts::merge);
        for (protocol, more) in &later.protocols {
            self.protocols.entry(*protocol).or_default().merge(more);
        }
        self.bursts.merge(&later.bursts);
        self.by_write.iter_mut().zip(later.by_write).for_each(|(own, more)| *own += more);
        self.after_writes.merge(&later.after_writes);
    }
}

impl NoiseCounts {
    fn count(&mut self, seen: &FrameObservation) {
        self.seen.count(true, seen.place);
        self.bytes += u64::from(seen.length);
        let whole = mix_bytes(&seen.bytes);
        if let Some(count) = self.wholes.entry(whole, whole) {
            *count += 1;
        }
        let Some(time) = seen.place.time else { return };
        if let Some(last) = self.last.filter(|last| *last < time) {
            self.period.add(time - last);
        }
        self.first.get_or_insert(time);
        self.last = Some(time);
    }

    fn merge(&mut self, later: &Self) {
        self.seen.merge(&later.seen);
        self.bytes += later.bytes;
        self.period.merge(&later.period);
        self.wholes.merge(later.wholes.clone(), |own, more| *own += more);
        if let Some((last, first)) = self.last.zip(later.first).filter(|(last, first)| last < first) {
            self.period.add(first - last);
        }
        self.first = self.first.or(later.first);
        self.last = later.last.or(self.last);
    }
}

/// The class of printable bytes; those of a driver are below it.
const PRINTABLE: usize = 3;

/// The class of a byte, as in `kinds`.
fn kind(byte: u8) -> usize {
    match byte {
        0 => 0,
        0xFF => 1,
        _ if is_of_driver(byte) => 2,
        b' '..=b'~' | b'\r' | b'\n' => PRINTABLE,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bursts(rows: &[(&[u8], bool)]) -> Bursts {
        let mut all = Bursts::default();
        for (bytes, goes_on) in rows {
            all.count(bytes, *goes_on, false);
        }
        all
    }

    #[test]
    fn bursts_merge_to_the_whole_wherever_they_are_cut() {
        let rows: Vec<(&[u8], bool)> = (0..200).map(|at| (&b"abc"[at % 3..], at % 5 > 2 || at % 7 == 0)).collect();
        for cut in 0..=rows.len() {
            let mut merged = bursts(&rows[..cut]);
            merged.merge(&bursts(&rows[cut..]));
            assert_eq!(merged, bursts(&rows), "cut at {cut}");
        }
        assert_eq!(bursts(&rows[..4]).kept, [b"abc".to_vec(), b"bc".to_vec(), b"cabc".to_vec()]);
    }
}
