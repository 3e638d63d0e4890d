//! Every row of the table of dialects: its sample is read as the row says, and is detected as itself.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::detect::detect;
use modlens_readers::text::{Dialect, Dialects, Reader};

type Strings = Vec<(Option<Side>, Vec<u8>)>;

/// The byte strings of a text, pieces of one joined.
fn read(rows: Vec<Arc<Dialect>>, text: &str, piece: usize) -> (Strings, u64) {
    let mut reader = Reader::new(rows, None, Arc::default());
    let mut strings: Strings = Vec::new();
    let mut take = |reader: &mut Reader, last| {
        while let Some((record, bytes)) = reader.next(last) {
            let side = record.side;
            match strings.last_mut() {
                Some((last, string)) if !record.starts_record && *last == side => string.extend_from_slice(bytes),
                _ => strings.push((side, bytes.to_vec())),
            }
        }
    };
    for part in text.as_bytes().chunks(piece) {
        reader.push(part);
        take(&mut reader, false);
    }
    take(&mut reader, true);
    (strings, reader.unread_lines().count)
}

/// Pieces that the row lists one by one are one string here.
fn expected(row: &Dialect) -> Strings {
    if row.name != "strace" {
        return row.bytes.clone();
    }
    let joined = [&row.bytes[1].1[..], &row.bytes[2].1].concat();
    vec![row.bytes[0].clone(), (row.bytes[1].0, joined)]
}

#[test]
fn each_sample_gives_its_bytes() {
    for row in Dialects::embedded().rows() {
        for piece in [1, 7, 100_000] {
            let (strings, unparsed) = read(vec![Arc::clone(row)], row.sample.trim_start_matches('\n'), piece);
            assert_eq!(strings, expected(row), "{}", row.name);
            assert!(unparsed == 0 || row.name == "node-modbus-serial", "{}: {unparsed} lines not understood", row.name);
        }
    }
}

#[test]
fn each_sample_is_detected_as_itself() {
    for row in Dialects::embedded().rows() {
        let alone = detect(row.sample.as_bytes(), "x.log", Dialects::embedded);
        assert_eq!(alone[0].0, row.name, "alone: {alone:?}");
        let chatter =
            |n: u32| format!("2026-11-21 12:30:{:02} INFO worker {n} of pool: cache holds {} of 4096 entries\n", n % 60, n * 7);
        let before: String = (0..100).map(chatter).collect();
        let after: String = (100..200).map(chatter).collect();
        let among = format!("{before}{}\n{after}", row.sample.trim_matches('\n'));
        let among = detect(among.as_bytes(), "x.log", Dialects::embedded);
        assert_eq!(among[0].0, row.name, "among other lines: {among:?}");
    }
}

/// Rows with records of several lines that checksums or headers prove.
const SEVERAL_LINES: [&str; 8] =
    ["text2pcap", "tcpdump", "socat", "jpnevulator", "eltima", "serialtool", "epics", "node-modbus-serial"];

#[test]
fn a_dialect_may_begin_anywhere() {
    let table = Arc::new(Dialects::default());
    for name in SEVERAL_LINES {
        let row = table.get(name).expect("a row");
        let mut reader =
            Reader::new(vec![Arc::clone(table.get("hex").expect("a row"))], Some(Arc::clone(&table)), Arc::default());
        let chatter = "a line of the program that holds nothing\n".repeat(2000);
        reader.push(format!("05 03 00 10 00 02 C4 4A\n{chatter}{}\n", row.sample.trim_matches('\n')).as_bytes());
        let mut strings: Strings = Vec::new();
        while let Some((record, bytes)) = reader.next(true) {
            strings.push((record.side, bytes.to_vec()));
        }
        assert_eq!(strings[1..], row.bytes[..], "{name}");
        assert!(reader.unread_lines().count <= 2001, "{name}: {}", reader.unread_lines().count);
    }
}

#[test]
fn the_marks_for_repeated_lines_of_a_dump_are_bounded_together() {
    let line = |at: u32| {
        let offset = at << 20;
        format!("{offset:08x}  01 03 00 00 00 0a c5 cd  01 03 00 00 00 0a c5 cd  |................|\n*\n")
    };
    let text = (0..40).map(line).collect::<Vec<_>>().concat();
    let mut reader = Reader::new(Dialects::embedded().named("hexdump").unwrap(), None, Arc::default());
    reader.push(text.as_bytes());
    let (mut bytes, mut losses) = (0, 0);
    while let Some((entry, data)) = reader.next(true) {
        bytes += data.len();
        losses += usize::from(entry.follows_loss);
    }
    assert!(bytes < 5 << 20, "{bytes} bytes of {} characters", text.len());
    assert_eq!(losses, 39 - 4);
}
