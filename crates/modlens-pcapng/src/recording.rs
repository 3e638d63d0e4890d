//! Raw recordings: every read of a tap with its time, unchanged, in pcapng with link type 250 (RTAC serial).
//!
//! The format:
//!
//! - One section header. Option 4 (application) is `modlens VERSION`; our custom option (2988, PEN 32473) is
//!   `recording session=ID segment=N`. All files written after one start of a tap have the same session and number
//!   their segments.
//! - One interface block per port, with link type 250 and times in ns. Option 2 is the port, option 8 the baud rate, and
//!   our custom option is `recording bus=NUMBER line=A settings=19200-8E1 name=NAME`: ports with the same bus number are
//!   the lines of one bus (`line` is present for two-line taps only, `settings` if they are known). The name is the rest
//!   of the text and may contain spaces.
//! - One packet block per read. Its time is when the read returned, which is never before the stop bit of the last byte.
//!   Its data are the RTAC header (big-endian `u32` seconds, `u32` microseconds, `u8` event, `u8` control lines, `u16`
//!   footer), then the bytes of the line. The events are those of the link type: 2 for bytes; 5 if bytes were lost before
//!   these; 8 if the receiver reported errors for some of them (parity, framing, break); 6, without bytes, if the port
//!   disappeared or the tap ended. Our custom option of the packet lists the positions of the bytes with errors, as
//!   `errors=3,7`. Event 0, without bytes, is a clock that somebody has set: our custom option is `clock_step=NS`, by which
//!   the times of the port jump from here on; without the option it is a moment of a silent line, in streams only. The direction is not recorded: event 2 is "received" because a tap only receives.
//!
//! Blocks are self-contained: a file that was cut off anywhere can be read up to its last complete block.

use std::fmt::Write as _;

use crate::blocks::{self, Interface};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// Link type RTAC serial.
pub const LINK_RTAC: u16 = 250;

const STATUS: u8 = 0;
const RECEIVED: u8 = 2;
const BYTES_LOST: u8 = 5;
const PORT_CLOSED: u8 = 6;
const RECEIVE_ERRORS: u8 = 8;

/// One read of a port.
#[derive(Clone, Copy, Debug, Default)]
pub struct PortRead<'a> {
    /// The time when the read returned.
    pub time: Ns,
    /// The bytes.
    pub bytes: &'a [u8],
    /// The positions of the bytes for which the receiver reported an error.
    pub errors: &'a [u32],
    /// Whether bytes were lost before these.
    pub hole: bool,
}

/// Appends the section header of a segment.
pub fn head(application: &str, session: &str, segment: u64, out: &mut Vec<u8>) {
    let words = format!("recording session={session} segment={segment}");
    blocks::section_with(application, "", &words, out);
}

/// Appends the interface block of a port. `bus` is the number and name of its bus, `line` the letter of its line on a
/// two-line tap.
pub fn port(name: &str, bus: (usize, &str), line: Option<&str>, settings: Option<&LineSettings>, out: &mut Vec<u8>) {
    let spelled = settings.map(LineSettings::to_string);
    let mut metadata = format!("recording bus={}", bus.0);
    for (key, value) in [("line", line), ("settings", spelled.as_deref())] {
        if let Some(value) = value {
            let _ = write!(metadata, " {key}={value}");
        }
    }
    let _ = write!(metadata, " name={}", bus.1);
    let described = spelled.map_or(String::new(), |text| format!(", {text}"));
    let interface = Interface {
        link: LINK_RTAC,
        name,
        description: &format!("reads of a Modbus tap{described}"),
        speed: settings.map(|line| u64::from(line.baud)),
        digits: 9,
        custom: &metadata,
    };
    blocks::interface(&interface, out);
}

/// Appends one read of the port with this interface number.
pub fn read(interface: u32, read: &PortRead<'_>, out: &mut Vec<u8>) {
    let event = match (read.hole, read.errors) {
        (true, _) if read.bytes.is_empty() => PORT_CLOSED,
        (true, _) => BYTES_LOST,
        (false, []) => RECEIVED,
        _ => RECEIVE_ERRORS,
    };
    let start = begin(interface, read.time, event, out);
    out.extend_from_slice(read.bytes);
    blocks::end_bytes(start, out);
    if !read.errors.is_empty() {
        let positions: Vec<String> = read.errors.iter().map(u32::to_string).collect();
        blocks::custom(out, |out| out.extend_from_slice(format!("errors={}", positions.join(",")).as_bytes()));
        blocks::end_options(out);
    }
    blocks::end_block(start, out);
}

/// Appends a mark: the times of this port jump by `step` to `time`, because the wall clock was set.
pub fn clock_step(interface: u32, time: Ns, step: Ns, out: &mut Vec<u8>) {
    let start = begin(interface, time, STATUS, out);
    blocks::end_bytes(start, out);
    blocks::custom(out, |out| out.extend_from_slice(format!("clock_step={step}").as_bytes()));
    blocks::end_options(out);
    blocks::end_block(start, out);
}

/// Appends a packet without bytes, which only says that time has come so far. Streams of a tap have it, recordings do not.
pub fn time(interface: u32, time: Ns, out: &mut Vec<u8>) {
    let start = begin(interface, time, STATUS, out);
    blocks::end_bytes(start, out);
    blocks::end_block(start, out);
}

/// Begins a packet with the header of the link type.
fn begin(interface: u32, time: Ns, event: u8, out: &mut Vec<u8>) -> usize {
    let time = time.max(0) as u64;
    let start = blocks::begin_packet(interface, time, out);
    out.extend_from_slice(&((time / 1_000_000_000) as u32).to_be_bytes());
    out.extend_from_slice(&((time % 1_000_000_000 / 1000) as u32).to_be_bytes());
    out.extend_from_slice(&[event, 0, 0, 0]);
    start
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_is_written_with_the_header_of_its_link_type() {
        let mut out = Vec::new();
        let bytes = &[1, 6, 0, 1, 0, 3, 0x98, 0x0B];
        read(0, &PortRead { time: 1_700_000_000_123_456_789, bytes, ..PortRead::default() }, &mut out);
        let payload = modlens_protocol::hex::hex(&out[28..48]);
        assert_eq!(payload, "6553f1000001e240020000000106000100 03980b".replace(' ', ""));
        assert_eq!(out.len(), 28 + 20 + 4);
    }
}
