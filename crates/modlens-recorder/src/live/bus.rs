//! One bus of a live run: the search for its line settings, then engine and recording.

use std::ops::Range;

use modlens_engine::line_search::{LineCheck, LineSearch, SearchOptions, SearchRead};
use modlens_engine::session::{BusOptions, Session};
use modlens_pcapng::recording::PortRead;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};

use super::options::{LiveStatus, Origin};
use super::ports::Ports;
use crate::feed::Feed;
use crate::port::Counts;
use crate::segments::RecordedPort;

/// The letters of the two lines of a bus that is tapped on both.
const LETTERS: [&str; 2] = ["A", "B"];

/// One bus of a live run.
pub(super) struct LiveBus {
    /// How it is decoded, but for settings that are found.
    template: BusOptions,
    /// The numbers of its ports.
    ports: Range<usize>,
    /// Its number in the session; `None` until settings were found for the first time.
    number: Option<usize>,
    search: Option<LineSearch>,
    origin: Origin,
    /// Watches settings that were found.
    check: Option<LineCheck>,
    /// The settings that the session knows.
    line: Option<LineSettings>,
    recorder: Option<Feed>,
    /// The numbers of its ports in the recording.
    recorded_as: Vec<u32>,
    /// Its reads are to go to the recorder by themselves, as soon as none is in our hands.
    awaits_recording: bool,
}

impl LiveBus {
    pub(super) fn new(template: BusOptions, ports: Range<usize>) -> Self {
        Self {
            template,
            ports,
            number: None,
            search: None,
            origin: Origin::None,
            check: None,
            line: None,
            recorder: None,
            recorded_as: Vec::new(),
            awaits_recording: false,
        }
    }

    /// Begins to decode with settings that are known, or to search them.
    pub(super) fn begin(&mut self, ports: &mut Ports, session: &mut Session, detect: bool) {
        let line = ports.line(self.ports.start);
        let takes_settings = ports.takes_line_settings(self.ports.start);
        if takes_settings && (detect || line.is_none()) {
            return self.begin_search(ports);
        }
        self.origin = if takes_settings { Origin::Given } else { Origin::None };
        self.begin_decoding(ports, session, line, None);
    }

    pub(super) fn status(&self, ports: &Ports) -> LiveStatus {
        let mut error_counts = Counts::new();
        for (name, count) in self.ports.clone().flat_map(|port| ports.error_counts(port)) {
            *error_counts.entry(name.clone()).or_default() += count;
        }
        LiveStatus {
            bus: self.template.bus.name.clone(),
            number: self.number,
            line: if self.origin == Origin::None { None } else { ports.line(self.ports.start) },
            origin: self.origin,
            lost: self.ports.clone().filter_map(|port| ports.lost(port)).max(),
            error_counts,
        }
    }

    /// Takes a read of one of its ports.
    pub(super) fn take(&mut self, ports: &mut Ports, session: &mut Session, read: SearchRead) {
        match &mut self.search {
            Some(search) => {
                search.feed(read);
                self.follow_search(ports, session);
            }
            None => self.feed(session, &read),
        }
    }

    /// Reports the search, if it goes on, what time it is.
    pub(super) fn advance(&mut self, ports: &mut Ports, session: &mut Session, now: Ns) {
        if let Some(search) = &mut self.search {
            search.advance(now);
            self.follow_search(ports, session);
        }
    }

    /// Begins the search again where settings that were found give nothing but damaged bytes.
    pub(super) fn check_found_line(&mut self, ports: &mut Ports, session: &Session) {
        let Some((check, number)) = self.check.as_mut().zip(self.number) else { return };
        let Some(damage) = check.damage(session, number) else { return };
        let line = ports.line(self.ports.start).map_or(String::new(), |line| format!(" at {line}"));
        self.say(ports, &format!("no valid frame in the last {damage} bytes{line}"));
        self.begin_search(ports);
    }

    /// Reports a search that has found nothing by now, decodes what it heard with the settings of the time, and ends what is
    /// in progress on the lines.
    pub(super) fn end(&mut self, ports: &mut Ports, session: &mut Session, now: Ns) {
        if let Some(search) = self.search.take() {
            self.say(ports, &search.diagnosis());
            for (line, read) in search.heard() {
                self.begin_decoding(ports, session, Some(line), None);
                self.feed(session, read);
            }
        }
        for port in self.ports.clone() {
            let end = SearchRead { port, line: ports.side(port), time: now, follows_loss: true, ..SearchRead::default() };
            self.feed(session, &end);
        }
    }

    /// Records all reads from now on, and those that are not decoded yet.
    pub(super) fn record(&mut self, recorder: Feed, ports: &Ports) {
        self.recorder = Some(recorder);
        if self.number.is_some() {
            self.describe_to_recorder(ports);
            self.record_directly(ports);
        }
    }

    /// Lets reads go to the recorder by themselves, now that none is in our hands.
    pub(super) fn record_directly(&mut self, ports: &Ports) {
        if !std::mem::take(&mut self.awaits_recording) {
            return;
        }
        // A line that is full is read less often, unless the recording shall have the times of all reads.
        let char_ns = if self.recorder.is_some() { 0 } else { self.line.map_or(0, |line| line.char_ns()) };
        for (side, port) in self.ports.clone().enumerate() {
            ports.inbox.set_char_ns(port, char_ns);
            if let Some((recorder, &number)) = self.recorder.as_ref().zip(self.recorded_as.get(side)) {
                ports.inbox.record(port, recorder.clone(), number);
            }
        }
    }

    fn say(&self, ports: &mut Ports, text: &str) {
        ports.messages.push(format!("{}: {text}", self.template.bus.name));
    }

    fn set_line(&self, ports: &mut Ports, line: LineSettings) {
        self.ports.clone().for_each(|port| ports.set_line(port, line));
    }

    /// Searches the settings, for the first time or again.
    fn begin_search(&mut self, ports: &mut Ports) {
        self.ports.clone().for_each(|port| ports.inbox.stop_recording(port));
        let marks_errors = self.ports.clone().all(|port| ports.marks_errors(port));
        // Lines with settings have serial framing only.
        let mode = self.template.mode.filter(|mode| *mode != Mode::Tcp);
        let search = LineSearch::new(SearchOptions { marks_errors, mode, ..SearchOptions::default() });
        self.say(ports, "detecting the line settings; waiting for traffic");
        self.set_line(ports, search.line());
        (self.search, self.check, self.origin) = (Some(search), None, Origin::Searching);
    }

    /// Sets the ports to what the search tries next, or begins to decode with what it has found.
    fn follow_search(&mut self, ports: &mut Ports, session: &mut Session) {
        let Some(mut search) = self.search.take() else { return };
        for text in search.take_messages() {
            self.say(ports, &text);
        }
        if ports.line(self.ports.start) != Some(search.line()) {
            self.set_line(ports, search.line());
            search.line_was_set(ports.now_ns());
        }
        let Some(found) = search.found() else {
            self.search = Some(search);
            return;
        };
        // Errors so far were caused by wrong settings.
        self.ports.clone().for_each(|port| ports.reset_error_counts(port));
        self.say(ports, &format!("found {}", found.evidence));
        (self.origin, self.check) = (Origin::Found, Some(LineCheck::default()));
        self.begin_decoding(ports, session, Some(found.line), Some(found.mode));
        for read in &found.reads {
            self.feed(session, read);
        }
    }

    /// Adds the bus to session and recording, or the same one with other settings, which a later search has found.
    fn begin_decoding(&mut self, ports: &Ports, session: &mut Session, line: Option<LineSettings>, mode: Option<Mode>) {
        if self.number.is_none() || self.line != line {
            let mode = mode.or(self.template.mode);
            self.number = Some(session.add_bus(BusOptions { line, mode, ..self.template.clone() }));
            self.line = line;
            self.describe_to_recorder(ports);
        }
        self.awaits_recording = true;
    }

    /// Describes the ports with their settings in the recording.
    fn describe_to_recorder(&mut self, ports: &Ports) {
        let Some(recorder) = &self.recorder else { return };
        let has_sides = self.ports.len() > 1;
        self.recorded_as.clear();
        for (port, letter) in self.ports.clone().zip(LETTERS) {
            self.recorded_as.push(recorder.add_port(&RecordedPort {
                name: ports.name(port).to_owned(),
                bus: self.template.bus.name.clone(),
                line: has_sides.then(|| letter.to_owned()),
                settings: self.line,
            }));
        }
        self.awaits_recording = true;
    }

    /// Passes a read to the engine. A loss is fed first, without bytes: it closes what came before only after all that time
    /// alone decides has been decided. The recording has the same, so that a replay gives the same rows.
    fn feed(&mut self, session: &mut Session, read: &SearchRead) {
        if read.follows_loss && !read.bytes.is_empty() {
            self.put(session, &SearchRead { bytes: Vec::new(), errors: Vec::new(), ..read.clone() });
        }
        self.put(session, read);
    }

    /// Passes a read to the engine, and to the recorder unless that has it already.
    fn put(&mut self, session: &mut Session, read: &SearchRead) {
        let Some(number) = self.number else { return };
        let (bytes, follows_loss) = (read.bytes.as_slice(), read.follows_loss);
        let recorded_as = self.recorded_as.get(read.port - self.ports.start);
        if let Some((recorder, &port)) = self.recorder.as_ref().zip(recorded_as).filter(|_| !read.is_recorded) {
            recorder.write(port, &PortRead { time: read.time, bytes, errors: &read.errors, hole: follows_loss });
        }
        let (times, error_positions) = (Times::Read(read.time), read.errors.as_slice());
        session.feed(number, &Chunk { bytes, line: read.line, times, error_positions, follows_loss, ..Chunk::default() });
    }
}
