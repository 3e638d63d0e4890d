//! The value of one column of one row.

use serde_json::Value as Json;

use super::Fields;
use modlens_profiles::points::Value;
use modlens_protocol::finding::Finding;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;

/// A list of numbers that still stands on the wire.
#[derive(Clone, Copy, Debug)]
pub enum Items<'a> {
    /// Two bytes each.
    Words(&'a [u8]),
    /// So many bits, lowest first.
    Bits(&'a [u8], usize),
    /// One number.
    One(i32),
}

impl Items<'_> {
    /// How many.
    pub fn len(&self) -> usize {
        match self {
            Self::Words(bytes) => bytes.len() / 2,
            Self::Bits(bytes, count) => (*count).min(bytes.len() * 8),
            Self::One(_) => 1,
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One of them.
    #[inline]
    pub fn get(&self, index: usize) -> i32 {
        match self {
            Self::Words(bytes) => i32::from(u16::from_be_bytes([bytes[2 * index], bytes[2 * index + 1]])),
            Self::Bits(bytes, _) => i32::from(bytes[index / 8] >> (index % 8) & 1),
            Self::One(value) => *value,
        }
    }
}

/// One value of a row.
#[derive(Clone, Debug)]
pub enum Cell<'a> {
    /// Nothing.
    Null,
    /// A number.
    Int(i64),
    /// A number with a fraction.
    Float(f64),
    /// A value of a point, in letters.
    Value(Value<'a>),
    /// A duration; columns show microseconds.
    Us(Ns),
    /// A time: ns since 1970.
    Time(Ns),
    /// Yes or no.
    Bool(bool),
    /// A word of ours: it needs no escaping.
    Word(&'a str),
    /// Text from outside.
    Text(&'a str),
    /// Bytes as hex.
    Hex(&'a [u8]),
    /// Numbers.
    Ints(Items<'a>),
    /// Codes of findings.
    Codes(&'a [Finding]),
    /// Decoded fields.
    Fields(Fields<'a>),
    /// Named values.
    Map(Json),
    /// Where it stands: file, kind of place, number.
    Source(&'a str, Place, u64),
}
