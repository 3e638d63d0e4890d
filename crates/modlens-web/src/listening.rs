//! A port that the page listens to: its reads become a raw recording, which is decoded like that of a tap.

use modlens_engine::line_search::{LineSearch, SearchOptions, SearchRead};
use modlens_pcapng::recording::{self, PortRead};
use modlens_protocol::framing::Mode;
use modlens_protocol::hex::parse_hex;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::port::Port;
use crate::Decoding;

impl Decoding {
    /// Begins the recording of a port: `name`, and `line` where the settings are known; else they are searched.
    /// Answers like [`Self::read`].
    pub fn listen(&mut self, question: &Json) -> Result<Json, String> {
        let name = question["name"].as_str().unwrap_or("port").to_owned();
        let line: Option<LineSettings> = question["line"].as_str().filter(|text| !text.is_empty()).map(str::parse).transpose()?;
        // Browsers take damaged bytes out of what they read, and mark none.
        let mode = self.mode.filter(|mode| *mode != Mode::Tcp);
        let options = SearchOptions { marks_errors: false, drops_damaged: true, mode };
        let search = line.is_none().then(|| LineSearch::new(options));
        let mut blocks = Vec::new();
        recording::head(&format!("modlens {}", env!("CARGO_PKG_VERSION")), "page", 1, &mut blocks);
        self.record(&blocks)?;
        self.port = Some(Port { name, line, search, next_interface: 0 });
        if let Some(line) = line {
            self.describe(line)?;
        }
        Ok(self.listening(Vec::new()))
    }

    /// Takes a read of the port: its bytes in `hex`, the `time` when it returned (nanoseconds, as text), and whether there
    /// is a `hole` before the bytes. Without bytes and without a hole it only says that time has come so far; `is_set` says
    /// that the port has the settings that were asked for by then. Answers the `line` to listen with, whether it is
    /// `searching`, and what there is to be `said`.
    pub fn read(&mut self, question: &Json) -> Result<Json, String> {
        let bytes = parse_hex(question["hex"].as_str().unwrap_or_default()).ok_or("bytes are not in hex")?;
        let time: Ns = question["time"].as_str().and_then(|text| text.parse().ok()).ok_or("a read without a time")?;
        let hole = question["hole"].as_bool().unwrap_or_default();
        let port = self.port.as_mut().ok_or("no port is listened to")?;
        let Some(search) = &mut port.search else {
            self.take_read(time, &bytes, hole)?;
            return Ok(self.listening(Vec::new()));
        };
        if question["is_set"].as_bool().unwrap_or_default() {
            search.line_was_set(time);
        }
        search.feed(SearchRead { time, bytes, follows_loss: hole, ..SearchRead::default() });
        search.advance(time);
        let mut said = search.take_messages();
        if let Some(found) = search.found().cloned() {
            port.search = None;
            said.push(format!("found {}", found.evidence));
            self.describe(found.line)?;
            for read in &found.reads {
                self.take_read(read.time, &read.bytes, read.follows_loss)?;
            }
        }
        Ok(self.listening(said))
    }

    /// Ends the recording of the port. What a search heard in vain is decoded with the settings of the time. Answers like
    /// [`Self::read`].
    pub fn hang_up(&mut self, question: &Json) -> Result<Json, String> {
        let port = self.port.as_mut().ok_or("no port is listened to")?;
        let mut said = Vec::new();
        if let Some(search) = port.search.take() {
            said.push(search.diagnosis());
            for (line, read) in search.heard() {
                self.describe(line)?;
                self.take_read(read.time, &read.bytes, read.follows_loss)?;
            }
        }
        if let Some(time) = question["time"].as_str().and_then(|text| text.parse().ok()) {
            self.take_read(time, &[], true)?;
        }
        Ok(self.listening(said))
    }

    fn listening(&self, said: Vec<String>) -> Json {
        let port = self.port.as_ref();
        let search = port.and_then(|port| port.search.as_ref());
        let line = search.map(LineSearch::line).or(port.and_then(|port| port.line));
        json!({"line": line.map(|line| line.to_string()), "searching": search.is_some(), "said": said})
    }

    /// Describes the port with these settings, where the recording does not by now.
    fn describe(&mut self, line: LineSettings) -> Result<(), String> {
        let Some(port) = &mut self.port else { return Ok(()) };
        if port.next_interface > 0 && port.line == Some(line) {
            return Ok(());
        }
        port.line = Some(line);
        port.next_interface += 1;
        let mut blocks = Vec::new();
        recording::port(&port.name, (0, &port.name), None, Some(&line), &mut blocks);
        self.record(&blocks)
    }

    fn take_read(&mut self, time: Ns, bytes: &[u8], hole: bool) -> Result<(), String> {
        let described = self.port.as_ref().and_then(|port| port.next_interface.checked_sub(1));
        let Some(interface) = described else { return Ok(()) };
        let mut blocks = Vec::new();
        if bytes.is_empty() && !hole {
            recording::time(interface, time, &mut blocks);
            return self.feed(&blocks).map(drop);
        }
        recording::read(interface, &PortRead { time, bytes, errors: &[], hole }, &mut blocks);
        self.record(&blocks)
    }

    /// Decodes blocks of the recording, and keeps them for the page, which saves them.
    fn record(&mut self, blocks: &[u8]) -> Result<(), String> {
        self.captured.extend_from_slice(blocks);
        self.feed(blocks).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::answer;

    /// Three exchanges (Application Protocol V1.1b3, 6.3); bytes were lost before the last one.
    #[test]
    fn reads_of_a_port_are_decoded_and_recorded() {
        let mut decoding = Decoding::open(&json!({"purpose": "live", "format": "pcapng", "name": "port"})).expect("valid");
        answer(&mut decoding, &json!({"call": "listen", "name": "port", "line": "19200-8E1"})).expect("a port");
        let exchanges = ["010300000001840a0103020007f986"; 3];
        for (at, hex) in exchanges.iter().enumerate() {
            let time = (1_700_000_000_000_000_000 + at as i64 * 100_000_000).to_string();
            answer(&mut decoding, &json!({"call": "read", "hex": hex, "time": time, "hole": at == 2})).expect("a read");
        }
        let mut recording = Vec::new();
        decoding.export_more(&mut recording);
        assert_eq!(decoding.finish(), Ok(3));
        let mut again = Decoding::open(&json!({"purpose": "live", "format": "pcapng", "name": "port"})).expect("valid");
        again.feed(&recording).expect("a recording");
        assert_eq!(again.finish(), Ok(3));
        let rows = |decoding: &mut Decoding| {
            answer(decoding, &json!({"call": "rows", "columns": ["time", "unit", "data", "status"], "from": 0, "count": 9}))
                .expect("rows")
        };
        assert_eq!(rows(&mut decoding), rows(&mut again));
        assert_eq!(rows(&mut again)["rows"][0][1], "1");
        assert!(answer(&mut again, &json!({"call": "read", "hex": "0", "time": "1"})).is_err());
    }

    /// The line is 115200-8E1, the first settings that are tried.
    #[test]
    fn settings_are_found_and_what_was_heard_with_them_is_decoded() {
        let mut decoding = Decoding::open(&json!({"purpose": "live", "format": "pcapng", "name": "port"})).expect("valid");
        let begun = answer(&mut decoding, &json!({"call": "listen", "name": "port", "line": ""})).expect("a port");
        assert_eq!((begun["line"].as_str(), begun["searching"].as_bool()), (Some("115200-8E1"), Some(true)));
        let mut said = Vec::new();
        for at in 0..3_i64 {
            let time = (1_700_000_000_000_000_000 + at * 100_000_000).to_string();
            let read = json!({"call": "read", "hex": "010300000001840a0103020007f986", "time": time});
            let answered = answer(&mut decoding, &read).expect("a read");
            assert_eq!((answered["line"].as_str(), answered["searching"].as_bool()), (Some("115200-8E1"), Some(false)));
            said.push(answered["said"].to_string());
        }
        assert!(said.concat().contains("found 115200-8E1, rtu"), "{said:?}");
        answer(&mut decoding, &json!({"call": "hang_up", "time": "1700000009000000000"})).expect("an end");
        assert_eq!(decoding.finish(), Ok(3));
    }

    /// Bytes that no settings explain are in the recording, with the settings of the time.
    #[test]
    fn a_search_in_vain_loses_nothing() {
        let mut decoding = Decoding::open(&json!({"purpose": "live", "format": "pcapng", "name": "port"})).expect("valid");
        answer(&mut decoding, &json!({"call": "listen", "name": "port"})).expect("a port");
        answer(&mut decoding, &json!({"call": "read", "hex": "a1b2c3", "time": "1700000000000000000"})).expect("a read");
        let said = answer(&mut decoding, &json!({"call": "hang_up", "time": "1700000001000000000"})).expect("an end");
        assert!(said["said"].to_string().contains("no line settings fit the 3 bytes"), "{said}");
        let mut recording = Vec::new();
        decoding.export_more(&mut recording);
        assert!(recording.windows(3).any(|bytes| bytes == [0xa1, 0xb2, 0xc3]));
    }

    /// A recording of a tap that was cut off after a request: nothing says that its port was closed.
    #[test]
    fn what_a_recording_ends_with_is_a_row() {
        let mut decoding = Decoding::open(&json!({"purpose": "live", "format": "pcapng", "name": "port"})).expect("valid");
        answer(&mut decoding, &json!({"call": "listen", "name": "port", "line": "9600-8E1"})).expect("a port");
        let read = json!({"call": "read", "hex": "010300000001840a", "time": "1700000000000000000"});
        answer(&mut decoding, &read).expect("a read");
        let mut recording = Vec::new();
        decoding.export_more(&mut recording);
        let mut again = Decoding::open(&json!({"purpose": "all", "format": "pcapng", "name": "cut off"})).expect("valid");
        again.feed(&recording).expect("a recording");
        assert_eq!(again.finish(), Ok(1));
    }
}
