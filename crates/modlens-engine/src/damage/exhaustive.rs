//! What is not tried in a region cannot change its result. Here is the oracle: candidates of a search that tries every frame at
//! every place, whatever it may be worth.

use crate::damage::candidates::Candidate;
use crate::damage::expected_frame::{expected_frames, poll_request};
use crate::damage::region::UnframedRegion;
use crate::frame_result::FramerContext;
use crate::input::Input;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{FramePosition, RequestCopy, TrafficModel};
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::functions::Functions;
use modlens_readers::chunk::Chunk;
use proptest::prelude::*;

fn framed(mut adu: Vec<u8>) -> Vec<u8> {
    adu.extend(crc16(&adu).to_le_bytes());
    adu
}

/// All candidates, by the slow way. Requests of the poll cycle are those of `polled`.
fn exhaustive(region: &UnframedRegion<'_, '_>, polled: &[Vec<u8>]) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    for start in 0..region.length {
        let mut of_these: Vec<Candidate> = Vec::new();
        for expected in expected_frames(region) {
            of_these.extend(region.candidate_worth(&expected, start, f32::MIN));
        }
        for request in polled {
            of_these.extend(region.candidate_worth(&poll_request(request), start, f32::MIN));
        }
        if region.context.known_units[usize::from(region.bytes()[start])] || region.input.offset() == 0 {
            for direction in [REQUEST, RESPONSE] {
                of_these.extend(region.unpredicted_candidate(start, direction));
            }
        }
        candidates.append(&mut of_these);
    }
    candidates
}

/// Bytes as a region may have them: frames, whole or damaged, and noise.
fn region_bytes() -> impl Strategy<Value = Vec<u8>> {
    let part = prop_oneof![
        (1u8..5, prop_oneof![Just(3u8), Just(6), Just(0x83)], proptest::collection::vec(0u8..4, 1..5), any::<usize>(), 0u8..4)
            .prop_map(|(unit, code, body, at, how)| {
                let mut frame = framed([vec![unit, code], body].concat());
                let at = at % frame.len();
                match how {
                    0 => drop(frame.remove(at)),
                    1 => frame[at] ^= 4,
                    2 => frame.insert(at, frame[at]),
                    _ => {}
                }
                frame
            }),
        proptest::collection::vec(prop_oneof![Just(0u8), Just(0xFF), any::<u8>(), 1u8..5], 1..8),
    ];
    proptest::collection::vec(part, 1..4).prop_map(|parts| parts.concat())
}

/// What the line has shown before the region, and how the region is framed.
#[derive(Clone, Copy, Debug)]
struct Circumstances {
    /// Requests that came after two rounds of all polls.
    frames: usize,
    asked: bool,
    is_first: bool,
    ends_as_announced: bool,
}

/// Returns the candidates in a region of these bytes on a line with these polls, those of the slow way by the poll cycle, and those of
/// the slow way by the dictionary, which may know requests that are not in the cycle.
fn candidates_of(bytes: &[u8], polled: &[Vec<u8>], given: Circumstances) -> [Vec<String>; 3] {
    let Circumstances { frames, asked, is_first, ends_as_announced } = given;
    let mut model = TrafficModel::default();
    for request in polled.iter().cycle().take(if polled.is_empty() { 0 } else { 2 * polled.len() + frames }) {
        let position = FramePosition { request_outstanding: false, unframed_bytes: 0 };
        model.learn(request, REQUEST, position, RequestCopy::First);
    }
    model.learn_flow_control(&[0x11]);
    model.update_costs();
    let units = std::array::from_fn(|unit| (1..5).contains(&unit));
    let request = RequestRef { unit: 2, pdu: &[3, 0, 1, 0, 2] };
    let context = FramerContext {
        outstanding_request: asked.then_some(request),
        ..FramerContext::without_clock(Functions::embedded(), &units)
    };
    let next = framed(vec![3, 3, 0, 1, 0, 1]);
    let mut input = Input::new(None);
    input.push(&Chunk { bytes: &[&[9][..], bytes, &next].concat(), ..Chunk::default() });
    if !is_first {
        input.consume(1);
    }
    let region = UnframedRegion {
        model: &model,
        context: &context,
        input: &input,
        length: bytes.len(),
        next_frame: Some((&next, Direction::Request)),
        follows_damaged_frame: false,
        frame_gap_ns: 5_000_000,
        ends_as_announced,
    };
    let known: Vec<Vec<u8>> = polled.iter().filter(|request| model.poll_cycle.contains(request)).cloned().collect();
    [region.all_candidates(), exhaustive(&region, &model.poll_cycle.all()), exhaustive(&region, &known)]
        .map(|candidates| candidates.iter().map(|candidate| format!("{candidate:?}")).collect())
}

/// Two requests that want the same slot of the dictionary take it from each other, so that it knows one of them and neither joins
/// the cycle. The oracle tries what is in the cycle: until it went by the dictionary, it disagreed here.
#[test]
fn a_request_that_shares_its_slot_is_no_poll_of_the_cycle() {
    let all: Vec<Vec<u8>> = (1..5)
        .flat_map(|unit| (0..4).flat_map(move |address| (0..4).map(move |value| framed(vec![unit, 3, 0, address, 0, value]))))
        .collect();
    let given = Circumstances { frames: 1, asked: false, is_first: false, ends_as_announced: false };
    let mut sharing = 0;
    for (at, one) in all.iter().enumerate() {
        for other in &all[at + 1..] {
            let mut lost_bytes = one.clone();
            lost_bytes.remove(2);
            let [tried, every, by_dictionary] = candidates_of(&lost_bytes, &[one.clone(), other.clone()], given);
            assert_eq!(tried, every, "{one:02x?} {other:02x?}");
            sharing += usize::from(tried != by_dictionary);
        }
    }
    assert!(sharing > 0, "no two of these requests want the same slot");
}

proptest! {
    #[test]
    fn what_is_not_tried_is_no_candidate(
        bytes in region_bytes(),
        polls in proptest::collection::vec((1u8..5, prop_oneof![Just(3u8), Just(6)], 0u8..4, 0u8..4), 0..12),
        frames in 0usize..200,
        asked in any::<bool>(),
        is_first in any::<bool>(),
        ends_as_announced in any::<bool>(),
    ) {
        let mut polled: Vec<Vec<u8>> = polls.iter().map(|&(unit, code, address, value)| framed(vec![unit, code, 0, address, 0, value])).collect();
        polled.sort();
        polled.dedup();
        let [tried, every, _] = candidates_of(&bytes, &polled, Circumstances { frames, asked, is_first, ends_as_announced });
        prop_assert_eq!(tried, every);
    }

    #[test]
    fn what_a_line_driver_has_left_on_a_noisy_line_is_nothing_else(
        glitch in prop_oneof![Just(0u8), Just(0x80), Just(0xF8), Just(0xFF)],
        length in 1usize..4,
        asked in any::<bool>(),
        is_request in any::<bool>(),
        follows_damaged_frame in any::<bool>(),
    ) {
        let mut model = TrafficModel::default();
        (0..50).for_each(|_| model.count_frame_after_stray_bytes(2));
        let units = [true; 256];
        let request = RequestRef { unit: glitch, pdu: &[3, 0, 1, 0, 2] };
        let context = FramerContext {
            outstanding_request: asked.then_some(request),
            ..FramerContext::without_clock(Functions::embedded(), &units)
        };
        let next = framed(vec![3, 3, 0, 1, 0, 1]);
        let mut input = Input::new(None);
        input.push(&Chunk { bytes: &[&[9][..], &vec![glitch; length], &next].concat(), ..Chunk::default() });
        input.consume(1);
        let direction = if is_request { Direction::Request } else { Direction::Response };
        let region = UnframedRegion {
            model: &model,
            context: &context,
            input: &input,
            length,
            next_frame: Some((&next, direction)),
            follows_damaged_frame,
            frame_gap_ns: 5_000_000,
            ends_as_announced: false,
        };
        prop_assert!(region.is_mere_glitch());
        prop_assert!(region.damaged_frames_of_any().is_empty());
    }
}
