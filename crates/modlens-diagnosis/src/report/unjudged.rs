//! What the recording cannot tell, and which one could.

use modlens_protocol::framing::{Mode, Verdict};
use serde_json::{json, Value as Json};

use crate::contrast::BusContrast;

/// Requests below which shares say little.
const FEW: u64 = 10;

/// What could not be judged on a bus.
pub(super) fn of_bus(name: &str, bus: &BusContrast) -> Vec<Json> {
    let mut found = Vec::new();
    let mut say = |what: &str, needs: &str| found.push(json!({"bus": name, "what": what, "needs": needs}));
    let requests = bus.requests_seen.total;
    if requests < FEW {
        say("too few requests for shares", "a longer recording: ten requests to each unit at least, a hundred are better");
    }
    if requests > 0 && requests == bus.requests_seen.failed && bus.frames.frames[Verdict::Noise as usize] == 0 {
        say(
            "whether the units answer at all: no answer is in the recording",
            "a recording that hears both directions, such as a tap on the line itself",
        );
    }
    let has_times = bus.units.values().any(|unit| unit.response_times.count + unit.waited.count > 0);
    if requests > 0 && !has_times {
        say(
            "pace and time-outs: the recording has no clock, or one that is too coarse",
            "a recording with times of a millisecond or better, such as one of modlens tap",
        );
    }
    if bus.frames.frames[Verdict::NoChecksum as usize] > 0 {
        say("damage on the wire: the recording has no checksums", "a recording of the bytes on the wire");
    }
    if bus.facts.mode == Some(Mode::Rtu) && !bus.facts.is_network && bus.facts.char_ns.is_none() && requests > 0 {
        say("how full the line is: its settings are not known", "the line settings: --line 19200-8E1, for instance");
    }
    found
}
