//! What a filter is refused with: the message, the place in its text, and what may be meant.

use modlens_protocol::renamed::{current, Vocabulary};

use crate::address;
use crate::compiler::Compiler;
use crate::error::FilterError;
use crate::similar::similar_name;
use crate::spelling::quoted;
use crate::syntax::{Kind, Node};
use crate::terms::{Term, TermKind};
use crate::words::{closed_set, column_of_word, instead_of_column, nearest_value, respelled, LEAST_LIKENESS};

/// The longest set of values that a message lists.
const MAX_LISTED: usize = 8;

impl Compiler<'_> {
    /// The error for a place of the filter.
    pub fn refusal(&self, node: &Node, message: impl Into<String>) -> FilterError {
        FilterError { message: message.into(), text: self.text.to_owned(), column: Some(node.start), hint: None }
    }

    /// The current spelling of a value of a column; refused where the column never has it.
    ///
    /// With `is_part` a part of a value will do.
    pub fn known_value<'t>(&self, column: &str, text: &'t str, node: &Node, is_part: bool) -> Result<&'t str, FilterError> {
        let word = respelled(column, text);
        let known = closed_set(column);
        let is_found = known.contains(&word) || (is_part && known.iter().any(|one| one.contains(text)));
        if known.is_empty() || is_found {
            return Ok(word);
        }
        let hint = nearest_value(column, word);
        let listed = if known.len() <= MAX_LISTED { known.join(", ") } else { String::from("listed by `modlens explain`") };
        let values = if hint.is_some() { String::new() } else { format!("; its values are {listed}") };
        let refusal = self.refusal(node, format!("{column} is never {}{values}", quoted(text)));
        Err(FilterError { hint: hint.map(ToOwned::to_owned), ..refusal })
    }

    /// Refuses a word without quotes that is compared with a column of texts or times.
    pub fn check_quotes(&self, column: &Node, word: &Node) -> Result<(), FilterError> {
        let (Kind::Name(column), Kind::Name(name)) = (&column.kind, &word.kind) else { return Ok(()) };
        let key = current(Vocabulary::Column, column);
        let Some(kind) = self.kind_of(key) else { return Ok(()) };
        let there = self.kind_of(current(Vocabulary::Column, name));
        if kind == TermKind::Number && there.is_none() && self.kind_of(&format!("{key}_name")).is_some() {
            self.check_number_name(key, name, word)?;
        }
        let is_nothing = ["none", "null", "nil"].contains(&name.to_lowercase().as_str());
        if !matches!(kind, TermKind::Text | TermKind::Time) || there == Some(kind) || is_nothing {
            return Ok(());
        }
        let known = closed_set(key);
        let mut meant = respelled(key, name);
        if !known.is_empty() && !known.contains(&meant) {
            meant = nearest_value(key, meant).unwrap_or(known[0]);
        }
        Err(self.refusal(word, format!("a text is in quotes: write {}, not {name}", quoted(meant))))
    }

    /// Refuses the name of a function or exception where its number stands.
    fn check_number_name(&self, column: &str, name: &str, word: &Node) -> Result<(), FilterError> {
        if instead_of_column(name, self.table).is_some() {
            return Ok(());
        }
        let example = quoted(&in_title_case(&name.replace('_', " ")));
        Err(self.refusal(word, format!("{column} is a number; write its name as `{example} in {column}_name`")))
    }

    /// Notes a decimal number such as 40001, which is a wire address without its quotes.
    ///
    /// Refused where there is no such wire address. In hex it is surely meant as it is written.
    pub fn note_number(&mut self, node: &Node) -> Result<(), FilterError> {
        let digits: String = self.text.chars().skip(node.start).take(node.end - node.start).collect();
        let is_decimal = digits.bytes().all(|digit| digit.is_ascii_digit());
        let Some((space, wire)) = address::parse(&digits).filter(|_| is_decimal) else { return Ok(()) };
        let kind = space.long_name().replace('_', " ");
        let meant = format!("{kind} {digits} of a manual is {} in quotes, wire address {wire}", quoted(&digits));
        let last = address::LAST_ADDRESS;
        if digits.parse::<i64>().is_ok_and(|number| number > last) {
            return Err(self.refusal(node, format!("wire addresses end at {last}; {meant}")));
        }
        let sentence = format!("{digits} is taken as a wire address, counted from 0; {meant}");
        if !self.notes.contains(&sentence) {
            self.notes.push(sentence);
        }
        Ok(())
    }

    /// What to write instead of comparing `a`, a number, with `b`, a text; often empty.
    pub fn advice(&self, a: &Term<'_>, b: &Term<'_>) -> String {
        let Some(column) = a.column() else {
            let is_time = (a.kind, b.kind) == (TermKind::Number, TermKind::Time);
            return String::from(if is_time { "; write times in quotes" } else { "" });
        };
        let Some(text) = b.text().map(str::trim) else { return String::new() };
        if !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit()) {
            return format!("; write {text} without quotes");
        }
        let name = format!("{column}_name");
        if self.kind_of(&name).is_some() {
            format!("; names are in {name}")
        } else {
            String::new()
        }
    }

    /// The refusal of a name that no column has, with what may be meant.
    pub fn unknown_name(&self, name: &str, node: &Node) -> FilterError {
        let message = format!("{} have no column {}", self.table, quoted(name));
        if let Some((column, word)) = column_of_word(name, self.table) {
            let word = quoted(word);
            let whole = if column == "findings" { format!("{word} in findings") } else { format!("{column} == {word}") };
            return self.refusal(node, format!("{message}; write `{whole}`"));
        }
        if let Some(instead) = instead_of_column(name, self.table) {
            return self.refusal(node, format!("{message}; write {instead}"));
        }
        let words = self.columns.iter().flat_map(|(column, _)| closed_set(column));
        let hint = similar_name(name, words.chain(self.columns.iter().map(|row| row.0)), LEAST_LIKENESS);
        FilterError { hint: hint.map(ToOwned::to_owned), ..self.refusal(node, message) }
    }

    /// The refusal of a call of another function; `name` is none where it is no function but a part of something.
    pub fn unknown_call(&self, name: Option<&str>, node: &Node) -> FilterError {
        let instead = match name {
            Some("len") => "; write `quantity > 3`",
            Some("range") => "; write `1 <= unit < 5`",
            Some(_) => "",
            None => "; a part of a text is asked by `'Read' in function_name`",
        };
        self.refusal(node, format!("the only functions are touches(hr, 107) and writes(hr, 107){instead}"))
    }

    /// The refusal of `&` or `|` between conditions.
    pub fn bit_operator(&self, operator: &str, node: &Node) -> FilterError {
        let word = if operator == "&" { "and" } else { "or" };
        self.refusal(node, format!("join conditions by `{word}`, not by `{operator}`"))
    }

    /// What messages call a term.
    pub fn described(term: &Term<'_>) -> String {
        let kind = term.kind.text();
        term.column().map_or_else(|| kind.to_owned(), |column| format!("{column} ({kind})"))
    }
}

/// Each word with a capital letter.
fn in_title_case(text: &str) -> String {
    let mut is_inside = false;
    let mut title = String::new();
    for letter in text.chars() {
        if is_inside {
            title.extend(letter.to_lowercase());
        } else {
            title.extend(letter.to_uppercase());
        }
        is_inside = letter.is_alphabetic();
    }
    title
}
