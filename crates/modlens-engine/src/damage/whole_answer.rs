//! A response that is there with all of its bytes, however many of them are wrong.
//!
//! Between two silences, as soon after the request as responses come, stand just as many bytes as its response has. No other
//! frame, whole or in part, and no noise ends there by chance: what the bytes seem to be on their own counts for less.

use crate::damage::expected_frame::response_length;
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::rtu_model::announced_length::EXCEPTION_RESPONSE_BYTES;
use modlens_protocol::direction::{Direction, RequestRef};

/// The length in bytes of the response that fills the burst at the beginning of the region, which may go on after the region.
/// `None` without times, and on a line of one side.
pub(super) fn length_of_whole_answer(region: &UnframedRegion<'_, '_>) -> Option<usize> {
    let (input, context) = (region.input, region.context);
    let request = context.outstanding_request.filter(|_| input.has_times && context.line_direction.is_none())?;
    let is_awaited = context.paired_units[usize::from(request.unit)] || has_header_of_answer(region, request);
    let length = response_length(region, request)?;
    let pause = input.pause_before(0).filter(|&pause| pause >= region.frame_gap_ns);
    let comes_in_time = pause.is_some() && (context.timeout_log_odds)(pause) <= 0.0;
    let is_one_burst = || input.boundary_after(0, length - 1, region.frame_gap_ns).is_none();
    (is_awaited && comes_in_time && ends_burst(region, length) && is_one_burst()).then_some(length)
}

/// Replaces `frames` by the one response that fills the region, if there is one and they are not a single frame with all of its
/// bytes. On a line where stray bytes are usual, the number of bytes proves less than a frame that was recognised, but for an
/// exception response with just the number of strays that it lacks.
pub(super) fn keep_answer_whole(region: &UnframedRegion<'_, '_>, frames: &mut Vec<DamagedFrame>) {
    let fills_region = |frame: &DamagedFrame| frame.start == 0 && frame.end == region.length;
    let is_exception = |frame: &DamagedFrame| !frame.is_short && frame.end - frame.start == EXCEPTION_RESPONSE_BYTES;
    let is_explained = match &frames[..] {
        [frame] => fills_region(frame) || (!is_exception(frame) && !region.has_few_strays()),
        others => !others.is_empty() && !region.has_few_strays(),
    };
    let Some(request) = region.context.outstanding_request.filter(|_| !is_explained) else { return };
    if length_of_whole_answer(region) == Some(region.length) {
        *frames = vec![DamagedFrame {
            start: 0,
            end: region.length,
            direction: Direction::Response,
            head: Vec::new(),
            is_short: false,
            damage: None,
            is_unidentified: !has_header_of_answer(region, request),
            wrong_head_bytes: 0,
        }];
    }
}

/// Whether the first bytes are unit and function of the response to this request.
fn has_header_of_answer(region: &UnframedRegion<'_, '_>, request: RequestRef<'_>) -> bool {
    let head = region.input.bytes().get(..2);
    head.is_some_and(|head| head[0] == request.unit && request.pdu.first() == Some(&head[1]))
}

/// Whether a silence follows the first `length` bytes of the input.
fn ends_burst(region: &UnframedRegion<'_, '_>, length: usize) -> bool {
    let is_last = region.input.is_closed && region.input.bytes().len() == length;
    is_last || region.input.pause_before(length).is_some_and(|pause| pause >= region.frame_gap_ns)
}
