//! Who speaks on which of two lines: the master on one, the units on the other.
//!
//! It is learned from frames that only one side can send, each of which is a vote. Before the first frame is emitted, the
//! first bytes of both lines are surveyed for such frames.

use crate::input::Input;
use crate::session::bus::BusState;
use crate::session::line::add_vote;
use crate::session::two_lines::peek::{frame_here, FRAME_OVERHEAD_BYTES};
use crate::weights;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// Votes on who speaks on a line, from its first 4096 bytes: frames that only a master can send, less those that only a unit
/// can send. Only whole frames with a valid checksum count; where a request and a response would fit, the longer one is taken.
fn survey(functions: &Functions, input: &Input) -> i32 {
    let bytes = &input.bytes()[..input.bytes().len().min(weights::SURVEY_BYTES)];
    let (mut votes, mut at) = (0, 0);
    while at + FRAME_OVERHEAD_BYTES < bytes.len() {
        let frame = [Direction::Request, Direction::Response].map(|side| frame_here(functions, &bytes[at..], side));
        let Some(adu) = frame.into_iter().flatten().max_by_key(|frame| frame.len()) else {
            at += 1;
            continue;
        };
        votes = add_vote(votes, functions, adu);
        at += adu.len() + CRC_BYTES;
    }
    votes
}

impl BusState {
    /// The one side that speaks on line `at` of a two-line tap, once the votes of both lines have shown it; votes on the
    /// other line count the other way. `None` while the lead is too small.
    pub(in crate::session) fn speaker(&self, at: usize) -> Option<Direction> {
        let lines = self.lines.iter().enumerate();
        let votes: i32 =
            lines.map(|(line, (_, state))| if line == at { state.request_votes } else { -state.request_votes }).sum();
        match votes {
            weights::SPEAKER_LEAD_FRAMES.. => Some(Direction::Request),
            _ if votes <= -weights::SPEAKER_LEAD_FRAMES => Some(Direction::Response),
            _ => None,
        }
    }

    /// Whether it is still open who speaks on which of the two lines, and further bytes may show it. Nothing is emitted until
    /// then, because the first frames would be paired the wrong way.
    ///
    /// The survey is only needed for two lines with a clock whose source does not say who sends: not for a connection, whose
    /// sides are known, nor for ASCII. It ends for good as soon as the votes have a lead, which the lines then start with; or
    /// as soon as one line has ended, has enough bytes, has no times, or has records or a side; or, live, after a second.
    /// While no line has bytes, it stays open. It is taken again with each call, as nothing is consumed before its end.
    pub(in crate::session) fn survey_is_open(&mut self, functions: &Functions, live: bool) -> bool {
        if self.is_surveyed || self.lines.is_empty() {
            return false;
        }
        let is_two_line_tap = self.lines[0].0 != 0 && self.options.bus.network.is_none();
        let is_needed = is_two_line_tap && self.options.mode != Some(Mode::Ascii);
        let has_lead = is_needed && self.take_survey(functions);
        self.is_surveyed = !is_needed || has_lead || self.has_survey_ended(live);
        !self.is_surveyed
    }

    /// Whether a survey must not go on, whatever the votes are: one line has ended, has enough bytes, has no times, or has
    /// records or a side; or, live, its time is over.
    fn has_survey_ended(&self, live: bool) -> bool {
        let lacks_side =
            |input: &Input| input.has_times && input.first_read().is_some_and(|read| !read.starts_record && read.side.is_none());
        let is_full = |input: &Input| input.is_ended || input.bytes().len() >= weights::SURVEY_BYTES || !lacks_side(input);
        let mut with_bytes = self.lines.iter().filter(|(_, line)| !line.input.bytes().is_empty());
        let until = self.survey_deadline().filter(|_| live);
        with_bytes.any(|(_, line)| is_full(&line.input)) || until.zip(self.now).is_some_and(|(until, now)| now >= until)
    }

    /// Counts the votes of both lines; if they have a lead, the lines start with them, and the answer is `true`.
    fn take_survey(&mut self, functions: &Functions) -> bool {
        let votes: Vec<i32> = self.lines.iter().map(|(_, line)| survey(functions, &line.input)).collect();
        let lead: i32 = votes.iter().enumerate().map(|(at, &votes)| if at == 0 { votes } else { -votes }).sum();
        let has_lead = lead.abs() >= weights::SPEAKER_LEAD_FRAMES;
        if has_lead {
            self.lines.iter_mut().zip(votes).for_each(|((_, line), votes)| line.request_votes = votes);
        }
        has_lead
    }

    /// When the survey ends in a live session, whatever has come: a second after the first byte. `None` once it is over, on
    /// the only line of a bus, and without times.
    pub(super) fn survey_deadline(&self) -> Option<Ns> {
        let waiting = self.lines.iter().filter(|(id, line)| *id != 0 && !line.input.bytes().is_empty());
        waiting
            .filter_map(|(_, line)| line.input.byte_time(0))
            .min()
            .filter(|_| !self.is_surveyed)
            .map(|first| first + weights::SURVEY_NS)
    }
}
