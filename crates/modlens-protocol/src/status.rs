//! How a transaction ended.

/// How a transaction ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Status {
    /// Answered.
    Ok,
    /// Refused.
    Exception,
    /// Not answered.
    NoResponse,
    /// Sent to all; no answer is due.
    Broadcast,
    /// The request arrived damaged.
    BadRequest,
    /// An answer came, but damaged.
    BadResponse,
    /// A response that nobody asked for.
    Unrequested,
    /// The recording ended before an answer could show.
    NotSeen,
}

impl Status {
    /// All of them.
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

    /// As the `status` column spells it.
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
