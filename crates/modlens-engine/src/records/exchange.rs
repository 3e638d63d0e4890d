//! Exchanges in short: what the rows of an exchange without a doubt follow from, in a twentieth of the room.

use crate::records::{Batch, Frame, FrameRef, Span, Transaction};
use crate::weights::UNCONFIRMED_TRANSACTION_BITS;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::status::Status;

/// An exchange of an RTU line without a clock, in short: a plain request and its good answer, without a finding. Its bytes are
/// in the arena, the answer's right behind the request's.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// Where the request's bytes begin.
    pub start: u32,
    /// Bytes of the request and of the answer.
    pub lengths: [u16; 2],
    /// Address of the first register or bit.
    pub address: u16,
    /// Number of registers or bits.
    pub quantity: u16,
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub function: u8,
    /// Log2 odds that the two belong together, and are what they seem.
    pub confidence: u8,
}

impl Exchange {
    /// The PDUs of the request and of the answer.
    #[inline]
    pub fn pdus<'a>(&self, arena: &'a [u8]) -> [&'a [u8]; 2] {
        let [request, answer] = self.lengths.map(usize::from);
        let both = &arena[self.start as usize..][..request + answer];
        let (request, answer) = both.split_at(request);
        [request, answer].map(|frame| &frame[1..frame.len() - CRC_BYTES])
    }
}

/// Rows of a batch that stand behind each other: as rows, or exchanges in short.
#[derive(Clone, Copy, Debug)]
pub enum Part<'a, Row> {
    /// As rows; at least one.
    Rows(&'a [Row]),
    /// In short.
    Short(&'a ExchangeRun),
}

impl Batch {
    /// The transactions in the order of their numbers, in parts.
    pub fn transaction_parts(&self) -> impl Iterator<Item = Part<'_, Transaction>> {
        parts(&self.transactions, |row| row.number, &self.exchange_runs, |run| run.number)
    }

    /// The frames in the order of their numbers, in parts; an exchange in short stands for its two.
    pub fn frame_parts(&self) -> impl Iterator<Item = Part<'_, Frame>> {
        parts(&self.frames, |row| row.number, &self.exchange_runs, |run| run.frame)
    }
}

fn parts<'a, Row>(
    mut rows: &'a [Row],
    of_row: fn(&Row) -> u64,
    runs: &'a [ExchangeRun],
    of_run: fn(&ExchangeRun) -> u64,
) -> impl Iterator<Item = Part<'a, Row>> {
    let mut runs = runs.iter().peekable();
    std::iter::from_fn(move || {
        if let Some(run) = runs.next_if(|run| rows.first().is_none_or(|row| of_run(run) < of_row(row))) {
            return Some(Part::Short(run));
        }
        let until = runs.peek().map_or(u64::MAX, |run| of_run(run));
        let (part, others) = rows.split_at(rows.iter().position(|row| of_row(row) > until).unwrap_or(rows.len()));
        rows = others;
        (!part.is_empty()).then_some(Part::Rows(part))
    })
}

/// Exchanges in short that stand one behind the other, on the line and in the arena.
#[derive(Clone, Debug)]
pub struct ExchangeRun {
    /// Index of the bus.
    pub bus: u32,
    /// Number of the first transaction; the others have the next ones.
    pub number: u64,
    /// Number of the first frame; each exchange has two.
    pub frame: u64,
    /// Stream offset of the first byte.
    pub offset: u64,
    /// Which of `Batch::exchanges`; at least one.
    pub exchanges: Span,
}

impl ExchangeRun {
    /// The row of the transaction at this place of the run, in the batch that both are of: the one that the session would have
    /// made.
    #[inline]
    pub fn transaction(&self, batch: &Batch, at: usize) -> Transaction {
        let exchanges = self.exchanges.of(&batch.exchanges);
        let Exchange { start, lengths, unit, function, confidence, .. } = exchanges[at];
        let [request, answer] = lengths.map(u32::from);
        let frame = self.frame + 2 * at as u64;
        let half = |frame: u64, start: u32, length: u32| {
            let pdu = Span { start: start + 1, length: length - 1 - CRC_BYTES as u32 };
            FrameRef { frame, wire: Span { start, length }, pdu, start: None }
        };
        Transaction {
            number: self.number + at as u64,
            bus: self.bus,
            mode: Mode::Rtu,
            start: None,
            elapsed: None,
            unit,
            function,
            status: Status::Ok,
            exception: None,
            confidence,
            unconfirmed: confidence < UNCONFIRMED_TRANSACTION_BITS,
            response_time: None,
            waited: None,
            late_response: None,
            retry_of: None,
            late_response_to: None,
            gap: None,
            mbap_id: None,
            request: half(frame, start, request),
            response: half(frame + 1, start + request, answer),
            findings: Span::default(),
            points: None,
            origin: self.offset + u64::from(start - exchanges[0].start),
        }
    }
}
