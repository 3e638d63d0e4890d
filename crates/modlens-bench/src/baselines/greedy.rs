//! Greedy finders that go by the CRC: predicted lengths, and all lengths.

use crate::baselines::layout::{request_length, response_length};
use crate::baselines::lines::{by_line, is_rtu};
use crate::baselines::pairing::Pairing;
use crate::checksum::{crc_fits, step};
use crate::model::Direction;
use crate::reported::{Algorithm, Reported};
use crate::sim::case::Case;

/// The longest and the shortest RTU frame (serial line specification, 2.5.1).
const LIMITS: (usize, usize) = (4, 256);

/// Predicts the length from the header, as request and as response.
#[derive(Clone, Copy, Debug, Default)]
pub struct Length;

/// Accepts the first length that the CRC confirms.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scan;

impl Algorithm for Length {
    fn name(&self) -> &'static str {
        "length"
    }

    fn run(&mut self, case: &Case) -> Vec<Reported> {
        by_line(case, predicted)
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

    fn run(&mut self, case: &Case) -> Vec<Reported> {
        by_line(case, scanned)
    }

    fn uses_times(&self) -> bool {
        false
    }

    fn reads(&self, case: &Case) -> bool {
        is_rtu(case)
    }
}

fn predicted(bytes: &[u8], line: u8, pairing: &mut Pairing) -> Vec<Reported> {
    let mut frames = Vec::new();
    let mut at = 0;
    while at + LIMITS.0 <= bytes.len() {
        let rest = &bytes[at..];
        let mut readings = [(Direction::Request, request_length(rest)), (Direction::Response, response_length(rest))];
        if pairing.expects(rest) {
            readings.swap(0, 1);
        }
        let fits = |length: usize| length <= LIMITS.1 && length <= rest.len() && crc_fits(&rest[..length]);
        let found = readings.into_iter().find_map(|(direction, length)| Some((direction, length.filter(|&n| fits(n))?)));
        at += found.map_or(1, |(direction, length)| {
            let mut frame = Reported::new(line, at as u64, (at + length) as u64, true);
            pairing.place_as(direction, &rest[..length], &mut frame);
            frames.push(frame);
            length
        });
    }
    frames
}

fn scanned(bytes: &[u8], line: u8, pairing: &mut Pairing) -> Vec<Reported> {
    let mut frames = Vec::new();
    let mut at = 0;
    while at + LIMITS.0 <= bytes.len() {
        let rest = &bytes[at..];
        at += first_fit(rest).map_or(1, |length| {
            let mut frame = Reported::new(line, at as u64, (at + length) as u64, true);
            pairing.place(&rest[..length], &mut frame);
            frames.push(frame);
            length
        });
    }
    frames
}

/// The shortest prefix whose last two bytes are its CRC: the register is 0 behind it.
fn first_fit(bytes: &[u8]) -> Option<usize> {
    let mut state = 0xFFFF;
    for (at, &byte) in bytes.iter().take(LIMITS.1).enumerate() {
        state = step(state, byte);
        if state == 0 && at + 1 >= LIMITS.0 {
            return Some(at + 1);
        }
    }
    None
}
