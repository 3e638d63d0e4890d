//! What the page may ask about a recording.

use modlens_filters::parse;
use modlens_tables::cell_text::cell_text;
use modlens_tables::columns::{Table, TableKind};
use serde_json::{json, Value as Json};

use crate::annotated::annotated;
use crate::export::Export;
use crate::registers;
use crate::report::report;
use crate::view::{local_changes, table_of};
use crate::Decoding;

/// Rows in one answer.
const MAX_ROWS: u64 = 1000;

/// Answers a question of the page. The message says what is wrong with it.
///
/// | `call` | with | answer |
/// |--|--|--|
/// | `listen` | `name`, `line` of a port | `line` to open it with, `searching`, `said`; `export_more` gives the bytes of its raw recording |
/// | `read` | `hex`, `time`, `hole`, `is_set` of a read of it | as before |
/// | `hang_up` | `time` when its last read returned | as before |
/// | `check` | `table`, `where` | `text` (normalized spelling), `notes` of the filter |
/// | `rows` | `table`, `columns`, `where` (a filter or null), `from`, `count` | `total`, `rows` (texts of the cells) |
/// | `row` | `table`, `where`, `at` | texts of all its columns by name |
/// | `bytes` | `table`, `where`, `at` | frames of the row: `title`, and `blocks` of bytes beside their meaning |
/// | `map` | | the last value of every register |
/// | `series` | `where` of the table `readings`, `most` | `total` values, and `steps`: time in µs, lowest, highest |
/// | `find` | `table`, `where`, `column`, `value` | `at`, the first row with this text in the column, or null |
/// | `keep_newest` | | null; from now on, as many transactions are kept as fit into the memory that they take now |
/// | `forgotten` | | how many `transactions` and `findings` are not kept any more |
/// | `export` | `table`, `where`, `format` | null; `export_more` then gives the bytes |
/// | `report` | | `document` of the recording, `title` and `body` of its page as HTML |
///
/// A filter with a time of day that is local needs `local`, the changes of the computer's offset from UTC, in seconds.
pub fn answer(decoding: &mut Decoding, question: &Json) -> Result<Json, String> {
    match question["call"].as_str().unwrap_or_default() {
        "listen" => decoding.listen(question),
        "read" => decoding.read(question),
        "hang_up" => decoding.hang_up(question),
        "check" => check(question),
        "rows" => rows(decoding, question),
        "row" => row(decoding, question),
        "bytes" => annotated(&mut decoding.views, &decoding.functions, question),
        "map" => Ok(registers::map(&decoding.views)),
        "series" => registers::series(&mut decoding.views, question),
        "find" => find(decoding, question),
        "keep_newest" => {
            decoding.keep_newest();
            Ok(Json::Null)
        }
        "forgotten" => {
            let forgotten = decoding.views.forgotten();
            Ok(json!({"transactions": forgotten.transactions, "findings": forgotten.findings}))
        }
        "export" => {
            let view = decoding.views.of(question)?;
            decoding.export = Some(Export::new(view, question["format"].as_str().unwrap_or_default())?);
            Ok(Json::Null)
        }
        "report" => Ok(report(decoding.document())),
        other => Err(format!("no call {other:?}")),
    }
}

fn check(question: &Json) -> Result<Json, String> {
    let text = question["where"].as_str().unwrap_or_default();
    let found = parse(text, table_of(question)?.name(), &|| local_changes(question)).map_err(|error| error.to_string())?;
    Ok(json!({"text": found.text, "notes": found.notes}))
}

fn number(question: &Json, key: &str) -> usize {
    question[key].as_u64().unwrap_or_default() as usize
}

fn rows(decoding: &mut Decoding, question: &Json) -> Result<Json, String> {
    let view = decoding.views.of(question)?;
    let keys = question["columns"].as_array().map(Vec::as_slice).unwrap_or_default();
    let columns = keys.iter().map(|key| view.kind().column(key.as_str().unwrap_or_default()));
    let columns = columns.collect::<Result<Vec<usize>, String>>()?;
    let count = question["count"].as_u64().unwrap_or_default().min(MAX_ROWS) as usize;
    let texts = |(table, row): (&Table, usize)| -> Json {
        columns.iter().map(|&column| Json::from(&*cell_text(&table.cell(row, column)))).collect()
    };
    let rows: Vec<Json> = view.window(number(question, "from"), count).map(texts).collect();
    Ok(json!({"total": view.len(), "rows": rows}))
}

fn row(decoding: &mut Decoding, question: &Json) -> Result<Json, String> {
    let view = decoding.views.of(question)?;
    let kind: TableKind = view.kind();
    let Some((table, row)) = view.window(number(question, "at"), 1).next() else { return Ok(Json::Null) };
    let columns = kind.columns().iter().enumerate();
    let texts = columns.map(|(i, column)| (column.key.clone(), Json::from(&*cell_text(&table.cell(row, i)))));
    Ok(Json::Object(texts.collect()))
}

fn find(decoding: &mut Decoding, question: &Json) -> Result<Json, String> {
    let view = decoding.views.of(question)?;
    let column = view.kind().column(question["column"].as_str().unwrap_or_default())?;
    let value = question["value"].as_str().unwrap_or_default();
    let at = view.window(0, view.len()).position(|(table, row)| cell_text(&table.cell(row, column)) == value);
    Ok(json!({"at": at}))
}
