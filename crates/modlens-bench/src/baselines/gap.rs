//! The rule of the specification: a silence ends a frame (serial line specification, 2.5.1.1).

use crate::baselines::lines::is_rtu;
use crate::baselines::pairing::{pair_lines, Pairing};
use crate::checksum::crc_fits;
use crate::reported::{Algorithm, Reported};
use crate::score::score;
use crate::sim::case::{Case, CaseLine};

/// Cuts at silences, with the best of seven thresholds: an oracle that no tool has.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gap;

/// Thresholds other than t3.5, in ms.
const THRESHOLDS: [f64; 6] = [3.0, 5.0, 10.0, 20.0, 35.0, 50.0];

impl Algorithm for Gap {
    fn name(&self) -> &'static str {
        "gap"
    }

    fn run(&mut self, case: &Case) -> Vec<Reported> {
        let thresholds = std::iter::once(case.settings.t35_ns()).chain(THRESHOLDS.map(|ms| ms * 1e6));
        let runs = thresholds.map(|threshold| cut(case, threshold));
        let best = runs.max_by(|a, b| score(case, a).fd().f1().total_cmp(&score(case, b).fd().f1()));
        best.expect("there are seven thresholds")
    }

    fn reads(&self, case: &Case) -> bool {
        is_rtu(case)
    }
}

/// The pieces between silences longer than this.
pub(crate) fn cut(case: &Case, threshold: f64) -> Vec<Reported> {
    let mut pieces = Vec::new();
    for line in &case.lines {
        cut_line(line, case.settings.char_ns(), threshold, &mut pieces);
    }
    let bytes = |frame: &Reported| case.bytes(frame.line)[frame.start as usize..frame.end as usize].to_vec();
    if case.lines.len() > 1 {
        return pair_lines(pieces, bytes);
    }
    let mut pairing = Pairing::default();
    let paired = pieces.into_iter().map(|(_, mut frame)| {
        if frame.crc_ok {
            pairing.place(&bytes(&frame), &mut frame);
        }
        frame
    });
    paired.collect()
}

/// Pieces of a line with the times of their last reads.
fn cut_line(line: &CaseLine, char_ns: f64, threshold: f64, pieces: &mut Vec<(i64, Reported)>) {
    let (mut start, mut end) = (0usize, 0usize);
    let mut before: Option<i64> = None;
    let mut order = 0;
    let mut close = |start: usize, end: usize, order: i64| {
        let piece = &line.bytes[start..end];
        let crc_ok = (4..=256).contains(&piece.len()) && crc_fits(piece);
        pieces.push((order, Reported::new(line.id, start as u64, end as u64, crc_ok)));
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
