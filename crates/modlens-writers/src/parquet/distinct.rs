//! Values by their numbers in a dictionary (parquet-format, Encodings.md, "Dictionary Encoding").
//!
//! The numbers have whole bytes, not as few bits as would do: they are written at once, and zstd finds what repeats in
//! them, which it cannot in bits.

use std::collections::HashMap;

use arrow_buffer::NullBuffer;
use foldhash::fast::FixedState;
use parquet::basic::Encoding;
use parquet::data_type::ByteArray;
use parquet::file::statistics::Statistics;

use super::column::Encoder;
use super::encode::{push_varint, some, texts, widen, Bounds};
use crate::values::ColumnBuilder;

/// Appends numbers of which there are so many different ones, as one run of packed ones.
fn push_places(places: &[u32], different: usize, out: &mut Vec<u8>) {
    let bytes = match different {
        0..=0x100 => 1,
        0x101..=0x1_0000 => 2,
        _ => 4,
    };
    out.push(8 * bytes as u8);
    if places.is_empty() {
        return;
    }
    let groups = places.len().div_ceil(8);
    push_varint((groups << 1 | 1) as u64, out);
    let start = out.len();
    out.resize(start + 8 * groups * bytes, 0);
    let room = &mut out[start..];
    match bytes {
        1 => room.iter_mut().zip(places).for_each(|(to, &place)| *to = place as u8),
        2 => room.as_chunks_mut().0.iter_mut().zip(places).for_each(|(to, &place)| *to = (place as u16).to_le_bytes()),
        _ => room.as_chunks_mut().0.iter_mut().zip(places).for_each(|(to, &place)| *to = place.to_le_bytes()),
    }
}

/// A number as Parquet has it.
pub(super) trait Number: Copy + PartialOrd {
    fn wide(self) -> i64;
    fn push(self, out: &mut Vec<u8>);
}

macro_rules! numbers {
    ($($kind:ty),*) => {$(
        impl Number for $kind {
            fn wide(self) -> i64 {
                i64::from(self)
            }

            fn push(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
        }
    )*};
}

numbers!(i32, i64);

/// Numbers: those of 16 bits are looked up, others searched for.
#[derive(Default)]
pub(super) struct Numbers<N> {
    /// One more than the place of a number; 0 where it was not seen.
    small: Vec<u32>,
    large: HashMap<i64, u32, FixedState>,
    seen: Vec<N>,
    places: Vec<u32>,
}

impl<N: Number> Numbers<N> {
    fn places(&mut self, numbers: impl Iterator<Item = N>, out: &mut Vec<u8>) {
        let mut places = std::mem::take(&mut self.places);
        places.clear();
        places.extend(numbers.map(|number| self.place(number)));
        push_places(&places, self.seen.len(), out);
        self.places = places;
    }

    #[inline]
    fn place(&mut self, number: N) -> u32 {
        let wide = number.wide();
        match self.small.get(wide as usize) {
            Some(&known) if known > 0 => known - 1,
            _ => self.find(number, wide),
        }
    }

    fn find(&mut self, number: N, wide: i64) -> u32 {
        let next = self.seen.len() as u32;
        let place = if let Ok(small) = u16::try_from(wide) {
            let small = usize::from(small);
            if self.small.len() <= small {
                self.small.resize(small + 1, 0);
            }
            self.small[small] = next + 1;
            next
        } else {
            *self.large.entry(wide).or_insert(next)
        };
        if place == next {
            self.seen.push(number);
        }
        place
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> usize {
        let count = self.seen.len();
        for number in self.seen.drain(..) {
            number.push(out);
            if let Some(small) = self.small.get_mut(number.wide() as usize) {
                *small = 0;
            }
        }
        self.large.clear();
        count
    }

    fn bounds(&self) -> Bounds<N> {
        let mut bounds = None;
        self.seen.iter().for_each(|&number| widen(&mut bounds, number));
        bounds
    }
}

impl Encoder<i64> for Numbers<i64> {
    const ENCODING: Encoding = Encoding::RLE_DICTIONARY;

    fn encode(&mut self, values: &ColumnBuilder<i64>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.places(some(values, nulls), out);
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> Option<usize> {
        Some(self.dictionary(out))
    }

    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        let (least, greatest) = self.bounds().unzip();
        Some(Statistics::int64(least, greatest, None, Some(nulls), false))
    }
}

impl Encoder<i32> for Numbers<i32> {
    const ENCODING: Encoding = Encoding::RLE_DICTIONARY;

    fn encode(&mut self, values: &ColumnBuilder<i32>, _: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.places(values.items.iter().copied(), out);
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> Option<usize> {
        Some(self.dictionary(out))
    }

    /// Those of all registers of a device help no query.
    fn statistics(&mut self, _: u64) -> Option<Statistics> {
        None
    }
}

/// Texts.
#[derive(Default)]
pub(super) struct Words {
    known: HashMap<Box<[u8]>, u32, FixedState>,
    /// As the dictionary has them.
    plain: Vec<u8>,
    /// The one before and its place: mostly the next one, too.
    latest: (Vec<u8>, u32),
    places: Vec<u32>,
}

impl Words {
    fn places<'a>(&mut self, words: impl Iterator<Item = &'a [u8]>, out: &mut Vec<u8>) {
        self.places.clear();
        for word in words {
            if self.known.is_empty() || word != self.latest.0 {
                self.find(word);
            }
            self.places.push(self.latest.1);
        }
        push_places(&self.places, self.known.len(), out);
    }

    fn find(&mut self, word: &[u8]) {
        let place = self.known.get(word).copied().unwrap_or_else(|| {
            let next = self.known.len() as u32;
            self.known.insert(word.into(), next);
            self.plain.extend_from_slice(&(word.len() as u32).to_le_bytes());
            self.plain.extend_from_slice(word);
            next
        });
        self.latest.0.clear();
        self.latest.0.extend_from_slice(word);
        self.latest.1 = place;
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> usize {
        out.append(&mut self.plain);
        let count = self.known.len();
        self.known.clear();
        count
    }
}

impl Encoder<u8> for Words {
    const ENCODING: Encoding = Encoding::RLE_DICTIONARY;

    fn encode(&mut self, values: &ColumnBuilder<u8>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.places(texts(values, nulls), out);
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> Option<usize> {
        Some(self.dictionary(out))
    }

    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        let bound = |word: Option<&Box<[u8]>>| word.map(|word| ByteArray::from(word.to_vec()));
        let (least, greatest) = (bound(self.known.keys().min()), bound(self.known.keys().max()));
        Some(Statistics::byte_array(least, greatest, None, Some(nulls), false))
    }
}

impl Encoder<&'static str> for Words {
    const ENCODING: Encoding = Encoding::RLE_DICTIONARY;

    fn encode(&mut self, values: &ColumnBuilder<&'static str>, _: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.places(values.items.iter().map(|word| word.as_bytes()), out);
    }

    fn dictionary(&mut self, out: &mut Vec<u8>) -> Option<usize> {
        Some(self.dictionary(out))
    }

    fn statistics(&mut self, _: u64) -> Option<Statistics> {
        None
    }
}
