//! Transactions that are counted in bulk leave every counter as it is when each is counted by itself.

use modlens_engine::records::Batch;
use modlens_protocol::functions::Functions;
use proptest::prelude::*;

use super::{BusContrast, Contrast};
use crate::observation::{FrameObservation, Observation};

#[path = "../../tests/traffic/mod.rs"]
mod traffic;
use traffic::{batches, batches_without_clock, fate, good_fate, Exchange, Fate};

/// What is counted of rows of which nothing is known but that they are there.
fn one_by_one(batches: &[Batch]) -> Contrast {
    let mut contrast = Contrast::default();
    for batch in batches {
        for row in &batch.frames {
            contrast.bus(batch, row.bus).frame(FrameObservation::of(batch, row));
        }
        for row in batch.all_transactions() {
            contrast.bus(batch, row.bus).transaction(Observation::of(batch, Functions::embedded(), row));
        }
    }
    contrast
}

fn in_bulk(batches: &[Batch]) -> Contrast {
    let mut contrast = Contrast::default();
    for batch in batches {
        contrast.observe(batch);
    }
    contrast
}

/// All that was counted.
fn counters(contrast: Contrast) -> Vec<(String, BusContrast)> {
    contrast.into_buses().collect()
}

/// Exchanges of a line with good and bad stretches.
fn exchanges() -> impl Strategy<Value = Vec<Exchange>> {
    let some = |fate: BoxedStrategy<Fate>, most: usize| prop::collection::vec((1u8..4, fate, 0u8..6, 2i64..300), 0..most);
    let stretch = prop_oneof![3 => some(good_fate().boxed(), 200), 1 => some(fate().boxed(), 20)];
    prop::collection::vec(stretch, 1..6).prop_map(|stretches| stretches.concat())
}

/// A poll cycle of more requests than are counted, or known at a time, with some that come again and again between them.
fn many_requests(count: u16, often: u8) -> Vec<Exchange> {
    let wide = (0..count).map(|at| (1 + (at >> 8) as u8, Fate::Writes(at as u8), at as u8, 10));
    wide.flat_map(|one| [one, (1, Fate::Answered, often, 10), (1, Fate::Says([one.2, 0, 9, 9]), one.2, 10)]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn rows_in_bulk_leave_the_counters_of_single_ones(exchanges in exchanges()) {
        let batches = batches(&exchanges);
        prop_assert_eq!(counters(in_bulk(&batches)), counters(one_by_one(&batches)));
    }

    #[test]
    fn compact_exchanges_leave_the_counters_of_single_rows(exchanges in exchanges()) {
        let rows = batches_without_clock(&exchanges, false);
        let compact = batches_without_clock(&exchanges, true);
        prop_assert_eq!(counters(in_bulk(&compact)), counters(one_by_one(&rows)));
    }
}

#[test]
fn requests_without_room_are_counted_as_single_rows_are() {
    let exchanges = many_requests(3000, 3);
    let rows = batches_without_clock(&exchanges, false);
    let compact = batches_without_clock(&exchanges, true);
    let (bulk, single) = (in_bulk(&compact), one_by_one(&rows));
    assert!(bulk.extent().has_overflowed && single.extent().has_overflowed);
    // Too much to be shown.
    assert!(counters(bulk) == counters(single));
}
