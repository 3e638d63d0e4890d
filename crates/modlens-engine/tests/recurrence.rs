//! Bytes that recur: what comes again and again is no proof by itself. Constant payloads that hold valid frames, runs of one
//! byte, other protocols.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};

use wire::{frame, good, read_request, read_response, session, MS};

/// How a line is heard: in one read without times, or frame by frame, 20 ms apart, in a recording or live.
#[derive(Clone, Copy, Debug)]
enum Tap {
    Untimed,
    Recorded,
    Live,
}

const TAPS: [Tap; 3] = [Tap::Untimed, Tap::Recorded, Tap::Live];

/// The rows of these frames.
fn heard(tap: Tap, frames: &[Vec<u8>]) -> Batch {
    if matches!(tap, Tap::Untimed) {
        let (mut session, bus) = session(false, Clock::None);
        session.feed(bus, &Chunk { bytes: &frames.concat(), ..Chunk::default() });
        session.flush();
        return session.take();
    }
    let (mut session, bus) = session(matches!(tap, Tap::Live), Clock::Utc);
    let mut now = 1_700_000_000_000_000_000;
    for bytes in frames {
        now += 20 * MS + bytes.len() as i64 * MS / 2;
        session.poll(now - MS);
        session.feed(bus, &Chunk { bytes, times: Times::Read(now), ..Chunk::default() });
    }
    session.poll(now + 5_000 * MS);
    session.flush();
    session.take()
}

/// Sixteen exchanges, from which units 1 and 2 become known.
fn known() -> Vec<Vec<u8>> {
    (0..16u16)
        .flat_map(|i| [read_request(1 + (i % 2) as u8, 100 * i, 2), read_response(1 + (i % 2) as u8, &[i, 7 * i])])
        .collect()
}

/// Frames that a payload may hold: requests and responses of this bus and of another, and a whole exchange.
fn inner() -> Vec<Vec<u8>> {
    vec![
        read_request(1, 0, 10),
        read_request(2, 0, 4),
        read_request(9, 100, 2),
        frame(1, &[6, 0, 1, 0, 3]),
        read_response(1, &[1, 2]),
        [read_request(1, 0, 2), read_response(1, &[0x1234, 0x5678])].concat(),
        [read_request(7, 0, 2), read_response(7, &[0x1234, 0x5678])].concat(),
    ]
}

/// Exchanges whose payload is `inner` between some bytes.
fn outer(inner: &[u8]) -> Vec<(&'static str, Vec<u8>, Vec<u8>)> {
    let mut data = [&[0xA1, 0x52, 0x17, 0x99][..], inner, &[0x31, 0x77]].concat();
    data.resize(data.len().next_multiple_of(2), 0x42);
    let (bytes, registers) = (data.len() as u8, data.len() as u8 / 2);
    let with = |head: &[u8]| frame(1, &[head, &data].concat());
    let file = with(&[21, bytes + 7, 6, 0, 4, 0, 7, 0, registers]);
    let loopback = with(&[8, 0, 0]);
    vec![
        ("write file record", file.clone(), file),
        ("write registers", with(&[16, 0, 1, 0, registers, bytes]), frame(1, &[16, 0, 1, 0, registers])),
        ("loopback", loopback.clone(), loopback),
        ("read registers", frame(1, &[3, 0, 1, 0, registers]), with(&[3, bytes])),
        ("read and write", with(&[23, 0, 1, 0, 1, 0, 9, 0, registers, bytes]), frame(1, &[23, 2, 0, 7])),
    ]
}

#[test]
fn a_frame_inside_a_constant_payload_is_payload() {
    let mut wrong = Vec::new();
    for tap in TAPS {
        for (number, inner) in inner().iter().enumerate() {
            for (name, request, response) in outer(inner) {
                for (warm, ahead) in [("cold", Vec::new()), ("warm", known())] {
                    let mut frames = ahead.clone();
                    for _ in 0..40 {
                        frames.extend([request.clone(), response.clone()]);
                    }
                    let found = good(&heard(tap, &frames));
                    let right = found.iter().filter(|(bytes, _)| *bytes == request || *bytes == response).count();
                    let all = frames.len();
                    if found.len() != all || right + ahead.len() != all {
                        wrong.push(format!("{tap:?} {warm} {name} {number}: {right} of 80, {} frames", found.len()));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn runs_of_one_byte_are_noise() {
    let mut wrong = Vec::new();
    for value in 0..=255u8 {
        for length in [20, 300, 4000] {
            let frames = [known(), vec![vec![value; length]], vec![read_request(1, 0, 2), read_response(1, &[1, 2])]].concat();
            for tap in TAPS {
                let batch = heard(tap, &frames);
                let found = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok && !frame.unconfirmed).count();
                if found != frames.len() - 1 {
                    wrong.push(format!("{tap:?} {value:02x} {length}: {found} of {}", frames.len() - 1));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}

/// A telegram of another protocol that holds `accident`, a valid frame of unit 1.
fn telegram(accident: &[u8]) -> Vec<u8> {
    [&[0x68, 0x10, 0xAA, 0x31, 0x07, 0x5C][..], accident, &[0x2F, 0x90, 0x44, 0x16]].concat()
}

#[test]
fn an_accident_of_the_checksum_that_recurs_is_not_believed_for_that() {
    // A request that is right but never comes; others break a limit or have a wrong length.
    let accidents = [
        frame(1, &[6, 0x33, 0x91, 0x5A, 0x27]),
        frame(1, &[3, 0x33, 0x91, 0x5A, 0x27]),
        frame(1, &[3, 0x33, 0x91, 0x5A, 0x27, 0x1F]),
    ];
    for tap in TAPS {
        for (number, accident) in accidents.iter().enumerate() {
            let mut frames = known();
            for _ in 0..30 {
                frames.extend([telegram(accident), read_request(1, 0, 2), read_response(1, &[0x1234, 0x5678])]);
            }
            let batch = heard(tap, &frames);
            let good = |unconfirmed: bool| {
                batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok && frame.unconfirmed == unconfirmed).count()
            };
            // The first time a right request may be one.
            let firm = good(false) - known().len() - 60;
            assert!(firm <= usize::from(number == 0), "{tap:?} {number}: {firm} firm, {} unconfirmed", good(true));
        }
    }
}

#[test]
fn a_request_behind_the_same_stray_bytes_is_believed_for_its_response() {
    // A driver that takes long to switch: six bytes in front of every frame.
    let strays = [0xFC, 0xFE, 0xF0, 0xE0, 0x80, 0xFE];
    for tap in TAPS {
        let mut frames = known();
        for value in 0..30u16 {
            frames.push([&strays[..], &read_request(1, 40, 2)].concat());
            frames.push([&strays[..], &read_response(1, &[value, 0x5678])].concat());
        }
        let batch = heard(tap, &frames);
        let firm = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok && !frame.unconfirmed).count();
        assert_eq!(firm, frames.len(), "{tap:?}");
    }
}

/// A telegram of another protocol, with a constant payload. Four of them have a valid CRC together, if they are cut before A6 44:
/// a frame of 108 bytes of unit 166 with function 68, which any vendor may have given any length.
const PERIOD: [u8; 27] = [
    0x68, 0x10, 0xAA, 0x13, 0x91, 0xB5, 0xF9, 0xBB, 0x21, 0x17, 0x03, 0xD5, 0x3A, 0xEE, 0x03, 0xC7, 0x5C, 0x6F, 0x2B, 0xB9, 0xF0,
    0x76, 0x2C, 0xA6, 0x44, 0xF8, 0x16,
];

/// The same, of which each one has a valid CRC, cut before 30 6E.
fn period_of_one_frame() -> Vec<u8> {
    let mut period = frame(0x30, &[0x6E, 0x16, 0x68, 0x10, 0xAA, 0x91, 0xB5, 0x21, 0x5A, 0xEE, 0x07]);
    period.rotate_left(3);
    period
}

#[test]
fn a_period_whose_crc_is_valid_by_accident_is_one_accident() {
    let mut wrong = Vec::new();
    for tap in TAPS {
        for (name, ahead) in [("cold", Vec::new()), ("warm", known())] {
            for (number, period) in [PERIOD.to_vec(), period_of_one_frame()].into_iter().enumerate() {
                // Twice with a counter between the telegrams, and thrice without.
                let counted = |round: u8| [&period[..], &[0x68, 0x04, round, 0x16]].concat();
                let spells: Vec<Vec<u8>> = (0..5)
                    .map(|spell| if spell % 2 == 0 { period.repeat(150) } else { (0..150).flat_map(counted).collect() })
                    .collect();
                let frames = [ahead.clone(), vec![spells.concat()]].concat();
                let batch = heard(tap, &frames);
                let good = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok && !frame.unconfirmed).count();
                if good != ahead.len() {
                    wrong.push(format!("{tap:?} {name} {number}: {} firm", good - ahead.len()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}:\n{}", wrong.len(), wrong.join("\n"));
}
