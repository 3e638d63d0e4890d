//! What a live run is given, and what it reports about its buses.

use std::time::Duration;

use modlens_engine::session::BusOptions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use crate::port::Counts;

/// After so long without bytes, beyond the timeout of a master, no transaction is in progress.
pub const IDLE_NS: Ns = 1_500_000_000;

/// A bus to listen to: one port, or one for each direction.
#[derive(Clone, Debug)]
pub struct TappedBus {
    /// The names of its ports.
    pub ports: Vec<String>,
    /// How it is decoded. Line settings that are `None` are found by listening, where the port has any.
    pub options: BusOptions,
}

/// How to listen.
#[derive(Clone, Debug)]
pub struct LiveOptions {
    /// A lost port is waited for.
    pub reconnect: bool,
    /// Line settings that are given are found by listening all the same.
    pub detect: bool,
    /// After so long without bytes no transaction is in progress, so that times may follow a clock that was set.
    pub idle_ns: Ns,
    /// A busy line wakes the loop at most so often.
    pub read_interval: Duration,
    /// The memory of reads that wait to be decoded, in bytes.
    pub queue_bytes: usize,
    /// When a lost port is tried again, first and then.
    pub retries: [Duration; 2],
    /// How often clocks and drivers' error counters are looked at.
    pub check_interval: Duration,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            reconnect: true,
            detect: false,
            idle_ns: IDLE_NS,
            read_interval: Duration::from_millis(6),
            queue_bytes: 1 << 26,
            retries: [Duration::from_millis(200), Duration::from_secs(1)],
            check_interval: Duration::from_secs(1),
        }
    }
}

/// Where the line settings of a bus come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Origin {
    /// It has none: raw TCP.
    #[default]
    None,
    /// The user gave them.
    Given,
    /// They were found by listening.
    Found,
    /// They are being searched.
    Searching,
}

impl Origin {
    /// The word for it; empty for none.
    pub fn text(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Given => "given",
            Self::Found => "found",
            Self::Searching => "searching",
        }
    }
}

/// What is known of a bus besides its traffic.
#[derive(Clone, Debug)]
pub struct LiveStatus {
    /// Its name.
    pub bus: String,
    /// Its number in the session, once it is decoded.
    pub number: Option<usize>,
    /// The present line settings.
    pub line: Option<LineSettings>,
    /// Where they come from.
    pub origin: Origin,
    /// For how long a port has been away.
    pub lost: Option<Duration>,
    /// What the drivers of its ports have counted since the beginning.
    pub error_counts: Counts,
}
