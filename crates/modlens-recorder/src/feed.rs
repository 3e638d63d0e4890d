//! Where the reads of ports go besides the engine: a recording, a server, or both.

use std::sync::Arc;

use modlens_pcapng::recording::PortRead;
use modlens_protocol::Ns;

use crate::segments::RecordedPort;

/// Takes the reads of ports. No method waits for a disk or a network, because the readers of ports call them.
pub trait ReadSink: Send + Sync {
    /// Adds a port; returns its number, which grows by one from port to port.
    fn add_port(&self, port: RecordedPort) -> u32;

    /// Takes a read of a port.
    fn write(&self, port: u32, read: &PortRead<'_>);

    /// Marks that the times of a port jump by `step` from now on, because the wall clock was set.
    fn mark_clock_step(&self, port: u32, time: Ns, step: Ns);

    /// Notes that all reads before this time have been written.
    fn advance(&self, _time: Ns) {}
}

/// Where reads go that are recorded or served; copies lead to the same place.
#[derive(Clone)]
pub struct Feed {
    sinks: Vec<Arc<dyn ReadSink>>,
}

impl From<Arc<dyn ReadSink>> for Feed {
    fn from(sink: Arc<dyn ReadSink>) -> Self {
        Self { sinks: vec![sink] }
    }
}

impl Feed {
    /// Joins feeds that have no port yet, so that all of them number ports alike.
    pub fn join(feeds: impl IntoIterator<Item = Self>) -> Self {
        Self { sinks: feeds.into_iter().flat_map(|feed| feed.sinks).collect() }
    }

    /// Adds a port; returns its number.
    pub fn add_port(&self, port: &RecordedPort) -> u32 {
        self.sinks.iter().map(|sink| sink.add_port(port.clone())).max().unwrap_or_default()
    }

    /// Passes a read of a port on.
    pub fn write(&self, port: u32, read: &PortRead<'_>) {
        self.sinks.iter().for_each(|sink| sink.write(port, read));
    }

    /// Marks that the times of a port jump by `step` from now on, because the wall clock was set.
    pub fn mark_clock_step(&self, port: u32, time: Ns, step: Ns) {
        self.sinks.iter().for_each(|sink| sink.mark_clock_step(port, time, step));
    }

    /// Notes that all reads before this time have been written.
    pub fn advance(&self, time: Ns) {
        self.sinks.iter().for_each(|sink| sink.advance(time));
    }
}
