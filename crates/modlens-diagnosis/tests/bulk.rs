//! Exchanges that went well are counted in bulk: that must give what counting them one by one gives, and compact exchanges what
//! whole rows give.

use modlens_diagnosis::contrast::Contrast;
use modlens_diagnosis::days::Days;
use modlens_diagnosis::report::Report;
use modlens_engine::records::Batch;
use proptest::prelude::*;

mod traffic;
use traffic::{batches, batches_without_clock, fate, Exchange, Fate};

fn counted(batches: &[Batch]) -> Contrast {
    let mut contrast = Contrast::default();
    for batch in batches {
        contrast.observe(batch);
    }
    contrast
}

fn report(contrast: Contrast) -> serde_json::Value {
    Report::of(contrast).json()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// The doctor by days counts each row by itself.
    #[test]
    fn bulk_gives_what_one_by_one_gives(
        exchanges in prop::collection::vec((1u8..4, fate(), 0u8..6, 2i64..300), 100..400),
    ) {
        let batches = batches(&exchanges);
        let mut days = Days::new(None);
        for batch in &batches {
            days.observe(batch);
        }
        let mut day = days.rows().remove(0);
        let row = day.as_object_mut().unwrap();
        for key in ["date", "bus", "seconds"] {
            row.remove(key);
        }
        prop_assert_eq!(day, report(counted(&batches)));
    }

    #[test]
    fn compact_exchanges_give_what_rows_give(
        exchanges in prop::collection::vec((1u8..4, fate(), 0u8..6, 2i64..300), 100..400),
    ) {
        let whole = counted(&batches_without_clock(&exchanges, false));
        let compact = counted(&batches_without_clock(&exchanges, true));
        prop_assert!(whole.clone().into_buses().eq(compact.clone().into_buses()));
        prop_assert_eq!(report(whole), report(compact));
    }
}

#[test]
fn compact_exchanges_are_emitted() {
    let exchanges: Vec<Exchange> = (0..200).map(|i| (1 + i % 3, Fate::Answered, i % 5, 10)).collect();
    let batches = batches_without_clock(&exchanges, true);
    let compact: usize = batches.iter().map(|batch| batch.exchanges.len()).sum();
    let in_rows: usize = batches.iter().map(|batch| batch.transactions.len()).sum();
    assert_eq!(compact + in_rows, 200);
    assert!(compact > 150, "{compact}");
}
