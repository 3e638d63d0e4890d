//! Commits a frame or unframed bytes: the root moves after them, and the model learns from them.

use crate::confidence::{self, Likeness, Standing};
use crate::framer::rtu::lone_frames::{key_of, SURROUNDING_BYTES};
use crate::framer::rtu::search::commit::one_side::{answers_fully, hears_unknown_side, is_next_write};
use crate::framer::rtu::search::commit::state::Decision;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::answerable::{fingerprint, AnswerableRequest, AnswerableRequests};
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::score;
use crate::rtu_model::side::{self, REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{heard_sides, FramePosition, RequestCopy, TrafficModel};
use crate::weights;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Layout, EXCEPTION_BIT};

// The surroundings by which a lone frame is known again all are before it.
const _: () = assert!(SURROUNDING_BYTES as u64 <= weights::MAY_HIDE_FRAME_BYTES);

/// The first frame of the best path, with a valid CRC, about to be committed.
struct Winner<'a> {
    /// Its index in the lattice.
    first: usize,
    /// Index of its first byte in the input.
    start_index: usize,
    /// Offset of its first byte.
    start: u64,
    /// Its bytes, CRC included.
    frame: FrameBytes<'a>,
    /// The bytes between the end of the root and its first byte, which belong to no frame.
    unframed: &'a [u8],
    /// `REQUEST` or `RESPONSE`.
    direction: usize,
    /// It answers the request that is outstanding after the root.
    answers_outstanding: bool,
    /// Score of its path less that of the best path without it, in bits. The root counts as such a path: all bytes are unframed
    /// there.
    lead: f32,
    /// The same without paths that begin with the same bytes: how sure it is where the frame begins and ends.
    lead_of_bounds: f32,
    /// Nothing shows which side of the line has sent it (`hears_unknown_side`).
    is_of_unknown_side: bool,
}

impl Winner<'_> {
    /// Whether it is alone: before it are so many unframed bytes that a whole frame may be hidden among them, so that
    /// nothing is known of what it follows.
    fn is_lone(&self) -> bool {
        self.unframed.len() as u64 >= weights::MAY_HIDE_FRAME_BYTES
    }
}

/// What speaks for a frame that is about to be committed, and against it.
struct Evidence {
    /// Log2 of the odds of its direction.
    direction_odds: f32,
    /// It stood alone in the same noise before.
    recurs: bool,
    /// It is alone in noise, and nothing vouches for it.
    is_unconfirmed: bool,
}

impl Search {
    /// Commits unframed bytes after the root, which no frame on the best path claims: all bytes scanned if closed, else the
    /// first `UNFRAMED_PIECE_BYTES`. The model learns them as noise.
    pub(super) fn commit_unframed_piece(&mut self, input: &Input, is_closed: bool) -> Decision {
        self.last_was_doubtful |= !is_closed;
        let to = if is_closed { self.scanned_to } else { self.committed_offset() + weights::UNFRAMED_PIECE_BYTES };
        let unframed = (self.committed_offset() - input.offset()) as usize..(to - input.offset()) as usize;
        self.model.learn_noise(&input.bytes()[unframed]);
        self.commit_unframed(to)
    }

    /// Commits the first frame of the best path: it becomes the root. `path_end` is the index of the last frame of that path in the
    /// lattice, `score` the path's in bits, as it is at the last byte scanned, or before a silence there (`is_closed`). Its
    /// confidence comes from its lead over the best path without it.
    ///
    /// With a valid CRC it teaches the model, as do the unframed bytes before it. An unconfirmed frame teaches no unit or
    /// function, and the request that is outstanding after it becomes unconfirmed as well. Nothing is learned from a damaged
    /// frame here: the framer does that when it emits the frame.
    pub(super) fn commit_frame(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        (path_end, score): (usize, f32),
        is_closed: bool,
    ) -> Decision {
        let first = self.lattice[path_end].first_on_path;
        let Hypothesis { start, end, direction, is_crc_valid, .. } = self.lattice[first];
        if !is_crc_valid {
            self.set_root(first);
            return Decision::Damaged { start, end, direction: side::direction_of(direction) };
        }
        let winner = self.winner(input, context, (path_end, score), is_closed);
        let evidence = self.weigh(input, context, &winner);
        self.learn_winner(context, &winner, evidence.is_unconfirmed);
        let direction = self.decided_direction(&winner);
        let confidence = confidence_of(context, &winner, &evidence);
        self.model.learn_noise(winner.unframed);
        self.set_root(first);
        if evidence.is_unconfirmed {
            self.doubt_outstanding_request();
        }
        self.last_was_doubtful = evidence.is_unconfirmed;
        let unconfirmed = evidence.is_unconfirmed || confidence < weights::MIN_FIRM_BITS;
        Decision::Frame { start, end, direction, confidence, unconfirmed }
    }

    /// What is known of the first frame of the best path, which ends with the frame `path_end` (an index of the lattice) and whose
    /// score is given; `is_closed`: as it is before a silence.
    fn winner<'a>(
        &self,
        input: &'a Input,
        context: &FramerContext<'_>,
        (path_end, score): (usize, f32),
        is_closed: bool,
    ) -> Winner<'a> {
        let first = self.lattice[path_end].first_on_path;
        let Hypothesis { start, end, direction, answers_outstanding, .. } = self.lattice[first];
        let index = |offset: u64| (offset - input.offset()) as usize;
        let frame = FrameBytes(&input.bytes()[index(start)..index(end)]);
        let rivals = || self.lattice.iter().filter(|path| path.first_on_path != first);
        let score_of = |rival| if is_closed { self.score_before_silence(rival) } else { self.current_score(rival) };
        let is_declared = context.declared_direction_at(input, index(start)).is_some();
        let has_other_bounds = |path: &&Hypothesis| {
            let other = &self.lattice[path.first_on_path];
            (other.start, other.end) != (start, end)
        };
        Winner {
            first,
            start_index: index(start),
            start,
            frame,
            unframed: &input.bytes()[index(self.committed_offset())..index(start)],
            direction,
            answers_outstanding,
            lead: score - rivals().map(score_of).fold(f32::MIN, f32::max),
            lead_of_bounds: score - rivals().filter(has_other_bounds).map(score_of).fold(f32::MIN, f32::max),
            is_of_unknown_side: direction == REQUEST && !is_declared && hears_unknown_side(self, input, context, frame, path_end),
        }
    }

    /// What speaks for a frame and against it, before the model learns from it. Counts it among adjacent and among lone frames,
    /// and learns whether it is a late response.
    fn weigh(&mut self, input: &Input, context: &FramerContext<'_>, winner: &Winner<'_>) -> Evidence {
        if winner.direction == RESPONSE {
            self.learn_late_response(context, winner.frame.0, winner.answers_outstanding);
        }
        let direction_odds = self.direction_odds(input, context, winner);
        let is_repetition = self.is_mere_repetition(context, winner);
        self.count_adjacent_frame(winner, is_repetition);
        let recurs = self.record_lone_frame(input, context, winner);
        let is_unconfirmed = self.is_unconfirmed(context, winner, recurs, is_repetition);
        Evidence { direction_odds, recurs, is_unconfirmed }
    }

    /// Whether a frame stands right after the same bytes, and no specification says how long it is. In bytes with a period, as the
    /// telegrams of another protocol have, any number of periods may have a valid CRC by chance, and then each of the frames
    /// that follow has as well: together they are one accident.
    fn is_mere_repetition(&self, context: &FramerContext<'_>, winner: &Winner<'_>) -> bool {
        let frame = winner.frame.0;
        self.last_valid_frame == Some((winner.start, fingerprint(frame)))
            && (Likeness::of_frame(context.functions, frame) == Likeness::OpenLength
                || !score::is_understood(&self.model, context, frame, winner.direction))
    }

    /// Counts a frame among those without a byte between them, unless it is a mere repetition.
    fn count_adjacent_frame(&mut self, winner: &Winner<'_>, is_repetition: bool) {
        let end = winner.start + winner.frame.0.len() as u64;
        self.last_valid_frame = Some((end, fingerprint(winner.frame.0)));
        if !winner.unframed.is_empty() {
            self.adjacent_frames = 0;
        } else if !is_repetition {
            self.adjacent_frames = self.adjacent_frames.saturating_add(1);
        }
    }

    /// Log2 of the odds of the direction of a frame in a run of equal frames, kept for the frame after it. What the recording
    /// declares is certain.
    fn direction_odds(&mut self, input: &Input, context: &FramerContext<'_>, winner: &Winner<'_>) -> f32 {
        let declared = context.declared_direction_at(input, winner.start_index);
        let pause = context.pause_evidence_at(input, winner.start_index);
        let odds = self.next_run_odds(context, winner.frame.0, (winner.direction, winner.answers_outstanding), pause);
        if declared == Some(side::direction_of(winner.direction)) {
            weights::CERTAIN_DIRECTION_BITS
        } else {
            odds
        }
    }

    /// Counts a frame that is alone (`is_lone`); returns whether the same came before, after the same bytes. A response
    /// that vouches for its request is counted for that one instead, and never counts as recurring itself.
    fn record_lone_frame(&mut self, input: &Input, context: &FramerContext<'_>, winner: &Winner<'_>) -> bool {
        let last = self.last_lone_frame.take();
        if self.vouches_for_outstanding(context, winner) {
            if let Some(key) = last {
                self.lone_frames.record_response(key);
            }
            return false;
        }
        if !winner.is_lone() {
            return false;
        }
        let end_index = winner.start_index + winner.frame.0.len();
        let key = key_of(&input.bytes()[winner.start_index - SURROUNDING_BYTES..end_index]);
        let came_before = self.lone_frames.is_recurring(key);
        self.lone_frames.record(key);
        self.last_lone_frame = Some(key);
        came_before
    }

    /// Whether a frame answers the request that is outstanding after the root and proves that it is one (`vouches_for`).
    fn vouches_for_outstanding(&self, context: &FramerContext<'_>, winner: &Winner<'_>) -> bool {
        let request = self.outstanding_request().filter(|_| winner.answers_outstanding);
        request.is_some_and(|request| vouches_for(context, request, winner.frame))
    }

    /// Whether a frame is alone in noise and nothing vouches for it: a CRC is valid by chance once in 65536 places.
    /// `recurs`: it stood alone in the same noise before.
    ///
    /// It is confirmed if it answers a sound request, or stands right after a frame that is not in doubt; where it only repeats
    /// that one (`is_repetition`), after a chain of others. Else a unit of a paired transaction vouches for its frames, in the
    /// middle of noise only for likely ones (`is_likely_in_noise`).
    fn is_unconfirmed(&self, context: &FramerContext<'_>, winner: &Winner<'_>, recurs: bool, is_repetition: bool) -> bool {
        let is_vouched = self.vouches_for_outstanding(context, winner);
        // Right after a chance match there may be another one, but neither its response nor a chain of frames.
        let is_chain = self.adjacent_frames >= weights::CHAIN_FRAMES;
        let follows_doubt = self.last_was_doubtful && !is_vouched && !is_chain;
        // A checksum that goes on with the pattern in front of it is no evidence, and neither is a length that nothing explains.
        let is_pattern = score::continues_pattern(winner.frame.0)
            && !score::is_understood(&self.model, context, winner.frame.0, winner.direction);
        let follows_firm_frame = winner.unframed.is_empty() && !follows_doubt && !is_pattern && (is_chain || !is_repetition);
        if follows_firm_frame || self.answers_sound_request(winner, is_vouched) {
            return false;
        }
        let is_in_noise = winner.is_lone() || follows_doubt || is_pattern;
        let is_unlikely = || recurs || !self.is_likely_in_noise(context, winner);
        !context.paired_units[usize::from(winner.frame.unit())] || (is_in_noise && is_unlikely())
    }

    /// Whether a frame answers an outstanding request that makes it sound. Two of three things have to hold: the request is
    /// confirmed, the frame proves it (`is_vouched`), and few bytes are between them: drivers that are switched leave a
    /// stray byte or two in front of every frame.
    fn answers_sound_request(&self, winner: &Winner<'_>, is_vouched: bool) -> bool {
        let Some(request) = self.outstanding_request().filter(|_| winner.answers_outstanding) else { return false };
        let is_near = !winner.is_lone();
        [!request.is_unconfirmed, is_vouched, is_near].into_iter().filter(|&holds| holds).count() >= 2
    }

    /// Whether a frame of a known unit is to be believed in the middle of noise: it is far from noise, and the specification
    /// explains it.
    fn is_likely_in_noise(&self, context: &FramerContext<'_>, winner: &Winner<'_>) -> bool {
        winner.lead >= weights::FIRM_IN_NOISE_BITS && score::is_understood(&self.model, context, winner.frame.0, winner.direction)
    }

    /// Teaches the model a frame that is about to become the root. An unconfirmed frame teaches
    /// no unit, only that stray bytes came before it.
    fn learn_winner(&mut self, context: &FramerContext<'_>, winner: &Winner<'_>, is_unconfirmed: bool) {
        if is_unconfirmed {
            self.model.count_frame_after_stray_bytes(winner.unframed.len() as u64);
        } else {
            self.learn_turn(context, winner);
            self.learn_frame(context, winner);
        }
    }

    /// Learns what a frame says about the outstanding request: a request leaves it unanswered, a response to it ends the unit's
    /// silence, and one that does not fit answers nothing.
    fn learn_turn(&mut self, context: &FramerContext<'_>, winner: &Winner<'_>) {
        if winner.direction == REQUEST {
            let is_left = self.outstanding_request().is_some_and(|request| !request.matches_frame(winner.frame));
            if is_left && !winner.is_lone() {
                heard_sides::learn_left(&mut self.model);
            }
            self.learn_request(winner.frame.0);
            return;
        }
        if winner.answers_outstanding {
            self.model.learn_silence(winner.frame.unit(), false);
        }
        let Some(request) = self.outstanding_request() else { return };
        let is_left = winner.answers_outstanding && is_next_write(context, request, winner.frame);
        if !answers_fully(context, request, winner.frame) {
            heard_sides::learn_unfit_response(&mut self.model, is_left);
        }
    }

    /// Teaches the model unit, function and place of a frame, whether it is a copy, and its length where that is open. An
    /// unsolicited response teaches no length: it may be a request that looks like one.
    fn learn_frame(&mut self, context: &FramerContext<'_>, winner: &Winner<'_>) {
        let &Winner { frame, direction, .. } = winner;
        let request = self.lattice[winner.first].answerable.outstanding.filter(|_| direction == REQUEST);
        let is_repeated = request.is_some_and(|id| self.requests.get(id).is_repeated);
        let copy = request_copy(context, frame.0, is_repeated);
        let request_outstanding = self.lattice[ROOT].answerable.outstanding.is_some();
        let position = FramePosition { request_outstanding, unframed_bytes: winner.unframed.len() as u64 };
        self.model.learn(frame.0, direction, position, copy);
        if direction == REQUEST || winner.answers_outstanding {
            learn_open_length(&mut self.model, context, frame, direction);
        }
        self.model.update_costs();
    }

    /// The direction of a frame; unknown where its lead is small and a rival reads the same bytes in the other direction, or where
    /// nothing shows which side of the line is heard.
    fn decided_direction(&self, winner: &Winner<'_>) -> Direction {
        let is_tie = || winner.lead < weights::UNDECIDED_DIRECTION_BITS && self.has_opposite_rival(winner.first, f32::MIN);
        if winner.is_of_unknown_side || is_tie() {
            Direction::Unknown
        } else {
            side::direction_of(winner.direction)
        }
    }

    /// Makes the request that is outstanding after the root, if there is one, unconfirmed. Other paths keep the original.
    fn doubt_outstanding_request(&mut self) {
        if let Some(outstanding) = self.lattice[ROOT].answerable.outstanding {
            self.reserve_request();
            self.lattice[ROOT].answerable.outstanding = Some(self.requests.add_unconfirmed_copy(outstanding));
        }
    }

    /// Learns from this request, which is about to be committed: the outstanding one gets no response, or, if none is
    /// outstanding, the last one is sent again or is not. An echo says nothing of that.
    #[inline]
    pub(in crate::framer::rtu::search) fn learn_request(&mut self, frame: &[u8]) {
        self.model.learn_same_again(frame, self.outstanding_request().is_some());
        let Some(outstanding) = self.outstanding_request() else { return };
        let is_same = outstanding.matches_frame(FrameBytes(frame));
        let may_be_echo = is_same && !outstanding.is_repeated && self.model.has_echo();
        let unit = outstanding.unit;
        if !may_be_echo {
            self.model.learn_silence(unit, true);
        }
    }

    /// Learns from a response about to be committed how often the late response to a request comes after the response to its
    /// retry: one chance more if it answers a retry, one hit more if it is late itself: no request is outstanding, and
    /// it fits the superseded one in full. Nothing is learned from one that equals the superseded request: it may be a retry.
    #[inline]
    pub(in crate::framer::rtu::search) fn learn_late_response(
        &mut self,
        context: &FramerContext<'_>,
        frame: &[u8],
        answers_outstanding: bool,
    ) {
        let AnswerableRequests { outstanding, superseded: Some(superseded), .. } = self.answerable() else { return };
        let frame = FrameBytes(frame);
        if superseded.pdu == frame.pdu() {
            return;
        }
        let is_retry = |request: &AnswerableRequest| (request.unit, &request.pdu) == (superseded.unit, &superseded.pdu);
        let answers_retry = answers_outstanding && outstanding.is_some_and(is_retry);
        let is_late = outstanding.is_none() && answers_fully(context, superseded, frame);
        if answers_retry || is_late {
            self.model.learn_late_response(is_late);
        }
    }
}

/// The log2 odds that a frame is right: by its lead, what it looks like and where it stands, but no more than the odds of its
/// direction, nor than an unconfirmed frame may have. Where no direction is reported, only its bounds can be wrong.
fn confidence_of(context: &FramerContext<'_>, winner: &Winner<'_>, evidence: &Evidence) -> u8 {
    let standing = match winner.is_lone() {
        true if evidence.recurs => Standing::Recurring,
        true => Standing::InNoise,
        false => Standing::Among,
    };
    let likeness = Likeness::of_frame(context.functions, winner.frame.0);
    let confidence = if winner.is_of_unknown_side {
        confidence::of_rtu_frame(winner.lead_of_bounds, likeness, standing)
    } else {
        confidence::of_rtu_frame(winner.lead, likeness, standing).min(confidence::of_direction(evidence.direction_odds))
    };
    if evidence.is_unconfirmed {
        confidence.min(weights::UNCONFIRMED_ODDS_BITS)
    } else {
        confidence
    }
}

/// Learns the length of a frame whose layout is not public; nothing from an exception response.
fn learn_open_length(model: &mut TrafficModel, context: &FramerContext<'_>, frame: FrameBytes<'_>, direction: usize) {
    if frame.is_exception() {
        return;
    }
    let row = context.functions.row(frame.code(), frame.body());
    let layout = row.map(|row| if direction == REQUEST { &row.request } else { &row.response });
    if layout.is_none_or(|layout| *layout == Layout::Unknown) {
        model.learn_length(frame.code(), direction, frame.body());
    }
}

/// What a request is to the one before it. Where the response may look like the request (`has_equal_layouts`) or the function
/// has no row, it is `Unclear`, and nothing is learned of echoes.
fn request_copy(context: &FramerContext<'_>, frame: &[u8], is_repeated: bool) -> RequestCopy {
    match context.functions.row(frame[1] & !EXCEPTION_BIT, &frame[2..]) {
        Some(row) if !row.has_equal_layouts && is_repeated => RequestCopy::Repeated,
        Some(row) if !row.has_equal_layouts => RequestCopy::First,
        _ => RequestCopy::Unclear,
    }
}

/// Whether a response proves that its request is one. A response that equals its request proves nothing, because wrong bytes
/// may come twice; neither does one that may have any length, because then any place may fit.
fn vouches_for(context: &FramerContext<'_>, request: &AnswerableRequest, response: FrameBytes<'_>) -> bool {
    let (&code, body) = request.pdu.split_first().unwrap_or((&0, &[]));
    let is_known = context.functions.row(code, body).is_some_and(|row| matches!(row.response, Layout::Body(_)));
    is_known && request.pdu != response.pdu()
}

/// Whether the framer holds a decision back: in a recording, unframed bytes are judged together with the frame after them.
pub fn is_held_back(decision: &Decision, input: &Input, context: &FramerContext<'_>) -> bool {
    let Decision::UnframedTo(to) = *decision else { return false };
    context.may_look_ahead
        && !input.is_closed
        && to < input.offset() + weights::OFFLINE_HOLD_BACK_BYTES
        && !comes_in_records(input, to)
}

/// Whether the first bytes come in records of a recording, or end where one begins: there each is judged by itself.
fn comes_in_records(input: &Input, to: u64) -> bool {
    let begins = |index: usize| input.starts_read(index) && input.read(index).is_some_and(|read| read.starts_record);
    input.first_read().is_some_and(|read| read.starts_record) || begins((to - input.offset()) as usize)
}
