//! What a filter is refused with.

use std::fmt;

use crate::spelling::quoted;

/// A filter that cannot be understood.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FilterError {
    /// What is wrong.
    pub message: String,
    /// The filter.
    pub text: String,
    /// Where, in characters from 0.
    pub column: Option<usize>,
    /// The nearest known name.
    pub hint: Option<String>,
}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = quoted(&self.text);
        let place = self.column.map_or_else(|| format!("in {text}"), |column| format!("column {} of {text}", column + 1));
        let question = self.hint.as_ref().map(|hint| format!("; did you mean {}?", quoted(hint))).unwrap_or_default();
        let whole = format!("{} ({place}){question}", self.message);
        f.write_str(&whole.split_whitespace().collect::<Vec<_>>().join(" "))
    }
}

impl std::error::Error for FilterError {}
