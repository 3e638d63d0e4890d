//! The loop of a tap: reads of the port to search or engine, rows to the outputs.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_engine::line_search::{LineCheck, LineSearch, SearchOptions, SearchRead};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;
use modlens_recorder::{Inbox, Read};

use crate::decoding::Decoding;
use crate::mqtt::Publisher;
use crate::options::Options;
use crate::port::{open_port, set_line};
use crate::rows::Rows;

const PORT: usize = 0;
const WAIT: Duration = Duration::from_millis(50);
const RECONNECT: Duration = Duration::from_secs(1);
/// How often settings that were found are checked.
const CHECK_NS: Ns = 1_000_000_000;
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
    decoding: Decoding<'a>,
    /// The settings of the port.
    line: Option<LineSettings>,
    /// The search for them, while it goes on; what watches them, where they were found.
    search: Option<LineSearch>,
    check: Option<LineCheck>,
    next_check: Ns,
    /// Reads are to go to the recorder by themselves, as soon as none is in our hands.
    awaits_recording: bool,
    rows: Rows,
}

impl<'a> Tap<'a> {
    /// Opens port and recording.
    fn open(options: &'a Options, rows: Rows) -> Result<Self, Trouble> {
        let port =
            open_port(&options.port).map_err(|error| Trouble { message: format!("{}: {error}", options.port), status: 4 })?;
        let mut tap = Self {
            options,
            port: Some(port),
            inbox: Inbox::new(QUEUE_BYTES),
            decoding: Decoding::open(options).map_err(output("--record"))?,
            line: options.line,
            search: None,
            check: None,
            next_check: 0,
            awaits_recording: false,
            rows,
        };
        if options.line.is_some() {
            tap.begin_decoding();
        }
        let marks_errors = tap.listen_to_port();
        if options.line.is_none() {
            tap.say("no line settings given; they are searched by listening");
            tap.begin_search(marks_errors);
        }
        Ok(tap)
    }

    fn say(&self, text: &str) {
        eprintln!("{}: {text}", self.options.bus);
    }

    /// Reads the port with the settings that hold now; whether its driver marks line errors.
    fn listen_to_port(&mut self) -> bool {
        // Any settings tell whether errors are marked; the search sets its own.
        let line = self.line.unwrap_or_else(|| LineSearch::new(SearchOptions::default()).line());
        let marks_errors = self.set_line(line);
        let Some(port) = &self.port else { return marks_errors };
        if let Err(error) = self.inbox.listen(PORT, port.as_fd(), marks_errors) {
            self.say(&error.to_string());
            self.port = None;
        }
        marks_errors
    }

    /// Sets the port; whether its driver marks line errors.
    fn set_line(&mut self, line: LineSettings) -> bool {
        self.line = Some(line);
        self.inbox.set_char_ns(PORT, line.char_ns());
        let Some(port) = &self.port else { return false };
        // A pseudo terminal has no parity, and a port that does not take the settings is still worth listening to.
        set_line(port, line).unwrap_or_else(|error| {
            self.say(&format!("{line}: {error}"));
            false
        })
    }

    /// Searches the settings, for the first time or again.
    fn begin_search(&mut self, marks_errors: bool) {
        self.inbox.stop_recording(PORT);
        let search = LineSearch::new(SearchOptions { marks_errors, mode: self.options.mode });
        self.set_line(search.line());
        self.search = Some(search);
        self.check = None;
    }

    /// Follows the search: sets the port to what it tries next, or begins to decode with what it has found.
    fn follow_search(&mut self) {
        let Some(mut search) = self.search.take() else { return };
        for text in search.take_messages() {
            self.say(&text);
        }
        if self.line != Some(search.line()) {
            self.set_line(search.line());
            search.line_was_set(self.inbox.now_ns());
        }
        match search.found() {
            None => self.search = Some(search),
            Some(found) => {
                self.say(&format!("found {}", found.evidence));
                self.check = Some(LineCheck::default());
                self.decoding.begin(Some(found.line), Some(found.mode));
                self.begin_decoding();
                for read in &found.reads {
                    self.decoding.feed(read);
                }
            }
        }
    }

    fn begin_decoding(&mut self) {
        self.decoding.begin(self.line, None);
        self.awaits_recording = true;
        let at = self.line.map_or(String::new(), |line| format!(" at {line}"));
        self.say(&format!("listening{at}; nothing is sent"));
    }

    fn listen(&mut self, stop: &AtomicBool) -> Result<(), Trouble> {
        let mut retry = Instant::now();
        while !stop.load(Ordering::Relaxed) && !self.rows.is_full() {
            self.record_directly();
            for read in self.inbox.take(WAIT, Duration::ZERO) {
                self.take(read);
            }
            if self.port.is_none() && Instant::now() >= retry {
                retry = Instant::now() + RECONNECT;
                self.reconnect();
            }
            self.advance();
            self.rows.put(self.decoding.take()).map_err(output("output"))?;
            for line in self.decoding.take_messages() {
                self.say(&line);
            }
        }
        Ok(())
    }

    /// Lets reads go to the recorder by themselves.
    fn record_directly(&mut self) {
        if std::mem::take(&mut self.awaits_recording) {
            if let Some((feed, at)) = self.decoding.recording() {
                self.inbox.record(PORT, feed, at);
            }
        }
    }

    /// One read, or the end of the port.
    fn take(&mut self, read: Read) {
        let Some(bytes) = read.bytes else {
            self.say("the port is gone; waiting for it");
            self.inbox.end(PORT);
            self.port = None;
            self.decoding.lose(read.time, read.is_recorded);
            return;
        };
        let (errors, follows_loss, is_recorded) = (read.errors, read.follows_loss, read.is_recorded);
        let read = SearchRead { port: PORT, line: 0, time: read.time, bytes, errors, follows_loss, is_recorded };
        match &mut self.search {
            Some(search) => {
                search.feed(read);
                self.follow_search();
            }
            None => self.decoding.feed(&read),
        }
    }

    /// Tells engine and search what time it is.
    fn advance(&mut self) {
        // The clocks are followed where nothing is read, too.
        self.inbox.check_clocks();
        let now = self.inbox.now_ns() - READ_LAG_NS;
        self.decoding.session.poll(now);
        if let Some(search) = &mut self.search {
            search.advance(now);
            self.follow_search();
        }
        if now >= self.next_check {
            self.next_check = now + CHECK_NS;
            self.check_found_line();
        }
    }

    /// Begins the search again where settings that were found give nothing but damaged bytes.
    fn check_found_line(&mut self) {
        let Some((check, bus)) = self.check.as_mut().zip(self.decoding.bus) else { return };
        let Some(damage) = check.damage(&self.decoding.session, bus) else { return };
        let at = self.line.map_or(String::new(), |line| format!(" at {line}"));
        self.say(&format!("no valid frame in the last {damage} bytes{at}; the settings are searched again"));
        let marks_errors = self.line.is_some_and(|line| self.set_line(line));
        self.begin_search(marks_errors);
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
            self.take(read);
        }
        if let Some(search) = self.search.take() {
            // What was heard is decoded and recorded with the settings of the time.
            self.say(&search.diagnosis());
            for (line, read) in search.heard() {
                self.decoding.begin(Some(line), None);
                self.decoding.feed(read);
            }
        }
        let recorded = self.decoding.close(self.inbox.now_ns());
        self.rows.put(self.decoding.take()).map_err(output("output"))?;
        let name = &self.options.bus;
        if let Some(status) = recorded {
            eprintln!("{name}: {} bytes recorded, {} lost", status.recorded, status.lost);
        }
        eprintln!("{name}: {} transactions", self.rows.count);
        match self.rows.close() {
            0 => Ok(()),
            lost => Err(Trouble { message: format!("{lost} messages were not delivered to the broker"), status: 3 }),
        }
    }
}
