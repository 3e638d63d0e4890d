//! What a text without a proven frame says all the same: what is odd about its bytes, or what the program itself reports.

use crate::text::proved::{hex_front, longest_hex, sender, single_bytes, single_digits};
use modlens_protocol::annotate::spaced_hex;
use modlens_protocol::checksum::{crc16, crc_valid, CRC_BYTES};
use modlens_protocol::direction::possible_directions;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::mbap::layout_fits;
use modlens_protocol::oddity::Oddity;

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

/// The exceptions that programs report (application protocol, 7): code, names in lower case, and what to do. The message has
/// the first of the names.
const EXCEPTIONS: [(u8, &[&str], &str); 5] = [
    (
        1,
        &["illegal function", "illegalfunction"],
        "the unit does not know the function; try input registers (4) for holding registers (3), or a write by another function",
    ),
    (
        2,
        &["illegal data address", "illegaladdress", "illegaldataaddress"],
        "the unit does not have the address, or not the whole block; check whether the address counts from 0 or 1, and the function",
    ),
    (3, &["illegal data value", "illegalvalue", "illegaldatavalue"], "the unit does not take this quantity or this value; read fewer registers, or write another value"),
    (4, &["server device failure", "slave device failure", "slavefailure", "slavedevicefailure"], "the unit, or a gateway that cannot reach it, has failed"),
    (
        11,
        &["target device failed to respond", "gatewaynoresponse"],
        "the gateway gets no answer of the unit; check its wires, rate and address",
    ),
];

/// What programs report, in lower case, with what it means and what to do; and where the frames of the same text contradict that,
/// which prove more: requests were answered, so that what they came by is right, or answers are whole.
const REPORTS: [(&[&str], &str, Beside); 4] = [
    (
        &["cleanup recv buffer"],
        "bytes left over before a request: the rest of an answer that came after the client had given up; raise its timeout",
        Beside::Nothing,
    ),
    (
        &["connection refused", "connection reset", "broken pipe"],
        "a connection that the other side refused or closed: its port and service, and how many clients it takes",
        Beside::Nothing,
    ),
    (
        &["checksum error", "crc error", "crc check error", "crccheckerror", "crc mismatch", "crcmismatch", "crc received", "invalid crc", "wrong crc", "crc check failed", "bad crc"],
        "a wrong checksum: bits changed on the line, other line settings, or bytes lost by a program; a recording of the bytes shows which",
        Beside::WholeAnswers(
            "a wrong checksum, and the answers that are printed here have right ones: they are whole, so that the program checks \
             them wrongly, or means bytes that it does not print",
        ),
    ),
    (
        &["timed out", "timeout", "no response", "no answer", "no reply", "(0 received)", "received 0 bytes"],
        "that no answer came in time: power, wires, rate and address of the unit, and whether anything comes back at all",
        Beside::Answers("that no answer came in time; other requests were answered"),
    ),
];

/// What is said of a report beside frames that contradict it.
#[derive(Clone, Copy, Debug)]
enum Beside {
    /// The same.
    Nothing,
    /// Where requests were answered.
    Answers(&'static str),
    /// Where whole answers came.
    WholeAnswers(&'static str),
}

/// A line that nothing could read, and the frame that was read shortly before it.
#[derive(Clone, Copy, Debug)]
pub(super) struct UnreadLine<'a> {
    pub number: u64,
    pub text: &'a [u8],
    pub before: &'a [u8],
}

/// The first of the reports.
const LEFT_OVER: usize = EXCEPTIONS.len();

/// What unread lines show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    words: String,
    /// What is said instead where requests of the same text were answered, and where whole answers came.
    beside_answers: Option<String>,
    beside_whole: Option<String>,
}

impl Said {
    /// The words; `has_answers` where requests of the same text were answered, `has_whole` where whole answers came.
    pub fn words(&self, has_answers: bool, has_whole: bool) -> &str {
        let instead = [(&self.beside_whole, has_whole), (&self.beside_answers, has_answers)];
        let instead = instead.into_iter().find_map(|(words, is_so)| words.as_deref().filter(|_| is_so));
        instead.unwrap_or(&self.words)
    }
}

impl From<String> for Said {
    fn from(words: String) -> Self {
        Self { words, beside_answers: None, beside_whole: None }
    }
}

/// What the bytes of a text show, or what it reports in words; `None` if neither says anything.
pub(super) fn named(text: &[u8]) -> Option<String> {
    let lines = text.split(|&byte| byte == b'\n').take(MOST_LINES);
    named_lines((1..).zip(lines).map(|(number, text)| UnreadLine { number, text, before: &[] }))
        .map(|said| said.words(false, false).to_owned())
}

/// The same of lines that nothing could read.
pub(super) fn named_lines<'a>(lines: impl Iterator<Item = UnreadLine<'a>> + Clone) -> Option<Said> {
    let words = || reported(lines.clone().map(|line| line.text));
    let bytes = || lines.clone().find_map(no_frame);
    odd_bytes(lines.clone()).map(Said::from).or_else(words).or_else(|| bytes().map(Said::from))
}

/// What the bytes of the first line show whose bytes are odd by themselves, or beside those of the line before.
fn odd_bytes<'a>(lines: impl Iterator<Item = UnreadLine<'a>>) -> Option<String> {
    let mut before = Vec::new();
    let mut side_before = None;
    for UnreadLine { number, text, before: read } in lines {
        let line = without_emphasis(text);
        let Some(bytes) = single_digits(&line).or_else(|| longest_hex(&line)) else { continue };
        if bytes.len() < LEAST_BYTES {
            continue;
        }
        // Where the words say that both were sent, the second is no answer to the first.
        let side = hex_front(&line).and_then(sender);
        let is_of_other = side.is_none() || side != side_before;
        let of_answer = |before: &[u8]| Oddity::of_answer(before, &bytes).filter(|_| is_of_other);
        let beside = |before: &[u8]| of_answer(before).or_else(|| Oddity::of_copy(before, &bytes));
        let own = || Oddity::of(&bytes);
        if let Some(oddity) = Oddity::of_copy(read, &bytes).or_else(own).or_else(|| beside(&before)) {
            return Some(format!("in line {number} {}", oddity.words()));
        }
        (before, side_before) = (bytes, side);
    }
    None
}

/// A line that is little more than bytes, which are no frame, and no part of the one that was read before.
fn no_frame(UnreadLine { number, text, before }: UnreadLine<'_>) -> Option<String> {
    let line = without_emphasis(text);
    let bytes = single_bytes(&line).filter(|bytes| (MIN_DAMAGED..=MAX_FRAME).contains(&bytes.len()))?;
    let is_part = before.windows(bytes.len()).any(|part| part == bytes);
    let is_only_bytes = line.len() <= 4 * bytes.len() + MOST_WORDS && !crc_valid(&bytes) && !is_part;
    let shown = spaced_hex(&bytes[..bytes.len().min(MOST_SHOWN)]);
    let more = if bytes.len() > MOST_SHOWN { " \u{2026}" } else { "" };
    let usual = || String::from("are no frame: they are damaged, cut, or of another protocol");
    let why = wrong_checksum(&bytes).or_else(|| lacks_checksum(&bytes)).unwrap_or_else(usual);
    is_only_bytes.then(|| format!("in line {number} the bytes {shown}{more} {why}"))
}

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

/// What is said of bytes that are a whole frame but for its checksum.
fn lacks_checksum(bytes: &[u8]) -> Option<String> {
    let [_, pdu @ ..] = bytes else { return None };
    let functions = Functions::embedded();
    let is_known = pdu.len() > 1 && functions.name(pdu[0] & !EXCEPTION_BIT).is_some();
    let right = spaced_hex(&crc16(bytes).to_le_bytes());
    (is_known && layout_fits(functions, pdu)).then(|| {
        format!("have the layout of a frame without its checksum ({right}): where they were sent so on a serial line, no unit answers them")
    })
}

/// What most lines report.
fn reported<'a>(lines: impl Iterator<Item = &'a [u8]>) -> Option<Said> {
    let mut counts = [0; EXCEPTIONS.len() + REPORTS.len()];
    for line in lines {
        if let Some(report) = report_in(&String::from_utf8_lossy(line).to_ascii_lowercase()) {
            counts[report] += 1;
        }
    }
    // Bytes left over are what the requests without an answer got.
    let is_particular = |at: usize| at == LEFT_OVER;
    let rank = |(at, count): &(usize, &usize)| (**count > 0 && is_particular(*at), **count, usize::MAX - at);
    let (most, times) = counts.iter().enumerate().max_by_key(rank)?;
    let lines = if *times == 1 { String::from("a line reports") } else { format!("{times} lines report") };
    if *times == 0 {
        return None;
    }
    if let Some((code, [name, ..], advice)) = EXCEPTIONS.get(most) {
        let beside = format!(
            "{lines} exception {code} ({name}), and no answer that is printed here is one: it is that of another request, or the \
             program has made it; of a unit it means that {advice}"
        );
        let words = format!("{lines} exception {code} ({name}): {advice}");
        return Some(Said { words, beside_answers: None, beside_whole: Some(beside) });
    }
    let (_, meaning, beside) = REPORTS[most - EXCEPTIONS.len()];
    let said = |meaning: &str| format!("{lines} {meaning}");
    let (beside_answers, beside_whole) = match beside {
        Beside::Nothing => (None, None),
        Beside::Answers(words) => (Some(said(words)), None),
        Beside::WholeAnswers(words) => (None, Some(said(words))),
    };
    Some(Said { words: said(meaning), beside_answers, beside_whole })
}

/// What a line in lower case reports: the index in `EXCEPTIONS`, or after all of these in `REPORTS`.
fn report_in(line: &str) -> Option<usize> {
    let says = |words: &[&str]| words.iter().any(|word| line.contains(word));
    let codes: Vec<u8> = exception_codes(line).collect();
    let exception = EXCEPTIONS.iter().position(|(code, names, _)| codes.contains(code) || says(names));
    let report = || Some(EXCEPTIONS.len() + REPORTS.iter().position(|(words, ..)| says(words))?);
    exception.or_else(report)
}

/// The numbers after the word "exception": `exception 2`, `exception code: 2`, `exception = 2`.
fn exception_codes(line: &str) -> impl Iterator<Item = u8> + '_ {
    line.match_indices("exception").filter_map(|(at, word)| {
        let rest = &line[at + word.len()..];
        let rest = rest.strip_prefix([' ', '_']).and_then(|rest| rest.strip_prefix("code")).unwrap_or(rest);
        let rest = rest.strip_prefix([' ', ':', '='])?.trim_start_matches([' ', '=']);
        rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
    })
}

/// A line without the marks by which people emphasize a byte: `00 **06** 31`.
fn without_emphasis(line: &[u8]) -> Vec<u8> {
    line.iter().copied().filter(|byte| !matches!(byte, b'*' | b'_')).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_protocol::functions::{parse_toml, VOCABULARY};

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
        assert!(
            said.words(false, false).starts_with("in line 7 the bytes are the request before with some bits changed"),
            "{said:?}"
        );
        let other = UnreadLine { text: b"answer: 9A 3C E1 55 47 B2 0D 66", ..heard };
        let said = named_lines([other].into_iter()).expect("a reason");
        assert!(said.words(false, false).contains("are no frame"), "{said:?}");
    }

    #[test]
    fn where_others_were_answered_nobody_is_sent_to_the_wires() {
        let said = named_lines([line(b"ERROR Connection timed out: select")].into_iter()).expect("a reason");
        assert_eq!(said.words(true, false), "a line reports that no answer came in time; other requests were answered");
        assert!(said.words(false, false).starts_with("a line reports that no answer came in time: power, wires"));
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
