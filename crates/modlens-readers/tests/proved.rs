//! A frame is read from any line in which a checksum or an MBAP header proves it, whatever is around it.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialects, Reader};

type Strings = Vec<(Option<Side>, Vec<u8>)>;

/// What `modlens` reads of a text: the rows that it detects, and what it falls back to. Blocks of one frame are joined.
fn read(text: &str) -> (Strings, u64) {
    let guesses = detect(text.as_bytes(), "x.log", Dialects::embedded);
    let format = if guesses[0].1 < 0.2 || guesses[0].0 == "raw" { "proved" } else { guesses[0].0.as_str() };
    let table = Arc::new(Dialects::default());
    let mut reader = Reader::new(table.named(format).expect("a format"), Some(table), Arc::default());
    reader.look_ahead(text.as_bytes());
    reader.push(text.as_bytes());
    let mut strings: Strings = Vec::new();
    while let Some((record, bytes)) = reader.next(true) {
        match strings.last_mut() {
            Some((_, string)) if !record.starts_record => string.extend_from_slice(bytes),
            _ => strings.push((record.side, bytes.to_vec())),
        }
    }
    (strings, reader.unread_lines().count)
}

/// The CRC bit by bit, as the specification has it (serial line, 6.2.2).
fn crc(bytes: &[u8]) -> [u8; 2] {
    let mut register = 0xFFFF_u16;
    for &byte in bytes {
        register ^= u16::from(byte);
        for _ in 0..8 {
            register = if register & 1 == 1 { register >> 1 ^ 0xA001 } else { register >> 1 };
        }
    }
    register.to_le_bytes()
}

fn rtu(bytes: &[u8]) -> Vec<u8> {
    [bytes, &crc(bytes)].concat()
}

fn tcp(transaction: u16, adu: &[u8]) -> Vec<u8> {
    let [high, low] = transaction.to_be_bytes();
    [&[high, low, 0, 0, 0, adu.len() as u8], adu].concat()
}

/// A notation: its name, and how it prints bytes.
type Notation = (&'static str, fn(&[u8]) -> String);

fn each(bytes: &[u8], separator: &str, print: impl Fn(u8) -> String) -> String {
    bytes.iter().map(|&b| print(b)).collect::<Vec<_>>().join(separator)
}

const NOTATIONS: &[Notation] = &[
    ("blanks", |bytes| each(bytes, " ", |b| format!("{b:02X}"))),
    ("lower case", |bytes| each(bytes, " ", |b| format!("{b:02x}"))),
    ("two blanks", |bytes| each(bytes, "  ", |b| format!("{b:02X}"))),
    ("tabs", |bytes| each(bytes, "\t", |b| format!("{b:02X}"))),
    ("commas", |bytes| each(bytes, ",", |b| format!("{b:02X}"))),
    ("commas and blanks", |bytes| each(bytes, ", ", |b| format!("{b:02x}"))),
    ("semicolons", |bytes| each(bytes, "; ", |b| format!("{b:02x}"))),
    ("dashes", |bytes| each(bytes, "-", |b| format!("{b:02X}"))),
    ("dots", |bytes| each(bytes, ".", |b| format!("{b:02X}"))),
    ("colons", |bytes| each(bytes, ":", |b| format!("{b:02x}"))),
    ("bars", |bytes| each(bytes, "|", |b| format!("{b:02X}"))),
    ("bars in a table", |bytes| each(bytes, " | ", |b| format!("{b:02X}"))),
    ("underscores", |bytes| each(bytes, "_", |b| format!("{b:02X}"))),
    ("slashes", |bytes| each(bytes, "/", |b| format!("{b:02X}"))),
    ("no separator", |bytes| each(bytes, "", |b| format!("{b:02x}"))),
    ("no separator, upper case", |bytes| each(bytes, "", |b| format!("{b:02X}"))),
    ("0x in front", |bytes| format!("0x{}", each(bytes, "", |b| format!("{b:02X}")))),
    ("0x", |bytes| each(bytes, " ", |b| format!("0x{b:02x}"))),
    ("0x without zeros", |bytes| each(bytes, " ", |b| format!("{b:#x}"))),
    ("0x and commas", |bytes| each(bytes, ", ", |b| format!("0x{b:02X}"))),
    ("0X", |bytes| each(bytes, ",", |b| format!("0X{b:02X}"))),
    ("0x glued", |bytes| each(bytes, "", |b| format!("0x{b:02x}"))),
    ("x", |bytes| each(bytes, " ", |b| format!("x{b:02x}"))),
    ("backslashes", |bytes| each(bytes, "", |b| format!("\\x{b:02x}"))),
    ("backslashes without x", |bytes| each(bytes, "", |b| format!("\\{b:02X}"))),
    ("percent", |bytes| each(bytes, "", |b| format!("%{b:02X}"))),
    ("dollar", |bytes| each(bytes, " ", |b| format!("${b:02X}"))),
    ("hash", |bytes| each(bytes, " ", |b| format!("#{b:02X}"))),
    ("h after", |bytes| each(bytes, " ", |b| format!("{b:02X}h"))),
    ("H and commas", |bytes| each(bytes, ", ", |b| format!("{b:02X}H"))),
    ("assembler", |bytes| each(bytes, ",", |b| format!("0{b:02X}h"))),
    ("squares", |bytes| each(bytes, "", |b| format!("[{b:02X}]"))),
    ("squares and blanks", |bytes| each(bytes, " ", |b| format!("[{b:02x}]"))),
    ("angles", |bytes| each(bytes, "", |b| format!("<{b:02X}>"))),
    ("braces", |bytes| each(bytes, "", |b| format!("{{{b:02X}}}"))),
    ("parentheses", |bytes| each(bytes, "", |b| format!("({b:02X})"))),
    ("quotes", |bytes| each(bytes, ", ", |b| format!("'{b:02x}'"))),
    ("double quotes", |bytes| each(bytes, ",", |b| format!("\"{b:02X}\""))),
    ("quotes with 0x", |bytes| each(bytes, ", ", |b| format!("'0x{b:02x}'"))),
    ("Markdown", |bytes| each(bytes, " ", |b| format!("**{b:02X}**"))),
    ("words", |bytes| bytes.chunks(2).map(|two| each(two, "", |b| format!("{b:02x}"))).collect::<Vec<_>>().join(" ")),
    ("fours", |bytes| bytes.chunks(4).map(|four| each(four, "", |b| format!("{b:02X}"))).collect::<Vec<_>>().join(" ")),
    ("a gap after eight", |bytes| {
        bytes.chunks(8).map(|eight| each(eight, " ", |b| format!("{b:02x}"))).collect::<Vec<_>>().join("  ")
    }),
    ("loose", |bytes| each(bytes, " ", |b| format!("{b:X}"))),
    ("loose and commas", |bytes| each(bytes, ",", |b| format!("{b:x}"))),
    ("decimal", |bytes| each(bytes, ", ", |b| b.to_string())),
    ("decimal without blanks", |bytes| each(bytes, ",", |b| b.to_string())),
    ("decimal and dashes", |bytes| each(bytes, "-", |b| b.to_string())),
    ("decimal and blanks", |bytes| each(bytes, " ", |b| b.to_string())),
    ("decimal of three digits", |bytes| each(bytes, " ", |b| format!("{b:03}"))),
    ("decimal with signs", |bytes| each(bytes, ", ", |b| b.cast_signed().to_string())),
    ("binary", |bytes| each(bytes, " ", |b| format!("{b:08b}"))),
];

/// Around the bytes: what is in a line, and who sent them.
type Surroundings = (&'static str, &'static str, Option<Side>);

const SURROUNDINGS: &[Surroundings] = &[
    ("Parsing RTU frame: ", "", None),
    ("", " - Read 122", None),
    ("I see ", " on the wire.", None),
    ("frame is `", "`, I think", None),
    ("which is answered by ", "", Some(Side::Received)),
    ("Buffer.from(\"", "\",\"hex\")", None),
    ("Buffer.from([", "])", None),
    ("const uint8_t request[] = {", "}; // read two", Some(Side::Sent)),
    ("data=b'", "'", None),
    ("{\"level\":\"debug\",\"msg\":\"modbus\",\"raw\":\"", "\",\"unit\":5}", None),
    ("<Buffer ", ">", None),
    ("Uint8Array(8) [", "]", None),
    ("RTU recv (44 bytes): ", "", Some(Side::Received)),
    ("[44] Sending: ", "", Some(Side::Sent)),
    ("2026-11-21 12:30:05.250 DEBUG [main] c.e.Modbus - payload ", "", None),
    ("[2026-11-21T12:30:05.250Z] [INFO] master said: ", " [OK]", None),
    ("Nov 21 12:30:05 host gateway[1234]: >> ", "", Some(Side::Sent)),
    ("12:30:05.250  COM3  <- ", "", Some(Side::Received)),
    ("12:30:05.250 -> ", "   ", Some(Side::Sent)),
    ("I/flutter ( 1234): onRxData: ", "", Some(Side::Received)),
    ("D/ModbusMaster( 812): tx_buf: ", " len=8", Some(Side::Sent)),
    ("\u{53d1}\u{9001}: ", "", None),
    ("\u{43e}\u{442}\u{432}\u{435}\u{442} \u{2190} ", "", Some(Side::Received)),
    ("* response **", "**", Some(Side::Received)),
    ("- request: _", "_", Some(Side::Sent)),
    ("| request | ", " | read two registers |", Some(Side::Sent)),
    ("1) Tx frame (hex) = ", ";", Some(Side::Sent)),
    ("[bus 2][I][meter.cpp:131] Received bytes <", ">", Some(Side::Received)),
    ("Write request sent: (", ")", Some(Side::Sent)),
    ("expected CRC ok, message: ", " !", None),
    ("Error: timeout after frame ", "; retry", None),
    ("serial.write([", "])", Some(Side::Sent)),
    ("print(ser.read(16))  # ", "", None),
    ("at line 12 of file.c: buf = { ", " }", None),
    ("\t\t--> ", " <--", Some(Side::Sent)),
    ("Slave answered with ", " within 20 ms (ok)", Some(Side::Received)),
    ("01.02.2026 12:30:05 #17: ", "", None),
    ("unit 5 func 3: ", ", took 12ms", None),
    ("0000-0001 \u{00bb} ", " \u{00ab}", None),
    ("Dump of the reply = \"", "\"", Some(Side::Received)),
];

/// Frames that each have a layout of one direction, with the bytes that they have on the line.
fn frames() -> Vec<Vec<u8>> {
    vec![
        rtu(&[5, 3, 0, 0x10, 0, 2]),
        rtu(&[5, 3, 4, 0, 0xFA, 1, 0x2C]),
        rtu(&[0x11, 0x83, 2]),
        rtu(&[1, 0x10, 0, 1, 0, 2, 4, 0, 10, 1, 2]),
        tcp(0x1234, &[5, 3, 0, 0x6B, 0, 3]),
        tcp(0xC7D0, &[0xFF, 4, 6, 0x12, 0xAB, 0, 200, 0xFF, 0xFE]),
    ]
}

/// Whether nobody could tell what these bytes are: the same text is valid in another notation.
fn is_ambiguous(notation: &str, surroundings: &Surroundings, frame: &[u8]) -> bool {
    // Without a checksum, numbers below 100 with dashes are hex as well as decimal.
    if notation == "decimal with signs" && frame[2..4] == [0, 0] {
        return true;
    }
    let continues = surroundings.0.ends_with(|c: char| c.is_ascii_alphanumeric());
    let is_comment = notation == "hash" && surroundings.0.is_empty();
    continues || is_comment || (notation == "backslashes without x" && surroundings.0.ends_with("b'"))
}

#[test]
fn a_frame_is_read_in_any_notation_and_surroundings() {
    let mut failures = Vec::new();
    let mut count = 0;
    for notation in NOTATIONS {
        for around in SURROUNDINGS {
            for frame in frames().into_iter().filter(|frame| !is_ambiguous(notation.0, around, frame)) {
                count += 1;
                let line = format!("{}{}{}\n", around.0, notation.1(&frame), around.1);
                let (strings, _) = read(&line);
                if strings.iter().map(|(_, bytes)| bytes).ne([&frame]) {
                    failures.push(format!("{}: {line:?} {strings:02X?}", notation.0));
                } else if around.2.is_some() && strings[0].0 != around.2 {
                    failures.push(format!("sender {:?}: {line:?}", strings[0].0));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{} of {count}:\n{}", failures.len(), failures[..failures.len().min(60)].join("\n"));
}

/// The frames of a text, without their senders.
fn frames_of(text: &str) -> Vec<Vec<u8>> {
    read(text).0.into_iter().map(|(_, bytes)| bytes).collect()
}

fn spaced(bytes: &[u8]) -> String {
    each(bytes, " ", |b| format!("{b:02X}"))
}

#[test]
fn lines_of_reports_are_read() {
    let [request, response] = [rtu(&[1, 4, 0, 0, 0, 2]), rtu(&[1, 4, 4, 0, 1, 2, 3])];
    let (asked, said) = (spaced(&request), spaced(&response));
    let escaped = |bytes: &[u8]| each(bytes, "", |b| format!("\\{b:02X}"));
    let plain = |bytes: &[u8]| each(bytes, "", |b| format!("{b:02x}"));
    for line in [
        format!("Parsing RTU frame: {asked}"),
        format!("{asked} - Read 122"),
        format!("which is answered by {asked}"),
        format!("\"{asked}\","),
        format!("Buffer.from(\"{}\",\"hex\")", plain(&request)),
        format!("b'{}'", plain(&request)),
        format!("answer: {}", asked.replacen("04", "**04**", 1)),
        format!("RTU recv (44 bytes): {asked}"),
        format!("echo -ne '{}'", escaped(&request)),
        format!("[0000] {asked}  ........"),
        format!("Frame 3/17: {asked} crc ok"),
    ] {
        assert_eq!(frames_of(&line), [&request[..]], "{line}");
    }
    assert_eq!(frames_of(&format!("poll: {asked}, answer: {said} in 12 ms")), [&request[..], &response]);
    let eight = format!("log: {asked} | {said} | ").repeat(4);
    assert_eq!(frames_of(&eight).len(), 8, "{eight}");
    let in_front = format!("Tx: {asked} and then the rest, {said}, {asked}");
    assert_eq!(frames_of(&in_front), [&request[..], &response, &request]);
}

/// How a program prints one byte in a line; the first argument says whether it was sent.
type Print = fn(bool, u8) -> String;

#[test]
fn a_byte_a_line_is_read() {
    let [request, response] = [rtu(&[5, 3, 0, 0x26, 0, 2]), rtu(&[5, 3, 4, 0, 0x26, 0, 0x41])];
    let prints: [Print; 5] = [
        |sent, b| format!("{}  0x{b:02x} ({})", if sent { '<' } else { '>' }, char::from(b & 0x5F)),
        |sent, b| format!("{} Byte {b} (0X{b:X})", if sent { "sent" } else { "received" }),
        |sent, b| format!("12:30:05 uart {}: {b:02X}", if sent { "tx" } else { "rx" }),
        |sent, b| format!("[D][{}] char = {b:02x}h;", if sent { "out" } else { "in" }),
        |sent, b| format!("{}[{}] 0x{b:02X}", if sent { "TxBuf" } else { "RxBuf" }, b % 7),
    ];
    for (i, print) in prints.iter().enumerate() {
        let lines = |sent, bytes: &[u8]| bytes.iter().map(|&b| print(sent, b) + "\n").collect::<String>();
        let text = lines(true, &request) + &lines(false, &response);
        assert_eq!(frames_of(&text), [&request[..], &response], "{i}: {text}");
    }
}

#[test]
fn frames_in_parts_and_damaged_ones_are_read_where_others_are() {
    let [request, response] = [rtu(&[5, 3, 0, 0x10, 0, 2]), rtu(&[5, 3, 4, 0, 0xFA, 1, 0x2C])];
    let mut damaged = response.clone();
    damaged[5] ^= 0x40;
    let line = |bytes: &[u8]| format!("line 7 of 9, payload={} end\n", spaced(bytes));
    let text = [&request[..], &response, &request, &damaged, &request, &response[..4], &response[4..]].map(line).concat();
    let expected = [&request[..], &response, &request, &damaged, &request, &response];
    assert_eq!(frames_of(&text), expected);
}

#[test]
fn what_a_program_prints_twice_counts_once() {
    let [request, response] = [rtu(&[5, 3, 0, 0x10, 0, 2]), rtu(&[5, 3, 4, 0, 0xFA, 1, 0x2C])];
    let (asked, said) = (spaced(&request), spaced(&response));
    let round = format!("I sent {asked} now\nQueue holds {asked} now\nthe meter answered {said}\nParsing RTU frame: {said}\n");
    // The same request again, by the same statement, was sent again.
    assert_eq!(frames_of(&round.repeat(2)), [&request[..], &response, &request, &response]);
    assert_eq!(frames_of(&format!("I sent {asked} now\n").repeat(3)).len(), 3);
    // The echo of a written register is a response.
    let echo = spaced(&rtu(&[5, 6, 0, 1, 0, 3]));
    assert_eq!(frames_of(&format!("frame one: {echo}\nframe two of it: {echo}\n")).len(), 2);
    assert_eq!(frames_of(&format!("I sent {echo} now\nit was answered by {echo} then\n")).len(), 2);
    // One line with both, in two notations.
    let both = format!("read {said} is {}\n", each(&response, ", ", |b| b.to_string()));
    assert_eq!(frames_of(&both), [&response[..]]);
}

#[test]
fn growing_buffers_are_no_further_bytes() {
    let response = rtu(&[5, 3, 4, 0, 0xFA, 1, 0x2C]);
    let hex = |bytes: &[u8]| each(bytes, " ", |b| format!("{b:#x}"));
    let line =
        |bytes: &[u8]| format!("2026-11-21 12:30:05.250 DEBUG (MainThread) [pymodbus.logging] Processing: {}\n", hex(bytes));
    let asked = hex(&rtu(&[5, 3, 0, 0x10, 0, 2]));
    let sent = format!("2026-11-21 12:30:05.200 DEBUG (MainThread) [pymodbus.logging] send: {asked}\n");
    let text = sent + &line(&response[..2]) + &line(&response[..5]) + &line(&response) + &line(&response);
    assert_eq!(frames_of(&text), [rtu(&[5, 3, 0, 0x10, 0, 2]), response]);
}

#[test]
fn numbers_of_other_meaning_give_no_frame() {
    for text in [
        "2026-11-21 12:30:05.250 INFO worker 17 of pool 3: cache holds 44 of 4096 entries\n",
        "0000: 01 04 00 00 00 02 00 00\n0010: 12 34 56 78 9a bc de f0\n",
        "commit 0123456789abcdef0123456789abcdef01234567\n",
        "device 01:23:45:67:89:ab connected, rssi -67, handle 0x0040\n",
        "uuid 550e8400-e29b-41d4-a716-446655440000\n",
        "values: 1, 2, 3, 4, 5, 6, 7, 8, 9, 10\n",
        "[00:00:00.000,000] <inf> boot: 0x20000000 0x00000000 0x00000000 0x00000000\n",
        "id:a1b2c3d4 trace:deadbeef span:00f067aa0ba902b7\n",
    ] {
        let among = text.repeat(20);
        let guesses = detect(among.as_bytes(), "x.log", Dialects::embedded);
        assert!(guesses[0].1 < 0.2 || guesses[0].0 == "raw", "{text}: {guesses:?}");
    }
}

#[test]
fn frames_of_modbus_ascii_are_read_anywhere() {
    let [one, two] = [":010300000001FB", ":0103020005F5"];
    let text = format!("Sending to port 2: \"{one}\\r\\n\", then wait\nit answered '{two}' at once\n");
    let (strings, _) = read(&text);
    let wire = |text: &str| [text.as_bytes(), b"\r\n"].concat();
    assert_eq!(strings, [(Some(Side::Sent), wire(one)), (Some(Side::Received), wire(two))]);
}

#[test]
fn unread_lines_are_ranked_by_their_hex() {
    let frame = spaced(&rtu(&[5, 3, 0, 0x10, 0, 2]));
    let few = "block of 01 02 03 0A 05 bytes and so on\n";
    let many = "block of 01 02 03 0A 05 06 07 08 09 10 bytes and so on\n";
    let text = format!("Tx: {frame}\n2026-11-21 12:30:05 nothing here\nnor here\nor here\n{few}{many}");
    let table = Arc::new(Dialects::default());
    let mut reader = Reader::new(table.named("words").expect("a row"), Some(table), Arc::default());
    reader.push(text.as_bytes());
    while reader.next(true).is_some() {}
    let unread = reader.unread_lines();
    assert_eq!((unread.count, unread.with_hex, unread.hex_bytes), (5, 2, 15));
    let lines: Vec<(u64, usize)> = unread.examples.iter().map(|(number, _, bytes)| (*number, *bytes)).collect();
    assert_eq!(lines, [(6, 10), (5, 5), (2, 0)]);
}

#[test]
fn nothing_is_guessed_where_a_format_is_named() {
    let table = Dialects::embedded();
    let frame = spaced(&rtu(&[5, 3, 0, 0x10, 0, 2]));
    let mut reader = Reader::new(table.named("pymodbus").expect("a row"), None, Arc::default());
    reader.push(format!("Parsing RTU frame: {frame}\n").as_bytes());
    assert!(reader.next(true).is_none());
    assert_eq!(reader.unread_lines().count, 1);
}

/// An RTU frame in the wrapper of Solarman V5 as pysolarmanv5 documents it, without the checksum at its end.
fn solarman_without_sum(control: u16, rtu_frame: &[u8]) -> Vec<u8> {
    let [low, high] = control.to_le_bytes();
    let is_request = control == 0x4510;
    let payload = if is_request { 15 } else { 14 };
    let length = (payload + rtu_frame.len()) as u8;
    let header = [0xA5, length, 0, low, high, 7, 0, 0x31, 0x52, 0x1A, 0x6B];
    [&header[..], &[2], &vec![0; payload - 1], rtu_frame, &[0, 0x15]].concat()
}

#[test]
fn wrappers_of_solarman_are_taken_off_before_their_checksum_is_put_in() {
    let [request, response] = [rtu(&[1, 3, 0, 0x28, 0, 3]), rtu(&[1, 3, 6, 0, 0xFA, 1, 0x2C, 0, 9])];
    let (open_request, mut whole) = (solarman_without_sum(0x4510, &request), solarman_without_sum(0x1510, &response));
    let last = whole.len() - 2;
    whole[last] = whole[1..last].iter().fold(0u8, |sum, &b| sum.wrapping_add(b));
    let notations: [Notation; 3] = [
        ("Python", |bytes| format!("bytearray(b'{}')", each(bytes, "", |b| format!("\\x{b:02x}")))),
        ("blanks", spaced),
        ("no separator", |bytes| each(bytes, "", |b| format!("{b:02x}"))),
    ];
    for (name, print) in notations {
        let text = format!("Sent data:  {}\nReceived data:  {}\n", print(&open_request), print(&whole));
        let expected = [(Some(Side::Sent), request.clone()), (Some(Side::Received), response.clone())];
        assert_eq!(read(&text).0, expected, "{name}: {text}");
    }
}

#[test]
fn the_rtu_form_of_an_mbap_frame_is_a_copy_of_it() {
    let json = |bytes: &[u8]| format!("{{\"type\":\"Buffer\",\"data\":[{}]}}", each(bytes, ",", |b| b.to_string()));
    let plain = |bytes: &[u8]| each(bytes, "", |b| format!("{b:02x}"));
    let answer = rtu(&[1, 0x83, 2]);
    for (transaction, adu) in [(0x2C, [1, 1, 0, 0, 0, 1]), (0x1234, [5, 3, 0, 0x6B, 0, 3]), (7, [2, 6, 0, 1, 0, 9])] {
        let (outer, inner) = (tcp(transaction, &adu), rtu(&adu));
        let expected = [(Some(Side::Received), outer.clone()), (Some(Side::Sent), answer.clone())];
        let (o, i, a) = (spaced(&outer), spaced(&inner), spaced(&answer));
        for text in [
            format!("socket received {o}\nrequest received by the server: {i}\nsending {a}\n"),
            format!(
                "rx: <{o}>\nreceived {}\n{{\"received\":{}}}\nsend: {a}\nsend {}\n",
                plain(&inner),
                json(&inner),
                json(&answer)
            ),
        ] {
            assert_eq!(read(&text).0, expected, "{text}");
        }
        let without_words = format!("socket {o}\nunwrapped {i}\n");
        let may_be_echo = adu[1] == 6;
        assert_eq!(frames_of(&without_words).len(), if may_be_echo { 2 } else { 1 }, "{without_words}");
        // A gateway has received the one and sent the other.
        let passed_on = format!("TCP received {o}\nRTU sent {i}\n");
        assert_eq!(frames_of(&passed_on), [&outer[..], &inner]);
    }
}

/// A call of node-modbus-serial's server, with what it prints of one request and its response.
fn node_server(transaction: u16, adu: &[u8], answer: &[u8]) -> String {
    let (outer, inner, answer) = (tcp(transaction, adu), rtu(adu), rtu(answer));
    let low = |bytes: &[u8]| each(bytes, " ", |b| format!("{b:02x}"));
    let (o, i, a) = (low(&outer), low(&inner), low(&answer));
    let json = |bytes: &[u8]| each(bytes, ",", |b| b.to_string());
    format!(
        " modbus-serial {{ action: 'socket data',\n  modbus-serial   data: <Buffer {o}> }} +50ms\n\
         modbus-serial {{ action: 'receive',\n  modbus-serial   data: <Buffer {i}>,\n\
         modbus-serial   requestBufferLength: {} }} +1ms\n\
         modbus-serial {{\"action\":\"receive\",\"data\":{{\"type\":\"Buffer\",\"data\":[{}]}}}} +0ms\n\
         modbus-serial {{ action: 'server response',\n  modbus-serial   responseBuffer: '{}' }} +0ms\n\
         modbus-serial {{ action: 'send', data: <Buffer {a}> }} +0ms\n\
         modbus-serial {{\"action\":\"send string\",\"data\":{{\"type\":\"Buffer\",\"data\":[{}]}}}} +0ms\n",
        inner.len(),
        json(&inner),
        a.replace(' ', ""),
        json(&answer),
    )
}

#[test]
fn a_server_of_node_modbus_serial_prints_each_frame_several_times() {
    let [ask, coil, echo] = [[9, 3, 0, 2, 0, 1], [9, 1, 0, 0, 0, 4], [9, 6, 0, 2, 0, 0x11]];
    let [said, refused] = [&[9, 3, 2, 0, 0x11][..], &[9, 0x81, 4]];
    let text = node_server(8, &ask, said) + &node_server(9, &coil, refused) + &node_server(10, &echo, &echo);
    let sent = |adu: &[u8]| (Some(Side::Sent), rtu(adu));
    let received = |transaction, adu: &[u8]| (Some(Side::Received), tcp(transaction, adu));
    let expected = [received(8, &ask), sent(said), received(9, &coil), sent(refused), received(10, &echo), sent(&echo)];
    assert_eq!(read(&text).0, expected, "{text}");
}

/// A request and its response as programs list them for people: a field a line.
const LISTED: &str = "\
Request:
Transaction ID: 0x0001
Protocol ID: 0x0000
Length: 0x0006
Unit ID: 0x01
Function: 0x03 (Read Holding Registers)
Start address: 0x006B
Quantity: 0x0003

Response:
Transaction ID: 0x0001
Protocol ID: 0x0000
Length: 0x0009

Unit ID: 0x01
Function: 0x03
Byte count: 0x06
Data: 02 2B 00 00 00 64  # 555, 0, 100
";

#[test]
fn fields_of_one_line_each_are_a_frame_where_the_header_announces_them() {
    let request = tcp(1, &[1, 3, 0, 0x6B, 0, 3]);
    let response = tcp(1, &[1, 3, 6, 2, 0x2B, 0, 0, 0, 0x64]);
    let (strings, unread) = read(LISTED);
    assert_eq!(strings, [(Some(Side::Sent), request.clone()), (Some(Side::Received), response.clone())]);
    assert_eq!(unread, 2, "the two titles");
    let plain = LISTED.replace("0x", "").replace("Request:", "").replace("Response:", "").replace(": ", " = ");
    assert_eq!(read(&plain), (vec![(None, request), (None, response)], 0));
}

#[test]
fn fields_that_their_header_does_not_announce_are_no_frame() {
    for (right, wrong) in
        [("0x0006", "0x0007"), ("Protocol ID: 0x0000", "Protocol ID: 0x0001"), ("Function: 0x03", "Function: 0x49")]
    {
        let (strings, _) = read(&LISTED.replace(right, wrong));
        assert!(strings.len() < 2, "{right} -> {wrong}: {strings:?}");
    }
    let registers = "reg 1: 0001\nreg 2: 0000\nreg 3: 0006\nreg 4: 0103\nreg 5: 006B\nreg 6: 0003\n";
    assert_eq!(read(registers).0, [], "no field ends with the unit");
}

#[test]
fn frames_are_joined_that_are_listed_a_byte_a_line_after_its_place() {
    let (request, response) =
        (rtu(&[1, 3, 0, 0, 0, 8]), rtu(&[1, 3, 16, 0, 7, 1, 44, 0, 0, 255, 255, 0, 9, 0, 200, 18, 52, 0, 1]));
    let lists: &[fn(usize, u8) -> String] = &[
        |at, byte| format!("{at:02X}: {byte:02X}"),
        |at, byte| format!("{at}: {byte}"),
        |at, byte| format!("data[{at}]={byte}"),
        |at, byte| format!("[{at}] {byte:02X}"),
        |at, byte| format!("buf[{at}]: {byte:08b}"),
        |at, byte| format!("byte {at} | {byte:#04x},"),
        |at, byte| format!("frame.buffer[{at:>2}] = {byte:>3};"),
    ];
    for (number, list) in lists.iter().enumerate() {
        let listed = |bytes: &[u8]| {
            let lines = bytes.iter().enumerate().map(|(at, byte)| list(at, *byte) + "\n");
            lines.collect::<String>()
        };
        let text = format!("Sent:\n{}Received:\n{}", listed(&request), listed(&response)).repeat(2);
        let (strings, unread) = read(&text);
        let frames = [(Some(Side::Sent), request.clone()), (Some(Side::Received), response.clone())];
        // The titles are the four lines without bytes.
        assert_eq!((strings, unread), ([&frames[..], &frames[..]].concat(), 4), "list {number}");
    }
    // With a time in front, and other output between the bytes.
    let logged =
        |(at, byte): (usize, &u8)| format!("[N] {}| receive: {:>3}: {byte:02X}\n[N] 7| receive: tick!\n", 4460 + at, at + 1);
    let logged = response.iter().enumerate().map(logged).collect::<Vec<_>>().concat();
    assert_eq!(read(&logged).0, [(Some(Side::Received), response)]);
    // A list of other numbers is no frame, and one that lacks a place neither.
    let place = |at: usize| at + usize::from(at > 3);
    let holed = each(&request, "\n", |byte| format!("{byte:02X}"));
    let holed = holed.lines().enumerate().map(|(at, byte)| format!("{:02X}: {byte}", place(at))).collect::<Vec<_>>().join("\n");
    assert_eq!(read(&holed).0, []);
}
