//! Whether a line shows which side of it is heard.
//!
//! The response to a write repeats it. So a tap that hears the units only hears what looks like requests that nobody answers, and
//! so does a tap on a line whose units are all dead. Where all frames are of this kind and hardly one was ever answered, nothing
//! distinguishes the two. A request that is sent again does: responses come once.

use crate::framer::rtu::context_score::mirrors_request;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::FramerContext;
use crate::input::Input;
use crate::rtu_model::answerable::AnswerableRequest;
use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::side::REQUEST;
use crate::rtu_model::traffic_model::heard_sides::{self, Turns};
use crate::weights;
use modlens_protocol::direction::{match_response, repeats_other_address, ResponseMatch};

/// Whether nothing shows that this frame, the first one of the path that ends with the frame `path_end` (an index of the lattice),
/// is a request: it may be a response by its layout, and so may all frames before it; it is not the one before it again;
/// and requests are left for others without a response, by what the line has shown and by the frames on that path.
pub(super) fn hears_unknown_side(
    search: &Search,
    input: &Input,
    context: &FramerContext<'_>,
    frame: FrameBytes<'_>,
    path_end: usize,
) -> bool {
    if context.is_multi_line || context.line_direction.is_some() || !mirrors_request(context, frame.pdu()) {
        return false;
    }
    let is_same = search.outstanding_request().is_some_and(|request| request.matches_frame(frame));
    let is_open = || {
        turns_ahead(search, input, context, path_end).is_some_and(|turns| heard_sides::hears_unknown_side(&search.model, turns))
    };
    !is_same && !search.model.has_plain_requests(context.functions) && is_open()
}

/// What the frames say of requests on the path that ends with the frame `path_end`; `None` where one of them shows by its layout
/// who has sent it.
fn turns_ahead(search: &Search, input: &Input, context: &FramerContext<'_>, path_end: usize) -> Option<Turns> {
    let (mut at, mut turns) = (path_end, Turns::default());
    while at != ROOT {
        let Hypothesis { start, end, direction, parent, answers_outstanding, is_crc_valid, .. } = search.lattice[at];
        let index = |offset: u64| (offset - input.offset()) as usize;
        let frame = FrameBytes(&input.bytes()[index(start)..index(end)]);
        if !mirrors_request(context, frame.pdu()) {
            return None;
        }
        let outstanding = search.lattice[parent].answerable.outstanding.map(|id| search.requests.get(id));
        // Else the response may be among the bytes between, or be the damaged frame.
        let follows_at_once = is_crc_valid && start - search.lattice[parent].end < weights::MAY_HIDE_FRAME_BYTES;
        if let Some(outstanding) = outstanding.filter(|_| follows_at_once) {
            let is_answer = direction != REQUEST && answers_fully(context, outstanding, frame);
            let is_left = if direction == REQUEST {
                !outstanding.matches_frame(frame)
            } else {
                answers_outstanding && is_next_write(context, outstanding, frame)
            };
            turns.answered += f32::from(u8::from(is_answer));
            turns.left += f32::from(u8::from(is_left));
        }
        at = parent;
    }
    Some(turns)
}

/// Whether a frame that answers this write in part has another address, so that it may as well be the next write.
pub(super) fn is_next_write(context: &FramerContext<'_>, request: &AnswerableRequest, frame: FrameBytes<'_>) -> bool {
    let row = context.functions.row(request.pdu[0], &request.pdu[1..]);
    row.is_some_and(|row| row.has_equal_layouts && repeats_other_address(row, &request.pdu, frame.pdu()))
}

/// Whether a response fits this request in full.
pub(super) fn answers_fully(context: &FramerContext<'_>, request: &AnswerableRequest, response: FrameBytes<'_>) -> bool {
    let (unit, pdu) = (response.unit(), response.pdu());
    match_response(context.functions, request.as_request_ref(), unit, pdu) == ResponseMatch::Fully
}
