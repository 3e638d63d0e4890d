//! What a text without a proven frame says all the same: what is odd about its bytes, or what the program itself reports.

use crate::text::proved::{byte_of_line, hex_front, longest_hex, named_digits, sender, single_bytes, single_digits};
use crate::text::reports::{reported, Said};
use crate::text::signal::{self, latin_bytes};
use modlens_protocol::annotate::{exception_name, spaced_hex};
use modlens_protocol::checksum::{crc16, crc_valid, CRC_BYTES};
use modlens_protocol::direction::possible_directions;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::in_words;
use modlens_protocol::mbap::layout_fits;
use modlens_protocol::oddity::{is_text, Oddity};
use std::collections::BTreeSet;

/// Lines that are looked at.
const MOST_LINES: usize = 2000;

/// From so many bytes on they may be a damaged frame, the longest of which has 256 and a header (RTU; Modbus TCP: 260).
const MIN_DAMAGED: usize = 5;
const MAX_FRAME: usize = 260;

/// Of a longer one the first bytes are shown.
const MOST_SHOWN: usize = 8;

/// So many other characters may be in a line of bytes.
const MOST_WORDS: usize = 40;

/// Fewer bytes are no answer.
const LEAST_BYTES: usize = 3;

/// A line that nothing could read, and the frame that was read shortly before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnreadLine<'a> {
    pub number: u64,
    pub text: &'a [u8],
    pub before: &'a [u8],
}

/// What the bytes of a text show, or what it reports in words; `None` if neither says anything.
pub(super) fn named(text: &[u8]) -> Option<String> {
    let lines = text.split(|&byte| byte == b'\n').take(MOST_LINES).map(<[u8]>::trim_ascii_end);
    let lines = (1..).zip(lines).map(|(number, text)| UnreadLine { number, text, before: &[] });
    named_lines(lines.filter(|line| !line.text.is_empty())).map(|said| said.words)
}

/// The same of lines that nothing could read.
pub(super) fn named_lines<'a>(lines: impl Iterator<Item = UnreadLine<'a>> + Clone) -> Option<Said> {
    let joined = joined_bytes(lines.clone());
    let whole = joined.iter().map(|one| UnreadLine { number: one.number, text: &one.text, before: one.before });
    // Line by line, because the joined ones live shorter.
    let mut all: Vec<UnreadLine<'_>> = Vec::new();
    lines.for_each(|line| all.push(line));
    leave_out_beginnings(&mut all);
    all.extend(whole);
    let lines = all.iter().copied();
    let words = || reported(lines.clone().map(|line| line.text));
    let is_completed = |one: &NoFrame| one.is_bare && adds_checksum(lines.clone(), one.number);
    let mut bytes: Vec<NoFrame> = lines.clone().filter_map(no_frame).filter(|one| !is_completed(one)).collect();
    repeated(&mut bytes);
    // Of bytes that have the layout of a frame, it is known what is wrong with them; of others, words say more.
    let first = |is_known: bool| bytes.iter().find(|one| one.is_known || !is_known).map(|one| Said::from(one.words.clone()));
    let read =
        lines.clone().filter_map(|line| single_bytes(&without_emphasis(line.text)).filter(|bytes| bytes.len() >= MIN_DAMAGED));
    let odd = odd_bytes(lines.clone()).or_else(|| few_bits(&read.collect::<Vec<_>>()));
    // Where no line has the layout of a frame, all of them together may show what the receiver sees.
    let odd =
        odd.or_else(|| signal::named(lines.clone().map(|line| line.text)).filter(|_| bytes.iter().all(|one| !one.is_known)));
    // A text may leave the checksum of a request out.
    let has_bytes = odd.is_some() || !joined.is_empty() || bytes.iter().any(|one| !one.is_bare);
    let mut said = odd.map(Said::from).or_else(|| first(true)).or_else(words).or_else(|| first(false))?;
    said.has_bytes = has_bytes;
    Some(said)
}

/// Leaves out lines whose bytes the next one prints with more after them, as of a receive buffer that fills.
fn leave_out_beginnings(lines: &mut Vec<UnreadLine<'_>>) {
    let bytes: Vec<Vec<u8>> = lines.iter().map(|line| single_bytes(&without_emphasis(line.text)).unwrap_or_default()).collect();
    let is_beginning = |at: usize| {
        let (Some(line), Some(next)) = (lines.get(at), lines.get(at + 1)) else { return false };
        let is_begun = bytes[at].len() >= LEAST_BYTES && bytes[at].len() < bytes[at + 1].len();
        is_begun && line.number + 1 == next.number && bytes[at + 1].starts_with(&bytes[at])
    };
    let kept: Vec<bool> = (0..lines.len()).map(|at| !is_beginning(at)).collect();
    let mut kept = kept.into_iter();
    lines.retain(|_| kept.next().unwrap_or(true));
}

/// Bytes of several lines with one each, in one line.
struct Joined<'a> {
    /// The number of the first line.
    number: u64,
    text: Vec<u8>,
    before: &'a [u8],
}

/// The bytes of lines in a row that hold one each.
fn joined_bytes<'a>(lines: impl Iterator<Item = UnreadLine<'a>>) -> Vec<Joined<'a>> {
    let mut all: Vec<(u64, Vec<u8>, &[u8])> = Vec::new();
    let mut last = 0;
    for UnreadLine { number, text, before } in lines {
        let Some(byte) = byte_of_line(text) else { continue };
        match all.last_mut().filter(|_| last + 1 == number) {
            Some((_, bytes, _)) => bytes.push(byte),
            None => all.push((number, vec![byte], before)),
        }
        last = number;
    }
    let all = all.into_iter().filter(|(_, bytes, _)| bytes.len() >= LEAST_BYTES);
    all.map(|(number, bytes, before)| Joined { number, text: spaced_hex(&bytes).into_bytes(), before }).collect()
}

/// What the bytes of the first line show whose bytes are odd by themselves, or beside those of the line before.
fn odd_bytes<'a>(lines: impl Iterator<Item = UnreadLine<'a>>) -> Option<String> {
    let mut before = Vec::new();
    let mut side_before = None;
    for UnreadLine { number, text, before: read } in lines {
        let line = without_emphasis(text);
        let Some(bytes) = single_digits(&line).or_else(|| latin_bytes(text)).or_else(|| longest_hex(&line)) else { continue };
        if let Some(refusal) = [&before[..], read].into_iter().find_map(|asked| bare_refusal(asked, &bytes)) {
            return Some(format!("in line {number} {refusal}"));
        }
        if bytes.len() < LEAST_BYTES {
            continue;
        }
        // Where the words say that both were sent, the second is no answer to the first.
        let side = hex_front(&line).and_then(sender);
        let is_of_other = side.is_none() || side != side_before;
        let of_answer = |before: &[u8]| Oddity::of_answer(before, &bytes).filter(|_| is_of_other);
        let beside = |before: &[u8]| of_answer(before).or_else(|| Oddity::of_copy(before, &bytes));
        let own = || Oddity::of(&bytes);
        let beside_read = Oddity::of_copy(read, &bytes).or_else(|| Oddity::of_count(read, &bytes));
        if let Some(oddity) = beside_read.or_else(own).or_else(|| beside(&before)) {
            if oddity == Oddity::CutRequest && is_received(&line) {
                return Some(format!("in line {number} {CUT_ECHO}"));
            }
            return Some(format!("in line {number} {}", oddity.words()));
        }
        (before, side_before) = (bytes, side);
    }
    None
}

/// What is said of two bytes that refuse the request before: a refusal without its unit and its checksum.
fn bare_refusal(asked: &[u8], bytes: &[u8]) -> Option<String> {
    let [refused, code] = *bytes else { return None };
    let function = refused & !EXCEPTION_BIT;
    let is_request = |pdu: &[u8]| pdu.first() == Some(&function) && possible_directions(Functions::embedded(), pdu).0;
    let unit_and_pdu = asked.strip_suffix(&crc16(&asked[..asked.len().saturating_sub(CRC_BYTES)]).to_le_bytes()).unwrap_or(asked);
    let is_of_request = is_request(asked) || unit_and_pdu.get(1..).is_some_and(is_request);
    let name = exception_name(code).filter(|_| refused != function && is_of_request)?;
    Some(format!(
        "the bytes {refused:02X} {code:02X} are a refusal without unit and checksum, as programs print it: function {function} is refused with \
         exception {code} ({name})"
    ))
}

/// What is said of a request without its last byte where it was received.
const CUT_ECHO: &str = "what came as the answer is the request itself without its last byte: the adapter hears its own transmission, and the \
                        program reads as many bytes as an answer would have; turn the echo off, or read and discard what was sent";

/// Whether a line says that its bytes were received.
fn is_received(line: &[u8]) -> bool {
    let line = String::from_utf8_lossy(line).to_ascii_lowercase();
    ["respon", "recei", "recv", "answer"].iter().any(|word| line.contains(word))
}

/// A line that is little more than bytes, which are no frame, and no part of the one that was read before.
fn no_frame(UnreadLine { number, text, before }: UnreadLine<'_>) -> Option<NoFrame> {
    let line = without_emphasis(text);
    let is_long = |bytes: &Vec<u8>| (MIN_DAMAGED..=MAX_FRAME).contains(&bytes.len());
    let bytes = single_bytes(&line).filter(is_long).or_else(|| named_digits(&line).filter(is_long))?;
    let is_part = before.windows(bytes.len()).any(|part| part == bytes);
    let is_only_bytes = line.len() <= 4 * bytes.len() + MOST_WORDS;
    let is_new = !crc_valid(&bytes) && !is_part;
    let shown = spaced_hex(&bytes[..bytes.len().min(MOST_SHOWN)]);
    let more = if bytes.len() > MOST_SHOWN { " \u{2026}" } else { "" };
    // Six bytes that are a request to read or write have no room for a checksum.
    let may_ask = bytes.len() == BARE_REQUEST && possible_directions(Functions::embedded(), &bytes[1..]).0;
    let is_request = may_ask && !is_received(&line) && lacks_checksum(&bytes).is_some();
    let known = wrong_checksum(&bytes).filter(|_| !is_request).or_else(|| cut_answer(&bytes));
    let is_known = known.is_some();
    let why = known.or_else(|| lacks_parts(&bytes));
    let is_unknown = why.is_none();
    let why = why.unwrap_or_else(|| String::from(UNKNOWN));
    // Whatever a program prints in front of them, what it puts in brackets are bytes.
    let is_bracketed = || hex_front(&line).is_some_and(|front| matches!(front.trim_ascii_end().last(), Some(b'[' | b'{' | b'(')));
    (is_new && (is_only_bytes || is_known && is_bracketed())).then(|| NoFrame {
        words: format!("in line {number} the bytes {shown}{more} {why}"),
        number,
        bytes: if is_unknown { bytes.clone() } else { Vec::new() },
        is_known,
        is_bare: is_request && !is_known,
    })
}

/// What is said of bytes that have nothing of a frame.
const UNKNOWN: &str = "are no frame: they are damaged, cut, or of another protocol";

/// The same where they come again and again.
const REPEATED: &str =
    "are no frame, and come so again and again. Noise does not repeat itself: the rate, the parity or the wires of the \
                        receiver are wrong, or they are of another protocol";

/// Of so many lines with the same bytes, chance is no reason.
const LEAST_ALIKE: usize = 3;

/// Replaces the words for bytes that have nothing of a frame where several lines hold the same.
fn repeated(all: &mut [NoFrame]) {
    let counts: Vec<usize> = all.iter().map(|one| all.iter().filter(|other| other.bytes == one.bytes).count()).collect();
    for (one, count) in all.iter_mut().zip(counts) {
        if !one.bytes.is_empty() && count >= LEAST_ALIKE {
            one.words = one.words.replace(UNKNOWN, REPEATED);
        }
    }
}

/// The numbers of the lines that are a request without its checksum in a program that adds one.
pub(super) fn completed<'a>(lines: impl Iterator<Item = UnreadLine<'a>> + Clone) -> Vec<u64> {
    let bare = lines.clone().filter_map(no_frame).filter(|one| one.is_bare);
    bare.map(|one| one.number).filter(|number| adds_checksum(lines.clone(), *number)).collect()
}

/// Whether a line is a statement of a program that holds bytes, and one shortly below it computes a checksum, which it adds to them.
fn adds_checksum<'a>(mut lines: impl Iterator<Item = UnreadLine<'a>> + Clone, number: u64) -> bool {
    let is_statement = |line: UnreadLine<'_>| {
        let front = hex_front(line.text).unwrap_or_default().trim_ascii_end();
        front.contains(&b'=') && matches!(front.last(), Some(b'[' | b'{' | b'('))
    };
    let computes = |line: UnreadLine<'_>| {
        let text = String::from_utf8_lossy(line.text).to_ascii_lowercase();
        (text.contains("crc") || text.contains("checksum")) && text.contains('(')
    };
    let mut below = lines.clone().filter(|line| (number + 1..=number + LINES_TO_CHECKSUM).contains(&line.number));
    lines.any(|line| line.number == number && is_statement(line)) && below.any(computes)
}

/// So many lines below its bytes, a program computes their checksum.
const LINES_TO_CHECKSUM: u64 = 4;

/// Unit, function, address and quantity or value.
const BARE_REQUEST: usize = 6;

/// What is said of bytes of several lines that lack their upper bits, as a port with too few data bits reads them: of many different
/// ones, those of the checksums among them, none is above a limit.
fn few_bits(lines: &[Vec<u8>]) -> Option<String> {
    let bytes = || lines.iter().flatten().copied();
    let (most, count) = (bytes().max()?, bytes().filter(|byte| *byte > 0).count());
    let kinds: BTreeSet<u8> = bytes().collect();
    let bits = [5, 6, 7].into_iter().find(|bits| u32::from(most) < 1 << bits)?;
    let is_much = lines.len() >= LEAST_LINES && count >= LEAST_LOW << (bits - 5) && kinds.len() >= LEAST_KINDS;
    let is_text = lines.iter().any(|line| is_text(line));
    (is_much && !is_text).then(|| {
        let limit = (1 << bits) - 1;
        format!(
            "none of {} bytes is above {limit:02X}, checksums included: their upper bits are missing, as where the port is set to {bits} data \
             bits; set it to 8, as RTU needs",
            bytes().count()
        )
    })
}

/// So many lines with so many bytes that are not 00, twice as many for each further bit, and of so many kinds, are no accident.
const LEAST_LINES: usize = 2;
const LEAST_LOW: usize = 24;
const LEAST_KINDS: usize = 10;

/// A line of bytes that are no frame.
struct NoFrame {
    words: String,
    number: u64,
    /// Those that have nothing of a frame.
    bytes: Vec<u8>,
    /// They have the layout of a frame, or of the beginning of one.
    is_known: bool,
    /// They are a request without its checksum.
    is_bare: bool,
}

/// What is said of the beginning of an answer to a read of registers.
fn cut_answer(bytes: &[u8]) -> Option<String> {
    let [unit @ 1..=247, function @ 3..=4, count, rest @ ..] = bytes else { return None };
    let (due, there) = (usize::from(*count) + CRC_BYTES, rest.len());
    let is_cut = count % 2 == 0 && *count > 0 && *count <= MOST_DATA && (LEAST_REST..due - 1).contains(&there);
    is_cut.then(|| {
        format!(
            "begin as an answer of unit {unit} to function {function} with {count} bytes of data, and {there} of {due} bytes are there, the \
             checksum included: the answer is cut, by the program that prints it or before"
        )
    })
}

/// The most bytes of registers in an answer (application protocol, 6.3).
const MOST_DATA: u8 = 250;

/// Fewer bytes after a byte count may be another frame.
const LEAST_REST: usize = 6;

/// What is wrong with bytes that have the layout of a frame, but for their checksum.
fn wrong_checksum(bytes: &[u8]) -> Option<String> {
    let (body, there) = bytes.split_last_chunk::<CRC_BYTES>()?;
    let [_, pdu @ ..] = body else { return None };
    let functions = Functions::embedded();
    let is_known = pdu.len() > 1 && functions.name(pdu[0] & !EXCEPTION_BIT).is_some();
    let right = spaced_hex(&crc16(body).to_le_bytes());
    let who =
        if possible_directions(functions, pdu).0 { "no unit answers such a request" } else { "a master discards such an answer" };
    (is_known && layout_fits(functions, pdu)).then(|| {
        format!(
            "have the layout of a frame, and its checksum is wrong: {} is there, and {right} belongs there; {who}",
            spaced_hex(there)
        )
    })
}

/// What is said of bytes that are a frame without its checksum, or without its unit as well; some may be either.
fn lacks_parts(bytes: &[u8]) -> Option<String> {
    match (lacks_checksum(bytes), bare_pdu(bytes)) {
        (Some(one), Some(other)) => Some(format!("{one}; or its unit is left out as well: {other}")),
        (Some(one), None) => Some(one),
        (None, other) => {
            other.map(|what| format!("are a frame without unit and checksum, as programs print it, and whole as such: {what}"))
        }
    }
}

/// What is said of bytes that are a whole frame but for its checksum.
fn lacks_checksum(bytes: &[u8]) -> Option<String> {
    let [unit, pdu @ ..] = bytes else { return None };
    let functions = Functions::embedded();
    let is_known = pdu.len() > 1 && functions.name(pdu[0] & !EXCEPTION_BIT).is_some();
    let right = spaced_hex(&crc16(bytes).to_le_bytes());
    let what = in_words::pdu(pdu).filter(|_| is_known && layout_fits(functions, pdu))?;
    Some(format!(
        "have the layout of a frame of unit {unit} without its checksum, {what}; {right} would be the checksum, which a serial line needs, \
         and which a text may leave out"
    ))
}

/// What bytes say that are a PDU: a frame without its unit and its checksum.
fn bare_pdu(bytes: &[u8]) -> Option<String> {
    let functions = Functions::embedded();
    let is_known = functions.name(bytes.first()? & !EXCEPTION_BIT).is_some();
    in_words::pdu(bytes).filter(|_| is_known && layout_fits(functions, bytes))
}

/// A line without the marks by which people emphasize a byte: `00 **06** 31`.
fn without_emphasis(line: &[u8]) -> Vec<u8> {
    line.iter().copied().filter(|byte| !matches!(byte, b'*' | b'_')).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::reports::EXCEPTIONS;
    use modlens_protocol::functions::{parse_toml, VOCABULARY};
    use modlens_protocol::oddity::Printed;

    #[test]
    fn odd_bytes_come_before_words() {
        let swapped = named(b"what is this?\nRx: 11 03 00 6B 00 03 87 76\n").expect("a reason");
        assert!(swapped.starts_with("in line 2 the checksum is right"), "{swapped}");
        let said = named(b"[W] Modbus error function code: 0x84 exception: 2\n").expect("a reason");
        assert!(said.starts_with("a line reports exception 2 (illegal data address)"), "{said}");
        let digits =
            named(b"data <Buffer 30 31 30 33 30 39 30 31 30 33 30 34 37 46 46 46 46 46 46 46 64 32 36 37 34 63 35 61>\n");
        assert!(digits.is_some_and(|words| words.contains("sent as characters")));
        assert_eq!(named(b"nothing to be seen\n"), None);
        assert_eq!(named(b"exception: 25 of 30\n"), None);
    }

    #[test]
    fn a_path_is_no_text_of_a_device() {
        for path in [
            r"Open port COM5 (C:\Program Files\Monitor Software\Serial.exe)",
            r"\\server\share\Modbus Programs",
            r"C:\new\readers\test",
        ] {
            assert_eq!(named(path.as_bytes()), None, "{path}");
        }
        for text in [&br"received b'Hello from device\r\n'"[..], br"RX:\x48\x65\x6C\x6C\x6F\x21"] {
            assert!(named(text).is_some_and(|words| words.contains("the bytes are text")), "{}", text.escape_ascii());
        }
    }

    fn line(text: &[u8]) -> UnreadLine<'_> {
        UnreadLine { number: 1, text, before: &[] }
    }

    #[test]
    fn what_the_other_side_received_is_compared_with_what_was_sent() {
        // 01 01 00 00 00 66 has the checksum BC 20: neither line is a frame, and one is the other with a byte in front.
        let text = b"sent:\n[01][01][00][00][00][67][7C][26]\nsimulator:\n[FF][01][01][00][00][00][67][7C][26]\n";
        assert!(named(text)
            .is_some_and(|words| words.contains("in line 4 the bytes are those of the line before with one more in front")));
        // 01 03 00 00 00 02 C4 0B, and the same with the highest bit of each byte set.
        let read = [1, 3, 0, 0, 0, 2, 0xC4, 0x0B];
        let heard = UnreadLine { number: 7, text: b"scope: 81 83 80 80 80 82 C4 8B", before: &read };
        let said = named_lines([heard].into_iter()).expect("a reason");
        assert!(said.words.starts_with("in line 7 the bytes are the request before with some bits changed"), "{said:?}");
        let other = UnreadLine { text: b"answer: 9A 3C E1 55 47 B2 0D 66", ..heard };
        let said = named_lines([other].into_iter()).expect("a reason");
        assert!(said.words.contains("are no frame"), "{said:?}");
    }

    #[test]
    fn bytes_come_before_words_wherever_they_stand() {
        // 11 04 00 08 00 01 has the checksum B2 98; here it is B2 9A, beside a complaint and a remark.
        let code = b"no response at all\nbyte q[] = {0x11,0x04,0x00,0x08,0x00,0x01,0xb2,0x9a}; // asks for register 8 with a valid checksum\n";
        assert!(named(code).is_some_and(|said| said.contains("in line 2 the bytes") && said.contains("b2 98 belongs there")));
        // Twelve registers have 24 bytes, and the checksum two.
        let cut = b"[7][E] some/long/path/of/a/program/and/the/file/in/which/it/is.cpp - Size: [11], Content: [11 03 18 00 01 00 02 00 03 00 04 ]\nCRC error\n";
        assert!(named(cut).is_some_and(|said| said.contains("8 of 26 bytes are there")));
        let prose = b"CRC error, and I read somewhere that my device 11 03 18 00 01 00 02 00 03 00 04 is what people call an odd one out\n";
        assert!(named(prose).is_some_and(|said| said.starts_with("a line reports a wrong checksum")));
    }

    #[test]
    fn bytes_of_one_line_each_are_read_together() {
        // Asked for three registers, of which the answer has six bytes; 46 is 06 with a bit more.
        let asked = [0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87];
        let texts = [
            "received Byte 17 (0X11)",
            "received Byte 3 (0X3)",
            "received Byte 70 (0X46)",
            "received Byte 2 (0x2)",
            "received Byte 43 (0x2b)",
        ];
        let lines = (4..).zip(texts).map(|(number, text)| UnreadLine { number, text: text.as_bytes(), before: &asked });
        let said = named_lines(lines).expect("a reason");
        assert!(said.words.starts_with("in line 4 the answer counts 70 bytes of data, and 6 are those"), "{said:?}");
        assert!(said.has_bytes);
    }

    #[test]
    fn where_others_were_answered_nobody_is_sent_to_the_wires() {
        let said = named_lines([line(b"ERROR Connection timed out: select")].into_iter()).expect("a reason");
        let answered = Printed { has_answered: true, ..Printed::default() };
        assert_eq!(said.beside(answered).words, "a line reports that no answer came in time; other requests were answered");
        assert!(said.words.starts_with("a line reports that no answer came in time: power, wires"));
    }

    #[test]
    fn bytes_left_over_say_more_than_silence() {
        let text = b"No response received\nWARNING: Cleanup recv buffer before send: 0x0 0x21\nNo response received\n";
        assert!(named(text).is_some_and(|said| said.contains("bytes left over before a request")));
    }

    #[test]
    fn an_exception_is_known_by_its_name_and_by_its_number() {
        let all: [&[u8]; 8] = [
            b"Exception 4",
            b"exception: 4",
            b"Exception Code 4",
            b"exception code: 4",
            b"exception = 4",
            b"ExceptionResponse(dev_id=1, function_code=131, exception_code=4)",
            b"Exception Response(131, 3, SlaveFailure)",
            b"Slave Device Failure",
        ];
        let said = named(b"exception 4").expect("a reason");
        assert!(said.starts_with("a line reports exception 4 (server device failure): "), "{said}");
        assert_eq!(all.map(named), all.map(|_| Some(said.clone())));
        for other in ["exceptions 4", "exception4", "exception 44", "exception code: 0x84"] {
            assert_eq!(named(other.as_bytes()), None, "{other}");
        }
    }

    #[test]
    fn exceptions_have_the_names_of_the_vocabulary() {
        let vocabulary = parse_toml(VOCABULARY).expect("a table");
        let rows = vocabulary["exception"].as_array().expect("rows");
        for (code, names, _) in EXCEPTIONS {
            let row = rows.iter().find(|row| row["code"] == code).expect("an exception of the specification");
            let name = row["name"].as_str().expect("a name").to_lowercase();
            assert!(name.ends_with(names[0]), "{code}: {name}");
        }
    }
}
