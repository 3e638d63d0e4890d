//! A port that the page listens to: its reads become a raw recording, which is decoded like that of a tap.

use modlens_pcapng::recording::{self, PortRead};
use modlens_protocol::hex::parse_hex;
use modlens_protocol::line::LineSettings;
use serde_json::Value as Json;

use crate::Decoding;

impl Decoding {
    /// Begins the recording of a port: `name`, and `line` where the settings are known.
    pub fn listen(&mut self, question: &Json) -> Result<(), String> {
        let name = question["name"].as_str().unwrap_or("port");
        let line: Option<LineSettings> = question["line"].as_str().filter(|text| !text.is_empty()).map(str::parse).transpose()?;
        let mut blocks = Vec::new();
        recording::head(&format!("modlens {}", env!("CARGO_PKG_VERSION")), "page", 1, &mut blocks);
        recording::port(name, (0, name), None, line.as_ref(), &mut blocks);
        self.record(&blocks)
    }

    /// Takes a read of the port: its bytes in `hex`, the `time` when it returned (nanoseconds, as text), and whether there
    /// is a `hole` before the bytes. Without bytes and without a hole it only says that time has come so far.
    pub fn read(&mut self, question: &Json) -> Result<(), String> {
        let bytes = parse_hex(question["hex"].as_str().unwrap_or_default()).ok_or("bytes are not in hex")?;
        let time = question["time"].as_str().and_then(|text| text.parse().ok()).ok_or("a read without a time")?;
        let hole = question["hole"].as_bool().unwrap_or_default();
        let mut blocks = Vec::new();
        if bytes.is_empty() && !hole {
            recording::time(0, time, &mut blocks);
            return self.feed(&blocks).map(drop);
        }
        recording::read(0, &PortRead { time, bytes: &bytes, errors: &[], hole }, &mut blocks);
        self.record(&blocks)
    }

    /// Decodes blocks of the recording, and keeps them for the page, which saves them.
    fn record(&mut self, blocks: &[u8]) -> Result<(), String> {
        self.captured.extend_from_slice(blocks);
        self.feed(blocks).map(drop)
    }
}
