//! What the search remembers only spares it questions. Here is the oracle: a search that forgets all of it before each byte.

use crate::framer::rtu::search::rejected::RejectedSubstrings;
use crate::framer::rtu::RtuFramer;
use crate::framer::{Framer, FramerContext};
use crate::input::Input;
use modlens_protocol::checksum::crc16;
use modlens_protocol::functions::Functions;
use modlens_readers::chunk::Chunk;
use proptest::prelude::*;

/// The rows of these bytes, of which so many come at a time. Before each question to the framer, a search that `forgets` knows neither what
/// it has rejected, nor where no rival begins.
fn rows(bytes: &[u8], at_a_time: usize, may_look_ahead: bool, forgets: bool) -> Vec<String> {
    let mut framer = RtuFramer::new(None);
    let mut input = Input::new(None);
    input.break_ns = framer.break_ns(None);
    let units = std::array::from_fn(|unit| (1..6).contains(&unit));
    let context = FramerContext { may_look_ahead, ..FramerContext::without_clock(Functions::embedded(), &units) };
    let (mut rows, mut adu) = (Vec::new(), Vec::new());
    let mut chunks = bytes.chunks(at_a_time);
    while !input.is_ended {
        if let Some(bytes) = chunks.next() {
            input.push(&Chunk { bytes, ..Chunk::default() });
        } else {
            (input.is_closed, input.is_ended) = (true, true);
        }
        loop {
            if forgets {
                framer.search.rejected = RejectedSubstrings::default();
                framer.search.skip.no_rival_before = 0;
                framer.search.skip.open_starts.clear();
            }
            let Some(row) = framer.next(&input, &context, &mut adu) else { break };
            rows.push(format!("{} {row:?} {adu:02x?}", input.offset()));
            input.consume(row.length);
        }
    }
    rows
}

fn framed(mut adu: Vec<u8>) -> Vec<u8> {
    adu.extend(crc16(&adu).to_le_bytes());
    adu
}

/// A stretch of a line with trouble: an exchange, perhaps with stray bytes, a bit flipped or the end missing; a vendor's frame; or
/// noise, some of which repeats itself.
fn stretch() -> impl Strategy<Value = Vec<u8>> {
    let strays = || proptest::collection::vec(prop_oneof![Just(0u8), Just(0xFF), any::<u8>()], 0..6);
    let exchange =
        (1u8..6, any::<u16>(), strays(), strays(), proptest::option::weighted(0.3, (any::<usize>(), 0u8..8)), 0usize..30);
    let exchange = exchange.prop_map(|(unit, value, before, between, flipped, missing)| {
        let request = framed(vec![unit, 3, 0, 16 * unit, 0, unit]);
        let data = (0..unit).flat_map(|_| value.to_be_bytes());
        let response = framed([unit, 3, 2 * unit].into_iter().chain(data).collect());
        let mut bytes = [before, request, between, response].concat();
        if let Some((at, bit)) = flipped {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        if missing < 6 {
            bytes.truncate(bytes.len() - missing);
        }
        bytes
    });
    let vendor = (1u8..6, 0x41u8..0x48, proptest::collection::vec(any::<u8>(), 1..30));
    let vendor = vendor.prop_map(|(unit, code, body)| framed([vec![unit, code], body].concat()));
    let part = proptest::collection::vec(prop_oneof![Just(0u8), Just(0xFF), any::<u8>()], 1..7);
    let pattern = (part, 1usize..80).prop_map(|(part, times)| part.repeat(times));
    let noise = proptest::collection::vec(any::<u8>(), 0..80);
    prop_oneof![6 => exchange, 2 => vendor, 1 => pattern, 1 => noise]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn what_is_remembered_changes_no_row(
        stretches in proptest::collection::vec(stretch(), 1..40),
        may_look_ahead in any::<bool>(),
    ) {
        let bytes = stretches.concat();
        let expected = rows(&bytes, 1, may_look_ahead, true);
        prop_assert_eq!(&rows(&bytes, 1, may_look_ahead, false), &expected);
        // What is read ahead, such as where a damaged frame may end, changes no row either.
        prop_assert_eq!(&rows(&bytes, usize::MAX, may_look_ahead, false), &expected);
    }
}

#[test]
fn a_pattern_that_is_full_of_valid_checksums_is_noise_either_way() {
    let bytes = [&framed(vec![1, 3, 0, 16, 0, 1])[..], &[0xFF, 0xFF, 0, 0, 0].repeat(300)].concat();
    assert_eq!(rows(&bytes, 1, true, false), rows(&bytes, 1, true, true));
}
