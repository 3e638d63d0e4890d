//! Registers: profiles that name them, their map, and the time series of one.

use std::sync::Arc;

use modlens_profiles::points::Plan;
use modlens_profiles::profile::{Mistake, Profile, ProfileFormat};
use modlens_tables::columns::{Cell, Table};
use modlens_tables::latest_values::LatestValues;
use serde_json::{json, Value as Json};

use crate::view::Views;

/// The plan of a profile: `text` in the format `form` (toml, yaml or csv). The message lists what is wrong with it.
pub(crate) fn plan(profile: &Json) -> Result<Arc<Plan>, String> {
    let form = profile["form"].as_str().unwrap_or("toml");
    let format = ProfileFormat::from_word(form).ok_or_else(|| format!("profiles in {form:?} are not read here"))?;
    let parsed = Profile::parse(profile["text"].as_str().unwrap_or_default(), format);
    let core = parsed.map_err(|mistakes| mistakes.iter().map(text).collect::<Vec<_>>().join("; "))?;
    Ok(Arc::new(Plan::new(core)))
}

/// Null, if it is a profile without mistakes.
pub fn check_profile(profile: &Json) -> Result<Json, String> {
    plan(profile).map(|_| Json::Null)
}

fn text(mistake: &Mistake) -> String {
    let line = (mistake.line > 0).then(|| format!("line {}", mistake.line));
    let key = Some(mistake.key.clone()).filter(|key| !key.is_empty());
    let place = [line, key].into_iter().flatten().collect::<Vec<_>>().join(", ");
    let hint = mistake.hint.as_ref().map_or_else(String::new, |hint| format!(" (did you mean {hint}?)"));
    format!("{place}: {}{hint}", mistake.message)
}

/// The last value of every register, as `modlens map --json` has them.
pub(crate) fn map(views: &Views) -> Json {
    let mut found = LatestValues::default();
    for batch in views.batches() {
        found.add(batch);
    }
    found.json(0, usize::MAX)
}

/// The values of the rows of a view of the table `readings` over time, in at most `most` steps: each the time in µs of its
/// first value (its number where times are not known), the lowest and the highest value.
pub(crate) fn series(views: &mut Views, question: &Json) -> Result<Json, String> {
    let view = views.of(question)?;
    let (time, value) = (view.kind().column("elapsed_us")?, view.kind().column("value")?);
    let most = question["most"].as_u64().unwrap_or(1000).max(1) as usize;
    let rows: Vec<(&Table, usize)> = view.window(0, view.len()).collect();
    let step = |(number, rows): (usize, &[(&Table, usize)])| {
        let (table, row) = rows[0];
        let begin = match table.cell(row, time) {
            Cell::Us(ns) => ns as f64 / 1000.0,
            _ => number as f64,
        };
        let values = rows.iter().filter_map(|&(table, row)| figure(&table.cell(row, value)));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), one| (low.min(one), high.max(one)));
        (low <= high).then(|| json!([begin, low, high]))
    };
    let size = rows.len().div_ceil(most).max(1);
    let steps: Vec<Json> = rows.chunks(size).enumerate().filter_map(step).collect();
    Ok(json!({"total": rows.len(), "steps": steps}))
}

fn figure(cell: &Cell<'_>) -> Option<f64> {
    match cell {
        Cell::Int(number) => Some(*number as f64),
        Cell::Float(number) => Some(*number),
        Cell::Value(value) => value.number(),
        _ => None,
    }
}
