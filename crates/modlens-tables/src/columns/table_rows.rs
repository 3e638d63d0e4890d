//! The rows of a table, one after the other: as rows, or as compact exchanges, of which whole rows are never made.

use std::ops::Range;

use modlens_engine::records::{Batch, Part, Transaction};

use crate::columns::cell::Cell;
use crate::columns::exchange_chunk::ExchangeChunk;
use crate::columns::exchange_ref::{ExchangeRef, RunRefs};
use crate::columns::exchange_value::PROFILE_COLUMN;
use crate::columns::reader::ColumnReader;
use crate::columns::sink::CellSink;
use crate::columns::table::{RowRef, Rows, Table};

/// A row of a table.
#[derive(Clone, Copy)]
pub enum TableRow<'a> {
    /// As a row.
    Whole(&'a RowRef<'a>),
    /// As a compact exchange.
    Compact(&'a ExchangeRef<'a>),
}

impl TableRow<'_> {
    /// Calls `with` for it as a row, which is made for that where it is compact.
    pub fn with_whole<T>(&self, with: impl FnOnce(&RowRef<'_>) -> T) -> T {
        match self {
            Self::Whole(row) => with(row),
            Self::Compact(exchange) => with(&RowRef::of_transaction(exchange.batch, &exchange.whole_row())),
        }
    }
}

/// Some rows of a table.
pub enum RowChunk<'a> {
    /// As rows.
    Whole(&'a [RowRef<'a>]),
    /// As compact exchanges.
    Compact(ExchangeChunk<'a>),
}

/// Rows that stand one after the other.
enum PartRefs<'a> {
    Whole(&'a [Transaction]),
    Compact(RunRefs<'a>),
}

impl PartRefs<'_> {
    /// How many are taken at a time.
    fn chunk_rows(&self) -> usize {
        match self {
            Self::Whole(_) => CHUNK_ROWS,
            Self::Compact(_) => CHUNK_EXCHANGES,
        }
    }
}

/// Says whether a column has a value, which is not made for that.
struct Probe(bool);

impl CellSink for Probe {
    #[inline(always)]
    #[allow(clippy::inline_always)] // Reduces the match to one arm in each caller.
    fn put_cell(&mut self, cell: Cell<'_>) {
        self.0 = !matches!(cell, Cell::Null);
    }
}

/// Whether a column has a value in this row.
fn is_value(row: &RowRef<'_>, reader: &ColumnReader<Probe>) -> bool {
    let mut probe = Probe(false);
    row.emit(reader, &mut probe);
    probe.0
}

/// Whether a column has a value in the row of a compact exchange.
fn is_exchange_value(exchange: &ExchangeRef<'_>, reader: &ColumnReader<Probe>) -> bool {
    let mut probe = Probe(false);
    reader.pass_exchanges(std::slice::from_ref(exchange), &mut probe);
    probe.0
}

fn refs<'a>(batch: &'a Batch, rows: &'a [Transaction]) -> Vec<RowRef<'a>> {
    rows.iter().map(|row| RowRef::of_transaction(batch, row)).collect()
}

/// Rows of a chunk: some twenty kilobytes.
const CHUNK_ROWS: usize = 64;

/// The same of compact exchanges, a multiple of 64, since the bits that say which of them have a value are written 64 at a time.
const CHUNK_EXCHANGES: usize = 256;

impl Table {
    /// Whether a column has a value in any row.
    pub fn has_value(&self, column: usize) -> bool {
        let reader = self.kind.reader(column);
        if !matches!(self.rows, Rows::AllAndCompact(_)) {
            return (0..self.len()).any(|row| is_value(&self.row(row), &reader));
        }
        let batch = &*self.batch;
        batch.transactions.iter().any(|row| is_value(&RowRef::of_transaction(batch, row), &reader))
            || self.has_value_in_exchange(column)
    }

    /// Whether a column has a value in the row of any compact exchange.
    fn has_value_in_exchange(&self, column: usize) -> bool {
        let (batch, reader) = (&*self.batch, self.kind.reader(column));
        self.has_compact_value(column)
            && batch
                .exchange_runs
                .iter()
                .map(|run| RunRefs::new(batch, run))
                .any(|run| run.all().any(|one| is_exchange_value(&one, &reader)))
    }

    /// Whether a column may have a value in the row of any compact exchange: that follows from the bus and the kind, but for
    /// times, which may be unknown, and for values of a profile.
    pub fn has_compact_value(&self, column: usize) -> bool {
        let (batch, reader) = (&*self.batch, self.kind.reader(column));
        if self.shows_profile(column) {
            return true;
        }
        batch.exchange_kinds().iter().any(|&(run, at)| {
            let exchange = RunRefs::new(batch, &batch.exchange_runs[run]).at(at);
            is_exchange_value(&exchange.with_known_times(), &reader)
        })
    }

    /// Whether a column has the same value, or none, in the rows of all compact exchanges with the bus and the kind of this one.
    pub fn is_exchange_constant(&self, column: usize, exchange: &ExchangeRef<'_>) -> bool {
        self.kind.is_constant_per_exchange_kind(column)
            || !(self.shows_profile(column) || is_exchange_value(&exchange.with_known_times(), &self.kind.reader(column)))
    }

    /// Whether a column shows values of profiles, and there are compact exchanges to which one applies: which of them have such a
    /// value depends on unit and address.
    fn shows_profile(&self, column: usize) -> bool {
        self.kind.columns()[column].key == PROFILE_COLUMN && self.batch.has_points()
    }

    /// Calls `each` for some rows, one after the other, until it returns false; gives the index of the row after the last one.
    pub fn each_row(&self, rows: Range<usize>, mut each: impl FnMut(TableRow<'_>) -> bool) -> usize {
        if !matches!(self.rows, Rows::AllAndCompact(_)) {
            let stops_at = rows.clone().find(|&row| !each(TableRow::Whole(&self.row(row))));
            return stops_at.map_or(rows.end, |row| row + 1);
        }
        let batch = &*self.batch;
        for (own, part) in self.parts(&rows) {
            for row in rows.start.max(own.start)..rows.end.min(own.end) {
                let at = row - own.start;
                let goes_on = match &part {
                    PartRefs::Whole(transactions) => each(TableRow::Whole(&RowRef::of_transaction(batch, &transactions[at]))),
                    PartRefs::Compact(run) => each(TableRow::Compact(&run.at(at))),
                };
                if !goes_on {
                    return row + 1;
                }
            }
        }
        rows.end
    }

    /// Calls `each` for chunks of at most `CHUNK_ROWS` rows, or `CHUNK_EXCHANGES` compact exchanges.
    pub fn each_chunk(&self, rows: Range<usize>, mut each: impl FnMut(RowChunk<'_>)) {
        if !matches!(self.rows, Rows::AllAndCompact(_)) {
            let mut next = rows.start;
            while next < rows.end {
                let end = rows.end.min(next + CHUNK_ROWS);
                each(RowChunk::Whole(&(next..end).map(|row| self.row(row)).collect::<Vec<_>>()));
                next = end;
            }
            return;
        }
        let batch = &*self.batch;
        for (own, part) in self.parts(&rows) {
            let mut next = rows.start.max(own.start) - own.start;
            let end = rows.end.min(own.end).saturating_sub(own.start);
            while next < end {
                let chunk = next..end.min(next + part.chunk_rows());
                next = chunk.end;
                match &part {
                    PartRefs::Whole(transactions) => each(RowChunk::Whole(&refs(batch, &transactions[chunk]))),
                    PartRefs::Compact(run) => each(RowChunk::Compact(ExchangeChunk::new(run, chunk))),
                }
            }
        }
    }

    /// The parts of a batch with compact exchanges that have some of these rows, each with the indices of its rows.
    fn parts(&self, rows: &Range<usize>) -> impl Iterator<Item = (Range<usize>, PartRefs<'_>)> {
        let (batch, Range { start, end }) = (&*self.batch, rows.clone());
        let (begin, parts) = batch.transaction_parts_from(start);
        let with_places = parts.scan(begin, |next, part| {
            let first = *next;
            *next += match part {
                Part::Rows(rows) => rows.len(),
                Part::Compact(run) => run.exchanges.length as usize,
            };
            Some((first..*next, part))
        });
        with_places.skip_while(move |(own, _)| own.end <= start).take_while(move |(own, _)| own.start < end).map(
            move |(own, part)| match part {
                Part::Rows(rows) => (own, PartRefs::Whole(rows)),
                Part::Compact(run) => (own, PartRefs::Compact(RunRefs::new(batch, run))),
            },
        )
    }
}
