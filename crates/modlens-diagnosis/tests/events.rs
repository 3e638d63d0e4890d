//! Troubles of a line as events: simulated lines, faster than real time.

use modlens_diagnosis::events::{Change, Event, Events};
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};

const MS: i64 = 1_000_000;
const S: i64 = 1000 * MS;
const MINUTE: i64 = 60 * S;
const START: i64 = 1_700_000_000 * S;

/// What a unit does with a request.
#[derive(Clone, Copy, PartialEq)]
enum Fate {
    Answers,
    IsSilent,
    IsDamaged,
    Refuses,
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// A number that looks random; the same each time.
fn hashed(number: i64) -> u64 {
    modlens_protocol::mix::mix(number as u64)
}

/// The events of a line on which three units are asked in turn, a request each `period`, for this time. `fate` gives what
/// comes of a request, by unit, time since the start, and number.
fn events(period: i64, length: i64, fate: impl Fn(u8, i64, i64) -> Fate) -> Vec<Event> {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut events = Events::default();
    let mut all = Vec::new();
    for number in 0..length / period {
        let (unit, at) = (1 + (number % 3) as u8, number * period);
        let mut feed = |bytes: &[u8], time: i64| {
            session.feed(bus, &Chunk { bytes, times: Times::Read(START + time), ..Chunk::default() });
        };
        feed(&framed(&[unit, 3, 0, 0, 0, 2]), at);
        let value = hashed(number) as u8;
        let mut answer = framed(&[unit, 3, 4, 0, value, 1, 2]);
        match fate(unit, at, number) {
            Fate::Answers => feed(&answer, at + 20 * MS),
            Fate::IsSilent => {}
            Fate::IsDamaged => {
                answer[(value % 5) as usize + 2] ^= 1 << (value % 8);
                feed(&answer, at + 20 * MS);
            }
            Fate::Refuses => feed(&framed(&[unit, 0x83, 4]), at + 20 * MS),
        }
        events.observe(&session.take());
        all.extend(events.take());
    }
    all
}

fn told(events: &[Event]) -> Vec<(Change, &str, Option<u8>)> {
    events.iter().map(|event| (event.change, event.trouble.row.code, event.trouble.row.unit)).collect()
}

/// Seconds from the start.
fn seconds(event: &Event) -> i64 {
    (event.time - START) / S
}

#[test]
fn a_unit_that_is_off_for_two_minutes_is_one_event_and_its_end() {
    let off = |at: i64| (20 * MINUTE..22 * MINUTE).contains(&at);
    let events = events(S, 40 * MINUTE, |unit, at, _| if unit == 2 && off(at) { Fate::IsSilent } else { Fate::Answers });
    let [begin, .., end] = events.as_slice() else { panic!("{:?}", told(&events)) };
    assert_eq!((begin.change, end.change), (Change::Begin, Change::End), "{:?}", told(&events));
    assert!(events.iter().all(|event| event.trouble.row.unit == Some(2)), "{:?}", told(&events));
    assert!(
        (1200..1260).contains(&seconds(begin)) && (1320..1440).contains(&seconds(end)),
        "{} {}",
        seconds(begin),
        seconds(end)
    );
    // 40 requests, one in three seconds.
    let length = (end.trouble.until - end.trouble.since) / S;
    assert!((114..=120).contains(&length), "{length} {end:?}");
    assert!(end.json()["text"].as_str().unwrap().starts_with("over after "));
}

#[test]
fn a_unit_that_stays_off_is_one_trouble_until_it_answers() {
    let off = |at: i64| (20 * MINUTE..240 * MINUTE).contains(&at);
    let events = events(S, 250 * MINUTE, |unit, at, _| if unit == 2 && off(at) { Fate::IsSilent } else { Fate::Answers });
    let (first, last) = (events.first().expect("an event"), events.last().expect("an event"));
    assert_eq!((first.change, last.change), (Change::Begin, Change::End), "{:?}", told(&events));
    // It may be said after some hours that the unit never answers.
    assert!(events.len() <= 4 && events.iter().all(|event| event.trouble.number == 1), "{:?}", told(&events));
    assert!((14_400..14_520).contains(&seconds(last)), "{}", seconds(last));
}

#[test]
fn noise_on_one_unit_begins_and_ends() {
    let noisy = |at: i64| (10 * MINUTE..15 * MINUTE).contains(&at);
    let events = events(200 * MS, 25 * MINUTE, |unit, at, number| {
        if unit == 3 && noisy(at) && hashed(number).is_multiple_of(3) {
            Fate::IsDamaged
        } else {
            Fate::Answers
        }
    });
    let (first, last) = (events.first().expect("an event"), events.last().expect("an event"));
    assert_eq!((first.change, last.change), (Change::Begin, Change::End), "{:?}", told(&events));
    assert!((600..660).contains(&seconds(first)) && (900..1020).contains(&seconds(last)), "{:?}", told(&events));
}

#[test]
fn one_lost_request_in_a_hundred_shows_in_a_long_window_and_does_not_flap() {
    let events = events(300 * MS, 180 * MINUTE, |unit, _, number| {
        if unit == 1 && hashed(number).is_multiple_of(30) {
            Fate::IsSilent
        } else {
            Fate::Answers
        }
    });
    let begins = events.iter().filter(|event| event.change == Change::Begin).count();
    assert!((1..=2).contains(&begins) && events.iter().all(|event| event.change != Change::End), "{:?}", told(&events));
}

#[test]
fn a_healthy_day_has_no_event() {
    // With the accidents of a healthy line: one request in a thousand.
    let events = events(700 * MS, 24 * 60 * MINUTE, |_, _, number| match hashed(number) % 2000 {
        0 => Fate::IsSilent,
        1 => Fate::IsDamaged,
        _ => Fate::Answers,
    });
    assert_eq!(told(&events), []);
}

#[test]
fn a_unit_that_comes_and_goes_is_held_longer_each_time() {
    let off = |at: i64| at % (4 * MINUTE) < 40 * S && at > MINUTE;
    let events = events(S, 120 * MINUTE, |unit, at, _| if unit == 2 && off(at) { Fate::IsSilent } else { Fate::Answers });
    let begins = events.iter().filter(|event| event.change == Change::Begin).count();
    // 30 times off: three or four events.
    assert!(begins <= 4, "{:?}", told(&events));
}

#[test]
fn a_unit_that_refuses_everything_is_a_trouble() {
    let events = events(S, 20 * MINUTE, |unit, at, _| if unit == 2 && at > 10 * MINUTE { Fate::Refuses } else { Fate::Answers });
    assert!(events.iter().any(|event| event.change == Change::Begin && event.trouble.row.unit == Some(2)), "{:?}", told(&events));
}
