//! Commits a frame or unframed bytes: the root moves behind them, and the model learns from them.

use crate::confidence::{self, Likeness, Standing};
use crate::framer::rtu::answerable::HeldRequest;
use crate::framer::rtu::lone_frames::{key_of, SURROUNDING_BYTES};
use crate::framer::rtu::score;
use crate::framer::rtu::search::commit::state::Decision;
use crate::framer::rtu::search::hypothesis::ROOT;
use crate::framer::rtu::search::state::Search;
use crate::framer::rtu::side::{self, REQUEST, RESPONSE};
use crate::framer::rtu::traffic_model::{FramePosition, RequestCopy, TrafficModel};
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights;
use modlens_protocol::direction::{self, Direction, ResponseMatch};
use modlens_protocol::functions::{Layout, EXCEPTION_BIT};

impl Search {
    /// Commits unframed bytes behind the root, which no frame on the best path claims: all bytes scanned if closed, else the
    /// first `UNFRAMED_PIECE_BYTES`. The model learns them as noise.
    pub(super) fn commit_unframed_piece(&mut self, input: &Input, is_closed: bool) -> Decision {
        self.last_was_doubtful |= !is_closed;
        let to = if is_closed { self.scanned_to } else { self.committed_offset() + weights::UNFRAMED_PIECE_BYTES };
        let unframed = (self.committed_offset() - input.offset()) as usize..(to - input.offset()) as usize;
        self.model.learn_noise(&input.bytes()[unframed]);
        self.commit_unframed(to)
    }

    /// Commits the frame `first` (an index of the lattice), the first one of the best path, whose score is given: it becomes the
    /// root. Confidence is the lead over the best path without it; the direction is unknown where the other one is as good.
    ///
    /// With a valid CRC it teaches the model, as do the unframed bytes before it. An unconfirmed frame teaches no unit or
    /// function, and the request that is outstanding behind it becomes unconfirmed, too.
    pub(super) fn commit_frame(&mut self, input: &Input, context: &FramerContext<'_>, first: usize, score: f32) -> Decision {
        let rivals = self.lattice.iter().filter(|path| path.first_on_path != first);
        // The root counts as a rival: the path on which all bytes scanned are unframed.
        let lead = score - rivals.map(|rival| self.current_score(rival)).fold(f32::MIN, f32::max);
        let frame = &self.lattice[first];
        let (start, end, direction) = (frame.start, frame.end, side::direction_of(frame.direction));
        // Nothing is learned from a damaged frame here; the framer explains it when its row is given out.
        if !frame.is_crc_valid {
            self.set_root(first);
            return Decision::Damaged { start, end, direction };
        }
        let bytes = &input.bytes()[(start - input.offset()) as usize..(end - input.offset()) as usize];
        if frame.direction == RESPONSE {
            let answers_outstanding = frame.answers_outstanding;
            self.learn_late_response(context, bytes, answers_outstanding);
        }
        let odds = self.direction_odds(input, context, first, bytes);
        let unframed_bytes = start - self.committed_offset();
        self.adjacent_frames = if unframed_bytes > 0 { 0 } else { self.adjacent_frames.saturating_add(1) };
        let recurs = self.record_lone_frame(input, context, first, bytes);
        let unconfirmed = self.is_unconfirmed(context, first, bytes, lead, recurs);
        // Noise must not teach units. That stray bytes stand before frames, it may.
        if unconfirmed {
            self.model.learn_stray_bytes(unframed_bytes);
        } else {
            self.learn_frame(context, first, bytes);
        }
        let is_undecided = lead < weights::UNDECIDED_DIRECTION_BITS && self.has_opposite_rival(first, f32::MIN);
        let direction = if is_undecided { Direction::Unknown } else { direction };
        let standing = match unframed_bytes >= weights::MAY_HIDE_FRAME_BYTES {
            true if recurs => Standing::Recurring,
            true => Standing::InNoise,
            false => Standing::Among,
        };
        let confidence = confidence::of_rtu_frame(lead, Likeness::of_frame(context.functions, bytes), standing).min(odds as u8);
        let confidence = if unconfirmed { confidence.min(weights::UNCONFIRMED_ODDS_BITS) } else { confidence };
        self.last_was_doubtful = unconfirmed;
        if unframed_bytes > 0 {
            let unframed = (self.committed_offset() - input.offset()) as usize..(start - input.offset()) as usize;
            self.model.learn_noise(&input.bytes()[unframed]);
        }
        self.set_root(first);
        if let Some(outstanding) = self.lattice[ROOT].answerable.outstanding.filter(|_| unconfirmed) {
            self.reserve_request();
            self.lattice[ROOT].answerable.outstanding = Some(self.requests.add_unconfirmed_copy(outstanding));
        }
        let unconfirmed = unconfirmed || confidence < weights::MIN_FIRM_BITS;
        Decision::Frame { start, end, direction, confidence, unconfirmed }
    }

    /// Log2 of the odds of the direction of the frame `first`, about to be committed, in a row of equal frames. What the recording
    /// declares is certain.
    fn direction_odds(&mut self, input: &Input, context: &FramerContext<'_>, first: usize, bytes: &[u8]) -> f32 {
        let frame = &self.lattice[first];
        let role = (frame.direction, frame.answers_outstanding);
        let index = (frame.start - input.offset()) as usize;
        let is_declared = context.declared_direction_at(input, index) == Some(side::direction_of(frame.direction));
        let pause = context.pause_evidence_at(input, index);
        let odds = self.next_run_odds(context, bytes, role, pause);
        if is_declared {
            weights::CERTAIN_DIRECTION_BITS
        } else {
            odds
        }
    }

    /// Whether the frame `first`, about to be committed, stands alone in noise and nothing vouches for it: a CRC is valid by
    /// chance once in 65536 places. `bytes` are the frame with its CRC, `lead` is its lead over all rivals in bits;
    /// `recurs`: it stood alone in the same noise before.
    ///
    /// A unit of a paired transaction vouches for its frames; in the middle of noise only for those that the specification
    /// explains, that are far from noise, and that did not come there before.
    fn is_unconfirmed(&self, context: &FramerContext<'_>, first: usize, bytes: &[u8], lead: f32, recurs: bool) -> bool {
        let frame = &self.lattice[first];
        let unframed_bytes = frame.start - self.committed_offset();
        let outstanding = self.outstanding_request();
        let is_vouched = frame.answers_outstanding && outstanding.is_none_or(|request| vouches_for(context, request, bytes));
        // Drivers that are switched leave a stray byte or two in front of every frame.
        let is_near = unframed_bytes < weights::MAY_HIDE_FRAME_BYTES;
        let is_sound = |request: &HeldRequest| !request.is_unconfirmed && (is_near || is_vouched);
        let answers_request =
            frame.answers_outstanding && outstanding.is_some_and(|request| is_sound(request) || (is_near && is_vouched));
        // Right behind a chance match there may be another one, but neither its response nor a chain of frames.
        let is_behind_doubt = self.last_was_doubtful && !is_vouched && self.adjacent_frames < weights::CHAIN_FRAMES;
        if answers_request || (unframed_bytes == 0 && !is_behind_doubt) {
            return false;
        }
        let is_in_noise = !is_near || is_behind_doubt;
        let is_unlikely = || {
            recurs || lead < weights::FIRM_IN_NOISE_BITS || !score::is_understood(&self.model, context, bytes, frame.direction)
        };
        !context.paired_units[bytes[0] as usize] || (is_in_noise && is_unlikely())
    }

    /// Counts the frame `first` if it stands behind so many unframed bytes that it stands alone; returns whether the same came
    /// before. A response that vouches for its request is counted for that one instead.
    fn record_lone_frame(&mut self, input: &Input, context: &FramerContext<'_>, first: usize, bytes: &[u8]) -> bool {
        let frame = &self.lattice[first];
        let (answers, start) = (frame.answers_outstanding, frame.start);
        let last = self.last_lone_frame.take();
        if answers && self.outstanding_request().is_some_and(|request| vouches_for(context, request, bytes)) {
            if let Some(key) = last {
                self.lone_frames.record_response(key);
            }
            return false;
        }
        if start - self.committed_offset() < weights::MAY_HIDE_FRAME_BYTES {
            return false;
        }
        let at = (start - input.offset()) as usize;
        let key = key_of(&input.bytes()[at - SURROUNDING_BYTES..at + bytes.len()]);
        let came_before = self.lone_frames.is_recurring(key);
        self.lone_frames.record(key);
        self.last_lone_frame = Some(key);
        came_before
    }

    /// Teaches the model the frame `first`, which is about to become the root; `bytes` are the frame with its CRC.
    fn learn_frame(&mut self, context: &FramerContext<'_>, first: usize, bytes: &[u8]) {
        match self.lattice[first].direction {
            REQUEST => self.learn_request(bytes),
            _ if self.lattice[first].answers_outstanding => self.model.learn_silence(bytes[0], false),
            _ => {}
        }
        let frame = &self.lattice[first];
        let direction = frame.direction;
        let request = frame.answerable.outstanding.filter(|_| direction == REQUEST).map(|id| self.requests.get(id));
        let copy = request_copy(context, bytes, request.is_some_and(|request| request.is_repeated));
        let position = FramePosition {
            request_outstanding: self.lattice[ROOT].answerable.outstanding.is_some(),
            unframed_bytes: frame.start - self.committed_offset(),
        };
        // An unsolicited response may be a request that looks like one.
        let has_clear_direction = direction == REQUEST || frame.answers_outstanding;
        self.model.learn(bytes, direction, position, copy);
        if has_clear_direction {
            learn_open_length(&mut self.model, context, bytes, direction);
        }
        self.model.update_costs();
    }

    /// Learns from this request, which is about to be committed: the outstanding one gets no response, or, if none is
    /// outstanding, the last one is sent again or is not. An echo says nothing of that.
    #[inline]
    pub(in crate::framer::rtu::search) fn learn_request(&mut self, frame: &[u8]) {
        self.model.learn_same_again(frame, self.outstanding_request().is_some());
        let Some(outstanding) = self.outstanding_request() else { return };
        let is_same = outstanding.unit == frame[0] && outstanding.pdu == frame[1..frame.len() - 2];
        let may_be_echo = is_same && !outstanding.is_repeated && self.model.has_echo();
        let unit = outstanding.unit;
        if !may_be_echo {
            self.model.learn_silence(unit, true);
        }
    }

    /// Learns how often the late response to a request comes behind the response to its retry; `frame` is a response about to be
    /// committed. Counts one that answers a retry, and one that fits the superseded request while none is outstanding: it is
    /// late. A response that equals its request may also be a retry, so nothing is learned from it.
    #[inline]
    pub(in crate::framer::rtu::search) fn learn_late_response(
        &mut self,
        context: &FramerContext<'_>,
        frame: &[u8],
        answers_outstanding: bool,
    ) {
        let requests = self.answerable();
        let Some(superseded) = requests.superseded else { return };
        let pdu = &frame[1..frame.len() - 2];
        if superseded.pdu == pdu {
            return;
        }
        match requests.outstanding {
            Some(retry) if answers_outstanding && (retry.unit, &retry.pdu) == (superseded.unit, &superseded.pdu) => {
                self.model.learn_late_response(false);
            }
            None if direction::match_response(context.functions, superseded.as_request_ref(), frame[0], pdu)
                == ResponseMatch::Fully =>
            {
                self.model.learn_late_response(true);
            }
            _ => {}
        }
    }
}

/// Learns the length of a frame whose layout is not public; nothing for an exception response. `frame` includes unit and CRC.
fn learn_open_length(model: &mut TrafficModel, context: &FramerContext<'_>, frame: &[u8], direction: usize) {
    let (code, body) = (frame[1], &frame[2..frame.len() - 2]);
    if code & EXCEPTION_BIT != 0 {
        return;
    }
    let row = context.functions.row(code, body);
    let layout = row.map(|row| if direction == REQUEST { &row.request } else { &row.response });
    if layout.is_none_or(|layout| *layout == Layout::Unknown) {
        model.learn_length(code, direction, body);
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
fn vouches_for(context: &FramerContext<'_>, request: &HeldRequest, response: &[u8]) -> bool {
    let (&code, body) = request.pdu.split_first().unwrap_or((&0, &[]));
    let is_known = context.functions.row(code, body).is_some_and(|row| matches!(row.response, Layout::Body(_)));
    is_known && request.pdu[..] != response[1..response.len() - 2]
}

/// Whether the framer holds a decision back: in a recording, unframed bytes are judged together with the frame behind them.
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
