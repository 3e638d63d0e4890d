//! Compiles the values of a filter: columns, literals, lists, arithmetic.

use modlens_protocol::renamed::{current, Vocabulary};
use serde_json::{json, Value as Json};

use crate::compiler::Compiler;
use crate::error::FilterError;
use crate::syntax::{Kind, Node};
use crate::terms::{Term, TermKind};
use crate::words::instead_of_column;

type Found<'n> = Result<Term<'n>, FilterError>;

impl Compiler<'_> {
    /// The value of a part of syntax.
    pub fn term<'n>(&mut self, node: &'n Node) -> Found<'n> {
        self.deeper(node, |compiler| compiler.value(node))
    }

    fn value<'n>(&mut self, node: &'n Node) -> Found<'n> {
        let term = |kind, tree: Json| Ok(Term { kind, tree, node });
        match &node.kind {
            Kind::Name(name) => {
                let key = current(Vocabulary::Column, name);
                let kind = self.kind_of(key).ok_or_else(|| self.unknown_name(name, node))?;
                term(kind, json!(["col", key]))
            }
            Kind::None => term(TermKind::None, json!(["none"])),
            Kind::Bool(yes) => term(TermKind::Number, json!(["num", i64::from(*yes)])),
            Kind::Integer(None) => Err(self.refusal(node, "a number of more than 64 bits")),
            Kind::Integer(Some(number)) => term(TermKind::Number, json!(["num", number])),
            Kind::Float(number) if !number.is_finite() => Err(self.refusal(node, "a number that is too large")),
            Kind::Float(number) => term(TermKind::Number, json!(["num", number])),
            Kind::Text(text) => term(TermKind::Text, json!(["text", text])),
            Kind::OtherLiteral => Err(self.refusal(node, "a literal is a number or a text")),
            Kind::List(items) | Kind::Tuple(items) => {
                let items: Vec<Json> = items.iter().map(|item| Ok(self.item(item)?.tree)).collect::<Result<_, _>>()?;
                term(TermKind::List, json!(["list", items]))
            }
            Kind::Negative(operand) => {
                let operand = self.number(operand)?.tree;
                let negative = match (operand[1].as_i64(), operand[1].as_f64()) {
                    (Some(number), _) if operand[0] == "num" => json!(["num", -number]),
                    (None, Some(number)) if operand[0] == "num" => json!(["num", -number]),
                    _ => json!(["neg", operand]),
                };
                term(TermKind::Number, negative)
            }
            Kind::Binary(left, operator @ ("+" | "-" | "*" | "/" | "//" | "%" | "&"), right) => {
                let (a, b) = (self.number(left)?.tree, self.number(right)?.tree);
                term(TermKind::Number, json!(["arith", operator, a, b]))
            }
            Kind::Binary(_, "|", _) => Err(self.bit_operator("|", node)),
            Kind::Call { name, .. } => Err(self.unknown_call(name.as_deref(), node)),
            Kind::Subscript => Err(self.refusal(node, "not part of the filter language; an item is asked by `5 in data`")),
            Kind::Attribute(name) => {
                let advice = instead_of_column(name, self.table).map(|instead| format!("; write {instead}"));
                Err(self.refusal(node, format!("not part of the filter language{}", advice.unwrap_or_default())))
            }
            Kind::Joined(..) | Kind::Not(_) | Kind::Compare(..) | Kind::Binary(..) | Kind::Other => {
                Err(self.refusal(node, "not part of the filter language"))
            }
        }
    }

    /// An item of a list.
    pub fn item<'n>(&mut self, node: &'n Node) -> Found<'n> {
        let found = self.term(node)?;
        if found.is_constant() || found.text().is_some() {
            return Ok(found);
        }
        Err(self.refusal(node, "a list holds numbers and texts"))
    }

    fn number<'n>(&mut self, node: &'n Node) -> Found<'n> {
        if matches!(node.kind, Kind::Compare(..) | Kind::Joined(..)) {
            return Err(self.refusal(node, "a condition is not a number; join conditions by `and` or `or`"));
        }
        let term = self.term(node)?;
        if matches!(term.kind, TermKind::Number | TermKind::Flag) {
            return Ok(term);
        }
        Err(self.refusal(node, format!("{} is not a number", Self::described(&term))))
    }
}
