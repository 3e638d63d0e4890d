//! The columns of each table, for a given width.
//!
//! The first rows decide which columns are worth showing: no response times without a clock, no bus if there is only
//! one.

use crate::view::cell_texts::{self, ColumnLookup, TransactionValues};
use crate::view::grid::{CellContent, ColumnHead, GridColumn};
use crate::view::notation::AddressNotation;
use crate::view::room::Room;
use crate::view::safe_text::{visible, width};
use crate::view::style::Style;
use crate::view::value_list::ValueList;
use modlens_tables::columns::{Cell, RowRef, TableKind};

/// The maximum width of a bus's short name.
const BUS_LABEL_COLUMNS: usize = 16;

/// The bus is left out after all other columns but the time.
const BUS_RANK: u8 = u8::MAX - 1;

type Pieces<'a> = Vec<(CellContent<'a>, Style)>;

/// The columns of a table except its times. In a narrow terminal some are shorter or merged with their neighbour.
pub fn columns(kind: TableKind, base: AddressNotation, rows: &[RowRef<'_>], room: Room) -> Vec<GridColumn> {
    let keys = ColumnLookup(kind);
    let is_wide = room.is_wide();
    let has_times = || {
        let elapsed = keys.at("elapsed_us");
        rows.iter().any(|row| !matches!(row.cell(elapsed), Cell::Null))
    };
    match kind {
        TableKind::Transactions => transactions(keys, base, has_times(), room),
        TableKind::Frames => frames(keys, has_times(), is_wide),
        TableKind::Connections => connections(keys, is_wide),
        TableKind::Readings => readings(keys, base, rows, room),
        TableKind::Findings => findings(keys, is_wide),
        TableKind::Diagnoses => diagnoses(keys),
    }
}

/// The column with the short name of the bus. `labels` maps each name to its short name.
pub fn bus(kind: TableKind, labels: Vec<(String, String)>) -> GridColumn {
    let at = ColumnLookup(kind).at("bus");
    let widest = labels.iter().map(|(_, label)| width(label)).max().unwrap_or(0);
    plain(ColumnHead::left("bus", widest.min(BUS_LABEL_COLUMNS)).dropped(BUS_RANK), move |row| {
        let name = cell_texts::word(row, at).unwrap_or_default();
        labels.iter().find(|(known, _)| known == name).map_or_else(|| visible(name), |(_, label)| label.clone())
    })
}

/// The columns of the table of transactions.
fn transactions(keys: ColumnLookup, base: AddressNotation, has_times: bool, room: Room) -> Vec<GridColumn> {
    let is_wide = room.is_wide();
    let own_number = number(keys, "txn", ColumnHead::right(if is_wide { "transaction" } else { "no." }, 4).dropped(1));
    let mut chosen = vec![own_number, unit(keys), function(keys, is_wide), addresses(keys, base, room)];
    if has_times {
        chosen.push(response_time(keys, is_wide));
    }
    let (status, exception, name) = (keys.at("status"), keys.at("exception"), keys.at("exception_name"));
    let (found, carried) = (keys.at("findings"), TransactionValues::new(keys));
    let state = move |row: &RowRef<'_>| {
        let word = cell_texts::word(row, status).unwrap_or_default();
        let code = cell_texts::number(row, exception).map_or_else(String::new, |code| format!(" {code}"));
        (format!("{word}{code}"), cell_texts::status_style(word))
    };
    chosen.extend(state_and_content("status", "values", is_wide, state, move |row, pieces| {
        let said = cell_texts::word(row, status).unwrap_or_default();
        let (values, mut refused) = (carried.values(row, base), visible(&cell_texts::text(row, name)));
        if !refused.is_empty() && !values.is_empty() {
            refused.push(':');
        }
        pieces.push((CellContent::Text(cell_texts::findings(row, found, said)), Style::Odd));
        pieces.push((CellContent::Text(refused), Style::Plain));
        pieces.push((CellContent::ValueList(values), Style::Plain));
    }));
    chosen
}

/// The columns of the table of frames.
fn frames(keys: ColumnLookup, has_times: bool, is_wide: bool) -> Vec<GridColumn> {
    let (code, name, direction) = (keys.at("function"), keys.at("function_name"), keys.at("direction"));
    let mut chosen = vec![
        number(keys, "frame", ColumnHead::right("frame", 5).dropped(1)),
        plain(ColumnHead::left("dir", 3), move |row| match cell_texts::word(row, direction) {
            Some("request") => "req".into(),
            Some("response") => "rsp".into(),
            _ => "?".into(),
        }),
        unit(keys),
        if is_wide {
            let head = ColumnHead::left("function", 24).at_most(28);
            plain(head, move |row| cell_texts::function_long(cell_texts::number(row, code), cell_texts::word(row, name)))
        } else {
            plain(ColumnHead::left("fc", 3), move |row| {
                cell_texts::number(row, code).map_or_else(String::new, |code| format!("{code:3}"))
            })
        },
        number(keys, "byte_length", ColumnHead::right("len", 3)),
    ];
    if has_times {
        let gap = keys.at("gap_us");
        chosen.push(plain(ColumnHead::right("gap ms", 6).dropped(2), move |row| {
            cell_texts::milliseconds(row, gap).unwrap_or_default()
        }));
    }
    let (verdict, found, hex) = (keys.at("verdict"), keys.at("findings"), keys.at("hex"));
    let state = move |row: &RowRef<'_>| {
        let word = cell_texts::word(row, verdict).unwrap_or_default();
        (word.to_owned(), cell_texts::verdict_style(word))
    };
    chosen.extend(state_and_content("verdict", "bytes", is_wide, state, move |row, pieces| {
        let said = cell_texts::word(row, verdict).unwrap_or_default();
        pieces.push((CellContent::Text(cell_texts::findings(row, found, said)), Style::Odd));
        if let Cell::Hex(bytes) = row.cell(hex) {
            pieces.push((CellContent::ValueList(ValueList::Bytes(bytes)), Style::Plain));
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
) -> Vec<GridColumn> {
    if is_wide {
        let state = GridColumn::new(ColumnHead::left(title, 12), move |row| {
            let (word, style) = state(row);
            (CellContent::Text(word), style)
        });
        let rest = GridColumn::new(ColumnHead::left(&format!("findings, {content}"), 12).sharing(), move |row| {
            let mut pieces = Vec::with_capacity(3);
            rest(row, &mut pieces);
            (CellContent::Run(pieces), Style::Plain)
        });
        return vec![state, rest];
    }
    vec![GridColumn::new(ColumnHead::left(&format!("{title}, {content}"), 11).sharing(), move |row| {
        let (word, style) = state(row);
        let mut pieces = vec![(CellContent::Text(word), style)];
        rest(row, &mut pieces);
        (CellContent::Run(pieces), Style::Plain)
    })]
}

/// The columns of the table of readings.
///
/// A narrow terminal has no room for raw registers beside names and values.
fn readings(keys: ColumnLookup, base: AddressNotation, rows: &[RowRef<'_>], room: Room) -> Vec<GridColumn> {
    let is_wide = room.is_wide();
    let (address, kind, raw) = (keys.at("address"), keys.at("register_type"), keys.at("raw"));
    let [name, value, unit_of_measure] = ["name", "value_text", "unit_of_measure"].map(|key| keys.at(key));
    let mut chosen = vec![
        transaction(keys, is_wide),
        unit(keys),
        plain(ColumnHead::left("type", 4), move |row| {
            cell_texts::short_name(cell_texts::word(row, kind)).unwrap_or_default().into()
        }),
        plain(ColumnHead::right(address_title(base, room), 6), move |row| {
            cell_texts::address_range(cell_texts::number(row, address), Some(1), cell_texts::word(row, kind), base)
        }),
        word(keys, "operation", ColumnHead::left(if is_wide { "operation" } else { "op" }, 5).dropped(2), |_| Style::Plain),
    ];
    if is_wide || rows.iter().all(|row| matches!(row.cell(name), Cell::Null)) {
        chosen.push(GridColumn::new(ColumnHead::right("raw", 5), move |row| match row.cell(raw) {
            Cell::Ints(items) => (CellContent::ValueList(ValueList::Numbers(items)), Style::Plain),
            _ => (CellContent::Text(String::new()), Style::Plain),
        }));
    }
    let named_value = move |row: &RowRef<'_>| {
        let [name, value, unit] = [name, value, unit_of_measure].map(|key| cell_texts::text(row, key));
        CellContent::Named(visible(&name), cell_texts::joined(&[value, unit]))
    };
    if is_wide {
        chosen.push(GridColumn::new(ColumnHead::left("value", 8).sharing(), move |row| (named_value(row), Style::Plain)));
        chosen.push(word(keys, "status", ColumnHead::left("status", 11), cell_texts::status_style));
        return chosen;
    }
    let status = keys.at("status");
    let state = move |row: &RowRef<'_>| {
        let word = cell_texts::word(row, status).unwrap_or_default();
        (word.to_owned(), cell_texts::status_style(word))
    };
    chosen.extend(state_and_content("status", "value", is_wide, state, move |row, pieces| {
        pieces.push((named_value(row), Style::Plain));
    }));
    chosen
}

/// The columns of the table of findings.
fn findings(keys: ColumnLookup, is_wide: bool) -> Vec<GridColumn> {
    let (severity, code) = (keys.at("severity"), keys.at("code"));
    let mut chosen = vec![
        number(keys, "frame", ColumnHead::right("frame", 5).dropped(2)),
        transaction(keys, is_wide),
        unit(keys),
        word(keys, "severity", ColumnHead::left("severity", 8).dropped(3), cell_texts::severity_style),
        GridColumn::new(ColumnHead::left("code", 16), move |row| {
            let style = cell_texts::severity_style(cell_texts::word(row, severity).unwrap_or_default());
            (CellContent::Text(cell_texts::text(row, code)), style)
        }),
        text(keys, "detail", ColumnHead::left("what was seen", 10).sharing()),
    ];
    if is_wide {
        chosen.push(text(keys, "advice", ColumnHead::left("what to check", 20).sharing()));
    }
    chosen
}

/// The columns of the table of connections.
fn connections(keys: ColumnLookup, is_wide: bool) -> Vec<GridColumn> {
    let (client, port) = (keys.at("client"), keys.at("client_port"));
    let (refused, reset, closed_by) = (keys.at("refused"), keys.at("reset"), keys.at("closed_by"));
    let (idle, found) = (keys.at("idle_us"), keys.at("findings"));
    let framing = ["client_framing", "server_framing"].map(|key| keys.at(key));
    let is_set = |row: &RowRef<'_>, column: usize| matches!(row.cell(column), Cell::Bool(true));
    let mut chosen = vec![
        number(keys, "connection", ColumnHead::right("conn", 4).dropped(1)),
        plain(ColumnHead::left("client", 15).at_most(28), move |row| {
            let port = cell_texts::number(row, port).unwrap_or_default();
            format!("{}:{port}", visible(&cell_texts::text(row, client)))
        }),
        number(keys, "requests", ColumnHead::right("req", 3)),
        number(keys, "answered", ColumnHead::right("ans", 3)),
        word(keys, "first_status", ColumnHead::left("first", 8), cell_texts::status_style),
    ];
    if is_wide {
        chosen.push(plain(ColumnHead::left("framing", 7), move |row| {
            let sides = framing.map(|side| cell_texts::word(row, side).unwrap_or("-"));
            if sides[0] == sides[1] {
                sides[0].to_owned()
            } else {
                sides.join("/")
            }
        }));
    }
    chosen.push(GridColumn::new(ColumnHead::left("end, findings", 10).sharing(), move |row| {
        let end = match (is_set(row, refused), is_set(row, reset), cell_texts::word(row, closed_by)) {
            (true, _, _) => String::from("refused"),
            (_, true, Some(by)) => format!("reset, ended by {by}"),
            (_, _, Some(by)) => format!("closed by {by}"),
            _ => String::from("open"),
        };
        let after = cell_texts::milliseconds(row, idle).map_or_else(String::new, |ms| format!("after {} ms", ms.trim()));
        let style = if is_set(row, refused) || is_set(row, reset) { Style::Odd } else { Style::Plain };
        let pieces = vec![
            (CellContent::Text(end), style),
            (CellContent::Text(after), Style::Plain),
            (CellContent::Text(cell_texts::findings(row, found, "")), Style::Odd),
        ];
        (CellContent::Run(pieces), Style::Plain)
    }));
    chosen
}

/// The columns of the table of diagnoses.
fn diagnoses(keys: ColumnLookup) -> Vec<GridColumn> {
    let (severity, code) = (keys.at("severity"), keys.at("code"));
    vec![
        GridColumn::new(ColumnHead::left("code", 16), move |row| {
            let style = cell_texts::severity_style(cell_texts::word(row, severity).unwrap_or_default());
            (CellContent::Text(cell_texts::text(row, code)), style)
        }),
        number(keys, "unit", ColumnHead::right("unit", 4)),
        number(keys, "failed", ColumnHead::right("failed", 6).dropped(2)),
        number(keys, "total", ColumnHead::right("of", 6).dropped(1)),
        text(keys, "sentence", ColumnHead::left("what is wrong", 12).sharing()),
    ]
}

/// A column of plain text.
fn plain(head: ColumnHead, read: impl Fn(&RowRef<'_>) -> String + Send + Sync + 'static) -> GridColumn {
    GridColumn::new(head, move |row| (CellContent::Text(read(row)), Style::Plain))
}

/// A column of numbers.
fn number(keys: ColumnLookup, key: &str, head: ColumnHead) -> GridColumn {
    let at = keys.at(key);
    plain(head, move |row| cell_texts::number(row, at).map_or_else(String::new, |number| number.to_string()))
}

/// The column with the number of the transaction that a row belongs to.
fn transaction(keys: ColumnLookup, is_wide: bool) -> GridColumn {
    number(keys, "txn", ColumnHead::right(if is_wide { "transaction" } else { "txn" }, 4).dropped(1))
}

/// The column with the unit address.
fn unit(keys: ColumnLookup) -> GridColumn {
    number(keys, "unit", ColumnHead::right("unit", 4))
}

/// A column of text from the input.
fn text(keys: ColumnLookup, key: &str, head: ColumnHead) -> GridColumn {
    let at = keys.at(key);
    plain(head, move |row| visible(&cell_texts::text(row, at)))
}

/// A column with words of modlens's own vocabulary, each in its style.
fn word(keys: ColumnLookup, key: &str, head: ColumnHead, style: fn(&str) -> Style) -> GridColumn {
    let at = keys.at(key);
    GridColumn::new(head, move |row| {
        let word = cell_texts::word(row, at).unwrap_or_default();
        (CellContent::Text(word.to_owned()), style(word))
    })
}

/// The column with the function.
fn function(keys: ColumnLookup, is_wide: bool) -> GridColumn {
    let (code, name) = (keys.at("function"), keys.at("function_name"));
    let (does, kind) = (keys.at("operation"), keys.at("register_type"));
    let head = ColumnHead::left("function", 11).at_most(if is_wide { 28 } else { 14 });
    plain(head, move |row| {
        let (code, name) = (cell_texts::number(row, code), cell_texts::word(row, name));
        if is_wide {
            cell_texts::function_long(code, name)
        } else {
            cell_texts::function_short(code, name, cell_texts::word(row, does), cell_texts::word(row, kind))
        }
    })
}

/// The title of a column of addresses.
fn address_title(base: AddressNotation, room: Room) -> &'static str {
    if room == Room::Narrow {
        base.short_title()
    } else {
        base.title()
    }
}

/// The column with the addresses that were read, or else those that were written.
fn addresses(keys: ColumnLookup, base: AddressNotation, room: Room) -> GridColumn {
    let kind = keys.at("register_type");
    let ranges = [["address", "quantity"], ["write_address", "write_quantity"]].map(|range| range.map(|key| keys.at(key)));
    plain(ColumnHead::left(address_title(base, room), if room == Room::Narrow { 6 } else { 11 }), move |row| {
        let range = ranges.iter().find(|[first, _]| cell_texts::number(row, *first).is_some());
        range.map_or_else(String::new, |&[first, quantity]| {
            cell_texts::address_range(
                cell_texts::number(row, first),
                cell_texts::number(row, quantity),
                cell_texts::word(row, kind),
                base,
            )
        })
    })
}

/// The column with the response time, or with the time that the master waited in vain.
fn response_time(keys: ColumnLookup, is_wide: bool) -> GridColumn {
    let [took, late, waited] = ["response_time_us", "late_response_us", "waited_us"].map(|key| keys.at(key));
    plain(ColumnHead::right(if is_wide { "response ms" } else { "resp. ms" }, 5).dropped(2), move |row| {
        let answer = cell_texts::milliseconds(row, took).or_else(|| cell_texts::milliseconds(row, late));
        let vain = || cell_texts::milliseconds(row, waited).map(|waited| format!(">{waited}"));
        answer.or_else(vain).unwrap_or_default()
    })
}
