//! Odd transactions and bytes, counted by what they mean to the master.

/// Odd transactions and bytes, by what they mean to the master.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Odd {
    /// Failed requests.
    pub failed: u64,
    /// Requests refused by an exception.
    pub refused: u64,
    /// Odd answers, and bytes between frames: nothing that the master asked for was lost by them.
    pub other: u64,
}

impl Odd {
    /// All of them.
    pub fn total(self) -> u64 {
        self.failed + self.refused + self.other
    }
}
