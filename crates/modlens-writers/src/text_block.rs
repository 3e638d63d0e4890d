//! A block of text that is written to a file in one block. Lines whose length has a bound that is known before are made in it: their
//! blocks are written one after the other, without a check for room before each.

use modlens_protocol::decimal::{decimal_texts, texts_with_comma};
use modlens_protocol::hex::digits_of;
use modlens_protocol::timestamp::{TimeFormatter, SECOND_BYTES};
use modlens_protocol::Ns;
use modlens_tables::cell_text::bit_texts;

/// A block ends with the row that makes it longer than this. Blocks of this size stay in the processor's cache until they
/// are written. A file takes smaller ones more slowly, a third in blocks of half the size.
pub const BLOCK_BYTES: usize = 1 << 17;

/// The most bytes that a line may have that is made in a block.
pub(crate) const LINE_BYTES: usize = 1 << 14;

/// Where lines are made that begin before `BLOCK_BYTES`: no place in them is after it. A power of two.
const ROOM: usize = 2 * BLOCK_BYTES;

/// Blocks are copied in sizes that the compiler knows: so far the last one may reach after the line.
const SLACK: usize = 64;

/// The bytes of text whose length is not known when the program is built are copied so many at a time.
const PIECE_BYTES: usize = 32;

/// The most bytes of a number.
pub(crate) const NUMBER_BYTES: usize = 20;

/// The most bytes of a time.
pub(crate) const TIME_BYTES: usize = 30;

/// The most bytes of a duration: a sign, a number, and three decimals.
pub(crate) const DURATION_BYTES: usize = NUMBER_BYTES + 5;

/// The texts of all numbers of 16 bits (`decimal_texts`).
pub(crate) type NumberTexts = [[u8; 8]; 1 << 16];

/// What is between the numbers of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// A blank.
    Blank,
    /// A comma.
    Comma,
}

impl Separator {
    /// The texts of all numbers of 16 bits, each with the separator after it.
    #[inline]
    pub(crate) fn number_texts(self) -> &'static NumberTexts {
        match self {
            Self::Blank => decimal_texts(),
            Self::Comma => texts_with_comma(),
        }
    }

    /// The digits of the bits of all bytes, each with the separator after it.
    #[inline]
    fn bit_texts(self) -> &'static [[u8; 16]; 256] {
        match self {
            Self::Blank => const { &bit_texts(b' ') },
            Self::Comma => const { &bit_texts(b',') },
        }
    }
}

/// A text that is written again and again.
pub(crate) struct FixedText {
    length: usize,
    first: [u8; PIECE_BYTES],
    /// The others.
    pieces: Vec<[u8; PIECE_BYTES]>,
}

impl FixedText {
    pub(crate) fn new(text: &[u8]) -> Self {
        let mut pieces = text.chunks(PIECE_BYTES).map(|bytes| {
            let mut piece = [0; PIECE_BYTES];
            piece[..bytes.len()].copy_from_slice(bytes);
            piece
        });
        Self { length: text.len(), first: pieces.next().unwrap_or_default(), pieces: pieces.collect() }
    }
}

/// A number whose digits but for the last four are remembered: numbers that rise by one or two from line to line have them in common.
#[derive(Default)]
pub(crate) struct HighDigits {
    /// The numbers from here on have them, ten thousand; 0 if there are none yet.
    from: u64,
    digits: [u8; 16],
    count: usize,
}

impl HighDigits {
    #[cold]
    fn change(&mut self, number: u64) {
        self.from = number / 10_000 * 10_000;
        let digits = (number / 10_000).to_string();
        self.count = digits.len();
        self.digits[..self.count].copy_from_slice(digits.as_bytes());
    }
}

/// A block of text.
pub struct TextBlock {
    /// The text, and room after it.
    bytes: Vec<u8>,
    length: usize,
}

/// A line in a block as far as it is written.
///
/// It is handed on by value, so that the length stays in a register, and has two words, as many as a function can return in registers.
pub(crate) struct Line<'a> {
    room: &'a mut [u8; ROOM + SLACK],
    /// Of the block.
    length: usize,
}

impl Default for TextBlock {
    /// An empty one. The system gives memory for what is written to.
    fn default() -> Self {
        Self { bytes: vec![0; ROOM + SLACK], length: 0 }
    }
}

impl TextBlock {
    /// The text.
    pub fn text(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Whether the block is as long as it should be.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.length >= BLOCK_BYTES
    }

    /// Makes it empty.
    pub fn clear(&mut self) {
        self.drop_first(self.length);
    }

    /// Takes the first bytes off, which are written.
    pub fn drop_first(&mut self, count: usize) {
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
        // A row may have been longer than any block.
        self.bytes.truncate(self.length.max(ROOM + SLACK));
        self.bytes.shrink_to(ROOM + SLACK);
    }

    /// Appends a text of any length.
    pub fn append(&mut self, text: &[u8]) {
        let end = self.length + text.len();
        if end > self.bytes.len() {
            self.bytes.resize(end, 0);
        }
        self.bytes[self.length..end].copy_from_slice(text);
        self.length = end;
    }

    /// A new line after the text, which is part of it once it is given to `add`; `None` where the block is full.
    #[inline]
    pub(crate) fn line(&mut self) -> Option<Line<'_>> {
        if self.is_full() {
            return None;
        }
        Some(Line { room: self.bytes.first_chunk_mut()?, length: self.length })
    }

    /// Adds a line of this block, of which its length is left.
    #[inline]
    pub(crate) fn add(&mut self, line_end: usize) {
        self.length = line_end;
    }
}

#[allow(clippy::inline_always)] // A handful of instructions each, and the length would not stay in a register.
impl Line<'_> {
    /// Appends the first `length` of these bytes.
    #[inline(always)]
    fn put<const BYTES: usize>(mut self, bytes: &[u8; BYTES], length: usize) -> Self {
        // The mask, which changes nothing, shows the compiler that all of it lies in the room.
        self.room[self.length & (ROOM - 1)..][..BYTES].copy_from_slice(bytes);
        self.length += length;
        self
    }

    /// Appends a fixed text.
    #[inline(always)]
    pub(crate) fn text(self, text: &FixedText) -> Self {
        let end = self.length + text.length;
        let mut line = self.put(&text.first, PIECE_BYTES);
        for piece in &text.pieces {
            line = line.put(piece, PIECE_BYTES);
        }
        line.length = end;
        line
    }

    /// Appends a number.
    #[inline(always)]
    pub(crate) fn number(self, number: u64, high: &mut HighDigits, texts: &NumberTexts) -> Self {
        if let Some(entry) = texts.get(number as usize) {
            return self.put(entry, usize::from(entry[7]));
        }
        if number.wrapping_sub(high.from) >= 10_000 {
            high.change(number);
        }
        // The last four digits, with leading zeros, are in the text of 1xxxx.
        let [_, a, b, c, d, ..] = texts[10_000 + (number - high.from) as usize];
        self.put(&high.digits, high.count).put(&[a, b, c, d], 4)
    }

    /// Appends a number of 16 bits.
    #[inline(always)]
    pub(crate) fn word(self, number: u16, texts: &NumberTexts) -> Self {
        let entry = &texts[usize::from(number)];
        self.put(entry, usize::from(entry[7]))
    }

    /// Appends a number that has nothing to do with the one before.
    #[inline(never)]
    fn other_number(self, number: u64) -> Self {
        let texts = decimal_texts();
        let four = |number: u64| {
            let [_, a, b, c, d, ..] = texts[10_000 + (number % 10_000) as usize];
            [a, b, c, d]
        };
        if let Some(entry) = texts.get(number as usize) {
            self.put(entry, usize::from(entry[7]))
        } else if let Some(entry) = texts.get((number / 10_000) as usize) {
            self.put(entry, usize::from(entry[7])).put(&four(number), 4)
        } else if let Some(entry) = texts.get((number / 100_000_000) as usize) {
            self.put(entry, usize::from(entry[7])).put(&four(number / 10_000), 4).put(&four(number), 4)
        } else {
            self.number(number, &mut HighDigits::default(), texts)
        }
    }

    /// Appends a time.
    #[inline(always)]
    pub(crate) fn time(self, ns: Ns, formatter: &mut TimeFormatter) -> Self {
        let (text, fraction, length) = formatter.parts(ns);
        self.put(text, SECOND_BYTES).put(&fraction, length)
    }

    /// Appends a duration in microseconds with as many decimals as it has.
    #[inline]
    pub(crate) fn duration(self, ns: Ns, texts: &NumberTexts) -> Self {
        let (sign, ns) = (usize::from(ns < 0), ns.unsigned_abs());
        let micros = ns / 1000;
        let line = self.put(b"-", sign);
        let line = match texts.get(micros as usize) {
            Some(entry) => line.put(entry, usize::from(entry[7])),
            None => line.other_number(micros),
        };
        if micros * 1000 == ns {
            line
        } else {
            line.decimals((ns % 1000) as u32)
        }
    }

    /// Appends decimals, three digits without zeros at the end.
    #[cold]
    fn decimals(self, rest: u32) -> Self {
        let text = format!(".{rest:03}");
        let shown = text.trim_end_matches('0').as_bytes();
        let mut bytes = [0; 4];
        bytes[..shown.len()].copy_from_slice(shown);
        self.put(&bytes, shown.len())
    }

    /// Appends a truth value.
    #[inline(always)]
    pub(crate) fn truth(self, yes: bool) -> Self {
        self.put(if yes { b"true\0\0\0\0" } else { b"false\0\0\0" }, if yes { 4 } else { 5 })
    }

    /// Appends bytes as hex digits: sixteen at a time, and the last ones again with those before them.
    #[inline]
    pub(crate) fn hex(mut self, bytes: &[u8]) -> Self {
        let end = self.length + 2 * bytes.len();
        if let Some(last) = bytes.last_chunk::<16>() {
            for group in bytes.as_chunks::<16>().0 {
                self = self.put::<32>(digits_of(group).as_flattened().try_into().expect("twice as many"), 32);
            }
            self.length = end - 32;
            self = self.put::<32>(digits_of(last).as_flattened().try_into().expect("twice as many"), 32);
        } else if let (Some(first), Some(last)) = (bytes.first_chunk::<8>(), bytes.last_chunk::<8>()) {
            self = self.put::<16>(digits_of(first).as_flattened().try_into().expect("twice as many"), 16);
            self.length = end - 16;
            self = self.put::<16>(digits_of(last).as_flattened().try_into().expect("twice as many"), 16);
        } else {
            let mut few = [0; 8];
            few.iter_mut().zip(bytes).for_each(|(to, &byte)| *to = byte);
            self = self.put::<16>(digits_of(&few).as_flattened().try_into().expect("twice as many"), 16);
        }
        self.length = end;
        self
    }

    /// Appends registers, the high byte of each first. The texts have what is between two after each.
    #[inline]
    pub(crate) fn registers(mut self, bytes: &[u8], texts: &NumberTexts) -> Self {
        let registers = bytes.as_chunks::<2>().0;
        for register in registers {
            let entry = texts[usize::from(u16::from_be_bytes(*register))];
            self = self.put(&entry, (u64::from_le_bytes(entry) >> 56) as usize + 1);
        }
        self.length -= usize::from(!registers.is_empty());
        self
    }

    /// Appends so many bits, the lowest of each byte first, or as many as there are.
    #[inline]
    pub(crate) fn bits(mut self, bytes: &[u8], count: usize, separator: Separator) -> Self {
        let (texts, count) = (separator.bit_texts(), count.min(8 * bytes.len()));
        let end = self.length + (2 * count).saturating_sub(1);
        for &byte in &bytes[..count.div_ceil(8)] {
            self = self.put(&texts[usize::from(byte)], 16);
        }
        self.length = end;
        self
    }

    /// Appends a text of any length; `None` if there is no room for it.
    #[inline]
    pub(crate) fn any_text(mut self, text: &[u8]) -> Option<Self> {
        let end = self.length + text.len();
        if end > ROOM - LINE_BYTES {
            return None;
        }
        self.room[self.length..end].copy_from_slice(text);
        self.length = end;
        Some(self)
    }

    /// Takes off what was appended last.
    #[inline(always)]
    pub(crate) fn without_last(mut self, length: usize) -> Self {
        self.length -= length;
        self
    }

    /// Where it ends in the block.
    #[inline(always)]
    pub(crate) fn end(self) -> usize {
        self.length
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::decimal::push_int;
    use modlens_protocol::hex::push_hex;
    use modlens_protocol::timestamp::push_time;
    use modlens_tables::cell_text::{push_items, push_us};
    use modlens_tables::columns::Items;
    use proptest::prelude::*;

    /// What `write` appends to a line that has begun, and what `push` appends to a vector.
    fn both(write: impl FnOnce(Line<'_>) -> Line<'_>, push: impl FnOnce(&mut Vec<u8>)) -> [String; 2] {
        let (mut block, mut pushed) = (TextBlock::default(), b"before".to_vec());
        block.bytes.fill(b'?');
        block.append(b"bef");
        let line = block.line().expect("it is not full").text(&FixedText::new(b"ore"));
        let end = write(line).end();
        block.add(end);
        push(&mut pushed);
        [block.text().to_vec(), pushed].map(|text| String::from_utf8(text).expect("ASCII"))
    }

    #[test]
    fn a_text_may_be_longer_than_a_block() {
        let mut block = TextBlock::default();
        block.append(&vec![b'a'; BLOCK_BYTES - 1]);
        let line = block.line().expect("it is not full").text(&FixedText::new(b"bc"));
        assert!(line.any_text(&vec![b'd'; ROOM]).is_none());
        assert_eq!(block.text().len(), BLOCK_BYTES - 1);
        block.append(&vec![b'b'; 3 * ROOM]);
        assert!(block.is_full() && block.line().is_none());
        assert_eq!((block.text().len(), block.text().ends_with(b"b")), (BLOCK_BYTES - 1 + 3 * ROOM, true));
        block.clear();
        assert!(block.text().is_empty() && block.line().is_some());
    }

    fn number() -> impl Strategy<Value = u64> {
        (any::<u64>(), 0u32..64).prop_map(|(number, shift)| number >> shift & i64::MAX as u64)
    }

    proptest! {
        #[test]
        fn pieces_are_those_of_the_general_way(number in number(), step in 0u64..20_000, ns in any::<i64>(), shift in 0u32..64) {
            let next = number.saturating_add(step).min(i64::MAX as u64);
            let mut high = HighDigits::default();
            for number in [number, next, number] {
                let [written, pushed] = both(|line| line.number(number, &mut high, decimal_texts()), |out| push_int(number as i64, out));
                prop_assert_eq!(written, pushed);
            }
            let ns = ns >> shift;
            for duration in [ns, ns / 1000 * 1000] {
                let [written, pushed] = both(|line| line.duration(duration, decimal_texts()), |out| push_us(duration, out));
                prop_assert_eq!(written, pushed);
            }
            let mut formatter = TimeFormatter::default();
            for time in [ns, ns.saturating_add(step as i64), ns] {
                let [written, pushed] = both(|line| line.time(time, &mut formatter), |out| push_time(time, out));
                prop_assert_eq!(written, pushed);
            }
        }

        #[test]
        fn lists_are_those_of_the_general_way(bytes in proptest::collection::vec(any::<u8>(), 0..300), bits in 0usize..2500) {
            for separator in [Separator::Blank, Separator::Comma] {
                let push = |items: &Items<'_>, out: &mut Vec<u8>| match separator {
                    Separator::Blank => push_items::<b' '>(items, out),
                    Separator::Comma => push_items::<b','>(items, out),
                };
                let [written, pushed] =
                    both(|line| line.registers(&bytes, separator.number_texts()), |out| push(&Items::Words(&bytes), out));
                prop_assert_eq!(written, pushed);
                let [written, pushed] =
                    both(|line| line.bits(&bytes, bits, separator), |out| push(&Items::Bits(&bytes, bits), out));
                prop_assert_eq!(written, pushed);
            }
            let [written, pushed] = both(|line| line.hex(&bytes), |out| push_hex(&bytes, out));
            prop_assert_eq!(written, pushed);
            let text: Vec<u8> = bytes.iter().map(|byte| b'a' + byte % 26).collect();
            let [written, pushed] = both(|line| line.text(&FixedText::new(&text)), |out| out.extend_from_slice(&text));
            prop_assert_eq!(written, pushed);
        }
    }
}
