//! What an oddity is and what to do, in words.

use super::Oddity;
use crate::annotate::exception_name;

impl Oddity {
    /// What it is and what to do, in words.
    pub fn words(&self) -> String {
        match self {
            Self::Digits(digits) => format!(
                "the bytes are hex digits sent as characters (\"{digits}\"): the sender writes its frame as text; Modbus RTU sends \
                 the bytes themselves, and Modbus ASCII begins with a colon"
            ),
            Self::Text(opening) => {
                format!("the bytes are text (\"{opening}\"): another protocol answers here; check the port and the device's protocol setting")
            }
            Self::AsciiSum { there, due } => format!(
                "the bytes are a frame of Modbus ASCII whose checksum (LRC) is wrong: {there:02X} is there, and {due:02X} belongs to these \
                 characters"
            ),
            Self::SwappedChecksum => String::from(
                "the checksum is right, but its two bytes are swapped: on the wire its low byte comes first; correct the program that \
                 makes the frame",
            ),
            Self::Doubled => String::from(
                "each byte is there twice, and one of each two makes a frame with a right checksum: the program that reads or prints \
                 them takes each byte twice, or two recorders of one line write into the same text",
            ),
            Self::OutOfStep => String::from(
                "the last byte belongs in front: the reader is one byte out of step; discard what is left in the receive buffer \
                 before each request",
            ),
            Self::HeaderLength { announced, present } => format!(
                "the MBAP header announces {announced} bytes after its length field, and {present} follow: the length field is \
                 wrong, so that the other side waits for more, or reads the next frame at the wrong place"
            ),
            Self::StrayFront { bytes, is_cut } => format!(
                "{} in front of the frame{}, as a line leaves that nobody drives: biasing, or the turning round of the adapter",
                if *bytes == 1 { "a stray byte is" } else { "two stray bytes are" },
                if *is_cut { ", whose last byte is missing" } else { "" }
            ),
            Self::StrayBeside(bytes) => format!(
                "the bytes are those of the line before with {} in front, as a line leaves that nobody drives: biasing, or the \
                 turning round of the adapter",
                if *bytes == 1 { "one more" } else { "two more" },
            ),
            Self::AlteredRequest => String::from(
                "the bytes are the request before with some bits changed: the adapter hears its own transmission, distorted; or, \
                 where this is what the other side received, rate, parity, data bits or levels differ between the two",
            ),
            Self::Zeros(count) => format!(
                "all {count} bytes are 00, which is what a receiver makes of a line that is held low: swapped wires (A and B), or \
                 a driver that never lets go"
            ),
            Self::Levels => String::from(
                "nearly all bytes are 00, FF or their like, which is what a receiver makes of a line with swapped wires (A and B), of \
                 another rate, or of one that nobody drives",
            ),
            Self::Refusal { unit, function, code } => format!(
                "unit {unit} refuses function {function} with exception {code} ({})",
                exception_name(*code).unwrap_or_default()
            ),
            Self::OtherFunction { asked, answered } => format!(
                "the answer begins with function {answered:02X}, and function {asked:02X} was asked for: what answers does not \
                 speak Modbus, or its bytes are damaged (rate, parity, levels)"
            ),
            Self::OtherCount { counted, due } => format!(
                "the answer counts {counted} bytes of data, and {due} are those that were asked for{}",
                if (counted ^ due).is_power_of_two() {
                    ": one bit of the byte count is wrong, so that the reader takes the frame for longer or shorter than it is; that is \
                     damage on the line (termination, biasing, ground, noise)"
                } else {
                    ": its byte count is damaged, or it is the answer to another request"
                }
            ),
            Self::Constant { byte, times, of } => format!(
                "{times} of {of} bytes are {byte:02X}: no frame is in them; the receiver sees one pattern over and over, as with wrong \
                 line settings (rate, parity, data bits), swapped wires, or a signal that is no serial data"
            ),
            Self::FewValues { bytes, values } => format!(
                "{bytes} bytes have {} values ({}), which no frames have: the receiver makes them of a signal at another rate or with \
                 other settings, or of swapped wires",
                values.len(),
                values.iter().map(|value| format!("{value:02X}")).collect::<Vec<_>>().join(", ")
            ),
            Self::Echo => String::from(
                "the answer is the request itself: the adapter hears its own transmission, and nothing else answers; turn its echo \
                 off, or read and discard as many bytes as were sent",
            ),
            Self::CutRequest => String::from(
                "the request lacks the last byte of its checksum, and is right otherwise. Where it was sent so, no unit answers it: \
                 correct the program, or the time at which its driver is switched off; where it was received, the adapter hears \
                 its own transmission",
            ),
            Self::Cut => String::from("the frame lacks its last byte, and is right otherwise: the reader expects one byte too few"),
        }
    }
}
