//! Whether a line has shown which of its sides is heard, where each frame may be a request or a response by its layout.

use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights::{self, PRIOR_WEIGHT_FRAMES};

/// What came of requests.
#[derive(Clone, Copy, Debug, Default)]
pub struct Turns {
    /// Those that had a response.
    pub answered: f32,
    /// Those without one that were left for another request.
    pub left: f32,
}

/// Learns that a request was left for another one without a response.
pub fn learn_left(model: &mut TrafficModel) {
    let all: f32 = model.unanswered.iter().map(|share| share.all).sum();
    let are_both = all >= PRIOR_WEIGHT_FRAMES && 2.0 * answered(model) >= all;
    model.heard_sides.left += 1.0;
    model.heard_sides.are_both |= are_both;
}

/// Learns that a response does not fit the request that is outstanding, which is left then if the response may as well be another
/// request.
pub fn learn_unfit_response(model: &mut TrafficModel, is_left: bool) {
    model.heard_sides.unfit_responses += 1.0;
    model.heard_sides.left += f32::from(u8::from(is_left));
}

/// Requests that had a response which fits, lately.
fn answered(model: &TrafficModel) -> f32 {
    let answered: f32 = model.unanswered.iter().map(|share| share.all - share.hits).sum();
    (answered - model.heard_sides.unfit_responses).max(0.0)
}

/// Whether requests are left for others again and again, and hardly one was ever answered, by what the line has shown and by what is
/// `ahead`: then these may as well be the responses of a side that is heard alone.
pub fn hears_unknown_side(model: &TrafficModel, ahead: Turns) -> bool {
    let (answered, left) = (answered(model) + ahead.answered, model.heard_sides.left + ahead.left);
    let is_one_sided = left >= weights::MIN_LEFT_FRAMES && answered < weights::UNKNOWN_SIDE_ANSWERED_SHARE * left;
    is_one_sided && !model.heard_sides.are_both
}
