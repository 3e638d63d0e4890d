//! The state of the search over one line, what it has committed, and the frames that the fast path commits past it.

use crate::fast_path::frame_check::{expected_response, FrameLength};
use crate::framer::rtu::answerable::{Answerable, AnswerableRequests, HeldRequest, RequestPool};
use crate::framer::rtu::crc_scan::CrcScanner;
use crate::framer::rtu::lone_frames::LoneFrames;
use crate::framer::rtu::search::commit::SkipAhead;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::side::{self, REQUEST, RESPONSE};
use crate::framer::rtu::traffic_model::{FramePosition, RequestCopy, TrafficModel};
use crate::framer::FramerContext;
use crate::weights::CERTAIN_DIRECTION_BITS;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::Ns;

/// The search over one line.
pub struct Search {
    /// The frame hypotheses behind the last frame committed, which is the root. Parents stand before their children.
    pub(super) lattice: Vec<Hypothesis>,
    pub(super) scanner: CrcScanner,
    /// Starts of the valid substrings that end at the last byte scanned.
    pub(super) valid_starts: Vec<u64>,
    /// Stream offset behind the last byte scanned.
    pub(super) scanned_to: u64,
    /// The scanner stands at `scanned_to`, so the search goes on there; else it begins anew behind the root.
    pub(super) is_scanning: bool,
    /// Offsets before which nothing can be decided.
    pub(super) skip: SkipAhead,
    /// The requests that hypotheses refer to.
    pub(super) requests: RequestPool,
    /// The last frame committed is unconfirmed, or a piece of noise was committed that goes on.
    pub(super) last_was_doubtful: bool,
    /// The shortest pause between frames, as the framer knows it.
    pub(super) frame_gap_ns: Ns,
    /// Log2 of the odds that the direction of the frame committed last is right, in a row of equal frames.
    pub(super) run_odds: f32,
    /// How many valid frames the search committed last without a byte between them. The fast path does not count here.
    pub(super) adjacent_frames: u8,
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
            scanned_to: 0,
            is_scanning: false,
            skip: SkipAhead::default(),
            requests: RequestPool::default(),
            last_was_doubtful: false,
            frame_gap_ns: Ns::MAX,
            run_odds: CERTAIN_DIRECTION_BITS,
            adjacent_frames: 0,
            lone_frames: LoneFrames::default(),
            last_lone_frame: None,
            model: TrafficModel::default(),
        }
    }
}

/// What was committed, and what is outstanding behind it.
impl Search {
    /// The stream offset up to which results are committed.
    #[inline]
    pub fn committed_offset(&self) -> u64 {
        self.lattice[ROOT].end
    }

    /// Whether no byte behind the committed ones was scanned.
    pub fn is_idle(&self) -> bool {
        self.lattice.len() == 1 && (!self.is_scanning || self.scanned_to == self.committed_offset())
    }

    /// Whether no byte behind this stream offset was scanned, and no request may be answered there.
    pub fn is_settled_at(&self, offset: u64) -> bool {
        let Answerable { outstanding, superseded, .. } = self.lattice[ROOT].answerable;
        self.lattice.len() == 1 && self.committed_offset() == offset && outstanding.is_none() && superseded.is_none()
    }

    /// The direction of the frame committed last.
    #[inline]
    pub fn last_direction(&self) -> Direction {
        side::direction_of(self.lattice[ROOT].direction)
    }

    /// The outstanding request.
    #[inline]
    pub fn outstanding_request(&self) -> Option<&HeldRequest> {
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
    /// Whether no hypothesis speaks against a fast-path frame behind the root and some stray bytes: there is none, or the best
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

    /// Whether the outstanding request is neither unconfirmed nor damaged: then an unambiguous frame behind stray bytes needs no
    /// search.
    pub fn has_sound_outstanding_request(&self) -> bool {
        self.outstanding_request().is_none_or(|request| !request.is_unconfirmed && !request.is_damaged)
    }

    /// Commits a frame that the fast path found behind the root and `stray_bytes` bytes: it becomes the root and teaches the
    /// model, as if the search had committed it. All hypotheses are dropped. The caller has checked layout and CRC.
    ///
    /// `bytes` begin at the root's end; `odds` are log2 of the odds of its direction. A request becomes the outstanding one, and the one before it superseded; a broadcast
    /// leaves none outstanding. A response answers the outstanding request.
    #[inline]
    pub fn commit_fast_path_frame(
        &mut self,
        context: &FramerContext<'_>,
        bytes: &[u8],
        stray_bytes: usize,
        length: FrameLength,
        odds: f32,
    ) {
        self.run_odds = odds;
        if self.lattice.len() > 1 {
            self.lattice.truncate(1);
        }
        let (strays, frame_and_more) = bytes.split_at(stray_bytes);
        let frame = &frame_and_more[..length.bytes()];
        let request_outstanding = self.lattice[ROOT].answerable.outstanding.is_some();
        let mut request_copy = RequestCopy::Unclear;
        let direction = if length.is_request() { REQUEST } else { RESPONSE };
        if length.is_request() {
            self.learn_request(frame);
            self.reserve_request();
            let row = context.functions.row(frame[1], &frame[2..]);
            let expected_response = row.and_then(|row| expected_response(row, &frame[1..frame.len() - 2]));
            if row.is_some_and(|row| !row.has_equal_layouts) {
                // The fast path does not take retries, and the response cannot look like this request.
                request_copy = RequestCopy::First;
            }
            let answerable = &mut self.lattice[ROOT].answerable;
            self.requests.set_outstanding(answerable, frame_and_more, frame.len(), expected_response);
        } else {
            // It answers, so it is not late itself; but it may be the response to a retry, which is counted.
            self.learn_late_response(context, frame, true);
            self.learn_response_to_lone_frame(frame);
            self.model.learn_silence(frame[0], false);
            self.lattice[ROOT].answerable.answer(frame);
        }
        self.last_lone_frame = None;
        let root = &mut self.lattice[ROOT];
        root.direction = direction;
        root.start = root.end + stray_bytes as u64;
        root.end = root.start + frame.len() as u64;
        self.scanned_to = root.end;
        (self.is_scanning, self.last_was_doubtful) = (false, false);
        // The layout of such a frame is known, so there is no length to be learned.
        let position = FramePosition { request_outstanding, unframed_bytes: stray_bytes as u64 };
        self.model.learn(frame, direction, position, request_copy);
        if stray_bytes > 0 {
            self.model.learn_noise(strays);
        }
    }

    /// If the outstanding request stood alone in noise: a response that differs from it proves it.
    #[inline]
    fn learn_response_to_lone_frame(&mut self, response: &[u8]) {
        let Some(key) = self.last_lone_frame else { return };
        if self.outstanding_request().is_some_and(|request| request.pdu != response[1..response.len() - 2]) {
            self.lone_frames.record_response(key);
        }
    }

    /// Takes over a transaction that the batch fast path framed and that ends here, as if `commit_fast_path_frame` had
    /// committed both of its frames; the model has learned from them already.
    pub fn sync_after_batch(&mut self, request: &[u8], response: &[u8], end: u64, odds: f32) {
        self.run_odds = odds;
        self.reserve_request();
        let answerable = &mut self.lattice[ROOT].answerable;
        self.requests.set_outstanding(answerable, request, request.len(), None);
        answerable.answer(response);
        let root = &mut self.lattice[ROOT];
        (root.direction, root.start, root.end) = (RESPONSE, end - response.len() as u64, end);
        (self.scanned_to, self.is_scanning, self.last_was_doubtful) = (end, false, false);
        self.last_lone_frame = None;
    }
}
