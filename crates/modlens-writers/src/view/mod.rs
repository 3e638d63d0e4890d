//! Rows as lines for people: the annotated tables, on a terminal or in a file.
//!
//! `tables` says which columns, `cells` what they say, `moments` when it was, `grid` how all of it fits, `text` that nothing
//! of it moves a cursor. A line is made of parts with styles; who prints without colour joins the parts.

mod cells;
mod grid;
mod moments;
mod tables;
mod text;

use cells::{Carried, Keys};
use grid::{Column, Grid, Shown};
use moments::Moments;

use modlens_protocol::Ns;
use modlens_tables::columns::{RowRef, Table, TableKind};

/// From this width on: two spaces between columns, longer names, microseconds.
const ROOMY: usize = 120;

/// A text and its style.
pub type Part = (String, Style);

/// How far clocks are ahead of UTC at a moment, both in ns; it does not change within a minute.
pub type Zone = Box<dyn Fn(Ns) -> Ns + Send + Sync>;

/// How a part looks; what colours these are is the terminal's business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// As it is.
    Plain,
    /// A title.
    Head,
    /// Of less interest.
    Dim,
    /// As it should be.
    Good,
    /// Worth a look.
    Odd,
    /// Wrong.
    Bad,
    /// Worth knowing.
    Note,
}

impl Style {
    /// Its name; nothing for plain text.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Head => "head",
            Self::Dim => "dim",
            Self::Good => "good",
            Self::Odd => "odd",
            Self::Bad => "bad",
            Self::Note => "note",
        }
    }
}

/// How addresses are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// As on the wire, from 0.
    Wire,
    /// The same in hex.
    Hex,
    /// 40001 is wire address 0 of the holding registers.
    Five,
    /// 400001 is.
    Six,
}

impl Base {
    /// The base of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "wire" => Self::Wire,
            "hex" => Self::Hex,
            "5digit" => Self::Five,
            "6digit" => Self::Six,
            _ => return None,
        })
    }

    /// How the head of a column of addresses names it.
    fn title(self) -> &'static str {
        match self {
            Self::Wire => "addr from 0",
            Self::Hex => "hex from 0",
            Self::Five => "40001-based",
            Self::Six => "400001-based",
        }
    }

    /// A wire address; where the type is unknown, as on the wire. Five digits reach to 9999: what lies above takes six.
    fn address(self, wire: i64, kind: Option<&str>) -> String {
        let digit = match kind {
            Some("coil") => 0,
            Some("discrete_input") => 1,
            Some("input_register") => 3,
            Some("holding_register") => 4,
            _ if self == Self::Hex => 0,
            _ => return wire.to_string(),
        };
        match self {
            Self::Wire => wire.to_string(),
            Self::Hex => format!("0x{wire:04X}"),
            Self::Five if wire < 9999 => format!("{digit}{:04}", wire + 1),
            Self::Five | Self::Six => format!("{digit}{:05}", wire + 1),
        }
    }
}

/// Which times a table shows; where it has none, the place in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Times {
    /// Time of day.
    Clock,
    /// Since the start.
    Elapsed,
    /// Since the row before.
    Delta,
}

/// How a table looks.
pub struct Look {
    /// Addresses.
    pub base: Base,
    /// Times.
    pub times: Times,
    /// Where the reader's clocks are.
    pub zone: Zone,
    /// Columns of the terminal.
    pub width: usize,
    /// Where each row says its bus: the names with their short ones.
    pub labels: Option<Vec<(String, String)>>,
}

/// The lines of one table, while it grows.
pub struct Lines {
    grid: Grid,
    moments: Moments,
    started: bool,
}

/// Which column has the times.
const TIMES_AT: usize = 1;

impl Lines {
    /// For a table that begins with these rows, one at least.
    pub fn new(kind: TableKind, rows: &[RowRef<'_>], look: Look) -> Self {
        let roomy = look.width >= ROOMY;
        let mut moments = Moments::new(look.times, kind, &rows[0], if roomy { 6 } else { 3 }, look.zone);
        let mut columns = tables::columns(kind, look.base, rows, roomy);
        // Its cells depend on the rows before, which no other column's do.
        let widest = rows.iter().map(|row| text::width(&moments.cell(row))).max().unwrap_or(0);
        let head = moments.head();
        let head = grid::Head { least: head.least.max(widest), ..head };
        columns.insert(TIMES_AT, Column::new(head, |_| (Shown::Text(String::new()), Style::Dim)));
        if let Some(labels) = look.labels {
            columns.insert(TIMES_AT + 1, tables::bus(kind, labels));
        }
        let grid = Grid::new(columns, rows, look.width, if roomy { "  " } else { " " });
        Self { grid, moments, started: false }
    }

    /// The line of titles.
    pub fn head(&self) -> Vec<Part> {
        self.grid.head()
    }

    /// The line of the next row.
    pub fn row(&mut self, row: &RowRef<'_>) -> Vec<Part> {
        let time = self.moments.cell(row);
        self.moments.advance(row);
        self.grid.row(row, TIMES_AT, time)
    }

    /// Appends the lines of some rows of a table: the titles in front of the first of all, and each day where it begins.
    pub fn rows(&mut self, table: &Table, range: std::ops::Range<usize>, mut line: impl FnMut(Vec<Part>)) {
        if !self.started && !range.is_empty() {
            self.started = true;
            line(self.head());
        }
        for index in range {
            let row = table.row(index);
            if let Some(day) = self.moments.day(&row) {
                line(vec![(day, Style::Dim)]);
            }
            line(self.row(&row));
        }
    }
}

/// Appends a line without its styles, and without spaces at its end.
pub fn push_plain(parts: &[Part], out: &mut String) {
    let start = out.len();
    for (text, _) in parts {
        out.push_str(text);
    }
    out.truncate(start + out[start..].trim_end().len());
    out.push('\n');
}

/// The values that a transaction carried, as many as fit into so many columns.
pub fn carried(row: &RowRef<'_>, base: Base, width: usize) -> String {
    Carried::new(Keys(TableKind::Transactions)).values(row, base).within(width)
}
