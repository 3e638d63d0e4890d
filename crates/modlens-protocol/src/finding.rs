//! The findings: one documented variant each, with its severity, why it matters and what to check. The detail of an
//! occurrence stands in its row.

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
        "the checksum is not that of the bytes"
        "The receiver drops such a frame in silence; the master waits for its time-out and asks again."
        "Noise: termination at both ends (150 ohm, or 120 ohm + 1 nF), bias of 450 to 650 ohm at one place, shield, at most 1000 m and 32 loads. If all frames are bad: baud rate, parity, swapped wires."
        "serial line 6.2";
    Incomplete "incomplete" Error
        "the frame ends before the bytes that it announces"
        "Bytes were lost, or the sender stopped; the frame is worthless to the receiver."
        "Overruns of the adapter, a sender whose driver is switched off too early, or the start or end of the recording."
        "serial line 2.5.1.1";
    BitFlip "bit_flip" Error
        "one flipped bit would mend the checksum"
        "A single disturbed bit is the mark of noise on the line, not of a wrong setting."
        "Termination, bias and shield; the unit named is far away or badly connected."
        "serial line 6.2.2";
    LostBytes "lost_bytes" Error
        "bytes of this frame are missing in the recording"
        "The tap did not deliver them; the units may well have heard the frame whole."
        "Overruns: a slower machine, a long USB cable or hub, an adapter without flow of its own; not the line."
        "";
    Collision "collision" Error
        "another sender talked into the frame"
        "Two drivers at once: the one that pulls to 0 wins, and both frames are lost."
        "Two masters, two units with one address, or a unit that answers after the master's time-out."
        "serial line 2.4.1";
    DoubledByte "doubled_byte" Error
        "a byte of this frame was delivered twice"
        "The recording is wrong in this place; the units may well have heard the frame whole."
        "The adapter, its driver, or a network serial server."
        "";
    Glitch "glitch" Info
        "stray bytes where a driver was switched on or off"
        "Receivers that go by the clock take them for a part of the frame."
        "Bias of 450 to 650 ohm at one place; the unit's driver-enable timing."
        "serial line 3.4.6";
    OtherChecksum "checksum_of_another_frame" Error
        "the checksum fits the same frame with one other byte"
        "The frame was edited by hand or taken from a document with a wrong example: the line does not do this."
        "The document or the test program that the frame comes from."
        "serial line 6.2.2";
    NoResponse "no_response" Error
        "the request was not answered"
        "The master lost one time-out, and the data are old."
        "Whether the unit exists, its address, its baud rate and parity, its power; if only sometimes: the line."
        "serial line 2.4.1";
    Retry "retry" Warning
        "the same request again after no answer"
        "Retries hide trouble from the application but cost bus time."
        "The reason for the first attempt's silence; the master's time-out may be too short."
        "serial line 2.4.1";
    LateResponse "late_response" Warning
        "an answer after the master had given up"
        "The master may take it for the answer to its next request."
        "The master's time-out is too short for this unit, or the unit is overloaded."
        "serial line 2.4.1";
    Unrequested "unrequested" Warning
        "a response that nobody asked for"
        "The request was lost to the tap, or a second device answers."
        "Two units with one address; the start of a recording; a tap that hears one side only."
        "serial line 2.4.1";
    Duplicate "duplicate_response" Warning
        "the same answer a second time"
        "Two devices with one address answer alike, or a repeater sends twice; the master may take it for its next answer."
        "Two units with one address; repeaters; gateways."
        "serial line 2.4.1";
    LocalEcho "local_echo" Info
        "the request was heard twice"
        "The master's adapter hears itself; a master that does not expect it takes the echo for the answer."
        "The adapter's receiver-enable setting; nothing, if the master copes with it."
        "serial line 3.2";
    TwoMasters "two_masters" Error
        "a request before the other one's answer, and both were answered"
        "There is one master on a serial line; two of them collide sooner or later."
        "A second controller, a service laptop or a gateway on the same line."
        "serial line 2.1";
    WrongUnit "wrong_unit" Error
        "another unit answered than the one asked"
        "The master drops the answer, or worse, believes it."
        "Unit addresses; gateways that rewrite them."
        "serial line 2.2";
    WrongFunction "wrong_function" Error
        "the answer carries another function than the request"
        "An exception must repeat the request's function code with its highest bit set; the master drops anything else."
        "The device's firmware, or a document with a wrong example."
        "7";
    Exception "exception" Warning
        "the unit refused the request"
        "The request was understood but not carried out."
        "modlens explain exception CODE says what the code means."
        "7";
    ResponseLength "response_length" Error
        "the response is shorter or longer than asked for"
        "The master asked for another number of registers or bits than it got."
        "Devices that answer 4 bytes a register, or cut long answers."
        "6";
    LengthMismatch "length_mismatch" Error
        "the byte count does not agree with the quantity"
        "Receivers differ in which of the two they believe."
        "The sender's firmware."
        "6";
    EchoMismatch "echo_mismatch" Error
        "the response does not repeat what the request said"
        "A write is confirmed by an echo; another echo means another register, or another value."
        "Whether the device limits or rounds written values; two devices with one address."
        "6.5";
    QuantityLimit "quantity_limit" Warning
        "a field is outside the limits of the specification"
        "Devices may refuse it with exception 3, or answer with a broken frame."
        "The master's configuration."
        "6";
    PaddingBits "padding_bits" Warning
        "bits behind the last one asked for are set"
        "Padding must be zero; set bits point to a device that answers whole bytes, or to a wrong example."
        "Count from the lowest bit of the first byte: 0x80 is the eighth bit, not the first."
        "6.1";
    ReservedUnit "reserved_unit" Info
        "a unit number above 247 on a serial line"
        "248 to 255 are reserved; devices use them all the same."
        "Nothing, if it is meant so."
        "serial line 2.2";
    BroadcastRead "broadcast_read" Warning
        "a read sent to unit 0"
        "Nobody answers a broadcast, so a broadcast read is pointless."
        "The master's unit number."
        "serial line 2.1";
    UnknownFunction "unknown_function" Info
        "a function that the table does not know"
        "Its bytes are shown as they are; only the checksum vouches for its length."
        "modlens decode --functions NAME|FILE loads further rows."
        "5";
    Tentative "tentative" Info
        "a frame that may be an accident of noise"
        "In noise of any length some bytes have a right checksum by chance."
        "Nothing, if more frames of this unit follow; else the noise."
        "";
    ShortSilence "short_silence" Info
        "less than t3.5 of silence before the frame"
        "Receivers that go by the clock run two such frames into one."
        "The sender's turnaround time; the baud rate given to modlens."
        "serial line 2.5.1.1";
    GapInside "gap_inside" Info
        "more than t1.5 of silence inside the frame"
        "Receivers that go by the clock drop such a frame."
        "Senders that are interrupted between two bytes; the baud rate given to modlens."
        "serial line 2.5.1.1";
    BareLineFeed "bare_line_feed" Info
        "an ASCII frame that ends without CR"
        "Strict receivers wait for CR LF."
        "The sender's firmware; a terminal program that changed the line ends."
        "serial line 2.5.2.1";
    LowerCaseHex "lower_case_hex" Info
        "an ASCII frame in lower-case hex"
        "The specification has 0-9 and A-F only; strict receivers drop the frame."
        "The sender's firmware."
        "serial line 2.5.2";
    MbapLength "mbap_length" Error
        "the MBAP header announces another length than the PDU needs"
        "Receivers that go by the header lose their place in the stream."
        "The sender's firmware, or a gateway that leaves the RTU checksum in."
        "messaging on TCP/IP 3.1.3";
    OrderMismatch "order_mismatch" Warning
        "the values make sense only in another order of bytes than the profile says"
        "Floating point numbers and counters read in the wrong order are plausible-looking nonsense."
        "order in the profile, of the device or of the point; modlens show FILE --at UNIT:hr:ADDRESS --as all shows all readings."
        "4.2";
    UnsupportedFunction "unsupported_function" Warning
        "the device does not have this function, says its profile"
        "The device refuses it, does not answer, or does something that nobody has described."
        "The master's configuration; or the list of functions in the profile, if the device answers as it should."
        "5";
    TransactionId "transaction_id" Warning
        "the answer carries another transaction identifier than its request"
        "A client that goes by the identifier drops the answer; with several requests at once answers are mixed up."
        "The device's firmware: it must copy the identifier. It was paired by unit, function and order."
        "messaging on TCP/IP 3.1.3";
    MissingSegment "missing_segment" Warning
        "bytes of the connection are not in the capture"
        "Requests and answers around the place may be missing or cut; their silence is the capture's, not the device's."
        "The capture: dropped packets, a snapshot length that is too short, a mirror port that is overloaded or shows one direction."
        "";
    Retransmission "tcp_retransmission" Info
        "TCP sent the bytes again"
        "A packet was lost or late on the network, which delays what follows; Modbus saw nothing of it."
        "The network between client and server: load, duplex settings, radio links; the bytes count once here."
        "";
    PacketTwice "packet_twice" Info
        "the capture holds packets twice"
        "A mirror port that copies both ways, or several interfaces; nothing was sent twice."
        "Nothing; each packet counts once here. Capture one interface or one direction to have smaller files."
        "";
    LineError "line_error" Warning
        "the receiver marked a parity, framing or break error"
        "Bytes with such a mark are rarely right."
        "Baud rate, parity and stop bits; noise."
        "serial line 2.5.1";
    ClockJumped "clock_jumped" Info
        "the recording's clock went backwards"
        "Response times and gaps across the jump mean nothing and are left empty."
        "Clock adjustments on the recording machine."
        "";
}

impl Finding {
    /// The finding of this code.
    pub fn from_code(code: &str) -> Option<Self> {
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
        }
    }
}
