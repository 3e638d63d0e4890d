//! A bus and a day as one flat row: the verdict, the first diagnoses, rates and margins.
//!
//! What somebody with hundreds of taps looks at: `modlens doctor ARCHIVE --to csv` writes these rows, and a tap publishes
//! that of its day.

use serde_json::{Map, Value as Json};

/// Key and meaning, in order; what a recording does not tell is null. Shares are from 0 to 1.
pub const COLUMNS: [(&str, &str); 18] = [
    ("date", "day in UTC, empty where the recording has no date"),
    ("bus", "name of the bus"),
    ("verdict", "healthy, trouble, broken, or unknown"),
    ("diagnosis_1", "the most harmful cause, with the unit where it is one: modlens explain CODE"),
    ("diagnosis_2", "the next one"),
    ("diagnosis_3", "the one after it"),
    ("requests", "requests that tell how the line works"),
    ("requests_per_s", "these, from the first to the last frame"),
    ("failed_share", "share without a valid answer, exceptions left out"),
    ("damaged_share", "share with damage"),
    ("late_share", "share answered after the request had been given up"),
    ("weakest_unit", "the unit that answers the least share of its requests"),
    ("answered_share", "that share"),
    ("slowest_unit", "the unit that leaves the least of the timeout; without one, the slowest"),
    ("response_time_p99_us", "the time that 99 of 100 of its answers keep within"),
    ("timeout_us", "the master's timeout, where it was seen"),
    ("time_reserve", "the share of the timeout that is left after those 99 of 100"),
    ("sentence", "the verdict in words"),
];

/// The row of an item of [`crate::days::Days::rows`].
pub fn bus_day(day: &Json) -> Json {
    let units: &[Json] = day["reserves"].as_array().map_or(&[], Vec::as_slice);
    let sum = |key: &str| units.iter().filter_map(|unit| unit[key].as_u64()).sum::<u64>();
    let requests = day["requests"].as_u64().unwrap_or(0);
    let seconds = day["seconds"].as_f64().filter(|seconds| *seconds != 0.0);
    let weakest = least(units, answered);
    let slowest = least(units, time_left);
    let of = |unit: Option<&Json>, key: &str| unit.map_or(Json::Null, |unit| unit[key].clone());
    let value = |key: &str| match key {
        "diagnosis_1" => nth_diagnosis(day, 0),
        "diagnosis_2" => nth_diagnosis(day, 1),
        "diagnosis_3" => nth_diagnosis(day, 2),
        "requests_per_s" => seconds.map_or(Json::Null, |seconds| rounded(requests as f64 / seconds, 3).into()),
        "failed_share" => share(day["failed"].as_u64().unwrap_or(0), requests),
        "damaged_share" => share(sum("damaged"), requests),
        "late_share" => share(sum("late"), requests),
        "weakest_unit" => of(weakest, "unit"),
        "answered_share" => weakest.and_then(answered).into(),
        "slowest_unit" => of(slowest, "unit"),
        "response_time_p99_us" | "timeout_us" => of(slowest, key),
        "time_reserve" => slowest.and_then(reserve).into(),
        _ => day[key].clone(),
    };
    COLUMNS.iter().map(|(key, _)| ((*key).to_owned(), value(key))).collect::<Map<_, _>>().into()
}

/// A cause in a word or two, if there are so many: `no_bias`, `slow unit 7`.
fn nth_diagnosis(day: &Json, number: usize) -> Json {
    let Some(one) = day["diagnoses"].get(number) else { return Json::Null };
    let code = one["code"].as_str().unwrap_or_default();
    one["unit"].as_u64().map_or_else(|| code.to_owned(), |unit| format!("{code} unit {unit}")).into()
}

fn rounded(value: f64, places: usize) -> f64 {
    format!("{value:.places$}").parse().unwrap_or(value)
}

fn quotient(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| rounded(part as f64 / whole as f64, 5))
}

fn share(part: u64, whole: u64) -> Json {
    quotient(part, whole).into()
}

/// The share of its requests that a unit answers.
fn answered(unit: &Json) -> Option<f64> {
    quotient(unit["answered"].as_u64()?, unit["requests"].as_u64()?)
}

/// The share of the timeout that is left; below 0 where answers come later.
fn reserve(unit: &Json) -> Option<f64> {
    let (p99, timeout) = (unit["response_time_p99_us"].as_f64()?, unit["timeout_us"].as_f64()?);
    (timeout != 0.0).then(|| rounded(1.0 - p99 / timeout, 5))
}

/// An order of units by their margin of time; by their slowness where no timeout is known.
fn time_left(unit: &Json) -> Option<f64> {
    reserve(unit).or_else(|| unit["response_time_p99_us"].as_f64().map(|p99| 1e9 - p99))
}

/// The unit with the least value, among those that have one; the lower number of equals.
fn least(units: &[Json], by: impl Fn(&Json) -> Option<f64>) -> Option<&Json> {
    let known = units.iter().filter_map(|unit| Some((by(unit)?, unit["unit"].as_u64(), unit)));
    known.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map(|found| found.2)
}
