//! Exchanges in short: what the rows of an exchange without a doubt follow from, in a twentieth of the room.

use crate::records::rows::{FrameRef, Span, Transaction};
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
    /// The row of the transaction at this place of the run: the one that the session would have made. `exchanges` are all of the
    /// batch.
    #[inline]
    pub fn transaction(&self, exchanges: &[Exchange], at: usize) -> Transaction {
        let of_run = self.exchanges.of(exchanges);
        let Exchange { start, lengths, unit, function, confidence, .. } = of_run[at];
        let [request, answer] = lengths.map(u32::from);
        let frame = self.frame + 2 * at as u64;
        let frame_ref = |frame: u64, start: u32, length: u32| {
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
            request: frame_ref(frame, start, request),
            response: frame_ref(frame + 1, start + request, answer),
            findings: Span::default(),
            // A line with profiles has no exchanges in short.
            points: None,
            origin: self.offset + u64::from(start - of_run[0].start),
        }
    }
}
