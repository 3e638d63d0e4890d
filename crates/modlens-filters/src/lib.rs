//! The language of filters: one Python-like expression that chooses rows of one table (`--where`).
//!
//! `analyzer/filters.py` describes the language and the tree that it becomes; `modlens_tables::predicate` evaluates the tree.
//! What is refused comes with the place in the text, and with what to write instead.
//!
//! - `lexer`, `parser`, `syntax`: the text, as Python reads it.
//! - `compiler`, `values`, `comparing`, `registers`, `moments`, `address`: what it means for a table.
//! - `refusals`, `words`, `word_tables`, `similar`: what people write instead, and what to write.
//! - `spelling`: the normalized spelling.

mod address;
mod comparing;
mod compiler;
mod error;
mod lexer;
mod moments;
mod parser;
mod refusals;
mod registers;
mod similar;
mod spelling;
mod syntax;
mod terms;
mod values;
mod word_tables;
mod words;

pub use error::FilterError;
use modlens_tables::predicate::Predicate;
pub use moments::{Changes, LocalChanges};
use serde_json::Value as Json;
pub use similar::similar_name;

/// The longest filter, in characters.
pub const MAX_CHARACTERS: usize = 4096;

/// A filter for the rows of one table.
#[derive(Clone, Debug, PartialEq)]
pub struct Filter {
    /// Its normalized spelling.
    pub text: String,
    /// What it compares, as `Predicate` takes it.
    pub tree: Json,
    /// Sentences about what is valid, but may be meant otherwise.
    pub notes: Vec<String>,
}

/// Parses a filter for the rows of a table. A table that does not exist has no columns.
pub fn parse(text: &str, table: &str, local: LocalChanges<'_>) -> Result<Filter, FilterError> {
    let refusal = |message: String, text: &str, column| FilterError { message, text: text.to_owned(), column, hint: None };
    if text.chars().nth(MAX_CHARACTERS).is_some() {
        let begin: String = text.chars().take(20).chain("...".chars()).collect();
        return Err(refusal(format!("a filter has at most {MAX_CHARACTERS} characters"), &begin, None));
    }
    let stripped = text.trim();
    if stripped.is_empty() {
        return Err(refusal(String::from("an empty filter; try `status != 'ok'`"), text, None));
    }
    let expression = parser::parse(stripped).map_err(|error| {
        let (at, message) =
            words::wrong_operator(stripped).unwrap_or((error.at, format!("not an expression: {}", error.message)));
        refusal(message, stripped, Some(at))
    })?;
    let mut compiler = compiler::Compiler::new(stripped, table, local);
    let tree = compiler.condition(&expression)?;
    Ok(Filter { text: spelling::spelled(&expression), tree, notes: compiler.notes })
}

/// Parses a filter, and compiles it for evaluation. The message is for people.
pub fn predicate(text: &str, table: &str, local: LocalChanges<'_>) -> Result<Predicate, String> {
    let filter = parse(text, table, local).map_err(|error| error.to_string())?;
    Predicate::new(table, &filter.tree.to_string())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn parsed(text: &str) -> Result<Filter, FilterError> {
        parse(text, "transactions", &Vec::new)
    }

    #[test]
    fn a_mistake_is_named_with_its_place() {
        for (text, message) in [
            ("unit = 1", "write `==` to compare, not `=` (column 6 of 'unit = 1')"),
            ("untis == 3", "transactions have no column 'untis' (column 1 of 'untis == 3'); did you mean 'unit'?"),
            ("(unit == 1", "not an expression: `(` is never closed (column 1 of '(unit == 1')"),
            ("unit ==", "not an expression: something is missing at its end (column 8 of 'unit ==')"),
        ] {
            assert_eq!(parsed(text).expect_err(text).to_string(), message);
        }
    }

    #[test]
    fn a_time_of_day_that_is_local_asks_for_the_changes() {
        let summer = || vec![(i64::MIN / 2, 3600), (7, 7200)];
        let found = parse("time >= '12:00 local'", "transactions", &summer).expect("valid");
        assert_eq!(found.tree[0], "or");
        assert_eq!(found.tree[1][1], serde_json::json!(["cmp", "<", ["col", "time"], ["time", 7]]));
    }

    proptest! {
        #[test]
        fn any_text_is_a_filter_or_an_error(text in "\\PC{0,40}|[a-z0-9 ()'=<>+,.-]{0,40}") {
            if let Ok(found) = parsed(&text) {
                prop_assert_eq!(parsed(&found.text).expect("its own spelling").tree, found.tree);
            }
        }
    }
}
