//! What is asked of a capture.

/// How frames are dressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// For the dissector `mbudp`: all functions, direction, pairing, checksum bytes.
    #[default]
    Udp,
    /// For the dissector `mbrtu`, which guesses directions.
    Rtu,
    /// Ethernet, IP and TCP around each PDU: for programs that know no other.
    Tcp,
}

impl Style {
    /// All of them with their words, the default first.
    pub const ALL: [(&'static str, Self); 3] = [("udp", Self::Udp), ("rtu", Self::Rtu), ("tcp", Self::Tcp)];

    /// What readers are told of it.
    pub(super) fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Udp => ("RTU and ASCII frames are shown as Modbus/UDP with their checksum behind", ""),
            Self::Rtu => ("shown by the dissector mbrtu", ""),
            Self::Tcp => (
                "SYNTHETIC Ethernet, IP and TCP around serial frames",
                "SYNTHETIC: this is serial traffic dressed as Modbus/TCP. Addresses, ports, handshakes and sequence numbers are \
                 invented; checksums of the line, damaged frames and noise are left out.",
            ),
        }
    }
}

/// What a capture shall be.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// How frames are dressed.
    pub style: Style,
    /// Classic pcap: no names, comments or flags.
    pub classic: bool,
    /// Frames are written at once, not when their transaction is complete.
    pub live: bool,
    /// Frames before and behind each frame that a filter keeps.
    pub context: usize,
    /// The program that wrote it.
    pub application: String,
}
