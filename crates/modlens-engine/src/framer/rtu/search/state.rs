//! The state of the search over one line, what it has committed, and the frames that the fast path commits past it.

use std::ops::Range;

use crate::framer::rtu::frame_check::{expected_response, FrameLength};
use crate::framer::rtu::lone_frames::LoneFrames;
use crate::framer::rtu::search::commit::SkipAhead;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::rejected::RejectedSubstrings;
use crate::framer::FramerContext;
use crate::rtu_model::answerable::{AnswerableRequest, AnswerableRequests, Fingerprint, RequestPool};
use crate::rtu_model::crc_scan::CrcScanner;
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::side::{self, REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{FramePosition, RequestCopy, TrafficModel};
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::Ns;

/// The search over one line.
pub struct Search {
    /// The frame hypotheses after the last frame committed, which is the root. Parents are before their children.
    pub(super) lattice: Vec<Hypothesis>,
    pub(super) scanner: CrcScanner,
    /// Starts of the valid substrings that end at the last byte scanned.
    pub(super) valid_starts: Vec<u64>,
    /// By index of a hypothesis, its new one: only used while some are dropped, and kept so that nothing is allocated.
    pub(super) new_indices: Vec<usize>,
    /// What was found to be worth nothing.
    pub(super) rejected: RejectedSubstrings,
    /// Stream offset after the last byte scanned.
    pub(super) scanned_to: u64,
    /// The scanner is at `scanned_to`, so the search goes on there; else it restarts after the root.
    pub(super) is_scanning: bool,
    /// Offsets before which nothing can be decided.
    pub(super) skip: SkipAhead,
    /// The requests that hypotheses refer to.
    pub(super) requests: RequestPool,
    /// The last frame committed is unconfirmed, or a block of noise was committed that goes on.
    pub(super) last_was_doubtful: bool,
    /// The shortest pause between frames, as the framer knows it.
    pub(super) frame_gap_ns: Ns,
    /// Log2 of the odds that the direction of the frame committed last is right, in a row of equal frames.
    pub(super) run_odds: f32,
    /// How many valid frames the search committed last without a byte between them. Neither the fast path nor a mere repetition
    /// (`is_mere_repetition`) counts here.
    pub(super) adjacent_frames: u8,
    /// Where the valid frame ends that the search committed last, and what distinguishes it from others.
    pub(super) last_valid_frame: Option<(u64, Fingerprint)>,
    /// Frames that stood alone in noise.
    pub(super) lone_frames: LoneFrames,
    /// The key of the frame committed last, if it stood alone in noise.
    pub(super) last_lone_frame: Option<u64>,
    /// What the line has taught.
    pub model: TrafficModel,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            lattice: vec![Hypothesis::root()],
            scanner: CrcScanner::default(),
            valid_starts: Vec::new(),
            new_indices: Vec::new(),
            rejected: RejectedSubstrings::default(),
            scanned_to: 0,
            is_scanning: false,
            skip: SkipAhead::default(),
            requests: RequestPool::default(),
            last_was_doubtful: false,
            frame_gap_ns: Ns::MAX,
            run_odds: CERTAIN_DIRECTION_BITS,
            adjacent_frames: 0,
            last_valid_frame: None,
            lone_frames: LoneFrames::default(),
            last_lone_frame: None,
            model: TrafficModel::default(),
        }
    }
}

/// What was committed, and what is outstanding after it.
impl Search {
    /// The stream offset up to which results are committed.
    #[inline]
    pub fn committed_offset(&self) -> u64 {
        self.lattice[ROOT].end
    }

    /// Whether no byte after the committed ones was scanned.
    pub fn is_idle(&self) -> bool {
        self.lattice.len() == 1 && (!self.is_scanning || self.scanned_to == self.committed_offset())
    }

    /// Whether no byte after this stream offset was scanned, and no request is outstanding there. The late response to a
    /// superseded one may still come.
    pub fn is_settled_at(&self, offset: u64) -> bool {
        let has_outstanding = self.lattice[ROOT].answerable.outstanding.is_some();
        self.lattice.len() == 1 && self.committed_offset() == offset && !has_outstanding
    }

    /// The direction of the frame committed last.
    #[inline]
    pub fn last_direction(&self) -> Direction {
        side::direction_of(self.lattice[ROOT].direction)
    }

    /// The outstanding request.
    #[inline]
    pub fn outstanding_request(&self) -> Option<&AnswerableRequest> {
        self.lattice[ROOT].answerable.outstanding.map(|id| self.requests.get(id))
    }

    /// All requests that the next frame may answer.
    pub fn answerable(&self) -> AnswerableRequests<'_> {
        self.requests.look_up(self.lattice[ROOT].answerable)
    }

    /// Sets the outstanding request, where the other line of a two-line tap carries the requests.
    pub fn set_outstanding_request(&mut self, request: Option<RequestRef<'_>>) {
        self.reserve_request();
        let id = request.map(|request| self.requests.add(request.unit, request.pdu));
        self.lattice[ROOT].answerable.outstanding = id;
    }

    /// Makes room for one more request in the pool.
    #[inline]
    pub(super) fn reserve_request(&mut self) {
        self.requests.make_room(self.lattice.iter().map(|hypothesis| &hypothesis.answerable));
    }

    /// Commits bytes up to this stream offset that another framer has framed.
    pub fn skip_to(&mut self, offset: u64) {
        self.lattice.truncate(1);
        self.lattice[ROOT].end = offset;
        self.scanned_to = offset;
        self.is_scanning = false;
    }
}

/// Frames that the fast path found.
impl Search {
    /// Whether no hypothesis speaks against a fast-path frame after the root and some stray bytes: there is none, or the best
    /// path begins with that very frame.
    pub fn allows_fast_path(&self, stray_bytes: usize, length: FrameLength) -> bool {
        if self.lattice.len() == 1 {
            return true;
        }
        let direction = if length.is_request() { REQUEST } else { RESPONSE };
        let first = self.lattice[self.best_path().0].first_on_path;
        let frame = &self.lattice[first];
        let start = self.committed_offset() + stray_bytes as u64;
        let end = start + length.bytes() as u64;
        (first == ROOT && stray_bytes == 0) || (frame.start, frame.end, frame.direction) == (start, end, direction)
    }

    /// Whether the outstanding request is neither unconfirmed nor damaged: then an unambiguous frame after stray bytes needs no
    /// search.
    pub fn has_sound_outstanding_request(&self) -> bool {
        self.outstanding_request().is_none_or(|request| !request.is_unconfirmed && !request.is_damaged)
    }

    /// Commits a frame that the fast path found after the root and `stray_bytes` bytes: it becomes the root and teaches the
    /// model, as if the search had committed it, but for what counts the search's own frames. All hypotheses are dropped.
    ///
    /// `bytes` begin at the root's end and have at least the stray bytes and the frame. The caller
    /// has checked layout and CRC. `odds` are log2 of the odds of its direction.
    #[inline]
    pub fn commit_fast_path_frame(
        &mut self,
        context: &FramerContext<'_>,
        bytes: &[u8],
        stray_bytes: usize,
        length: FrameLength,
        odds: f32,
    ) {
        if self.lattice.len() > 1 {
            self.lattice.truncate(1);
        }
        let (strays, frame_and_more) = bytes.split_at(stray_bytes);
        let frame = &frame_and_more[..length.bytes()];
        let request_outstanding = self.lattice[ROOT].answerable.outstanding.is_some();
        let (direction, copy) = if length.is_request() {
            (REQUEST, self.take_fast_path_request(context, frame_and_more, frame.len()))
        } else {
            self.take_fast_path_response(context, frame);
            (RESPONSE, RequestCopy::Unclear)
        };
        let start = self.committed_offset() + stray_bytes as u64;
        self.move_root(direction, start..start + frame.len() as u64, odds);
        // The layout of such a frame is known, so there is no length to be learned.
        let position = FramePosition { request_outstanding, unframed_bytes: stray_bytes as u64 };
        self.model.learn(frame, direction, position, copy);
        if stray_bytes > 0 {
            self.model.learn_noise(strays);
        }
    }

    /// Makes the first `length` of these bytes, a request that the fast path found, the outstanding one, and the one outstanding
    /// before it the superseded one; a broadcast leaves none outstanding. Returns what it teaches about echoes: the fast path
    /// takes no retries, so it is no copy, unless its response may look like it.
    #[inline]
    fn take_fast_path_request(&mut self, context: &FramerContext<'_>, frame_and_more: &[u8], length: usize) -> RequestCopy {
        let frame = FrameBytes(&frame_and_more[..length]);
        self.learn_request(frame.0);
        self.reserve_request();
        let row = context.functions.row(frame.code(), &frame.0[2..]);
        let expected_response = row.and_then(|row| expected_response(row, frame.pdu()));
        let answerable = &mut self.lattice[ROOT].answerable;
        self.requests.set_outstanding(answerable, frame_and_more, length, expected_response);
        match row {
            Some(row) if !row.has_equal_layouts => RequestCopy::First,
            _ => RequestCopy::Unclear,
        }
    }

    /// Takes a frame that the fast path found as the response to the outstanding request, which is answered with it. So it is
    /// not late itself; but it may be the response to a retry, which is counted.
    #[inline]
    fn take_fast_path_response(&mut self, context: &FramerContext<'_>, frame: &[u8]) {
        self.learn_late_response(context, frame, true);
        self.learn_response_to_lone_frame(frame);
        self.model.learn_silence(frame[0], false);
        self.lattice[ROOT].answerable.answer(frame);
    }

    /// Makes the frame with these stream offsets (the end excluded) the root, with nothing scanned after it and nothing doubtful
    /// about it. `odds` are log2 of the odds of its direction.
    #[inline]
    fn move_root(&mut self, direction: usize, frame: Range<u64>, odds: f32) {
        let root = &mut self.lattice[ROOT];
        (root.direction, root.start, root.end) = (direction, frame.start, frame.end);
        (self.scanned_to, self.is_scanning, self.last_was_doubtful) = (frame.end, false, false);
        self.last_lone_frame = None;
        self.run_odds = odds;
    }

    /// If the outstanding request stood alone in noise: a response that differs from it proves it.
    #[inline]
    fn learn_response_to_lone_frame(&mut self, response: &[u8]) {
        let Some(key) = self.last_lone_frame else { return };
        if self.outstanding_request().is_some_and(|request| request.pdu != response[1..response.len() - 2]) {
            self.lone_frames.record_response(key);
        }
    }

    /// Takes over a transaction that the batch fast path framed and that ends at stream offset `end`, as if
    /// `commit_fast_path_frame` had committed both of its frames; the model has learned from them already. `request` and
    /// `response` have their CRCs; `odds` are log2 of the odds of the response's direction. No hypotheses are left: the batch
    /// begins only where there are none.
    pub fn sync_after_batch(&mut self, request: &[u8], response: &[u8], end: u64, odds: f32) {
        self.reserve_request();
        let answerable = &mut self.lattice[ROOT].answerable;
        self.requests.set_outstanding(answerable, request, request.len(), None);
        answerable.answer(response);
        self.move_root(RESPONSE, end - response.len() as u64..end, odds);
    }
}
