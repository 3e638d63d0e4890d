//! The findings of a row, as bits.

use modlens_protocol::finding::{Finding, Severity};

/// The findings of a row, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FindingSet(u64);

impl FindingSet {
    pub(super) fn of(findings: &[Finding]) -> Self {
        Self(findings.iter().fold(0, |set, finding| set | 1 << (*finding as u64)))
    }

    /// Whether there is none.
    pub(super) fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether one of them is more than worth knowing.
    pub fn has_trouble(self) -> bool {
        !self.is_empty() && Finding::ALL.iter().any(|finding| self.has(*finding) && finding.doc().severity != Severity::Info)
    }

    /// The others.
    #[must_use]
    pub fn without(self, finding: Finding) -> Self {
        Self(self.0 & !(1 << (finding as u64)))
    }

    /// Whether a finding is among them.
    #[inline]
    pub fn has(self, finding: Finding) -> bool {
        self.0 >> (finding as u64) & 1 == 1
    }
}
