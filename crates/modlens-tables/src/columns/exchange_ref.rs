//! Compact exchanges as rows of the table of transactions, of which columns read what they show.

use std::mem::ManuallyDrop;

use modlens_engine::records::{Batch, Exchange, ExchangeFrame, ExchangeRun, ExchangeTiming, OptionalNs, PacketPair, Transaction};
use modlens_protocol::functions::{FunctionRow, Functions};
use modlens_protocol::pdu::u16_at;
use modlens_protocol::Ns;

use crate::columns::exchange_value::{ExchangeDuration, ExchangeNumber, ExchangeValue, PROFILE_COLUMN};
use crate::columns::function_rows::functions;
use crate::columns::transaction_view::TransactionView;

/// A compact exchange of a batch.
#[derive(Clone, Copy)]
pub struct ExchangeRef<'a> {
    pub(super) batch: &'a Batch,
    pub(super) run: &'a ExchangeRun,
    pub(super) exchange: &'a Exchange,
    /// Its place in the run.
    at: usize,
    /// Where the bytes of the run begin in the arena.
    run_start: u32,
    /// If it has times.
    timing: Option<ExchangeTiming<'a>>,
    functions: &'a Functions,
}

/// Packets of which all is known.
static KNOWN_TIMES: PacketPair =
    PacketPair { starts: [0, 0], gap: OptionalNs::known(0), response_time: OptionalNs::known(0), packet: 0, mbap_id: 0 };

impl<'a> ExchangeRef<'a> {
    /// Index of its bus.
    #[inline]
    pub fn bus(&self) -> u32 {
        self.run.bus
    }

    /// Its function and exception code as one number (`Exchange::kind`).
    #[inline]
    pub fn kind(&self) -> usize {
        self.exchange.kind()
    }

    /// One that has a value in each column in which an exchange of this bus and kind may have one: it may lack only times.
    #[must_use]
    pub fn with_known_times(&self) -> ExchangeRef<'a> {
        let known = ExchangeTiming { pair: &KNOWN_TIMES, recording_start: Some(0) };
        ExchangeRef { timing: self.timing.map(|_| known), ..*self }
    }

    /// What a column shows of exchanges of this bus and kind, where it has a value; `None` if it has to be read from their rows.
    pub fn value_of(&self, column: &str) -> Option<ExchangeValue> {
        // Where the body of a request chooses the row, it may be another one for the next exchange.
        let is_chosen = self.functions.leading_bytes(self.exchange.function) > 0;
        ExchangeValue::of_column(column, self.function_row().filter(|_| !is_chosen)?)
    }

    /// Its numbers, each at the place that `ExchangeNumber` has in the order. What a column without a value shows is of no use.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A dozen instructions, once a line.
    pub fn numbers(&self) -> [u64; ExchangeNumber::COUNT] {
        let (exchange, at) = (self.exchange, self.at as u64);
        let frame = self.run.frame + 2 * at;
        [
            self.run.number + at,
            u64::from(exchange.unit),
            u64::from(exchange.address),
            u64::from(exchange.quantity),
            u64::from(exchange.confidence),
            self.timing.map_or(0, |timing| u64::from(timing.pair.mbap_id)),
            frame,
            frame + 1,
            self.transaction().origin,
        ]
    }

    /// When its request began, if it has times.
    #[inline]
    pub fn start(&self) -> Option<Ns> {
        self.timing.map(|timing| timing.pair.starts[0])
    }

    /// One of its durations.
    #[inline]
    pub fn duration(&self, of: ExchangeDuration) -> Option<Ns> {
        let row = ManuallyDrop::new(self.transaction());
        match of {
            ExchangeDuration::Elapsed => row.elapsed,
            ExchangeDuration::Response => row.response_time,
            ExchangeDuration::Gap => row.gap,
        }
    }

    /// Whether its confidence is low.
    #[inline]
    pub fn is_unconfirmed(&self) -> bool {
        ManuallyDrop::new(self.transaction()).unconfirmed
    }

    /// The bytes of its request and of its response together.
    #[inline]
    pub fn byte_count(&self) -> usize {
        self.exchange.lengths.map(usize::from).iter().sum()
    }

    /// The bytes of one of its frames.
    #[inline]
    pub fn frame(&self, half: ExchangeFrame) -> &'a [u8] {
        self.exchange.frame(half, &self.batch.arena)
    }

    /// The body of one of its PDUs.
    #[inline]
    fn body(&self, half: ExchangeFrame) -> &'a [u8] {
        self.exchange.body(half, &self.batch.arena, self.run.mode())
    }

    /// The registers or bits from this offset of a body on.
    #[inline]
    pub fn block(&self, half: ExchangeFrame, at: usize) -> &'a [u8] {
        self.body(half).get(at..).unwrap_or(&[])
    }

    /// The number in two bytes of the request's body, at this offset.
    #[inline]
    pub fn request_word(&self, at: usize) -> u16 {
        u16_at(self.body(ExchangeFrame::Request), at).unwrap_or(0)
    }

    /// How many registers or bits it reads or writes.
    #[inline]
    pub fn quantity(&self) -> usize {
        usize::from(self.exchange.quantity)
    }

    /// The row of the table of functions for it.
    #[inline]
    pub(super) fn function_row(&self) -> Option<&'a FunctionRow> {
        // The body of a request chooses the row for few functions only.
        let body = match self.functions.leading_bytes(self.exchange.function) {
            0 => &[],
            _ => self.body(ExchangeFrame::Request),
        };
        self.functions.row(self.exchange.function, body)
    }

    /// Whether a column may show values of a profile, of this exchange or of another one in its batch with the same bus and kind.
    pub fn shows_profile(&self, column: &str) -> bool {
        column == PROFILE_COLUMN && self.batch.has_points()
    }

    /// Its row, with the profile of its unit.
    pub(super) fn whole_row(&self) -> Transaction {
        Transaction { points: self.run.points_of(self.exchange.unit).cloned(), ..self.transaction() }
    }

    /// Its row, without the profile of its unit.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of the row only what the caller reads is made.
    pub(super) fn transaction(&self) -> Transaction {
        self.run.transaction_of(self.exchange, self.at, self.run_start, self.timing)
    }

    /// Its row as columns read it.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `transaction`.
    pub(super) fn view<'v>(&'v self, row: &'v Transaction) -> TransactionView<'v> {
        TransactionView::of_exchange(row, self.function_row(), self.run.points_of(self.exchange.unit))
    }
}

/// The compact exchanges of a run.
pub(super) struct RunRefs<'a> {
    pub(super) batch: &'a Batch,
    pub(super) run: &'a ExchangeRun,
    pub(super) exchanges: &'a [Exchange],
    functions: &'a Functions,
}

impl<'a> RunRefs<'a> {
    pub(super) fn new(batch: &'a Batch, run: &'a ExchangeRun) -> Self {
        Self { batch, run, exchanges: run.exchanges.of(&batch.exchanges), functions: functions(batch) }
    }

    /// The exchange at this place of the run.
    #[inline]
    pub(super) fn at(&self, at: usize) -> ExchangeRef<'a> {
        let exchange = &self.exchanges[at];
        ExchangeRef {
            batch: self.batch,
            run: self.run,
            exchange,
            at,
            run_start: self.exchanges[0].start,
            timing: self.run.timing(&self.batch.packet_pairs, at),
            functions: self.functions,
        }
    }

    /// All of them.
    pub(super) fn all(&self) -> impl Iterator<Item = ExchangeRef<'a>> + '_ {
        (0..self.exchanges.len()).map(|at| self.at(at))
    }
}
