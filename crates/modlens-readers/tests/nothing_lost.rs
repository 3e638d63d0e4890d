//! Each byte of hex in a text is read, listed as skipped, or counted as unread, whatever is written around it.

use std::sync::Arc;

use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialects, Reader};
use proptest::prelude::*;

/// A request and a response of unit 7, a response of unit 1 as Modbus/TCP, a damaged request, the beginning of a response.
const FRAMES: [&str; 6] = [
    "07 03 00 10 00 01 85 A9",
    "07 03 02 01 2C 30 09",
    "00 01 00 00 00 05 01 03 02 12 34",
    "07 03 00 10 00 01 85 A8",
    "07 03 14 00 64 00 65 00",
    "07 83 02 61 31",
];

/// What may be in front of bytes, and after them.
const FRONTS: [&str; 22] = [
    "",
    "TX: ",
    "RX: ",
    "sent (8): ",
    "Gesendet: ",
    "-> ",
    "<- ",
    "[12:30:05.250] ",
    "12:30:05 answer ",
    "// ",
    "# got ",
    "/* ",
    "* D (123) mb: rx ",
    "data = \"",
    "uint8_t reply[] = {",
    "the meter then sends ",
    "[I] foo: TX(8) -> ",
    "> ",
    "  | ",
    "0000: ",
    "x[3]=",
    "logs << \"[10:00:05] RX: ",
];
const BEHINDS: [&str; 12] =
    ["", " // good", "  |........|", " (8 bytes)", "\";", " };", " ...", ", crc wrong", "]", " */", " = 300 V", " | ok"];

/// How many bytes are in runs of at least four pairs of digits with a blank between them.
fn pairs(line: &str) -> usize {
    let (mut all, mut run) = (0, 0);
    for word in line.split([' ', '"', '{', '|', '=', ';', '(', ')', ',']).chain([""]) {
        if word.len() == 2 && word.bytes().all(|b| b.is_ascii_hexdigit()) {
            run += 1;
        } else {
            all += if run >= 4 { run } else { 0 };
            run = 0;
        }
    }
    all
}

/// How many bytes of hex a text holds, and how many of them were read, skipped or counted.
fn account(text: &str) -> (usize, usize, String) {
    let held = text.lines().map(pairs).sum();
    let guesses = detect(text.as_bytes(), "x.log", Dialects::embedded);
    if guesses[0].1 < 0.25 {
        // The refusal has the number.
        let reason = &guesses[0].2;
        let at = reason.rfind(" bytes of hex").unwrap_or(0);
        let number = reason[..at].rsplit(' ').next().and_then(|number| number.parse().ok()).unwrap_or(0);
        return (held, number, reason.clone());
    }
    let table = Arc::new(Dialects::embedded().clone());
    let mut reader = Reader::new(table.named(&guesses[0].0).expect("a text"), Some(table), Arc::default());
    reader.look_ahead(text.as_bytes());
    reader.push(text.as_bytes());
    let mut read = 0;
    while let Some((_, bytes)) = reader.next(true) {
        read += bytes.len();
    }
    let skipped: usize = reader.skipped().iter().map(|(_, bytes, _)| bytes.len()).sum();
    let unread = reader.unread_lines().hex_bytes as usize;
    (held, read + skipped + unread, format!("{}: read {read}, skipped {skipped}, unread {unread}", guesses[0].0))
}

fn line() -> impl Strategy<Value = String> {
    let part = || (0..FRONTS.len(), 0..FRAMES.len(), 0..BEHINDS.len());
    (part(), part(), 0usize..10).prop_map(|((front, frame, behind), (other, second, end), how)| {
        let one = format!("{}{}{}", FRONTS[front], FRAMES[frame], BEHINDS[behind]);
        match how {
            0 => format!("{one} {}{}{}", FRONTS[other], FRAMES[second], BEHINDS[end]),
            1 => format!("{}{}\n{}{}", FRONTS[front], &FRAMES[frame][..8], &FRAMES[frame][9..], BEHINDS[behind]),
            2 => String::from("read of 2 registers at 16 has failed"),
            _ => one,
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn bytes_are_read_or_counted(lines in prop::collection::vec(line(), 1..8)) {
        let text = lines.join("\n") + "\n";
        let (held, known, how) = account(&text);
        prop_assert!(known >= held, "{known} of {held} bytes: {how}\n{text}");
    }
}

#[test]
#[ignore = "for texts of others"]
fn texts_are_read_or_counted() {
    for file in std::env::args().skip_while(|arg| arg != "--").skip(1) {
        let text = std::fs::read(&file).expect("a file");
        let (held, known, how) = account(&String::from_utf8_lossy(&text));
        if known < held {
            println!("{file}: {known} of {held}: {how}");
        }
    }
}
