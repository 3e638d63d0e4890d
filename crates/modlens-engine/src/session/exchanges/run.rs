//! Exchanges that the fast path emits one after the other: what is the same for all of them, and what is counted once.

use crate::records::Batch;
use crate::session::bus::BusState;
use crate::session::frame_timing::TimingConfig;
use modlens_protocol::Ns;

/// What one run of the fast path has emitted: the exchanges, and their bytes on all lines.
#[derive(Default)]
pub(super) struct BatchTotals {
    pub exchanges: u64,
    pub bytes: usize,
}

/// Where the last exchange of a run ends.
#[derive(Clone, Copy, Default)]
pub(super) struct ExchangeEnd {
    /// Index of the arena after its bytes.
    pub arena: usize,
    /// Its number.
    pub txn: u64,
}

impl ExchangeEnd {
    /// That of the exchange emitted last.
    #[inline]
    pub fn newest(batch: &Batch, next_txn: u64) -> Self {
        Self { arena: batch.arena.len(), txn: next_txn - 1 }
    }
}

/// What exchanges with times become.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Rows.
    Rows,
    /// Rows of frames, and compact transactions.
    CompactBesideFrames,
    /// Compact exchanges, without frames.
    Compact,
}

/// One run of the fast path over a bus: what stays the same in it, and what it has emitted so far.
pub(super) struct Run {
    /// How frames are timed, as it was at the beginning of the run.
    pub config: TimingConfig,
    /// Response times below this are left out of rows and statistics: the clock cannot measure them.
    pub min_measurable_ns: Ns,
    /// What its exchanges become.
    pub form: Form,
    /// What it has emitted.
    pub totals: BatchTotals,
}

impl Run {
    /// Returns a run over this bus. `line` is the index of the line whose clock counts.
    pub(super) fn new(state: &mut BusState, line: usize) -> Self {
        let config = state.timing_config(line);
        let min_measurable_ns = 2 * state.coarsest_resolution();
        Self { config, min_measurable_ns, form: Form::Rows, totals: BatchTotals::default() }
    }

    /// Returns whether frames of the bus have times.
    pub(super) fn has_clock(&self) -> bool {
        self.config.has_clock
    }

    /// This silence before a packet, if the clock can measure it.
    #[inline]
    pub(super) fn measurable_gap(&self, gap: Ns) -> Option<Ns> {
        (gap >= 2 * self.config.resolution && gap > 0).then_some(gap)
    }

    /// Returns the time in ns within which a response on a serial line has to come; endless without a clock.
    pub(super) fn request_timeout(&self, state: &BusState) -> Ns {
        if self.config.has_clock {
            state.pairing.request_timeout(false)
        } else {
            Ns::MAX
        }
    }
}
