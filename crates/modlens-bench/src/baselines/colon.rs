//! ASCII as the specification describes it: a colon begins a frame, CR LF ends it (2.5.2).

use crate::baselines::lines::by_line;
use crate::baselines::pairing::RivalPairing;
use crate::checksum::{crc, lrc};
use crate::model::Framing;
use crate::reported::{Algorithm, ReportedFrame};
use crate::sim::case::Case;

/// Cuts frames from a colon to CR LF; a further colon begins a new frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Colon;

impl Algorithm for Colon {
    fn name(&self) -> &'static str {
        "colon"
    }

    fn run(&mut self, case: &Case) -> Vec<ReportedFrame> {
        let mut frames = by_line(case, find_frames);
        frames.sort_by_key(|frame| (frame.line, frame.start));
        frames
    }

    fn uses_times(&self) -> bool {
        false
    }

    fn reads(&self, case: &Case) -> bool {
        case.framing == Framing::Ascii
    }
}

/// All frames of a line.
fn find_frames(bytes: &[u8], line: u8, pairing: &mut RivalPairing) -> Vec<ReportedFrame> {
    let mut frames = Vec::new();
    let mut start = None;
    for (at, &byte) in bytes.iter().enumerate() {
        match byte {
            b':' => start = Some(at),
            b'\n' if at > 0 && bytes[at - 1] == b'\r' => {
                if let Some(start) = start.take() {
                    let body = decode(&bytes[start + 1..at - 1]);
                    let mut frame = ReportedFrame::new(line, start as u64, at as u64 + 1, body.is_some());
                    if let Some(body) = body {
                        // The table of lengths is for RTU frames, which have two bytes of checksum instead of one.
                        let mut rtu = body[..body.len() - 1].to_vec();
                        let crc = crc(&rtu);
                        rtu.extend(crc.to_le_bytes());
                        pairing.assign(&rtu, &mut frame);
                    }
                    frames.push(frame);
                }
            }
            _ => {}
        }
    }
    frames
}

/// Decodes unit, PDU and LRC; `None` if there is a character that is no hex digit or if the LRC is invalid.
fn decode(digits: &[u8]) -> Option<Vec<u8>> {
    if digits.len() % 2 == 1 || digits.len() < 6 {
        return None;
    }
    let digit = |byte: u8| char::from(byte).to_digit(16).map(|digit| digit as u8);
    let bytes: Option<Vec<u8>> = digits.chunks(2).map(|pair| Some(digit(pair[0])? << 4 | digit(pair[1])?)).collect();
    bytes.filter(|bytes| lrc(bytes) == 0)
}
