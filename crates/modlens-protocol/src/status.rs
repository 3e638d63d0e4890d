//! The result of a transaction.

/// The result of a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Status {
    /// The unit responded.
    Ok,
    /// The unit responded with an exception.
    Exception,
    /// The unit did not respond.
    NoResponse,
    /// A broadcast: no unit responds.
    Broadcast,
    /// The request arrived damaged.
    BadRequest,
    /// A response arrived, but it is damaged.
    BadResponse,
    /// A response without a request.
    Unrequested,
    /// The recording does not show whether there was a response.
    NotSeen,
}

impl Status {
    /// All statuses.
    pub const ALL: [Self; 8] = [
        Self::Ok,
        Self::Exception,
        Self::NoResponse,
        Self::Broadcast,
        Self::BadRequest,
        Self::BadResponse,
        Self::Unrequested,
        Self::NotSeen,
    ];

    /// The value of the `status` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Exception => "exception",
            Self::NoResponse => "no_response",
            Self::Broadcast => "broadcast",
            Self::BadRequest => "bad_request",
            Self::BadResponse => "bad_response",
            Self::Unrequested => "unrequested",
            Self::NotSeen => "not_seen",
        }
    }
}
