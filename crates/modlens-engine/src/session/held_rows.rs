//! Rows that wait for older ones, and how they get into the order of their numbers.

use std::collections::VecDeque;

use crate::records::{Batch, Span, Transaction};
use crate::session::held_exchanges::PendingExchanges;

/// Rows of transactions. In a recording they wait here for older transactions that are still open.
#[derive(Default)]
pub(crate) struct PendingRows {
    /// Those that came in the order of their numbers; in a live session all of them.
    rows: VecDeque<Transaction>,
    /// Those that are older than others that came before. A request without a response is known as such when the next ones are.
    late: Vec<Transaction>,
    /// Those that are compact exchanges with times.
    pub(crate) exchanges: PendingExchanges,
    /// Rows are returned as they come.
    live: bool,
}

impl PendingRows {
    pub(super) fn new(live: bool) -> Self {
        Self { live, ..Self::default() }
    }

    pub(super) fn len(&self) -> usize {
        self.rows.len() + self.late.len() + self.exchanges.len()
    }

    /// The buses of all of them, each as often as it comes.
    pub(super) fn buses(&self) -> impl Iterator<Item = usize> + '_ {
        let of_rows = self.rows.iter().chain(&self.late).map(|row| row.bus);
        of_rows.chain(self.exchanges.runs().map(|run| run.bus)).map(|bus| bus as usize)
    }

    /// Copies the bytes and findings of all of them from one batch to the next, and lets the rows refer to the copies. A PDU that
    /// is a part of the bytes on the wire stays one.
    pub(super) fn move_bytes(&mut self, from: &Batch, to: &mut Batch) {
        self.exchanges.move_bytes(from, to);
        for row in self.rows.iter_mut().chain(&mut self.late) {
            row.findings = to.store_findings(row.findings.of(&from.codes));
            for frame in [&mut row.request, &mut row.response] {
                let inside = frame.pdu.start.wrapping_sub(frame.wire.start);
                let wire = to.store(frame.wire.of(&from.arena));
                frame.pdu = if inside < frame.wire.length.max(1) {
                    Span { start: wire.start + inside, length: frame.pdu.length }
                } else {
                    to.store(frame.pdu.of(&from.arena))
                };
                frame.wire = wire;
            }
        }
    }

    /// Adds a row.
    #[inline(always)]
    #[allow(clippy::inline_always)] // A row is large, and the caller makes it in its place.
    pub(crate) fn push(&mut self, row: Transaction) {
        if !self.live && self.rows.back().is_some_and(|last| last.number > row.number) {
            self.late.push(row);
        } else {
            self.rows.push_back(row);
        }
    }

    /// Moves the rows whose number is less than `oldest` after those in the batch; in a live session all of them.
    ///
    /// Each late row is put into its place on this way. To put it there before would move all that have waited for it.
    pub(super) fn give_out(&mut self, oldest: u64, batch: &mut Batch) {
        self.exchanges.give_out(oldest, batch);
        let to = &mut batch.transactions;
        if self.late.is_empty() && to.is_empty() && self.rows.back().is_none_or(|last| self.live || last.number < oldest) {
            *to = std::mem::replace(&mut self.rows, std::mem::take(to).into()).into();
            return;
        }
        self.late.sort_by_key(|row| row.number);
        let ready = self.late.partition_point(|row| row.number < oldest);
        for late in self.late.drain(..ready) {
            let place = self.rows.partition_point(|row| row.number <= late.number);
            to.extend(self.rows.drain(..place));
            to.push(late);
        }
        let ready = if self.live { self.rows.len() } else { self.rows.partition_point(|row| row.number < oldest) };
        to.extend(self.rows.drain(..ready));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::records::{Exchange, ExchangeRun, OptionalNs, PacketPair};
    use crate::session::held_exchanges::ExchangeStart;
    use modlens_protocol::framing::Mode;

    const EXCHANGE: Exchange =
        Exchange { start: 0, lengths: [12, 11], address: 0, quantity: 1, unit: 1, function: 3, confidence: 0, exception: 0 };
    const PAIR: PacketPair =
        PacketPair { starts: [0, 1], gap: OptionalNs::UNKNOWN, response_time: OptionalNs::UNKNOWN, packet: 1, mbap_id: 0 };

    fn row(number: u64) -> Transaction {
        let exchanges = Span { start: 0, length: 1 };
        ExchangeRun { bus: 0, number, frame: 1, offset: 0, exchanges, packets: None, points: None }.transaction(
            &[EXCHANGE],
            &[],
            0,
        )
    }

    fn push(held: &mut PendingRows, number: u64, is_compact: bool) {
        if is_compact {
            let start = ExchangeStart {
                bus: number as u32 % 3 / 2,
                number,
                frame: 2 * number,
                recording_start: Some(0),
                mode: Mode::Tcp,
            };
            held.exchanges.push(
                Exchange { start: 23 * number as u32, ..EXCHANGE },
                PacketPair { packet: number, ..PAIR },
                &start,
            );
        } else {
            held.push(row(number));
        }
    }

    /// The numbers in a batch, of which each compact exchange has to be its own.
    fn numbers(batch: &Batch) -> Vec<u64> {
        let is_own =
            |row: &&Transaction| row.mbap_id.is_none() || (row.origin == row.number && row.request.frame == 2 * row.number);
        let rows = batch.all_transactions();
        assert_eq!(rows.iter().find(|row| !is_own(row)).map(|row| row.number), None);
        assert!(rows.iter().all(|row| row.mbap_id.is_none() || u64::from(row.request.wire.start) == 23 * row.number));
        rows.iter().map(|row| row.number).collect()
    }

    proptest! {
        /// Each transaction comes so many places later than its number says, those in time perhaps compact; what is older than
        /// all that are still to come, or some of it, is returned now and then.
        #[test]
        fn rows_are_given_out_as_a_sort_would_give_them(
            delays in prop::collection::vec((prop_oneof![3 => Just(0usize), 1 => 0usize..40], any::<bool>()), 1..120),
            takes in prop::collection::vec((any::<prop::sample::Index>(), 0u64..20), 0..8),
        ) {
            let mut order: Vec<(usize, u64)> = delays.iter().zip(0..).map(|((delay, _), number)| (number as usize + delay, number)).collect();
            order.sort_unstable();
            let takes: Vec<(usize, u64)> = takes.iter().map(|(at, less)| (at.index(order.len()), *less)).collect();
            let (mut held, mut given, mut least) = (PendingRows::new(false), Vec::new(), 0);
            for (at, &(_, number)) in order.iter().enumerate() {
                let (delay, is_compact) = delays[number as usize];
                push(&mut held, number, is_compact && delay == 0);
                let to_come = order[at + 1..].iter().map(|(_, number)| *number).min().unwrap_or(order.len() as u64);
                for (_, less) in takes.iter().filter(|(when, _)| *when == at) {
                    least = to_come.saturating_sub(*less).max(least);
                    let mut batch = Batch::default();
                    held.give_out(least, &mut batch);
                    given.extend(numbers(&batch));
                    prop_assert_eq!(given.len() + held.len(), at + 1);
                    prop_assert_eq!(&given, &(0..least).collect::<Vec<_>>());
                }
            }
            let mut batch = Batch::default();
            held.give_out(u64::MAX, &mut batch);
            given.extend(numbers(&batch));
            prop_assert_eq!(given, (0..order.len() as u64).collect::<Vec<_>>());
            prop_assert_eq!(held.len(), 0);
        }

        #[test]
        fn a_live_session_gives_rows_out_as_they_come(numbers in prop::collection::vec(0u64..50, 0..60)) {
            let mut held = PendingRows::new(true);
            for &number in &numbers {
                push(&mut held, number, false);
            }
            let mut batch = Batch::default();
            held.give_out(7, &mut batch);
            prop_assert_eq!(batch.transactions.iter().map(|row| row.number).collect::<Vec<_>>(), numbers);
        }
    }
}
