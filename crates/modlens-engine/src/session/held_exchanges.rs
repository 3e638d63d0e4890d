//! Compact exchanges with times that wait for older transactions, as rows do (`held_rows`).

use std::collections::VecDeque;

use crate::records::{Batch, Exchange, ExchangeRun, PacketPair, PacketsOfRun, Span};
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Compact exchanges, in the order of their numbers.
#[derive(Default)]
pub(crate) struct PendingExchanges {
    exchanges: Vec<Exchange>,
    pairs: Vec<PacketPair>,
    /// Those whose numbers, frames and bytes follow each other; their places are those in `exchanges` and `pairs`.
    runs: VecDeque<ExchangeRun>,
}

impl PendingExchanges {
    pub(super) fn len(&self) -> usize {
        self.exchanges.len()
    }

    /// The runs of these exchanges, each of one bus.
    pub(super) fn runs(&self) -> impl Iterator<Item = &ExchangeRun> {
        self.runs.iter()
    }

    /// Adds an exchange of this number, which is higher than those before. `start` is what a run needs that begins with it.
    #[inline]
    pub(crate) fn push(&mut self, exchange: Exchange, pair: PacketPair, start: &ExchangeStart) {
        let goes_on = self.runs.back_mut().zip(self.exchanges.last()).filter(|(run, last)| {
            let begins_at = last.start + u32::from(last.lengths[0]) + u32::from(last.lengths[1]);
            run.bus == start.bus
                && run.end() == start.number
                && run.frame + 2 * u64::from(run.exchanges.length) == start.frame
                && run.mode() == start.mode
                && run.packets.is_some_and(|packets| packets.recording_start == start.recording_start)
                && begins_at == exchange.start
        });
        if let Some((run, _)) = goes_on {
            run.exchanges.length += 1;
        } else {
            let first = self.exchanges.len() as u32;
            self.runs.push_back(ExchangeRun {
                bus: start.bus,
                number: start.number,
                frame: start.frame,
                offset: 0,
                exchanges: Span { start: first, length: 1 },
                packets: Some(PacketsOfRun { first, recording_start: start.recording_start, mode: start.mode }),
                points: None,
            });
        }
        self.exchanges.push(exchange);
        self.pairs.push(pair);
    }

    /// Adds the exchange that goes on right after the one added last: with the next number, frames and bytes of the same bus.
    #[inline]
    pub(crate) fn push_next(&mut self, exchange: Exchange, pair: PacketPair) {
        if let Some(run) = self.runs.back_mut() {
            run.exchanges.length += 1;
            self.exchanges.push(exchange);
            self.pairs.push(pair);
        }
    }

    /// Moves those whose number is less than `oldest` after the compact exchanges of a batch.
    pub(super) fn give_out(&mut self, oldest: u64, to: &mut Batch) {
        let (first, first_pair) = (to.exchanges.len() as u32, to.packet_pairs.len() as u32);
        let mut given = 0;
        while let Some(run) = self.runs.front_mut().filter(|run| run.number < oldest) {
            let ready = run.exchanges.length.min(u32::try_from(oldest - run.number).unwrap_or(u32::MAX));
            let packets = run.packets.map(|packets| PacketsOfRun { first: first_pair + given, ..packets });
            let exchanges = Span { start: first + given, length: ready };
            to.exchange_runs.push(ExchangeRun { exchanges, packets, ..run.clone() });
            given += ready;
            if ready < run.exchanges.length {
                run.number += u64::from(ready);
                run.frame += 2 * u64::from(ready);
                run.exchanges.length -= ready;
                break;
            }
            self.runs.pop_front();
        }
        if given == 0 {
            return;
        }
        // Where a batch has exchanges of lines without a clock, too, these are among the others.
        if first > first_pair {
            to.exchange_runs.sort_by_key(|run| run.number);
        }
        // As slices, which are copied in one block.
        let given = given as usize;
        to.exchanges.extend_from_slice(&self.exchanges[..given]);
        to.packet_pairs.extend_from_slice(&self.pairs[..given]);
        self.exchanges.drain(..given);
        self.pairs.drain(..given);
        let mut next = 0;
        for run in &mut self.runs {
            (run.exchanges.start, run.packets) = (next, run.packets.map(|packets| PacketsOfRun { first: next, ..packets }));
            next += run.exchanges.length;
        }
    }

    /// Copies the bytes of all of them from the arena of one batch to that of another, and lets them refer to the copies.
    pub(super) fn move_bytes(&mut self, from: &Batch, to: &mut Batch) {
        for run in &self.runs {
            let exchanges = &mut self.exchanges[run.exchanges.start as usize..][..run.exchanges.length as usize];
            let (Some(first), Some(last)) = (exchanges.first(), exchanges.last()) else { continue };
            let start = first.start;
            let length = last.start - start + u32::from(last.lengths[0]) + u32::from(last.lengths[1]);
            let copy = to.store(Span { start, length }.of(&from.arena)).start;
            for exchange in exchanges {
                exchange.start = exchange.start - start + copy;
            }
        }
    }
}

/// What a run begins with.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExchangeStart {
    /// Index of the bus.
    pub(crate) bus: u32,
    /// Number of the transaction.
    pub(crate) number: u64,
    /// Number of the request's frame.
    pub(crate) frame: u64,
    /// When the recording began.
    pub(crate) recording_start: Option<Ns>,
    /// Framing.
    pub(crate) mode: Mode,
}
