//! The counters of TCP connections: who was let in, for how long, and in which framing the two sides speak.

use modlens_engine::records::{Connection, End};
use modlens_protocol::status::Status;

use super::sample::Sample;
use super::tally::{mix_bytes, Place, Tally};
use modlens_engine::durations::Durations;

/// Clients that are counted one by one.
const MAX_CLIENTS: usize = 256;

/// A connection with so few requests is one for each request.
const FEW_REQUESTS: u64 = 2;

/// The connections to one server.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Connections {
    /// Attempts that were refused, or closed by the server before anything was asked.
    pub turned_away: Tally,
    /// Connections that were closed after one or two requests.
    pub short: Tally,
    /// Connections that the server closed though requests had been answered.
    pub closed_by_server: Tally,
    /// Their idle times before.
    pub idle: Durations,
    /// Connections whose first request was not answered, of those with answers.
    pub first_lost: Tally,
    /// Answers that the client took for those of the next request.
    pub lockstep: u64,
    /// When the first connection with such answers began.
    pub lockstep_since: Option<Place>,
    /// Answers.
    pub answered: u64,
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
    /// Answers.
    pub answered: u64,
}

impl Connections {
    pub(super) fn count(&mut self, seen: &Connection) {
        // A connection is no transaction, so it has no number among the examples.
        let place = Place { number: 0, elapsed: None, time: seen.opened.or(seen.begun) };
        let by_server = seen.closed_by == Some(End::Server);
        let turned_away = seen.is_refused || (seen.requests == 0 && by_server);
        self.turned_away.count(turned_away, place);
        self.answered += seen.answered;
        if seen.lockstep > 0 {
            self.lockstep += seen.lockstep;
            self.lockstep_since.get_or_insert(place);
        }
        if seen.requests > 0 {
            // The first and the last one may be cut by the recording.
            self.short.count(seen.requests <= FEW_REQUESTS && seen.closed.is_some() && seen.opened.is_some(), place);
            self.closed_by_server.count(by_server, place);
            if let (true, Some(idle)) = (by_server, seen.idle) {
                self.idle.add(idle);
            }
        }
        if seen.answered > 0 && seen.opened.is_some() {
            self.first_lost.count(seen.first_status == Some(Status::NoResponse), place);
        }
        if let Some(client) = self.clients.entry(mix_bytes(seen.client.as_bytes()), seen.client.clone()) {
            client.count(seen, turned_away, place);
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.turned_away.merge(&later.turned_away);
        self.short.merge(&later.short);
        self.closed_by_server.merge(&later.closed_by_server);
        self.idle.merge(&later.idle);
        self.first_lost.merge(&later.first_lost);
        self.lockstep += later.lockstep;
        self.lockstep_since = self.lockstep_since.or(later.lockstep_since);
        self.answered += later.answered;
        self.clients.merge(&later.clients, ClientCounts::merge);
    }
}

impl ClientCounts {
    fn count(&mut self, seen: &Connection, turned_away: bool, place: Place) {
        self.turned_away.count(turned_away, place);
        self.requests += seen.requests;
        self.answered += seen.answered;
        if seen.requests == 0 {
            return;
        }
        // A client that speaks one framing drops what comes in another, though it is reported here as the answer that it is.
        let differ = seen.client_framing.zip(seen.server_framing).is_some_and(|(client, server)| client != server);
        // A server of MBAP drops requests in another framing without a word.
        let is_ignored = seen.client_framing.is_some_and(|framing| framing != "tcp") && seen.answered == 0;
        let mismatched = differ || is_ignored;
        self.mismatched.count(mismatched, place);
        if mismatched {
            self.mismatched_requests += seen.requests;
            self.framing = self.framing.or(seen.client_framing);
            self.other_framing = self.other_framing.or(seen.server_framing);
        }
    }

    fn merge(&mut self, later: &Self) {
        self.turned_away.merge(&later.turned_away);
        self.mismatched.merge(&later.mismatched);
        self.mismatched_requests += later.mismatched_requests;
        self.framing = self.framing.or(later.framing);
        self.other_framing = self.other_framing.or(later.other_framing);
        self.requests += later.requests;
        self.answered += later.answered;
    }
}
