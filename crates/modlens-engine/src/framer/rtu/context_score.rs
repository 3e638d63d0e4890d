//! What the frames before it add to the score of a frame hypothesis: whose turn it is, and what of it was to be expected.
//!
//! Direction and pairing are decided together here. A frame is scored as a request or as a response in one place of one path;
//! what it is worth by its own bytes is in `score`. All scores and costs are in bits.

use crate::framer::{FramerContext, PauseEvidence};
use crate::rtu_model::answerable::{fingerprint, AnswerableRequest, AnswerableRequests};
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::side::{REQUEST, RESPONSE};
use crate::rtu_model::traffic_model::{FramePosition, TrafficModel};
use crate::weights;
use modlens_protocol::direction::{counts_registers, expected_data_bytes, match_response, repeats_other_address, ResponseMatch};
use modlens_protocol::functions::{FunctionRow, Layout};

/// Bytes of a response's PDU that repeat its request: function code, address, and value or quantity.
const ECHOED_PDU_BYTES: usize = 5;

/// What stands before a frame hypothesis on its path.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Preceding {
    /// Bytes between the frame before and this one.
    pub unframed_bytes: u64,
    /// The frame's own unit and function stand among them: perhaps its request, damaged.
    pub has_same_header: bool,
}

/// A frame hypothesis in its place on a path, with all that its context score depends on.
#[derive(Clone, Copy)]
pub struct FrameInPlace<'a> {
    /// What the line has taught.
    pub model: &'a TrafficModel,
    /// What the session knows.
    pub context: &'a FramerContext<'a>,
    /// The requests that it may answer here.
    pub answerable: AnswerableRequests<'a>,
    /// Its bytes, CRC included.
    pub frame: FrameBytes<'a>,
    /// What a request is worth, in bits, for being one that was seen before (`TrafficModel::polled_request_score`).
    pub polled_score: f32,
    /// What the silence before it says.
    pub pause: PauseEvidence,
    /// What stands before it.
    pub preceding: Preceding,
}

/// What the frames before it add to a frame hypothesis.
#[derive(Clone, Copy)]
pub struct ContextScore {
    /// The score in bits; may be negative.
    pub bits: f32,
    /// It answers the outstanding request.
    pub answers_outstanding: bool,
}

/// The score that the frames before it add to a frame hypothesis as one of this direction (`REQUEST` or `RESPONSE`). A request
/// never answers.
pub fn context_score(place: &FrameInPlace<'_>, direction: usize) -> ContextScore {
    // Between two frames stand other bytes, so the second one does not come at once.
    let too_soon_bits = if place.preceding.unframed_bytes == 0 { place.pause.too_soon_bits } else { [0.0; 2] };
    let place = FrameInPlace { pause: PauseEvidence { too_soon_bits, ..place.pause }, ..*place };
    if direction == REQUEST {
        ContextScore { bits: request_score(&place), answers_outstanding: false }
    } else {
        response_score(&place)
    }
}

/// Whether the response to this request repeats it byte by byte, as that to function 6 does. `pdu` is the request's.
pub fn mirrors_request(context: &FramerContext<'_>, pdu: &[u8]) -> bool {
    context.functions.row(pdu[0], &pdu[1..]).is_some_and(|row| row.has_equal_layouts)
}

/// What several scores below are made of.
impl FrameInPlace<'_> {
    fn position(&self) -> FramePosition {
        let request_outstanding = self.answerable.outstanding.is_some();
        FramePosition { request_outstanding, unframed_bytes: self.preceding.unframed_bytes }
    }

    /// Whether this request has the frame's unit and PDU.
    fn equals(&self, request: &AnswerableRequest) -> bool {
        request.unit == self.frame.unit() && request.pdu == self.frame.pdu()
    }

    /// Whether the frame is a response that fits this request in full.
    fn answers_fully(&self, request: &AnswerableRequest) -> bool {
        self.match_with(request) == ResponseMatch::Fully
    }

    fn match_with(&self, request: &AnswerableRequest) -> ResponseMatch {
        match_response(self.context.functions, request.as_request_ref(), self.frame.unit(), self.frame.pdu())
    }

    /// What unit and function code cost in this direction: the score of their being predicted.
    fn known_header_score(&self, direction: usize) -> f32 {
        let (unit, code) = (self.frame.unit(), self.frame.code());
        self.model.unit_cost(unit) + self.model.function_cost(self.context.functions, code, direction)
    }

    /// The information content of the body: the score of its being predicted.
    fn known_body_score(&self) -> f32 {
        self.model.bits_of(self.frame.body())
    }

    /// The function's row by this request, which the frame answers; `None` for an exception response: a request predicts
    /// nothing of its body.
    fn row_of_answered(&self, request: &AnswerableRequest) -> Option<&FunctionRow> {
        let row = self.context.functions.row(request.pdu[0], &request.pdu[1..]);
        row.filter(|_| !self.frame.is_exception())
    }

    /// Whether the request that was answered last was heard twice before its response.
    fn last_was_echoed(&self) -> bool {
        self.answerable.last_answered.is_some_and(|(request, _)| request.is_repeated)
    }

    /// Whether the same bytes again, as a retry or as a response that equals its request, prove nothing: the frame stands
    /// after noise (`MAY_HIDE_FRAME_BYTES` or more), which repeats itself, and no frame that teaches has named its unit; or only
    /// responses are heard, of which equal ones follow each other.
    fn is_expected_again(&self) -> bool {
        let is_in_noise = self.preceding.unframed_bytes >= weights::MAY_HIDE_FRAME_BYTES;
        (is_in_noise && !self.model.has_unit(self.frame.unit())) || self.model.hears_responses_only()
    }
}

/// The score of a request in its place. Either it gains what the dictionary predicts of its bytes, if it was polled, or what the
/// same request before it predicts, whichever is more; and it costs the turn that it takes.
fn request_score(place: &FrameInPlace<'_>) -> f32 {
    match place.answerable.outstanding {
        None => due_request_score(place),
        Some(outstanding) if place.equals(outstanding) => copied_request_score(place, outstanding),
        Some(_) => other_request_score(place),
    }
}

/// The score of a request while none is outstanding.
fn due_request_score(place: &FrameInPlace<'_>) -> f32 {
    place.polled_score.max(request_again_score(place)) - place.model.request_turn_cost(place.position())
}

/// The score of a request while none is outstanding, for being one that stood there before: the one answered last, if its
/// response was equal to it, or a superseded one. Its unit, function and body are known then. 0 for any other, and 0 where
/// responses have a line of their own, because no response looks like a request there.
fn request_again_score(place: &FrameInPlace<'_>) -> f32 {
    if place.context.is_multi_line || place.is_expected_again() {
        return 0.0;
    }
    let equals_answered = |(request, response)| place.equals(request) && response == fingerprint(place.frame.0);
    let choice = if place.answerable.last_answered.is_some_and(equals_answered) {
        place.model.same_again_cost() - place.pause.poll.min(0.0) + place.pause.too_soon_bits[1]
    } else if place.answerable.superseded.is_some_and(|request| place.equals(request)) {
        weights::RETRY_CHOICE_BITS
    } else {
        return 0.0;
    };
    place.known_header_score(REQUEST) + place.known_body_score() - choice
}

/// The score of a request that equals the outstanding one: a retry, or, unless that was heard twice already, its echo by the
/// tap's own adapter, whichever costs less.
fn copied_request_score(place: &FrameInPlace<'_>, outstanding: &AnswerableRequest) -> f32 {
    let retry = retry_cost(place);
    let copy = if outstanding.is_repeated { retry } else { retry.min(echo_cost(place)) };
    if place.is_expected_again() {
        return place.polled_score - copy;
    }
    let known = place.known_header_score(REQUEST) + place.known_body_score();
    place.polled_score.max(known - weights::RETRY_CHOICE_BITS) - copy
}

/// Cost of a request that equals the outstanding one, as its retry: that the first one stays unanswered, less for a unit that
/// was silent twice already (the superseded request is the same, too), and more where the silence before it is rather a
/// response time than a timeout. Where the response would repeat the request, the silences of this very unit count, and that
/// a retry does not come at once.
fn retry_cost(place: &FrameInPlace<'_>) -> f32 {
    let mirrors = mirrors_request(place.context, place.frame.pdu());
    let unanswered = if mirrors {
        place.model.silence_costs(place.frame.unit(), place.position()).silent
    } else {
        place.model.request_turn_cost(place.position())
    };
    let is_third = place.answerable.superseded.is_some_and(|request| place.equals(request));
    let unanswered = if is_third { unanswered.min(weights::STILL_SILENT_BITS) } else { unanswered };
    let too_soon = if mirrors { place.pause.too_soon_bits.iter().sum::<f32>() } else { 0.0 };
    unanswered - place.pause.timeout.min(0.0) + too_soon
}

/// Cost of a request that equals the outstanding one, as the echo of the tap's own adapter, which comes once and at once. Where
/// the response would repeat the request, the one before it may have been echoed, which makes this one cheaper, and a silence
/// as long as a response time makes it dearer. One too short to stand between two frames is no response time; but where other
/// requests show whether there is echo, they tell more than that.
fn echo_cost(place: &FrameInPlace<'_>) -> f32 {
    let mirrors = mirrors_request(place.context, place.frame.pdu());
    let again = if mirrors && place.last_was_echoed() { weights::ECHO_AGAIN_BITS } else { f32::MAX };
    let is_early = place.pause.too_soon_bits[0] > 0.0 && !place.model.has_plain_requests(place.context.functions);
    let late = if mirrors && !is_early { (-place.pause.timeout).clamp(0.0, weights::LATE_ECHO_BITS) } else { 0.0 };
    place.model.echo_costs().twice.min(again) + late
}

/// The score of a request that differs from the outstanding one, which is left unanswered. It costs more where it comes as early
/// as responses do: no master gives up as soon as that. After unframed bytes that does not count: the response may be among
/// them; and where hardly any response is heard, its time proves nothing. Where it equals the superseded request, the
/// outstanding one was rather another frame, and its body is known.
fn other_request_score(place: &FrameInPlace<'_>) -> f32 {
    let is_superseded = place.answerable.superseded.is_some_and(|request| place.equals(request));
    let known = if is_superseded { place.known_body_score() - weights::RETRY_CHOICE_BITS } else { 0.0 };
    let follows_at_once = place.preceding.unframed_bytes == 0;
    let too_soon = if follows_at_once { (-place.pause.timeout).clamp(0.0, weights::TOO_SOON_BITS) } else { 0.0 };
    let too_soon = too_soon * place.model.heard_responses(place.position());
    place.polled_score.max(known) - place.model.request_turn_cost(place.position()) - too_soon
}

/// The score of a response in its place, and whether it answers the outstanding request: it does if it has the unit and the
/// function of that request, exceptions included.
fn response_score(place: &FrameInPlace<'_>) -> ContextScore {
    let answered = place.answerable.outstanding.map(|request| (request, place.match_with(request)));
    match answered {
        Some((request, matched)) if matched != ResponseMatch::No => {
            ContextScore { bits: answering_response_score(place, request, matched), answers_outstanding: true }
        }
        _ => ContextScore { bits: unsolicited_response_score(place), answers_outstanding: false },
    }
}

/// The score of a response that does not answer the outstanding request: as the late response to the superseded request, as a
/// copy of the last response, or as an unsolicited one, whichever is most. An unsolicited one costs its turn, and more where
/// none is outstanding and its own request may stand damaged among the bytes before it. After a silence in which the outstanding
/// request was given up, it is rather the next request.
fn unsolicited_response_score(place: &FrameInPlace<'_>) -> f32 {
    let follows_damage = place.preceding.has_same_header && place.answerable.outstanding.is_none();
    let damaged_request = if follows_damage { weights::DAMAGED_REQUEST_BITS } else { 0.0 };
    let may_be_request = place.answerable.outstanding.is_some() && place.preceding.unframed_bytes == 0;
    let given_up = if may_be_request { place.pause.timeout.clamp(0.0, weights::GIVEN_UP_BITS) } else { 0.0 };
    let unsolicited = place.model.unsolicited_turn_cost(place.position()) - damaged_request + given_up;
    let late = late_response_score(place).unwrap_or(f32::MIN);
    let copied = copied_response_score(place).unwrap_or(f32::MIN);
    late.max(copied).max(-unsolicited)
}

/// The score of a response to this outstanding request, which it fits in full or in part (`matched`): unit and function are
/// predicted, and perhaps bytes of the body. One that equals its request may be an echo or a retry instead; and where only
/// responses are heard, that one was a response like this, and predicts nothing.
fn answering_response_score(place: &FrameInPlace<'_>, request: &AnswerableRequest, matched: ResponseMatch) -> f32 {
    let is_doubtful = request.pdu == place.frame.pdu() && place.model.hears_responses_only();
    let header = if is_doubtful { 0.0 } else { place.known_header_score(RESPONSE) };
    let score = header - weights::ANSWERED_BITS + answering_body_score(place, request, matched);
    if request.pdu != place.frame.pdu() {
        return score;
    }
    // How often this very unit answers, instead of how often units do.
    let answered = place.model.silence_costs(place.frame.unit(), place.position()).answered;
    score + (weights::ANSWERED_BITS - answered) - mirrored_response_cost(place, request)
}

/// The score of the body of a response to this request: of the bytes that the request predicts, or of all where the same
/// response was given last time. A count or a field that disagrees breaks a rule. 0 for an exception response, and where
/// the request is damaged or its function has no response: then no byte is predicted.
fn answering_body_score(place: &FrameInPlace<'_>, request: &AnswerableRequest, matched: ResponseMatch) -> f32 {
    let Some(row) = place.row_of_answered(request) else { return 0.0 };
    let equals_last = place.answerable.last_answered.is_some_and(|(_, last)| last == fingerprint(place.frame.0));
    if row.response == Layout::NoResponse || request.is_damaged {
        0.0
    } else if counts_registers(row, &request.pdu, place.frame.pdu()) {
        // Its layout has paid for the wrong count, which the request predicts.
        place.model.bits(place.frame.body()[0])
    } else if matched == ResponseMatch::Partly && repeats_other_address(row, &request.pdu, place.frame.pdu()) {
        -weights::OTHER_ADDRESS_BITS
    } else if matched == ResponseMatch::Partly && row.has_equal_layouts && request.pdu.len() == place.frame.pdu().len() {
        -weights::OTHER_VALUE_BITS
    } else if matched == ResponseMatch::Partly {
        -weights::BROKEN_RULE_BITS
    } else if equals_last {
        place.known_body_score()
    } else if request.pdu == place.frame.pdu() && place.is_expected_again() {
        0.0
    } else {
        predicted_body_score(place.model, row, request, place.frame.pdu())
    }
}

/// Cost of a response that equals its request for not being what else such a frame may be: a retry, where the silence before it
/// is rather a timeout; what comes too soon for a response; or, unless this request was heard twice already, its echo.
fn mirrored_response_cost(place: &FrameInPlace<'_>, request: &AnswerableRequest) -> f32 {
    let missing_echo = if place.last_was_echoed() { weights::ECHO_MISSING_BITS } else { 0.0 };
    let echo = if request.is_repeated { 0.0 } else { place.model.echo_costs().once.max(missing_echo) };
    place.pause.timeout.max(0.0) + place.pause.too_soon_bits[0] + echo
}

/// The score of the bytes of a response that its request predicts: the byte count; or all of them if it equals its request;
/// or the two fields in front where it repeats any (`row.echo`). `pdu` is the response's, which answers in full.
fn predicted_body_score(model: &TrafficModel, row: &FunctionRow, request: &AnswerableRequest, pdu: &[u8]) -> f32 {
    if expected_data_bytes(row, &request.pdu).is_some() {
        model.bits(pdu[1])
    } else if request.pdu == pdu && row.has_equal_layouts {
        model.bits_of(&pdu[1..])
    } else if row.echo.is_empty() {
        0.0
    } else {
        model.bits_of(&pdu[1..pdu.len().min(ECHOED_PDU_BYTES)])
    }
}

/// The score of a response as the late response to the superseded request; `None` unless it answers that one in full. One that
/// equals the request is rather its retry after a timeout, and rather something else where a whole exchange lies between.
fn late_response_score(place: &FrameInPlace<'_>) -> Option<f32> {
    let request = place.answerable.superseded.filter(|request| place.answers_fully(request))?;
    let is_mirrored = request.pdu == place.frame.pdu();
    let may_be_request = if is_mirrored { place.pause.timeout.max(0.0) + spanning_cost(place, request) } else { 0.0 };
    let row = place.row_of_answered(request);
    let body = row.map_or(0.0, |row| predicted_body_score(place.model, row, request, place.frame.pdu()));
    Some(place.known_header_score(RESPONSE) + body - (place.model.late_response_cost() + may_be_request))
}

/// The score of a response as a copy of the last one; `None` unless it has the length and the CRC of that and answers the same
/// request in full. One that equals its request is rather that request again, so it is `None` as well.
fn copied_response_score(place: &FrameInPlace<'_>) -> Option<f32> {
    let (request, last) = place.answerable.last_answered?;
    if last != fingerprint(place.frame.0) || request.pdu == place.frame.pdu() || !place.answers_fully(request) {
        return None;
    }
    // A copy has to agree in every byte. If less were enough, the two would look like a request and its retry.
    let body = place.row_of_answered(request).map_or(0.0, |_| place.known_body_score());
    Some(place.known_header_score(RESPONSE) + body - weights::REPEATED_RESPONSE_BITS)
}

/// Cost of a late response that equals this superseded request, for what stands between the two: nothing while a request is
/// outstanding, or if the request answered last is the retry of this one; else a whole exchange.
fn spanning_cost(place: &FrameInPlace<'_>, request: &AnswerableRequest) -> f32 {
    let is_retry = |(other, _): (&AnswerableRequest, _)| other.unit == request.unit && other.pdu == request.pdu;
    if place.answerable.outstanding.is_some() || place.answerable.last_answered.is_some_and(is_retry) {
        0.0
    } else {
        weights::SPANS_EXCHANGE_BITS
    }
}
