//! What a word of a filter may be meant for: closed sets of values, names of other programs, operators of other languages.

use modlens_diagnosis::table::diagnoses;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::renamed::{current, Vocabulary};
use modlens_protocol::status::Status;
use modlens_tables::columns::{definition, TABLES};

use crate::similar::{normalized, similar_name};
use crate::word_tables::{COLUMNS, COLUMNS_OF_WORDS, EXPRESSIONS, NOTHING, NOW, OPERATIONS, OPERATORS, SETS, VALUES};

/// How similar the nearest word has to be.
pub const LEAST_LIKENESS: f64 = 0.6;

/// The vocabulary of a column whose words may be given in their former spelling.
pub fn vocabulary(column: &str) -> Option<Vocabulary> {
    match column {
        "status" | "first_status" => Some(Vocabulary::Status),
        "findings" | "code" => Some(Vocabulary::Finding),
        _ => None,
    }
}

/// The current spelling of a value of a column.
pub fn respelled<'a>(column: &str, word: &'a str) -> &'a str {
    vocabulary(column).map_or(word, |vocabulary| current(vocabulary, word))
}

/// Key and type of the columns of a table, in the order of `columns.toml`.
pub fn columns_of(table: &str) -> impl Iterator<Item = (&'static str, &'static str)> {
    let rows = definition()[table].as_array().map(Vec::as_slice).unwrap_or_default();
    rows.iter().filter_map(|row| Some((row["key"].as_str()?, row["type"].as_str()?)))
}

fn has_column(table: &str, key: &str) -> bool {
    columns_of(table).any(|(column, _)| column == key)
}

/// All values that a column can have; empty for a column that can have any.
pub fn closed_set(column: &str) -> Vec<&'static str> {
    let findings = || Finding::ALL.iter().map(|finding| finding.doc().code);
    match column {
        "status" | "first_status" => Status::ALL.iter().map(|one| one.text()).collect(),
        "verdict" => Verdict::ALL.iter().map(|one| one.text()).collect(),
        "findings" => findings().collect(),
        "code" => {
            let mut codes: Vec<&str> = findings().collect();
            let others = diagnoses().iter().map(|one| one.code.as_str());
            codes.extend(others.filter(|code| Finding::from_code(code).is_none()));
            codes
        }
        _ => SETS.iter().find(|row| row.0 == column).map(|row| row.1.to_vec()).unwrap_or_default(),
    }
}

/// The value of a closed set that a word most probably means.
pub fn nearest_value(column: &str, word: &str) -> Option<&'static str> {
    let known = closed_set(column);
    let plain = normalized(word);
    let called_in = match column {
        "code" => "findings",
        "first_status" => "status",
        other => other,
    };
    let called = VALUES.iter().find(|row| row.0 == called_in).map_or(&[][..], |row| row.1);
    let is_name = |names: &str| names.split(' ').any(|name| normalized(name) == plain);
    if let Some((value, _)) = called.iter().find(|(_, names)| is_name(names)) {
        return Some(value);
    }
    let mut begins = known.iter().filter(|value| !plain.is_empty() && normalized(value).starts_with(&plain));
    match (begins.next(), begins.next()) {
        (Some(only), None) => Some(only),
        _ => similar_name(word, known, LEAST_LIKENESS),
    }
}

/// The column of a table that has this word among its values, and the word as it spells it.
pub fn column_of_word(word: &str, table: &str) -> Option<(&'static str, &'static str)> {
    let columns = COLUMNS_OF_WORDS.iter().copied().chain(SETS.iter().map(|row| row.0));
    columns.filter(|column| has_column(table, column)).find_map(|column| {
        let wanted = respelled(column, word);
        closed_set(column).into_iter().find(|value| *value == wanted).map(|value| (column, value))
    })
}

/// The operations, and functions of other operations, that a word alone means.
pub fn operations_of_word(word: &str) -> (Vec<&str>, &'static [i64]) {
    OPERATIONS.iter().find(|row| row.0 == word).map_or((vec![word], &[]), |row| (row.1.to_vec(), row.2))
}

/// What to write instead of a name that no column of the table has, if anything is known.
pub fn instead_of_column(word: &str, table: &str) -> Option<String> {
    let plain = word.rsplit('.').next().unwrap_or(word).to_lowercase();
    let is_among = |names: &str| names.split(' ').any(|name| name == plain);
    if NOTHING.contains(&plain.as_str()) {
        return Some(String::from("`is None` or `is not None`"));
    }
    if NOW.contains(&plain.as_str()) {
        return Some(String::from("a time in quotes, such as '2023-10-11T14:00:00Z'"));
    }
    let expressions = EXPRESSIONS.iter().filter(|row| is_among(row.0)).flat_map(|row| row.1);
    if let Some((_, expression)) = expressions.into_iter().find(|row| row.0 == table) {
        return Some((*expression).to_owned());
    }
    if let Some((column, _)) = COLUMNS.iter().find(|(column, names)| has_column(table, column) && is_among(names)) {
        return Some(format!("`{column}`"));
    }
    if has_column(table, &plain) {
        return Some(format!("`{plain}`"));
    }
    let meant = COLUMNS.iter().find(|(_, names)| is_among(names)).map_or(plain.as_str(), |row| row.0);
    // The table that most people look at comes first.
    let tables = ["transactions"].into_iter().chain(TABLES);
    tables.into_iter().find(|other| has_column(other, meant)).map(|other| format!("`{meant}` with --table {other}"))
}

// ---- operators of other languages

const WORDS_OF_FILTERS: &[&str] = &["and", "or", "not", "in", "is"];

/// Quotation marks of word processors: single and double, high and low, and angle ones.
const CURLY_QUOTES: &str = "\u{2018}\u{2019}\u{201a}\u{201c}\u{201d}\u{201e}\u{ab}\u{bb}";

/// The first operator of another language in a text that is no expression: its place, and what to write.
pub fn wrong_operator(text: &str) -> Option<(usize, String)> {
    let letters: Vec<char> = text.chars().collect();
    let (mut at, mut previous) = (0, String::new());
    while at < letters.len() {
        let length = piece(&letters[at..]);
        if length > 0 {
            let word: String = letters[at..at + length].iter().collect();
            if let Some(advice) = instead_of_piece(&word, &previous) {
                return Some((at, advice));
            }
            previous = word;
        }
        at += length.max(1);
    }
    None
}

/// The length of the token that letters begin with: a text in quotes, an operator, a word; 0 for anything else.
fn piece(letters: &[char]) -> usize {
    let run = |is_part: &dyn Fn(char) -> bool| letters.iter().take_while(|letter| is_part(**letter)).count();
    let first = letters[0];
    let is_in_word = |letter: char| letter.is_alphanumeric() || letter == '_' || letter == '.';
    match first {
        '\'' | '"' => {
            let mut at = 1;
            while at < letters.len() && letters[at] != first {
                at += if letters[at] == '\\' { 2 } else { 1 };
            }
            if at < letters.len() {
                at + 1
            } else {
                0
            }
        }
        _ if "=!<>~&|".contains(first) => run(&|letter| "=!<>~&|".contains(letter)),
        _ if "≥≤≠;:/".contains(first) || CURLY_QUOTES.contains(first) => 1,
        _ => run(&is_in_word),
    }
}

/// What to write instead of a token of a text that is no expression; `None` for a right one.
fn instead_of_piece(word: &str, previous: &str) -> Option<String> {
    if CURLY_QUOTES.contains(word) {
        return Some(String::from("write texts in straight quotes, as in 'ok'"));
    }
    if let Some(measure) = measure(word) {
        return Some(format!("write numbers without a unit; {measure}_us columns count microseconds"));
    }
    if word == ":" || (word == "/" && matches!(previous, "==" | "!=")) {
        return Some(String::from("write times, names and other texts in quotes"));
    }
    let is_number = word.bytes().all(|digit| digit.is_ascii_digit());
    if is_number && word.starts_with('0') && word.contains(|digit| digit != '0') {
        return Some(String::from("a number has no leading zeros; bytes are a text, as '01 03'"));
    }
    let name = word.to_lowercase();
    // A first word such as `between` may be meant for a column.
    let is_name = previous.is_empty() && word.chars().all(char::is_alphabetic) && !WORDS_OF_FILTERS.contains(&name.as_str());
    if WORDS_OF_FILTERS.contains(&word) || is_name {
        return None;
    }
    let (_, advice) = OPERATORS.iter().find(|row| row.0 == name)?;
    Some(format!("write {advice}, not `{word}`"))
}

/// For a number with a unit of time, what it is in microseconds; empty where it is not that simple.
fn measure(word: &str) -> Option<String> {
    const UNITS: [(&str, f64); 5] = [("us", 1.0), ("ms", 1e3), ("s", 1e6), ("m", 60e6), ("h", 3600e6)];
    let (unit, digits, size) = UNITS.iter().find_map(|(unit, size)| Some((unit, word.strip_suffix(unit)?, size)))?;
    let is_number = digits.starts_with(|digit: char| digit.is_ascii_digit())
        && digits.chars().all(|digit| digit.is_ascii_digit() || digit == '.');
    if !is_number {
        return None;
    }
    let (whole, decimals) = digits.split_once('.').unwrap_or((digits, "0"));
    let is_simple = (1..=12).contains(&whole.len()) && (1..=6).contains(&decimals.len()) && !decimals.contains('.');
    let number: f64 = if is_simple { digits.parse().ok()? } else { return Some(String::new()) };
    Some(format!("{digits}{unit} is {:.0}, because ", number * size))
}
