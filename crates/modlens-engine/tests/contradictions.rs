//! Recordings that contradict physics or their settings: that is reported at the end of the line, and values of doubtful place are not
//! taken for registers.
//!
//! Expected values follow from how each line is built here.

mod wire;

use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{read_request, read_response, MS};

/// A character at 19200 baud, 8E1, at which the lines run.
const CHAR: i64 = 572_917;

/// A recording of 30 exchanges at 19200-8E1, `pause_ms` apart, with a time for each byte, read with these settings.
fn recording(settings: &str, pause_ms: i64, mark_errors: bool) -> Batch {
    let mut session = Session::new(
        Arc::new(Functions::default()),
        WantedTables { frames: true, transactions: true, findings: true },
        false,
        None,
    );
    let mut options = BusOptions { mode: Some(Mode::Rtu), line: Some(settings.parse().unwrap()), ..BusOptions::named("bus") };
    options.bus.clock = Clock::Relative;
    let bus = session.add_bus(options);
    let mut now = 1_000 * MS;
    for i in 0..30u16 {
        for bytes in [read_request(1, 10, 2), read_response(1, &[300 + i, 7])] {
            now += pause_ms * MS;
            for byte in bytes {
                now += CHAR;
                let chunk = Chunk { bytes: &[byte], times: Times::Read(now), has_line_error: mark_errors, ..Chunk::default() };
                session.feed(bus, &chunk);
            }
        }
    }
    session.flush();
    session.take()
}

fn findings(batch: &Batch) -> Vec<Finding> {
    let mut found: Vec<Finding> = batch.findings.iter().map(|row| row.finding).collect();
    found.retain(|finding| matches!(finding, Finding::FasterThanLine | Finding::OverfullLine | Finding::ErrorsOnValidFrames));
    found
}

#[test]
fn a_line_of_its_own_settings_contradicts_nothing() {
    for pause_ms in [4, 40] {
        assert_eq!(findings(&recording("19200-8E1", pause_ms, false)), []);
        assert_eq!(findings(&recording("38400-8E1", pause_ms, false)), [], "twice the rate is not impossible");
    }
}

#[test]
fn bytes_closer_than_the_rate_allows_and_more_of_them_than_fit_are_told_once() {
    let batch = recording("9600-8E1", 40, false);
    assert_eq!(findings(&batch), [Finding::FasterThanLine]);
    // The 9 bytes of a response: 8 of them within 8 characters of 573 us, which take 1146 us each at 9600 baud.
    let detail = &batch.findings.iter().find(|row| row.finding == Finding::FasterThanLine).unwrap().detail;
    assert_eq!(detail, "in 60 of 60 frames; for instance 8 bytes within 4583 us, which take 9166 us at these settings");
    // 30 times 17 bytes: 510 characters of 9.2 ms in about 0.5 s.
    assert_eq!(findings(&recording("1200-8E1", 4, false)), [Finding::FasterThanLine, Finding::OverfullLine]);
}

#[test]
fn errors_in_all_valid_frames_are_those_of_the_receiver() {
    assert_eq!(findings(&recording("19200-8E1", 40, true)), [Finding::ErrorsOnValidFrames]);
}

#[test]
fn a_response_of_another_length_is_no_good_one() {
    let (mut session, bus) = wire::session(false, Clock::None);
    for (asked, registers) in [(2, vec![1, 2]), (2, vec![1]), (1, vec![1, 2]), (2, vec![3, 4])] {
        session.feed(bus, &Chunk { bytes: &read_request(1, 10, asked), ..Chunk::default() });
        session.feed(bus, &Chunk { bytes: &read_response(1, &registers), ..Chunk::default() });
    }
    session.flush();
    let batch = session.take();
    let statuses: Vec<Status> = batch.transactions.iter().map(|row| row.status).collect();
    assert_eq!(statuses, [Status::Ok, Status::BadResponse, Status::BadResponse, Status::Ok]);
    let details: Vec<&str> = batch.findings.iter().map(|row| row.detail.as_str()).collect();
    assert_eq!(details, ["2 bytes, 4 were requested", "4 bytes, 2 were requested"]);
    assert!(batch.findings.iter().all(|row| row.finding == Finding::ResponseLength));
}
