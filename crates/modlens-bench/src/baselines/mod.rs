//! The rivals: what other tools do, each at its best.
//!
//! - [`Gap`]: cuts at silences, with the best of seven thresholds, which an oracle chooses for every case.
//! - [`Length`]: predicts the length from the header, both ways, and accepts what the CRC confirms.
//! - [`Scan`]: accepts the first length that the CRC confirms.
//! - [`Colon`]: ASCII, from a colon to CR LF.

mod colon;
mod gap;
mod greedy;
mod layout;
mod pairing;

pub use colon::Colon;
pub use gap::Gap;
pub use greedy::{Length, Scan};

use crate::model::Framing;
use crate::reported::{Algorithm, Reported};
use crate::sim::case::Case;

/// All of them, in the order of the tables.
pub fn all() -> Vec<Box<dyn Algorithm>> {
    vec![Box::new(Gap), Box::new(Length), Box::new(Scan), Box::new(Colon)]
}

fn is_rtu(case: &Case) -> bool {
    case.framing == Framing::Rtu
}

/// Runs a finder over every line of a case and pairs what it finds.
///
/// `find` gets the bytes of a line and a slot for pairing; on two lines pairing comes afterwards, in order of time.
fn by_line(case: &Case, find: impl Fn(&[u8], u8, &mut pairing::Pairing) -> Vec<Reported>) -> Vec<Reported> {
    if let [line] = &case.lines[..] {
        return find(&line.bytes, line.id, &mut pairing::Pairing::default());
    }
    let mut frames = Vec::new();
    for line in &case.lines {
        let mut order = order_of(&line.reads);
        let found = find(&line.bytes, line.id, &mut pairing::Pairing::default());
        frames.extend(found.into_iter().map(|mut frame| {
            frame.txn = None;
            (order(frame.end - 1), frame)
        }));
    }
    pairing::pair_lines(frames, |frame| case.bytes(frame.line)[frame.start as usize..frame.end as usize].to_vec())
}

/// When the byte at this offset was read; offsets must not go back.
fn order_of(reads: &[crate::sim::tap::Read]) -> impl FnMut(u64) -> i64 + '_ {
    let (mut at, mut end) = (0, 0u64);
    move |offset| {
        while at < reads.len() && end + u64::from(reads[at].length) <= offset {
            end += u64::from(reads[at].length);
            at += 1;
        }
        reads.get(at).map_or(i64::MAX, |read| read.order)
    }
}
