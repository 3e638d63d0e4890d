//! Room for the text of one line whose length has a bound that is known before: its pieces are written one behind the other, and
//! nobody asks for each whether there is room.

use modlens_protocol::decimal::{decimal_texts, texts_with_comma};
use modlens_protocol::hex::digits_of;
use modlens_protocol::timestamp::{TimeFormatter, SECOND_BYTES};
use modlens_protocol::Ns;

/// The most bytes that a line in this room may have.
pub(crate) const LINE_BYTES: usize = 1 << 14;

/// Pieces are copied in sizes that the compiler knows: so far the last one may reach behind the line.
const SLACK: usize = 64;

/// The bytes of text whose length is not known when the program is built are copied so many at a time.
const PIECE_BYTES: usize = 32;

/// The most bytes of a number.
pub(crate) const NUMBER_BYTES: usize = 20;

/// The most bytes of a time.
pub(crate) const TIME_BYTES: usize = 30;

/// The most bytes of a duration: a sign, a number, and three decimals.
pub(crate) const DURATION_BYTES: usize = NUMBER_BYTES + 5;

/// The digits of each bit of a byte, the lowest first, with a separator behind each, by separator.
const BITS_WITH_BLANKS: [[u8; 16]; 256] = bit_texts(b' ');
const BITS_WITH_COMMAS: [[u8; 16]; 256] = bit_texts(b',');

const fn bit_texts(separator: u8) -> [[u8; 16]; 256] {
    let mut texts = [[separator; 16]; 256];
    let mut at = 0;
    while at < 8 * 256 {
        texts[at / 8][2 * (at % 8)] = b'0' + (at / 8 >> (at % 8) & 1) as u8;
        at += 1;
    }
    texts
}

/// What stands between the numbers of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Separator {
    /// A blank.
    Blank,
    /// A comma.
    Comma,
}

impl Separator {
    /// The texts of all numbers of 16 bits, each with the separator behind it.
    #[inline]
    fn number_texts(self) -> &'static [[u8; 8]; 1 << 16] {
        match self {
            Self::Blank => decimal_texts(),
            Self::Comma => texts_with_comma(),
        }
    }

    /// The digits of the bits of all bytes, each with the separator behind it.
    #[inline]
    fn bit_texts(self) -> &'static [[u8; 16]; 256] {
        match self {
            Self::Blank => &BITS_WITH_BLANKS,
            Self::Comma => &BITS_WITH_COMMAS,
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

    pub(crate) fn len(&self) -> usize {
        self.length
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

/// The room for a line.
pub(crate) struct LineRoom(Box<[u8; LINE_BYTES + SLACK]>);

/// A line as far as it is written.
///
/// It is handed on by value, so that its length stays in a register.
pub(crate) struct Line<'a> {
    room: &'a mut [u8; LINE_BYTES + SLACK],
    length: usize,
}

impl LineRoom {
    pub(crate) fn new() -> Self {
        Self(Box::new([0; LINE_BYTES + SLACK]))
    }

    /// An empty line.
    #[inline]
    pub(crate) fn line(&mut self) -> Line<'_> {
        Line { room: &mut self.0, length: 0 }
    }
}

#[allow(clippy::inline_always)] // A handful of instructions each, and the length would not stay in a register.
impl Line<'_> {
    /// Appends the first `length` of these bytes.
    #[inline(always)]
    fn put<const BYTES: usize>(mut self, bytes: &[u8; BYTES], length: usize) -> Self {
        // The mask, which changes nothing, tells the compiler that all of it lies in the room.
        self.room[self.length & (LINE_BYTES - 1)..][..BYTES].copy_from_slice(bytes);
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
    pub(crate) fn number(self, number: u64, high: &mut HighDigits) -> Self {
        let texts = decimal_texts();
        if let Some(entry) = texts.get(number as usize) {
            return self.put(entry, usize::from(entry[7]));
        }
        if number.wrapping_sub(high.from) >= 10_000 {
            high.change(number);
        }
        // The last four digits, with leading zeros, stand in the text of 1xxxx.
        let [_, a, b, c, d, ..] = texts[10_000 + (number - high.from) as usize];
        self.put(&high.digits, high.count).put(&[a, b, c, d], 4)
    }

    /// Appends a number of 16 bits.
    #[inline(always)]
    pub(crate) fn word(self, number: u16) -> Self {
        let entry = &decimal_texts()[usize::from(number)];
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
            self.number(number, &mut HighDigits::default())
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
    pub(crate) fn duration(self, ns: Ns) -> Self {
        let (sign, ns) = (usize::from(ns < 0), ns.unsigned_abs());
        let micros = ns / 1000;
        let line = self.put(b"-", sign).other_number(micros);
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

    /// Appends bytes as hex digits: sixteen at a time, and the last ones once more with those before them.
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

    /// Appends registers, the high byte of each first.
    #[inline]
    pub(crate) fn registers(mut self, bytes: &[u8], separator: Separator) -> Self {
        let texts = separator.number_texts();
        let registers = bytes.as_chunks::<2>().0;
        for register in registers {
            let entry = &texts[usize::from(u16::from_be_bytes(*register))];
            self = self.put(entry, usize::from(entry[7]) + 1);
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

    /// Takes off what was appended last.
    #[inline(always)]
    pub(crate) fn without_last(mut self, length: usize) -> Self {
        self.length -= length;
        self
    }

    /// Moves what is written to the end of `out`.
    #[inline(always)]
    pub(crate) fn move_to(mut self, out: &mut Vec<u8>) -> Self {
        out.extend_from_slice(&self.room[..self.length]);
        self.length = 0;
        self
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
        let (mut room, mut written, mut pushed) = (LineRoom::new(), Vec::new(), b"before".to_vec());
        room.0.fill(b'?');
        write(room.line().text(&FixedText::new(b"before"))).move_to(&mut written);
        push(&mut pushed);
        [written, pushed].map(|text| String::from_utf8(text).expect("ASCII"))
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
                let [written, pushed] = both(|line| line.number(number, &mut high), |out| push_int(number as i64, out));
                prop_assert_eq!(written, pushed);
            }
            let ns = ns >> shift;
            for duration in [ns, ns / 1000 * 1000] {
                let [written, pushed] = both(|line| line.duration(duration), |out| push_us(duration, out));
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
                    both(|line| line.registers(&bytes, separator), |out| push(&Items::Words(&bytes), out));
                prop_assert_eq!(written, pushed);
                let [written, pushed] =
                    both(|line| line.bits(&bytes, bits, separator), |out| push(&Items::Bits(&bytes, bits), out));
                prop_assert_eq!(written, pushed);
            }
            let [written, pushed] = both(|line| line.hex(&bytes), |out| push_hex(&bytes, out));
            prop_assert_eq!(written, pushed);
            let [written, pushed] = both(|line| line.text(&FixedText::new(&bytes[..bytes.len() / 2])), |out| {
                out.extend_from_slice(&bytes[..bytes.len() / 2]);
            }).map(|text| text.len());
            prop_assert_eq!(written, pushed);
        }
    }
}
