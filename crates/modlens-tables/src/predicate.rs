//! A compiled filter over rows: the tree of `analyzer/filters.py`, interpreted.
//!
//! A comparison with null is false; so is `in` with a null on either side.

use std::borrow::Cow;
use std::cmp::Ordering;

use serde_json::Value as Json;

use crate::cell_text::{cell_text, source_text};
use crate::columns::{read_range, row_of, write_range, Cell, Items, Table, TableKind};
use modlens_protocol::finding::Finding;

/// A filter for one table.
#[derive(Clone, Debug)]
pub struct Predicate {
    /// The table it is for.
    pub kind: TableKind,
    root: Expr,
}

#[derive(Clone, Debug)]
enum Expr {
    Column(usize),
    Int(i64),
    Float(f64),
    Text(String),
    List(Vec<Expr>),
    None,
    And(Box<Expr>, Box<Expr>),
    Or(Box<Expr>, Box<Expr>),
    Not(Box<Expr>),
    Compare(Compare, Box<Expr>, Box<Expr>),
    In(Box<Expr>, Box<Expr>),
    IsNone(Box<Expr>),
    Arithmetic(char, Box<Expr>, Box<Expr>),
    Negative(Box<Expr>),
    Touches { register_type: String, first: u32, last: u32, only_writes: bool },
}

#[derive(Clone, Copy, Debug)]
enum Compare {
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
}

enum Val<'a> {
    Null,
    Int(i64),
    Float(f64),
    Text(Cow<'a, str>),
    Ints(Items<'a>),
    Codes(&'a [Finding]),
    List(&'a [Expr]),
}

impl Predicate {
    /// Compiles a tree. The error says which node is wrong; `filters.py` never builds one.
    pub fn new(table: &str, tree: &str) -> Result<Self, String> {
        let kind = TableKind::from_name(table).ok_or_else(|| format!("no table {table:?}"))?;
        let tree: Json = serde_json::from_str(tree).map_err(|e| e.to_string())?;
        Ok(Self { kind, root: compile(kind, &tree, 0)? })
    }

    /// The rows to be kept.
    #[must_use]
    pub fn filter(&self, table: &Table) -> Table {
        if let Some(kept) = self.by_numbers(table) {
            return kept;
        }
        table.filter(|table, row| self.holds(table, row))
    }

    /// A column of numbers beside a constant: without a look at each row.
    fn by_numbers(&self, table: &Table) -> Option<Table> {
        let Expr::Compare(op, a, b) = &self.root else { return None };
        let (Expr::Column(column), limit) = (&**a, limit(b)?) else { return None };
        match op {
            Compare::Eq => table.with_numbers(*column, |number| number.partial_cmp(&limit) == Some(Ordering::Equal)),
            // What is no number differs from nothing.
            Compare::Ne => table.with_numbers(*column, |number| number.partial_cmp(&limit).is_some_and(Ordering::is_ne)),
            Compare::Lt => table.with_numbers(*column, |number| number < limit),
            Compare::Le => table.with_numbers(*column, |number| number <= limit),
            Compare::Gt => table.with_numbers(*column, |number| number > limit),
            Compare::Ge => table.with_numbers(*column, |number| number >= limit),
        }
    }

    /// Whether the row is to be kept.
    pub fn holds(&self, table: &Table, row: usize) -> bool {
        holds(&self.root, table, row)
    }
}

/// Deeper trees are refused: recursion is bounded.
const DEPTH: usize = 200;

fn compile(kind: TableKind, tree: &Json, depth: usize) -> Result<Expr, String> {
    let wrong = || format!("no filter: {tree}");
    let parts = tree.as_array().filter(|_| depth < DEPTH).ok_or_else(wrong)?;
    let word = parts.first().and_then(Json::as_str).ok_or_else(wrong)?;
    let sub = |i: usize| parts.get(i).ok_or_else(wrong).and_then(|tree| compile(kind, tree, depth + 1)).map(Box::new);
    let text = |i: usize| parts.get(i).and_then(Json::as_str).ok_or_else(wrong);
    Ok(match word {
        "col" => Expr::Column(kind.column(text(1)?)?),
        "num" => match parts.get(1) {
            Some(n) if n.is_i64() || n.is_u64() => Expr::Int(n.as_i64().unwrap_or(i64::MAX)),
            Some(n) => Expr::Float(n.as_f64().ok_or_else(wrong)?),
            None => return Err(wrong()),
        },
        "text" => Expr::Text(text(1)?.to_owned()),
        "time" => Expr::Int(parts.get(1).and_then(Json::as_i64).ok_or_else(wrong)?),
        "none" => Expr::None,
        "list" => {
            let items = parts.get(1).and_then(Json::as_array).ok_or_else(wrong)?;
            Expr::List(items.iter().map(|item| compile(kind, item, depth + 1)).collect::<Result<_, _>>()?)
        }
        "and" => Expr::And(sub(1)?, sub(2)?),
        "or" => Expr::Or(sub(1)?, sub(2)?),
        "not" => Expr::Not(sub(1)?),
        "cmp" => {
            let op = match text(1)? {
                "==" => Compare::Eq,
                "!=" => Compare::Ne,
                "<" => Compare::Lt,
                "<=" => Compare::Le,
                ">" => Compare::Gt,
                ">=" => Compare::Ge,
                _ => return Err(wrong()),
            };
            Expr::Compare(op, sub(2)?, sub(3)?)
        }
        "in" => Expr::In(sub(1)?, sub(2)?),
        "is_none" => Expr::IsNone(sub(1)?),
        "arith" => {
            let op = match text(1)? {
                "//" => 'f',
                op if "+-*/%&".contains(op) && op.len() == 1 => op.chars().next().expect("one character"),
                _ => return Err(wrong()),
            };
            Expr::Arithmetic(op, sub(2)?, sub(3)?)
        }
        "neg" => Expr::Negative(sub(1)?),
        "touches" | "writes" => {
            let number = |i: usize| parts.get(i).and_then(Json::as_u64).map(|n| n as u32).ok_or_else(wrong);
            Expr::Touches {
                register_type: text(1)?.to_owned(),
                first: number(2)?,
                last: number(3)?,
                only_writes: word == "writes",
            }
        }
        _ => return Err(wrong()),
    })
}

fn holds(expr: &Expr, table: &Table, row: usize) -> bool {
    match expr {
        Expr::And(a, b) => holds(a, table, row) && holds(b, table, row),
        Expr::Or(a, b) => holds(a, table, row) || holds(b, table, row),
        Expr::Not(a) => !holds(a, table, row),
        Expr::IsNone(a) => matches!(value(a, table, row), Val::Null),
        Expr::Compare(op, a, b) => compare(*op, &value(a, table, row), &value(b, table, row)),
        Expr::In(a, b) => contains(&value(a, table, row), &value(b, table, row)),
        Expr::Touches { register_type, first, last, only_writes } => {
            touches(table, row, register_type, (*first, *last), *only_writes)
        }
        other => matches!(value(other, table, row), Val::Int(n) if n != 0),
    }
}

fn value<'a>(expr: &'a Expr, table: &'a Table, row: usize) -> Val<'a> {
    match expr {
        Expr::Column(column) => cell(table.cell(row, *column)),
        Expr::Int(n) => Val::Int(*n),
        Expr::Float(n) => Val::Float(*n),
        Expr::Text(text) => Val::Text(Cow::Borrowed(text)),
        Expr::List(items) => Val::List(items),
        Expr::Negative(a) => match value(a, table, row) {
            Val::Int(n) => n.checked_neg().map_or(Val::Null, Val::Int),
            Val::Float(n) => Val::Float(-n),
            _ => Val::Null,
        },
        Expr::Arithmetic(op, a, b) => arithmetic(*op, &value(a, table, row), &value(b, table, row)),
        Expr::None => Val::Null,
        condition => Val::Int(i64::from(holds(condition, table, row))),
    }
}

fn cell(cell: Cell<'_>) -> Val<'_> {
    match cell {
        Cell::Null => Val::Null,
        Cell::Int(n) | Cell::Time(n) => Val::Int(n),
        Cell::Us(ns) => Val::Float(ns as f64 / 1000.0),
        Cell::Float(value) => Val::Float(value),
        Cell::Bool(yes) => Val::Int(i64::from(yes)),
        Cell::Word(text) | Cell::Text(text) => Val::Text(Cow::Borrowed(text)),
        Cell::Ints(items) => Val::Ints(items),
        Cell::Codes(codes) => Val::Codes(codes),
        Cell::Source(file, place, number) => Val::Text(Cow::Owned(source_text(file, place, number))),
        other => Val::Text(Cow::Owned(cell_text(&other))),
    }
}

fn order(a: &Val<'_>, b: &Val<'_>) -> Option<Ordering> {
    match (a, b) {
        (Val::Int(a), Val::Int(b)) => Some(a.cmp(b)),
        (Val::Int(a), Val::Float(b)) => (*a as f64).partial_cmp(b),
        (Val::Float(a), Val::Int(b)) => a.partial_cmp(&(*b as f64)),
        (Val::Float(a), Val::Float(b)) => a.partial_cmp(b),
        (Val::Text(a), Val::Text(b)) => Some(a.cmp(b)),
        _ => None,
    }
}

fn compare(op: Compare, a: &Val<'_>, b: &Val<'_>) -> bool {
    fits(op, order(a, b))
}

/// A constant that a float64 holds exactly.
fn limit(expr: &Expr) -> Option<f64> {
    match expr {
        Expr::Int(n) if n.unsigned_abs() <= 1 << 53 => Some(*n as f64),
        Expr::Float(n) => Some(*n),
        _ => None,
    }
}

fn fits(op: Compare, order: Option<Ordering>) -> bool {
    let Some(order) = order else { return false };
    match op {
        Compare::Eq => order.is_eq(),
        Compare::Ne => order.is_ne(),
        Compare::Lt => order.is_lt(),
        Compare::Le => order.is_le(),
        Compare::Gt => order.is_gt(),
        Compare::Ge => order.is_ge(),
    }
}

fn contains(item: &Val<'_>, list: &Val<'_>) -> bool {
    match (item, list) {
        (Val::Null, _) => false,
        (item, Val::List(items)) => items.iter().any(|other| {
            let other = match other {
                Expr::Int(n) => Val::Int(*n),
                Expr::Float(n) => Val::Float(*n),
                Expr::Text(text) => Val::Text(Cow::Borrowed(text)),
                _ => Val::Null,
            };
            compare(Compare::Eq, item, &other)
        }),
        (Val::Int(n), Val::Ints(items)) => (0..items.len()).any(|i| i64::from(items.get(i)) == *n),
        (Val::Float(n), Val::Ints(items)) => (0..items.len()).any(|i| f64::from(items.get(i)).total_cmp(n).is_eq()),
        (Val::Text(text), Val::Codes(codes)) => codes.iter().any(|code| code.doc().code == text),
        (Val::Text(part), Val::Text(whole)) => whole.contains(part.as_ref()),
        _ => false,
    }
}

fn arithmetic<'a>(op: char, a: &Val<'_>, b: &Val<'_>) -> Val<'a> {
    if let (Val::Int(a), Val::Int(b)) = (a, b) {
        let (a, b) = (*a, *b);
        let floor = |a: i64, b: i64| a.checked_div_euclid(b).map(|q| if b < 0 && a.rem_euclid(b) != 0 { q - 1 } else { q });
        let result = match op {
            '+' => a.checked_add(b),
            '-' => a.checked_sub(b),
            '*' => a.checked_mul(b),
            '&' => Some(a & b),
            'f' => floor(a, b),
            '%' => floor(a, b).and_then(|q| a.checked_sub(q.checked_mul(b)?)),
            _ => return if b == 0 { Val::Null } else { Val::Float(a as f64 / b as f64) },
        };
        return result.map_or(Val::Null, Val::Int);
    }
    let number = |val: &Val<'_>| match val {
        Val::Int(n) => Some(*n as f64),
        Val::Float(n) => Some(*n),
        _ => None,
    };
    let (Some(a), Some(b)) = (number(a), number(b)) else { return Val::Null };
    let result = match op {
        '+' => a + b,
        '-' => a - b,
        '*' => a * b,
        '/' => a / b,
        'f' => (a / b).floor(),
        '%' => a - (a / b).floor() * b,
        _ => return Val::Null,
    };
    if result.is_finite() {
        Val::Float(result)
    } else {
        Val::Null
    }
}

fn touches(table: &Table, row: usize, register_type: &str, (first, last): (u32, u32), only_writes: bool) -> bool {
    let Some(t) = table.transaction(row) else {
        return touches_reading(table, row, register_type, (first, last), only_writes);
    };
    if row_of(&table.batch, t).and_then(|row| row.register_type.as_deref()) != Some(register_type) {
        return false;
    }
    let overlaps = |range: Option<(u16, u16)>| {
        range.is_some_and(|(address, quantity)| {
            let (low, high) = (u32::from(address), u32::from(address) + u32::from(quantity));
            low <= last && first < high
        })
    };
    overlaps(write_range(&table.batch, t)) || (!only_writes && overlaps(read_range(&table.batch, t)))
}

fn touches_reading(table: &Table, row: usize, register_type: &str, (first, last): (u32, u32), only_writes: bool) -> bool {
    let text = |key: &str| table.kind.column(key).map(|column| cell_text(&table.cell(row, column))).unwrap_or_default();
    let address = text("address").parse::<u32>();
    text("register_type") == register_type
        && address.is_ok_and(|address| (first..=last).contains(&address))
        && (!only_writes || text("operation") == "write")
}
