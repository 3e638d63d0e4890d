//! What is known of the value that is looked for.

use serde_json::Value as Json;

/// A value that a display showed.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// The value.
    pub value: f64,
    /// The number of decimal places that were shown.
    pub decimals: i32,
    /// The time and the tolerance of the clock in nanoseconds; `None` if the time is not known.
    pub at: Option<(i64, i64)>,
}

impl Shown {
    /// One unit of the last digit that was shown.
    pub fn unit(&self) -> f64 {
        10f64.powi(-self.decimals)
    }
}

/// How a value moved from one time to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// It went up.
    Up,
    /// It went down.
    Down,
    /// It was the same again.
    Same,
    /// It was another one.
    Changed,
}

impl Change {
    /// All changes with their words.
    pub const ALL: [(Self, &'static str); 4] =
        [(Self::Up, "up"), (Self::Down, "down"), (Self::Same, "same"), (Self::Changed, "changed")];
}

/// A change between two times, in nanoseconds since 1970.
#[derive(Clone, Copy, Debug)]
pub struct Move {
    /// How the value moved.
    pub change: Change,
    /// The first time.
    pub from: i64,
    /// The second time.
    pub to: i64,
}

/// A history of the value from another source.
#[derive(Clone, Debug, Default)]
pub struct History {
    /// Times in nanoseconds since 1970.
    pub times: Vec<i64>,
    /// The value at each time.
    pub values: Vec<f64>,
    /// Whether the zone of the times is known. If not, offsets of up to 14 hours are tried.
    pub has_zone: bool,
}

/// Everything that is known of the value.
#[derive(Clone, Debug, Default)]
pub struct Query {
    /// Values that were shown.
    pub shown: Vec<Shown>,
    /// Changes.
    pub moves: Vec<Move>,
    /// A history.
    pub history: Option<History>,
}

impl Query {
    /// Reads the query from `{"shown": [[value, decimals, at, within]], "moves": [[word, from, to]], "history": {...}}`;
    /// `None` if it has another form.
    pub fn from_json(json: &Json) -> Option<Self> {
        let shown = json["shown"].as_array()?.iter().map(shown).collect::<Option<_>>()?;
        let moves = json["moves"].as_array()?.iter().map(movement).collect::<Option<_>>()?;
        let history = match &json["history"] {
            Json::Null => None,
            given => Some(history(given)?),
        };
        Some(Self { shown, moves, history })
    }
}

fn shown(json: &Json) -> Option<Shown> {
    let at = json[2].as_i64().zip(json[3].as_i64());
    Some(Shown { value: json[0].as_f64()?, decimals: json[1].as_i64()? as i32, at })
}

fn movement(json: &Json) -> Option<Move> {
    let word = json[0].as_str()?;
    let change = Change::ALL.iter().find(|row| row.1 == word)?.0;
    Some(Move { change, from: json[1].as_i64()?, to: json[2].as_i64()? })
}

fn history(json: &Json) -> Option<History> {
    let times = json["times"].as_array()?.iter().map(Json::as_i64).collect::<Option<Vec<_>>>()?;
    let values = json["values"].as_array()?.iter().map(Json::as_f64).collect::<Option<Vec<_>>>()?;
    (times.len() == values.len()).then_some(History { times, values, has_zone: json["has_zone"].as_bool()? })
}
