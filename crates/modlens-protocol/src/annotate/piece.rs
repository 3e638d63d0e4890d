//! A block of a frame, and the words beside it.

/// What part of a frame a block belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Unit, delimiters, noise.
    Frame,
    /// The header of Modbus/TCP.
    Mbap,
    /// The PDU.
    Pdu,
    /// CRC or LRC.
    Checksum,
}

impl Layer {
    /// Its name in the public API.
    pub fn text(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Mbap => "mbap",
            Self::Pdu => "pdu",
            Self::Checksum => "checksum",
        }
    }
}

/// Some bytes of a frame and what they mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Where they start on the wire, from 0; in ASCII mode these are characters.
    pub offset: usize,
    /// The bytes as they were on the wire; empty for something that is missing.
    pub bytes: Vec<u8>,
    /// The field's name in the table, with its place in a list: `registers[2]`, `objects[0].value`.
    pub name: String,
    /// The value as text, in the base that fits it.
    pub value: String,
    /// The meaning in words, may be empty. Where something is wrong, it says what.
    pub meaning: Meaning,
    /// The part of the frame.
    pub layer: Layer,
}

impl Piece {
    /// A block of a layer.
    pub fn new(layer: Layer, offset: usize, bytes: &[u8], name: &str, value: String, meaning: Meaning) -> Self {
        Self { offset, bytes: bytes.to_vec(), name: name.to_owned(), value, meaning, layer }
    }
}

/// The meaning of a field in words, and whether its value is valid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Meaning {
    /// The words.
    pub text: String,
    /// False where something is wrong.
    pub is_valid: bool,
}

impl Meaning {
    /// The meaning of something that is as it should be.
    pub fn valid(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_valid: true }
    }

    /// What is wrong.
    pub fn wrong(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_valid: false }
    }
}

/// Bytes as hex digits with a blank between them.
pub fn spaced_hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}

/// "1 byte", "2 bytes".
pub fn counted(count: impl Into<u64>, noun: &str) -> String {
    let count = count.into();
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}
