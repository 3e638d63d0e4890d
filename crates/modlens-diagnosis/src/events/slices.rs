//! Counters by time, the older the coarser.

use modlens_engine::records::{Batch, Connection};
use modlens_protocol::Ns;

use crate::contrast::{Contrast, OpenConnections};

/// A slice, and the time between two judgements.
pub const SLICE: Ns = 10_000_000_000;

/// So many slices at most are looked back at: nearly three hours.
const MOST: u64 = 1024;
/// A step of the clock greater than this, or any step back, begins a new history.
const LONGEST_PAUSE: Ns = 24 * 3600 * 1_000_000_000;

/// The last slices. Of each length, a power of two, there are two at most.
#[derive(Clone, Debug, Default)]
pub(super) struct Slices {
    /// How many slices were merged, and their counters; the oldest first.
    past: Vec<(u64, Contrast)>,
    open: Contrast,
    since: Option<Ns>,
    connections: OpenConnections,
}

impl Slices {
    /// Counts the rows of a batch.
    pub fn observe(&mut self, batch: &Batch, now: Ns) {
        self.since.get_or_insert(now);
        self.open.observe_after(batch, &self.connections);
    }

    /// Counts what has come of connections that are open.
    pub fn observe_open(&mut self, connections: &[Connection], now: Ns) {
        self.open.observe_open(connections, now, &mut self.connections);
    }

    /// Whether the open slice is over. Where the clock was set, all that was counted is forgotten.
    pub fn is_over(&mut self, before: Ns, now: Ns) -> bool {
        if now < before - SLICE || now - before > LONGEST_PAUSE {
            *self = Self::default();
        }
        self.since.is_some_and(|since| now - since >= SLICE)
    }

    /// Ends the open slice.
    pub fn close(&mut self, now: Ns) {
        self.past.push((1, std::mem::take(&mut self.open)));
        self.since = Some(now);
        let mut at = self.past.len();
        // The third of a length is one too many: the two older ones become one.
        while at >= 3 && self.past[at - 3].0 == self.past[at - 1].0 {
            let (length, newer) = self.past.remove(at - 2);
            self.past[at - 3].0 += length;
            self.past[at - 3].1.merge(newer);
            at -= 2;
        }
        while self.past.iter().map(|(length, _)| length).sum::<u64>() > MOST {
            self.past.remove(0);
        }
    }

    /// The counters of the last slice, the last two, and so on up to all, with the logarithm of the number of slices.
    pub fn windows(&self) -> impl Iterator<Item = (u32, Contrast)> + '_ {
        let mut window: Option<(u64, Contrast)> = None;
        let mut due = 1;
        self.past.iter().enumerate().rev().filter_map(move |(at, (length, counted))| {
            let mut all = counted.clone();
            let more = window.take().map_or(0, |(more, newer)| {
                all.merge(newer);
                more
            });
            let length = length + more;
            window = Some((length, all.clone()));
            (length >= due || at == 0).then(|| {
                due = length * 2;
                (length.ilog2(), all)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn older_slices_are_coarser_and_the_oldest_are_forgotten() {
        let mut slices = Slices::default();
        let lengths = |slices: &Slices| slices.past.iter().map(|(length, _)| *length).collect::<Vec<_>>();
        for now in 1..=7 {
            slices.close(now);
        }
        assert_eq!(lengths(&slices), [4, 2, 1]);
        for now in 8..10_000 {
            slices.close(now);
            assert!(lengths(&slices).windows(2).all(|pair| pair[0] >= pair[1]));
        }
        let all: u64 = lengths(&slices).iter().sum();
        assert!((MOST / 2..=MOST).contains(&all) && slices.past.len() <= 22);
    }
}
