//! The latency of live reports: the time from the read of a frame's last byte to the report of the frame.

use crate::reported::ReportedFrame;
use crate::sim::case::Case;

/// Latencies of live reports.
#[derive(Clone, Debug, Default)]
pub struct Latency {
    ns: Vec<i64>,
}

impl Latency {
    pub(crate) fn of(case: &Case, reported: &[ReportedFrame]) -> Self {
        let mut ns = Vec::new();
        for line in &case.lines {
            let mut frames: Vec<(u64, i64)> = reported
                .iter()
                .filter(|frame| frame.line == line.id && frame.is_whole)
                .filter_map(|frame| Some((frame.end - 1, frame.emitted_ns?)))
                .collect();
            frames.sort_unstable();
            let mut reads = case.read_times(line.id);
            ns.extend(frames.into_iter().filter_map(|(last, emitted)| Some(emitted - reads.at(last)?)));
        }
        Self { ns }
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.ns.extend(&other.ns);
    }

    /// Whether anything was measured.
    pub fn is_empty(&self) -> bool {
        self.ns.is_empty()
    }

    /// The median, the 95th and the 99th percentile, and the maximum, in ms.
    pub fn percentiles(&self) -> [f64; 4] {
        let mut sorted = self.ns.clone();
        sorted.sort_unstable();
        [0.50, 0.95, 0.99, 1.0].map(|share| {
            let at = (share * (sorted.len().max(1) - 1) as f64).round() as usize;
            sorted.get(at).map_or(0.0, |&ns| ns as f64 / 1e6)
        })
    }
}
