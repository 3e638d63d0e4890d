//! The findings: one documented variant each, with its severity, why it matters and what to check. The detail of an
//! occurrence is in its row.

use crate::renamed::{current, Vocabulary};

/// The severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Information.
    Info,
    /// It works, but should be corrected.
    Warning,
    /// Data was lost, damaged or refused.
    Error,
}

impl Severity {
    /// The value of the `severity` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// The documentation of a finding.
#[derive(Clone, Copy, Debug)]
pub struct Doc {
    /// Its code in columns and filters.
    pub code: &'static str,
    /// Its severity.
    pub severity: Severity,
    /// A short description.
    pub title: &'static str,
    /// Why it matters.
    pub why: &'static str,
    /// What to check.
    pub advice: &'static str,
    /// The section of the specification.
    pub section: &'static str,
}

macro_rules! findings {
    ($($variant:ident $code:literal $severity:ident $title:literal $why:literal $advice:literal $section:literal;)*) => {
        /// A finding. `Finding::doc` describes it.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Finding { $(#[doc = $title] $variant,)* }

        impl Finding {
            /// All findings, in the order of this file.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)*];

            /// Its documentation.
            pub fn doc(self) -> Doc {
                match self {
                    $(Self::$variant => Doc {
                        code: $code, severity: Severity::$severity, title: $title, why: $why, advice: $advice, section: $section,
                    },)*
                }
            }
        }
    };
}

findings! {
    BadChecksum "bad_checksum" Error
        "the checksum does not match the bytes"
        "The receiver discards such a frame without a response; the master waits for its response timeout and usually retries."
        "For noise: termination at both ends (150 ohm, or 120 ohm in series with 1 nF), biasing at one point (450 to 650 ohm), the shield, cable length (1000 m at most) and loading (32 unit loads at most). If all frames are bad: baud rate, parity, swapped A/B wires."
        "serial line 6.2";
    Incomplete "incomplete" Error
        "the frame is shorter than its own fields say"
        "Bytes were lost, or the sender stopped; the receiver discards the frame."
        "Buffer overruns in the adapter; a sender that disables its driver too early; a frame cut off by the start or end of the recording."
        "serial line 2.5.1.1";
    BitFlip "bit_flip" Error
        "flipping a single bit would make the checksum valid"
        "A single corrupted bit points to noise on the line, not to wrong settings."
        "Termination, biasing and shield; the unit shown may be at the far end or poorly connected."
        "serial line 6.2.2";
    LostBytes "lost_bytes" Error
        "bytes of this frame are missing from the recording"
        "The tap did not deliver them; the devices may well have received the whole frame."
        "Buffer overruns in the tap: a slow computer, a long USB cable or hub, an adapter with a small buffer. The line is not the cause."
        "";
    FlowControl "flow_control" Error
        "the serial driver took a byte out of this frame as software flow control"
        "The driver of the tap's port takes 0x11 (XON) and 0x13 (XOFF) for commands to itself; the devices received the whole frame."
        "Switch software flow control off at the port: stty -ixon -ixoff, or XON/XOFF in the terminal program or serial server that recorded this."
        "";
    Collision "collision" Error
        "another device transmitted during this frame"
        "Two drivers were enabled at once; where they conflict, the bus usually reads 0, and both frames are lost."
        "Two masters, two units with the same address, or a unit that responds after the master's timeout."
        "serial line 2.4.1";
    DuplicateByte "duplicate_byte" Error
        "a byte of this frame was delivered twice"
        "The recording is wrong at this point; the devices may well have received the frame correctly."
        "The adapter, its driver, or a serial device server."
        "";
    StrayBytes "stray_bytes" Info
        "spurious bytes, seen when a driver was enabled or disabled"
        "Receivers that separate frames by silence treat them as part of the frame."
        "Biasing resistors of 450 to 650 ohm, fitted at one point only; the timing of the unit's driver enable."
        "serial line 3.4.6";
    OtherChecksum "checksum_of_another_frame" Error
        "the checksum matches this frame with one byte different"
        "The frame was edited by hand or copied from a wrong example; noise on the line does not do this."
        "The document or the test program that the frame comes from."
        "serial line 6.2.2";
    NoResponse "no_response" Error
        "the request received no response"
        "The master waits out its response timeout, and its data go stale."
        "The unit's power supply, address, baud rate and parity, and whether it is present at all; if only some requests fail, the wiring and biasing."
        "serial line 2.4.1";
    ConnectionClosed "connection_closed" Warning
        "the connection was closed before the response came"
        "A server or a gateway that closes a connection instead of responding leaves the client without a reason."
        "The log of the server or gateway: connection limits, idle timeouts, restarts; whether the client gives up first."
        "messaging on TCP/IP 4.2";
    OneSideOnly "one_side_only" Warning
        "only requests, or only responses, were recorded"
        "What the other side sends is not heard, so that neither missing nor wrong responses can be noticed."
        "The tap: which wires or which direction of the switch port it is connected to, and whether any unit responds at all."
        "serial line 2.1";
    NoValidFrame "no_valid_frame" Error
        "next to none of the bytes belong to a valid frame"
        "No framing fits: neither RTU nor ASCII nor Modbus/TCP."
        "Baud rate, parity, data and stop bits, swapped wires; whether the line carries Modbus at all."
        "serial line 2.5";
    FasterThanLine "faster_than_line" Warning
        "the bytes come closer together than the line settings allow"
        "No line can carry them at this rate: the settings or the times of the recording are wrong, and all times derived from them."
        "The baud rate in --line; without --line modlens finds it. A recording that was replayed faster than it was made."
        "serial line 2.5.1";
    OverfullLine "overfull_line" Warning
        "the bytes need more time on the line than the recording lasts"
        "A utilization above 100 % is impossible: the settings or the times of the recording are wrong."
        "The baud rate in --line; clock adjustments and joined recordings."
        "serial line 2.5.1";
    ErrorsOnValidFrames "errors_on_valid_frames" Warning
        "the receiver reports line errors in nearly all valid frames"
        "A valid checksum proves that the bytes arrived right: the receiver expects another parity or stop bit than the devices send."
        "Parity and stop bits of the port that recorded this."
        "serial line 2.5.1";
    SwappedChecksum "swapped_checksum" Warning
        "the unit sends the two bytes of its checksum in the wrong order"
        "The low byte comes first; a master that follows the specification drops these responses."
        "The unit's firmware, or its setting for the order of the CRC."
        "serial line 2.5.1.2";
    MissingChecksum "missing_checksum" Warning
        "the unit sends no checksum"
        "A master that follows the specification drops these responses, and damage to them cannot be noticed."
        "The unit's firmware or settings; a converter that removes the checksum."
        "serial line 2.5.1";
    PaddedResponses "padded_responses" Info
        "the unit sends the same bytes after each response"
        "Receivers that separate frames by silence treat them as part of the frame."
        "How long the unit keeps its driver enabled; the unit's firmware."
        "serial line 2.5.1";
    AnswersAsOtherUnit "answers_as_other_unit" Warning
        "requests to this unit are answered by another one"
        "A master that compares the address drops these responses."
        "A gateway or converter that puts its own address into responses; the address set in the unit."
        "serial line 2.2";
    Retry "retry" Warning
        "the same request was sent again because no response had come"
        "Retries hide problems from the application but use up bus time."
        "Why the first request went unanswered; the master's timeout may be too short."
        "serial line 2.4.1";
    LateResponse "late_response" Warning
        "the response arrived after the master's timeout"
        "The master may mistake it for the response to its next request."
        "The master's timeout is too short for this unit, or the unit is overloaded."
        "serial line 2.4.1";
    Unsolicited "unsolicited" Warning
        "a response without a request"
        "The tap missed the request, a second device responded, or the response came after the master had given up (late_response)."
        "Two units with the same address; the start of the recording; a tap that hears only one direction."
        "serial line 2.4.1";
    Duplicate "duplicate_response" Warning
        "the same response again"
        "Two devices with the same address respond alike, or a repeater sends twice; the master may take the copy for its next response."
        "Two units with the same address; repeaters; gateways."
        "serial line 2.4.1";
    ConflictingResponse "conflicting_response" Error
        "a second response to the same request, with other content"
        "One request has one response: the client takes one of the two and drops the other, and nobody knows which is true."
        "Who sent it: the packets' MAC addresses and times to live, a second server or proxy at the address, a gateway that forwards to two units. Both responses are kept as frames."
        "messaging on TCP/IP 4.2";
    LocalEcho "local_echo" Info
        "the request was received twice"
        "The master's adapter receives its own transmission; a master that does not expect this takes the echo for the response."
        "The adapter's receiver-enable setting; there is nothing to do if the master handles the echo."
        "serial line 3.2";
    TwoMasters "two_masters" Error
        "a second request was sent before the first was answered; both got a response"
        "A serial line has one master; the requests of two masters collide sooner or later."
        "A second controller, a service laptop or a gateway on the same line."
        "serial line 2.1";
    WrongUnit "wrong_unit" Error
        "a different unit responded than the one addressed"
        "The master discards the response or, worse, accepts it."
        "Unit addresses; gateways that rewrite them."
        "serial line 2.2";
    WrongFunction "wrong_function" Error
        "the response has a different function code than the request"
        "An exception response must repeat the request's function code with its highest bit set; the master discards anything else."
        "The device's firmware, or an error in its documentation."
        "7";
    Exception "exception" Warning
        "the unit answered with an exception"
        "The unit did not carry out the request."
        "The meaning of the exception code: modlens explain exception N."
        "7";
    ResponseLength "response_length" Error
        "the response is shorter or longer than requested"
        "The master requested a different number of registers or bits than it received."
        "Devices that send 4 bytes per register, or truncate long responses."
        "6";
    LengthMismatch "length_mismatch" Error
        "the byte count does not agree with the quantity"
        "Some receivers use one, some the other."
        "The sender's firmware."
        "6";
    EchoMismatch "echo_mismatch" Error
        "the response does not repeat the fields of the request"
        "A device confirms a write by echoing it; a different echo means that another register or another value was written."
        "Whether the device clamps or rounds written values; two devices with the same address."
        "6.5";
    QuantityLimit "quantity_limit" Warning
        "a field exceeds the limits of the specification"
        "Devices may refuse the request with exception 3, or send a malformed response."
        "The master's configuration."
        "6";
    PaddingBits "padding_bits" Warning
        "bits beyond the last requested one are set"
        "Padding must be zero; set bits suggest a device that always sends whole bytes, or a wrong example."
        "The bit order: bits are counted from the least significant bit of the first byte, so 0x80 is the eighth bit, not the first."
        "6.1";
    ReservedUnit "reserved_unit" Info
        "a unit number above 247 on a serial line"
        "The numbers 248 to 255 are reserved, but some devices use them."
        "Nothing, if it is intended."
        "serial line 2.2";
    BroadcastRead "broadcast_read" Warning
        "a read request sent to unit 0"
        "No unit responds to a broadcast, so a broadcast read is pointless."
        "The unit number that the master uses."
        "serial line 2.1";
    UnknownFunction "unknown_function" Info
        "a function code that modlens does not know"
        "Its bytes are shown undecoded, and only the checksum confirms where the frame ends."
        "modlens decode --functions NAME|FILE loads additional function codes."
        "5";
    Unconfirmed "unconfirmed" Info
        "a frame that may be noise with a matching checksum"
        "In a long stretch of noise, some bytes match a checksum by chance; bytes that recur match it each time."
        "Nothing, if more frames of this unit follow; otherwise the noise."
        "";
    ShortSilence "short_silence" Info
        "less than t3.5 of silence before the frame"
        "Receivers that separate frames by silence join such a frame to the one before it."
        "The sender's turnaround time; the --line setting."
        "serial line 2.5.1.1";
    GapInFrame "gap_in_frame" Info
        "more than t1.5 of silence inside the frame"
        "The frame is valid, but receivers that separate frames by silence discard it."
        "The sender: software UARTs and slow main loops pause for 1 to 20 ms between bytes, gateways and USB adapters for 2 to 80 ms between packets, busy PLCs and operating systems for longer; the --line setting."
        "serial line 2.5.1.1";
    BareLineFeed "bare_line_feed" Info
        "an ASCII frame that ends without CR"
        "Strict receivers wait for CR LF."
        "The sender's firmware; a terminal program that changed the line endings."
        "serial line 2.5.2.1";
    LowerCaseHex "lower_case_hex" Info
        "an ASCII frame in lower-case hex"
        "The specification allows only 0-9 and A-F; strict receivers discard the frame."
        "The sender's firmware."
        "serial line 2.5.2";
    MbapLength "mbap_length" Error
        "the MBAP header announces a different length than the PDU has"
        "Receivers that rely on the header lose their place in the stream."
        "The sender's firmware, or a gateway that leaves the RTU checksum in."
        "messaging on TCP/IP 3.1.3";
    OrderMismatch "order_mismatch" Warning
        "the values make sense only in a different byte order than the profile states"
        "Floating-point numbers and counters read in the wrong order look plausible but are wrong."
        "The key order in the profile, of the device or of the point; modlens show FILE --at UNIT:hr:ADDRESS --as all shows the values in every order."
        "4.2";
    UnsupportedFunction "unsupported_function" Warning
        "a function that the device does not support, according to its profile"
        "The device refuses the request, does not respond, or does something undocumented."
        "The master's configuration; or the list of functions in the profile, if the device responds as it should."
        "5";
    TransactionId "transaction_id_mismatch" Warning
        "the response has a different transaction identifier than its request"
        "A client that checks the identifier discards the response; with several requests outstanding, responses are mixed up."
        "The device's firmware: it must copy the identifier. modlens paired the two by unit, function and order."
        "messaging on TCP/IP 3.1.3";
    MissingSegment "missing_segment" Warning
        "bytes of the TCP connection are missing from the capture"
        "Requests and responses around this point may be missing or truncated; a missing response is then the fault of the capture, not of the device."
        "The capture: dropped packets, a snapshot length that is too short, a mirror port that is overloaded or copies only one direction."
        "";
    Retransmission "tcp_retransmission" Info
        "TCP sent the bytes again"
        "A packet was lost or delayed on the network, which holds up everything after it; the Modbus data are not affected."
        "The network between client and server: congestion, duplex settings, radio links. The bytes are counted once."
        "";
    ConflictingSegment "conflicting_segment" Error
        "TCP sent the same bytes of the stream again, as others"
        "A sender repeats what it has sent, byte by byte. Other bytes in the same place come from somebody else, or were changed on the way, and which of them the receiver took is not known."
        "Who sent the packet: MAC addresses, times to live, IP identifications. Frames have the bytes that came first; the detail has the others."
        "";
    DuplicatePacket "duplicate_packet" Info
        "the capture contains packets twice"
        "A mirror port copied both directions, or several interfaces were captured; nothing was sent twice."
        "Nothing: each packet is counted once. Capture one interface or one direction for smaller files."
        "";
    LineError "line_error" Warning
        "the receiver reported a parity, framing or break error"
        "Bytes received with such an error are usually corrupt."
        "Baud rate, parity and stop bits; noise."
        "serial line 2.5.1";
    ClockJumped "clock_jumped" Info
        "the recording's clock went backwards"
        "Response times and gaps across the jump are meaningless and are left empty."
        "Clock adjustments on the recording computer."
        "";
}

impl Finding {
    /// The finding of this code, which may have its former spelling.
    pub fn from_code(code: &str) -> Option<Self> {
        let code = current(Vocabulary::Finding, code);
        Self::ALL.iter().copied().find(|finding| finding.doc().code == code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finding_has_its_text() {
        for finding in Finding::ALL {
            let doc = finding.doc();
            assert_eq!(Finding::from_code(doc.code), Some(*finding));
            assert!(!doc.title.is_empty() && doc.why.ends_with('.') && doc.advice.ends_with('.'), "{}", doc.code);
            // A comment in a capture is `severity code: title: detail`, and is taken apart again.
            assert!(!doc.title.contains(": "), "{}", doc.code);
        }
    }
}
