//! Frames by the rule of the specification: a silence ends a frame (serial line specification, 2.5.1.1).

use crate::baselines::lines::is_rtu;
use crate::baselines::pairing::{pair_lines, RivalPairing};
use crate::checksum::crc_fits;
use crate::reported::{Algorithm, ReportedFrame};
use crate::score::score;
use crate::sim::case::{Case, CaseLine};

/// Cuts at silences, with the threshold of seven that gives the best score. No real tool has such an oracle.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gap;

/// The thresholds that are tried besides t3.5, in ms.
const THRESHOLDS_MS: [f64; 6] = [3.0, 5.0, 10.0, 20.0, 35.0, 50.0];

impl Algorithm for Gap {
    fn name(&self) -> &'static str {
        "gap"
    }

    fn run(&mut self, case: &Case) -> Vec<ReportedFrame> {
        let thresholds = std::iter::once(case.settings.t35_ns()).chain(THRESHOLDS_MS.map(|ms| ms * 1e6));
        let runs = thresholds.map(|threshold| cut(case, threshold));
        let best = runs
            .max_by(|a, b| score(case, a).frames_with_direction().f1().total_cmp(&score(case, b).frames_with_direction().f1()));
        best.expect("there are seven thresholds")
    }

    fn reads(&self, case: &Case) -> bool {
        is_rtu(case)
    }
}

/// The blocks between silences that are longer than `threshold` ns.
pub(crate) fn cut(case: &Case, threshold: f64) -> Vec<ReportedFrame> {
    let mut pieces = Vec::new();
    for line in &case.lines {
        cut_line(line, case.settings.char_ns(), threshold, &mut pieces);
    }
    let bytes = |frame: &ReportedFrame| case.bytes(frame.line)[frame.start as usize..frame.end as usize].to_vec();
    if case.lines.len() > 1 {
        return pair_lines(pieces, bytes);
    }
    let mut pairing = RivalPairing::default();
    let paired = pieces.into_iter().map(|(_, mut frame)| {
        if frame.is_whole {
            pairing.assign(&bytes(&frame), &mut frame);
        }
        frame
    });
    paired.collect()
}

/// Blocks of a line with the times of their last reads.
fn cut_line(line: &CaseLine, char_ns: f64, threshold: f64, pieces: &mut Vec<(i64, ReportedFrame)>) {
    let (mut start, mut end) = (0usize, 0usize);
    let mut before: Option<i64> = None;
    let mut order = 0;
    let mut close = |start: usize, end: usize, order: i64| {
        let piece = &line.bytes[start..end];
        let is_whole = (4..=256).contains(&piece.len()) && crc_fits(piece);
        pieces.push((order, ReportedFrame::new(line.id, start as u64, end as u64, is_whole)));
    };
    for read in &line.reads {
        if let (Some(now), Some(before)) = (read.time, before) {
            let silence = (now - before) as f64 - f64::from(read.length) * char_ns;
            if silence > threshold && end > start {
                close(start, end, order);
                start = end;
            }
        }
        (before, order) = (read.time, read.order);
        end += read.length as usize;
    }
    if end > start {
        close(start, end, order);
    }
}
