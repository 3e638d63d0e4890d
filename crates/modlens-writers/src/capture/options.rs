//! The options of a capture file.

/// How frames are encapsulated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encapsulation {
    /// For the dissector `mbudp`, which decodes all functions, the direction and pairs, and shows checksum bytes.
    #[default]
    Udp,
    /// For the dissector `mbrtu`, which guesses the direction.
    Rtu,
    /// Ethernet, IP and TCP around each PDU, for programs that support nothing else.
    Tcp,
}

impl Encapsulation {
    /// All styles with their names, the default first.
    pub const ALL: [(&'static str, Self); 3] = [("udp", Self::Udp), ("rtu", Self::Rtu), ("tcp", Self::Tcp)];

    /// Descriptions for the users of the file: of each interface, and of the whole file.
    pub(super) fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Udp => ("RTU and ASCII frames are shown as Modbus/UDP followed by their checksum", ""),
            Self::Rtu => ("shown by the dissector mbrtu", ""),
            Self::Tcp => (
                "SYNTHETIC Ethernet, IP and TCP around the frames",
                "SYNTHETIC: these are decoded frames dressed as Modbus/TCP. Addresses and ports of serial lines are invented, those \
                 of TCP connections are as captured; handshakes and sequence numbers are invented in any case. Checksums of the \
                 line, damaged frames and noise are left out.",
            ),
        }
    }
}

/// The options of a capture file.
#[derive(Clone, Debug, Default)]
pub struct CaptureOptions {
    /// How frames are encapsulated.
    pub style: Encapsulation,
    /// Whether to write classic pcap, which has no names, comments or flags.
    pub classic: bool,
    /// Whether frames are written at once, rather than when their transaction is complete.
    pub live: bool,
    /// The number of frames to write before and after each frame that a filter keeps.
    pub context: usize,
    /// The program that writes the file.
    pub application: String,
}
