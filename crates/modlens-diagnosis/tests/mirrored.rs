//! Registers that pass 0, units that refuse all from one moment on, and waits that are no timeout.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use serde_json::Value as Json;

const MS: i64 = 1_000_000;
const START: i64 = 1_700_000_000_000 * MS;

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// A read of `quantity` registers from 0 on, of unit 1.
fn read(function: u8, address: u8, quantity: u8) -> Vec<u8> {
    framed(&[1, function, 0, address, 0, quantity])
}

fn answer(function: u8, values: &[u16]) -> Vec<u8> {
    let bytes = values.iter().flat_map(|value| value.to_be_bytes());
    framed(&[vec![1, function, 2 * values.len() as u8], bytes.collect()].concat())
}

/// What the doctor reports about frames at times in milliseconds.
fn judged(frames: impl IntoIterator<Item = (i64, Vec<u8>)>) -> Json {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    for (at, bytes) in frames {
        session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(START + at * MS), ..Chunk::default() });
    }
    session.flush();
    let mut contrast = Contrast::default();
    contrast.observe(&session.take());
    Report::of(contrast).json()
}

fn codes(found: &Json) -> Vec<&str> {
    found["diagnoses"].as_array().unwrap().iter().filter_map(|row| row["code"].as_str()).collect()
}

/// A device with the same signed register under function 3 and 4, which is at `value(poll)`.
fn mirrored(value: impl Fn(i64) -> u16) -> Vec<(i64, Vec<u8>)> {
    (0..150)
        .flat_map(|poll| {
            let [long, short] = [vec![value(poll), 22, 42, 54], vec![value(poll), 22]];
            [
                (poll * 200, read(3, 0, 4)),
                (poll * 200 + 20, answer(3, &long)),
                (poll * 200 + 100, read(4, 0, 2)),
                (poll * 200 + 120, answer(4, &short)),
            ]
        })
        .collect()
}

#[test]
fn a_signed_register_that_passes_0_has_not_jumped() {
    // 2, 1, 0, -1, -2 in words of 16 bits, back and forth.
    let slow = |poll: i64| (4 - (poll % 18 - 9).abs()) as u16;
    assert_eq!(codes(&judged(mirrored(slow))), Vec::<&str>::new());
}

#[test]
fn a_single_signed_register_is_minus_1_for_once() {
    let frames = (0..150).flat_map(|poll| {
        let value = if poll == 77 { 0xFFFF } else { (poll % 3) as u16 };
        [(poll * 200, read(3, 0, 1)), (poll * 200 + 20, answer(3, &[value]))]
    });
    assert_eq!(codes(&judged(frames)), Vec::<&str>::new());
    let far = (0..150).flat_map(|poll| {
        let value = if poll == 77 { 0xFFFF } else { 5000 + (poll % 3) as u16 };
        [(poll * 200, read(3, 0, 1)), (poll * 200 + 20, answer(3, &[value]))]
    });
    assert_eq!(codes(&judged(far)), ["value_spike"]);
}

#[test]
fn a_unit_that_refuses_all_from_a_moment_on_has_one_cause() {
    let frames = (0..100).flat_map(|poll| {
        let answers = match poll {
            0..40 => [answer(3, &[7, 8]), answer(4, &[9])],
            _ => [framed(&[1, 0x83, 2]), framed(&[1, 0x84, 2])],
        };
        let [first, second] = answers;
        let at = poll * 200;
        [(at, read(3, 0, 2)), (at + 20, first), (at + 100, read(4, 90, 1)), (at + 120, second)]
    });
    let found = judged(frames);
    assert_eq!(codes(&found), ["register_hole"]);
    // Poll 40 is read at its end, 8 s after 22:13:20; its 8 characters of 11 bits began 4.6 ms before.
    assert_eq!(
        found["diagnoses"][0]["sentence"],
        "All that was asked for (addresses 0 to 1, address 90) no longer exists in unit 1: 120 of 200 requests were refused since \
         2023-11-14 22:13:27 UTC."
    );
}

/// Polls every 200 ms, of which some get no answer; the next request comes `waited` ms later.
fn silent_polls(waited: i64) -> Vec<(i64, Vec<u8>)> {
    let (mut at, mut frames) = (0, Vec::new());
    for poll in 0..100 {
        frames.push((at, read(3, 0, 1)));
        if poll % 10 == 9 {
            at += waited;
            continue;
        }
        frames.push((at + 20, answer(3, &[5])));
        at += 200;
    }
    frames
}

#[test]
fn a_wait_shorter_than_the_median_answer_is_no_timeout() {
    let timeout = |waited| judged(silent_polls(waited))["reserves"][0]["timeout_us"].as_f64();
    assert!(timeout(500).is_some_and(|us| (490e3..=500e3).contains(&us)));
    assert_eq!(timeout(8), None);
}
