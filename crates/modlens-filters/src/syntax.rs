//! The syntax of a filter, before it is known what its names mean.

/// A part of a filter; places count characters of its text.
#[derive(Clone, Debug)]
pub struct Node {
    pub kind: Kind,
    pub start: usize,
    pub end: usize,
}

/// What a part is. `Other` is everything that Python's expressions have and filters have not.
#[derive(Clone, Debug)]
pub enum Kind {
    /// Conditions joined by `and` or `or`.
    Joined(&'static str, Vec<Node>),
    Not(Box<Node>),
    /// A chain of comparisons, with the words of `COMPARISONS`.
    Compare(Box<Node>, Vec<(&'static str, Node)>),
    /// A call; `is_plain` says that no argument has a name.
    Call {
        name: Option<String>,
        arguments: Vec<Node>,
        is_plain: bool,
    },
    Tuple(Vec<Node>),
    List(Vec<Node>),
    Name(String),
    /// A whole number; `None` if it needs more than 64 bits.
    Integer(Option<i64>),
    Float(f64),
    Text(String),
    Bool(bool),
    None,
    /// Bytes, an imaginary number, an ellipsis.
    OtherLiteral,
    Negative(Box<Node>),
    /// Two values with an operator between them: one of `+ - * / // % & |`, or another of Python's.
    Binary(Box<Node>, &'static str, Box<Node>),
    /// A name after a dot.
    Attribute(String),
    Subscript,
    Other,
}

/// Words that are no names.
pub const KEYWORDS: &[&str] = &[
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue", "def", "del", "elif", "else",
    "except", "finally", "for", "from", "global", "if", "import", "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise",
    "return", "try", "while", "with", "yield",
];

/// The operators between two values, and how tightly they bind.
pub const BINARY: &[(&str, u8)] =
    &[("|", 1), ("^", 2), ("&", 3), ("<<", 4), (">>", 4), ("+", 5), ("-", 5), ("*", 6), ("/", 6), ("//", 6), ("%", 6), ("@", 6)];

/// How tightly an operator binds.
pub fn level_of(operator: &str) -> u8 {
    BINARY.iter().find(|row| row.0 == operator).map_or(u8::MAX, |row| row.1)
}

/// The operators that compare.
pub const COMPARISONS: &[&str] = &["==", "!=", "<=", ">=", "<", ">"];
