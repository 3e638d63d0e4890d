//! Tables of a section: texts of cells, without HTML.

use serde_json::Value as Json;

use crate::cells::{cell, columns, function, has_several_buses, is_drawn, is_right, is_strip};
use crate::layout::text;
use crate::rows::{rows_at, Row};
use crate::texts::{fixed, number, plain};

/// Rows of a table where the layout does not say how many.
const MOST: u64 = 500;

/// Statuses of transactions without a valid answer.
const FAILED: [&str; 3] = ["no_response", "bad_request", "bad_response"];

/// A table as texts.
pub struct Table {
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Which columns are aligned to the right.
    pub right: Vec<bool>,
    /// Which columns scripts draw: without them, their cells are empty.
    pub drawn: Vec<bool>,
    /// Which columns are small pictures: their texts are outlines.
    pub strips: Vec<bool>,
    /// Rows that are not shown.
    pub more: usize,
}

impl Table {
    /// The table of a section of the layout; columns without any text are left out.
    pub fn of(document: &Json, section: &Json) -> Self {
        let mut found = rows_at(document, text(&section["rows"]));
        let most = section["most"].as_u64().unwrap_or(MOST) as usize;
        let more = found.len().saturating_sub(most);
        found.truncate(most);
        if !section["matrix"].is_null() {
            return matrix(document, &found);
        }
        let with_texts = columns(document, section).map(|column| {
            let texts: Vec<String> = found.iter().map(|row| cell(document, column, row)).collect();
            (column, texts)
        });
        let kept: Vec<(&Json, Vec<String>)> =
            with_texts.filter(|(column, texts)| is_drawn(column) || texts.iter().any(|text| !text.is_empty())).collect();
        Self {
            head: kept.iter().map(|(column, _)| text(&column["title"]).to_owned()).collect(),
            rows: (0..found.len()).map(|row| kept.iter().map(|(_, texts)| texts[row].clone()).collect()).collect(),
            right: kept.iter().map(|(column, _)| is_right(column)).collect(),
            drawn: kept.iter().map(|(column, _)| is_drawn(column)).collect(),
            strips: kept.iter().map(|(column, _)| is_strip(column)).collect(),
            more,
        }
    }
}

/// Transactions, failures and exceptions by unit and function.
fn matrix(document: &Json, rows: &[Row<'_>]) -> Table {
    let several = has_several_buses(document);
    let unit = |row: &Row<'_>| {
        let bus = row.at("bus").filter(|_| several).map(plain).unwrap_or_default();
        format!("{bus} {}", row.at("unit").map(plain).unwrap_or_default()).trim().to_owned()
    };
    let code = |row: &Row<'_>| row.at("function").and_then(Json::as_u64).unwrap_or_default();
    let mut codes: Vec<u64> = rows.iter().map(code).collect();
    codes.sort_unstable();
    codes.dedup();
    let mut body: Vec<Vec<String>> = Vec::new();
    for row in rows {
        let name = unit(row);
        let at = body.iter().position(|line| line[0] == name).unwrap_or_else(|| {
            let mut line = vec![String::new(); codes.len() + 1];
            line[0] = name;
            body.push(line);
            body.len() - 1
        });
        let column = codes.partition_point(|&one| one < code(row));
        body[at][column + 1] = transactions(row);
    }
    let mut head = vec!["unit".to_owned()];
    head.extend(codes.iter().map(|&code| function(document, &code.into())));
    let none = vec![false; head.len()];
    Table { right: none.clone(), drawn: none.clone(), strips: none, head, rows: body, more: 0 }
}

fn transactions(row: &Row<'_>) -> String {
    let count = |path: &str| row.at(path).map_or(0.0, number);
    let failed: f64 = FAILED.iter().map(|status| count(&format!("statuses.{status}"))).sum();
    let refused = fixed(count("statuses.exception"), 0);
    let mut parts = vec![fixed(count("transactions"), 0)];
    if failed > 0.0 {
        parts.push(format!("{} failed", fixed(failed, 0)));
    }
    match refused.as_str() {
        "0" => (),
        "1" => parts.push("1 exception".to_owned()),
        many => parts.push(format!("{many} exceptions")),
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn columns_without_text_are_left_out() {
        let section = json!({"rows": "x[]", "most": 1, "columns": [
            {"title": "a", "path": "a", "as": "int"}, {"title": "b", "path": "b", "as": "text"},
            {"title": "c", "as": "plot"}, {"title": "bus", "path": "bus", "as": "text", "only_with_several_buses": true},
        ]});
        let document = json!({"x": [{"a": 1, "bus": "main"}, {"a": 2}], "statistics": {"buses": [{}]}});
        let table = Table::of(&document, &section);
        assert_eq!(table.head, ["a", "c"]);
        assert_eq!(table.rows, [["1", ""]]);
        assert_eq!((table.right, table.drawn, table.more), (vec![true, false], vec![false, true], 1));
    }

    #[test]
    fn the_matrix_has_a_row_for_each_unit_of_each_bus() {
        let row = |bus: &str, unit: u8, function: u8, statuses: Json| json!({"bus": bus, "units": [{"unit": unit, "function": function, "transactions": 7, "statuses": statuses}]});
        let document = json!({
            "functions": {"3": "Read"},
            "statistics": {"buses": [
                row("a", 1, 6, json!({"ok": 7})), row("b", 1, 3, json!({"no_response": 1, "bad_response": 1, "exception": 1})),
                row("a", 1, 3, json!({"exception": 2})),
            ]},
        });
        let table = Table::of(&document, &json!({"rows": "statistics.buses[].units[]", "matrix": {}}));
        assert_eq!(table.head, ["unit", "3 Read", "6"]);
        assert_eq!(table.rows, [["a 1", "7, 2 exceptions", "7"], ["b 1", "7, 2 failed, 1 exception", ""]]);
    }
}
