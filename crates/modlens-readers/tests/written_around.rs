//! What people and programs write around the bytes of a log: sentences that quote frames, times on lines of their own, colours
//! whose escape character is written out, shell commands, the rest of an earlier read.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialects, Reader};

/// A request of register 16 of unit 7, and its response; another program computed the CRCs.
const REQUEST: &str = "07 03 00 10 00 01 85 A9";
const RESPONSE: &str = "07 03 02 01 2C 30 09";

/// An entry of a log: its time in ns, who sent it, and its bytes.
type Entry = (Option<i64>, Option<Side>, Vec<u8>);

/// What is read of a text, the reasons for what is not, and the bytes of hex in lines that nothing reads.
fn read(text: &str) -> (Vec<Entry>, Vec<&'static str>, u64) {
    let guesses = detect(text.as_bytes(), "x.log", Dialects::embedded);
    let table = Arc::new(Dialects::default());
    let mut reader = Reader::new(table.named(&guesses[0].0).expect("a text"), Some(table), Arc::default());
    reader.look_ahead(text.as_bytes());
    reader.push(text.as_bytes());
    let mut entries = Vec::new();
    while let Some((entry, bytes)) = reader.next(true) {
        entries.push((entry.time, entry.side, bytes.to_vec()));
    }
    let skipped = reader.skipped().iter().map(|(_, _, reason)| *reason).collect();
    (entries, skipped, reader.unread_lines().hex_bytes)
}

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|pair| u8::from_str_radix(pair, 16).expect("hex")).collect()
}

fn frames(text: &str) -> Vec<Vec<u8>> {
    read(text).0.into_iter().map(|(.., bytes)| bytes).collect()
}

#[test]
fn a_sentence_that_quotes_a_frame_repeats_nothing() {
    let text = format!(
        "PC asks: {REQUEST}\nmeter answers: {RESPONSE}\n\
         Can it be that the second one ({RESPONSE}) is the answer to an earlier question of mine?\n\
         I also see its first bytes `07 03 02 01` alone when the cable is too long for the adapter\n"
    );
    assert_eq!(frames(&text), [bytes(REQUEST), bytes(RESPONSE)]);
}

#[test]
fn a_program_that_prints_long_lines_may_poll_the_same_frame_again() {
    let line = |number: u32| {
        format!("12:30:{number:02} worker asks the meter on this line for its values now with {REQUEST} and then waits for it\n")
    };
    assert_eq!(frames(&(line(1) + &line(2) + &line(3))), vec![bytes(REQUEST); 3]);
}

#[test]
fn a_time_on_a_line_of_its_own_is_that_of_the_bytes_below() {
    let block = |time: &str, hex: &str| format!("Timestamp : 2026-11-21 12:30:{time}\nRaw frame : {hex}\n\n");
    let (entries, ..) = read(&(block("05,250", REQUEST) + &block("05,270", RESPONSE)));
    let times: Vec<i64> = entries.iter().filter_map(|(time, ..)| *time).collect();
    assert_eq!((entries.len(), times.len()), (2, 2));
    assert_eq!(times[1] - times[0], 20_000_000);
}

#[test]
fn a_shell_command_is_no_frame_although_a_frame_follows_it() {
    let run = |register: &str| {
        format!("user@host:~/at-cmd$ ./read -xmb {register}0001\n2026/11/21 12:30:05 +ok={}\n", RESPONSE.replace(' ', ""))
    };
    let (entries, _, hex_bytes) = read(&(run("0010") + &run("0020") + &run("0030")));
    assert_eq!(entries.into_iter().map(|(.., bytes)| bytes).collect::<Vec<_>>(), vec![bytes(RESPONSE); 3]);
    assert_eq!(hex_bytes, 12);
}

#[test]
fn a_named_line_that_begins_as_a_proven_frame_is_read_although_it_is_damaged() {
    let text = format!(
        "If I send this to the meter : {REQUEST}\nI expect to receive : {RESPONSE}\nI am receiving : 07 03 02 FF 2C 30 09\n"
    );
    let (entries, ..) = read(&text);
    assert_eq!(entries[2], (None, Some(Side::Received), bytes("07 03 02 FF 2C 30 09")));
}

#[test]
fn what_was_left_of_an_earlier_read_counts_once() {
    let hex = |hex: &str| bytes(hex).iter().map(|b| format!("{b:#x}")).collect::<Vec<_>>().join(" ");
    let (old, new) = (hex(REQUEST), hex("08 03 00 10 00 01 85 56"));
    let text = format!(
        "2026-11-21 12:30:05,250 DEBUG transport:329 recv: {new} old_data: {old} addr=None\n\
         2026-11-21 12:30:05,250 DEBUG base:91 Processing: {old} {new}\n"
    );
    let (entries, skipped, _) = read(&text);
    assert_eq!(entries.len(), 2, "{entries:?}");
    assert_eq!(skipped.len(), 1);
}

#[test]
fn two_lines_of_a_program_for_each_frame_are_one_frame() {
    let hex = bytes(REQUEST).iter().map(|b| format!("{b:#x}")).collect::<Vec<_>>().join(" ");
    let both = |second: u32| {
        format!(
            "2026-11-21 12:30:{second:02} DEBUG: Handling data: {hex}\n2026-11-21 12:30:{second:02} DEBUG: Processing: {hex}\n"
        )
    };
    assert_eq!(frames(&(both(1) + &both(3) + &both(5))), vec![bytes(REQUEST); 3]);
}

#[test]
fn the_name_of_a_container_is_no_hex() {
    let text = format!("Nov 21 12:30:05 host be7606b67c2f[691]: #033[36m2026-11-21 12:30:05.250 DEBUG send: {REQUEST}#033[0m\n");
    let (entries, skipped, _) = read(&text);
    assert_eq!(entries.len(), 1);
    assert_eq!(skipped, [""; 0]);
}

#[test]
fn a_command_that_the_next_line_repeats_as_sent_counts_once() {
    let text = format!("/proto.send {REQUEST}\n  TX: {REQUEST}\n  RX: {RESPONSE}\n  (7 bytes, 12ms)\n");
    let (entries, ..) = read(&text);
    let sides: Vec<_> = entries.iter().map(|(_, side, _)| *side).collect();
    assert_eq!(sides, [Some(Side::Sent), Some(Side::Received)]);
}

#[test]
fn the_rest_of_a_frame_may_stand_in_the_next_comment() {
    // Three registers, with the CRC of another program.
    let text = "//received: 07 03 06 00 01 00\n//02 00 03 D6 D4\n";
    let whole = read(text).0.into_iter().flat_map(|(.., bytes)| bytes).collect::<Vec<_>>();
    assert_eq!(whole, bytes("07 03 06 00 01 00 02 00 03 D6 D4"));
}

#[test]
fn a_frame_of_ascii_may_have_a_blank_in_front_of_its_lrc() {
    // 01 + 06 + 05 + A1 + A1 = 1 4E, of which B2 is the complement.
    assert_eq!(frames("2026-11-21 12:30:05 send \":01060005A1A1 B2\\r\\n\"\n"), [b":01060005A1A1B2\r\n".to_vec()]);
}

#[test]
fn an_hour_may_have_one_digit() {
    let (entries, ..) = read(&format!("66\t9:25:13\ttool.exe\tTX {REQUEST}\n67\t9:25:14\ttool.exe\tRX {RESPONSE}\n"));
    let times: Vec<i64> = entries.iter().filter_map(|(time, ..)| *time).collect();
    assert_eq!(times[1] - times[0], 1_000_000_000);
}

#[test]
fn the_hour_in_a_string_is_no_byte() {
    let (entries, ..) =
        read(&format!("    logs << \"[10:00:05] TX: {REQUEST}\";\n    logs << \"[10:00:06] RX: 07 03 14 00 64 00...\";\n"));
    assert_eq!(entries.iter().map(|(.., bytes)| bytes.clone()).collect::<Vec<_>>(), [bytes(REQUEST), bytes("07 03 14 00 64 00")]);
    assert!(entries.iter().all(|(time, ..)| time.is_some()));
}

#[test]
fn a_request_without_data_is_proved_by_its_header() {
    // Report Server ID (application protocol, 6.13).
    assert_eq!(
        frames("00000000  00 00 00 00 00 02 01 11                            ........\n"),
        [bytes("00 00 00 00 00 02 01 11")]
    );
}

#[test]
fn the_fields_of_a_frame_below_it_repeat_it() {
    let fields = "Address : 07\nFunction : 03\nRegister : 0010\nNumber : 0001\nChecksum : 85A9\n";
    let text = format!("I am receiving wrong data from it.\nI send this to the meter : {}\n{fields}", REQUEST.replace(' ', ""));
    let (entries, skipped, _) = read(&text);
    assert_eq!((entries.len(), skipped.len()), (1, 1), "{entries:?}");
}

#[test]
fn a_few_bytes_in_front_of_the_time_since_the_last_line_are_counted() {
    let text = format!("x send <Buffer {}> +0ms\nx payload <Buffer 83 02> +2ms\n", REQUEST.to_lowercase());
    assert_eq!(read(&text).2, 2);
}

#[test]
fn the_offset_of_a_dump_is_no_byte() {
    let text = format!("00000000  {REQUEST}  {RESPONSE} 07  |........,0..|\n00000010  03 00 10 00 01 85 A9\n");
    let (entries, skipped, hex_bytes) = read(&text);
    assert_eq!(entries.iter().map(|(.., bytes)| bytes.len()).sum::<usize>(), 23);
    assert_eq!((skipped, hex_bytes), (Vec::new(), 0));
}

#[test]
fn frames_in_base64_are_read_among_words_and_in_quotes() {
    // The request and the response, encoded by another program.
    let text = "12:30:05 up payload BwMAEAABhak=\n12:30:06 down {\"data\": \"BwMCASwwCQ==\"}\nthe PasswordHash= and \"CamelCaseName\" are words\n";
    assert_eq!(frames(text), [bytes(REQUEST), bytes(RESPONSE)]);
}

#[test]
fn binary_digits_are_read_once() {
    let text = "request 00000111 00000011 00000000 00010000 00000000 00000001 10000101 10101001\nresponse 00000111 00000011 00000010 00000001 00101100 00110000 00001001\n";
    let (entries, skipped, unread) = read(text);
    assert_eq!(entries.into_iter().map(|(.., bytes)| bytes).collect::<Vec<_>>(), [bytes(REQUEST), bytes(RESPONSE)]);
    assert_eq!((skipped, unread), (Vec::new(), 0));
}

#[test]
fn what_a_sentence_expects_instead_of_a_frame_in_it_was_never_on_the_line() {
    for text in [
        format!("the meter answers with {RESPONSE} but I expected 07 83 02 61 31 or so\n"),
        format!("I get `{RESPONSE}`, it should be `07 83 02 61 31`\n"),
    ] {
        assert_eq!(frames(&text), [bytes(RESPONSE)], "{text}");
    }
}

#[test]
fn pairs_of_digits_that_nothing_proves_look_like_hex() {
    let guesses = detect(b"01 03 00 05 00 01\n", "x.log", Dialects::embedded);
    assert_eq!((guesses[0].0.as_str(), guesses[0].1 < 0.25), ("hex", true));
}

#[test]
fn a_label_may_be_followed_by_what_it_is_about() {
    // The echo of a write is the same bytes in both directions, so that the labels alone say who sent them.
    for (asks, answers) in [
        ("// Request: it writes one of the coils and then waits for the unit", "// Response"),
        ("# Anfrage: schreibt eine der Spulen und wartet dann auf das Ger\u{e4}t", "# Antwort"),
        (
            "// \u{8bf7}\u{6c42}: \u{5199}\u{5165} 1 \u{4e2a}\u{5bc4}\u{5b58}\u{5668} (0xFF00 = 1, 0x0000 = 0)",
            "// \u{54cd}\u{5e94}",
        ),
    ] {
        let text = format!("{asks}\n00 05 00 00 00 06 07 05 00 04 FF 00\n{answers}\n00 05 00 00 00 06 07 05 00 04 FF 00\n");
        let sides: Vec<_> = read(&text).0.into_iter().map(|(_, side, _)| side).collect();
        assert_eq!(sides, [Some(Side::Sent), Some(Side::Received)], "{asks}");
    }
}

#[test]
fn rtu_and_ascii_in_one_line_are_both_read() {
    // 07 + 03 + 02 + 01 + 2C = 39, of which C7 is the complement.
    let line = "reply = ascii ? \":070302012CC7\\r\\n\" : fromHex(\"0703 0201 2C30 09\");\n";
    let found = frames(&line.replace("0703 0201 2C30 09", "070302012C3009"));
    assert_eq!(found, [b":070302012CC7\r\n".to_vec(), bytes(RESPONSE)]);
}

#[test]
fn two_strings_in_a_line_are_both_read_although_the_first_is_all_escaped() {
    // The 2C of the response is a comma, its 30 a zero, and its 09 a tab.
    let line = r"answers['\x07\x03\x00\x10\x00\x01\x85\xa9'] = '\x07\x03\x02\x01,0\t'";
    assert_eq!(frames(&format!("{line}\n")), [bytes(REQUEST), bytes(RESPONSE)]);
}

#[test]
fn a_frame_may_be_listed_with_remarks_and_its_data_without() {
    let text =
        "answer:\n07 \tunit\n03 \tfunction\n06 \t\u{5b57}\u{8282}\u{6570}\n00 01 00\n02 00 03\nD6 D4\tCRC\u{6821}\u{9a8c}\n";
    assert_eq!(frames(text).concat(), bytes("07 03 06 00 01 00 02 00 03 D6 D4"));
}

#[test]
fn the_rest_of_a_frame_may_stand_after_another_call() {
    let text = format!(
        "uart_write(port, req, 8, 100)  sent: {REQUEST}\nled_off()  ok\nuart_read(port, buf, 3, 200)  got: 07 03 06\n\
         length_of(req, 8)  9\nuart_read(port, buf+3, 8, 200)  got: 00 01 00 02 00 03 D6 D4\n"
    );
    assert_eq!(frames(&text).concat(), [bytes(REQUEST), bytes("07 03 06 00 01 00 02 00 03 D6 D4")].concat());
}

#[test]
fn a_byte_in_two_notations_a_line_is_one_byte() {
    let line = |byte: u8| format!("[D][bus:042]: got byte {byte} (0X{byte:x})\n");
    let listed: String = bytes(RESPONSE).into_iter().map(line).collect();
    assert_eq!(frames(&listed).concat(), bytes(RESPONSE));
    let cut: String = bytes(RESPONSE)[1..].iter().map(|byte| line(*byte)).collect();
    let (_, _, unread) = read(&format!("sent: {REQUEST}\n\n{cut}"));
    assert_eq!(unread, 6, "what no checksum proves is counted");
}

#[test]
fn two_lists_of_numbers_in_a_line_are_both_counted() {
    let text = format!("sent: {REQUEST}\nno match: 7, 3, 6, 0, 1, 0, 2, 0, 3 != 7, 3, 6, 6, 0, 1, 0, 2, 0, 3\n");
    assert_eq!(read(&text).2, 19);
}
