//! How often each symptom was seen: what a joint explanation has to account for.

use std::collections::BTreeMap;

use modlens_protocol::checksum::{crc_valid, CRC_BYTES};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::in_words;
use modlens_protocol::mbap::{layout_lengths, PREFIX_BYTES};
use modlens_protocol::oddity::{bare_refusals, is_of_driver, is_swapped, is_text, Oddity};

use super::before::Before;
use super::context::Around;
use super::odd_transaction::{figures, of_transaction};
use super::symptom::Symptom;
use super::tally::{Place, Tally};
use crate::observation::{added, figures_of_header, Figures, FrameObservation, Observation};

/// How often each symptom was seen, by unit; `None` where no unit is near.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symptoms(BTreeMap<(Symptom, Option<u8>), Seen>);

/// How often a symptom was seen of a unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// All of them.
    pub all: Tally,
    /// Those that are failed requests; others are refusals, odd answers, and bytes between frames.
    pub failed_requests: u64,
    /// The numbers that show it, of the first of them.
    pub figures: Option<Figures>,
}

impl Symptoms {
    fn count(&mut self, symptom: Symptom, unit: Option<u8>, place: Place) -> &mut Seen {
        let seen = self.0.entry((symptom, unit)).or_default();
        seen.all.count(true, place);
        seen
    }

    /// Counts a transaction, if it is odd.
    pub(super) fn transaction(&mut self, seen: &Observation, before: Before) {
        if let Some(symptom) = of_transaction(seen, before) {
            let is_failure = seen.outcome.counts() && seen.outcome.is_failure();
            let counted = self.count(symptom, Some(seen.unit), seen.place);
            counted.failed_requests += u64::from(is_failure);
            counted.figures = counted.figures.or_else(|| figures(symptom, seen, before));
        }
    }

    /// Counts a frame of another framing than the one before.
    pub(super) fn other_framing(&mut self, seen: &FrameObservation) {
        self.count(Symptom::OtherFraming, seen.unit, seen.place);
    }

    /// Counts an answer that was taken as it is, although the bytes of its checksum are swapped.
    pub(super) fn swapped_checksum(&mut self, seen: &FrameObservation) {
        self.count(Symptom::ChecksumSwapped, seen.unit, seen.place);
    }

    /// Counts a request that another master has sent.
    pub(super) fn foreign_request(&mut self, seen: &FrameObservation) {
        self.count(Symptom::ForeignRequest, seen.unit, seen.place).figures = seen.unit.map(|unit| [unit.into(), 0]);
    }

    /// Counts a request with bytes of an idle line in front of it.
    pub(super) fn idle_front(&mut self, seen: &FrameObservation, figures: Figures) {
        let counted = self.count(Symptom::RequestBehind, seen.unit, seen.place);
        counted.figures = counted.figures.or(Some(figures));
    }

    /// Counts a frame of no transaction whose layout is not that of its function, although its checksum or header is right.
    pub(super) fn lone_layout(&mut self, seen: &FrameObservation) {
        let is_odd = seen.findings.has(Finding::LengthMismatch) || seen.findings.has(Finding::MbapLength);
        if is_odd && seen.txn.is_none() && seen.verdict == Verdict::Ok {
            let (symptom, figures) =
                layout(seen).map_or((Symptom::OtherLayout, None), |(symptom, figures)| (symptom, Some(figures)));
            let counted = self.count(symptom, seen.unit, seen.place);
            counted.figures = counted.figures.or(figures);
        }
    }

    /// Counts a message over Modbus/TCP whose length field no message can have, and which is therefore taken for no frame; whether
    /// it is one.
    pub(super) fn impossible_header(&mut self, seen: &FrameObservation) -> bool {
        let figures = impossible_header(&seen.bytes).filter(|_| seen.txn.is_none());
        if figures.is_some() {
            self.count(Symptom::HeaderLength, seen.bytes.get(PREFIX_BYTES).copied(), seen.place).figures = figures;
        }
        figures.is_some()
    }

    /// Counts bytes that belong to no transaction, near this unit.
    pub(super) fn frame(&mut self, seen: &FrameObservation, unit: Option<u8>, around: Around) {
        let is_behind_header = around.is_behind_header;
        if let Some((unit, code, times)) = bare_refusals(&seen.bytes) {
            for _ in 0..times {
                self.count(Symptom::RefusalBare, Some(unit), seen.place).figures = Some([code.into(), 0]);
            }
            return;
        }
        let symptom = match seen.bytes.as_slice() {
            bytes if is_behind_header && is_header(bytes) && added(bytes).is_none() => Symptom::HeaderLength,
            _ if is_behind_header => Symptom::BytesAfter,
            [byte] if Some(*byte) == unit => Symptom::NextStart,
            bytes if matches!(Oddity::of(bytes), Some(Oddity::Digits(_))) => Symptom::AnswerDigits,
            bytes if is_swapped(bytes) => Symptom::ChecksumSwapped,
            bytes if counted(seen).is_some() && crc_valid(bytes) => Symptom::CountWrong,
            [1..=247, pdu @ ..] if seen.mode == Mode::Tcp && in_words::pdu(pdu).is_some() => Symptom::HeaderMissing,
            bytes if bytes.len() < 3 && bytes.iter().all(|byte| is_of_driver(*byte)) => Symptom::Stray,
            bytes if is_text(bytes) => Symptom::Text,
            _ if around.is_behind_answer => Symptom::AfterAnswer,
            _ => Symptom::Noise,
        };
        let counted = self.count(symptom, unit, seen.place);
        let is_whole = || layout_lengths(Functions::embedded(), &seen.bytes).contains(&Some(seen.length as usize));
        if symptom == Symptom::HeaderLength && seen.bytes.len() == seen.length as usize && is_whole() {
            counted.figures = counted.figures.or(figures_of_header(&seen.bytes));
        }
        if let (Symptom::Noise, [byte]) = (symptom, &seen.bytes[..]) {
            counted.figures = counted.figures.or(Some([(*byte).into(), 0]));
        }
        if let (Symptom::AfterAnswer, [byte, ..]) = (symptom, &seen.bytes[..]) {
            counted.figures = counted.figures.or(Some([(*byte).into(), seen.length]));
        }
        if symptom == Symptom::CountWrong {
            counted.figures = counted.figures.or(self::counted(seen));
        }
        if symptom == Symptom::BytesAfter {
            counted.figures = counted.figures.or(Some([added(&seen.bytes).unwrap_or(seen.length), 0]));
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        for (key, seen) in &later.0 {
            let own = self.0.entry(*key).or_default();
            own.all.merge(&seen.all);
            own.failed_requests += seen.failed_requests;
            own.figures = own.figures.or(seen.figures);
        }
    }

    /// The numbers that show a symptom of a unit.
    pub fn figures(&self, symptom: Symptom, unit: Option<u8>) -> Option<Figures> {
        self.0.get(&(symptom, unit))?.figures
    }

    /// All of them with their counts.
    pub fn all(&self) -> impl Iterator<Item = (Symptom, Option<u8>, &Seen)> {
        self.0.iter().map(|((symptom, unit), seen)| (*symptom, *unit, seen))
    }
}

/// The byte count of a frame on a serial line that would be an answer to a read, and the bytes that follow it, where the two differ.
fn counted(seen: &FrameObservation) -> Option<Figures> {
    let [_, 1..=4, count, data @ .., _, _] = seen.bytes.as_slice() else { return None };
    let is_kept_whole = seen.mode == Mode::Rtu && seen.bytes.len() == seen.length as usize;
    (is_kept_whole && usize::from(*count) != data.len()).then_some([u32::from(*count), data.len() as u32])
}

/// The byte count of a whole frame and the bytes of data after it, where the two differ, and what that is.
fn layout(seen: &FrameObservation) -> Option<(Symptom, Figures)> {
    let pdu = match seen.mode {
        _ if seen.bytes.len() != seen.length as usize => None,
        Mode::Tcp => seen.bytes.get(PREFIX_BYTES + 1..),
        Mode::Rtu => seen.bytes.get(1..seen.bytes.len().checked_sub(CRC_BYTES)?),
        Mode::Ascii => None,
    };
    let differ = |count: u8, data: &[u8]| Some([u32::from(count), data.len() as u32]).filter(|[one, other]| one != other);
    match pdu? {
        [0x0F | 0x10, _, _, _, _, count, data @ ..] => Some((Symptom::RequestLayout, differ(*count, data)?)),
        [1..=4, count, data @ ..] if data.len() != READ_REST => Some((Symptom::CountWrong, differ(*count, data)?)),
        _ => None,
    }
}

/// What follows the first byte of the address in a request to read: the second one, and the quantity.
const READ_REST: usize = 3;

/// The length field of a header, and what follows it by the layout of its function, where no message can be as long as the field says.
fn impossible_header(bytes: &[u8]) -> Option<Figures> {
    let [announced, present] = figures_of_header(bytes)?;
    // On a serial line, this would be a unit and a public function.
    let may_be_serial = matches!(bytes[..2], [1..=247, 1..=24]);
    let whole = layout_lengths(Functions::embedded(), bytes).into_iter().flatten().find(|whole| *whole <= bytes.len())?;
    (announced > LONGEST && present > 2 && !may_be_serial).then(|| [announced, (whole - PREFIX_BYTES) as u32])
}

/// The most bytes after a length field: the unit and a PDU of 253 (Modbus messaging on TCP/IP, 3.1.3).
const LONGEST: u32 = 254;

/// Whether bytes begin as a frame over Modbus/TCP.
fn is_header(bytes: &[u8]) -> bool {
    figures_of_header(bytes).is_some_and(|[_, present]| present > 2)
}
