//! Compact exchanges as rows of the table of transactions, of which columns read what they show.

use modlens_engine::records::{Batch, Exchange, ExchangeRun, ExchangeTiming, PacketPair, Transaction};
use modlens_protocol::functions::{FunctionRow, Functions};

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
    pub(super) function_row: Option<&'a FunctionRow>,
}

/// A number that compact exchanges hold as a column shows it, so that nothing of the row has to be made for it.
#[derive(Clone, Copy, Debug)]
pub enum ExchangeNumber {
    /// That of the transaction.
    Txn,
    /// The unit.
    Unit,
    /// Address of the first register or bit that is read or written.
    Address,
    /// How many are read or written.
    Quantity,
    /// The confidence.
    Confidence,
    /// The identifier in the MBAP headers.
    MbapId,
    /// The number of the request's frame.
    RequestFrame,
    /// The number of the response's frame.
    ResponseFrame,
}

impl ExchangeNumber {
    /// The number that a column of transactions shows, where it has a value; `None` if it shows something else. What is written
    /// is left out: a request to read and write (function 23) has an address and a quantity for either.
    pub fn of_column(key: &str) -> Option<Self> {
        Some(match key {
            "txn" => Self::Txn,
            "unit" => Self::Unit,
            "address" => Self::Address,
            "quantity" => Self::Quantity,
            "confidence" => Self::Confidence,
            "mbap_id" => Self::MbapId,
            "request_frame" => Self::RequestFrame,
            "response_frame" => Self::ResponseFrame,
            _ => return None,
        })
    }
}

/// Packets of which all is known.
static KNOWN_TIMES: PacketPair = PacketPair { starts: [0, 0], gap: Some(0), response_time: Some(0), packet: 0, mbap_id: 0 };

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

    /// One of its numbers. Only for columns that have a value in it.
    #[inline]
    pub fn number(&self, of: ExchangeNumber) -> i64 {
        let frame = self.run.frame + 2 * self.at as u64;
        match of {
            ExchangeNumber::Txn => (self.run.number + self.at as u64) as i64,
            ExchangeNumber::Unit => i64::from(self.exchange.unit),
            ExchangeNumber::Address => i64::from(self.exchange.address),
            ExchangeNumber::Quantity => i64::from(self.exchange.quantity),
            ExchangeNumber::Confidence => i64::from(self.exchange.confidence),
            ExchangeNumber::MbapId => self.timing.map_or(0, |timing| i64::from(timing.pair.mbap_id)),
            ExchangeNumber::RequestFrame => frame as i64,
            ExchangeNumber::ResponseFrame => frame as i64 + 1,
        }
    }

    /// Its row.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Of the row only what the caller reads is made.
    pub(super) fn transaction(&self) -> Transaction {
        self.run.transaction_of(self.exchange, self.at, self.run_start, self.timing)
    }

    /// Its row as columns read it.
    #[inline(always)]
    #[allow(clippy::inline_always)] // See `transaction`.
    pub(super) fn view<'v>(&'v self, row: &'v Transaction) -> TransactionView<'v> {
        TransactionView::with_function(row, self.function_row)
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
        // The body of a request chooses the row for few functions only.
        let body = match self.functions.leading_bytes(exchange.function) {
            0 => &[],
            _ => exchange.request_body(&self.batch.arena, self.run.mode()),
        };
        ExchangeRef {
            batch: self.batch,
            run: self.run,
            exchange,
            at,
            run_start: self.exchanges[0].start,
            timing: self.run.timing(&self.batch.packet_pairs, at),
            function_row: self.functions.row(exchange.function, body),
        }
    }

    /// All of them.
    pub(super) fn all(&self) -> impl Iterator<Item = ExchangeRef<'a>> + '_ {
        (0..self.exchanges.len()).map(|at| self.at(at))
    }
}
