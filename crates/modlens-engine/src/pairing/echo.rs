//! Whether a request that appears twice is the echo of the local adapter or the master's retry.
//!
//! An echo comes much sooner than any retry: the clock decides as far as it is fine enough, else whether the line has shown
//! echo so far (`echo_share`). Where neither reports, nothing is claimed.

use crate::findings::{order, timing};
use crate::pairing::interval::interval;
use crate::pairing::timeouts::MIN_MASTER_TIMEOUT_NS;
use crate::pairing::Pairing;
use crate::transactions::transaction::{ObservedFrame, PendingTransaction};
use modlens_protocol::framing::{Mode, BROADCAST_UNIT};
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;
use modlens_readers::chunk::Side;

/// The echo of an adapter that receives its own transmission comes within this time: the adapter's own delay.
const MAX_ECHO_DELAY_NS: Ns = 3_000_000;

/// No echo comes as late as this by a fine clock, though its adapter holds bytes back for as long as the slowest ones (16 ms).
const LATEST_ECHO_NS: Ns = 20_000_000;

/// What a request is in relation to the one before it.
pub(super) enum SameRequest {
    /// The adapter's echo of the request of this transaction.
    Echo(u64),
    /// The same request again: either the echo or a retry, the evidence does not tell which.
    Ambiguous,
    /// A retry, or a different request.
    New,
}

impl Pairing {
    /// Whether a request is the adapter's echo of the one before it, on a serial line: of the newest open request, or of the
    /// last broadcast, which is forgotten then.
    pub(super) fn compare_with_open(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) -> SameRequest {
        if frame.mode == Mode::Tcp {
            return SameRequest::New;
        }
        if frame.unit() == BROADCAST_UNIT {
            let before = self.history.last_broadcast.take().filter(|before| before.is_repeated_by(frame));
            return before.map_or(SameRequest::New, |before| self.echo_or_retry(frame, before.end, before.txn));
        }
        let is_same = |open: &PendingTransaction| open.unit == frame.unit() && open.request.pdu() == frame.pdu();
        // An echo comes at once, with stray bytes before it at most: a request that has a damaged response or an exchange after
        // it is asked again.
        let comes_at_once = |open: &PendingTransaction| !open.response.is_present() && frame.number <= open.request.number + 2;
        let open = self.open.back().filter(|open| is_same(open) && !open.echo_seen && comes_at_once(open));
        let same = open.map(|open| (open.request.end, open.txn));
        if open.is_some_and(|open| (open.request.side, frame.side) == (Some(Side::Sent), Some(Side::Sent))) {
            // The program says that it sent both.
            return SameRequest::New;
        }
        if open.is_some_and(|open| (open.request.side, frame.side) == (Some(Side::Sent), Some(Side::Received))) {
            // The program has received what it sent itself, whenever it has printed that.
            let echo = same.map_or(SameRequest::New, |(_, txn)| SameRequest::Echo(txn));
            self.count_copies(true);
            self.mark_open(&echo, frame);
            return echo;
        }
        if !mirrors_request(functions, frame.pdu()) {
            self.count_copies(same.is_some_and(|(end, _)| !is_too_late_for_echo(self.read_lateness, interval(end, frame.start))));
        }
        let Some((end, txn)) = same else { return SameRequest::New };
        let same = self.echo_or_retry(frame, end, txn);
        self.mark_open(&same, frame);
        same
    }

    /// Counts a request whose response does not repeat it in the share of those that appear twice.
    fn count_copies(&mut self, is_second_copy: bool) {
        if is_second_copy {
            self.echoes.last_appeared_twice = Some(true);
        } else {
            self.echoes.add_request();
        }
    }

    /// Marks the newest open request, which `frame` repeats. If that is its echo, it gets the finding, and its response time
    /// counts from the end of the echo: from the last byte of the request, whichever copy of it that is. Where the evidence
    /// decides nothing, its silence will prove nothing either.
    fn mark_open(&mut self, same: &SameRequest, frame: &ObservedFrame<'_>) {
        let Some(open) = self.open.back_mut() else { return };
        match same {
            SameRequest::Echo(_) => {
                open.echo_seen = true;
                order::note_echo(open);
                open.request.end = frame.end.or(open.request.end);
            }
            SameRequest::Ambiguous => open.silence_is_inconclusive = true,
            SameRequest::New => {}
        }
    }

    /// Whether the same request again is an echo or a retry, `end` being the end of the first one: by the clock as far as
    /// it is fine enough, else by whether this line has shown echo so far.
    fn echo_or_retry(&self, frame: &ObservedFrame<'_>, end: Option<Ns>, txn: u64) -> SameRequest {
        // A clock of a second distinguishes an echo from a retry no better than none.
        let is_fine_enough = self.read_lateness < MIN_MASTER_TIMEOUT_NS;
        match (interval(end, frame.start).filter(|_| is_fine_enough), self.echoes.has_echo()) {
            (Some(pause), _) if self.read_lateness <= MAX_ECHO_DELAY_NS && comes_at_once(frame, pause) => SameRequest::Echo(txn),
            (Some(pause), Some(true))
                if pause < MIN_MASTER_TIMEOUT_NS && !is_too_late_for_echo(self.read_lateness, Some(pause)) =>
            {
                SameRequest::Echo(txn)
            }
            (Some(pause), _) if !self.is_before_timeout(pause) => SameRequest::New,
            (Some(_), _) | (None, None) => SameRequest::Ambiguous,
            (None, Some(true)) => SameRequest::Echo(txn),
            (None, Some(false)) => SameRequest::New,
        }
    }
}

/// Whether a request comes so soon after the same one, by a fine clock, that it can only be an echo: within an adapter's delay, or
/// sooner than two frames follow each other on this line, with no stray bytes between.
fn comes_at_once(frame: &ObservedFrame<'_>, pause: Ns) -> bool {
    let follows_directly = || frame.gap.is_some_and(|gap| gap >= pause);
    pause < MAX_ECHO_DELAY_NS || (timing::has_short_silence(frame.codes) && follows_directly())
}

/// Whether a clock whose reads are late by so little shows that so long after a request its echo does not come any more.
fn is_too_late_for_echo(read_lateness: Ns, pause: Option<Ns>) -> bool {
    read_lateness <= MAX_ECHO_DELAY_NS && pause.is_some_and(|pause| pause >= LATEST_ECHO_NS)
}

/// Whether the response to this request repeats it byte by byte, as that to function 6 does. Of functions without a row
/// nothing is known, and it may.
pub(super) fn mirrors_request(functions: &Functions, pdu: &[u8]) -> bool {
    pdu.split_first().and_then(|(&code, body)| functions.row(code, body)).is_none_or(|row| row.has_equal_layouts)
}
