//! The kinds of ordinary traffic, a row each.

/// How the traffic was recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The bytes of an RTU line, without times.
    Rtu,
    /// The characters of an ASCII line, without times.
    Ascii,
    /// A log with the time and the hex bytes of an RTU frame on each line.
    Log,
    /// A capture of Modbus/TCP with so many connections, a packet a message.
    Capture(u8),
}

impl Form {
    /// The extension of a file of this form.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Rtu => "bin",
            Self::Ascii => "ascii",
            Self::Log => "hex",
            Self::Capture(_) => "pcap",
        }
    }
}

/// A kind of traffic. Shares are parts of 1 of all requests.
#[derive(Clone, Debug)]
pub struct Kind {
    /// Its name.
    pub name: &'static str,
    /// How it was recorded.
    pub form: Form,
    /// The number of units, from address 1 on.
    pub units: u8,
    /// The number of entries of the poll list.
    pub polls: u16,
    /// Polls are asked in random order in place of that of the list.
    pub is_random: bool,
    /// The function codes of polls, each as often as it is in the list.
    pub reads: &'static [u8],
    /// The quantities of registers that polls ask for.
    pub registers: &'static [u16],
    /// The quantities of coils or inputs that polls ask for.
    pub bits: &'static [u16],
    /// The first and the last address that polls and writes begin at.
    pub addresses: [u16; 2],
    /// The share of writes between the polls.
    pub writes: f64,
    /// The function codes of writes, as those of `reads`; 65 is one that a vendor has defined.
    pub write_codes: &'static [u8],
    /// The share of requests that are refused.
    pub refused: f64,
    /// The share of requests without a response.
    pub silent: f64,
    /// The share of requests without a response that are then sent again, and answered.
    pub retried: f64,
}

/// Small and large blocks of registers.
const BLOCKS: &[u16] = &[1, 2, 2, 4, 6, 10, 16, 20, 32, 50, 80, 125];

/// Mostly reads of registers, some of bits.
const MIXED_READS: &[u8] = &[3, 3, 3, 3, 3, 3, 4, 4, 1, 2];

/// What a kind has in common with most others.
const ORDINARY: Kind = Kind {
    name: "",
    form: Form::Rtu,
    units: 8,
    polls: 96,
    is_random: false,
    reads: &[3],
    registers: BLOCKS,
    bits: &[1, 8, 16, 24, 64, 100, 500],
    addresses: [0, 899],
    writes: 0.0,
    write_codes: &[6],
    refused: 0.0,
    silent: 0.0,
    retried: 0.0,
};

/// Kinds that differ in one thing each from polls of registers, and mixtures in every form.
pub const KINDS: &[Kind] = &[
    Kind { name: "registers", ..ORDINARY },
    Kind { name: "bits", reads: &[1, 2], ..ORDINARY },
    Kind { name: "write-coil", writes: 0.15, write_codes: &[5], ..ORDINARY },
    Kind { name: "write-register", writes: 0.15, ..ORDINARY },
    Kind { name: "write-many", writes: 0.15, write_codes: &[15, 16], ..ORDINARY },
    Kind { name: "read-and-write", writes: 0.015, write_codes: &[23], ..ORDINARY },
    Kind { name: "silent", silent: 0.005, ..ORDINARY },
    Kind { name: "retried", retried: 0.005, ..ORDINARY },
    Kind { name: "refused", refused: 0.02, ..ORDINARY },
    Kind { name: "random-order", is_random: true, ..ORDINARY },
    Kind { name: "one-unit", units: 1, polls: 6, ..ORDINARY },
    Kind { name: "many-units", units: 120, polls: 480, ..ORDINARY },
    Kind { name: "short", registers: &[1, 2], ..ORDINARY },
    Kind { name: "long", registers: &[125], ..ORDINARY },
    Kind { name: "vendor", writes: 0.02, write_codes: &[65], ..ORDINARY },
    Kind { name: "mixed", ..MIXED },
    Kind { name: "ascii", form: Form::Ascii, ..MIXED },
    Kind { name: "log", form: Form::Log, ..MIXED },
    Kind { name: "capture", form: Form::Capture(1), ..MIXED },
    Kind { name: "connections", form: Form::Capture(12), ..MIXED },
];

/// Everything at once.
const MIXED: Kind = Kind {
    reads: MIXED_READS,
    writes: 0.1,
    write_codes: &[5, 6, 6, 15, 16, 16, 23],
    refused: 0.01,
    silent: 0.003,
    retried: 0.001,
    ..ORDINARY
};

/// Returns the kind with this name.
pub fn named(name: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| kind.name == name)
}
