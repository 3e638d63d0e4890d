//! The counters of TCP connections: who was let in, for how long, and in which framing the two sides speak.

use modlens_engine::records::{Connection, End};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use super::displaced::Displaced;
use super::sample::Sample;
use super::tally::{mix_bytes, Place, Tally};
use super::unserved::{is_ignored, LockedOut, Unserved, IN_VAIN};
use modlens_engine::durations::Durations;

/// Clients that are counted one by one.
const MAX_CLIENTS: usize = 256;

/// A connection with so few requests is one for each request.
const FEW_REQUESTS: u64 = 2;

/// The connections to one server.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Connections {
    /// Attempts that were refused while another connection was served, or closed by the server before anything was asked.
    pub turned_away: Tally,
    /// Attempts that were refused while no other connection was served.
    pub down: Tally,
    /// Connections of which no request was answered, while another one was served.
    pub unserved: Tally,
    /// Requests that were not served.
    pub in_vain: Unserved,
    /// When clients were kept out.
    pub kept_out: LockedOut,
    /// Connections that were closed after one or two requests.
    pub short: Tally,
    /// Connections that the server closed though requests had been answered.
    pub closed_by_server: Tally,
    /// Their idle times before.
    pub idle: Durations,
    /// Those that had to give way to another one.
    pub displaced: Displaced,
    /// Connections whose first request was not answered, of those with answers.
    pub first_lost: Tally,
    /// Answers that the client took for those of the next request.
    pub lockstep: u64,
    /// When the first of these came.
    pub lockstep_since: Option<Place>,
    /// When the last one came.
    pub lockstep_until: Option<Place>,
    /// Answers since then.
    pub answers_in_step: u64,
    /// Connections with answers that begin before one with answers is over.
    pub side_by_side: u64,
    /// When the last connection with answers is over; never where it is open at the end.
    last_closed: Option<Ns>,
    /// Requests that were answered.
    pub answered: u64,
    /// Answers, those to no request among them.
    pub answers: u64,
    /// By client.
    pub clients: Sample<String, ClientCounts, MAX_CLIENTS>,
}

/// The connections of one client.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClientCounts {
    /// Attempts that were turned away.
    pub turned_away: Tally,
    /// Connections on which the two sides write in different framings, or requests in one without any answer.
    pub mismatched: Tally,
    /// Requests on these.
    pub mismatched_requests: u64,
    /// Framing of its requests there.
    pub framing: Option<&'static str>,
    /// Framing of the answers there.
    pub other_framing: Option<&'static str>,
    /// Requests.
    pub requests: u64,
    /// Those that write.
    pub writes: u64,
    /// Answers.
    pub answered: u64,
    /// From the beginning of the first connection with requests to the end of the last one; without end where one is still open.
    pub span: Option<(Ns, Ns)>,
    /// Its connections that are over, those that only write and all others: the requests, and from the beginning of the first to the
    /// end of the last one.
    pub kinds: [(u64, Option<(Ns, Ns)>); 2],
    /// One of each kind was open at the same time: two programs of one computer.
    pub has_two_programs: bool,
}

/// What has been counted already of a connection that is still open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    requests: u64,
    writes: u64,
    answered: u64,
    answers: u64,
    lockstep: u64,
    is_unserved: bool,
    in_vain: u64,
}

impl Counted {
    /// All that has come so far of a connection that is still open.
    pub fn of_open(seen: &Connection, now: Ns) -> Self {
        let has_waited = seen.begun.is_some_and(|begun| now - begun >= IN_VAIN);
        let is_unserved = has_waited && seen.answered == 0 && seen.is_beside_answered && !is_ignored(seen);
        let in_vain = if is_unserved { seen.requests } else { 0 };
        Self { is_unserved, in_vain, ..Self::of(seen) }
    }

    /// All that has come of a connection.
    fn of(seen: &Connection) -> Self {
        let (requests, answered, answers, lockstep) = (seen.requests, seen.answered, seen.answers, seen.lockstep);
        Self { requests, writes: seen.writes, answered, answers, lockstep, is_unserved: false, in_vain: 0 }
    }

    /// What has come since.
    fn until(self, now: Self) -> Self {
        Self {
            requests: now.requests.saturating_sub(self.requests),
            writes: now.writes.saturating_sub(self.writes),
            answered: now.answered.saturating_sub(self.answered),
            answers: now.answers.saturating_sub(self.answers),
            lockstep: now.lockstep.saturating_sub(self.lockstep),
            is_unserved: now.is_unserved && !self.is_unserved,
            in_vain: now.in_vain.saturating_sub(self.in_vain),
        }
    }
}

/// A server that has no room closes at once; one that closes later has waited for a request in vain.
const AT_ONCE: Ns = 1_000_000_000;

/// Whether a connection was open for a while.
fn is_idle(seen: &Connection) -> bool {
    seen.opened.zip(seen.closed).is_some_and(|(opened, closed)| closed - opened > AT_ONCE)
}

impl Connections {
    /// Counts a connection that is over. What was counted while it was open is not counted again.
    pub(super) fn count(&mut self, seen: &Connection, before: Counted) {
        // A connection is no transaction, so it has no number among the examples.
        let place = Place { number: 0, elapsed: None, time: seen.opened.or(seen.begun) };
        let by_server = seen.closed_by == Some(End::Server);
        let is_unanswered = seen.answered == 0 && seen.is_beside_answered;
        // The server had ended it when the first request came.
        let is_closed_first = is_unanswered && by_server && seen.idle == Some(0);
        let is_down = seen.is_refused && !seen.is_beside_answered;
        let turned_away =
            (seen.is_refused && !is_down) || (seen.requests == 0 && by_server && !is_down && !is_idle(seen)) || is_closed_first;
        self.down.count(is_down, place);
        self.turned_away.count(turned_away, place);
        let is_unserved = is_unanswered && seen.requests > 0 && !turned_away && !is_ignored(seen);
        // Where the others asked nothing in its time, nothing says that it was not served.
        let is_open = seen.requests > 0 && seen.answered == 0 && !is_unserved && !turned_away;
        if !before.is_unserved && !is_open {
            self.unserved.count(is_unserved, place);
        }
        self.displaced.count(seen, by_server, place);
        let in_vain = self.in_vain.of(seen);
        let new = before.until(Counted { in_vain, ..Counted::of(seen) });
        self.in_vain.count(seen, (new.requests, new.in_vain), place);
        self.count_kept_out(seen, turned_away || is_unserved || in_vain > 0, place);
        self.progress(seen, new, place);
        if seen.requests > 0 {
            // The first and the last one may be cut by the recording.
            self.short.count(seen.requests <= FEW_REQUESTS && seen.closed.is_some() && seen.opened.is_some(), place);
        }
        if seen.requests > 0 || (by_server && is_idle(seen)) {
            self.closed_by_server.count(by_server, place);
            if let (true, Some(idle)) = (by_server, seen.idle) {
                self.idle.add(idle);
            }
        }
        if seen.answered > 0 {
            self.side_by_side += u64::from(seen.begun.zip(self.last_closed).is_some_and(|(begun, closed)| begun < closed));
            self.last_closed = self.last_closed.max(Some(seen.closed.unwrap_or(Ns::MAX)));
        }
        if seen.answered > 0 && seen.opened.is_some() {
            self.first_lost.count(seen.first_status == Some(Status::NoResponse), place);
        }
        if let Some(client) = self.clients.entry(mix_bytes(seen.client.as_bytes()), seen.client.clone()) {
            client.turned_away.count(turned_away, place);
            client.count_kind(seen);
        }
    }

    /// Counts whether a connection keeps its client out, and for how long.
    fn count_kept_out(&mut self, seen: &Connection, is_kept_out: bool, place: Place) {
        if is_kept_out {
            let until = seen.first_wait.answered.or(seen.closed).or(seen.beside_until).or(place.time);
            self.kept_out.fail(&seen.client, place, Place { time: until, ..place });
        }
        if seen.answered > 0 {
            self.kept_out.serve(&seen.client);
        }
    }

    /// Counts what has come of a connection that is still open.
    pub(super) fn count_open(&mut self, seen: &Connection, before: Counted, now: Ns) {
        let place = Place { number: 0, elapsed: None, time: Some(now) };
        let new = before.until(Counted::of_open(seen, now));
        if new.is_unserved {
            self.unserved.count(true, place);
            self.count_kept_out(seen, true, place);
        }
        self.in_vain.count(seen, (new.requests, new.in_vain), place);
        self.progress(seen, new, place);
    }

    /// Counts what has come of a connection since it was last looked at.
    fn progress(&mut self, seen: &Connection, new: Counted, place: Place) {
        self.answered += new.answered;
        self.answers += new.answers;
        self.answers_in_step += new.answers;
        if new.lockstep > 0 {
            let (last, answers) = seen.lockstep_until;
            self.lockstep += new.lockstep;
            self.lockstep_since.get_or_insert(Place { time: seen.lockstep_since.or(place.time), ..place });
            self.lockstep_until = Some(Place { time: last.or(place.time), ..place });
            self.answers_in_step = seen.answers - answers;
        }
        if let Some(client) = self.clients.entry(mix_bytes(seen.client.as_bytes()), seen.client.clone()) {
            client.count(seen, new, place);
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.turned_away.merge(&later.turned_away);
        self.down.merge(&later.down);
        self.unserved.merge(&later.unserved);
        self.in_vain.merge(&later.in_vain);
        self.kept_out.merge(&later.kept_out);
        self.short.merge(&later.short);
        self.closed_by_server.merge(&later.closed_by_server);
        self.idle.merge(&later.idle);
        self.displaced.merge(&later.displaced);
        self.side_by_side += later.side_by_side;
        self.last_closed = self.last_closed.max(later.last_closed);
        self.first_lost.merge(&later.first_lost);
        self.lockstep += later.lockstep;
        self.lockstep_since = self.lockstep_since.or(later.lockstep_since);
        self.lockstep_until = later.lockstep_until.or(self.lockstep_until);
        let in_step = if later.lockstep > 0 { 0 } else { self.answers_in_step };
        self.answers_in_step = in_step + later.answers_in_step;
        self.answered += later.answered;
        self.answers += later.answers;
        self.clients.merge(later.clients.clone(), ClientCounts::merge);
    }
}

impl ClientCounts {
    fn count(&mut self, seen: &Connection, new: Counted, place: Place) {
        self.requests += new.requests;
        self.writes += new.writes;
        self.answered += new.answered;
        if new.requests == 0 {
            return;
        }
        self.stretch(seen.begun.or(seen.opened).map(|begun| (begun, seen.closed.unwrap_or(Ns::MAX))));
        // A client that speaks one framing drops what comes in another, though it is reported here as the answer that it is.
        let differ = seen.client_framing.zip(seen.server_framing).is_some_and(|(client, server)| client != server);
        let mismatched = differ || is_ignored(seen);
        self.mismatched.count(mismatched, place);
        if mismatched {
            self.mismatched_requests += new.requests;
            self.framing = self.framing.or(seen.client_framing);
            self.other_framing = self.other_framing.or(seen.server_framing);
        }
    }

    /// Counts what a connection was for. Connections come in the order in which they begin.
    fn count_kind(&mut self, seen: &Connection) {
        let Some(begun) = seen.begun.or(seen.opened).filter(|_| seen.requests > 0) else { return };
        let kind = usize::from(seen.writes < seen.requests);
        let (_, other) = self.kinds[1 - kind];
        self.has_two_programs |= other.is_some_and(|(_, until)| until > begun);
        let (requests, span) = &mut self.kinds[kind];
        *requests += seen.requests;
        *span = stretched(*span, Some((begun, seen.closed.unwrap_or(Ns::MAX))));
    }

    /// Stretches the span over another one.
    fn stretch(&mut self, other: Option<(Ns, Ns)>) {
        self.span = stretched(self.span, other);
    }

    fn merge(&mut self, later: &Self) {
        self.turned_away.merge(&later.turned_away);
        self.mismatched.merge(&later.mismatched);
        self.mismatched_requests += later.mismatched_requests;
        self.framing = self.framing.or(later.framing);
        self.other_framing = self.other_framing.or(later.other_framing);
        self.requests += later.requests;
        self.writes += later.writes;
        self.answered += later.answered;
        self.stretch(later.span);
        self.has_two_programs |= later.has_two_programs;
        for ((requests, span), (more, other)) in self.kinds.iter_mut().zip(later.kinds) {
            *requests += more;
            *span = stretched(*span, other);
        }
    }
}

/// A span over both.
fn stretched(own: Option<(Ns, Ns)>, other: Option<(Ns, Ns)>) -> Option<(Ns, Ns)> {
    match (own, other) {
        (Some(own), Some(other)) => Some((own.0.min(other.0), own.1.max(other.1))),
        (own, other) => own.or(other),
    }
}
