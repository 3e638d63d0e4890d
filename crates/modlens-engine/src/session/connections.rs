//! The rows of TCP connections: each is complete once its connection is over, and rows come in the order in which
//! connections begin.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::findings;
use crate::records::{Bus, Connection, End};
use crate::session::connection_tally::ConnectionTally;
use crate::transactions::transaction::ConnectionEnd;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use modlens_readers::pcap::{EndedConnection, SideFraming};

/// Rows that may wait for an older connection that is still open; beyond it they are written all the same, out of order.
const MAX_HELD_CONNECTIONS: usize = 16_384;

/// The word for a side that writes in no framing of Modbus.
const OTHER_FRAMING: &str = "other";

/// The connections of all captures of a session.
#[derive(Debug, Default)]
pub(super) struct Connections {
    /// The last number that was given.
    last: u64,
    /// Those that have begun and are not over.
    open: BTreeSet<u64>,
    /// The rows of those that are over.
    ended: BTreeMap<u64, Connection>,
}

impl Connections {
    /// The number of a connection that has no row: of datagrams, or of rows that are read back.
    pub(super) fn number(&mut self) -> u64 {
        self.last += 1;
        self.last
    }

    /// The number of a TCP connection that begins.
    pub(super) fn begin(&mut self) -> u64 {
        let number = self.number();
        self.open.insert(number);
        number
    }

    /// Ends a TCP connection: its row is complete.
    pub(super) fn end(&mut self, row: Connection) {
        self.open.remove(&row.number);
        self.ended.insert(row.number, row);
    }

    /// The rows that no open connection holds back; all of them in a live session, or if they are too many.
    pub(super) fn take(&mut self, live: bool) -> Vec<Connection> {
        if self.ended.is_empty() {
            return Vec::new();
        }
        let first_open = self.open.first().copied().filter(|_| !live && self.ended.len() <= MAX_HELD_CONNECTIONS);
        let held = first_open.map_or_else(BTreeMap::new, |first| self.ended.split_off(&first));
        std::mem::replace(&mut self.ended, held).into_values().collect()
    }
}

/// How a connection ended, where the capture shows its end.
pub(super) fn connection_end(ended: &EndedConnection<'_>) -> Option<ConnectionEnd> {
    let EndedConnection { client_side, history, .. } = *ended;
    let is_over = history.is_reset || history.closed.is_some() || history.closed_by.is_some();
    let by_client = history.closed_by.map(|side| side == client_side);
    is_over.then_some(ConnectionEnd { is_reset: history.is_reset, by_client })
}

/// What the other connections to the server of one that has no answer show.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Beside {
    /// One of them was answered while this one was open.
    pub is_answered: bool,
    /// When one of them was answered last.
    pub until: Option<Ns>,
}

/// The row of a connection that is over. `mode` is the framing in which its frames were found, if any were.
pub(super) fn row(
    number: u64,
    ended: &EndedConnection<'_>,
    (source, clock): (Arc<str>, Clock),
    mode: Option<Mode>,
    (tally, beside): (ConnectionTally, Beside),
) -> Connection {
    let EndedConnection { client, server, client_side, history } = *ended;
    let framing = |side: usize, has_frames: bool| side_framing(history.framing[side], mode.filter(|_| has_frames));
    let counted = counted(&tally, (source, clock));
    Connection {
        number,
        client: client.address.to_string(),
        client_port: client.port,
        server: server.to_string(),
        begun: history.begun,
        opened: history.opened,
        is_accepted: history.is_accepted,
        closed: history.closed,
        closed_by: history.closed_by.map(|side| if side == client_side { End::Client } else { End::Server }),
        is_refused: history.is_refused,
        is_reset: history.is_reset,
        is_beside_answered: beside.is_answered,
        beside_until: beside.until,
        client_framing: framing(client_side, tally.requests > 0),
        server_framing: framing(1 - client_side, tally.has_response),
        retransmitted_segments: history.retransmitted,
        lost_bytes: history.lost_bytes,
        idle: history.idle(),
        origin: history.packet,
        findings: findings::connection::with_those_of_packets(tally.findings, history),
        ..counted
    }
}

/// What the frames and transactions of a connection add up to, in a row that is empty otherwise.
fn counted(tally: &ConnectionTally, (source, clock): (Arc<str>, Clock)) -> Connection {
    Connection {
        clock,
        source,
        requests: tally.requests,
        writes: tally.writes,
        answered: tally.answered,
        answers: tally.in_flight.answers,
        first_wait: tally.in_flight.first_wait,
        first_status: tally.first.map(|(_, status)| status),
        in_flight_max: tally.in_flight.most,
        lockstep: tally.in_flight.lockstep,
        lockstep_since: tally.in_flight.lockstep_since,
        lockstep_until: tally.in_flight.lockstep_until,
        ..Connection::default()
    }
}

/// The row of a connection that is still open, as far as its frames show it.
pub(super) fn open_row(
    bus: &Bus,
    source: Arc<str>,
    mode: Option<Mode>,
    (tally, beside): (&ConnectionTally, Beside),
) -> Option<Connection> {
    let network = bus.network.as_ref()?;
    let framing = |has_frames: bool| mode.filter(|_| has_frames).map(Mode::text);
    Some(Connection {
        number: network.connection,
        client: network.client.clone(),
        client_port: network.client_port?,
        server: network.server.clone(),
        begun: tally.in_flight.first_request,
        is_accepted: true,
        is_beside_answered: beside.is_answered,
        beside_until: beside.until,
        client_framing: framing(tally.requests > 0),
        server_framing: framing(tally.has_response),
        ..counted(tally, (source, bus.clock))
    })
}

/// The word for the framing of a side: as its segments begin, or else that of its frames.
fn side_framing(seen: SideFraming, of_frames: Option<Mode>) -> Option<&'static str> {
    match seen {
        SideFraming::Silent => None,
        SideFraming::Known(mode) => Some(mode.text()),
        SideFraming::Unknown(_) => Some(of_frames.map_or(OTHER_FRAMING, Mode::text)),
    }
}
