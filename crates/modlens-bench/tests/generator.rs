//! The generator: the same on every run and platform, and its truth is true.

use modlens_bench::model::{Direction, Framing, Label};
use modlens_bench::sim::case::{Case, Traffic};
use modlens_bench::sim::output::{write_chunk_log, write_truth};
use modlens_bench::sim::scenario::Scenario;
use modlens_bench::sim::tap::TapMode;
use modlens_bench::sim::truth::TruthFrame;

fn traffic(name: &str, seed: u64, frames: usize) -> Traffic {
    Traffic::new(Scenario::named(name).unwrap(), seed, frames)
}

/// The CRC of the specification, bit by bit (serial line specification, 6.2.2).
fn naive_crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte), |crc, _| if crc & 1 == 1 { (crc >> 1) ^ 0xA001 } else { crc >> 1 })
    })
}

/// FNV-1a: enough to see that something changed.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xCBF2_9CE4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

fn bytes_of<'a>(case: &'a Case, frame: &TruthFrame) -> &'a [u8] {
    &case.bytes(frame.line)[frame.start as usize..frame.end as usize]
}

#[test]
fn the_same_seed_gives_the_same_recording() {
    for scenario in Scenario::all() {
        let log = |seed| {
            let mut text = Vec::new();
            let case = Traffic::new(scenario, seed, 150).tap(TapMode::Tcp);
            write_chunk_log(&case, &mut text).unwrap();
            write_truth(&case, &mut text).unwrap();
            text
        };
        assert_eq!(log(4), log(4), "{}", scenario.name);
        assert_ne!(log(4), log(5), "{}", scenario.name);
    }
}

/// If these change, figures of earlier versions can no longer be compared: change them on purpose only.
#[test]
fn recordings_of_earlier_versions_stay_as_they_are() {
    let hashes = ["clean", "hostile", "ascii_field", "lines_field"].map(|name| {
        let case = traffic(name, 1, 300).tap(TapMode::Ftdi16);
        let mut text = Vec::new();
        write_chunk_log(&case, &mut text).unwrap();
        format!("{name} {:016x}", hash(&text))
    });
    assert_eq!(hashes, HASHES);
}

const HASHES: [&str; 4] =
    ["clean a7161d7d19960fdc", "hostile 8bea1033eaa286bb", "ascii_field 3cf11d0dd8eaf5bd", "lines_field 5c49b5778f3996e4"];

#[test]
fn all_taps_deliver_the_same_bytes() {
    for name in ["field", "lines_field", "ascii_field"] {
        let traffic = traffic(name, 2, 400);
        for mode in TapMode::ALL {
            let case = traffic.tap(mode);
            for (line, heard) in traffic.lines.iter().zip(&case.lines) {
                assert_eq!(line.bytes, heard.bytes);
                let fed: Vec<u8> =
                    case.timed_reads().filter(|feed| feed.line == line.id).flat_map(|feed| feed.bytes.to_vec()).collect();
                assert_eq!(fed, line.bytes);
            }
            let orders: Vec<Option<i64>> = case.timed_reads().map(|feed| feed.time).collect();
            assert!(orders.windows(2).all(|pair| pair[0] <= pair[1]), "{name} {mode:?}");
        }
    }
}

#[test]
fn valid_frames_have_their_checksum_and_their_header() {
    for scenario in Scenario::all() {
        let case = Traffic::new(scenario, 3, 600).tap(TapMode::None);
        let mut valid = 0;
        for frame in case.truth.iter().filter(|frame| frame.valid) {
            let bytes = bytes_of(&case, frame);
            valid += 1;
            if scenario.framing == Framing::Rtu {
                assert_eq!(naive_crc(bytes), 0, "{} {frame:?}", scenario.name);
                assert!((4..=256).contains(&bytes.len()), "{} {}", scenario.name, bytes.len());
                assert_eq!((bytes[0], bytes[1] & 0x7F, bytes[1] > 0x7F), (frame.unit, frame.function, frame.exception));
            } else {
                let text = std::str::from_utf8(bytes).unwrap();
                let digits = text.strip_prefix(':').and_then(|text| text.strip_suffix("\r\n")).unwrap();
                let body: Vec<u8> =
                    (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect();
                assert_eq!(body.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte)), 0);
                assert_eq!((body[0], body[1] & 0x7F), (frame.unit, frame.function));
            }
        }
        // A tap that hears one side only gets half of the 600 frames.
        let least = if scenario.only.is_some() { 200 } else { 300 };
        assert!(valid > least, "{}: {valid}", scenario.name);
    }
}

#[test]
fn frames_stand_one_behind_the_other() {
    for scenario in Scenario::all() {
        let case = Traffic::new(scenario, 6, 500).tap(TapMode::None);
        for line in &case.lines {
            let mut end = 0;
            for frame in case.truth.iter().filter(|frame| frame.line == line.id) {
                assert!(frame.start >= end && frame.end > frame.start, "{} {frame:?}", scenario.name);
                end = frame.end;
            }
            assert!(end <= line.bytes.len() as u64);
        }
    }
}

#[test]
fn damaged_frames_are_called_damaged() {
    for name in ["bitflip", "drop", "truncate", "collide", "overrun", "hostile"] {
        let case = traffic(name, 7, 1500).tap(TapMode::None);
        let damaged: Vec<_> = case.truth.iter().filter(|frame| !frame.valid).collect();
        assert!(damaged.len() > 20, "{name}");
        // A damaged frame is right by chance only: one in 65536, or a truncated last byte of 00.
        let right = damaged.iter().filter(|frame| naive_crc(bytes_of(&case, frame)) == 0).count();
        assert!(right <= 2, "{name}: {right} of {}", damaged.len());
    }
}

#[test]
fn transactions_and_labels_hang_together() {
    let case = traffic("faults", 8, 3000).tap(TapMode::None);
    let requests: Vec<_> = case.truth.iter().filter(|frame| frame.direction == Direction::Request).collect();
    for pair in requests.windows(2) {
        assert!(pair[0].txn < pair[1].txn);
        if pair[1].labels.contains(Label::Retry) {
            assert_eq!(bytes_of(&case, pair[0]), bytes_of(&case, pair[1]));
        }
    }
    for frame in &case.truth {
        let asked = requests.iter().find(|request| request.txn == frame.txn);
        if let (Some(asked), Direction::Response, true) = (asked, frame.direction, frame.valid) {
            let same = asked.unit == frame.unit;
            assert_eq!(same, !(frame.labels.contains(Label::WrongUnit) || frame.allowed_labels.contains(Label::WrongUnit)));
        }
        let answered = || case.truth.iter().any(|other| other.txn == frame.txn && other.direction == Direction::Response);
        if frame.labels.contains(Label::NoResponse) {
            assert!(frame.direction == Direction::Request && !answered());
        }
    }
    for label in Label::ALL.into_iter().filter(|&label| label != Label::Echo) {
        assert!(case.truth.iter().any(|frame| frame.labels.contains(label)), "{label:?}");
    }
}

#[test]
fn files_are_what_decode_reads() {
    let case = traffic("lines_field", 9, 60).tap(TapMode::Exact);
    let (mut log, mut truth) = (Vec::new(), Vec::new());
    write_chunk_log(&case, &mut log).unwrap();
    write_truth(&case, &mut truth).unwrap();
    let (log, truth) = (String::from_utf8(log).unwrap(), String::from_utf8(truth).unwrap());
    assert!(log.lines().all(|row| row.starts_with(r#"{"t": "#) && row.ends_with(r#""}"#) && row.contains(r#""hex": ""#)));
    assert!(log.contains(r#""line": "A""#) && log.contains(r#""line": "B""#));
    assert_eq!(truth.lines().count(), case.truth.len());
    assert!(truth.lines().all(|row| row.starts_with(r#"{"start": "#) && row.ends_with('}')));
}
