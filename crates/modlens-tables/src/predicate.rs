//! Evaluates filter expressions over rows: the tree that `analyzer/filters.py` compiles them to.
//!
//! A comparison with null is false, and so is `in` with a null on either side.

use std::borrow::Cow;
use std::cmp::Ordering;

use serde_json::Value as Json;

use crate::cell_text::{cell_text, source_text};
use crate::columns::{read_range, row_of, write_range, Cell, Items, Table, TableKind};
use modlens_protocol::finding::Finding;

/// A filter for one table.
#[derive(Clone, Debug)]
pub struct Predicate {
    /// The table whose rows it filters.
    pub kind: TableKind,
    root: Expr,
}

/// A node of the expression tree. Conditions are numbers: 1 for true, 0 for false.
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

/// A comparison operator.
#[derive(Clone, Copy, Debug)]
enum Compare {
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
}

/// The value of an expression in one row.
enum Operand<'a> {
    Null,
    Int(i64),
    Float(f64),
    Text(Cow<'a, str>),
    Ints(Items<'a>),
    Codes(&'a [Finding]),
    List(&'a [Expr]),
}

impl Predicate {
    /// Compiles a tree in JSON. The error names the node that is wrong; trees from `filters.py` are always right.
    pub fn new(table: &str, tree: &str) -> Result<Self, String> {
        let kind = TableKind::from_name(table).ok_or_else(|| format!("no table {table:?}"))?;
        let tree: Json = serde_json::from_str(tree).map_err(|e| e.to_string())?;
        Ok(Self { kind, root: compile(kind, &tree, 0)? })
    }

    /// The rows that satisfy the filter.
    #[must_use]
    pub fn filter(&self, table: &Table) -> Table {
        if let Some(kept) = self.filter_by_numbers(table) {
            return kept;
        }
        table.filter(|table, row| self.holds(table, row))
    }

    /// Filters by a comparison of a numeric column with a constant, which needs no evaluation row by row; `None` if the
    /// filter is something else or the column does not support it.
    fn filter_by_numbers(&self, table: &Table) -> Option<Table> {
        let Expr::Compare(op, a, b) = &self.root else { return None };
        let (Expr::Column(column), constant) = (&**a, exact_constant(b)?) else { return None };
        match op {
            Compare::Eq => table.with_numbers(*column, |number| number.partial_cmp(&constant) == Some(Ordering::Equal)),
            // A row without a number is not equal to the constant, but comparisons with null are false.
            Compare::Ne => table.with_numbers(*column, |number| number.partial_cmp(&constant).is_some_and(Ordering::is_ne)),
            Compare::Lt => table.with_numbers(*column, |number| number < constant),
            Compare::Le => table.with_numbers(*column, |number| number <= constant),
            Compare::Gt => table.with_numbers(*column, |number| number > constant),
            Compare::Ge => table.with_numbers(*column, |number| number >= constant),
        }
    }

    /// Whether a row satisfies the filter.
    pub fn holds(&self, table: &Table, row: usize) -> bool {
        is_true(&self.root, table, row)
    }
}

/// Trees that are nested deeper than this are refused, so that recursion is bounded.
const MAX_DEPTH: usize = 200;

/// Compiles the node `["operator", arguments...]` and its arguments.
fn compile(kind: TableKind, tree: &Json, depth: usize) -> Result<Expr, String> {
    let wrong = || format!("not a filter: {tree}");
    let parts = tree.as_array().filter(|_| depth < MAX_DEPTH).ok_or_else(wrong)?;
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

/// Whether a condition holds in a row.
fn is_true(expr: &Expr, table: &Table, row: usize) -> bool {
    match expr {
        Expr::And(a, b) => is_true(a, table, row) && is_true(b, table, row),
        Expr::Or(a, b) => is_true(a, table, row) || is_true(b, table, row),
        Expr::Not(a) => !is_true(a, table, row),
        Expr::IsNone(a) => matches!(value(a, table, row), Operand::Null),
        Expr::Compare(op, a, b) => compare(*op, &value(a, table, row), &value(b, table, row)),
        Expr::In(a, b) => contains(&value(a, table, row), &value(b, table, row)),
        Expr::Touches { register_type, first, last, only_writes } => {
            touches(table, row, register_type, (*first, *last), *only_writes)
        }
        other => matches!(value(other, table, row), Operand::Int(n) if n != 0),
    }
}

/// The value of an expression in a row.
fn value<'a>(expr: &'a Expr, table: &'a Table, row: usize) -> Operand<'a> {
    match expr {
        Expr::Column(column) => cell(table.cell(row, *column)),
        Expr::Int(n) => Operand::Int(*n),
        Expr::Float(n) => Operand::Float(*n),
        Expr::Text(text) => Operand::Text(Cow::Borrowed(text)),
        Expr::List(items) => Operand::List(items),
        Expr::Negative(a) => match value(a, table, row) {
            Operand::Int(n) => n.checked_neg().map_or(Operand::Null, Operand::Int),
            Operand::Float(n) => Operand::Float(-n),
            _ => Operand::Null,
        },
        Expr::Arithmetic(op, a, b) => arithmetic(*op, &value(a, table, row), &value(b, table, row)),
        Expr::None => Operand::Null,
        condition => Operand::Int(i64::from(is_true(condition, table, row))),
    }
}

/// The value of a column as an operand. Durations are in microseconds, as users see them.
fn cell(cell: Cell<'_>) -> Operand<'_> {
    match cell {
        Cell::Null => Operand::Null,
        Cell::Int(n) | Cell::Time(n) => Operand::Int(n),
        Cell::Us(ns) => Operand::Float(ns as f64 / 1000.0),
        Cell::Float(value) => Operand::Float(value),
        Cell::Bool(yes) => Operand::Int(i64::from(yes)),
        Cell::Word(text) | Cell::Text(text) => Operand::Text(Cow::Borrowed(text)),
        Cell::Ints(items) => Operand::Ints(items),
        Cell::Codes(codes) => Operand::Codes(codes),
        Cell::Source(file, place, number) => Operand::Text(Cow::Owned(source_text(file, place, number))),
        other => Operand::Text(Cow::Owned(cell_text(&other))),
    }
}

/// The order of two values; `None` if they cannot be compared.
fn compare_values(a: &Operand<'_>, b: &Operand<'_>) -> Option<Ordering> {
    match (a, b) {
        (Operand::Int(a), Operand::Int(b)) => Some(a.cmp(b)),
        (Operand::Int(a), Operand::Float(b)) => (*a as f64).partial_cmp(b),
        (Operand::Float(a), Operand::Int(b)) => a.partial_cmp(&(*b as f64)),
        (Operand::Float(a), Operand::Float(b)) => a.partial_cmp(b),
        (Operand::Text(a), Operand::Text(b)) => Some(a.cmp(b)),
        _ => None,
    }
}

fn compare(op: Compare, a: &Operand<'_>, b: &Operand<'_>) -> bool {
    satisfies(op, compare_values(a, b))
}

/// The value of a numeric constant, if a float64 represents it exactly.
fn exact_constant(expr: &Expr) -> Option<f64> {
    match expr {
        Expr::Int(n) if n.unsigned_abs() <= 1 << 53 => Some(*n as f64),
        Expr::Float(n) => Some(*n),
        _ => None,
    }
}

/// Whether an order satisfies a comparison operator.
fn satisfies(op: Compare, compare_values: Option<Ordering>) -> bool {
    let Some(compare_values) = compare_values else { return false };
    match op {
        Compare::Eq => compare_values.is_eq(),
        Compare::Ne => compare_values.is_ne(),
        Compare::Lt => compare_values.is_lt(),
        Compare::Le => compare_values.is_le(),
        Compare::Gt => compare_values.is_gt(),
        Compare::Ge => compare_values.is_ge(),
    }
}

/// The operator `in`: an item of a list of constants, a number in a list of registers, a finding code, or a part of a
/// text.
fn contains(item: &Operand<'_>, list: &Operand<'_>) -> bool {
    match (item, list) {
        (Operand::Null, _) => false,
        (item, Operand::List(items)) => items.iter().any(|other| {
            let other = match other {
                Expr::Int(n) => Operand::Int(*n),
                Expr::Float(n) => Operand::Float(*n),
                Expr::Text(text) => Operand::Text(Cow::Borrowed(text)),
                _ => Operand::Null,
            };
            compare(Compare::Eq, item, &other)
        }),
        (Operand::Int(n), Operand::Ints(items)) => (0..items.len()).any(|i| i64::from(items.get(i)) == *n),
        (Operand::Float(n), Operand::Ints(items)) => (0..items.len()).any(|i| f64::from(items.get(i)).total_cmp(n).is_eq()),
        (Operand::Text(text), Operand::Codes(codes)) => codes.iter().any(|code| code.doc().code == text),
        (Operand::Text(part), Operand::Text(whole)) => whole.contains(part.as_ref()),
        _ => false,
    }
}

/// Applies an arithmetic operator with the semantics of Python: `//` and `%` round towards minus infinity. Null on
/// overflow and on division by zero.
fn arithmetic<'a>(op: char, a: &Operand<'_>, b: &Operand<'_>) -> Operand<'a> {
    if let (Operand::Int(a), Operand::Int(b)) = (a, b) {
        let (a, b) = (*a, *b);
        let floor = |a: i64, b: i64| a.checked_div_euclid(b).map(|q| if b < 0 && a.rem_euclid(b) != 0 { q - 1 } else { q });
        let result = match op {
            '+' => a.checked_add(b),
            '-' => a.checked_sub(b),
            '*' => a.checked_mul(b),
            '&' => Some(a & b),
            'f' => floor(a, b),
            '%' => floor(a, b).and_then(|q| a.checked_sub(q.checked_mul(b)?)),
            _ => return if b == 0 { Operand::Null } else { Operand::Float(a as f64 / b as f64) },
        };
        return result.map_or(Operand::Null, Operand::Int);
    }
    let number = |val: &Operand<'_>| match val {
        Operand::Int(n) => Some(*n as f64),
        Operand::Float(n) => Some(*n),
        _ => None,
    };
    let (Some(a), Some(b)) = (number(a), number(b)) else { return Operand::Null };
    let result = match op {
        '+' => a + b,
        '-' => a - b,
        '*' => a * b,
        '/' => a / b,
        'f' => (a / b).floor(),
        '%' => a - (a / b).floor() * b,
        _ => return Operand::Null,
    };
    if result.is_finite() {
        Operand::Float(result)
    } else {
        Operand::Null
    }
}

/// Whether a transaction read or wrote an address from `first` to `last` (or only wrote it).
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

/// Whether a reading belongs to an address from `first` to `last` (and was written).
fn touches_reading(table: &Table, row: usize, register_type: &str, (first, last): (u32, u32), only_writes: bool) -> bool {
    let text = |key: &str| table.kind.column(key).map(|column| cell_text(&table.cell(row, column))).unwrap_or_default();
    let address = text("address").parse::<u32>();
    text("register_type") == register_type
        && address.is_ok_and(|address| (first..=last).contains(&address))
        && (!only_writes || text("operation") == "write")
}
