//! Compact exchanges: what the rows of an unambiguous exchange follow from, in a twentieth of the memory, or a fifth where it
//! has times.

use std::sync::Arc;

use crate::records::rows::{FrameRef, Span, Transaction};
use crate::weights::UNCONFIRMED_TRANSACTION_BITS;
use modlens_profiles::points::{PlanInstance, UnitPlans};
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::framing::Mode;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Function codes without the exception bit.
const FUNCTIONS: usize = 128;

/// The highest exception code of the specification (application protocol, 7).
const MAX_EXCEPTION: u8 = 11;

/// An exchange of an RTU line, or of a TCP connection in a packet each: a plain request and its good response,
/// without a finding; or its refusal, whose only finding is the exception. Its bytes are in the arena, the response's right
/// after the request's.
#[derive(Clone, Copy, Debug)]
pub struct Exchange {
    /// Where the request's bytes begin.
    pub start: u32,
    /// Bytes of the request and of the response.
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
    /// The exception code of a refusal, which is one that `has_place_for` takes; else `NOT_REFUSED`.
    pub exception: u8,
}

/// The `exception` of an exchange whose response has data.
pub const NOT_REFUSED: u8 = 0;

impl Exchange {
    /// Kinds of exchanges (`kind`).
    pub const KINDS: usize = FUNCTIONS * (MAX_EXCEPTION as usize + 1);

    /// Whether a refusal with this exception code may be a compact exchange. Others than those of the specification are rare,
    /// and there would be a kind for each.
    #[inline]
    pub fn has_place_for(exception: u8) -> bool {
        (1..=MAX_EXCEPTION).contains(&exception)
    }

    /// Function and exception code as one number. Exchanges of a kind have values in the same columns.
    #[inline]
    pub fn kind(&self) -> usize {
        usize::from(self.exception) * FUNCTIONS + usize::from(self.function)
    }

    /// How it ended.
    #[inline]
    pub fn status(&self) -> Status {
        if self.exception == NOT_REFUSED {
            Status::Ok
        } else {
            Status::Exception
        }
    }

    /// The PDUs of the request and of the response of an RTU line.
    #[inline]
    pub fn pdus<'a>(&self, arena: &'a [u8]) -> [&'a [u8]; 2] {
        let [request, response] = self.lengths.map(usize::from);
        let both = &arena[self.start as usize..][..request + response];
        let (request, response) = both.split_at(request);
        [request, response].map(|frame| &frame[1..frame.len() - CRC_BYTES])
    }

    /// The numbers of bytes in front of a PDU and after it, on a connection and on an RTU line.
    #[inline]
    pub fn around_pdu(mode: Mode) -> [u32; 2] {
        if mode == Mode::Tcp {
            [MBAP_PREFIX_BYTES as u32 + 1, 0]
        } else {
            [1, CRC_BYTES as u32]
        }
    }

    /// The bytes of one of its frames.
    #[inline]
    pub fn frame<'a>(&self, half: ExchangeFrame, arena: &'a [u8]) -> &'a [u8] {
        let [request, response] = self.lengths.map(usize::from);
        match half {
            ExchangeFrame::Request => &arena[self.start as usize..][..request],
            ExchangeFrame::Response => &arena[self.start as usize + request..][..response],
        }
    }

    /// The body of one of its PDUs, on a connection or on an RTU line.
    #[inline]
    pub fn body<'a>(&self, half: ExchangeFrame, arena: &'a [u8], mode: Mode) -> &'a [u8] {
        let [before, after] = Self::around_pdu(mode).map(|bytes| bytes as usize);
        let frame = self.frame(half, arena);
        &frame[before + 1..frame.len() - after]
    }
}

/// One of the two frames of an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExchangeFrame {
    /// That of the request.
    Request,
    /// That of the response.
    Response,
}

/// A duration that may be unknown. It takes no more memory than a known one: exchanges are kept by the million.
#[derive(Clone, Copy, Debug)]
pub struct OptionalNs(Ns);

impl OptionalNs {
    /// One that is not known. No clock reaches its value.
    pub const UNKNOWN: Self = Self(Ns::MIN);

    /// One that is known.
    pub const fn known(ns: Ns) -> Self {
        Self(ns)
    }

    /// The duration, if it is known.
    pub fn get(self) -> Option<Ns> {
        (self.0 != Ns::MIN).then_some(self.0)
    }
}

impl From<Option<Ns>> for OptionalNs {
    fn from(known: Option<Ns>) -> Self {
        known.map_or(Self::UNKNOWN, Self)
    }
}

/// What a compact exchange with times has beside its bytes: the times and the place of its packets, or of its lines in a log.
#[derive(Clone, Copy, Debug)]
pub struct PacketPair {
    /// Start of the request and of the response.
    pub starts: [Ns; 2],
    /// Silence before the request.
    pub gap: OptionalNs,
    /// From the end of the request to the start of the response; `None` if the clock cannot measure it.
    pub response_time: OptionalNs,
    /// Number of the request's packet or line.
    pub packet: u64,
    /// Transaction identifier of both MBAP headers, on a connection.
    pub mbap_id: u16,
}

/// Compact exchanges that stand one after the other, on the line and in the arena.
#[derive(Clone, Debug)]
pub struct ExchangeRun {
    /// Index of the bus.
    pub bus: u32,
    /// Number of the first transaction; the others have the next ones.
    pub number: u64,
    /// Number of the first frame; each exchange has two.
    pub frame: u64,
    /// Stream offset of the first byte; of no use where there are times.
    pub offset: u64,
    /// Which of `Batch::exchanges`; at least one.
    pub exchanges: Span,
    /// Where there are times, those of their packets or lines; `None` on a line without a clock.
    pub packets: Option<PacketsOfRun>,
    /// The profiles of the units of the bus, which are the same for all of them; `None` if no unit has one.
    pub points: Option<Arc<UnitPlans>>,
}

/// The packets of a run on a connection, or the lines of one in a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketsOfRun {
    /// Index of the first of its exchanges in `Batch::packet_pairs`.
    pub first: u32,
    /// When the recording began.
    pub recording_start: Option<Ns>,
    /// Framing: Modbus/TCP on a connection, else RTU.
    pub mode: Mode,
}

/// The times of a compact exchange.
#[derive(Clone, Copy, Debug)]
pub struct ExchangeTiming<'a> {
    /// Those of its packets or lines.
    pub pair: &'a PacketPair,
    /// When the recording began.
    pub recording_start: Option<Ns>,
}

impl ExchangeRun {
    /// Number of the transaction after its last one.
    #[inline]
    pub fn end(&self) -> u64 {
        self.number + u64::from(self.exchanges.length)
    }

    /// The row of the transaction at this place of the run: the one that the session would have made. `exchanges` and `pairs` are
    /// all of the batch.
    #[inline]
    pub fn transaction(&self, exchanges: &[Exchange], pairs: &[PacketPair], at: usize) -> Transaction {
        let own = self.exchanges.of(exchanges);
        let points = self.points_of(own[at].unit).cloned();
        Transaction { points, ..self.transaction_of(&own[at], at, own[0].start, self.timing(pairs, at)) }
    }

    /// The profile of a unit.
    #[inline]
    pub fn points_of(&self, unit: u8) -> Option<&Arc<PlanInstance>> {
        self.points.as_ref()?.of_unit(unit)
    }

    /// The numbers of bytes in front of a PDU and after it.
    #[inline]
    pub fn around_pdu(&self) -> [u32; 2] {
        Exchange::around_pdu(self.mode())
    }

    /// Framing.
    #[inline]
    pub fn mode(&self) -> Mode {
        self.packets.map_or(Mode::Rtu, |packets| packets.mode)
    }

    /// The times of the exchange at this place, if there are any.
    #[inline]
    pub fn timing<'a>(&self, pairs: &'a [PacketPair], at: usize) -> Option<ExchangeTiming<'a>> {
        let PacketsOfRun { first, recording_start, .. } = self.packets?;
        Some(ExchangeTiming { pair: &pairs[first as usize + at], recording_start })
    }

    /// The same, for an exchange that is at this place and has these times; the bytes of the first one begin at `first_start` in
    /// the arena. Where a caller reads little of the row, little of it is made, and the profile (`points_of`) is left out, since it
    /// would have to be dropped.
    #[inline(always)]
    #[allow(clippy::inline_always)] // What the caller does not read is known only there.
    pub fn transaction_of(
        &self,
        exchange: &Exchange,
        at: usize,
        first_start: u32,
        timing: Option<ExchangeTiming<'_>>,
    ) -> Transaction {
        let Exchange { start, lengths, unit, function, confidence, exception, .. } = *exchange;
        let pair = timing.map(|timing| timing.pair);
        let [before, after] = self.around_pdu();
        let [request, response] = lengths.map(u32::from);
        let frame = self.frame + 2 * at as u64;
        let frame_ref = |frame: u64, begin: u32, length: u32, side: usize| {
            let pdu = Span { start: begin + before, length: length - before - after };
            let start = pair.map(|pair| pair.starts[side]);
            FrameRef { frame, wire: Span { start: begin, length }, pdu, start, end: start }
        };
        Transaction {
            number: self.number + at as u64,
            bus: self.bus,
            mode: self.mode(),
            start: pair.map(|pair| pair.starts[0]),
            elapsed: timing.and_then(|timing| Some(timing.pair.starts[0] - timing.recording_start?)),
            unit,
            function,
            status: exchange.status(),
            exception: Some(exception).filter(|&code| code != 0),
            confidence,
            unconfirmed: confidence < UNCONFIRMED_TRANSACTION_BITS,
            response_time: pair.and_then(|pair| pair.response_time.get()),
            waited: None,
            late_response: None,
            retry_of: None,
            late_response_to: None,
            gap: pair.and_then(|pair| pair.gap.get()),
            mbap_id: pair.filter(|_| self.mode() == Mode::Tcp).map(|pair| pair.mbap_id),
            request: frame_ref(frame, start, request, 0),
            response: frame_ref(frame + 1, start + request, response, 1),
            // The finding of a refusal is the first of each batch.
            findings: Span { start: 0, length: u32::from(exception != 0) },
            points: None,
            origin: pair.map_or(self.offset + u64::from(start - first_start), |pair| pair.packet),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_duration_is_no_known_one_and_takes_no_memory() {
        let known = [Ns::MIN + 1, -1, 0, 1, Ns::MAX];
        assert_eq!(known.map(|ns| OptionalNs::known(ns).get()), known.map(Some));
        assert_eq!([Some(0), None].map(|ns| OptionalNs::from(ns).get()), [Some(0), None]);
        assert_eq!(OptionalNs::UNKNOWN.get(), None);
        assert_eq!(size_of::<OptionalNs>(), size_of::<Ns>());
    }
}
