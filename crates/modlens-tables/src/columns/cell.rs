//! The value of one column in one row.

use serde_json::Value as Json;

use super::fields::Fields;
use modlens_profiles::points::Value;
use modlens_protocol::finding::Finding;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;

/// A list of numbers that is still encoded as on the wire.
#[derive(Clone, Copy, Debug)]
pub enum Items<'a> {
    /// Registers, two bytes each.
    Words(&'a [u8]),
    /// This many bits, packed with the least significant first.
    Bits(&'a [u8], usize),
    /// A single number.
    One(i32),
    /// Numbers of rows.
    Numbers(&'a [u64]),
}

impl Items<'_> {
    /// The number of items.
    pub fn len(&self) -> usize {
        match self {
            Self::Words(bytes) => bytes.len() / 2,
            Self::Bits(bytes, count) => (*count).min(bytes.len() * 8),
            Self::One(_) => 1,
            Self::Numbers(numbers) => numbers.len(),
        }
    }

    /// Whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The item at an index.
    #[inline]
    pub fn get(&self, index: usize) -> i32 {
        match self {
            Self::Words(bytes) => i32::from(u16::from_be_bytes([bytes[2 * index], bytes[2 * index + 1]])),
            Self::Bits(bytes, _) => i32::from(bytes[index / 8] >> (index % 8) & 1),
            Self::One(value) => *value,
            Self::Numbers(numbers) => numbers[index] as i32,
        }
    }
}

/// One value of a row, of any kind. Writers match on it.
#[derive(Clone, Debug)]
pub enum Cell<'a> {
    /// No value.
    Null,
    /// An integer.
    Int(i64),
    /// A floating point number.
    Float(f64),
    /// The converted value of a point; shown as its exact text.
    Value(Value<'a>),
    /// A duration in ns; columns show microseconds.
    Us(Ns),
    /// A time in ns since 1970.
    Time(Ns),
    /// A truth value.
    Bool(bool),
    /// Text from a fixed vocabulary of modlens, which needs no escaping.
    Word(&'a str),
    /// Text from the input, which may need escaping.
    Text(&'a str),
    /// Bytes, shown as hex.
    Hex(&'a [u8]),
    /// A list of numbers.
    Ints(Items<'a>),
    /// Finding codes.
    Codes(&'a [Finding]),
    /// The decoded fields of a message.
    Fields(Fields<'a>),
    /// Named values, as a JSON object.
    Map(Json),
    /// Where the row was found in the input: file, kind of position, number.
    Source(&'a str, Place, u64),
}
