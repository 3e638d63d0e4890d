//! Connections that a server lets in and does not serve while it serves others, and when clients are kept out.

use std::collections::VecDeque;

use modlens_engine::records::Connection;
use modlens_protocol::Ns;

use super::gaps::Episode;
use super::tally::{mix_bytes, Place, Tally};

/// A request that waits for so long while another connection is served waits in vain.
pub(super) const IN_VAIN: Ns = 5_000_000_000;

/// A server that serves one client after the other answers the next one so soon after the one before has gone.
const NEXT: Ns = 2_000_000_000;

/// Ends of connections that are remembered.
const MAX_ENDS: usize = 16;

/// Clients that a spell names, and spells that are kept apart.
const MAX_CLIENTS: usize = 8;
const MAX_SPELLS: usize = 16;

/// Requests that are not served, and the connections that have ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unserved {
    /// Requests on connections that were not served while others were; those that were served once another one had ended among
    /// them.
    pub requests: Tally,
    /// When the last connections ended that had been served.
    ends: VecDeque<Ns>,
}

impl Unserved {
    /// Counts a connection, some of whose requests were counted when it was open; so many of the rest were sent in vain.
    pub(super) fn count(&mut self, seen: &Connection, (new, in_vain): (u64, u64), place: Place) {
        let until = seen.first_wait.answered.or(seen.closed).or(seen.beside_until);
        if let Some(more) = in_vain.checked_sub(1) {
            self.requests.count(true, place);
            self.requests.failed += more;
            self.requests.total += more;
            self.requests.last = Some(Place { time: until.or(place.time), ..place });
        }
        self.requests.count_good(new.saturating_sub(in_vain));
        if let Some(closed) = seen.closed.filter(|_| seen.answered > 0) {
            self.ends.push_back(closed);
            self.forget();
        }
    }

    /// How many requests of a connection were sent in vain.
    pub(super) fn of(&self, seen: &Connection) -> u64 {
        let Some(asked) = seen.first_wait.asked.filter(|_| !is_ignored(seen)) else { return 0 };
        let Some(answered) = seen.first_wait.answered else {
            let until = seen.closed.map_or(seen.beside_until, |closed| seen.beside_until.map(|last| last.min(closed)));
            let is_long = until.is_some_and(|until| until - asked >= IN_VAIN);
            return if seen.is_beside_answered && is_long { seen.requests } else { 0 };
        };
        let is_next = |end: &Ns| (asked..=answered).contains(end) && answered - end <= NEXT;
        if answered - asked >= IN_VAIN && self.ends.iter().any(is_next) {
            seen.first_wait.requests
        } else {
            0
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.requests.merge(&later.requests);
        self.ends.extend(&later.ends);
        self.forget();
    }

    fn forget(&mut self) {
        self.ends.drain(..self.ends.len().saturating_sub(MAX_ENDS));
    }
}

/// When clients were kept out: each spell ends where one of them is served on a new connection.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LockedOut {
    spells: Vec<Episode>,
    /// The clients of the spell that goes on, by hash.
    clients: Vec<u64>,
}

impl LockedOut {
    /// Counts an attempt of a client that failed, from a time to another.
    pub(super) fn fail(&mut self, client: &str, from: Place, until: Place) {
        let client = mix_bytes(client.as_bytes());
        if self.clients.is_empty() {
            self.spells.push(Episode { first: from, last: until, failed: 0, total: 0, before: 0 });
            self.join_last();
        }
        if self.clients.len() < MAX_CLIENTS && !self.clients.contains(&client) {
            self.clients.push(client);
        }
        if let Some(spell) = self.spells.last_mut() {
            (spell.last, spell.failed, spell.total) = (until, spell.failed + 1, spell.total + 1);
        }
    }

    /// Counts a connection of a client that was served.
    pub(super) fn serve(&mut self, client: &str) {
        if self.clients.contains(&mix_bytes(client.as_bytes())) {
            self.clients.clear();
        }
    }

    /// The spells, and whether the last one is over; one of all where there are too many.
    pub fn spells(&self) -> (&[Episode], bool) {
        (&self.spells, self.clients.is_empty())
    }

    pub(super) fn merge(&mut self, later: &Self) {
        let goes_on = !self.clients.is_empty();
        for (at, spell) in later.spells.iter().enumerate() {
            match self.spells.last_mut().filter(|_| goes_on && at == 0) {
                Some(own) => *own = joined(own, spell),
                None => self.spells.push(*spell),
            }
            self.join_last();
        }
        if !later.spells.is_empty() {
            self.clients.clone_from(&later.clients);
        }
    }

    /// Joins the last two of too many.
    fn join_last(&mut self) {
        if self.spells.len() > MAX_SPELLS {
            let last = self.spells.pop().expect("there are many");
            let before = self.spells.last_mut().expect("there are many");
            *before = joined(before, &last);
        }
    }
}

/// One spell of two.
fn joined(one: &Episode, next: &Episode) -> Episode {
    Episode { last: next.last, failed: one.failed + next.failed, total: one.total + next.total, ..*one }
}

/// Whether nothing is answered on a connection in another framing than MBAP: a server of MBAP drops that without a word.
pub(super) fn is_ignored(seen: &Connection) -> bool {
    seen.client_framing.is_some_and(|framing| framing != "tcp") && seen.answered == 0
}
