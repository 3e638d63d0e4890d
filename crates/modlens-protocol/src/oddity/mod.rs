//! What is odd about bytes that are no frame, as far as they show it by themselves: a checksum with its bytes swapped, a header
//! that announces another length, a frame in letters. Each is something that no disturbance of a line brings forth.

mod altered;
mod text;
mod words;

use altered::is_altered;
pub use altered::Altered;
pub use text::{is_text, opening};
use text::{wrong_lrc, LEAST_LETTERS};

use crate::annotate::exception_name;
use crate::checksum::{correctable_bit, crc16, crc_valid, CRC_BYTES};
use crate::direction::possible_directions;
use crate::functions::{Functions, StandardLayout, EXCEPTION_BIT};
use crate::mbap::{layout_fits, layout_lengths, PREFIX_BYTES};

/// The shortest RTU frame: unit, function code, checksum.
const LEAST_FRAME: usize = 4;

/// The shortest exception response, without its checksum.
const LEAST_REFUSAL: usize = 3;

/// A request to read, without its checksum.
const READ_BYTES: usize = 6;

/// The same with its checksum.
const READ_FRAME: usize = 8;

/// So many bytes that are nearly all the same, or of so few values that each is there so often, are no accident.
const LEAST_SAME: usize = 16;
const LEAST_OF_FEW: usize = 24;
const BYTES_PER_VALUE: usize = 5;

/// The most bytes in front of a frame that are looked at.
const MOST_STRAY: usize = 2;

/// What is odd about a run of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Oddity {
    /// The bytes are hex digits, each sent as a character; the digits.
    Digits(String),
    /// The bytes are text; its beginning.
    Text(String),
    /// The bytes are a frame of Modbus ASCII, but for its checksum.
    AsciiSum {
        /// What is there.
        there: u8,
        /// What belongs there.
        due: u8,
    },
    /// The checksum is right, but its high byte is first.
    SwappedChecksum,
    /// The last byte, put in front, makes a frame.
    OutOfStep,
    /// An MBAP header announces another number of bytes than follow, and what follows is whole by its layout.
    HeaderLength {
        /// By the header, the unit included.
        announced: usize,
        /// What follows.
        present: usize,
    },
    /// So many bytes are in front of a frame, which is whole or lacks its last byte.
    StrayFront {
        /// How many.
        bytes: usize,
        /// Whether the last byte of the frame is missing.
        is_cut: bool,
    },
    /// A frame that lacks its last byte.
    Cut,
    /// The same of a request to read.
    CutRequest,
    /// An exception response without a right checksum, or printed without its unit, which the checksum shows.
    Refusal {
        /// Who refuses.
        unit: u8,
        /// What was asked for, and the code.
        function: u8,
        /// The exception.
        code: u8,
    },
    /// The answer to a read begins with another function.
    OtherFunction {
        /// What was asked for.
        asked: u8,
        /// What came.
        answered: u8,
    },
    /// The byte count of the answer to a read is not that of what was asked for, and the rest of it shows no other request.
    OtherCount {
        /// What the answer says.
        counted: u8,
        /// What was asked for.
        due: u8,
    },
    /// Nearly all bytes are the same, which is neither 00 nor a character of a text; which, how many, and of how many.
    Constant {
        /// The byte.
        byte: u8,
        /// How often it is there.
        times: usize,
        /// All bytes.
        of: usize,
    },
    /// Many bytes of few values, as no frame is; how many, and which.
    FewValues {
        /// All bytes.
        bytes: usize,
        /// The values.
        values: Vec<u8>,
    },
    /// The answer to a read is the read itself.
    Echo,
    /// Each byte is there twice, and one of each two makes a frame.
    Doubled,
    /// The bytes of the line before with so many in front.
    StrayBeside(usize),
    /// The request of the line before with some of its bits changed.
    AlteredRequest,
    /// All bytes are 00; how many.
    Zeros(usize),
    /// Nearly all bytes are 00, FF, or one run of equal bits beside another.
    Levels,
}

/// What the frames of a text show, beside the words of the same text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Printed {
    /// A request was answered.
    pub has_answered: bool,
    /// Each request was answered.
    pub has_all_answered: bool,
    /// Whole answers with a right checksum came, and no damaged one.
    pub has_whole_answers: bool,
    /// All frames have a right checksum, and there is one at least.
    pub is_whole: bool,
}

/// What lines of a text report that hold no frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reported {
    /// The words.
    pub words: String,
    /// Bytes are among these lines, so that the frames of the text are not all that it prints.
    pub has_bytes: bool,
    /// All that is known of these lines is that they hold bytes.
    pub is_unknown: bool,
}

impl Oddity {
    /// What is odd about these bytes; `None` for a frame, and for bytes that show nothing.
    ///
    /// ```
    /// use modlens_protocol::oddity::Oddity;
    /// // The example of the specification for function 3, with the checksum 76 87 (low byte first) the wrong way round.
    /// assert_eq!(Oddity::of(&[0x11, 3, 0, 0x6B, 0, 3, 0x87, 0x76]), Some(Oddity::SwappedChecksum));
    /// assert_eq!(Oddity::of(&[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87]), None);
    /// ```
    pub fn of(bytes: &[u8]) -> Option<Self> {
        if bytes.len() < LEAST_REFUSAL || crc_valid(bytes) {
            return None;
        }
        if let Some(refusal) = refusal(bytes) {
            return Some(refusal);
        }
        if bytes.len() < LEAST_FRAME {
            return None;
        }
        if bytes.len() >= LEAST_LEVELS && bytes.iter().all(|byte| *byte == 0) {
            return Some(Self::Zeros(bytes.len()));
        }
        if let Some(digits) = digits(bytes) {
            return Some(Self::Digits(digits));
        }
        if let Some([there, due]) = wrong_lrc(bytes) {
            return Some(Self::AsciiSum { there, due });
        }
        if is_text(bytes) {
            return Some(Self::Text(opening(bytes)));
        }
        if is_swapped(bytes) {
            return Some(Self::SwappedChecksum);
        }
        if is_doubled(bytes) {
            return Some(Self::Doubled);
        }
        if is_out_of_step(bytes) {
            return Some(Self::OutOfStep);
        }
        header_length(bytes)
            .or_else(|| stray_front(bytes))
            .or_else(|| lacks_last(bytes).then_some(Self::Cut))
            .or_else(|| is_cut_request(bytes).then_some(Self::CutRequest))
            .or_else(|| is_of_levels(bytes).then_some(Self::Levels))
    }

    /// What is odd about the bytes that came after a request to read; neither needs a checksum.
    ///
    /// ```
    /// use modlens_protocol::oddity::Oddity;
    /// let request = [0x55, 3, 0x3F, 0xFF, 0, 1];
    /// assert_eq!(Oddity::of_answer(&request, &[0x55, 0xFF, 1]), Some(Oddity::OtherFunction { asked: 3, answered: 0xFF }));
    /// assert_eq!(Oddity::of_answer(&request, &request), Some(Oddity::Echo));
    /// assert_eq!(Oddity::of_answer(&request, &[0x55, 3, 2, 0, 9]), None);
    /// ```
    pub fn of_answer(request: &[u8], answer: &[u8]) -> Option<Self> {
        let (asked, checksum) = request.split_at_checked(READ_BYTES)?;
        if !is_read(asked) || !matches!(checksum.len(), 0 | CRC_BYTES) || answer.len() < LEAST_REFUSAL || answer[0] != asked[0] {
            return None;
        }
        if answer.len() >= READ_BYTES && request.starts_with(answer) {
            return Some(Self::Echo);
        }
        let [asked, answered] = [asked[1], answer[1]];
        (answered & !EXCEPTION_BIT != asked).then_some(Self::OtherFunction { asked, answered })
    }

    /// Whether an answer that is no valid frame counts other bytes than a request to read asks for.
    ///
    /// ```
    /// use modlens_protocol::oddity::Oddity;
    /// // Three registers have six bytes; 06 and 26 (38) differ in one bit.
    /// let request = [0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87];
    /// assert_eq!(Oddity::of_count(&request, &[0x11, 3, 0x26, 2, 0x2B]), Some(Oddity::OtherCount { counted: 0x26, due: 6 }));
    /// assert_eq!(Oddity::of_count(&request, &[0x11, 3, 6, 2, 0x2B]), None);
    /// ```
    pub fn of_count(request: &[u8], answer: &[u8]) -> Option<Self> {
        let (asked, _) = request.split_at_checked(READ_BYTES).filter(|(asked, _)| is_read(asked))?;
        let [unit, function, counted, ..] = *answer else { return None };
        let quantity = usize::from(u16::from_be_bytes([asked[4], asked[5]]));
        let due = u8::try_from(if function <= 2 { quantity.div_ceil(8) } else { 2 * quantity }).ok()?;
        // Six bytes, or eight, may be another request.
        let is_answer =
            asked[..2] == [unit, function] && !matches!(answer.len(), READ_BYTES | READ_FRAME) && answer.len() > LEAST_FRAME;
        (is_answer && counted != due && !crc_valid(answer)).then_some(Self::OtherCount { counted, due })
    }

    /// What a receiver sees that gets no Modbus: one value over and over, levels, or few values.
    ///
    /// ```
    /// use modlens_protocol::oddity::Oddity;
    /// assert_eq!(Oddity::of_signal(&[0xB5; 20]), Some(Oddity::Constant { byte: 0xB5, times: 20, of: 20 }));
    /// assert_eq!(Oddity::of_signal(&[0, 0, 0xFF, 0, 0xFE, 0, 0, 0, 0xF8, 0, 0, 0xFF]), Some(Oddity::Levels));
    /// assert_eq!(Oddity::of_signal(&[1, 3, 20, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xC4, 0x0B]), None);
    /// ```
    pub fn of_signal(bytes: &[u8]) -> Option<Self> {
        let mut counts = [0usize; 256];
        for byte in bytes {
            counts[usize::from(*byte)] += 1;
        }
        let most = (0..=u8::MAX).max_by_key(|byte| counts[usize::from(*byte)])?;
        let times = counts[usize::from(most)];
        let is_frame = matches!(bytes[..bytes.len().min(2)], [1..=247, code] if is_known(code));
        if is_of_levels(bytes) {
            return Some(Self::Levels);
        }
        if bytes.len() >= LEAST_SAME && times * 20 >= bytes.len() * 19 && most != 0 && !most.is_ascii_graphic() && most != b' ' {
            return Some(Self::Constant { byte: most, times, of: bytes.len() });
        }
        let values: Vec<u8> = (0..=u8::MAX).filter(|byte| counts[usize::from(*byte)] > 0).collect();
        // Registers are often 0, and a text has signs.
        let is_few = bytes.len() >= LEAST_OF_FEW && values.len() * BYTES_PER_VALUE <= bytes.len() && values.len() > 2;
        let is_mixed = counts[0] * 2 < bytes.len() && times * 4 < bytes.len() * 3;
        (is_few && is_mixed && !is_frame && !is_text(bytes)).then_some(Self::FewValues { bytes: bytes.len(), values })
    }

    /// What is odd about bytes beside those before them, as where one list is what was sent, and the other what was received.
    ///
    /// ```
    /// use modlens_protocol::oddity::Oddity;
    /// let sent = [1, 1, 0, 0, 0, 0x67, 0x7C, 0x26];
    /// assert_eq!(Oddity::of_copy(&sent, &[&[0xFF], &sent[..]].concat()), Some(Oddity::StrayBeside(1)));
    /// assert_eq!(Oddity::of_copy(&sent, &sent), None);
    /// ```
    pub fn of_copy(before: &[u8], bytes: &[u8]) -> Option<Self> {
        let more = bytes.len().saturating_sub(before.len());
        if before.len() >= READ_BYTES && (1..=MOST_STRAY).contains(&more) && bytes.ends_with(before) {
            return Some(Self::StrayBeside(more));
        }
        let is_request = before.get(..READ_BYTES).is_some_and(is_read);
        (is_request && crc_valid(before) && !crc_valid(bytes) && is_altered(before, bytes)).then_some(Self::AlteredRequest)
    }
}
/// The single wrong bit of an RTU frame, as (index of the byte, number of the bit): the one whose inversion makes its checksum right
/// and leaves a frame with the layout of its function. What was cut has such a bit by chance, but not the length.
///
/// ```
/// use modlens_protocol::{functions::Functions, oddity::wrong_bit};
/// // 01 03 02 00 07 has the checksum F9 86; here the lowest bit of the 07 is wrong.
/// assert_eq!(wrong_bit(Functions::embedded(), &[1, 3, 2, 0, 6, 0xF9, 0x86]), Some((4, 0)));
/// // Six bytes of an answer with 40 of data: inverting the lowest bit of the fourth makes the checksum right by chance.
/// assert_eq!(wrong_bit(Functions::embedded(), &[1, 3, 40, 0, 0x2E, 0x18]), None);
/// ```
pub fn wrong_bit(functions: &Functions, frame: &[u8]) -> Option<(usize, u8)> {
    let (at, bit) = correctable_bit(frame)?;
    let mut right = frame.to_vec();
    right[at] ^= 1 << bit;
    let pdu = right.get(1..right.len().checked_sub(CRC_BYTES)?)?;
    layout_fits(functions, pdu).then_some((at, bit))
}

/// The digits, where all bytes are hex digits, with or without the end of a line, and their number is even.
fn digits(bytes: &[u8]) -> Option<String> {
    let text = bytes.trim_ascii();
    let is_digits = text.len() >= LEAST_LETTERS && text.len().is_multiple_of(2) && text.iter().all(u8::is_ascii_hexdigit);
    // Numbers in frames that happen to be digits are no text: a frame of digits has both kinds, or begins with a low address.
    (is_digits && (text[0] == b'0' || text.len() > 2 * LEAST_LETTERS)).then(|| String::from_utf8_lossy(text).into_owned())
}

/// Whether the checksum is right but for the order of its bytes.
pub fn is_swapped(frame: &[u8]) -> bool {
    let Some((content, sent)) = frame.split_last_chunk::<2>() else { return false };
    content.len() >= 2 && is_known(frame[1]) && crc16(content).to_be_bytes() == *sent && sent[0] != sent[1]
}

/// Whether each byte is there twice, and one of each two makes a frame.
///
/// ```
/// use modlens_protocol::oddity::is_doubled;
/// // The refusal 01 83 02 with its checksum C0 F1.
/// assert!(is_doubled(&[1, 1, 0x83, 0x83, 2, 2, 0xC0, 0xC0, 0xF1, 0xF1]));
/// assert!(!is_doubled(&[1, 1, 0x83, 0x83, 2, 2, 0xC0, 0xC0, 0xF1, 0xF0]));
/// ```
pub fn is_doubled(bytes: &[u8]) -> bool {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let half: Vec<u8> = pairs.iter().map(|[byte, _]| *byte).collect();
    let are_alike = rest.is_empty() && pairs.iter().all(|[one, other]| one == other);
    are_alike && half.len() >= LEAST_FRAME && is_known(half[1]) && crc_valid(&half)
}

/// Whether the last byte, put in front, makes a frame.
pub fn is_out_of_step(bytes: &[u8]) -> bool {
    let Some((last, rest)) = bytes.split_last() else { return false };
    rest.len() >= LEAST_FRAME && is_known(rest[0]) && crc_valid(&[&[*last], rest].concat())
}

fn is_known(function: u8) -> bool {
    Functions::embedded().name(function & !EXCEPTION_BIT).is_some()
}

/// An exception response whose checksum is wrong or missing, or one without its unit, which a right checksum shows.
fn refusal(bytes: &[u8]) -> Option<Oddity> {
    let said = |unit, function: u8, code| {
        let is_answer = function & EXCEPTION_BIT != 0 && is_known(function) && exception_name(code).is_some();
        is_answer.then_some(Oddity::Refusal { unit, function: function & !EXCEPTION_BIT, code })
    };
    match *bytes {
        [unit @ 1..=247, function, code] | [unit @ 1..=247, function, code, _, _] => said(unit, function, code),
        [function, code, _, _] if function & EXCEPTION_BIT != 0 => {
            let unit = (1..=247).find(|unit| crc_valid(&[&[*unit], bytes].concat()))?;
            said(unit, function, code)
        }
        _ => None,
    }
}

/// Several times the same refusal without its checksum, after a byte or two of the one before at most, as a reader collects them
/// that waits for more: the unit, the exception, and how often.
///
/// ```
/// use modlens_protocol::oddity::bare_refusals;
/// assert_eq!(bare_refusals(&[2, 1, 0x83, 2, 1, 0x83, 2]), Some((1, 2, 2)));
/// assert_eq!(bare_refusals(&[1, 0x83, 2, 0xC0, 0xF1]), None);
/// ```
pub fn bare_refusals(bytes: &[u8]) -> Option<(u8, u8, u32)> {
    let rest = &bytes[bytes.len() % LEAST_REFUSAL..];
    let (one, times) = (rest.get(..LEAST_REFUSAL)?, rest.len() / LEAST_REFUSAL);
    let is_alike = times > 1 && rest.chunks(LEAST_REFUSAL).all(|other| other == one);
    match refusal(one).filter(|_| is_alike)? {
        Oddity::Refusal { unit, code, .. } => Some((unit, code, times as u32)),
        _ => None,
    }
}

fn header_length(bytes: &[u8]) -> Option<Oddity> {
    let (head, rest) = bytes.split_first_chunk::<PREFIX_BYTES>()?;
    let announced = usize::from(u16::from_be_bytes([head[4], head[5]]));
    if head[2..4] != [0, 0] || announced == rest.len() || rest.len() < 3 || !is_known(rest[1]) {
        return None;
    }
    // Some other length that the layout admits would make anything fit: all that came has to be one frame.
    let functions = Functions::embedded();
    let is_whole = layout_fits(functions, &rest[1..]) && layout_lengths(functions, bytes).contains(&Some(bytes.len()));
    is_whole.then_some(Oddity::HeaderLength { announced, present: rest.len() })
}

/// Whether a byte is what a receiver makes of a line that is switched or floats: 00, FF, or one run of ones above zeros.
pub fn is_of_driver(byte: u8) -> bool {
    byte.leading_ones() + byte.trailing_zeros() >= 8
}

/// Fewer bytes of this kind come about by chance.
const LEAST_LEVELS: usize = 12;

fn is_of_levels(bytes: &[u8]) -> bool {
    let plain = bytes.iter().filter(|byte| is_of_driver(**byte)).count();
    // A block of zeros, or of FF, is a block of values.
    let kinds = [0, 0xFF].iter().filter(|kind| bytes.contains(kind)).count();
    let is_mixed = kinds == 2 || bytes.iter().any(|byte| is_of_driver(*byte) && !matches!(byte, 0 | 0xFF));
    bytes.len() >= LEAST_LEVELS && plain * 10 >= bytes.len() * 9 && is_mixed && !matches!(bytes[..2], [1..=247, 1..=24])
}

fn stray_front(bytes: &[u8]) -> Option<Oddity> {
    (1..=MOST_STRAY).find_map(|count| {
        let frame = bytes.get(count..).filter(|frame| frame.len() >= LEAST_FRAME && is_known(frame[1]))?;
        let is_cut = !crc_valid(frame);
        (!is_cut || lacks_last(frame)).then_some(Oddity::StrayFront { bytes: count, is_cut })
    })
}

/// Whether an answer to a read lacks its last byte, and the first one of its checksum is right.
pub fn lacks_last(frame: &[u8]) -> bool {
    let [0..=247, 1..=4, count, ..] = *frame else { return false };
    let length = 3 + usize::from(count);
    count > 0 && frame.len() == length + 1 && crc16(&frame[..length]).to_le_bytes()[0] == frame[length]
}

/// Whether a request to read lacks its last byte, and the first one of its checksum is right.
fn is_cut_request(frame: &[u8]) -> bool {
    let Some((request, &[first])) = frame.split_at_checked(READ_BYTES) else { return false };
    is_read(request) && crc16(request).to_le_bytes()[0] == first
}

/// Whether unit and PDU are a request to read coils or registers, as many as one may read at once.
fn is_read(adu: &[u8]) -> bool {
    let [1..=247, pdu @ ..] = adu else { return false };
    let functions = Functions::embedded();
    let kind = pdu.first().and_then(|&code| functions.standard_request(code)).map(|request| request.kind);
    matches!(kind, Some(StandardLayout::ReadBits | StandardLayout::ReadRegisters)) && possible_directions(functions, pdu).0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The answer `01 03 02 00 07`, whose checksum by the specification's algorithm is F9 86.
    const ANSWER: [u8; 7] = [1, 3, 2, 0, 7, 0xF9, 0x86];

    #[test]
    fn a_frame_and_its_accidents_are_told_apart() {
        assert_eq!(Oddity::of(&ANSWER), None);
        assert_eq!(Oddity::of(&[1, 3, 2, 0, 7, 0x86, 0xF9]), Some(Oddity::SwappedChecksum));
        assert_eq!(Oddity::of(&[3, 2, 0, 7, 0xF9, 0x86, 1]), Some(Oddity::OutOfStep));
        assert_eq!(Oddity::of(&ANSWER[..6]), Some(Oddity::Cut));
        // The checksum of the request of the specification for function 3 is 76 87.
        assert_eq!(Oddity::of(&[0x11, 3, 0, 0x6B, 0, 3, 0x76]), Some(Oddity::CutRequest));
        assert_eq!(Oddity::of(&[0x11, 3, 0, 0x6B, 0, 3, 0x75]), None);
        assert_eq!(Oddity::of(&[&[0], &ANSWER[..]].concat()), Some(Oddity::StrayFront { bytes: 1, is_cut: false }));
        assert_eq!(Oddity::of(&[&[0], &ANSWER[..6]].concat()), Some(Oddity::StrayFront { bytes: 1, is_cut: true }));
        assert_eq!(Oddity::of(b"010302000786F9"), Some(Oddity::Digits(String::from("010302000786F9"))));
        // Unit 26 refuses function 3 with exception 2: 1A 83 02 has the LRC 61.
        assert_eq!(Oddity::of(b":1A830262\r\n"), Some(Oddity::AsciiSum { there: 0x62, due: 0x61 }));
        assert_eq!(Oddity::of(b":1A830261\r\n"), None);
        assert_eq!(Oddity::of(b"FINS\0\0\0\x10"), Some(Oddity::Text(String::from("FINS"))));
        // Neither noise nor a few signs show anything.
        assert_eq!(Oddity::of(&[0x40, 0x40, 0x40, 0x41, 0x64, 0xF0]), None);
        assert_eq!(Oddity::of(&[0x9A, 0x3C, 0xE1, 0x55, 0x47, 0xB2]), None);
    }

    #[test]
    fn an_exception_response_is_known_without_its_checksum_or_its_unit() {
        // Of unit 15 to function 3 with exception 3: the checksum of `0F 83 03` is F2 60, low byte first 60 F2.
        let refusal = Some(Oddity::Refusal { unit: 15, function: 3, code: 3 });
        for bytes in [&[15, 0x83, 3][..], &[15, 0x83, 3, 0x60, 0xF3], &[0x83, 3, 0x60, 0xF2]] {
            assert_eq!(Oddity::of(bytes), refusal, "{bytes:?}");
        }
        // A right frame; a code that the specification does not have; a checksum that fits no unit.
        for bytes in [&[15, 0x83, 3, 0x60, 0xF2][..], &[15, 0x83, 99], &[0x83, 3, 0, 0]] {
            assert_eq!(Oddity::of(bytes), None, "{bytes:?}");
        }
    }

    #[test]
    fn a_header_that_counts_wrong_is_named_with_both_counts() {
        // Messaging on TCP/IP, 3.1.3: the length counts the unit and the PDU, here 9 bytes.
        let answer = [0, 1, 0, 0, 0, 6, 1, 3, 6, 1, 0, 0, 0, 0, 0x34];
        assert_eq!(Oddity::of(&answer), Some(Oddity::HeaderLength { announced: 6, present: 9 }));
        let right = [0, 1, 0, 0, 0, 9, 1, 3, 6, 1, 0, 0, 0, 0, 0x34];
        assert_eq!(Oddity::of(&right), None);
    }
}
