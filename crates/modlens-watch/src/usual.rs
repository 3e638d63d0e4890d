//! What is usual: the usage of a recording, read back from JSON.

use std::collections::BTreeMap;

use serde_json::Value as Json;

use crate::usage::RequestKey;

/// What a baseline records for one register.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsualValues {
    /// How often it changed.
    pub changes: u64,
    /// Its values, where they are few.
    pub few: Vec<i64>,
    /// Lowest and highest.
    pub range: Option<(i64, i64)>,
}

/// What a baseline records for one request.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsualRequest {
    /// How often it was seen.
    pub count: u64,
    /// Ranges of the interval between two, in seconds.
    pub periods: Vec<[f64; 2]>,
    /// How often it ended how.
    pub outcomes: BTreeMap<String, u64>,
    /// Number of response times, and their deciles in seconds.
    pub response_times: (u64, Vec<f64>),
    /// Values by register.
    pub values: Vec<UsualValues>,
}

/// What a baseline records for one bus.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UsualBus {
    /// Its requests.
    pub requests: BTreeMap<RequestKey, UsualRequest>,
    /// How long it was observed, in hours.
    pub hours: Option<f64>,
}

/// A baseline.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Usual {
    /// By the name of the bus.
    pub buses: BTreeMap<String, UsualBus>,
}

impl Usual {
    /// Reads what `Usage::json` wrote. The error names the bus, the number of the request and the key.
    pub fn new(json: &Json) -> Result<Self, String> {
        let mut usual = Self::default();
        for row in list(json, "bus") {
            let name = row["name"].as_str().ok_or("a bus without name")?;
            let mut bus = UsualBus { hours: row["hours"].as_f64(), ..UsualBus::default() };
            for (number, request) in list(row, "request").iter().enumerate() {
                let wrong = |key: &str| format!("bus {name:?}, request {}: {key} is missing or wrong", number + 1);
                let (key, request) = self::request(request).map_err(wrong)?;
                bus.requests.insert(key, request);
            }
            usual.buses.insert(name.to_owned(), bus);
        }
        Ok(usual)
    }
}

fn list<'a>(json: &'a Json, key: &str) -> &'a [Json] {
    json[key].as_array().map(Vec::as_slice).unwrap_or_default()
}

/// The request of a row; the error is the key that is wrong.
fn request(row: &Json) -> Result<(RequestKey, UsualRequest), &'static str> {
    let small = |key: &'static str| row[key].as_u64().and_then(|number| u8::try_from(number).ok()).ok_or(key);
    let number = |key: &'static str| match row.get(key) {
        None | Some(Json::Null) => Ok(None),
        Some(value) => value.as_u64().and_then(|number| u16::try_from(number).ok()).map(Some).ok_or(key),
    };
    let key = RequestKey {
        client: row["client"].as_str().map(str::to_owned),
        unit: small("unit")?,
        function: small("function")?,
        writes: row["writes"].as_bool().unwrap_or(false),
        range: number("address")?.zip(number("quantity")?),
    };
    let pair = |pair: &Json| Some([pair[0].as_f64()?, pair[1].as_f64()?]);
    let seconds = |all: &[Json]| all.iter().map(Json::as_f64).collect::<Option<Vec<f64>>>();
    let outcomes = row["outcomes"].as_object().into_iter().flatten();
    Ok((
        key,
        UsualRequest {
            count: row["count"].as_u64().ok_or("count")?,
            periods: list(row, "period_s").iter().map(pair).collect::<Option<_>>().ok_or("period_s")?,
            outcomes: outcomes.filter_map(|(name, count)| Some((name.clone(), count.as_u64()?))).collect(),
            response_times: (
                row["response_time"]["count"].as_u64().unwrap_or(0),
                seconds(list(&row["response_time"], "deciles_s")).ok_or("response_time")?,
            ),
            values: list(row, "values").iter().map(values).collect::<Option<_>>().ok_or("values")?,
        },
    ))
}

fn values(row: &Json) -> Option<UsualValues> {
    let row = row.as_array()?;
    let changes = row.first()?.as_u64()?;
    if row.last()?.is_string() {
        return Some(UsualValues { changes, few: Vec::new(), range: Some((row.get(1)?.as_i64()?, row.get(2)?.as_i64()?)) });
    }
    let few: Vec<i64> = row[1..].iter().map(Json::as_i64).collect::<Option<_>>()?;
    let range = few.iter().min().copied().zip(few.iter().max().copied());
    Some(UsualValues { changes, few, range })
}
