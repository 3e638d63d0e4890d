//! The cells of a table, by the words of the column's `as`.

use modlens_protocol::visible::visible;
use serde_json::Value as Json;

use crate::layout::{list, text};
use crate::rows::Row;
use crate::texts::{fixed, milliseconds, moment, number, percent, plain, words};

/// Columns that are aligned to the right.
const RIGHT: [&str; 9] = ["number", "int", "some", "ms", "seconds", "percent", "load", "share", "total"];

/// Whether a document is of several buses, so that each row names its own.
pub fn has_several_buses(document: &Json) -> bool {
    list(&document["statistics"]["buses"]).len() > 1
}

/// The columns of a section; those that tell buses apart only where there are several.
pub fn columns<'a>(document: &Json, section: &'a Json) -> impl Iterator<Item = &'a Json> {
    let several = has_several_buses(document);
    list(&section["columns"]).iter().filter(move |column| several || column["only_with_several_buses"] != true)
}

/// Whether the cells of a column are aligned to the right.
pub fn is_right(column: &Json) -> bool {
    RIGHT.contains(&text(&column["as"]))
}

/// Whether a script draws the cells of a column.
pub fn is_drawn(column: &Json) -> bool {
    column["as"] == "plot"
}

/// Whether the cells of a column are small pictures: outlines, one for each colour.
pub fn is_strip(column: &Json) -> bool {
    column["as"] == "strip"
}

/// The text of a cell; empty where there is no value.
pub fn cell(document: &Json, column: &Json, row: &Row<'_>) -> String {
    let at = |key: &str| column[key].as_str().and_then(|path| row.at(path));
    let Some(value) = at("path").or_else(|| at("or")) else { return String::new() };
    match text(&column["as"]) {
        "plot" => String::new(),
        // The outlines of the colours of a picture.
        "strip" => list(value).iter().map(plain).collect::<Vec<String>>().join("|"),
        "int" => fixed(number(value), 0),
        "some" => if_any(number(value), |count| fixed(count, 0)),
        "ms" => milliseconds(number(value)),
        "seconds" => fixed(number(value) / 1e6, 1),
        "percent" => percent(number(value)),
        "load" => if_any(number(value), percent),
        "share" => if_any(at("of").map_or(0.0, number), |whole| percent(number(value) / whole)),
        "counts" => counts(value),
        "total" => fixed(value.as_object().map_or(0.0, |counts| counts.values().map(number).sum()), 0),
        "list" => list(value).iter().map(plain).collect::<Vec<String>>().join(", "),
        "yes" => if *value == true { "yes" } else { "" }.to_owned(),
        "words" => words(text(value)),
        "time" => moment(text(value)),
        "function" => function(document, value),
        _ => plain(value),
    }
}

/// A function with its name.
pub fn function(document: &Json, code: &Json) -> String {
    let number = plain(code);
    let name = text(&document["functions"][&number]);
    format!("{number} {}", visible(name)).trim().to_owned()
}

fn if_any(value: f64, write: impl Fn(f64) -> String) -> String {
    if value == 0.0 {
        String::new()
    } else {
        write(value)
    }
}

fn counts(value: &Json) -> String {
    let counts = value.as_object().into_iter().flatten().filter(|(_, count)| number(count) != 0.0);
    counts.map(|(key, count)| format!("{} {}", words(key), fixed(number(count), 0))).collect::<Vec<String>>().join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn shown(column: &Json, row: &Json) -> String {
        let document = json!({"functions": {"3": "Read Holding Registers"}});
        cell(&document, column, &Row::from(row.as_object().expect("an object")))
    }

    #[test]
    fn a_cell_is_written_as_its_column_says() {
        let row = json!({"time_us": 12345.5, "a": 1, "b": 3, "none": 0, "nothing": null, "counts": {"bad_crc": 2, "ok": 0, "noise": 1}});
        assert_eq!(shown(&json!({"path": "time_us", "as": "ms"}), &row), "12.3");
        assert_eq!(shown(&json!({"path": "a", "of": "b", "as": "share"}), &row), "33.3 %");
        assert_eq!(shown(&json!({"path": "a", "of": "none", "as": "share"}), &row), "");
        assert_eq!(shown(&json!({"path": "none", "as": "some"}), &row), "");
        assert_eq!(shown(&json!({"path": "none", "as": "int"}), &row), "0");
        assert_eq!(shown(&json!({"path": "nothing", "or": "b", "as": "text"}), &row), "3");
        assert_eq!(shown(&json!({"path": "counts", "as": "counts"}), &row), "bad crc 2, noise 1");
        assert_eq!(shown(&json!({"path": "counts", "as": "total"}), &row), "3");
        assert_eq!(shown(&json!({"path": "b", "as": "function"}), &row), "3 Read Holding Registers");
        assert_eq!(shown(&json!({"path": "a", "as": "function"}), &row), "1");
    }

    #[test]
    fn each_column_of_the_layout_is_written_by_a_known_word() {
        const OTHERS: [&str; 9] = ["strip", "text", "words", "counts", "list", "function", "yes", "plot", "time"];
        for section in crate::layout::sections() {
            for column in list(&section["columns"]) {
                let word = text(&column["as"]);
                assert!(RIGHT.contains(&word) || OTHERS.contains(&word), "{word:?} in {column}");
            }
        }
    }
}
