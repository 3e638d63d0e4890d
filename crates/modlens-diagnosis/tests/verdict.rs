//! What is no diagnosis, and not healthy all the same.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

#[test]
fn a_line_with_a_unit_that_refuses_everything_is_not_healthy() {
    // Three units in turn; the third one answers each request with exception 7, which no cause explains.
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions::named("line"));
    let mut contrast = Contrast::default();
    for number in 0..300u16 {
        let unit = 1 + (number % 3) as u8;
        let answer = if unit == 3 { framed(&[unit, 0x83, 7]) } else { framed(&[unit, 3, 2, 0, number as u8]) };
        let bytes = [framed(&[unit, 3, 0, 0, 0, 1]), answer].concat();
        session.feed(bus, &Chunk { bytes: &bytes, ..Chunk::default() });
        contrast.observe(&session.take());
    }
    session.flush();
    contrast.observe(&session.take());
    let found = Report::of(contrast).json();
    assert_eq!(found["verdict"], "trouble", "{found}");
    assert!(found["sentence"].as_str().unwrap().contains("Unit 3: 100 of 100 requests were refused"), "{found}");
}

#[test]
fn a_unit_that_never_answers_is_named_although_noise_damages_some_requests() {
    // Two units in turn, one of which is off; each fiftieth byte string has a flipped bit. Responses come after 20 ms, the
    // master waits 500 ms.
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions::named("line"));
    let mut contrast = Contrast::default();
    let (mut time, mut sent) = (0, 0);
    let mut feed = |session: &mut Session, mut bytes: Vec<u8>, time: i64| {
        sent += 1;
        if sent % 50 == 0 {
            bytes[4] ^= 4;
        }
        session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(time), ..Chunk::default() });
    };
    for number in 0..600u16 {
        let unit = 1 + (number % 2) as u8;
        feed(&mut session, framed(&[unit, 3, 0, 0, 0, 1]), time);
        if unit == 1 {
            feed(&mut session, framed(&[unit, 3, 2, 0, number as u8]), time + 20_000_000);
        }
        time += if unit == 1 { 60_000_000 } else { 500_000_000 };
        contrast.observe(&session.take());
    }
    session.flush();
    contrast.observe(&session.take());
    let found = Report::of(contrast).json();
    assert_eq!(found["diagnoses"][0]["code"], "dead_unit_cost", "{found}");
    assert_eq!(found["diagnoses"][0]["unit"], 2, "{found}");
    assert_eq!(found["diagnoses"][0]["episodes"].as_array().unwrap().len(), 1, "{found}");
}

/// A line on which a master asks two units in turn and writes to the first one in each tenth exchange; `after` gives the
/// further bytes that come 20 ms after an exchange, by its number and whether it was a write.
fn judged(after: impl Fn(u16, bool) -> Vec<u8>) -> serde_json::Value {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions::named("line"));
    let mut contrast = Contrast::default();
    for number in 0..600u16 {
        let unit = 1 + (number % 2) as u8;
        let is_write = number % 10 == 0;
        let request = if is_write { framed(&[unit, 6, 0, 1, 0, number as u8]) } else { framed(&[unit, 3, 0, 0, 0, 1]) };
        let answer = if is_write { request.clone() } else { framed(&[unit, 3, 2, 0, number as u8]) };
        let at = i64::from(number) * 200_000_000;
        for (bytes, time) in [(request, at), (answer, at + 20_000_000), (after(number, is_write), at + 50_000_000)] {
            if !bytes.is_empty() {
                session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(time), ..Chunk::default() });
            }
        }
        contrast.observe(&session.take());
    }
    session.flush();
    contrast.observe(&session.take());
    Report::of(contrast).json()
}

#[test]
fn noise_after_writes_is_named_although_no_request_fails() {
    // What a relay that drops leaves on the line: other bytes each time.
    let noise = |number: u16| (0..7u16).map(|at| (number * 37 + at * 101 + at * at * 13) as u8 | 0x11).collect::<Vec<_>>();
    let found = judged(|number, is_write| if is_write { noise(number) } else { Vec::new() });
    assert_eq!(found["diagnoses"][0]["code"], "line_noise", "{found}");
    assert!(found["sentence"].as_str().unwrap().contains("come right after writes"), "{found}");
    // The near miss: as often, wherever it falls.
    let found = judged(|number, _| if number % 11 == 3 { noise(number) } else { Vec::new() });
    assert!(!found["sentence"].as_str().unwrap().contains("after writes"), "{found}");
}

#[test]
fn a_unit_whose_answers_come_twice_is_two_devices_and_not_a_second_master() {
    let found = judged(|number, is_write| {
        if number % 2 == 1 || is_write {
            return Vec::new();
        }
        // The second answer, spoilt in the middle.
        let mut bytes = framed(&[1, 3, 2, 0x12, number as u8]);
        bytes[3] ^= 0x5A;
        bytes
    });
    assert_eq!(found["diagnoses"][0]["code"], "duplicate_address", "{found}");
    assert_eq!(found["diagnoses"][0]["unit"], 1, "{found}");
}

/// Four units in turn, each twentieth answer spoilt in the middle; now and then a request comes right after itself.
fn in_turn(is_repeated: impl Fn(u16) -> bool) -> serde_json::Value {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut contrast = Contrast::default();
    let (mut time, mut place) = (0i64, 0u16);
    for number in 0..800u16 {
        place += u16::from(!is_repeated(number));
        let unit = 1 + (place % 4) as u8;
        let mut answer = framed(&[unit, 3, 4, 0, number as u8, 3, 1]);
        if number % 20 == 7 {
            answer[5] ^= 0x5A;
            answer[6] ^= 0x3C;
        }
        for (bytes, after) in [(framed(&[unit, 3, 0, 0, 0, 2]), 0), (answer, 20_000_000)] {
            session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(time + after), ..Chunk::default() });
        }
        time += 90_000_000;
        contrast.observe(&session.take());
    }
    session.flush();
    contrast.observe(&session.take());
    Report::of(contrast).json()
}

#[test]
fn a_list_whose_requests_come_right_after_themselves_is_that_of_two_masters() {
    let found = in_turn(|number| number % 14 == 5);
    assert_eq!(found["diagnoses"][0]["code"], "two_masters", "{found}");
    for other in [in_turn(|_| false), in_turn(|number| number % 2 == 1)] {
        let codes = other["diagnoses"].as_array().unwrap().iter().map(|row| row["code"].to_string());
        assert!(!codes.collect::<String>().contains("two_masters"), "{other}");
    }
}
