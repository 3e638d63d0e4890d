//! The loop of a tap: reads of the port to the engine, rows to the outputs.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_engine::records::Bus;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_recorder::{Inbox, Read, RecordedPort, Recorder, RecorderOptions};

use crate::mqtt::Publisher;
use crate::options::Options;
use crate::port::{open_port, set_line};
use crate::rows::Rows;
use crate::search::Search;

const PORT: usize = 0;
const WAIT: Duration = Duration::from_millis(50);
const RECONNECT: Duration = Duration::from_secs(1);
const CLOSE: Duration = Duration::from_secs(5);
const QUEUE_BYTES: usize = 1 << 24;
/// The engine is told a time so far in the past: reads may not have reached the queue yet.
const READ_LAG_NS: Ns = 30_000_000;

/// What ends the program, and its exit status.
pub struct Trouble {
    /// What to tell.
    pub message: String,
    /// The exit status.
    pub status: u8,
}

fn output(name: &str) -> impl Fn(io::Error) -> Trouble + '_ {
    move |error| Trouble { message: format!("{name}: {error}"), status: 3 }
}

/// Listens until a signal or `--count` ends it.
pub fn run(options: &Options) -> Result<(), Trouble> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(output("signals"))?;
    }
    let publisher = match &options.broker {
        Some(broker) => Some(Publisher::start(broker.clone(), options.bus.clone()).map_err(output("--mqtt"))?),
        None => None,
    };
    let rows = Rows::open(options, publisher).map_err(output("output"))?;
    let mut tap = Tap::open(options, rows)?;
    tap.listen(&stop)?;
    tap.close()
}

/// A tap of one bus.
struct Tap<'a> {
    options: &'a Options,
    port: Option<OwnedFd>,
    inbox: Inbox,
    recorder: Option<Recorder>,
    session: Session,
    bus: Option<usize>,
    line: Option<LineSettings>,
    search: Option<Search>,
    rows: Rows,
}

impl<'a> Tap<'a> {
    /// Opens port and recording.
    fn open(options: &'a Options, rows: Rows) -> Result<Self, Trouble> {
        let port =
            open_port(&options.port).map_err(|error| Trouble { message: format!("{}: {error}", options.port), status: 4 })?;
        let recorder = match &options.record {
            Some(path) => {
                let (rotation, retention) = (options.rotation, options.retention);
                let wanted = RecorderOptions { rotation, retention, ..RecorderOptions::new(path) };
                Some(Recorder::start(wanted).map_err(output("--record"))?)
            }
            None => None,
        };
        let wanted = WantedTables { frames: false, transactions: true, findings: false };
        let session = Session::new(Arc::new(Functions::default()), wanted, true, None);
        let (inbox, line) = (Inbox::new(QUEUE_BYTES), options.line);
        let mut tap = Self { options, port: Some(port), inbox, recorder, session, bus: None, line, search: None, rows };
        if line.is_none() {
            tap.say("no line settings given; they are searched by listening");
            tap.search = Some(Search::new(options.mode, tap.inbox.now_ns()));
        } else {
            tap.begin_decoding();
        }
        tap.listen_to_port();
        Ok(tap)
    }

    fn say(&self, text: &str) {
        eprintln!("{}: {text}", self.options.bus);
    }

    /// Reads the port with the settings that hold now.
    fn listen_to_port(&mut self) {
        let Some(line) = self.line.or_else(|| self.search.as_ref().map(Search::line)) else { return };
        let Some(port) = &self.port else { return };
        // A pseudo terminal has no parity, and a port that does not take the settings is still worth listening to.
        let marks = set_line(port, line).unwrap_or_else(|error| {
            self.say(&format!("{line}: {error}"));
            false
        });
        self.inbox.set_char_ns(PORT, line.char_ns());
        if let Err(error) = self.inbox.listen(PORT, port.as_fd(), marks) {
            self.say(&error.to_string());
            self.port = None;
        }
    }

    /// Adds the bus to the engine and to the recording, now that its settings are known.
    fn begin_decoding(&mut self) {
        let bus = Bus {
            name: self.options.bus.clone(),
            source: self.options.port.clone(),
            place: Place::Offset,
            clock: Clock::Utc,
            line: self.line,
            network: None,
        };
        self.bus = Some(self.session.add_bus(BusOptions {
            bus,
            mode: self.options.mode,
            line: self.line,
            resolution: None,
            rule: None,
        }));
        if let Some(recorder) = &self.recorder {
            let at = recorder.add_port(RecordedPort {
                name: self.options.port.clone(),
                bus: self.options.bus.clone(),
                line: None,
                settings: self.line,
            });
            self.inbox.record(PORT, recorder.feed(), at);
        }
        let at = self.line.map_or(String::new(), |line| format!(" at {line}"));
        self.say(&format!("listening{at}; nothing is sent"));
    }

    fn listen(&mut self, stop: &AtomicBool) -> Result<(), Trouble> {
        let mut retry = Instant::now();
        while !stop.load(Ordering::Relaxed) && !self.rows.is_full() {
            for read in self.inbox.take(WAIT, Duration::ZERO) {
                self.take(&read);
            }
            if self.port.is_none() && Instant::now() >= retry {
                retry = Instant::now() + RECONNECT;
                self.reconnect();
            }
            self.advance();
            self.rows.put(self.session.take()).map_err(output("output"))?;
            for line in self.recorder.as_ref().map(Recorder::take_messages).unwrap_or_default() {
                self.say(&line);
            }
        }
        Ok(())
    }

    /// One read, or the end of the port.
    fn take(&mut self, read: &Read) {
        if read.bytes.is_none() {
            self.say("the port is gone; waiting for it");
            self.inbox.end(PORT);
            self.port = None;
            self.feed(&Read { follows_loss: true, bytes: Some(Vec::new()), ..read.clone() });
        } else if let Some(search) = &mut self.search {
            if search.takes(read) {
                self.line = Some(search.line());
                self.search = None;
                self.begin_decoding();
            }
        } else {
            self.feed(read);
        }
    }

    fn feed(&mut self, read: &Read) {
        let (Some(bus), Some(bytes)) = (self.bus, &read.bytes) else { return };
        let times = Times::Read(read.time);
        if read.follows_loss {
            // What came before is closed only after all that time alone decides has been decided, as `modlens tap` does.
            self.session.feed(bus, &Chunk { times, follows_loss: true, ..Chunk::default() });
        }
        if !bytes.is_empty() {
            let (error_positions, follows_loss) = (read.errors.as_slice(), read.follows_loss);
            self.session.feed(bus, &Chunk { bytes, times, error_positions, follows_loss, ..Chunk::default() });
        }
    }

    /// Tells engine and search what time it is.
    fn advance(&mut self) {
        for change in self.inbox.check_clocks() {
            let _ = change;
        }
        let now = self.inbox.now_ns() - READ_LAG_NS;
        self.session.poll(now);
        if self.search.as_mut().is_some_and(|search| search.goes_on(now)) {
            self.inbox.end(PORT);
            self.listen_to_port();
        }
    }

    fn reconnect(&mut self) {
        if let Ok(port) = open_port(&self.options.port) {
            self.say("the port is back");
            self.port = Some(port);
            self.inbox.hole(PORT);
            self.listen_to_port();
        }
    }

    /// Decides what is open, and completes all outputs.
    fn close(mut self) -> Result<(), Trouble> {
        self.inbox.close();
        for read in self.inbox.take(Duration::ZERO, Duration::ZERO) {
            self.take(&read);
        }
        if let Some(bus) = self.bus {
            let times = Times::Read(self.inbox.now_ns());
            self.session.feed(bus, &Chunk { times, follows_loss: true, ..Chunk::default() });
        }
        self.session.flush();
        self.rows.put(self.session.take()).map_err(output("output"))?;
        let name = self.options.bus.clone();
        if let Some(mut recorder) = self.recorder.take() {
            let status = recorder.close(CLOSE);
            eprintln!("{name}: {} bytes recorded, {} lost", status.recorded, status.lost);
        }
        eprintln!("{name}: {} transactions", self.rows.count);
        match self.rows.close() {
            0 => Ok(()),
            lost => Err(Trouble { message: format!("{lost} messages were not delivered to the broker"), status: 3 }),
        }
    }
}
