//! The values of a filter while it is compiled, and the blocks of trees that need no syntax.

use modlens_protocol::register_type::Space;
use serde_json::{json, Value as Json};

use crate::syntax::Node;

/// What kind of value a term is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TermKind {
    Number,
    Flag,
    Time,
    Text,
    Numbers,
    Texts,
    Map,
    List,
    None,
}

impl TermKind {
    /// The kind of a type of `columns.toml`.
    pub fn of_type(name: &str) -> Self {
        match name {
            "bool" => Self::Flag,
            "time" => Self::Time,
            "text" | "hex" => Self::Text,
            "ints" => Self::Numbers,
            "texts" => Self::Texts,
            "map" => Self::Map,
            _ => Self::Number,
        }
    }

    /// What messages call it.
    pub fn text(self) -> &'static str {
        match self {
            Self::Number => "a number",
            Self::Flag => "true or false",
            Self::Time => "a time",
            Self::Text => "a text",
            Self::Numbers => "a list of numbers",
            Self::Texts => "a list of texts",
            Self::Map => "a map",
            Self::List => "a list",
            Self::None => "None",
        }
    }
}

/// A value in a filter: its kind, its tree, its syntax.
#[derive(Clone, Debug)]
pub struct Term<'a> {
    pub kind: TermKind,
    pub tree: Json,
    pub node: &'a Node,
}

impl Term<'_> {
    /// The column that it is.
    pub fn column(&self) -> Option<&str> {
        (self.tree[0] == "col").then(|| self.tree[1].as_str()).flatten()
    }

    /// The text that it is.
    pub fn text(&self) -> Option<&str> {
        (self.tree[0] == "text").then(|| self.tree[1].as_str()).flatten()
    }

    /// Whether it is a number that is in the filter.
    pub fn is_constant(&self) -> bool {
        self.tree[0] == "num"
    }

    /// Whether it is a column of addresses.
    pub fn is_address(&self) -> bool {
        matches!(self.column(), Some("address" | "write_address"))
    }
}

/// Joins conditions pairwise into a balanced tree: a chain of a thousand would otherwise be a thousand levels deep.
pub fn join(word: &str, mut parts: Vec<Json>) -> Json {
    if parts.len() == 1 {
        return parts.remove(0);
    }
    let behind = parts.split_off(parts.len().div_ceil(2));
    json!([word, join(word, parts), join(word, behind)])
}

/// The condition for `address == '40108'`: wire address 107, and register type holding register.
///
/// `is_turned` says that the literal is on the left.
pub fn at_address(operator: &str, column: &Json, (space, wire): (Space, i64), is_turned: bool) -> Json {
    let value = json!(["num", wire]);
    let place = if is_turned { json!(["cmp", operator, value, column]) } else { json!(["cmp", operator, column, value]) };
    let register_type = |operator: &str| json!(["cmp", operator, ["col", "register_type"], ["text", space.long_name()]]);
    if operator == "!=" {
        return json!(["and", ["not", ["is_none", column]], ["or", place, register_type("!=")]]);
    }
    json!(["and", place, register_type("==")])
}
