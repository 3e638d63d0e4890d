//! Frames of a bus, by their verdicts and their findings.

use modlens_engine::records::Frame;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::Ns;

use super::rates::Rates;
use super::tally::Tally;
use crate::observation::{FrameObservation, DAMAGED_PARTS};

/// Frames, good and bad, of a bus.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameCounts {
    /// By verdict, in the order of `Verdict::ALL`.
    pub frames: [u64; Verdict::ALL.len()],
    /// Bytes by verdict.
    pub bytes: [u64; Verdict::ALL.len()],
    /// Bytes of frames with a right checksum that may be an accident of noise.
    pub unconfirmed_bytes: u64,
    /// Bytes of the longest of those.
    pub longest_unconfirmed: u64,
    /// First and last time.
    pub span: Option<(Ns, Ns)>,
    /// Frames with a single flipped bit.
    pub bit_flips: Tally,
    /// Frames in which another device transmitted, too.
    pub collisions: Tally,
    /// Requests heard twice.
    pub echoes: Tally,
    /// Frames with a pause inside.
    pub pauses: Tally,
    /// Bytes lost or doubled by the tap.
    pub lost: Tally,
    /// Damaged requests without a transaction, by the part that is damaged.
    pub request_parts: [Tally; DAMAGED_PARTS],
    /// How fast the bytes of good frames came.
    pub rates: Rates,
    /// Good frames of writes, and those shortly after them.
    pub behind_writes: u64,
    /// Frames without a finding that are not counted in the tallies yet.
    clean: u64,
}

impl FrameCounts {
    /// Frames with this verdict.
    pub fn of(&self, verdict: Verdict) -> u64 {
        self.frames[verdict as usize]
    }

    /// Bytes of frames with this verdict.
    pub fn bytes_of(&self, verdict: Verdict) -> u64 {
        self.bytes[verdict as usize]
    }

    /// Bytes of frames that are right as far as their bytes can tell.
    pub fn good_bytes(&self) -> u64 {
        self.bytes_of(Verdict::Ok) + self.bytes_of(Verdict::NoChecksum)
    }

    pub(super) fn count(&mut self, seen: &FrameObservation) {
        self.settle();
        self.count_size(seen.verdict as usize, seen.length, seen.place.time);
        let has = |finding| seen.findings.has(finding);
        if seen.verdict.is_good() && has(Finding::Unconfirmed) {
            self.unconfirmed_bytes += u64::from(seen.length);
            self.longest_unconfirmed = self.longest_unconfirmed.max(seen.length.into());
        }
        self.bit_flips.count(has(Finding::BitFlip), seen.place);
        self.collisions.count(has(Finding::Collision), seen.place);
        self.echoes.count(has(Finding::LocalEcho), seen.place);
        self.pauses.count(has(Finding::GapInFrame), seen.place);
        if let Some(part) = seen.damage {
            self.request_parts.iter_mut().enumerate().for_each(|(at, tally)| tally.count(at == part as usize, seen.place));
        }
        self.lost.count(has(Finding::LostBytes) || has(Finding::DuplicateByte), seen.place);
    }

    #[inline]
    pub(super) fn count_clean(&mut self, row: &Frame) {
        self.clean += 1;
        self.count_size(row.verdict as usize, row.wire.length, row.start);
    }

    pub(super) fn count_compact(&mut self, frames: u64, bytes: u64) {
        self.clean += frames;
        self.frames[Verdict::Ok as usize] += frames;
        self.bytes[Verdict::Ok as usize] += bytes;
    }

    #[inline]
    fn count_size(&mut self, verdict: usize, length: u32, time: Option<Ns>) {
        self.frames[verdict] += 1;
        self.bytes[verdict] += u64::from(length);
        if let Some(time) = time {
            let (first, last) = self.span.unwrap_or((time, time));
            self.span = Some((first.min(time), last.max(time)));
        }
    }

    /// Counts the clean frames in the tallies.
    pub(super) fn settle(&mut self) {
        let clean = std::mem::take(&mut self.clean);
        for tally in [&mut self.bit_flips, &mut self.collisions, &mut self.echoes, &mut self.pauses, &mut self.lost] {
            tally.count_good(clean);
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.frames.iter_mut().zip(later.frames).for_each(|(own, more)| *own += more);
        self.bytes.iter_mut().zip(later.bytes).for_each(|(own, more)| *own += more);
        self.unconfirmed_bytes += later.unconfirmed_bytes;
        self.longest_unconfirmed = self.longest_unconfirmed.max(later.longest_unconfirmed);
        self.span = match (self.span, later.span) {
            (Some(own), Some(more)) => Some((own.0.min(more.0), own.1.max(more.1))),
            (own, more) => own.or(more),
        };
        self.bit_flips.merge(&later.bit_flips);
        self.collisions.merge(&later.collisions);
        self.request_parts.iter_mut().zip(&later.request_parts).for_each(|(own, more)| own.merge(more));
        self.echoes.merge(&later.echoes);
        self.pauses.merge(&later.pauses);
        self.lost.merge(&later.lost);
        self.behind_writes += later.behind_writes;
        self.rates.merge(&later.rates);
    }
}
