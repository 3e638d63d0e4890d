//! Encodings without a dictionary (parquet-format, Encodings.md).

use arrow_buffer::NullBuffer;
use parquet::basic::Encoding;
use parquet::file::statistics::Statistics;

use super::column::Encoder;
use crate::values::ColumnBuilder;

/// ULEB128.
pub(super) fn push_varint(mut value: u64, out: &mut Vec<u8>) {
    while value > 0x7F {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn push_zigzag(value: i64, out: &mut Vec<u8>) {
    push_varint((value << 1 ^ value >> 63) as u64, out);
}

/// Levels as runs of one value each ("RLE/bit-packing hybrid"), behind their length in bytes.
pub(super) struct Runs<'a> {
    pub(super) out: &'a mut Vec<u8>,
    start: usize,
    value: u8,
    count: usize,
}

impl<'a> Runs<'a> {
    pub(super) fn begin(out: &'a mut Vec<u8>) -> Self {
        let start = out.len();
        out.extend_from_slice(&[0; 4]);
        Self { out, start, value: 0, count: 0 }
    }

    /// This value so many times more.
    pub(super) fn put(&mut self, value: u8, count: usize) {
        if value != self.value && count > 0 {
            self.flush();
            self.value = value;
        }
        self.count += count;
    }

    fn flush(&mut self) {
        if self.count > 0 {
            push_varint((self.count as u64) << 1, self.out);
            self.out.push(self.value);
            self.count = 0;
        }
    }

    pub(super) fn end(mut self) {
        self.flush();
        let length = (self.out.len() - self.start - 4) as u32;
        self.out[self.start..self.start + 4].copy_from_slice(&length.to_le_bytes());
    }
}

/// The values that are not null.
pub(super) fn some<'a, T: Copy>(values: &'a ColumnBuilder<T>, nulls: Option<&'a NullBuffer>) -> impl Iterator<Item = T> + 'a {
    let items = values.items.iter().enumerate();
    items.filter(move |(row, _)| nulls.is_none_or(|nulls| nulls.is_valid(*row))).map(|(_, item)| *item)
}

/// The texts that are not null.
pub(super) fn texts<'a>(values: &'a ColumnBuilder<u8>, nulls: Option<&'a NullBuffer>) -> impl Iterator<Item = &'a [u8]> {
    let ends = values.offsets.windows(2).enumerate();
    let there = ends.filter(move |(row, _)| nulls.is_none_or(|nulls| nulls.is_valid(*row)));
    there.map(|(_, ends)| &values.items[ends[0] as usize..ends[1] as usize])
}

/// The least and the greatest of some values.
pub(super) type Bounds<T> = Option<(T, T)>;

pub(super) fn widen<T: Copy + PartialOrd>(bounds: &mut Bounds<T>, value: T) {
    *bounds = Some(match *bounds {
        None => (value, value),
        Some((least, greatest)) => (if value < least { value } else { least }, if value > greatest { value } else { greatest }),
    });
}

/// Whole numbers as differences (`DELTA_BINARY_PACKED`): counters take next to no room.
#[derive(Default)]
pub(super) struct Deltas {
    bounds: Bounds<i64>,
    numbers: Vec<i64>,
}

/// Differences of a block, which share their least one; of a miniblock, which share their width.
const BLOCK: usize = 128;
const MINI: usize = 32;

impl Encoder<i64> for Deltas {
    const ENCODING: Encoding = Encoding::DELTA_BINARY_PACKED;

    fn encode(&mut self, values: &ColumnBuilder<i64>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.numbers.clear();
        self.numbers.extend(some(values, nulls));
        for &number in &self.numbers {
            widen(&mut self.bounds, number);
        }
        push_deltas(&self.numbers, out);
    }

    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        let (least, greatest) = self.bounds.take().unzip();
        Some(Statistics::int64(least, greatest, None, Some(nulls), false))
    }
}

fn push_deltas(numbers: &[i64], out: &mut Vec<u8>) {
    push_varint(BLOCK as u64, out);
    push_varint((BLOCK / MINI) as u64, out);
    push_varint(numbers.len() as u64, out);
    let Some((&first, rest)) = numbers.split_first() else { return push_zigzag(0, out) };
    push_zigzag(first, out);
    let mut before = first;
    for block in rest.chunks(BLOCK) {
        let mut deltas = [0; BLOCK];
        for (delta, &number) in deltas.iter_mut().zip(block) {
            *delta = number.wrapping_sub(before);
            before = number;
        }
        push_block(&mut deltas, block.len(), out);
    }
}

/// Appends a block of which so many are there; the last miniblock of them is filled up, those behind it are left out.
fn push_block(deltas: &mut [i64; BLOCK], count: usize, out: &mut Vec<u8>) {
    let least = deltas[..count].iter().copied().min().unwrap_or(0);
    push_zigzag(least, out);
    let widths = out.len();
    out.extend_from_slice(&[0; BLOCK / MINI]);
    for (at, mini) in deltas[..count].chunks(MINI).enumerate() {
        let any = mini.iter().fold(0, |any, delta| any | delta.wrapping_sub(least) as u64);
        let width = u64::BITS - any.leading_zeros();
        out[widths + at] = width as u8;
        if width > 0 {
            let mut all = [0; MINI];
            all.iter_mut().zip(mini).for_each(|(one, delta)| *one = delta.wrapping_sub(least) as u64);
            push_packed(&all, width, out);
        }
    }
}

/// Appends numbers of so many bits, the lowest bits first.
fn push_packed(numbers: &[u64; MINI], width: u32, out: &mut Vec<u8>) {
    let (mut bits, mut held) = (0_u128, 0);
    for &number in numbers {
        bits |= u128::from(number) << held;
        held += width;
        if held >= u64::BITS {
            out.extend_from_slice(&(bits as u64).to_le_bytes());
            bits >>= u64::BITS;
            held -= u64::BITS;
        }
    }
    out.extend_from_slice(&bits.to_le_bytes()[..held as usize / 8]);
}

/// Texts: their lengths as differences, then their bytes (`DELTA_LENGTH_BYTE_ARRAY`).
#[derive(Default)]
pub(super) struct Lengths {
    lengths: Vec<i64>,
}

impl Encoder<u8> for Lengths {
    const ENCODING: Encoding = Encoding::DELTA_LENGTH_BYTE_ARRAY;

    fn encode(&mut self, values: &ColumnBuilder<u8>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        self.lengths.clear();
        self.lengths.extend(texts(values, nulls).map(|text| text.len() as i64));
        push_deltas(&self.lengths, out);
        // A null has no bytes.
        out.extend_from_slice(&values.items);
    }

    /// The least and the greatest of bytes in hex help no query.
    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        Some(Statistics::byte_array(None, None, None, Some(nulls), false))
    }
}

/// Values as they are (`PLAIN`).
#[derive(Default)]
pub(super) struct Plain<T> {
    bounds: Bounds<T>,
}

impl Encoder<f64> for Plain<f64> {
    const ENCODING: Encoding = Encoding::PLAIN;

    fn encode(&mut self, values: &ColumnBuilder<f64>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        for number in some(values, nulls) {
            if !number.is_nan() {
                widen(&mut self.bounds, number);
            }
            out.extend_from_slice(&number.to_le_bytes());
        }
    }

    /// Zeros have two signs, and a reader looks for either (parquet.thrift, `ColumnOrder`).
    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        let signed = |(least, greatest)| (if least == 0.0 { -0.0 } else { least }, if greatest == 0.0 { 0.0 } else { greatest });
        let (least, greatest) = self.bounds.take().map(signed).unzip();
        Some(Statistics::double(least, greatest, None, Some(nulls), false))
    }
}

impl Encoder<bool> for Plain<bool> {
    const ENCODING: Encoding = Encoding::PLAIN;

    fn encode(&mut self, values: &ColumnBuilder<bool>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
        let start = out.len();
        for (at, yes) in some(values, nulls).enumerate() {
            if at % 8 == 0 {
                out.push(0);
            }
            out[start + at / 8] |= u8::from(yes) << (at % 8);
            widen(&mut self.bounds, yes);
        }
    }

    fn statistics(&mut self, nulls: u64) -> Option<Statistics> {
        let (least, greatest) = self.bounds.take().unzip();
        Some(Statistics::boolean(least, greatest, None, Some(nulls), false))
    }
}
