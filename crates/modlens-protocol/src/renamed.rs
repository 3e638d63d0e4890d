//! Words of columns, statuses and findings that were spelled differently in the version before this one.
//!
//! The former spelling is accepted as input for one version: in filters, in `--columns`, by `modlens explain`, as an
//! attribute of a row in Python, and in captures that modlens has exported. Output has the current spelling only.
//! `docs/records.md` shows this table to users, and a test compares the two.

/// What a word names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vocabulary {
    /// The key of a column.
    Column,
    /// A value of the column `status`.
    Status,
    /// The code of a finding.
    Finding,
}

impl Vocabulary {
    /// The name of the vocabulary, as `_modlens.vocabulary` gives it to Python.
    pub fn text(self) -> &'static str {
        match self {
            Self::Column => "column",
            Self::Status => "status",
            Self::Finding => "finding",
        }
    }
}

/// A word whose spelling has changed.
#[derive(Clone, Copy, Debug)]
pub struct Renamed {
    /// What the word names.
    pub vocabulary: Vocabulary,
    /// The spelling in the version before.
    pub former: &'static str,
    /// The spelling now.
    pub current: &'static str,
}

const fn renamed(vocabulary: Vocabulary, former: &'static str, current: &'static str) -> Renamed {
    Renamed { vocabulary, former, current }
}

/// Every word whose spelling has changed.
pub const RENAMED: &[Renamed] = &[
    renamed(Vocabulary::Column, "tentative", "unconfirmed"),
    renamed(Vocabulary::Column, "cut_by", "delimited_by"),
    renamed(Vocabulary::Column, "late_for", "late_response_to"),
    renamed(Vocabulary::Column, "evidence", "impact"),
    renamed(Vocabulary::Status, "unrequested", "unsolicited"),
    renamed(Vocabulary::Status, "not_seen", "not_observed"),
    renamed(Vocabulary::Finding, "unrequested", "unsolicited"),
    renamed(Vocabulary::Finding, "tentative", "unconfirmed"),
    renamed(Vocabulary::Finding, "glitch", "stray_bytes"),
    renamed(Vocabulary::Finding, "doubled_byte", "duplicate_byte"),
    renamed(Vocabulary::Finding, "gap_inside", "gap_in_frame"),
    renamed(Vocabulary::Finding, "packet_twice", "duplicate_packet"),
    renamed(Vocabulary::Finding, "transaction_id", "transaction_id_mismatch"),
];

/// The current spelling of a word; the word itself if its spelling has not changed.
pub fn current(vocabulary: Vocabulary, word: &str) -> &str {
    let entry = RENAMED.iter().find(|entry| entry.vocabulary == vocabulary && entry.former == word);
    entry.map_or(word, |entry| entry.current)
}

/// The former spelling of a word, if its spelling has changed.
pub fn former(vocabulary: Vocabulary, word: &str) -> Option<&'static str> {
    RENAMED.iter().find(|entry| entry.vocabulary == vocabulary && entry.current == word).map(|entry| entry.former)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_former_spelling_is_also_a_current_one() {
        for entry in RENAMED {
            let taken = RENAMED.iter().any(|other| other.vocabulary == entry.vocabulary && other.current == entry.former);
            assert!(!taken, "{}", entry.former);
            assert_eq!(current(entry.vocabulary, entry.former), entry.current);
            assert_eq!(current(entry.vocabulary, entry.current), entry.current);
            assert_eq!(former(entry.vocabulary, entry.current), Some(entry.former));
        }
    }
}
