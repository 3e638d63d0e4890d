//! Columns that take their values from many compact exchanges at once.

use crate::values::ColumnBuilder;
use modlens_tables::columns::{ExchangeChunk, ExchangeNumber, ExchangeRef, ReadLayout};

/// Gives a column the values of many compact exchanges at once.
pub(super) trait OfExchanges<T>: Send {
    /// Learns from an exchange of the next kind.
    fn learn(&mut self, exchange: &ExchangeRef<'_>);

    /// Forgets all kinds.
    fn forget_kinds(&mut self);

    /// Appends the items of these exchanges. `kinds` are the numbers of their kinds, `has_value` is 1 for each kind that has a
    /// value, else 0; which rows have one is left to the caller.
    fn push_items(&self, exchanges: &ExchangeChunk<'_>, kinds: &[u32], has_value: &[u8], to: &mut ColumnBuilder<T>);
}

/// Numbers of the exchanges; 0 where there is no value.
pub(super) struct Numbers(pub(super) ExchangeNumber);

impl OfExchanges<i64> for Numbers {
    fn learn(&mut self, _: &ExchangeRef<'_>) {}

    fn forget_kinds(&mut self) {}

    fn push_items(&self, exchanges: &ExchangeChunk<'_>, kinds: &[u32], has_value: &[u8], to: &mut ColumnBuilder<i64>) {
        let start = to.items.len();
        exchanges.numbers(self.0, &mut to.items);
        if has_value.contains(&0) {
            for (number, &kind) in to.items[start..].iter_mut().zip(kinds) {
                *number *= i64::from(has_value[kind as usize]);
            }
        }
    }
}

/// The registers or bits that were read.
#[derive(Default)]
pub(super) struct ReadValues {
    /// Where each kind has them.
    layouts: Vec<Option<ReadLayout>>,
}

impl OfExchanges<i32> for ReadValues {
    fn learn(&mut self, exchange: &ExchangeRef<'_>) {
        self.layouts.push(ReadLayout::of(exchange));
    }

    fn forget_kinds(&mut self) {
        self.layouts.clear();
    }

    fn push_items(&self, exchanges: &ExchangeChunk<'_>, kinds: &[u32], _: &[u8], to: &mut ColumnBuilder<i32>) {
        to.offsets.reserve(kinds.len());
        exchanges.each_read(&self.layouts, kinds, |read| to.push_read(read));
    }
}
