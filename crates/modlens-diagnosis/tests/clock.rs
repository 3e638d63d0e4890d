//! Recordings with a hole, or with a clock that was set: said as such, and no unit is blamed.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use serde_json::Value as Json;

const MS: i64 = 1_000_000;
const S: i64 = 1000 * MS;
const START: i64 = 1_700_000_000 * S;

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// What the doctor reports about 300 reads, 10 in a second, of three units in turn; `clock` changes the time of each frame, or leaves
/// the frame out.
fn judged(clock: impl Fn(i64) -> Option<i64>) -> Json {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut contrast = Contrast::default();
    for number in 0..300i64 {
        let unit = 1 + (number % 3) as u8;
        let frames = [framed(&[unit, 3, 0, 0, 0, 1]), framed(&[unit, 3, 2, 0, number as u8])];
        for (bytes, at) in frames.iter().zip([0, 20 * MS]) {
            if let Some(time) = clock(number * 100 * MS + at) {
                session.feed(bus, &Chunk { bytes, times: Times::Read(START + time), ..Chunk::default() });
            }
        }
        contrast.observe(&session.take());
    }
    session.flush();
    contrast.observe(&session.take());
    Report::of(contrast).json()
}

fn unjudged(found: &Json) -> Vec<&str> {
    found["not_judged"].as_array().unwrap().iter().filter_map(|row| row["what"].as_str()).collect()
}

#[test]
fn a_recording_without_a_gap_has_nothing_to_say_of_its_clock() {
    let found = judged(Some);
    assert_eq!(found["verdict"], "healthy");
    assert!(unjudged(&found).is_empty(), "{found}");
}

#[test]
fn a_hole_is_told_with_its_ends_and_is_no_units_fault() {
    // From the answer of second 10 on until 16 s after it, all is missing: 10.0 is the last request before, 26.1 the first after.
    let found = judged(|time| (time <= 10 * S || time > 26 * S + 50 * MS).then_some(time));
    assert_eq!((&found["verdict"], found["diagnoses"].as_array().unwrap().len()), (&Json::from("healthy"), 0), "{found}");
    let said = unjudged(&found);
    // A request of 8 characters of 11 bits, read at its end, began 4.6 ms before; 1,700,000,000 s is 22:13:20.
    let times = "the 16 s from 2023-11-14T22:13:29.995000Z to 2023-11-14T22:13:46.095000Z";
    assert!(said.len() == 1 && said[0].contains("hole") && said[0].starts_with(times), "{said:?}");
}

#[test]
fn a_clock_that_is_set_forward_in_an_exchange_looks_like_a_hole() {
    let found = judged(|time| Some(if time > 10 * S { time + 3600 * S } else { time }));
    assert_eq!(found["diagnoses"].as_array().unwrap().len(), 0, "{found}");
    let said = unjudged(&found);
    assert!(said.len() == 1 && said[0].starts_with("the 60 min") && said[0].contains("clock was set forward"), "{said:?}");
}

#[test]
fn a_clock_that_is_set_back_is_told_with_how_often() {
    let found = judged(|time| Some(time - [0, 5 * S, 9 * S][usize::from(time > 10 * S) + usize::from(time > 20 * S)]));
    assert_eq!(found["diagnoses"].as_array().unwrap().len(), 0, "{found}");
    let said = unjudged(&found);
    assert!(said.len() == 1 && said[0].ends_with("went backwards 2 times"), "{said:?}");
}
