//! Requests and responses as an index of learned counts.

use modlens_protocol::direction::Direction;

/// The index of learned counts for requests.
pub const REQUEST: usize = 0;
/// The index of learned counts for responses.
pub const RESPONSE: usize = 1;

/// The direction of an index.
pub fn direction_of(index: usize) -> Direction {
    if index == REQUEST {
        Direction::Request
    } else {
        Direction::Response
    }
}

/// The index of a direction; an unknown one counts as a request.
pub fn index_of(direction: Direction) -> usize {
    if direction == Direction::Response {
        RESPONSE
    } else {
        REQUEST
    }
}
