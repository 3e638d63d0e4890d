//! What the words of a text report: exceptions, error messages of programs, and codes of libraries.

use modlens_protocol::oddity::{Printed, Reported};

/// The exceptions that programs report (application protocol, 7): code, names in lower case, and what to do. The message has
/// the first of the names.
pub(super) const EXCEPTIONS: [(u8, &[&str], &str); 5] = [
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
/// which prove more: requests were answered, so that what they came by is right, or frames are whole.
const REPORTS: [(&[&str], &str, Beside); 11] = [
    (
        &["cleanup recv buffer"],
        "bytes left over before a request: the rest of an answer that came after the client had given up; raise its timeout",
        Beside::Nothing,
    ),
    (
        &["incorrect data logger serial", "incorrect sequence number"],
        "an answer of the data logger that is not to this request: the serial number that the program sends is not that of the logger, which \
         refuses it then, or another program asks the logger, too",
        Beside::Nothing,
    ),
    (
        &["ignored (not "],
        "requests to another unit than the program is, which it says to ignore: where it answers them all the same, as far as bytes are \
         printed, it answers for another unit",
        Beside::Nothing,
    ),
    (
        &["requested slave (not", "slave id mismatch", "unit id mismatch", "invalid slave id", "response from wrong slave", "unexpected slave"],
        "an answer with another unit number than was asked: a late answer of another unit, an echo, or a gateway that puts its own number",
        Beside::Nothing,
    ),
    (
        &["port not open", "could not open port", "cannot open port", "permission denied", "access is denied", "device or resource busy", "no such file or directory", "error opening port", "failed to open port"],
        "a port that the program cannot open: nothing was sent; its name, the rights of the user, and other programs that hold it",
        Beside::Nothing,
    ),
    (
        &["no route to host", "host is unreachable", "network is unreachable", "name or service not known", "ehostunreach", "enotfound", "getaddrinfo"],
        "a host that the network does not reach: its address, the cable and the router; nothing of Modbus was sent",
        Beside::Nothing,
    ),
    (
        &["connection refused", "actively refused", "econnrefused", "cannot connect", "could not connect", "failed to connect", "connection failed"],
        "a connection that the other side does not accept: its port (502) and service, and how many clients it takes",
        Beside::Nothing,
    ),
    (
        &["connection reset", "broken pipe", "econnreset", "epipe", "closed by the remote", "forcibly closed", "connection lost", "connection closed", "because of eof", "unexpected eof"],
        "a connection that the other side closed: how many clients it takes, how long it keeps an idle one, and requests that it does not know",
        Beside::Nothing,
    ),
    (
        &["transaction id mismatch", "transaction identifier", "transaction id '", "invalid transaction", "expected transaction", "unexpected transaction", "unexpected response with transaction"],
        "an answer with another transaction identifier than that of the request: it belongs to a request before, and came too late, or a gateway \
         numbers its answers itself",
        Beside::Nothing,
    ),
    (
        &["checksum error", "crc error", "crc check error", "crccheckerror", "crc mismatch", "crcmismatch", "crc received", "invalid crc", "wrong crc", "crc check failed", "bad crc", "incorrect crc", "crc fail", "crc not match", "crc does not match", "crc doesn't match", "does not match the crc", "checksums failed to match", "checksum mismatch", "invalid checksum", "wrong checksum", "bad (should be", "lrc error"],
        "a wrong checksum: bits changed on the line, other line settings, or bytes lost by a program; a recording of the bytes shows which",
        Beside::WholeFrames {
            answers: "a wrong checksum, and the answers that are printed here have right ones: they are whole, so that the program checks \
                      them wrongly, or means bytes that it does not print",
            requests: "a wrong checksum, and the request that is printed here has a right one. If this program sent it, its complaint is of the answer, \
                       which is not printed: bits changed on the line, other line settings, or lost bytes. If this program received it, it \
                       checks it wrongly, as where it takes requests for answers",
        },
    ),
    (
        &["timed out", "timeout", "time out", "no response", "no answer", "no reply", "not responding", "no communication", "(0 received)", "received 0 bytes"],
        "that no answer came in time: power, wires, rate and address of the unit, and whether anything comes back at all",
        Beside::Answers {
            some: "that no answer came in time; other requests were answered",
            all: "that no answer came in time, and what is printed here was answered: the answer came when the program had given up, which a longer \
                  timeout cures, the program did not take it for one, or the report is of a request that is not printed",
        },
    ),
];

/// Codes of microcontroller libraries, which are not the same in all of them.
const CODES: [(u8, &str); 7] = [
    (0xE0, "of eModbus and esp32ModbusRTU that no answer came in time, of ModbusMaster that another unit answered than was asked"),
    (0xE1, "of ModbusMaster that another function was answered than was asked, of modbus-esp8266 a failure without a reason"),
    (0xE2, "of ModbusMaster that no answer came in time, of eModbus a wrong checksum, of modbus-esp8266 data of another size than its function has"),
    (0xE3, "of ModbusMaster a wrong checksum, of eModbus and modbus-esp8266 an answer that is not that to the request"),
    (0xE4, "of modbus-esp8266 that no answer came in time, of eModbus that another unit answered than was asked"),
    (0xE5, "of eModbus an answer of another length than its function has, of modbus-esp8266 that the connection was lost"),
    (0xE6, "of modbus-esp8266 that the request was cancelled, of eModbus a request with too many or too few parameters"),
];

/// What is said of a report beside frames that contradict it.
#[derive(Clone, Copy, Debug)]
enum Beside {
    /// The same.
    Nothing,
    /// Where some requests were answered, and where all were.
    Answers { some: &'static str, all: &'static str },
    /// Where whole answers came, and where there are whole frames only.
    WholeFrames { answers: &'static str, requests: &'static str },
}

/// The first of the reports.
const LEFT_OVER: usize = EXCEPTIONS.len();

/// What unread lines show.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Said {
    pub(super) words: String,
    /// What is said instead where some requests of the same text were answered, where all were, where whole answers came, and where all
    /// frames are whole.
    answered: [Option<String>; 2],
    whole: [Option<String>; 2],
    pub(super) has_bytes: bool,
    is_unknown: bool,
}

impl Said {
    /// What is said beside what the frames of the same text show. Where the lines hold bytes, their damage may be what is reported.
    pub fn beside(&self, printed: Printed) -> Reported {
        let ([some, all], [answers, frames]) = (&self.answered, &self.whole);
        let instead = [
            (answers, printed.has_whole_answers && !self.has_bytes),
            (frames, printed.is_whole && !self.has_bytes),
            (all, printed.has_all_answered),
            (some, printed.has_answered),
        ];
        let instead = instead.into_iter().find_map(|(words, is_so)| words.as_deref().filter(|_| is_so));
        let words = instead.unwrap_or(&self.words).to_owned();
        Reported { words, has_bytes: self.has_bytes, is_unknown: self.is_unknown }
    }

    /// What is said of lines with hex of which nothing else is known: how many there are, and which of them holds most.
    pub(super) fn of_hex(lines: u64, most: u64) -> Self {
        let words = match lines {
            1 => format!("line {most} holds hex that could not be read as a frame"),
            count => format!("{count} lines hold hex that could not be read as frames, line {most} most of it"),
        };
        Self { has_bytes: true, is_unknown: true, ..Self::from(words) }
    }
}

impl From<String> for Said {
    fn from(words: String) -> Self {
        Self { words, answered: [None, None], whole: [None, None], has_bytes: false, is_unknown: false }
    }
}

/// What most lines report.
pub(super) fn reported<'a>(lines: impl Iterator<Item = &'a [u8]> + Clone) -> Option<Said> {
    let texts = || lines.clone().map(|line| String::from_utf8_lossy(line).to_ascii_lowercase());
    let mut counts = [0; EXCEPTIONS.len() + REPORTS.len()];
    texts().filter_map(|line| report_in(&line)).for_each(|report| counts[report] += 1);
    // Bytes left over are what the requests without an answer got.
    let is_particular = |at: usize| at == LEFT_OVER;
    let rank = |(at, count): &(usize, &usize)| (**count > 0 && is_particular(*at), **count, usize::MAX - at);
    let (most, times) = counts.iter().enumerate().max_by_key(rank)?;
    let lines = if *times == 1 { String::from("a line reports") } else { format!("{times} lines report") };
    if *times == 0 {
        return texts().find_map(|line| counted(&line).or_else(|| coded(&line))).map(Said::from);
    }
    let said = |meaning: &str| format!("{lines} {meaning}");
    if let Some((code, [name, ..], advice)) = EXCEPTIONS.get(most) {
        let words = format!("{lines} exception {code} ({name}): {advice}");
        let beside = format!(
            "{lines} exception {code} ({name}), and no answer that is printed here is one: it is that of another request, or the \
             program has made it; of a unit it means that {advice}"
        );
        return Some(Said { whole: [Some(beside), None], ..Said::from(words) });
    }
    let (_, meaning, beside) = REPORTS[most - EXCEPTIONS.len()];
    let plain = Said::from(said(meaning));
    Some(match beside {
        Beside::Nothing => plain,
        Beside::Answers { some, all } => Said { answered: [Some(said(some)), Some(said(all))], ..plain },
        Beside::WholeFrames { answers, requests } => Said { whole: [Some(said(answers)), Some(said(requests))], ..plain },
    })
}

/// Reads what a line reports about an answer that is too short or too long: how many bytes the program expected, and how many came.
fn counted(line: &str) -> Option<String> {
    let number = |text: &str| text.split(|c: char| !c.is_ascii_digit()).find(|part| !part.is_empty())?.parse::<u32>().ok();
    let is_of_bytes = ["byte", "length", "size"].iter().any(|word| line.contains(word));
    let (expected, got) = if let Some((got, expected)) = line.split_once("does not match") {
        (number(expected)?, number(got)?)
    } else {
        let got = ["received", "recieved", "got ", "but was"].iter().find_map(|word| {
            let at = line.find(word)?;
            let before = line[..at].trim_end_matches([' ', '(']).rsplit(|c: char| !c.is_ascii_digit()).next()?.parse().ok();
            number(line[at..].split([',', ';']).next()?).or(before)
        });
        (number(&line[line.find("expect")?..])?, got?)
    };
    let what = if got < expected {
        "bytes were lost, the timeout is too short for the whole answer, or it is a refusal, which has 5 bytes"
    } else {
        "the answer belongs to another request, or other bytes are in front of it or after it"
    };
    (is_of_bytes && got != expected && got > 0 && expected < 300)
        .then(|| format!("a line reports an answer of {got} bytes in place of {expected}: {what}"))
}

/// What a line means by a code of a library for microcontrollers.
fn coded(line: &str) -> Option<String> {
    let is_report = ["err", "result", "fail", "code", "return", "exception"].iter().any(|word| line.contains(word));
    let words = || line.split(|c: char| !c.is_ascii_alphanumeric());
    let code = |word: &str| match word.strip_prefix("0x").unwrap_or(word) {
        hex if hex.len() == 2 && hex.starts_with('e') => u8::from_str_radix(hex, 16).ok(),
        decimal => decimal.parse().ok().filter(|code| *code >= CODES[0].0),
    };
    let (code, meaning) = words().filter_map(code).find_map(|code| CODES.iter().find(|(known, _)| *known == code))?;
    (is_report && words().count() < MOST_CODED)
        .then(|| format!("a line reports the code {code:02X} ({code}), which means {meaning}"))
}

/// A longer line is bytes.
const MOST_CODED: usize = 24;

/// What a line in lower case reports: the index in `EXCEPTIONS`, or after all of these in `REPORTS`.
fn report_in(line: &str) -> Option<usize> {
    let says = |words: &[&str]| {
        words.iter().any(|word| line.match_indices(word).any(|(at, _)| !is_setting(word, &line[at + word.len()..])))
    };
    let codes: Vec<u8> = exception_codes(line).collect();
    let exception = EXCEPTIONS.iter().position(|(code, names, _)| codes.contains(code) || says(names));
    let report = || Some(EXCEPTIONS.len() + REPORTS.iter().position(|(words, ..)| says(words))?);
    exception.or_else(report)
}

/// Whether a word and what follows it give a time and no event: `timeout=10000`, `Timeout setting: 1100.0 ms`.
fn is_setting(word: &str, rest: &str) -> bool {
    let value = rest.trim_start_matches(" setting").trim_start().strip_prefix([':', '=']);
    TIMES.contains(&word) && value.is_some_and(|value| value.trim_start().starts_with(|c: char| c.is_ascii_digit()))
}

/// The words of reports that are names of settings, too.
const TIMES: [&str; 2] = ["timeout", "time out"];

/// The numbers after the word "exception": `exception 2`, `exception code: 2`, `exception = 2`.
fn exception_codes(line: &str) -> impl Iterator<Item = u8> + '_ {
    line.match_indices("exception").filter_map(|(at, word)| {
        let rest = &line[at + word.len()..];
        let rest = rest.strip_prefix([' ', '_']).and_then(|rest| rest.strip_prefix("code")).unwrap_or(rest);
        let rest = rest.strip_prefix([' ', ':', '='])?.trim_start_matches([' ', '=']);
        rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_that_is_set_is_no_report() {
        let said = |line: &str| reported([line.as_bytes()].into_iter()).map(|said| said.words);
        for setting in ["worker: started, timeout=2500", "Timeout: 300 ms", "timeout = 1.5", "Timeout setting: 850.0 ms."] {
            assert_eq!(said(setting), None, "{setting}");
        }
        for event in ["timeout", "Timeout: no data", "TIMEOUT 300 ms", "read timeout (timeout=300)", "no answer, timeout=300"] {
            assert!(said(event).is_some_and(|words| words.contains("no answer came in time")), "{event}");
        }
    }
}
