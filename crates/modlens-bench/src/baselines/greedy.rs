//! Greedy methods that accept the first frame with a valid CRC: of the predicted lengths, or of all lengths.

use crate::baselines::layout::{request_length, response_length};
use crate::baselines::lines::{by_line, is_rtu};
use crate::baselines::pairing::RivalPairing;
use crate::checksum::{crc_fits, step};
use crate::model::Direction;
use crate::reported::{Algorithm, ReportedFrame};
use crate::sim::case::Case;

/// The shortest RTU frame (serial line specification, 2.5.1).
const MIN_FRAME_BYTES: usize = 4;

/// The longest RTU frame (serial line specification, 2.5.1).
const MAX_FRAME_BYTES: usize = 256;

/// Predicts the length from the header, as request and as response.
#[derive(Clone, Copy, Debug, Default)]
pub struct Length;

/// Accepts the first length that gives a valid CRC.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scan;

impl Algorithm for Length {
    fn name(&self) -> &'static str {
        "length"
    }

    fn run(&mut self, case: &Case) -> Vec<ReportedFrame> {
        by_line(case, find_by_predicted_length)
    }

    fn uses_times(&self) -> bool {
        false
    }

    fn reads(&self, case: &Case) -> bool {
        is_rtu(case)
    }
}

impl Algorithm for Scan {
    fn name(&self) -> &'static str {
        "scan"
    }

    fn run(&mut self, case: &Case) -> Vec<ReportedFrame> {
        by_line(case, find_by_all_lengths)
    }

    fn uses_times(&self) -> bool {
        false
    }

    fn reads(&self, case: &Case) -> bool {
        is_rtu(case)
    }
}

/// All frames of a line whose length the header predicts; the direction that the pairing expects is tried first.
fn find_by_predicted_length(bytes: &[u8], line: u8, pairing: &mut RivalPairing) -> Vec<ReportedFrame> {
    let mut frames = Vec::new();
    let mut at = 0;
    while at + MIN_FRAME_BYTES <= bytes.len() {
        let rest = &bytes[at..];
        let mut candidates = [(Direction::Request, request_length(rest)), (Direction::Response, response_length(rest))];
        if pairing.expects(rest) {
            candidates.swap(0, 1);
        }
        let fits = |length: usize| length <= MAX_FRAME_BYTES && length <= rest.len() && crc_fits(&rest[..length]);
        let found = candidates.into_iter().find_map(|(direction, length)| Some((direction, length.filter(|&n| fits(n))?)));
        at += found.map_or(1, |(direction, length)| {
            let mut frame = ReportedFrame::new(line, at as u64, (at + length) as u64, true);
            pairing.assign_with_direction(direction, &rest[..length], &mut frame);
            frames.push(frame);
            length
        });
    }
    frames
}

/// All frames of a line, each of the shortest length that gives a valid CRC.
fn find_by_all_lengths(bytes: &[u8], line: u8, pairing: &mut RivalPairing) -> Vec<ReportedFrame> {
    let mut frames = Vec::new();
    let mut at = 0;
    while at + MIN_FRAME_BYTES <= bytes.len() {
        let rest = &bytes[at..];
        at += first_valid_length(rest).map_or(1, |length| {
            let mut frame = ReportedFrame::new(line, at as u64, (at + length) as u64, true);
            pairing.assign(&rest[..length], &mut frame);
            frames.push(frame);
            length
        });
    }
    frames
}

/// The length of the shortest prefix that ends with its CRC, after which the register is 0.
fn first_valid_length(bytes: &[u8]) -> Option<usize> {
    let mut state = 0xFFFF;
    for (at, &byte) in bytes.iter().take(MAX_FRAME_BYTES).enumerate() {
        state = step(state, byte);
        if state == 0 && at + 1 >= MIN_FRAME_BYTES {
            return Some(at + 1);
        }
    }
    None
}
