//! A TCP connection, as a row.

use std::sync::Arc;

use modlens_protocol::finding::Finding;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// One of the two ends of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The end that sends requests.
    Client,
    /// The end that sends responses.
    Server,
}

impl End {
    /// The word in the tables.
    pub fn text(self) -> &'static str {
        match self {
            Self::Client => "client",
            Self::Server => "server",
        }
    }
}

/// How long a connection waits for its first answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FirstWait {
    /// When the first request came.
    pub asked: Option<Ns>,
    /// When the first answer came.
    pub answered: Option<Ns>,
    /// How many requests came until then.
    pub requests: u64,
}

/// One TCP connection of a capture, whether or not it carried a byte.
#[derive(Clone, Debug, Default)]
pub struct Connection {
    /// Running number from 1, in the order in which connections begin.
    pub number: u64,
    /// Address of the client.
    pub client: String,
    /// Port of the client.
    pub client_port: u16,
    /// Address and port of the server.
    pub server: String,
    /// The kind of the capture's clock.
    pub clock: Clock,
    /// Time of the first packet.
    pub begun: Option<Ns>,
    /// When the client asked for the connection; `None` where its SYN was not captured.
    pub opened: Option<Ns>,
    /// The server has sent something other than a RST.
    pub is_accepted: bool,
    /// When the first FIN or RST ended it; `None` where it is open at the end of the capture.
    pub closed: Option<Ns>,
    /// Who sent that.
    pub closed_by: Option<End>,
    /// The server has answered the SYN with a RST.
    pub is_refused: bool,
    /// A RST ended it.
    pub is_reset: bool,
    /// Requests of the client.
    pub requests: u64,
    /// Those that write registers or bits.
    pub writes: u64,
    /// Those with an answer, an exception included.
    pub answered: u64,
    /// Answers of the server, those to no request among them.
    pub answers: u64,
    /// Another connection to the server was answered while this one was open.
    pub is_beside_answered: bool,
    /// When another connection to the server was answered last; `None` where it is not known, and if this one was answered.
    pub beside_until: Option<Ns>,
    /// How long it took until the first answer came.
    pub first_wait: FirstWait,
    /// What came of the first request.
    pub first_status: Option<Status>,
    /// The most requests that waited for their answers at the same time.
    pub in_flight_max: u32,
    /// Answers that came in the place of those to the request after theirs.
    pub lockstep: u64,
    /// When the first of these came, or the request that followed it.
    pub lockstep_since: Option<Ns>,
    /// When the last of these came, and how many answers had come then.
    pub lockstep_until: (Option<Ns>, u64),
    /// The framing in which the client writes: a framing of Modbus, or `other`; `None` where it has sent nothing.
    pub client_framing: Option<&'static str>,
    /// The framing in which the server writes.
    pub server_framing: Option<&'static str>,
    /// Segments that were transmitted again.
    pub retransmitted_segments: u32,
    /// Bytes that are missing from the capture.
    pub lost_bytes: u64,
    /// The silence before it was closed.
    pub idle: Option<Ns>,
    /// Findings on the connection.
    pub findings: Vec<Finding>,
    /// The file.
    pub source: Arc<str>,
    /// Number of its first packet.
    pub origin: u64,
}
