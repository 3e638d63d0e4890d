//! Each byte of hex in a text is read, listed as skipped, or counted as unread, whatever is written around it.

use std::sync::Arc;

use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialects, Reader};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

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

/// A byte string as programs print it.
fn written(hex: &str, notation: usize) -> String {
    let pairs: Vec<&str> = hex.split(' ').collect();
    let values = pairs.iter().map(|pair| u8::from_str_radix(pair, 16).expect("hex"));
    let each = |write: &dyn Fn(&str) -> String| pairs.iter().map(|pair| write(pair)).collect::<Vec<_>>();
    match notation {
        0..4 => hex.to_owned(),
        4 => hex.replace(' ', ""),
        5 => hex.replace(' ', "-"),
        6 => hex.replace(' ', ":").to_lowercase(),
        7 => each(&|pair| format!("0x{pair}")).join(", "),
        8 => values.map(|b| format!("{b:#x}")).collect::<Vec<_>>().join(" "),
        9 => each(&|pair| format!("[{pair}]")).concat(),
        10 => format!("b'{}'", each(&|pair| format!("\\x{}", pair.to_lowercase())).concat()),
        _ => format!("[{}]", values.map(|b| b.to_string()).collect::<Vec<_>>().join(", ")),
    }
}

/// How many bytes of a text were read, skipped or counted.
fn account(text: &str) -> (usize, String) {
    let guesses = detect(text.as_bytes(), "x.log", Dialects::embedded);
    if guesses[0].1 < 0.25 {
        // The refusal has the number.
        let reason = &guesses[0].2;
        let at = reason.rfind(" bytes of hex").unwrap_or(0);
        let number = reason[..at].rsplit(' ').next().and_then(|number| number.parse().ok()).unwrap_or(0);
        return (number, reason.clone());
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
    (read + skipped + unread, format!("{}: read {read}, skipped {skipped}, unread {unread}", guesses[0].0))
}

/// A line, and how many bytes it holds.
fn line() -> impl Strategy<Value = (String, usize)> {
    let part = || (0..FRONTS.len(), 0..FRAMES.len(), 0..BEHINDS.len());
    (part(), part(), 0usize..10, 0usize..12).prop_map(|((front, frame, behind), (other, second, end), how, notation)| {
        let hex = |frame: usize| written(FRAMES[frame], notation);
        let bytes = |frame: usize| FRAMES[frame].split(' ').count();
        let one = format!("{}{}{}", FRONTS[front], hex(frame), BEHINDS[behind]);
        match how {
            0 => (format!("{one} {}{}{}", FRONTS[other], hex(second), BEHINDS[end]), bytes(frame) + bytes(second)),
            1 => {
                let (first, rest) = FRAMES[frame].split_at(12);
                let rest = rest.trim_start();
                let halves = (written(first.trim_end(), notation), written(if rest.is_empty() { "07" } else { rest }, notation));
                // Fewer bytes are numbers.
                let long = if rest.len() >= 11 { bytes(frame) } else { 4 };
                (format!("{}{}\n{}{}", FRONTS[front], halves.0, halves.1, BEHINDS[behind]), long)
            }
            2 => (String::from("read of 2 registers at 16 has failed"), 0),
            _ => (one, bytes(frame)),
        }
    })
}

/// The same texts each time, unless `PROPTEST_RNG_SEED` asks for others.
fn config() -> ProptestConfig {
    let usual = ProptestConfig::default();
    let rng_seed = if usual.rng_seed == RngSeed::Random { RngSeed::Fixed(1) } else { usual.rng_seed };
    ProptestConfig { cases: 400, failure_persistence: None, rng_seed, ..usual }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn bytes_are_read_or_counted(lines in prop::collection::vec(line(), 1..8)) {
        let held: usize = lines.iter().map(|(_, bytes)| bytes).sum();
        let text: String = lines.into_iter().map(|(line, _)| line + "\n").collect();
        let (known, how) = account(&text);
        prop_assert!(known >= held, "{known} of {held} bytes: {how}\n{text}");
    }
}
