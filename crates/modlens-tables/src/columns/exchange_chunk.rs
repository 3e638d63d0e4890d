//! Compact exchanges that stand one after the other, of which a writer of columns takes a value from each at once.

use std::ops::Range;

use modlens_engine::records::Exchange;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Operation;

use crate::columns::exchange_ref::{ExchangeRef, RunRefs};
use crate::columns::exchange_value::ExchangeNumber;

/// The registers or bits that an exchange has read.
#[derive(Clone, Copy, Debug)]
pub struct ReadData<'a> {
    /// How many there are.
    pub count: usize,
    /// Whether they are bits, packed with the least significant first, or registers of two bytes each.
    pub are_bits: bool,
    /// Their bytes, and whatever follows them in memory: who reads eight registers at a time may read beyond the last.
    pub from: &'a [u8],
}

/// Where the responses of a kind of exchanges have what was read.
#[derive(Clone, Copy, Debug)]
pub struct ReadLayout {
    /// Bytes of the response in front of it.
    before: u32,
    /// Bytes of the response in front of it and after it.
    around: u32,
    are_bits: bool,
    /// The request says how many bits there are; else there are those of whole bytes.
    is_counted: bool,
}

impl ReadLayout {
    /// That of the kind of this exchange; `None` if nothing was read. See `TransactionView::read_data`.
    pub fn of(exchange: &ExchangeRef<'_>) -> Option<Self> {
        let row = exchange.function_row().filter(|_| exchange.exchange.exception == 0)?;
        let (at, are_bits) = row.offsets.response_block?;
        let [before_pdu, behind_pdu] = Exchange::around_pdu(exchange.run.mode());
        let before = before_pdu + 1 + at as u32;
        let is_read = matches!(row.operation, Operation::Read | Operation::ReadWrite);
        let is_counted = is_read && row.offsets.address.is_some() && row.offsets.quantity.is_some();
        Some(Self { before, around: before + behind_pdu, are_bits, is_counted })
    }

    /// What this exchange has read.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A few instructions for each exchange.
    fn read<'a>(self, exchange: &Exchange, arena: &'a [u8]) -> ReadData<'a> {
        let [request, response] = exchange.lengths.map(u32::from);
        let from = &arena[(exchange.start + request + self.before) as usize..];
        let bytes = response.saturating_sub(self.around) as usize;
        let count = match (self.are_bits, self.is_counted) {
            (false, _) => bytes / 2,
            (true, false) => 8 * bytes,
            (true, true) => usize::from(exchange.quantity).min(8 * bytes),
        };
        ReadData { count, are_bits: self.are_bits, from }
    }
}

/// Some compact exchanges of a run.
pub struct ExchangeChunk<'a> {
    run: &'a RunRefs<'a>,
    /// Their places in the run.
    places: Range<usize>,
}

impl<'a> ExchangeChunk<'a> {
    /// Kinds of exchanges (`kinds`).
    pub const KINDS: usize = Exchange::KINDS;

    pub(super) fn new(run: &'a RunRefs<'a>, places: Range<usize>) -> Self {
        Self { run, places }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Index of their bus, and the framing. Exchanges that have both and a kind in common have values in the same columns.
    pub fn bus_and_mode(&self) -> (u32, Mode) {
        (self.run.run.bus, self.run.run.mode())
    }

    /// Function and exception code of each as one number (`Exchange::kind`).
    pub fn kinds(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.exchanges().iter().map(Exchange::kind)
    }

    /// The exchange at this place of the chunk.
    pub fn at(&self, place: usize) -> ExchangeRef<'a> {
        self.run.at(self.places.start + place)
    }

    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = ExchangeRef<'a>> + '_ {
        self.places.clone().map(|place| self.run.at(place))
    }

    /// Appends a number of each. Where a column has no value in it, the number means nothing.
    pub fn numbers(&self, of: ExchangeNumber, to: &mut Vec<i64>) {
        let (run, exchanges, first) = (self.run.run, self.exchanges(), self.places.start as i64);
        let counted = |from: u64, step: i64| {
            let from = from as i64 + first * step;
            (0..exchanges.len() as i64).map(move |at| from + at * step)
        };
        match of {
            ExchangeNumber::Txn => to.extend(counted(run.number, 1)),
            ExchangeNumber::RequestFrame => to.extend(counted(run.frame, 2)),
            ExchangeNumber::ResponseFrame => to.extend(counted(run.frame + 1, 2)),
            ExchangeNumber::Unit => to.extend(exchanges.iter().map(|exchange| i64::from(exchange.unit))),
            ExchangeNumber::Address => to.extend(exchanges.iter().map(|exchange| i64::from(exchange.address))),
            ExchangeNumber::Quantity => to.extend(exchanges.iter().map(|exchange| i64::from(exchange.quantity))),
            ExchangeNumber::Confidence => to.extend(exchanges.iter().map(|exchange| i64::from(exchange.confidence))),
            ExchangeNumber::MbapId | ExchangeNumber::Origin => {
                to.extend(self.all().map(|exchange| exchange.numbers()[of as usize] as i64));
            }
        }
    }

    /// Calls `each` for what each has read, as the column `data` shows it. `layouts` has that of each kind, of which `kinds` are the
    /// indices for these exchanges.
    pub fn each_read(&self, layouts: &[Option<ReadLayout>], kinds: &[u32], mut each: impl FnMut(Option<ReadData<'a>>)) {
        let arena = &self.run.batch.arena;
        for (exchange, &kind) in self.exchanges().iter().zip(kinds) {
            each(layouts[kind as usize].map(|layout| layout.read(exchange, arena)));
        }
    }

    fn exchanges(&self) -> &'a [Exchange] {
        &self.run.exchanges[self.places.clone()]
    }
}
