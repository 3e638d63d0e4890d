//! Reads the metadata that modlens itself has written into a pcapng file, in custom options with our enterprise number.
//!
//! Raw recordings state which ports are the lines of one bus, and exports state for each packet which row it is. Both are
//! text: a first word, then `key=value` pairs separated by spaces. What writes recordings is
//! `modlens_pcapng::recording`, what writes exports `modlens_writers::capture`.

use std::borrow::Cow;

use pcap_parser::{OptionCode, PcapNGOption};

use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::renamed::{former, Vocabulary};
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Number under which our custom options stand: the one that RFC 5612 keeps for documentation, until modlens has its own.
pub const ENTERPRISE: u32 = 32_473;

const COMMENT: u16 = 1;

/// The metadata of an interface: the serial port or the bus whose bytes it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct PortMetadata {
    /// The raw recording whose reads these are; `None` for an export of decoded frames.
    pub recording: Option<RecordingSegment>,
    /// The name of the bus.
    pub name: String,
    /// Which line of a two-line tap: 1 is A, 2 is B, 0 is the only line.
    pub line: u8,
    /// Line settings, where they were known.
    pub settings: Option<LineSettings>,
    /// The kind of clock that the bus had.
    pub clock: Clock,
    /// The first moment of the recording that was exported, in ns.
    pub origin: Option<Ns>,
}

/// The place of a file in a raw recording, which a tap may split into several files.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingSegment {
    /// An identifier that all files of one run of a tap share.
    pub session: String,
    /// Number of the file, from 1.
    pub number: u64,
    /// Number of the bus of this port; ports with the same number are the lines of one bus.
    pub bus: u64,
}

impl PortMetadata {
    /// Parses the metadata of a section and of an interface; `None` if modlens has written neither.
    pub fn read(section: &str, metadata: &str) -> Option<Self> {
        let (kind, _) = metadata.split_once(' ')?;
        // The name comes last, because it may contain spaces.
        let (metadata, name) = metadata.split_once(" name=")?;
        let recording = match kind {
            "recording" => Some(RecordingSegment {
                session: value(section, "session")?.to_owned(),
                number: number(section, "segment")?,
                bus: number(metadata, "bus")?,
            }),
            "export" => None,
            _ => return None,
        };
        Some(Self {
            name: name.to_owned(),
            line: match value(metadata, "line") {
                None => 0,
                Some("A") => 1,
                Some(_) => 2,
            },
            settings: value(metadata, "settings").and_then(|text| text.parse().ok()),
            clock: match value(metadata, "clock") {
                Some("relative") => Clock::Relative,
                Some("none") => Clock::None,
                _ => Clock::Utc,
            },
            origin: value(metadata, "origin_ns").and_then(|text| text.parse().ok()),
            recording,
        })
    }
}

/// The metadata of a packet that modlens has exported: its frame, and the transactions that are complete with it.
#[derive(Clone, Debug)]
pub struct PacketMetadata<'a> {
    /// All metadata of the frame, as text.
    pub frame: &'a str,
    /// The part of it that every frame has, parsed.
    pub fields: FrameMetadata,
    /// The metadata of each transaction, as text.
    pub transactions: Vec<&'a str>,
    /// The comments of the packet, findings among them.
    pub comments: Vec<&'a str>,
    /// The bytes that were on the line.
    pub bytes: Cow<'a, [u8]>,
}

/// Default values, which are not written because most frames of a serial line have them.
#[derive(Clone, Copy, Debug)]
pub struct Defaults {
    /// The framing.
    pub mode: Mode,
    /// The verdict on the frame.
    pub verdict: Verdict,
    /// The evidence that delimited the frame.
    pub delimited_by: DelimitedBy,
    /// The log2 odds that the row is right.
    pub confidence: u8,
    /// The status of a transaction.
    pub status: Status,
}

/// The defaults on which writer and reader have to agree.
pub const DEFAULTS: Defaults =
    Defaults { mode: Mode::Rtu, verdict: Verdict::Ok, delimited_by: DelimitedBy::Length, confidence: 15, status: Status::Ok };

/// The metadata that every frame has.
#[derive(Clone, Copy, Debug)]
pub struct FrameMetadata {
    /// Number of the frame, from 1.
    pub number: u64,
    /// The framing.
    pub mode: Mode,
    /// The verdict on the frame.
    pub verdict: Verdict,
    /// Whether it is a request or a response.
    pub direction: Direction,
    /// The evidence that delimited the frame.
    pub delimited_by: DelimitedBy,
}

impl FrameMetadata {
    /// Parses the metadata of a frame; `None` if modlens has not written it.
    pub fn read(metadata: &str) -> Option<Self> {
        Some(Self {
            number: number(metadata, "frame").filter(|&number| number > 0)?,
            mode: value_or_default(metadata, "mode", DEFAULTS.mode, |name| {
                named(&[Mode::Rtu, Mode::Ascii, Mode::Tcp], Mode::text, name)
            })?,
            verdict: value_or_default(metadata, "verdict", DEFAULTS.verdict, |name| named(&Verdict::ALL, Verdict::text, name))?,
            direction: named(
                &[Direction::Request, Direction::Response, Direction::Unknown],
                Direction::text,
                value(metadata, "direction"),
            )?,
            delimited_by: value_or_default(metadata, "delimited_by", DEFAULTS.delimited_by, |name| {
                named(&DelimitedBy::ALL, DelimitedBy::text, name)
            })?,
        })
    }
}

/// The metadata in the options of a packet; `None` if there is none on a frame.
pub fn packet_metadata<'a>(options: &'a [PcapNGOption<'a>], bytes: &'a [u8]) -> Option<PacketMetadata<'a>> {
    let mut all = self::custom_texts(options);
    let frame = all.next().filter(|text| text.starts_with("frame="))?;
    let fields = FrameMetadata::read(frame)?;
    let transactions = all.filter(|text| text.starts_with("transaction=")).collect();
    let comments = options.iter().filter(|option| option.code.0 == COMMENT);
    let comments = comments.filter_map(|option| std::str::from_utf8(option.as_bytes().ok()?).ok()).collect();
    let bytes = match value(frame, "wire") {
        Some(digits) => Cow::Owned(unhex(digits)?),
        None => Cow::Borrowed(bytes),
    };
    Some(PacketMetadata { frame, fields, transactions, comments, bytes })
}

/// The positions of the bytes in a read for which the receiver reported an error.
pub fn errors(options: &[PcapNGOption<'_>]) -> Vec<u32> {
    let listed = custom_texts(options).find_map(|text| text.strip_prefix("errors="));
    listed.map_or(Vec::new(), |text| text.split(',').filter_map(|place| place.parse().ok()).collect())
}

/// The texts of all custom options that modlens has written.
pub fn custom_texts<'a>(options: &'a [PcapNGOption<'a>]) -> impl Iterator<Item = &'a str> {
    let custom = options.iter().filter(|option| option.code == OptionCode::Custom2988);
    custom.filter_map(|option| {
        let (enterprise, text) = option.as_bytes().ok()?.split_first_chunk()?;
        // The number is in the byte order of the machine that wrote the file.
        let ours = [u32::from_le_bytes(*enterprise), u32::from_be_bytes(*enterprise)].contains(&ENTERPRISE);
        std::str::from_utf8(text).ok().filter(|_| ours)
    })
}

/// The value of a key, which may have its former spelling, if it is there.
pub fn value<'a>(metadata: &'a str, key: &str) -> Option<&'a str> {
    let of = |key: &str| metadata.split(' ').find_map(|word| word.strip_prefix(key)?.strip_prefix('='));
    of(key).or_else(|| of(former(Vocabulary::Column, key)?))
}

/// The value of a key as `read` parses it, or the default if the key is missing; `None` if `read` cannot parse it.
pub fn value_or_default<T>(metadata: &str, key: &str, default: T, read: impl FnOnce(Option<&str>) -> Option<T>) -> Option<T> {
    match value(metadata, key) {
        None => Some(default),
        name => read(name),
    }
}

/// The value of a key as a number; `None` if it is missing or no number.
pub fn number(metadata: &str, key: &str) -> Option<u64> {
    value(metadata, key)?.parse().ok()
}

/// The value of a key in microseconds with up to three decimals, converted to ns.
pub fn micros(metadata: &str, key: &str) -> Option<Ns> {
    let text = value(metadata, key)?;
    let (sign, digits) = text.strip_prefix('-').map_or((1, text), |rest| (-1, rest));
    let (whole, rest) = digits.split_once('.').unwrap_or((digits, ""));
    let part = format!("{rest:0<3}");
    Some(sign * (whole.parse::<Ns>().ok()?.checked_mul(1000)? + part.get(..3)?.parse::<Ns>().ok()?))
}

/// The value in `all` whose text is `name`.
pub fn named<T: Copy>(all: &[T], text: fn(T) -> &'static str, name: Option<&str>) -> Option<T> {
    all.iter().copied().find(|one| Some(text(*one)) == name)
}

/// Decodes hex digits; `None` for an odd number of digits or another character.
pub fn unhex(digits: &str) -> Option<Vec<u8>> {
    let pairs = digits.as_bytes().chunks(2);
    pairs.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok().filter(|_| pair.len() == 2)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_of_ports_is_parsed() {
        let port =
            PortMetadata::read("recording session=ab segment=3", "recording bus=1 line=B settings=9600-8N2 name=a b=c").unwrap();
        assert_eq!(port.recording, Some(RecordingSegment { session: "ab".into(), number: 3, bus: 1 }));
        assert_eq!((port.name.as_str(), port.line, port.settings), ("a b=c", 2, "9600-8N2".parse().ok()));
        let port = PortMetadata::read("", "export clock=relative origin_ns=-5 name=x").unwrap();
        assert_eq!((port.recording, port.clock, port.origin, port.line), (None, Clock::Relative, Some(-5), 0));
        for other in ["", "frame=1", "recording bus=1 name=without a session", "export clock=utc"] {
            assert_eq!(PortMetadata::read("", other), None);
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
