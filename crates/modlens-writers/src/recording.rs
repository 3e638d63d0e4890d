//! Raw recordings: every read of a tap with its time, as it came, in pcapng of link type 250 (RTAC serial).
//!
//! The form, for whoever reads it:
//!
//! - One section header; option 4 (application) is `modlens VERSION`; our custom option (2988, PEN 32473) is
//!   `recording session=ID segment=N`. All files of one start of a tap have the same session and count their segments.
//! - One interface block per port, link type 250, times in ns. Option 2 is the port, option 8 the baud rate, and our
//!   custom option is `recording bus=NUMBER line=A settings=19200-8E1 name=NAME`: ports with the same bus number are the
//!   lines of one bus (`line` is there for two-line taps only, `settings` where they are known), and the name, which
//!   may hold spaces, is the rest of the text.
//! - One packet block a read. Its time is when the read returned: never before the last byte's stop bit. Its bytes are
//!   the RTAC header (big-endian `u32` seconds, `u32` microseconds, `u8` event, `u8` control lines, `u16` footer), then the
//!   bytes of the line. The events are those of the link type: 2 for bytes, 5 where bytes were lost before these, 8 where
//!   the receiver marked some of them (parity, framing, break), 6, without bytes, where the port went away or the tap
//!   ended; which ones were marked stands in our custom option of the packet, as
//!   `errors=3,7`. Nothing is said of who sent them: 2 is "received", because a tap receives.
//!
//! Blocks are complete in themselves: a file that was cut off anywhere is read up to its last whole block.

use std::fmt::Write as _;

use super::capture::blocks::{self, Interface};
use modlens_protocol::line::Line;
use modlens_protocol::Ns;

/// RTAC serial.
pub const LINK_RTAC: u16 = 250;

const RECEIVED: u8 = 2;
const LOST: u8 = 5;
const ENDED: u8 = 6;
const MARKED: u8 = 8;

/// What a port gave.
#[derive(Clone, Copy, Debug, Default)]
pub struct Read<'a> {
    /// When the read returned.
    pub time: Ns,
    /// The bytes.
    pub bytes: &'a [u8],
    /// Those of them that the receiver marked.
    pub errors: &'a [u32],
    /// Bytes were lost before these.
    pub hole: bool,
}

/// The beginning of a segment.
pub fn head(application: &str, session: &str, segment: u64, out: &mut Vec<u8>) {
    let words = format!("recording session={session} segment={segment}");
    blocks::section_with(application, "", &words, out);
}

/// A port of the tap: `bus` is the number of its bus, `line` its line's letter on a two-line tap.
pub fn port(name: &str, bus: (usize, &str), line: Option<&str>, settings: Option<&Line>, out: &mut Vec<u8>) {
    let spelled = settings.map(super::capture::settings);
    let mut custom = format!("recording bus={}", bus.0);
    for (key, value) in [("line", line), ("settings", spelled.as_deref())] {
        if let Some(value) = value {
            let _ = write!(custom, " {key}={value}");
        }
    }
    let _ = write!(custom, " name={}", bus.1);
    let described = spelled.map_or(String::new(), |text| format!(", {text}"));
    let what = Interface {
        link: LINK_RTAC,
        name,
        description: &format!("reads of a Modbus tap{described}"),
        speed: settings.map(|line| u64::from(line.baud)),
        digits: 9,
        custom: &custom,
    };
    blocks::interface(&what, out);
}

/// One read of a port, by the number of its interface block.
pub fn read(interface: u32, read: &Read<'_>, out: &mut Vec<u8>) {
    let time = read.time.max(0) as u64;
    let event = match (read.hole, read.errors) {
        (true, _) if read.bytes.is_empty() => ENDED,
        (true, _) => LOST,
        (false, []) => RECEIVED,
        _ => MARKED,
    };
    let start = blocks::begin_packet(interface, time, out);
    out.extend_from_slice(&((time / 1_000_000_000) as u32).to_be_bytes());
    out.extend_from_slice(&((time % 1_000_000_000 / 1000) as u32).to_be_bytes());
    out.extend_from_slice(&[event, 0, 0, 0]);
    out.extend_from_slice(read.bytes);
    blocks::end_bytes(start, out);
    if !read.errors.is_empty() {
        let places: Vec<String> = read.errors.iter().map(u32::to_string).collect();
        blocks::custom(out, |out| out.extend_from_slice(format!("errors={}", places.join(",")).as_bytes()));
        blocks::end_options(out);
    }
    blocks::end_block(start, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_has_the_header_of_its_link_type() {
        let mut out = Vec::new();
        let bytes = &[1, 6, 0, 1, 0, 3, 0x98, 0x0B];
        read(0, &Read { time: 1_700_000_000_123_456_789, bytes, ..Read::default() }, &mut out);
        let payload = modlens_protocol::hex::hex(&out[28..48]);
        assert_eq!(payload, "6553f1000001e240020000000106000100 03980b".replace(' ', ""));
        assert_eq!(out.len(), 28 + 20 + 4);
    }
}
