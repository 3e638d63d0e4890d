//! Parts of a recording, observed apart and merged in order, give what one pass gives.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::report::Report;
use modlens_engine::records::Batch;
use proptest::prelude::*;

mod traffic;
use traffic::{batches, fate, Exchange, Fate};

fn observed(batches: &[Batch]) -> Contrast {
    let mut contrast = Contrast::default();
    for batch in batches {
        contrast.observe(batch);
    }
    contrast
}

fn shown(contrast: Contrast) -> String {
    Report::of(contrast).json().to_string()
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
            merged.merge(observed(&batches[from..to]));
            from = to;
        }
        for ((_, one), (_, other)) in whole.clone().into_buses().zip(merged.clone().into_buses()) {
            prop_assert_eq!(&one.units, &other.units);
            prop_assert_eq!(&one.requests, &other.requests);
            prop_assert_eq!(&one.noise, &other.noise);
            prop_assert_eq!(&one.frames, &other.frames);
        }
        prop_assert_eq!(shown(whole), shown(merged));
    }
}

#[test]
fn chunks_of_a_recording_change_nothing() {
    let exchanges: Vec<Exchange> = (0..200).map(|i| (1 + i % 3, Fate::Answered, i % 5, 10)).collect();
    let one_by_one = batches(&exchanges);
    assert!(shown(observed(&one_by_one)).contains("\"verdict\":\"healthy\""));
}
