//! The columns of each of the four tables, for a given width.
//!
//! The first rows decide which columns are worth showing: no response times without a clock, no bus if there is only
//! one.

use crate::view::cells::{self, Carried, Keys};
use crate::view::grid::{Column, Head, Shown, Values};
use crate::view::text::{visible, width};
use crate::view::{Base, Style};
use modlens_tables::columns::{Cell, RowRef, TableKind};

/// The maximum width of a bus's short name.
const BUS_LABEL_COLUMNS: usize = 16;

type Pieces<'a> = Vec<(Shown<'a>, Style)>;

/// The columns of a table except its times. In a narrow terminal some are shorter or merged with their neighbour.
pub fn columns(kind: TableKind, base: Base, rows: &[RowRef<'_>], is_wide: bool) -> Vec<Column> {
    let keys = Keys(kind);
    let elapsed = keys.at("elapsed_us");
    let has_times = rows.iter().any(|row| !matches!(row.cell(elapsed), Cell::Null));
    match kind {
        TableKind::Transactions => transactions(keys, base, has_times, is_wide),
        TableKind::Frames => frames(keys, has_times, is_wide),
        TableKind::Readings => readings(keys, base),
        TableKind::Findings => findings(keys, is_wide),
    }
}

/// The column with the short name of the bus. `labels` maps each name to its short name.
pub fn bus(kind: TableKind, labels: Vec<(String, String)>) -> Column {
    let at = Keys(kind).at("bus");
    let widest = labels.iter().map(|(_, label)| width(label)).max().unwrap_or(0);
    plain(Head::left("bus", widest.min(BUS_LABEL_COLUMNS)), move |row| {
        let name = cells::word(row, at).unwrap_or_default();
        labels.iter().find(|(known, _)| known == name).map_or_else(|| visible(name), |(_, label)| label.clone())
    })
}

/// The columns of the table of transactions.
fn transactions(keys: Keys, base: Base, has_times: bool, is_wide: bool) -> Vec<Column> {
    let mut chosen = vec![number(keys, "txn", Head::right("txn", 4)), unit(keys), function(keys, is_wide), addresses(keys, base)];
    if has_times {
        chosen.push(response_time(keys));
    }
    let (status, exception, name) = (keys.at("status"), keys.at("exception"), keys.at("exception_name"));
    let (found, carried) = (keys.at("findings"), Carried::new(keys));
    let state = move |row: &RowRef<'_>| {
        let word = cells::word(row, status).unwrap_or_default();
        let code = cells::number(row, exception).map_or_else(String::new, |code| format!(" {code}"));
        (format!("{word}{code}"), cells::status_style(word))
    };
    chosen.extend(state_and_content("status", "values", is_wide, state, move |row, pieces| {
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

/// The columns of the table of frames.
fn frames(keys: Keys, has_times: bool, is_wide: bool) -> Vec<Column> {
    let (code, name, direction) = (keys.at("function"), keys.at("function_name"), keys.at("direction"));
    let mut chosen = vec![
        number(keys, "frame", Head::right("frame", 5)),
        plain(Head::left("dir", 3), move |row| match cells::word(row, direction) {
            Some("request") => "req".into(),
            Some("response") => "rsp".into(),
            _ => "?".into(),
        }),
        unit(keys),
        if is_wide {
            let head = Head::left("function", 24).at_most(28);
            plain(head, move |row| cells::function_long(cells::number(row, code), cells::word(row, name)))
        } else {
            plain(Head::left("fc", 3), move |row| cells::number(row, code).map_or_else(String::new, |code| format!("{code:3}")))
        },
        number(keys, "byte_length", Head::right("len", 3)),
    ];
    if has_times {
        let gap = keys.at("gap_us");
        chosen.push(plain(Head::right("gap ms", 6), move |row| cells::milliseconds(row, gap).unwrap_or_default()));
    }
    let (verdict, found, hex) = (keys.at("verdict"), keys.at("findings"), keys.at("hex"));
    let state = move |row: &RowRef<'_>| {
        let word = cells::word(row, verdict).unwrap_or_default();
        (word.to_owned(), cells::verdict_style(word))
    };
    chosen.extend(state_and_content("verdict", "bytes", is_wide, state, move |row, pieces| {
        let said = cells::word(row, verdict).unwrap_or_default();
        pieces.push((Shown::Text(cells::findings(row, found, said)), Style::Odd));
        if let Cell::Hex(bytes) = row.cell(hex) {
            pieces.push((Shown::Values(Values::Bytes(bytes)), Style::Plain));
        }
    }));
    chosen
}

/// The last columns: the state of a row, then findings and content in the remaining room.
///
/// In a narrow terminal they share one column: most states are `ok`, which leaves more room for the content.
fn state_and_content(
    title: &str,
    content: &str,
    is_wide: bool,
    state: impl Fn(&RowRef<'_>) -> (String, Style) + Send + Sync + 'static,
    rest: impl for<'a> Fn(&RowRef<'a>, &mut Pieces<'a>) + Send + Sync + 'static,
) -> Vec<Column> {
    if is_wide {
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

/// The columns of the table of readings.
fn readings(keys: Keys, base: Base) -> Vec<Column> {
    let (address, kind, raw) = (keys.at("address"), keys.at("register_type"), keys.at("raw"));
    let parts = ["name", "value_text", "unit_of_measure"].map(|key| keys.at(key));
    vec![
        number(keys, "txn", Head::right("txn", 4)),
        unit(keys),
        plain(Head::left("type", 4), move |row| cells::short_name(cells::word(row, kind)).unwrap_or_default().into()),
        plain(Head::right(base.title(), 6), move |row| {
            cells::address_range(cells::number(row, address), Some(1), cells::word(row, kind), base)
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

/// The columns of the table of findings.
fn findings(keys: Keys, is_wide: bool) -> Vec<Column> {
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
    if is_wide {
        chosen.push(text(keys, "advice", Head::left("what to check", 20).sharing()));
    }
    chosen
}

/// A column of plain text.
fn plain(head: Head, read: impl Fn(&RowRef<'_>) -> String + Send + Sync + 'static) -> Column {
    Column::new(head, move |row| (Shown::Text(read(row)), Style::Plain))
}

/// A column of numbers.
fn number(keys: Keys, key: &str, head: Head) -> Column {
    let at = keys.at(key);
    plain(head, move |row| cells::number(row, at).map_or_else(String::new, |number| number.to_string()))
}

/// The column with the unit address.
fn unit(keys: Keys) -> Column {
    number(keys, "unit", Head::right("unit", 4))
}

/// A column of text from the input.
fn text(keys: Keys, key: &str, head: Head) -> Column {
    let at = keys.at(key);
    plain(head, move |row| visible(&cells::text(row, at)))
}

/// A column with words of modlens's own vocabulary, each in its style.
fn word(keys: Keys, key: &str, head: Head, style: fn(&str) -> Style) -> Column {
    let at = keys.at(key);
    Column::new(head, move |row| {
        let word = cells::word(row, at).unwrap_or_default();
        (Shown::Text(word.to_owned()), style(word))
    })
}

/// The column with the function.
fn function(keys: Keys, is_wide: bool) -> Column {
    let (code, name) = (keys.at("function"), keys.at("function_name"));
    let (does, kind) = (keys.at("operation"), keys.at("register_type"));
    let head = Head::left("function", 11).at_most(if is_wide { 28 } else { 14 });
    plain(head, move |row| {
        let (code, name) = (cells::number(row, code), cells::word(row, name));
        if is_wide {
            cells::function_long(code, name)
        } else {
            cells::function_short(code, name, cells::word(row, does), cells::word(row, kind))
        }
    })
}

/// The column with the addresses that were read, or else those that were written.
fn addresses(keys: Keys, base: Base) -> Column {
    let kind = keys.at("register_type");
    let ranges = [["address", "quantity"], ["write_address", "write_quantity"]].map(|range| range.map(|key| keys.at(key)));
    plain(Head::left(base.title(), 11), move |row| {
        let range = ranges.iter().find(|[first, _]| cells::number(row, *first).is_some());
        range.map_or_else(String::new, |&[first, quantity]| {
            cells::address_range(cells::number(row, first), cells::number(row, quantity), cells::word(row, kind), base)
        })
    })
}

/// The column with the response time, or with the time that the master waited in vain.
fn response_time(keys: Keys) -> Column {
    let [took, late, waited] = ["response_time_us", "late_response_us", "waited_us"].map(|key| keys.at(key));
    plain(Head::right("ms", 5), move |row| {
        let answer = cells::milliseconds(row, took).or_else(|| cells::milliseconds(row, late));
        let vain = || cells::milliseconds(row, waited).map(|waited| format!(">{waited}"));
        answer.or_else(vain).unwrap_or_default()
    })
}
