//! What happened over time: figures that can be added up by hand, and parts that merge to the whole.

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_profiles::points::Plan;
use modlens_profiles::profile::{Profile, ProfileFormat};
use modlens_protocol::checksum::crc16;
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use modlens_tables::overview::Overview;
use serde_json::{json, Value as Json};
use std::sync::Arc;

const START: i64 = 1_700_000_000_000_000_000;
/// 19200-8E1: 11 bits a character.
const CHARACTER: i64 = 572_916;

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// A batch for each exchange: a unit is asked for two registers every 2 s; it answers 20 ms later with the values
/// that it is given, with an exception, or not at all.
fn batches(exchanges: &[(u8, Option<Result<u16, u8>>)], clock: bool) -> Vec<Batch> {
    batches_of(Session::default(), exchanges, clock)
}

fn batches_of(mut session: Session, exchanges: &[(u8, Option<Result<u16, u8>>)], clock: bool) -> Vec<Batch> {
    let mut options = BusOptions::named("line");
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = if clock { Clock::Utc } else { Clock::None };
    let bus = session.add_bus(options);
    let mut all = Vec::new();
    for (number, (unit, answer)) in exchanges.iter().enumerate() {
        let mut now = START + number as i64 * 2_000_000_000;
        let request = framed(&[*unit, 3, 0, 107, 0, 2]);
        let answer = answer.map(|answer| match answer {
            Ok(value) => framed(&[&[*unit, 3, 4][..], &value.to_be_bytes(), &[0, 9]].concat()),
            Err(code) => framed(&[*unit, 0x83, code]),
        });
        for bytes in [Some(request), answer].into_iter().flatten() {
            now += bytes.len() as i64 * CHARACTER;
            let times = if clock { Times::Read(now) } else { Times::None };
            session.feed(bus, &Chunk { bytes: &bytes, times, ..Chunk::default() });
            now += 20_000_000;
        }
        all.push(session.take());
    }
    session.flush();
    all.push(session.take());
    all
}

fn observed(batches: &[Batch]) -> Overview {
    let mut overview = Overview::default();
    for batch in batches {
        overview.observe(batch);
    }
    overview
}

/// The time series of exchanges, each with one of 90 units, in 20 blocks without times: compact, or as rows.
fn courses(exchanges: usize, compact: bool) -> Overview {
    let mut session = Session::default();
    if compact {
        session.emit_compact();
    }
    let bus = session.add_bus(BusOptions::named("line"));
    let (mut overview, mut in_compact) = (Overview::of_courses(), 0);
    let bytes: Vec<Vec<u8>> = (0..exchanges)
        .map(|number| {
            let unit = 1 + (number * number % 90) as u8;
            let function = 3 + (number / 7 % 2) as u8;
            let answer = if number % 50 == 49 { vec![unit, function | 0x80, 2] } else { vec![unit, function, 4, 1, 2, 3, 4] };
            [framed(&[unit, function, 0, 107, 0, 2]), framed(&answer)].concat()
        })
        .collect();
    for block in bytes.chunks(exchanges.div_ceil(20)) {
        session.feed(bus, &Chunk { bytes: &block.concat(), ..Chunk::default() });
        let batch = session.take();
        in_compact += batch.exchanges.len();
        overview.observe(&batch);
    }
    session.flush();
    overview.observe(&session.take());
    assert_eq!(compact, in_compact > exchanges / 2, "{in_compact} of {exchanges}");
    overview
}

#[test]
fn compact_exchanges_have_the_courses_of_rows() {
    for exchanges in [500, 5000] {
        assert!(courses(exchanges, true) == courses(exchanges, false), "{exchanges}");
    }
}

fn sum(column: &Json) -> f64 {
    column.as_array().unwrap().iter().filter_map(Json::as_f64).sum()
}

#[test]
fn figures_are_those_of_the_line() {
    let exchanges = [(1, Some(Ok(5))), (1, Some(Err(2))), (1, None), (2, Some(Ok(7))), (1, Some(Ok(8)))];
    let found = observed(&batches(&exchanges, true)).json(&[]);
    let bus = &found["buses"][0];
    assert_eq!((bus["axis"].as_str(), bus["settings"].as_str()), (Some("utc"), Some("19200-8E1")));
    let line = &bus["line"];
    // Five requests of 8 bytes, three answers of 9, an exception of 5.
    assert_eq!((sum(&line["frames"]) as u64, sum(&line["bytes"]) as u64), (9, 72));
    assert!((sum(&line["busy_us"]) - 72.0 * CHARACTER as f64 / 1000.0).abs() < 0.001, "{line}");
    let sums = ["transactions", "failed", "exceptions"].map(|key| sum(&line[key]) as u64);
    assert_eq!(sums, [5, 1, 1]);
    let rows = bus["requests"]["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    let of_first = &rows[0];
    let sums = ["transactions", "ok", "exceptions", "silent", "damaged"].map(|key| sum(&of_first[key]) as u64);
    assert_eq!(sums, [4, 2, 1, 1, 0]);
    let longest = of_first["response_time"]["max_us"].as_array().unwrap().iter().filter_map(Json::as_f64).fold(0.0, f64::max);
    assert!((longest - 20_000.0).abs() < 600.0, "{longest}");
    let registers = bus["registers"]["rows"].as_array().unwrap();
    let of = |unit: u64, address: u64| registers.iter().find(|row| row["unit"] == unit && row["address"] == address).unwrap();
    let changing = of(1, 107);
    assert_eq!(
        (&changing["min"], &changing["max"], &changing["value"], &changing["changes"]),
        (&json!(5), &json!(8), &json!(8), &json!(1))
    );
    assert_eq!(changing["course"]["last"].as_array().unwrap().iter().filter(|value| !value.is_null()).count(), 2);
    assert_eq!((&of(1, 108)["course"], &of(2, 107)["reads"]), (&Json::Null, &json!(1)));
}

#[test]
fn without_a_clock_the_axis_is_the_number_of_the_transaction() {
    let exchanges = [(1, Some(Ok(5))); 3];
    let found = observed(&batches(&exchanges, false)).json(&[]);
    let bus = &found["buses"][0];
    assert_eq!(bus["axis"], "transactions");
    assert_eq!((&bus["line"]["start"], &bus["line"]["step"]), (&json!(1), &json!(1)));
    assert_eq!(bus["line"]["transactions"], json!([1, 1, 1]));
    assert_eq!((&bus["line"]["busy_us"], &bus["line"]["silence_us"]), (&Json::Null, &Json::Null));
}

#[test]
fn parts_merge_to_the_whole() {
    let exchanges: Vec<_> = (0..700u16)
        .map(|number| {
            let answer = match number % 7 {
                3 => None,
                5 => Some(Err(2)),
                _ => Some(Ok(number * 3)),
            };
            ((number % 5) as u8 + 1, answer)
        })
        .collect();
    let profile = "profile = 1\n[[registers]]\nat = 'hr:107'\nname = 'level'\n";
    let plan = Arc::new(Plan::new(Profile::parse(profile, ProfileFormat::Toml).unwrap()));
    for (clock, has_profile) in [(true, false), (false, false), (true, true), (false, true)] {
        let mut session = Session::default();
        if has_profile {
            session.bind(None, &[1, 2, 3], &plan);
        }
        let batches = batches_of(session, &exchanges, clock);
        let whole = observed(&batches).json(&[4]);
        for cut in [1, 123, 500, 699] {
            let mut merged = observed(&batches[..cut]);
            merged.merge(&observed(&batches[cut..]));
            assert_eq!(merged.json(&[4]), whole, "{cut}");
        }
    }
}

#[test]
fn what_a_diagnosis_names_is_among_the_examples() {
    let exchanges: Vec<_> = (0..1000).map(|number| (1, (number % 3 > 0).then_some(Ok(number)))).collect();
    let found = observed(&batches(&exchanges, true)).json(&[301]);
    let examples = found["examples"].as_array().unwrap();
    assert_eq!(examples.len(), 200);
    let named = examples.iter().find(|one| one["txn"] == 301).expect("it is named");
    assert_eq!((&named["status"], &named["request_hex"]), (&json!("no_response"), &json!("0103006b0002b5d7")));
}
