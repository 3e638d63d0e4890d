//! Exchanges of a log with times that are matched in their lines (`line_pairs`), one after the other.

use crate::fast_path::rtu_exchange::{Answered, LastExchange};
use crate::framer::rtu::traffic_model::LearningRun;
use crate::session::exchanges::run::Run;
use modlens_readers::text::LogEntry;

/// A run of exchanges that are matched in their lines.
pub(crate) struct LineRun {
    /// Index of the bus.
    pub(super) bus: usize,
    pub(super) run: Run,
    /// What came before the run.
    pub(super) answered_before: Answered,
    pub(super) last: Option<LastExchange>,
    /// What the framer has still to learn of the run.
    pub(super) learning: LearningRun,
    /// A request whose response is still to come: its line, and how many bytes it has, which are the last ones of the arena.
    pub(super) request: Option<(LogEntry, usize)>,
}

/// How long lines take the general way before a run is tried again: to begin one, what waits has to be decided, which is cheaper
/// for many lines at once where none can begin.
#[derive(Default)]
pub(crate) struct LineTries {
    /// Runs since the last exchange that could not begin, or had none.
    failures: u32,
    /// Lines that came since the last try while others were undecided.
    lines: u32,
}

impl LineTries {
    /// Counts a line in front of which others are undecided; whether a run should be tried with it. After two failures it is
    /// tried after an odd number of lines, which is a request next time if it was a response.
    pub(super) fn is_due(&mut self) -> bool {
        self.lines += 1;
        let least = if self.failures < 2 { 1 } else { (1 << (self.failures - 2).min(6)) + 1 };
        self.lines >= least
    }

    pub(super) fn note_run(&mut self, exchanges: u64) {
        (self.failures, self.lines) = (if exchanges > 0 { 0 } else { self.failures + 1 }, 0);
    }
}
