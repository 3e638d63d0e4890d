//! Units that do not keep to the specification in all of their responses: one finding for the line, with n of N.

mod wire;

use modlens_engine::records::Batch;
use modlens_protocol::checksum::crc16;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use wire::{in_pieces, read_request, read_response, session, MS};

/// Polls of each of three units.
const POLLS: u16 = 40;

/// What unit 2 makes of its response.
type Spoil = fn(Vec<u8>) -> Vec<u8>;

/// Requests and responses in turns; those of unit 2 are spoiled.
fn frames(spoil: Spoil) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    for poll in 0..3 * POLLS {
        let unit = 1 + (poll % 3) as u8;
        frames.push(read_request(unit, 10 * u16::from(unit), 2));
        let response = read_response(unit, &[1000 + poll % 47, 2000 + poll % 31]);
        frames.push(if unit == 2 { spoil(response) } else { response });
    }
    frames
}

/// The rows of a recording without times, and of a live tap whose reads are frames.
fn recorded_and_live(spoil: Spoil) -> [Batch; 2] {
    let bytes = frames(spoil).concat();
    let (mut untimed, _) = session(false, Clock::None);
    let recorded = in_pieces(&mut untimed, &bytes, 1000);
    let (mut live, bus) = session(true, Clock::Relative);
    let mut time = 0;
    for bytes in frames(spoil) {
        time += 15 * MS;
        live.feed(bus, &Chunk { bytes: &bytes, times: Times::Read(time), ..Chunk::default() });
    }
    live.flush();
    [recorded, live.take()]
}

fn details(batch: &Batch, finding: Finding) -> Vec<&str> {
    batch.findings.iter().filter(|row| row.finding == finding).map(|row| &row.detail[..]).collect()
}

fn answered(batch: &Batch, unit: u8) -> usize {
    batch.transactions.iter().filter(|row| row.unit == unit && row.status == Status::Ok).count()
}

#[test]
fn a_unit_that_swaps_its_checksum_is_one_finding_and_is_decoded() {
    for batch in recorded_and_live(|mut frame| {
        let end = frame.len();
        frame.swap(end - 2, end - 1);
        frame
    }) {
        let found = details(&batch, Finding::SwappedChecksum);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with("unit 2: ") && found[0].contains(" of 40 responses"), "{found:?}");
        assert!(details(&batch, Finding::BadChecksum).len() <= 6);
        assert!(answered(&batch, 2) >= 34, "{}", answered(&batch, 2));
    }
}

#[test]
fn a_unit_without_checksum_is_one_finding_and_is_decoded() {
    for batch in recorded_and_live(|mut frame| {
        frame.truncate(frame.len() - 2);
        frame
    }) {
        let found = details(&batch, Finding::MissingChecksum);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].starts_with("unit 2: ") && found[0].contains(" of 40 responses"), "{found:?}");
        let bare = batch.frames.iter().filter(|frame| frame.verdict == Verdict::NoChecksum).count();
        assert!(bare >= 30, "{bare}: {found:?}");
        assert!(details(&batch, Finding::Incomplete).len() <= 10);
    }
}

#[test]
fn a_unit_that_pads_its_responses_is_one_finding() {
    let spoils: [(Spoil, &str); 2] = [
        (|frame| [&frame[..], &[0]].concat(), "are followed by 00"),
        (|frame| [&frame[..], &[0xFF, 0xFF]].concat(), "are followed by FF FF"),
    ];
    for (spoil, says) in spoils {
        for batch in recorded_and_live(spoil) {
            let found = details(&batch, Finding::PaddedResponses);
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].starts_with("unit 2: ") && found[0].ends_with(says), "{found:?}");
            assert!(details(&batch, Finding::StrayBytes).len() <= 6);
            assert_eq!(answered(&batch, 2), usize::from(POLLS));
        }
    }
}

#[test]
fn a_gateway_that_answers_as_255_is_one_finding() {
    for batch in recorded_and_live(|frame| {
        let mut content = frame[..frame.len() - 2].to_vec();
        content[0] = 0xFF;
        [&content[..], &crc16(&content).to_le_bytes()].concat()
    }) {
        let found = details(&batch, Finding::AnswersAsOtherUnit);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains(" of 40 requests to unit 2 were answered as unit 255"), "{found:?}");
    }
}

#[test]
fn a_line_on_which_nothing_fits_is_one_finding() {
    // A linear congruential generator; the constants are Knuth's (MMIX).
    let mut state = 1u64;
    let bytes: Vec<u8> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    })
    .take(5000)
    .collect();
    let (mut unfit, _) = session(false, Clock::None);
    let batch = in_pieces(&mut unfit, &bytes, 700);
    assert_eq!(details(&batch, Finding::NoValidFrame).len(), 1);
    let (mut sound, _) = session(false, Clock::None);
    let batch = in_pieces(&mut sound, &frames(|frame| frame).concat(), 700);
    let said = [Finding::NoValidFrame, Finding::SwappedChecksum, Finding::MissingChecksum, Finding::PaddedResponses];
    assert!(said.iter().all(|&finding| details(&batch, finding).is_empty()));
}
