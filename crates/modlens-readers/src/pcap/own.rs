//! What modlens itself has written into a capture: custom options with the number of our enterprise.
//!
//! Raw recordings (`write/recording.rs`) say which ports are the lines of one bus, exports (`write/capture/words.rs`) say of
//! each packet which row it is. Both are text: a first word, then `key=value` separated by spaces.

use std::borrow::Cow;

use pcap_parser::{OptionCode, PcapNGOption};

use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::line::Line;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Number under which our custom options stand: the one that RFC 5612 keeps for documentation, until modlens has its own.
pub const ENTERPRISE: u32 = 32_473;

const COMMENT: u16 = 1;

/// What is told of a port.
#[derive(Clone, Debug, PartialEq)]
pub struct Port {
    /// Reads of a tap, of this recording; `None` for decoded frames.
    pub recording: Option<Segment>,
    /// The name of its bus.
    pub name: String,
    /// Which line of the bus: 0 for the only one.
    pub line: u8,
    /// Line settings.
    pub settings: Option<Line>,
    /// What clock the bus had.
    pub clock: Clock,
    /// The first moment of the recording that was exported.
    pub origin: Option<Ns>,
}

/// Of which recording, and which part of it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Segment {
    /// The same for all files of one start of a tap.
    pub session: String,
    /// Number of the file, from 1.
    pub number: u64,
    /// The bus of this port: those with the same number are its lines.
    pub bus: u64,
}

impl Port {
    /// Takes the words of a section and of an interface apart; `None` if they are not these.
    pub fn read(section: &str, words: &str) -> Option<Self> {
        let (kind, _) = words.split_once(' ')?;
        // Last: names may hold spaces.
        let (words, name) = words.split_once(" name=")?;
        let recording = match kind {
            "recording" => Some(Segment {
                session: value(section, "session")?.to_owned(),
                number: number(section, "segment")?,
                bus: number(words, "bus")?,
            }),
            "export" => None,
            _ => return None,
        };
        Some(Self {
            name: name.to_owned(),
            line: match value(words, "line") {
                None => 0,
                Some("A") => 1,
                Some(_) => 2,
            },
            settings: value(words, "settings").and_then(|text| text.parse().ok()),
            clock: match value(words, "clock") {
                Some("relative") => Clock::Relative,
                Some("none") => Clock::None,
                _ => Clock::Utc,
            },
            origin: value(words, "origin_ns").and_then(|text| text.parse().ok()),
            recording,
        })
    }
}

/// A packet that modlens has exported: its frame, and rows that are complete with it.
#[derive(Clone, Debug)]
pub struct Told<'a> {
    /// The words on the frame.
    pub frame: &'a str,
    /// Those that every frame has.
    pub words: Words,
    /// The words on transactions.
    pub transactions: Vec<&'a str>,
    /// The comments; findings are among them.
    pub comments: Vec<&'a str>,
    /// The bytes of the line.
    pub bytes: Cow<'a, [u8]>,
}

/// The values of words that are left out, because most frames of a serial line have them.
#[derive(Clone, Copy, Debug)]
pub struct Usual {
    /// Framing.
    pub mode: Mode,
    /// What a frame is worth.
    pub verdict: Verdict,
    /// What ended it.
    pub cut_by: CutBy,
    /// Bits between it and its best rival.
    pub confidence: u8,
    /// How a transaction ended.
    pub status: Status,
}

/// The usual values: what writes captures and what reads them back must agree.
pub const USUAL: Usual =
    Usual { mode: Mode::Rtu, verdict: Verdict::Ok, cut_by: CutBy::Length, confidence: 60, status: Status::Ok };

/// The words on a frame, taken apart.
#[derive(Clone, Copy, Debug)]
pub struct Words {
    /// Number of the frame, from 1.
    pub number: u64,
    /// Framing.
    pub mode: Mode,
    /// What it was worth.
    pub verdict: Verdict,
    /// Who had sent it.
    pub direction: Direction,
    /// What had ended it.
    pub cut_by: CutBy,
}

impl Words {
    /// Takes them apart; `None` if they are not ours.
    pub fn read(words: &str) -> Option<Self> {
        Some(Self {
            number: number(words, "frame").filter(|&number| number > 0)?,
            mode: unusual(words, "mode", USUAL.mode, |name| named(&[Mode::Rtu, Mode::Ascii, Mode::Tcp], Mode::text, name))?,
            verdict: unusual(words, "verdict", USUAL.verdict, |name| named(&Verdict::ALL, Verdict::text, name))?,
            direction: named(
                &[Direction::Request, Direction::Response, Direction::Unknown],
                Direction::text,
                value(words, "direction"),
            )?,
            cut_by: unusual(words, "cut_by", USUAL.cut_by, |name| named(&CutBy::ALL, CutBy::text, name))?,
        })
    }
}

/// What is told of a packet; `None` if it has no words on a frame.
pub fn told<'a>(options: &'a [PcapNGOption<'a>], bytes: &'a [u8]) -> Option<Told<'a>> {
    let mut all = self::words(options);
    let frame = all.next().filter(|words| words.starts_with("frame="))?;
    let words = Words::read(frame)?;
    let transactions = all.filter(|words| words.starts_with("transaction=")).collect();
    let comments = options.iter().filter(|option| option.code.0 == COMMENT);
    let comments = comments.filter_map(|option| std::str::from_utf8(option.as_bytes().ok()?).ok()).collect();
    let bytes = match value(frame, "wire") {
        Some(digits) => Cow::Owned(unhex(digits)?),
        None => Cow::Borrowed(bytes),
    };
    Some(Told { frame, words, transactions, comments, bytes })
}

/// Places of the bytes in a read that the receiver had marked.
pub fn errors(options: &[PcapNGOption<'_>]) -> Vec<u32> {
    let listed = words(options).find_map(|words| words.strip_prefix("errors="));
    listed.map_or(Vec::new(), |text| text.split(',').filter_map(|place| place.parse().ok()).collect())
}

/// Our own custom options.
pub fn words<'a>(options: &'a [PcapNGOption<'a>]) -> impl Iterator<Item = &'a str> {
    let custom = options.iter().filter(|option| option.code == OptionCode::Custom2988);
    custom.filter_map(|option| {
        let (enterprise, text) = option.as_bytes().ok()?.split_first_chunk()?;
        // In the byte order of whoever wrote the file.
        let ours = [u32::from_le_bytes(*enterprise), u32::from_be_bytes(*enterprise)].contains(&ENTERPRISE);
        std::str::from_utf8(text).ok().filter(|_| ours)
    })
}

/// The value of a key.
pub fn value<'a>(words: &'a str, key: &str) -> Option<&'a str> {
    words.split(' ').find_map(|word| word.strip_prefix(key)?.strip_prefix('='))
}

/// The value of a key as `read` takes it, or the usual one where the key is left out; `None` if it means nothing.
pub fn unusual<T>(words: &str, key: &str, usual: T, read: impl FnOnce(Option<&str>) -> Option<T>) -> Option<T> {
    match value(words, key) {
        None => Some(usual),
        name => read(name),
    }
}

/// The value of a key as a number.
pub fn number(words: &str, key: &str) -> Option<u64> {
    value(words, key)?.parse().ok()
}

/// Microseconds with up to three digits behind the point, in ns.
pub fn micros(words: &str, key: &str) -> Option<Ns> {
    let text = value(words, key)?;
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |rest| (-1, rest));
    let (whole, rest) = digits.split_once('.').unwrap_or((digits, ""));
    let part = format!("{rest:0<3}");
    Some(sign * (whole.parse::<Ns>().ok()?.checked_mul(1000)? + part.get(..3)?.parse::<Ns>().ok()?))
}

/// The value of that name.
pub fn named<T: Copy>(all: &[T], text: fn(T) -> &'static str, name: Option<&str>) -> Option<T> {
    all.iter().copied().find(|one| Some(text(*one)) == name)
}

/// Bytes of hex digits.
pub fn unhex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok().filter(|_| pair.len() == 2)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_on_ports_are_read() {
        let port = Port::read("recording session=ab segment=3", "recording bus=1 line=B settings=9600-8N2 name=a b=c").unwrap();
        assert_eq!(port.recording, Some(Segment { session: "ab".into(), number: 3, bus: 1 }));
        assert_eq!((port.name.as_str(), port.line, port.settings), ("a b=c", 2, "9600-8N2".parse().ok()));
        let port = Port::read("", "export clock=relative origin_ns=-5 name=x").unwrap();
        assert_eq!((port.recording, port.clock, port.origin, port.line), (None, Clock::Relative, Some(-5), 0));
        for other in ["", "frame=1", "recording bus=1 name=without a session", "export clock=utc"] {
            assert_eq!(Port::read("", other), None);
        }
    }

    #[test]
    fn microseconds_are_exact() {
        for (text, ns) in [("0", 0), ("1234.567", 1_234_567), ("1.5", 1500), ("-0.02", -20), ("7", 7000)] {
            assert_eq!(micros(&format!("a=1 gap_us={text}"), "gap_us"), Some(ns));
        }
        assert_eq!(micros("gap_us=x", "gap_us"), None);
    }
}
