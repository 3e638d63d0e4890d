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
}
