//! What is not tried in a region cannot change its result. Here is the oracle: candidates of a search that tries every frame at
//! every place, whatever it may be worth.

use crate::damage::candidates::Candidate;
use crate::damage::expected_frame::{expected_frames, poll_request};
use crate::damage::region::UnframedRegion;
use crate::framer::rtu::side::{REQUEST, RESPONSE};
use crate::framer::rtu::traffic_model::{FramePosition, RequestCopy, TrafficModel};
use crate::framer::FramerContext;
use crate::input::Input;
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
        let mut model = TrafficModel::default();
        let mut polled: Vec<Vec<u8>> = polls.iter().map(|&(unit, code, address, value)| framed(vec![unit, code, 0, address, 0, value])).collect();
        polled.sort();
        polled.dedup();
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
        input.push(&Chunk { bytes: &[&[9][..], &bytes, &next].concat(), ..Chunk::default() });
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
        // The cycle holds them in the order in which they came again.
        let in_order: Vec<Vec<u8>> = polled.into_iter().filter(|request| model.poll_cycle.contains(request)).collect();
        let told = |candidates: Vec<Candidate>| -> Vec<String> { candidates.iter().map(|candidate| format!("{candidate:?}")).collect() };
        prop_assert_eq!(told(region.all_candidates()), told(exhaustive(&region, &in_order)));
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
        (0..50).for_each(|_| model.learn_stray_bytes(2));
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
