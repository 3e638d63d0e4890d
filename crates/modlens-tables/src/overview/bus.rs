//! What happened over time on one bus: the series of its line, of its requests and of its registers.

use std::collections::BTreeMap;

use modlens_engine::records::{Batch, Bus, Exchange, ExchangeRun, Frame};
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use super::line::{p95_column, us, BusBucket, RequestBucket};
use super::registers::Registers;
use super::requests::{Requests, RequestsOfBus, MAX_REQUESTS};
use super::series::{Bucket, Range, Series};

/// The finest bucket of time is two to the power of this wide: a millisecond.
const TIME_SHIFT: u32 = 20;

/// By what a bus's series go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Axis {
    /// Time since 1970.
    Utc,
    /// Time since the beginning of the recording.
    Relative,
    /// The number of the transaction, where there is no clock.
    Transactions,
}

#[derive(Clone, Copy)]
pub(super) enum RowKind {
    Frame,
    Transaction,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct BusOverview {
    pub(super) name: String,
    pub(super) source: String,
    pub(super) settings: Option<LineSettings>,
    pub(super) axis: Axis,
    /// Where the last frame and the last transaction were, for rows without a time.
    pub(super) last: [i64; 2],
    pub(super) line: Series<BusBucket>,
    pub(super) requests: RequestsOfBus,
    pub(super) registers: Registers,
}

impl BusOverview {
    pub(super) fn new(row: &Bus, has_time: bool) -> Self {
        let axis = match row.clock {
            Clock::Utc if has_time => Axis::Utc,
            Clock::Relative if has_time => Axis::Relative,
            _ => Axis::Transactions,
        };
        Self {
            name: row.name.clone(),
            source: row.source.clone(),
            settings: row.line,
            axis,
            last: [0; 2],
            line: Series::new(axis.shift()),
            requests: RequestsOfBus::default(),
            registers: Registers::default(),
        }
    }

    /// Where a row is: by its time, or by its number where the bus has no clock. A row that has neither is where the last one
    /// was.
    #[inline]
    pub(super) fn place(&mut self, rows: RowKind, time: Option<Ns>, number: Option<u64>) -> i64 {
        let position = match self.axis {
            Axis::Transactions => number.map(|number| number as i64),
            _ => time,
        };
        let last = &mut self.last[rows as usize];
        *last = position.unwrap_or(*last);
        *last
    }

    /// The requests of one function to one unit; `None` if there is no room for them. `count` is how many there are of all buses.
    #[inline]
    pub(super) fn requests_of(&mut self, unit_and_function: (u8, u8), count: &mut usize) -> Option<&mut Requests> {
        let index = self.requests.find(unit_and_function).or_else(|| self.add_requests(unit_and_function, count))?;
        Some(self.requests.at(index))
    }

    #[cold]
    fn add_requests(&mut self, unit_and_function: (u8, u8), count: &mut usize) -> Option<usize> {
        (*count < MAX_REQUESTS).then(|| {
            *count += 1;
            self.requests.add(Requests::new(unit_and_function, self.axis.shift()))
        })
    }

    #[inline]
    pub(super) fn frame(&mut self, row: &Frame, most: usize) {
        let time = if self.axis == Axis::Utc { row.start } else { row.elapsed };
        let position = self.place(RowKind::Frame, time, row.txn);
        self.line.at(position, most).frame(row);
        self.busy(position, row.wire.length, most);
    }

    /// Adds the frames of compact exchanges.
    pub(super) fn compact_frames(&mut self, batch: &Batch, run: &ExchangeRun, most: usize) {
        let exchanges = run.exchanges.of(&batch.exchanges);
        self.each_bucket(RowKind::Frame, run.number, exchanges, most, BusBucket::good_frames);
        if self.axis == Axis::Transactions || self.settings.is_none() {
            return;
        }
        let position = self.last[RowKind::Frame as usize];
        for length in exchanges.iter().flat_map(|exchange| exchange.lengths) {
            self.busy(position, length.into(), most);
        }
    }

    /// Adds consecutive exchanges without times, the first of which has this number, to the buckets of the line: as many at a
    /// time as lie in one.
    pub(super) fn each_bucket(
        &mut self,
        rows: RowKind,
        number: u64,
        exchanges: &[Exchange],
        most: usize,
        add: impl Fn(&mut BusBucket, &[Exchange]),
    ) {
        let (mut number, mut rest) = (number, exchanges);
        while !rest.is_empty() {
            let position = self.place(rows, None, Some(number));
            // Room is made before it is known where the bucket ends: it may become wider.
            self.line.at(position, most);
            // Without numbers, all of them are where the last row was.
            let count = match self.axis {
                Axis::Transactions => rest.len().min((self.line.bucket_end(position) - position) as usize),
                _ => rest.len(),
            };
            let (own, others) = rest.split_at(count);
            add(self.line.at(position, most), own);
            self.place(rows, None, Some(number + count as u64 - 1));
            (number, rest) = (number + count as u64, others);
        }
    }

    /// Adds the time that a frame of this length takes, where there is a clock.
    #[inline]
    fn busy(&mut self, position: i64, length: u32, most: usize) {
        if let Some(line) = self.settings.filter(|_| self.axis != Axis::Transactions) {
            let busy = line.char_ns() * i64::from(length);
            let width = self.line.width();
            if position & (width - 1) <= width - busy {
                self.line.at(position, most).busy += busy;
            } else {
                self.add_busy(position, busy, most);
            }
        }
    }

    /// Shares the time that a frame took among the buckets that it lies in.
    #[cold]
    fn add_busy(&mut self, start: i64, busy: Ns, most: usize) {
        // The last bucket first: it may make all others wider.
        self.line.at(start + busy - 1, most);
        let width = self.line.width();
        let (mut from, end) = (start, start + busy);
        while from < end {
            let until = ((from & !(width - 1)) + width).min(end);
            self.line.at(from, most).busy += until - from;
            from = until;
        }
    }

    /// The 95th percentile of each unit's response times, all functions taken together.
    pub(super) fn units_json(&self, range: Range) -> Json {
        let mut units: BTreeMap<u8, Vec<RequestBucket>> = BTreeMap::new();
        for ((unit, _), counts) in self.requests.sorted() {
            let more = counts.series.cut_to(range);
            match units.get_mut(&unit) {
                Some(own) => own.iter_mut().zip(&more).for_each(|(own, more)| own.merge(more)),
                None => drop(units.insert(unit, more)),
            }
        }
        units.iter().map(|(unit, buckets)| json!({"unit": unit, "p95_us": p95_column(buckets)})).collect()
    }

    /// The range of the bus in buckets that are wide enough for all these series.
    pub(super) fn common(&self, series: impl Iterator<Item = Range>, most: usize) -> Range {
        self.line.range().into_iter().chain(series).reduce(Range::with).expect("the bus has rows").within(most)
    }
}

impl Axis {
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::Utc => "utc",
            Self::Relative => "relative",
            Self::Transactions => "transactions",
        }
    }

    pub(super) fn shift(self) -> u32 {
        match self {
            Self::Transactions => 0,
            _ => TIME_SHIFT,
        }
    }

    /// Where the buckets of a range begin, and how wide each is: in microseconds, or in transactions.
    pub(super) fn steps(self, range: Range) -> Json {
        let (start, step) = (range.first << range.shift, 1i64 << range.shift);
        let count = range.last - range.first + 1;
        match self {
            Self::Transactions => json!({"start": start, "step": step, "count": count}),
            _ => json!({"start": us(start), "step": us(step), "count": count}),
        }
    }
}
