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
    /// A response arrived, but it is damaged, or has another length than was requested.
    BadResponse,
    /// A response without a request.
    Unsolicited,
    /// The recording ended or lost data before a response could be observed.
    NotObserved,
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
        Self::Unsolicited,
        Self::NotObserved,
    ];

    /// What the status means, as `modlens explain` says it.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Ok => "a valid response was received",
            Self::Exception => "the unit refused the request with an exception response",
            Self::NoResponse => "no response arrived before the timeout, or before the master went on",
            Self::Broadcast => "sent to all units; no response is expected",
            Self::BadRequest => "the request was damaged on the line",
            Self::BadResponse => "a response arrived, but it was damaged, or has another length than requested",
            Self::Unsolicited => "a response without a request",
            Self::NotObserved => "the recording does not show whether a response came: it ended, lost data, or the master went on before its timeout",
        }
    }

    /// The value of the `status` column.
    pub fn text(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Exception => "exception",
            Self::NoResponse => "no_response",
            Self::Broadcast => "broadcast",
            Self::BadRequest => "bad_request",
            Self::BadResponse => "bad_response",
            Self::Unsolicited => "unsolicited",
            Self::NotObserved => "not_observed",
        }
    }
}
