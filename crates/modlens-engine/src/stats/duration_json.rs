//! Durations as the statistics write them, in microseconds.

use serde_json::{json, Value as Json};

use crate::durations::{eighth_edge, Durations};
use modlens_protocol::Ns;

/// Count, extremes, mean and percentiles, and how exact these are; null of none.
pub(super) fn summary(durations: &Durations) -> Json {
    let (Some((least, most)), Some(mean)) = (durations.range(), durations.mean()) else { return Json::Null };
    json!({
        "count": durations.count, "min_us": us(least), "mean_us": mean / 1000.0,
        "p50_us": percentile(durations, 0.5), "p95_us": percentile(durations, 0.95), "max_us": us(most),
        "percentile_error": durations.error(),
    })
}

/// As `summary`, with the 99th percentile and the counts for each eighth of an octave: their edges, one more than there are
/// counts.
pub(super) fn with_buckets(durations: &Durations) -> Json {
    let mut found = summary(durations);
    if found.is_null() {
        return found;
    }
    let (first, counts) = durations.by_eighths();
    let edges: Vec<f64> = (first..=first + counts.len()).map(|eighth| eighth_edge(eighth) / 1000.0).collect();
    found["p99_us"] = json!(percentile(durations, 0.99));
    found["histogram"] = json!({"edges_us": edges, "counts": counts});
    found
}

fn percentile(durations: &Durations, share: f64) -> Option<f64> {
    durations.percentile(share).map(us)
}

fn us(ns: Ns) -> f64 {
    ns as f64 / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_stand_between_their_edges() {
        let mut times = Durations::default();
        // An octave from 2^20 ns has eighths of 2^17 ns = 131.072 us.
        for ns in [1 << 20, (1 << 20) + (1 << 17) - 1, (1 << 20) + (1 << 17)] {
            times.add(ns);
        }
        let found = with_buckets(&times);
        assert_eq!(found["histogram"]["counts"], json!([2, 1]));
        assert_eq!(found["histogram"]["edges_us"], json!([1048.576, 1179.648, 1310.72]));
        assert_eq!((&found["p99_us"], &found["percentile_error"]), (&found["max_us"], &json!(0.0)));
        assert_eq!(with_buckets(&Durations::default()), Json::Null);
    }
}
