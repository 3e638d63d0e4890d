//! The loop of every tap: reads of ports to the search for line settings or to the engine.
//!
//! [`LiveRun::step`] waits for reads, has them decoded, and looks after the ports. Rows are then in the session: the caller
//! takes them with `Session::take` and hands them to its consumers (outputs, screens, brokers). That is the only place where
//! decoded rows leave the loop.

mod bus;
mod options;
mod ports;

use std::time::{Duration, Instant};

use modlens_engine::line_search::SearchRead;
use modlens_engine::session::Session;
use modlens_protocol::Ns;

use crate::feed::Feed;
use crate::port::{Opener, PortError};
use crate::queue::Read;
use bus::LiveBus;
pub use options::{LiveOptions, LiveStatus, Origin, TappedBus, IDLE_NS};
use ports::Ports;

/// The engine is given a time so far in the past: reads may not have reached the queue yet.
const READ_LAG_NS: Ns = 30_000_000;
/// How often settings that were found by listening are checked.
const CHECK_NS: Ns = 1_000_000_000;
/// Open ports, and what becomes of their reads.
pub struct LiveRun {
    ports: Ports,
    buses: Vec<LiveBus>,
    detect: bool,
    next_check: Ns,
    /// Where reads go besides the engine.
    feed: Option<Feed>,
}

impl LiveRun {
    /// Opens all ports; a bus whose settings are known is added to the session.
    pub fn open(buses: Vec<TappedBus>, opener: Opener, options: LiveOptions, session: &mut Session) -> Result<Self, PortError> {
        let detect = options.detect;
        let mut run = Self { ports: Ports::new(opener, options), buses: Vec::new(), detect, next_check: 0, feed: None };
        for tapped in buses {
            let first = run.ports.count();
            let has_sides = tapped.ports.len() > 1;
            for (side, name) in (1..).zip(&tapped.ports) {
                run.ports.open(name, run.buses.len(), if has_sides { side } else { 0 }, tapped.options.line)?;
            }
            run.buses.push(LiveBus::new(tapped.options, first..run.ports.count()));
        }
        for bus in &mut run.buses {
            bus.begin(&mut run.ports, session, run.detect);
        }
        Ok(run)
    }

    /// Waits for reads and has them decoded, until there are rows or messages, at most `timeout`.
    pub fn step(&mut self, session: &mut Session, timeout: Duration) -> Result<(), PortError> {
        let until = Instant::now() + timeout;
        loop {
            self.buses.iter_mut().for_each(|bus| bus.record_directly(&self.ports));
            let reads = self.ports.take(until.saturating_duration_since(Instant::now()));
            let mut lost = Ok(());
            for read in reads {
                if read.bytes.is_none() {
                    lost = lost.and(self.ports.lose(read.port, read.error));
                }
                self.take(session, read);
            }
            lost?;
            self.ports.maintain();
            self.advance(session);
            if session.pending_rows() > 0 || !self.ports.messages.is_empty() || Instant::now() >= until {
                return Ok(());
            }
        }
    }

    /// Stops reading, decodes what was read, and decides what is still open.
    pub fn finish(&mut self, session: &mut Session) {
        for read in self.ports.drain() {
            self.take(session, read);
        }
        let now = self.ports.now_ns();
        for bus in &mut self.buses {
            bus.end(&mut self.ports, session, now);
        }
        session.flush();
    }

    /// Records or serves all reads from now on, and those that are not decoded yet. A bus whose settings are searched is
    /// recorded when they are found, with the reads that were made with these.
    pub fn record(&mut self, feed: Feed) {
        for bus in &mut self.buses {
            bus.record(feed.clone(), &self.ports);
        }
        self.feed = Some(feed);
    }

    /// Sentences for the user since the last call.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.ports.messages)
    }

    /// Each bus besides its traffic.
    pub fn statuses(&self) -> Vec<LiveStatus> {
        self.buses.iter().map(|bus| bus.status(&self.ports)).collect()
    }

    /// For tests: as if somebody had set the wall clock forward by `wall`, and the machine had slept for `suspended`.
    pub fn pretend(&self, wall: Ns, suspended: Ns) {
        self.ports.inbox.pretend(wall, suspended);
    }

    /// Ends all threads and closes the ports.
    pub fn close(&mut self) {
        self.ports.close();
    }

    /// One read, or the end of a port.
    fn take(&mut self, session: &mut Session, read: Read) {
        let bus = self.ports.bus(read.port);
        let read = SearchRead {
            port: read.port,
            line: self.ports.side(read.port),
            time: read.time,
            follows_loss: read.follows_loss || read.bytes.is_none(),
            bytes: read.bytes.unwrap_or_default(),
            errors: read.errors,
            is_recorded: read.is_recorded,
        };
        self.buses[bus].take(&mut self.ports, session, read);
    }

    /// Reports engine and searches what time it is.
    fn advance(&mut self, session: &mut Session) {
        let now = self.ports.told_ns(READ_LAG_NS);
        if let Some(feed) = &self.feed {
            feed.advance(now);
        }
        for bus in &mut self.buses {
            bus.advance(&mut self.ports, session, now);
        }
        session.poll(now);
        if now >= self.next_check {
            self.next_check = now + CHECK_NS;
            for bus in &mut self.buses {
                bus.check_found_line(&mut self.ports, session);
            }
        }
    }
}
