//! Styles of text, which the terminal turns into colours.

/// A text and its style.
pub type StyledText = (String, Style);

/// The style of a part. The terminal chooses its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Plain text.
    Plain,
    /// A column title.
    ColumnHead,
    /// Of minor interest.
    Dim,
    /// Correct.
    Good,
    /// Unusual.
    Odd,
    /// Wrong.
    Bad,
    /// Information.
    Note,
}

impl Style {
    /// Its name; empty for plain text.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::ColumnHead => "head",
            Self::Dim => "dim",
            Self::Good => "good",
            Self::Odd => "odd",
            Self::Bad => "bad",
            Self::Note => "note",
        }
    }
}
