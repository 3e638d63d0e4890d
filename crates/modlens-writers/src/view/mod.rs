//! Shows rows as lines of text for people, on a terminal or in a file.
//!
//! `tables` chooses the columns, `cells` makes their text, `moments` shows times, `grid` fits everything into the
//! width, `text` makes it safe for a terminal. A line consists of parts with styles; without colours the parts are
//! simply joined.

mod cells;
mod grid;
mod moments;
mod tables;
mod text;

use cells::{ColumnLookup, TransactionValues};
use grid::{CellContent, Grid, GridColumn};
use moments::TimeColumn;

use modlens_protocol::Ns;
use modlens_tables::columns::{RowRef, Table, TableKind};

/// From this terminal width on, columns have two spaces between them, names are longer, and times have microseconds.
const WIDE_COLUMNS: usize = 120;

/// A text and its style.
pub type StyledText = (String, Style);

/// The offset of local time from UTC at a time, both in ns. It does not change within a minute.
pub type Zone = Box<dyn Fn(Ns) -> Ns + Send + Sync>;

/// The style of a part. The terminal chooses its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Plain text.
    Plain,
    /// A column title.
    ColumnHead,
    /// Of minor interest.
    Dim,
    /// Correct.
    Good,
    /// Unusual.
    Odd,
    /// Wrong.
    Bad,
    /// Information.
    Note,
}

impl Style {
    /// Its name; empty for plain text.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::ColumnHead => "head",
            Self::Dim => "dim",
            Self::Good => "good",
            Self::Odd => "odd",
            Self::Bad => "bad",
            Self::Note => "note",
        }
    }
}

/// The notation of addresses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AddressNotation {
    /// As on the wire, from 0, in decimal.
    Wire,
    /// As on the wire, from 0, in hexadecimal.
    Hex,
    /// Modicon notation with five digits: 40001 is wire address 0 of the holding registers.
    Five,
    /// Modicon notation with six digits: 400001 is wire address 0 of the holding registers.
    Six,
}

impl AddressNotation {
    /// The notation with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "wire" => Self::Wire,
            "hex" => Self::Hex,
            "5digit" => Self::Five,
            "6digit" => Self::Six,
            _ => return None,
        })
    }

    /// The title of an address column in this notation.
    fn title(self) -> &'static str {
        match self {
            Self::Wire => "addr from 0",
            Self::Hex => "hex from 0",
            Self::Five => "40001-based",
            Self::Six => "400001-based",
        }
    }

    /// A wire address in this notation; in wire notation if the table is unknown. Five digits suffice up to 9999;
    /// higher addresses are shown with six.
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

/// The times that a table shows. If they are unknown, the position in the file is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeDisplay {
    /// Time of day.
    Clock,
    /// Time since the start.
    Elapsed,
    /// Time since the previous row.
    Delta,
}

/// The appearance of a table.
pub struct TableOptions {
    /// The notation of addresses.
    pub base: AddressNotation,
    /// The times to show.
    pub times: TimeDisplay,
    /// The user's time zone.
    pub zone: Zone,
    /// The width of the terminal in columns.
    pub width: usize,
    /// The names of the buses and their short names, if each row shows its bus.
    pub labels: Option<Vec<(String, String)>>,
}

/// The lines of one table, which may still be growing.
pub struct TableLines {
    grid: Grid,
    moments: TimeColumn,
    started: bool,
}

/// The index of the time column.
const TIME_COLUMN: usize = 1;

impl TableLines {
    /// The lines of a table that begins with these rows, of which there must be at least one.
    pub fn new(kind: TableKind, rows: &[RowRef<'_>], look: TableOptions) -> Self {
        let is_wide = look.width >= WIDE_COLUMNS;
        let mut moments = TimeColumn::new(look.times, kind, &rows[0], if is_wide { 6 } else { 3 }, look.zone);
        let mut columns = tables::columns(kind, look.base, rows, is_wide);
        // The cells of the time column depend on previous rows, unlike those of all other columns.
        let widest = rows.iter().map(|row| text::width(&moments.cell(row))).max().unwrap_or(0);
        let head = moments.head();
        let head = grid::ColumnHead { least: head.least.max(widest), ..head };
        columns.insert(TIME_COLUMN, GridColumn::new(head, |_| (CellContent::Text(String::new()), Style::Dim)));
        if let Some(labels) = look.labels {
            columns.insert(TIME_COLUMN + 1, tables::bus(kind, labels));
        }
        let grid = Grid::new(columns, rows, look.width, if is_wide { "  " } else { " " });
        Self { grid, moments, started: false }
    }

    /// The line of titles.
    pub fn head(&self) -> Vec<StyledText> {
        self.grid.head()
    }

    /// The line of the next row.
    pub fn row(&mut self, row: &RowRef<'_>) -> Vec<StyledText> {
        let time = self.moments.cell(row);
        self.moments.advance(row);
        self.grid.row(row, TIME_COLUMN, time)
    }

    /// Passes on the lines of a range of rows, with the titles before the first row of all, and each date before its
    /// first row.
    pub fn rows(&mut self, table: &Table, range: std::ops::Range<usize>, mut line: impl FnMut(Vec<StyledText>)) {
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

/// Appends a line without styles and without trailing spaces.
pub fn push_plain(parts: &[StyledText], out: &mut String) {
    let start = out.len();
    for (text, _) in parts {
        out.push_str(text);
    }
    out.truncate(start + out[start..].trim_end().len());
    out.push('\n');
}

/// The values of a transaction, as many as fit into `width` columns.
pub fn carried(row: &RowRef<'_>, base: AddressNotation, width: usize) -> String {
    TransactionValues::new(ColumnLookup(TableKind::Transactions)).values(row, base).within(width)
}
