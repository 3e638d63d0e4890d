//! Compact exchanges are written as the rows that they stand for: the same line, with frames wanted and without.

use std::sync::Arc;

use modlens_arrow::batch::{all_columns, BatchBuilder};
use modlens_engine::records::{Batch, Part};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_profiles::points::Plan;
use modlens_profiles::profile::{Profile, ProfileFormat};
use modlens_protocol::checksum::crc16;
use modlens_protocol::framing::Mode;
use modlens_readers::chunk::Chunk;
use modlens_readers::text::{Dialects, Reader};
use modlens_tables::columns::{Table, TableKind};
use modlens_tables::overview::Overview;
use modlens_writers::{csv, jsonl};
use proptest::prelude::*;

fn framed(adu: &[u8]) -> Vec<u8> {
    [adu, &crc16(adu).to_le_bytes()].concat()
}

/// A read of bits or registers, a write of one or several, or both in one, with its response.
fn exchange(unit: u8, function: u8, address: u16, quantity: u8, value: u8) -> [Vec<u8>; 2] {
    let head = [unit, function, (address >> 8) as u8, address as u8];
    let data = |count: u8| (0..count).map(|at| value.wrapping_add(at)).collect::<Vec<u8>>();
    let (request, response) = match function {
        // The bits of the last byte that were not asked for are 0.
        1 | 2 => ([&head[..], &[0, 8]].concat(), vec![unit, function, 1, value]),
        3 | 4 => ([&head[..], &[0, quantity]].concat(), [&[unit, function, 2 * quantity], &data(2 * quantity)[..]].concat()),
        5 => ([&head[..], &[0xFF, 0]].concat(), [&head[..], &[0xFF, 0]].concat()),
        6 => ([&head[..], &[0, value]].concat(), [&head[..], &[0, value]].concat()),
        15 => ([&head[..], &[0, 8, 1, value]].concat(), [&head[..], &[0, 8]].concat()),
        23 => {
            let count = quantity % 4 + 1;
            let written = [&[0, 9, 0, count, 2 * count], &data(2 * count)[..]].concat();
            ([&head[..], &[0, quantity], &written].concat(), [&[unit, function, 2 * quantity], &data(2 * quantity)[..]].concat())
        }
        _ => ([&head[..], &[0, quantity, 2 * quantity], &data(2 * quantity)].concat(), [&head[..], &[0, quantity]].concat()),
    };
    [framed(&request), framed(&response)]
}

/// A polled line; one exchange in seven has no response, is refused, or is damaged.
fn line() -> impl Strategy<Value = Vec<u8>> {
    let function = prop_oneof![Just(1u8), Just(2), Just(3), Just(4), Just(5), Just(6), Just(15), Just(16), Just(23)];
    let polls = proptest::collection::vec((1u8..4, function, prop_oneof![0u16..4, Just(0x300u16)], 1u8..5), 1..6);
    (polls, proptest::collection::vec((0u8..27, any::<u8>()), 4..120)).prop_map(|(polls, turns)| {
        let mut bytes = Vec::new();
        for (turn, (accident, value)) in turns.into_iter().enumerate() {
            let (unit, function, address, quantity) = polls[turn % polls.len()];
            let [request, mut response] = exchange(unit, function, address, quantity, value);
            match accident {
                0 => response.clear(),
                1 | 3 => response = framed(&[unit, function | 0x80, value % 13]),
                2 => *response.last_mut().expect("a response has bytes") ^= 1,
                _ => {}
            }
            bytes.extend([request, response].concat());
        }
        bytes
    })
}

/// The batch of an RTU line without a clock, with compact exchanges, or rows alone.
fn batch(bytes: &[u8], compact: bool) -> Batch {
    batch_with(&[], bytes, compact)
}

/// The same where units have these profiles.
fn batch_with(profiles: &[(u8, Arc<Plan>)], bytes: &[u8], compact: bool) -> Batch {
    let mut session =
        Session::new(Arc::default(), WantedTables { frames: true, transactions: true, findings: true }, false, None);
    if compact {
        session.emit_compact();
    }
    for (unit, plan) in profiles {
        session.bind(None, &[*unit], plan);
    }
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("line") });
    session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    session.flush();
    session.take()
}

/// Profiles of two of the three units: numbers in all orders, with a scale factor that changes; and one with a list of functions
/// and words of its own for an exception.
fn profiles() -> [(u8, Arc<Plan>); 2] {
    let first = "[[registers]]\nat='hr:0'\nname='power'\nsf='factor'\n[[registers]]\nat='hr:1'\nname='factor'\ntype='s16'\n\
        [[registers]]\nat='hr:2'\nname='float'\ntype='f32'\n[[registers]]\nat='ir:1'\nname='sum'\ntype='u32'\norder='CDAB'\n\
        [[registers]]\nat='co:2'\nname='pump'\n[[registers]]\nat='hr:0x301'\nname='t'\nscale=0.1\n";
    let second = "[device]\nfunctions = [1, 3, 6, 16]\n[device.exceptions]\n2 = 'not there'\n\
        [[registers]]\nat='hr:1'\nname='state'\nenum={1='on'}\n";
    [(1, first), (2, second)].map(|(unit, text)| {
        let profile = Profile::parse(&format!("profile = 1\n{text}"), ProfileFormat::Toml).expect("it is a profile");
        (unit, Arc::new(Plan::new(profile)))
    })
}

/// A line of a log: the time, in milliseconds, and a frame in hex.
fn log_line(ms: u64, frame: &[u8]) -> String {
    let pairs: Vec<String> = frame.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("{}.{:03} {}\n", ms / 1000, ms % 1000, pairs.join(" "))
}

/// The same traffic as a log with times and a frame a line; one exchange in nine has no response, is refused, or is damaged.
fn log() -> impl Strategy<Value = String> {
    let function = prop_oneof![Just(1u8), Just(2), Just(3), Just(4), Just(5), Just(6), Just(15), Just(16), Just(23)];
    let polls = proptest::collection::vec((1u8..4, function, prop_oneof![0u16..4, Just(0x300u16)], 1u8..5), 1..6);
    let turn = (0u8..27, any::<u8>(), prop_oneof![8 => 1u64..30, 1 => Just(0), 1 => 900u64..2000], 0u64..40);
    (polls, proptest::collection::vec(turn, 4..120)).prop_map(|(polls, turns)| {
        let (mut text, mut now) = (String::new(), 1_697_041_234_000);
        let mut add = |pause: u64, frame: &[u8]| {
            now += pause;
            text.push_str(&log_line(now, frame));
        };
        for (turn, (accident, value, pause, wait)) in turns.into_iter().enumerate() {
            let (unit, function, address, quantity) = polls[turn % polls.len()];
            let [request, mut response] = exchange(unit, function, address, quantity, value);
            add(pause, &request);
            match accident {
                0 => continue,
                1 => response = framed(&[unit, function | 0x80, 2]),
                2 => *response.last_mut().expect("a response has bytes") ^= 1,
                _ => {}
            }
            add(wait, &response);
        }
        text
    })
}

/// The rows of such a log, taken after each block of `block` bytes, with frames or without; and how many are compact.
fn rows_of_log(log: &str, frames: bool, block: usize) -> (Vec<String>, usize) {
    let mut session = Session::new(Arc::default(), WantedTables { frames, transactions: true, findings: true }, false, None);
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("log") });
    session.open_text(bus, Reader::new(Dialects::embedded().named("hex").unwrap(), None, Arc::default()), b"");
    let count = TableKind::Transactions.columns().len();
    let (mut texts, mut compact) = (vec![String::new(); 2 * count], 0);
    let mut add = |batch: Batch| {
        compact += batch.exchanges.len();
        let table = Table::new(Arc::new(batch), TableKind::Transactions);
        for column in 0..count {
            texts[column] += &csv_of(&table, &[column]);
            texts[count + column] += &jsonl_of(&table, &[column]);
        }
    };
    for part in log.as_bytes().chunks(block) {
        session.feed_text(bus, part, false);
        add(session.take());
    }
    session.feed_text(bus, b"", true);
    session.flush();
    add(session.take());
    texts.push(session.stats_json().to_string());
    (texts, compact)
}

fn csv_of(table: &Table, columns: &[usize]) -> String {
    let mut text = Vec::new();
    csv::rows(table, columns, &mut text);
    String::from_utf8(text).expect("CSV is UTF-8")
}

fn jsonl_of(table: &Table, columns: &[usize]) -> String {
    let mut text = Vec::new();
    jsonl::rows(table, columns, &mut text);
    String::from_utf8(text).expect("JSON is UTF-8")
}

// The other tests would pass if there were none.
#[test]
fn a_polled_line_has_compact_exchanges() {
    let [request, response] = exchange(17, 3, 0x6B, 3, 7);
    let refused = [&request[..], &framed(&[17, 0x83, 2])].concat();
    let batch = batch(&[&[request, response].concat().repeat(9)[..], &refused].concat().repeat(10), true);
    assert!(batch.exchanges.len() > 90, "{} of 100", batch.exchanges.len());
    assert!(batch.exchanges.iter().filter(|exchange| exchange.exception == 2).count() > 8);
    assert!(batch.transaction_parts().any(|part| matches!(part, Part::Compact(_))));
}

// The property of profiles would hold if there were none as well.
#[test]
fn a_line_with_a_profile_has_compact_exchanges() {
    let polls = [exchange(1, 3, 2, 2, 7), exchange(1, 4, 1, 2, 7), exchange(3, 3, 2, 2, 7)].concat().concat();
    let batch = batch_with(&profiles(), &polls.repeat(40), true);
    assert!(batch.exchanges.len() > 90, "{} of 120", batch.exchanges.len());
    assert!(batch.exchange_runs.iter().all(|run| run.points_of(1).is_some() && run.points_of(3).is_none()));
}

#[test]
fn a_log_with_times_has_compact_exchanges() {
    let mut log = String::new();
    for turn in 0..100u8 {
        for (at, frame) in exchange(17, 3, 0x6B, 3, turn).iter().enumerate() {
            log.push_str(&log_line(1_697_041_234_000 + 1000 * u64::from(turn) + 10 * at as u64, frame));
        }
    }
    let (rows, compact) = rows_of_log(&log, false, 1 << 18);
    assert!(compact > 90, "{compact} of 100");
    assert_eq!((rows, 0), rows_of_log(&log, true, 1 << 18));
}

proptest! {
    // A block of less than a line decides each line when it comes, in the general way.
    #[test]
    fn a_log_with_times_has_the_rows_of_the_general_way(log in log(), block in 60usize..3000) {
        let (general, _) = rows_of_log(&log, true, 20);
        for (frames, block) in [(true, log.len()), (false, log.len()), (false, block), (false, 20)] {
            prop_assert_eq!(&rows_of_log(&log, frames, block).0, &general);
        }
    }

    #[test]
    fn every_column_is_that_of_the_row(bytes in line()) {
        let [compact, rows] = [true, false].map(|compact| Table::new(Arc::new(batch(&bytes, compact)), TableKind::Transactions));
        columns_are_those_of_rows(&compact, &rows)?;
    }

    /// Record batches of many tables, of which some have whole rows, and that end anywhere in them.
    #[test]
    fn rows_of_several_tables_become_record_batches(lines in proptest::collection::vec(line(), 1..6), cut in 0usize..50) {
        let columns = all_columns(TableKind::Transactions);
        let [compact, rows] = [true, false].map(|compact| {
            let tables = lines.iter().map(|bytes| Table::new(Arc::new(batch(bytes, compact)), TableKind::Transactions));
            let mut batches = BatchBuilder::new(TableKind::Transactions, &columns);
            let mut found = Vec::new();
            for table in tables {
                let at = cut.min(table.len());
                batches.add(&table, 0..at);
                found.push(batches.finish());
                batches.add(&table, at..table.len());
            }
            found.push(batches.finish());
            found
        });
        prop_assert_eq!(compact, rows);
    }

    #[test]
    fn what_profiles_say_is_that_of_the_rows(bytes in line(), others in line()) {
        let bytes = [bytes, others].concat();
        let [compact, rows] = [true, false].map(|compact| Arc::new(batch_with(&profiles(), &bytes, compact)));
        for kind in [TableKind::Transactions, TableKind::Readings, TableKind::Findings] {
            let [compact, rows] = [&compact, &rows].map(|batch| Table::new(Arc::clone(batch), kind));
            columns_are_those_of_rows(&compact, &rows)?;
        }
        let [compact, rows] = [&compact, &rows].map(|batch| {
            let mut overview = Overview::default();
            overview.observe(batch);
            overview.json(&[])
        });
        prop_assert_eq!(compact, rows);
    }

    #[test]
    fn the_overview_is_that_of_the_rows(bytes in line()) {
        overview_is_that_of_the_rows(&bytes)?;
    }
}

/// Each column by itself, all of them in text, and as a record batch.
fn columns_are_those_of_rows(compact: &Table, rows: &Table) -> Result<(), TestCaseError> {
    let all: Vec<usize> = (0..compact.kind.columns().len()).collect();
    for &column in &all {
        prop_assert_eq!(csv_of(compact, &[column]), csv_of(rows, &[column]));
        prop_assert_eq!(jsonl_of(compact, &[column]), jsonl_of(rows, &[column]));
        prop_assert_eq!(compact.has_value(column), rows.has_value(column));
    }
    prop_assert_eq!(csv_of(compact, &all), csv_of(rows, &all));
    prop_assert_eq!(jsonl_of(compact, &all), jsonl_of(rows, &all));
    prop_assert_eq!(modlens_arrow::batch::batch(compact), modlens_arrow::batch::batch(rows));
    Ok(())
}

/// The overview of compact exchanges, and the time series alone, show what that of whole rows shows.
fn overview_is_that_of_the_rows(bytes: &[u8]) -> Result<(), TestCaseError> {
    let of = |mut overview: Overview, compact| {
        overview.observe(&batch(bytes, compact));
        overview.json(&[])
    };
    let rows = of(Overview::default(), false);
    prop_assert_eq!(&of(Overview::default(), true), &rows);
    // What the text of `stats` shows is part of it.
    let courses = of(Overview::of_courses(), true);
    for (bus, whole) in courses["buses"].as_array().unwrap().iter().zip(rows["buses"].as_array().unwrap()) {
        prop_assert_eq!(&bus["line"], &whole["line"]);
        for key in ["steps", "units"] {
            prop_assert_eq!(&bus["requests"][key], &whole["requests"][key]);
        }
    }
    Ok(())
}

// A run that lies in many buckets, which become wider on the way.
#[test]
fn the_courses_of_a_long_run_are_those_of_the_rows() {
    let cycle: Vec<u8> = (1..4).flat_map(|unit| exchange(unit, 3, 0x6B, 3 + unit, 7).concat()).collect();
    let bytes = cycle.repeat(1500);
    assert!(batch(&bytes, true).exchange_runs.iter().any(|run| run.exchanges.length > 2048));
    overview_is_that_of_the_rows(&bytes).unwrap();
}
