//! How a server numbers its responses, where it does not repeat the identifiers of requests.

/// Responses in a row by which a server shows that it does not repeat identifiers.
const MIN_CONSISTENT_RESPONSES: u8 = 2;

/// How the identifiers of a server's responses differ from those of the requests that they fit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct IdHabit {
    /// The identifier of the last such response, and by how much it exceeds that of the request.
    last: Option<(u16, u16)>,
    /// Responses in a row with the same identifier ...
    same_id: u8,
    /// ... and with the same difference.
    same_difference: u8,
}

impl IdHabit {
    /// Counts a response that fits a request with another identifier; whether the habit is known by now.
    pub(super) fn observe(&mut self, response_id: u16, request_id: u16) -> bool {
        let difference = response_id.wrapping_sub(request_id);
        // Zero is what servers send that ignore the field.
        let before = self.last.replace((response_id, difference)).unwrap_or((0, difference.wrapping_add(1)));
        let count = |is_same: bool, count: u8| if is_same { count.saturating_add(1) } else { 1 };
        self.same_id = count(before.0 == response_id, self.same_id.max(1));
        self.same_difference = count(before.1 == difference, self.same_difference);
        self.is_known(response_id, request_id)
    }

    /// Whether a response with this identifier to a request with that one is what the server does.
    pub(super) fn is_known(self, response_id: u16, request_id: u16) -> bool {
        let Some((id, difference)) = self.last else { return false };
        (self.same_id >= MIN_CONSISTENT_RESPONSES && id == response_id)
            || (self.same_difference >= MIN_CONSISTENT_RESPONSES && difference == response_id.wrapping_sub(request_id))
    }
}
