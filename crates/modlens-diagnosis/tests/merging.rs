//! Parts of a recording, observed apart and merged in order, give what one pass gives.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use proptest::prelude::*;

/// What comes of a request, and how many milliseconds after the exchange before it is sent.
type Exchange = (u8, Fate, u8, i64);

#[derive(Clone, Copy, Debug)]
enum Fate {
    Answered,
    Refused,
    Silent,
    FirstByteLost,
    BitFlipped,
    Overlaid,
    Stray,
    Late,
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// The reads of an exchange: bytes and the milliseconds before them.
fn reads((unit, fate, address, pause): Exchange) -> Vec<(Vec<u8>, i64)> {
    let request = framed(&[unit, 3, 0, address, 0, 2]);
    let answer = framed(&[unit, 3, 4, address, 1, 2, 3]);
    let mut flipped = answer.clone();
    flipped[4] ^= 0x10;
    let answers: Vec<(Vec<u8>, i64)> = match fate {
        Fate::Answered => vec![(answer, 20)],
        Fate::Refused => vec![(framed(&[unit, 0x83, 2]), 20)],
        Fate::Silent => vec![],
        Fate::FirstByteLost => vec![(answer[1..].to_vec(), 20)],
        Fate::BitFlipped => vec![(flipped, 20)],
        Fate::Overlaid => vec![(vec![0, 2, 0, 9, 0, 0, 4], 20)],
        Fate::Stray => vec![(vec![0], 5), (answer, 20)],
        Fate::Late => vec![(answer, 900)],
    };
    [vec![(request, pause)], answers].concat()
}

/// The batches of a recording, one after each exchange.
fn batches(exchanges: &[Exchange]) -> Vec<Batch> {
    let mut session = Session::default();
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    let bus = session.add_bus(options);
    let mut now = 1_700_000_000_000_000_000;
    let mut all = Vec::new();
    for exchange in exchanges {
        for (bytes, pause_ms) in reads(*exchange) {
            now += pause_ms * 1_000_000 + bytes.len() as i64 * 572_917;
            session.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(now), ..Chunk::default() });
        }
        all.push(session.take());
    }
    session.flush();
    all.push(session.take());
    all
}

fn observed(batches: &[Batch]) -> Contrast {
    let mut contrast = Contrast::default();
    for batch in batches {
        contrast.observe(batch);
    }
    contrast
}

fn shown(contrast: &Contrast) -> String {
    Report::of(contrast).json().to_string()
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        8 => Just(Fate::Answered),
        1 => Just(Fate::Refused),
        2 => Just(Fate::Silent),
        1 => Just(Fate::FirstByteLost),
        1 => Just(Fate::BitFlipped),
        1 => Just(Fate::Overlaid),
        1 => Just(Fate::Stray),
        1 => Just(Fate::Late),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn parts_merge_to_the_whole(
        exchanges in prop::collection::vec((1u8..4, fate(), 0u8..6, 2i64..300), 1..260),
        cuts in prop::collection::vec(0.0f64..1.0, 0..4),
    ) {
        let batches = batches(&exchanges);
        let whole = observed(&batches);
        let mut ends: Vec<usize> = cuts.iter().map(|cut| (cut * batches.len() as f64) as usize).collect();
        ends.push(batches.len());
        ends.sort_unstable();
        let mut merged = Contrast::default();
        let mut from = 0;
        for to in ends {
            merged.merge(&observed(&batches[from..to]));
            from = to;
        }
        for ((_, one), (_, other)) in whole.buses().zip(merged.buses()) {
            prop_assert_eq!(&one.units, &other.units);
            prop_assert_eq!(&one.requests, &other.requests);
            prop_assert_eq!(&one.noise, &other.noise);
            prop_assert_eq!(&one.frames, &other.frames);
        }
        prop_assert_eq!(shown(&whole), shown(&merged));
    }
}

#[test]
fn chunks_of_a_recording_change_nothing() {
    let exchanges: Vec<Exchange> = (0..200).map(|i| (1 + i % 3, Fate::Answered, i % 5, 10)).collect();
    let one_by_one = batches(&exchanges);
    assert!(shown(&observed(&one_by_one)).contains("\"verdict\":\"healthy\""));
}
