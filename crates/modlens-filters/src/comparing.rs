//! Compiles comparisons of two values, and membership.

use serde_json::{json, Value as Json};

use crate::address;
use crate::compiler::{Compiler, Tree};
use crate::error::FilterError;
use crate::moments::{at_time_of_day, moment, time_of_day, Zone};
use crate::syntax::Kind;
use crate::terms::{at_address, join, Term, TermKind};

impl Compiler<'_> {
    /// The tree of a comparison by one of `== != < <= > >=`.
    ///
    /// An address column compared with an address literal becomes a comparison of wire address and register type; a time
    /// column makes a text a moment.
    pub fn compare(&mut self, operator: &str, a: Term<'_>, b: Term<'_>) -> Tree {
        for (one, other, is_turned) in [(&a, &b, false), (&b, &a, true)] {
            self.note_address(one, other)?;
            if let Some(found) = self.special(operator, one, other, is_turned)? {
                return Ok(found);
            }
        }
        let (a, b) = (self.as_time(&a, &b)?, self.as_time(&b, &a)?);
        let as_plain = |kind| if kind == TermKind::Flag { TermKind::Number } else { kind };
        for term in [&a, &b] {
            if !matches!(as_plain(term.kind), TermKind::Number | TermKind::Text | TermKind::Time) {
                let message = format!("{} cannot be compared; use `in`", Self::described(term));
                return Err(self.refusal(term.node, message));
            }
        }
        if as_plain(a.kind) != as_plain(b.kind) {
            let advice = [self.advice(&a, &b), self.advice(&b, &a)].into_iter().find(|advice| !advice.is_empty());
            let (one, other) = (Self::described(&a), Self::described(&b));
            let message = format!("{one} cannot be compared with {other}{}", advice.unwrap_or_default());
            return Err(self.refusal(b.node, message));
        }
        Ok(json!(["cmp", operator, self.spelling(&a, &b, false)?, self.spelling(&b, &a, false)?]))
    }

    /// The tree of a comparison of a column with an address, or a time of day.
    fn special(
        &self,
        operator: &str,
        column: &Term<'_>,
        literal: &Term<'_>,
        is_turned: bool,
    ) -> Result<Option<Json>, FilterError> {
        if column.is_address() && literal.kind == TermKind::Text {
            let Some(found) = literal.text().and_then(address::parse) else {
                let message = "not an address; write 107, '40108', '400108' or '4x006B'";
                return Err(self.refusal(literal.node, message));
            };
            return Ok(Some(at_address(operator, &column.tree, found, is_turned)));
        }
        let is_time = column.kind == TermKind::Time && column.column().is_some();
        let Some(clock) = literal.text().filter(|_| is_time).and_then(time_of_day) else { return Ok(None) };
        let changes = match clock.zone {
            Zone::Fixed(offset) => vec![(i64::MIN / 2, offset)],
            Zone::Local => (self.local)(),
        };
        Ok(Some(at_time_of_day(operator, &column.tree, clock.ns, &changes, is_turned)))
    }

    /// The tree of `item in place`.
    ///
    /// A list of items of the same kind stays a list; otherwise it becomes comparisons joined by `or`, so that literals such
    /// as '40108' are compared as addresses.
    pub fn membership(&mut self, item: &Term<'_>, place: &Term<'_>) -> Tree {
        if place.kind == TermKind::List {
            return self.choice(item, place);
        }
        let wanted = match place.kind {
            TermKind::Numbers => TermKind::Number,
            TermKind::Texts | TermKind::Text => TermKind::Text,
            _ => {
                let is_number = place.kind == TermKind::Number;
                let advice = if is_number { "; write `unit in (1, 2)` or `1 <= unit <= 5`" } else { "" };
                let message = format!("{} has no items for `in`{advice}", Self::described(place));
                return Err(self.refusal(place.node, message));
            }
        };
        if item.kind != wanted {
            let plural = format!("{}s", &wanted.text()[2..]);
            let message = format!("{} holds {plural}, not {}", Self::described(place), Self::described(item));
            return Err(self.refusal(item.node, message));
        }
        Ok(json!(["in", self.spelling(item, place, place.kind == TermKind::Text)?, place.tree]))
    }

    fn choice(&mut self, item: &Term<'_>, list: &Term<'_>) -> Tree {
        let (Kind::List(nodes) | Kind::Tuple(nodes)) = &list.node.kind else { unreachable!("a list has items") };
        let choices: Vec<Term<'_>> = nodes.iter().map(|node| self.item(node)).collect::<Result<_, _>>()?;
        if choices.is_empty() {
            return Err(self.refusal(list.node, "an empty list"));
        }
        for choice in &choices {
            self.note_address(item, choice)?;
        }
        if choices.iter().all(|choice| choice.kind == item.kind) {
            let same: Vec<Json> = choices.iter().map(|choice| self.spelling(choice, item, false)).collect::<Result<_, _>>()?;
            return Ok(json!(["in", item.tree, ["list", same]]));
        }
        let parts: Vec<Json> =
            choices.into_iter().map(|choice| self.compare("==", item.clone(), choice)).collect::<Result<_, _>>()?;
        Ok(join("or", parts))
    }

    /// Notes a number that is written like the number of a register in a handbook.
    fn note_address(&mut self, column: &Term<'_>, literal: &Term<'_>) -> Result<(), FilterError> {
        if column.is_address() && literal.is_constant() {
            self.note_number(literal.node)?;
        }
        Ok(())
    }

    fn as_time<'n>(&self, term: &Term<'n>, other: &Term<'_>) -> Result<Term<'n>, FilterError> {
        let Some(text) = term.text().filter(|_| other.kind == TermKind::Time) else { return Ok(term.clone()) };
        let Some(ns) = moment(text) else {
            let message = "not a time; write '2023-10-11T14:00:00Z' or '14:00:00'";
            return Err(self.refusal(term.node, message));
        };
        Ok(Term { kind: TermKind::Time, tree: json!(["time", ns]), node: term.node })
    }

    /// A text that is compared with a column, as the column spells it.
    ///
    /// Bytes in lower-case hex, and statuses and findings in their current spelling. A word that the column never has is
    /// refused.
    fn spelling(&self, term: &Term<'_>, other: &Term<'_>, is_part: bool) -> Tree {
        let (Some(text), Some(column)) = (term.text(), other.column()) else { return Ok(term.tree.clone()) };
        if self.columns.contains(&(column, "hex")) {
            let digits: String = text.split_whitespace().collect();
            return Ok(json!(["text", digits.to_lowercase()]));
        }
        Ok(json!(["text", self.known_value(column, text, term.node, is_part)?]))
    }
}
