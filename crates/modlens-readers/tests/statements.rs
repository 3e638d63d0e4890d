//! Which statements of a program print frames is learned from the whole text, and no hex in it is dropped silently.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialects, Reader};

/// The entries of a text: line, side, bytes as hex, whether the checksum was not printed.
type Entries = Vec<(u64, Option<Side>, String, bool)>;

/// Reads a text as `modlens decode` does; also returns the lines of skipped bytes, and the reader.
fn read(text: &str) -> (Entries, Reader, f64) {
    let guesses = detect(text.as_bytes(), "x.log", Dialects::embedded);
    let format = if guesses[0].0 == "raw" { "proved" } else { guesses[0].0.as_str() };
    let table = Arc::new(Dialects::default());
    let mut reader = Reader::new(table.named(format).expect("a format"), Some(table), Arc::default());
    reader.look_ahead(text.as_bytes());
    reader.push(text.as_bytes());
    let mut entries = Entries::new();
    while let Some((entry, bytes)) = reader.next(true) {
        let hex = modlens_protocol::hex::hex(bytes).to_lowercase();
        entries.push((entry.number, entry.side, hex, entry.lacks_checksum));
    }
    (entries, reader, guesses[0].1)
}

const SENT: Option<Side> = Some(Side::Sent);
const RECEIVED: Option<Side> = Some(Side::Received);

/// Labels of requests and responses.
const LABELS: &[[&str; 2]] = &[
    ["Gesendet: ", "Empfangen: "],
    ["\u{53d1}\u{9001}: ", "\u{63a5}\u{6536}: "],
    ["Sent 8 bytes: ", "Received 9 bytes: "],
    ["[modbus] request frame len=8 data=[", "[modbus] response frame len=9 data=["],
    ["TX (8) ", "RX (9) "],
    ["Poll: ", "Got reply ["],
    ["wait 12:00:01 Q ", "wait 12:00:02 A "],
];

#[test]
fn damaged_responses_are_read_by_any_label_that_takes_turns_with_requests() {
    // All responses are damaged: a bit, a byte in front and none at the end, a byte less.
    let responses = ["010304789b34ce05eb", "000103042e220acd84", "01030463d3d8130f", "01030417ec8ff19be6"];
    let requests = ["010300000002c40b", "01030001000295cb", "01030002000265cb", "010300030002340b"];
    for [request, response] in LABELS {
        let turns = requests.iter().zip(responses);
        let lines: Vec<String> = turns.map(|(asked, answer)| format!("{request}{asked}\n{response}{answer}\n")).collect();
        let text = lines.concat();
        let (entries, _, _) = read(&text);
        let found: Vec<_> = entries.iter().map(|(_, side, hex, _)| (*side, hex.as_str())).collect();
        let expected = requests.iter().zip(responses).flat_map(|(asked, answer)| [(SENT, *asked), (RECEIVED, answer)]);
        assert_eq!(found, expected.collect::<Vec<_>>(), "{text}");
    }
}

#[test]
fn values_listed_after_a_response_are_no_frames() {
    let text = "Ask: 01 03 00 00 00 02 C4 0B\nGot: 01 03 04 00 FA 01 2C 5A 4F\nData: 00 FA 01 2C\n";
    let (entries, reader, _) = read(&text.repeat(4));
    assert!(entries.iter().all(|(line, ..)| line % 3 != 0), "{entries:?}");
    assert_eq!((reader.unread_lines().with_hex, reader.unread_lines().hex_bytes), (4, 16));
}

#[test]
fn what_a_person_types_without_checksum_is_no_damaged_copy_of_the_frame() {
    let text = "AT+COMMAND1= 01 03 00 00 00 01,1\nCMD1 = 01 03 00 00 00 01 84 0a\nRETURN1 = 01 03 02 04 00 ba 84\n";
    let (entries, reader, _) = read(text);
    assert_eq!(entries.iter().map(|entry| entry.0).collect::<Vec<_>>(), [2, 3]);
    assert_eq!(reader.unread_lines().with_hex, 1);
}

#[test]
fn exchanges_prove_frames_without_checksums() {
    let text = "Anfrage: 05 03 00 10 00 02\nAntwort: 05 03 04 00 FA 01 2C\nAnfrage: 05 03 00 20 00 01\nAntwort: 05 83 02\n";
    let (entries, _, confidence) = read(text);
    assert!((0.5..1.0).contains(&confidence), "{confidence}");
    assert_eq!(entries.iter().map(|entry| (entry.1, entry.3)).collect::<Vec<_>>(), [(SENT, true), (RECEIVED, true)].repeat(2));
    // Another quantity, another unit, an echo alone: these prove nothing.
    for text in [
        "a: 05 03 00 10 00 03\nb: 05 03 04 00 FA 01 2C\n",
        "a: 05 03 00 10 00 02\nb: 06 03 04 00 FA 01 2C\n",
        "a: 05 06 00 10 00 02\nb: 05 06 00 10 00 02\n",
    ] {
        assert!(read(text).2 < 0.2, "{text}");
    }
}

#[test]
fn a_response_without_its_checksum_is_read_among_others() {
    let text = "Req: 0A 01 04 A1 00 01 AC 63\nResp: 0A 81 02 <no crc>\n";
    assert_eq!(read(text).0, [(1, SENT, "0a0104a10001ac63".to_owned(), false), (2, RECEIVED, "0a8102".to_owned(), true)]);
}

#[test]
fn functions_of_a_vendor_are_read_where_headers_count_on() {
    let frame = |id: u16| format!("send: 0x0 {id:#x} 0x0 0x0 0x0 0x4 0x1 0x41 0x6 0x3\n");
    let text: String = [1, 1, 2, 2, 3, 3].map(frame).concat();
    assert!(read(&text).2 > 0.9);
    assert!(read(&[1, 90, 17, 200].map(frame).concat()).2 < 0.2);
}

#[test]
fn comments_are_read_where_they_hold_frames_and_counted_where_they_hold_other_hex() {
    let (entries, reader, _) = read("# a remark\n// Raw: 01 03 00 0B 00 01 F5 C8\n# dump DE AD BE EF 00 11\n");
    assert_eq!(entries.iter().map(|entry| entry.0).collect::<Vec<_>>(), [2]);
    assert_eq!((reader.unread_lines().count, reader.unread_lines().with_hex), (1, 1));
}

#[test]
fn hex_that_a_dialect_leaves_in_a_line_is_read_or_listed() {
    let sent = "send: 0x36 0xc1 0x0 0x0 0x0 0x6 0x1 0x3 0x99 0x3e 0x0 0x2";
    let received = "recv: 0x36 0xc1 0x0 0x0 0x0 0x7 0x1 0x3 0x4 0x0 0x0 0x0 0x0 extra data: ";
    let (entries, ..) = read(&format!(">>>>> {sent} >>>>> {received}>>>>> {}\n", sent.replace("0xc1", "0xc2")));
    assert_eq!(entries.len(), 3);
    let (_, reader, _) = read(&format!("{received} 0xde 0xad 0xbe 0xef 0x1\n"));
    assert_eq!(reader.skipped().iter().map(|(line, bytes, _)| (*line, bytes.len())).collect::<Vec<_>>(), [(1, 5)]);
}

#[test]
fn a_text_that_is_refused_says_what_hex_it_holds() {
    let guesses = detect(b"hello\nbuffer: 03 04 15 39 43 68\n", "x.log", Dialects::embedded);
    let reason = &guesses[0].2;
    let parts = ["in line 2 the bytes 03 04 15 39 43 68 ", "1 line holds 6 bytes of hex"];
    assert!(parts.iter().all(|part| reason.contains(part)), "{reason}");
}

#[test]
fn an_echo_by_another_word_is_no_printed_copy() {
    let (entries, ..) = read("write <Buffer 01 03 00 5e 00 02 a5 d9>\nresp <Buffer 01 03 00 5e 00 02 a5 d9>\n");
    assert_eq!(entries.iter().map(|entry| entry.1).collect::<Vec<_>>(), [SENT, RECEIVED]);
}

#[test]
fn fields_that_begin_with_their_bytes_are_a_frame() {
    let text = "00 00 Transaction identifier\n00 00 Protocol identifier\n00 03 Length\n01 Unit\n84 Error code 4\n02 Exception\n";
    assert_eq!(read(text).0.iter().map(|entry| entry.2.as_str()).collect::<Vec<_>>(), ["000000000003018402"]);
}
