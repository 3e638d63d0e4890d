//! Pauses inside frames that come through an adapter which holds bytes back.
//!
//! A read that ends inside a frame may make the bytes after it look late: by the latency timer of the adapter, or by a host
//! that is busy now and then. A single long pause proves nothing there. It is the sender's if one sender has it again and again
//! and the others on the same line do not: adapter and host delay the frames of all alike.

use modlens_protocol::direction::Direction;
use modlens_protocol::Ns;

/// By so much an adapter and its driver make a read late as a matter of course: FTDI's latency timer is 16 ms by default.
const USUAL_LATENESS_NS: Ns = 20_000_000;

/// Frames with such a pause from which on it is a habit of their sender, ...
const MIN_FRAMES: u16 = 4;
/// ... if at least one in so many of its frames has it, ...
const FRAMES_PER_PAUSE: u16 = 4;
/// ... and at most one in so many of those of all others.
const OTHERS_PER_PAUSE: u16 = 20;

/// Frames of one sender that came in several reads.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    frames: u16,
    with_pause: u16,
}

impl Counts {
    fn add(&mut self, has_pause: bool) {
        if self.frames == u16::MAX {
            (self.frames, self.with_pause) = (self.frames / 2, self.with_pause / 2);
        }
        self.frames += 1;
        self.with_pause += u16::from(has_pause);
    }
}

/// The pauses inside the frames of a line, by sender.
#[derive(Debug, Default)]
pub(crate) struct InnerPauses {
    /// Masters, and units by number. Empty until a frame has a long pause.
    senders: Vec<Counts>,
}

impl InnerPauses {
    /// Counts a good frame with this longest pause between its reads; gives the part of that pause which its sender must have
    /// made, if there is any.
    pub(crate) fn add(&mut self, direction: Direction, unit: u8, longest: Option<Ns>) -> Option<Ns> {
        let longest = longest?;
        let proven = longest - USUAL_LATENESS_NS;
        if proven <= 0 && self.senders.is_empty() {
            return None;
        }
        self.senders.resize(257, Counts::default());
        let sender = if direction == Direction::Response { 1 + usize::from(unit) } else { 0 };
        self.senders[sender].add(proven > 0);
        (proven > 0 && self.is_habit_of(sender)).then_some(proven)
    }

    fn is_habit_of(&self, sender: usize) -> bool {
        let own = self.senders[sender];
        let sum = |count: fn(&Counts) -> u16| self.senders.iter().map(|counts| u64::from(count(counts))).sum::<u64>();
        let others = sum(|counts| counts.frames) - u64::from(own.frames);
        let others_with_pause = sum(|counts| counts.with_pause) - u64::from(own.with_pause);
        let is_frequent = own.with_pause >= MIN_FRAMES && own.frames / FRAMES_PER_PAUSE <= own.with_pause;
        is_frequent && others >= u64::from(MIN_FRAMES) && others_with_pause * u64::from(OTHERS_PER_PAUSE) <= others
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    #[test]
    fn a_pause_is_proven_where_one_sender_has_it_again_and_again() {
        let mut pauses = InnerPauses::default();
        let mut proven = Vec::new();
        for at in 0..40 {
            assert_eq!(pauses.add(Direction::Request, 7, Some(12 * MS)), None);
            assert_eq!(pauses.add(Direction::Response, 8, Some(15 * MS)), None);
            proven.extend(pauses.add(Direction::Response, 7, Some(if at % 2 == 0 { 44 * MS } else { MS })));
        }
        assert_eq!(proven, [24 * MS; 17]);
    }

    #[test]
    fn delays_of_all_senders_and_single_ones_prove_nothing() {
        let mut pauses = InnerPauses::default();
        for at in 0..200 {
            let longest = if at % 3 == 0 { 60 * MS } else { 10 * MS };
            assert_eq!(pauses.add(Direction::Request, 7, Some(longest)), None);
            assert_eq!(pauses.add(Direction::Response, 7, Some(longest)), None);
        }
        let mut pauses = InnerPauses::default();
        for at in 0..200 {
            assert_eq!(pauses.add(Direction::Request, 7, Some(10 * MS)), None);
            assert_eq!(pauses.add(Direction::Response, 7, Some(if at % 40 == 0 { 60 * MS } else { 10 * MS })), None);
        }
    }
}
