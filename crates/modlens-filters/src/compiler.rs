//! Compiles the syntax of a filter into the tree that `modlens_tables::predicate` evaluates.
//!
//! A comparison that can never be true (a number with a text) is an error, not a filter that selects nothing.

use modlens_protocol::finding::Finding;
use modlens_protocol::renamed::{current, Vocabulary};
use serde_json::{json, Value as Json};

use crate::error::FilterError;
use crate::moments::LocalChanges;
use crate::spelling::quoted;
use crate::syntax::{Kind, Node};
use crate::terms::{join, Term, TermKind};
use crate::words::{closed_set, column_of_word, columns_of, operations_of_word};

/// A tree, or why there is none.
pub type Tree = Result<Json, FilterError>;

/// The deepest nesting of a filter.
const MAX_DEPTH: usize = 60;

/// Columns that (nearly) every row has a value in: alone they would select everything.
const ALWAYS_THERE: &[&str] = &[
    "unit",
    "function",
    "bus",
    "mode",
    "status",
    "verdict",
    "direction",
    "delimited_by",
    "confidence",
    "byte_offset",
    "byte_length",
    "elapsed_us",
    "time",
    "source",
    "hex",
    "operation",
    "raw",
    "value_text",
    "code",
    "severity",
    "detail",
    "impact",
    "advice",
    "client_port",
    "requests",
    "writes",
    "answered",
    "in_flight_max",
    "retransmitted_segments",
];

/// The columns that number the rows of a table.
const NUMBERS_OF_ROWS: &[(&str, &str)] =
    &[("transactions", "txn"), ("frames", "frame"), ("readings", "txn"), ("connections", "connection")];

/// Compiles one filter for the rows of a table.
pub struct Compiler<'a> {
    pub text: &'a str,
    pub table: &'a str,
    /// Key and type of the columns of the table.
    pub columns: Vec<(&'static str, &'static str)>,
    pub local: LocalChanges<'a>,
    /// What is valid, but may be meant otherwise.
    pub notes: Vec<String>,
    depth: usize,
}

impl<'a> Compiler<'a> {
    pub fn new(text: &'a str, table: &'a str, local: LocalChanges<'a>) -> Self {
        Self { text, table, columns: columns_of(table).collect(), local, notes: Vec::new(), depth: 0 }
    }

    /// The kind of a column of the table.
    pub fn kind_of(&self, key: &str) -> Option<TermKind> {
        self.columns.iter().find(|row| row.0 == key).map(|row| TermKind::of_type(row.1))
    }

    /// Compiles what is one level deeper.
    pub fn deeper<T>(
        &mut self,
        node: &Node,
        compile: impl FnOnce(&mut Self) -> Result<T, FilterError>,
    ) -> Result<T, FilterError> {
        if self.depth == MAX_DEPTH {
            return Err(self.refusal(node, format!("nested more than {MAX_DEPTH} levels deep")));
        }
        self.depth += 1;
        let found = compile(self);
        self.depth -= 1;
        found
    }

    /// The tree of a condition.
    pub fn condition(&mut self, node: &Node) -> Tree {
        self.deeper(node, |compiler| match &node.kind {
            Kind::Joined(word, parts) => {
                let parts = parts.iter().map(|part| compiler.condition(part)).collect::<Result<_, _>>()?;
                Ok(join(word, parts))
            }
            Kind::Not(operand) => Ok(json!(["not", compiler.condition(operand)?])),
            Kind::Compare(left, rest) => compiler.comparisons(left, rest),
            Kind::Call { name, arguments, is_plain } => compiler.call(node, name.as_deref(), arguments, *is_plain),
            Kind::Tuple(items) => Err(compiler.refusal(
                items.last().unwrap_or(node),
                "join conditions by `and` or `or`, not by commas; a list is in brackets, as in `unit in (1, 2)`",
            )),
            Kind::Name(name) => compiler.word_alone(name, node),
            Kind::Binary(_, operator @ ("&" | "|"), _) => Err(compiler.bit_operator(operator, node)),
            _ => {
                let term = compiler.term(node)?;
                let example = compiler.condition_with(&term);
                let kind = term.kind.text();
                Err(compiler.refusal(node, format!("{kind} is not a condition; compare it, as in `{example}`")))
            }
        })
    }

    /// An example of a condition that a term alone may be meant for.
    fn condition_with(&self, term: &Term<'_>) -> String {
        if term.kind != TermKind::Text {
            return String::from(if term.is_constant() { "unit in (1, 2)" } else { "unit == 1" });
        }
        match term.tree[1].as_str().and_then(|word| column_of_word(word, self.table)) {
            Some(("findings", word)) => format!("{} in findings", quoted(word)),
            _ => String::from("status in ('ok', 'exception')"),
        }
    }

    /// The condition that a word alone is: a column that is not empty, a status, a finding.
    fn word_alone(&self, name: &str, node: &Node) -> Tree {
        let key = current(Vocabulary::Column, name);
        if let Some(kind) = self.kind_of(key) {
            return self.column_alone(key, kind, node);
        }
        let Some((column, word)) = column_of_word(name, self.table) else { return Err(self.unknown_name(name, node)) };
        Ok(match column {
            "findings" => json!(["in", ["text", word], ["col", column]]),
            "operation" => {
                let (operations, functions) = operations_of_word(word);
                let operations = operations.iter().map(|one| json!(["cmp", "==", ["col", column], ["text", one]]));
                let functions = functions.iter().map(|code| json!(["cmp", "==", ["col", "function"], ["num", code]]));
                join("or", operations.chain(functions).collect())
            }
            _ => json!(["cmp", "==", ["col", column], ["text", word]]),
        })
    }

    /// The condition that a column alone is; for `findings`, that there is one at least.
    fn column_alone(&self, key: &str, kind: TermKind, node: &Node) -> Tree {
        if kind == TermKind::Flag {
            return Ok(json!(["cmp", "==", ["col", key], ["num", 1]]));
        }
        if key == "findings" {
            let codes = Finding::ALL.iter().map(|one| json!(["in", ["text", one.doc().code], ["col", key]]));
            return Ok(join("or", codes.collect()));
        }
        if ALWAYS_THERE.contains(&key) || NUMBERS_OF_ROWS.contains(&(self.table, key)) {
            let example =
                closed_set(key).last().map_or_else(|| String::from("unit == 1"), |word| format!("{key} == {}", quoted(word)));
            let message = format!("{} is not a condition; compare it, as in `{example}`", kind.text());
            return Err(self.refusal(node, message));
        }
        Ok(json!(["not", ["is_none", ["col", key]]]))
    }

    fn comparisons(&mut self, left: &Node, rest: &[(&'static str, Node)]) -> Tree {
        for (_, between) in rest.iter().rev().skip(1).rev() {
            // `unit == 1 & function == 3` is the chain `unit == (1 & function) == 3` in Python.
            if let Kind::Binary(_, operator @ ("&" | "|"), _) = &between.kind {
                return Err(self.bit_operator(operator, between));
            }
        }
        let (mut left, mut parts) = (left, Vec::new());
        for (operator, right) in rest {
            parts.push(self.comparison(left, operator, right)?);
            left = right;
        }
        Ok(join("and", parts))
    }

    /// The tree of one comparison; `in` and `not in` are tests for membership.
    fn comparison(&mut self, left: &Node, operator: &str, right: &Node) -> Tree {
        self.check_quotes(left, right)?;
        self.check_quotes(right, left)?;
        if matches!(operator, "is" | "is not") {
            return self.is_none(left, operator, right);
        }
        let (a, b) = (self.term(left)?, self.term(right)?);
        for term in [&a, &b] {
            if term.kind == TermKind::None {
                return Err(self.refusal(term.node, "compare with None by `is None` or `is not None`"));
            }
        }
        match operator {
            "in" => self.membership(&a, &b),
            "not in" => {
                let found = self.membership(&a, &b)?;
                // Comparisons with null are false, `not in` too: it needs an explicit test for null.
                let tested = if b.column().is_some() { &b.tree } else { &a.tree };
                Ok(json!(["and", ["not", ["is_none", tested]], ["not", found]]))
            }
            _ => self.compare(operator, a, b),
        }
    }

    fn is_none(&mut self, left: &Node, operator: &str, right: &Node) -> Tree {
        if self.term(right)?.kind != TermKind::None {
            return Err(self.refusal(right, "`is` works only with None; use `==`"));
        }
        let tree = json!(["is_none", self.term(left)?.tree]);
        Ok(if operator == "is" { tree } else { json!(["not", tree]) })
    }
}
