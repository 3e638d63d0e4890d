//! Connections that a server ends when another one begins: it serves one client, the newest.

use std::collections::VecDeque;

use modlens_engine::records::Connection;
use modlens_protocol::Ns;

use super::tally::{Place, Tally};

/// So many ends are kept: who is displaced ends before who displaces it.
const KEPT: usize = 32;

/// The end of the one comes so soon after the beginning of the other.
const SOON: Ns = 50_000_000;

/// Beginnings of connections, and whether a server has ended another one right then.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Displaced {
    /// Those that have displaced another one.
    pub beginnings: Tally,
    ends: VecDeque<Ns>,
}

impl Displaced {
    /// Counts a connection that is over.
    pub(super) fn count(&mut self, seen: &Connection, is_by_server: bool, place: Place) {
        if let Some(opened) = seen.opened {
            self.beginnings.count(self.ends.iter().any(|end| (opened..opened + SOON).contains(end)), place);
        }
        // Where connections are as short as that, as with a server that closes after each answer, one always begins before.
        let lasted = seen.opened.zip(seen.closed).is_some_and(|(opened, closed)| closed - opened >= 10 * SOON);
        self.ends.extend(seen.closed.filter(|_| is_by_server && lasted));
        self.forget();
    }

    pub(super) fn merge(&mut self, later: &Self) {
        self.beginnings.merge(&later.beginnings);
        self.ends.extend(&later.ends);
        self.forget();
    }

    fn forget(&mut self) {
        self.ends.drain(..self.ends.len().saturating_sub(KEPT));
    }
}
