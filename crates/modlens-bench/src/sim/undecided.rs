//! What no listener can decide on a line with requests that are repeated: the truth allows it, but does not ask for it.

use crate::model::{Direction, Label};
use crate::sim::repeated::MIRRORED_FUNCTIONS;
use crate::sim::scenario::Scenario;
use crate::sim::tap::TapMode;
use crate::sim::truth::TruthFrame;

/// Marks the frames whose direction no listener can tell: in a row of equal frames without times, from the first request without
/// response on; and all of them where the adapter echoes requests, unless polls show that it does. An adapter that holds bytes
/// back as long as units take to respond shows as little of an echo as no clock.
///
/// What would be required of them is then allowed only. `recorded`: the bytes of the only line.
pub(crate) fn mark_undecided(truth: &mut [TruthFrame], recorded: &[u8], scenario: &Scenario, mode: TapMode) {
    let Some(repeated) = &scenario.repeated else { return };
    let hides_echo = scenario.echo > 0.0 && repeated.polls == 0 && mode == TapMode::Ftdi16;
    if mode != TapMode::None && !hides_echo {
        return;
    }
    let bytes = |frame: &TruthFrame| &recorded[frame.start as usize..frame.end as usize];
    let mut from = 0;
    while from < truth.len() {
        let length = truth[from..].iter().take_while(|frame| bytes(frame) == bytes(&truth[from])).count();
        let row = &mut truth[from..from + length];
        let answered: Vec<u32> =
            row.iter().filter(|frame| frame.direction == Direction::Response).map(|frame| frame.txn).collect();
        let shows_no_echo = scenario.echo > 0.0 && repeated.polls == 0;
        let silent = row.iter().position(|frame| !answered.contains(&frame.txn));
        let first = if shows_no_echo { Some(0) } else { silent };
        let is_mirrored = MIRRORED_FUNCTIONS.contains(&row[0].function);
        if let Some(first) = first.filter(|_| length > 1 && is_mirrored) {
            row[first..].iter_mut().for_each(leave_open);
        }
        from += length;
    }
}

fn leave_open(frame: &mut TruthFrame) {
    frame.is_undecided = true;
    for label in [Label::NoResponse, Label::Retry, Label::Echo] {
        frame.labels.remove(label);
        frame.allowed_labels.insert(label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::case::Traffic;

    fn truth(name: &str, mode: TapMode) -> Vec<TruthFrame> {
        Traffic::new(Scenario::named(name).unwrap(), 1, 400).tap(mode).truth
    }

    #[test]
    fn writes_and_their_responses_are_equal_and_alternate() {
        let traffic = Traffic::new(Scenario::named("writes_100ms").unwrap(), 1, 400);
        let bytes = |frame: &TruthFrame| &traffic.lines[0].bytes[frame.start as usize..frame.end as usize];
        assert!(traffic.truth.windows(2).all(|pair| bytes(&pair[0]) == bytes(&pair[1])));
        assert!(traffic.truth.windows(2).all(|pair| pair[0].direction != pair[1].direction));
    }

    #[test]
    fn a_heart_that_dies_sends_requests_only() {
        let truth = truth("heart_dies", TapMode::Exact);
        let dead = &truth[truth.len() / 2 + 2..];
        assert!(dead.iter().all(|frame| frame.direction == Direction::Request && frame.labels.contains(Label::NoResponse)
            || frame.txn == dead[dead.len() - 1].txn));
        assert!(truth[..truth.len() / 2 - 2].iter().filter(|frame| frame.direction == Direction::Response).count() > 90);
    }

    #[test]
    fn only_without_times_something_is_undecided() {
        let undecided = |name, mode| truth(name, mode).iter().filter(|frame| frame.is_undecided).count();
        assert_eq!((undecided("heart_dies", TapMode::Exact), undecided("writes_25ms", TapMode::None)), (0, 0));
        assert!((190..=210).contains(&undecided("heart_dies", TapMode::None)));
        assert_eq!(undecided("echo_25ms", TapMode::None), truth("echo_25ms", TapMode::None).len());
        // Two other units are polled between two heartbeats, so each is alone.
        assert_eq!(undecided("dead_two", TapMode::None), 0);
    }
}
