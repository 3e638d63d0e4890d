//! Values that depend on the bus of a row.
#![allow(clippy::inline_always)]

use modlens_engine::records::{Batch, Bus, Network};
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use crate::columns::cell::Cell;
use crate::columns::column_value::{ColumnValue, Time, Us};

/// A bus by its index.
#[inline]
pub(super) fn bus(batch: &Batch, index: u32) -> &Bus {
    &batch.buses[index as usize]
}

/// A property of a TCP connection; null on a serial bus.
#[inline]
pub(super) fn network(batch: &Batch, index: u32, read: fn(&Network) -> Cell<'_>) -> Cell<'_> {
    bus(batch, index).network.as_ref().map_or(Cell::Null, read)
}

/// The time of a row as a cell; null if the clock of the bus is not set to UTC.
#[inline]
pub(super) fn time<'a>(batch: &Batch, index: u32, start: Option<Ns>) -> Cell<'a> {
    utc_time(batch, index, start).cell()
}

/// A duration as a cell.
#[inline]
pub(super) fn us<'a>(ns: Option<Ns>) -> Cell<'a> {
    ns.map(Us).cell()
}

/// A time of day, if the clock of the bus is set to UTC.
#[inline(always)]
pub(super) fn utc_time(batch: &Batch, index: u32, start: Option<Ns>) -> Option<Time> {
    start.filter(|_| bus(batch, index).clock == Clock::Utc).map(Time)
}
