//! What each of the four tables shows, in which columns, in how much room.
//!
//! The first rows decide what is worth a column: no response times without a clock, no bus where there is one only.

use crate::view::cells::{self, Carried, Keys};
use crate::view::grid::{Column, Head, Shown, Values};
use crate::view::text::{visible, width};
use crate::view::{Base, Style};
use modlens_tables::columns::{Cell, RowRef, TableKind};

/// Columns of a bus's short name.
const LABEL: usize = 16;

type Pieces<'a> = Vec<(Shown<'a>, Style)>;

/// The columns of a table, without its times; in little room some are shorter, or one with their neighbour.
pub fn columns(kind: TableKind, base: Base, rows: &[RowRef<'_>], roomy: bool) -> Vec<Column> {
    let keys = Keys(kind);
    let elapsed = keys.at("elapsed_us");
    let timed = rows.iter().any(|row| !matches!(row.cell(elapsed), Cell::Null));
    match kind {
        TableKind::Transactions => transactions(keys, base, timed, roomy),
        TableKind::Frames => frames(keys, timed, roomy),
        TableKind::Readings => readings(keys, base),
        TableKind::Findings => findings(keys, roomy),
    }
}

/// The bus's short name: `labels` has each name with its own.
pub fn bus(kind: TableKind, labels: Vec<(String, String)>) -> Column {
    let at = Keys(kind).at("bus");
    let widest = labels.iter().map(|(_, label)| width(label)).max().unwrap_or(0);
    plain(Head::left("bus", widest.min(LABEL)), move |row| {
        let name = cells::word(row, at).unwrap_or_default();
        labels.iter().find(|(known, _)| known == name).map_or_else(|| visible(name), |(_, label)| label.clone())
    })
}

fn transactions(keys: Keys, base: Base, timed: bool, roomy: bool) -> Vec<Column> {
    let mut chosen = vec![number(keys, "txn", Head::right("txn", 4)), unit(keys), function(keys, roomy), addresses(keys, base)];
    if timed {
        chosen.push(response(keys));
    }
    let (status, exception, name) = (keys.at("status"), keys.at("exception"), keys.at("exception_name"));
    let (found, carried) = (keys.at("findings"), Carried::new(keys));
    let state = move |row: &RowRef<'_>| {
        let word = cells::word(row, status).unwrap_or_default();
        let code = cells::number(row, exception).map_or_else(String::new, |code| format!(" {code}"));
        (format!("{word}{code}"), cells::status_style(word))
    };
    chosen.extend(ending("status", "values", roomy, state, move |row, pieces| {
        let said = cells::word(row, status).unwrap_or_default();
        let (values, mut refused) = (carried.values(row, base), visible(&cells::text(row, name)));
        if !refused.is_empty() && !values.is_empty() {
            refused.push(':');
        }
        pieces.push((Shown::Text(cells::findings(row, found, said)), Style::Odd));
        pieces.push((Shown::Text(refused), Style::Plain));
        pieces.push((Shown::Values(values), Style::Plain));
    }));
    chosen
}

fn frames(keys: Keys, timed: bool, roomy: bool) -> Vec<Column> {
    let (code, name, direction) = (keys.at("function"), keys.at("function_name"), keys.at("direction"));
    let mut chosen = vec![
        number(keys, "frame", Head::right("frame", 5)),
        plain(Head::left("dir", 3), move |row| match cells::word(row, direction) {
            Some("request") => "req".into(),
            Some("response") => "rsp".into(),
            _ => "?".into(),
        }),
        unit(keys),
        if roomy {
            let head = Head::left("function", 24).at_most(28);
            plain(head, move |row| cells::function_long(cells::number(row, code), cells::word(row, name)))
        } else {
            plain(Head::left("fc", 3), move |row| cells::number(row, code).map_or_else(String::new, |code| format!("{code:3}")))
        },
        number(keys, "byte_length", Head::right("len", 3)),
    ];
    if timed {
        let gap = keys.at("gap_us");
        chosen.push(plain(Head::right("gap ms", 6), move |row| cells::milliseconds(row, gap).unwrap_or_default()));
    }
    let (verdict, found, hex) = (keys.at("verdict"), keys.at("findings"), keys.at("hex"));
    let state = move |row: &RowRef<'_>| {
        let word = cells::word(row, verdict).unwrap_or_default();
        (word.to_owned(), cells::verdict_style(word))
    };
    chosen.extend(ending("verdict", "bytes", roomy, state, move |row, pieces| {
        let said = cells::word(row, verdict).unwrap_or_default();
        pieces.push((Shown::Text(cells::findings(row, found, said)), Style::Odd));
        if let Cell::Hex(bytes) = row.cell(hex) {
            pieces.push((Shown::Values(Values::Bytes(bytes)), Style::Plain));
        }
    }));
    chosen
}

/// The last columns: a state, then findings and content in what room is left.
///
/// In little room both are one column: most states are `ok`, which leaves more for the content.
fn ending(
    title: &str,
    content: &str,
    roomy: bool,
    state: impl Fn(&RowRef<'_>) -> (String, Style) + Send + Sync + 'static,
    rest: impl for<'a> Fn(&RowRef<'a>, &mut Pieces<'a>) + Send + Sync + 'static,
) -> Vec<Column> {
    if roomy {
        let state = Column::new(Head::left(title, 12), move |row| {
            let (word, style) = state(row);
            (Shown::Text(word), style)
        });
        let rest = Column::new(Head::left(&format!("findings, {content}"), 12).sharing(), move |row| {
            let mut pieces = Vec::with_capacity(3);
            rest(row, &mut pieces);
            (Shown::Run(pieces), Style::Plain)
        });
        return vec![state, rest];
    }
    vec![Column::new(Head::left(&format!("{title}, {content}"), 11).sharing(), move |row| {
        let (word, style) = state(row);
        let mut pieces = vec![(Shown::Text(word), style)];
        rest(row, &mut pieces);
        (Shown::Run(pieces), Style::Plain)
    })]
}

fn readings(keys: Keys, base: Base) -> Vec<Column> {
    let (address, kind, raw) = (keys.at("address"), keys.at("register_type"), keys.at("raw"));
    let parts = ["name", "value_text", "unit_of_measure"].map(|key| keys.at(key));
    vec![
        number(keys, "txn", Head::right("txn", 4)),
        unit(keys),
        plain(Head::left("type", 4), move |row| cells::short(cells::word(row, kind)).unwrap_or_default().into()),
        plain(Head::right(base.title(), 6), move |row| {
            cells::span(cells::number(row, address), Some(1), cells::word(row, kind), base)
        }),
        word(keys, "operation", Head::left("does", 5), |_| Style::Plain),
        Column::new(Head::right("raw", 5), move |row| match row.cell(raw) {
            Cell::Ints(items) => (Shown::Values(Values::Numbers(items)), Style::Plain),
            _ => (Shown::Text(String::new()), Style::Plain),
        }),
        plain(Head::left("value", 8).sharing(), move |row| cells::joined(&parts.map(|part| cells::text(row, part)))),
        word(keys, "status", Head::left("status", 11), cells::status_style),
    ]
}

fn findings(keys: Keys, roomy: bool) -> Vec<Column> {
    let (severity, code) = (keys.at("severity"), keys.at("code"));
    let mut chosen = vec![
        number(keys, "frame", Head::right("frame", 5)),
        number(keys, "txn", Head::right("txn", 4)),
        unit(keys),
        word(keys, "severity", Head::left("severity", 8), cells::severity_style),
        Column::new(Head::left("code", 16), move |row| {
            let style = cells::severity_style(cells::word(row, severity).unwrap_or_default());
            (Shown::Text(cells::text(row, code)), style)
        }),
        text(keys, "detail", Head::left("what was seen", 10).sharing()),
    ];
    if roomy {
        chosen.push(text(keys, "advice", Head::left("what to check", 20).sharing()));
    }
    chosen
}

/// A column that is a text without a colour.
fn plain(head: Head, read: impl Fn(&RowRef<'_>) -> String + Send + Sync + 'static) -> Column {
    Column::new(head, move |row| (Shown::Text(read(row)), Style::Plain))
}

fn number(keys: Keys, key: &str, head: Head) -> Column {
    let at = keys.at(key);
    plain(head, move |row| cells::number(row, at).map_or_else(String::new, |number| number.to_string()))
}

fn unit(keys: Keys) -> Column {
    number(keys, "unit", Head::right("unit", 4))
}

/// A text from outside.
fn text(keys: Keys, key: &str, head: Head) -> Column {
    let at = keys.at(key);
    plain(head, move |row| visible(&cells::text(row, at)))
}

/// A word of ours, in its colour.
fn word(keys: Keys, key: &str, head: Head, style: fn(&str) -> Style) -> Column {
    let at = keys.at(key);
    Column::new(head, move |row| {
        let word = cells::word(row, at).unwrap_or_default();
        (Shown::Text(word.to_owned()), style(word))
    })
}

fn function(keys: Keys, roomy: bool) -> Column {
    let (code, name) = (keys.at("function"), keys.at("function_name"));
    let (does, kind) = (keys.at("operation"), keys.at("register_type"));
    let head = Head::left("function", 11).at_most(if roomy { 28 } else { 14 });
    plain(head, move |row| {
        let (code, name) = (cells::number(row, code), cells::word(row, name));
        if roomy {
            cells::function_long(code, name)
        } else {
            cells::function_short(code, name, cells::word(row, does), cells::word(row, kind))
        }
    })
}

/// What was read, or else what was written.
fn addresses(keys: Keys, base: Base) -> Column {
    let kind = keys.at("register_type");
    let ranges = [["address", "quantity"], ["write_address", "write_quantity"]].map(|range| range.map(|key| keys.at(key)));
    plain(Head::left(base.title(), 11), move |row| {
        let range = ranges.iter().find(|[first, _]| cells::number(row, *first).is_some());
        range.map_or_else(String::new, |&[first, quantity]| {
            cells::span(cells::number(row, first), cells::number(row, quantity), cells::word(row, kind), base)
        })
    })
}

/// How long the answer took, or how long it was waited for in vain.
fn response(keys: Keys) -> Column {
    let [took, late, waited] = ["response_time_us", "late_response_us", "waited_us"].map(|key| keys.at(key));
    plain(Head::right("ms", 5), move |row| {
        let answer = cells::milliseconds(row, took).or_else(|| cells::milliseconds(row, late));
        let vain = || cells::milliseconds(row, waited).map(|waited| format!(">{waited}"));
        answer.or_else(vain).unwrap_or_default()
    })
}
