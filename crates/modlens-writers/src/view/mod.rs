//! Shows rows as lines of text for people, on a terminal or in a file.
//!
//! `table_columns` chooses the columns, `cell_texts` makes their text, `time_column` shows times, `grid` fits everything
//! into the width and `value_list` the values, `safe_text` measures and cuts. A line consists of parts with styles; without
//! colours the parts are simply joined.

mod cell_texts;
mod grid;
mod notation;
mod room;
mod safe_text;
mod style;
mod table_columns;
mod time_column;
mod value_list;

pub use notation::{AddressNotation, TimeDisplay, Zone};
pub use style::{Style, StyledText};

use cell_texts::{ColumnLookup, TransactionValues};
use grid::{CellContent, Grid, GridColumn};
use room::Room;
use time_column::TimeColumn;

use modlens_tables::columns::{RowRef, Table, TableKind};

/// The appearance of a table.
pub struct TableOptions {
    /// The notation of addresses.
    pub addresses: AddressNotation,
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
    time_column: TimeColumn,
    started: bool,
}

/// The index of the time column.
const TIME_COLUMN_INDEX: usize = 1;

/// The time is the last column to be left out.
const TIME_RANK: u8 = u8::MAX;

impl TableLines {
    /// The lines of a table that begins with these rows, of which there must be at least one.
    pub fn new(kind: TableKind, rows: &[RowRef<'_>], options: TableOptions) -> Self {
        let room = Room::of(options.width);
        let mut time_column = TimeColumn::new(options.times, kind, &rows[0], room, options.zone);
        let mut columns = table_columns::columns(kind, options.addresses, rows, room);
        // The cells of the time column depend on previous rows, unlike those of all other columns.
        let widest = rows.iter().map(|row| safe_text::width(&time_column.cell(row))).max().unwrap_or(0);
        let head = time_column.head();
        let head = grid::ColumnHead { min_width: head.min_width.max(widest), ..head };
        columns.insert(TIME_COLUMN_INDEX, GridColumn::new(head.dropped(TIME_RANK), |_| (CellContent::Time, Style::Dim)));
        if let Some(labels) = options.labels {
            columns.insert(TIME_COLUMN_INDEX + 1, table_columns::bus(kind, labels));
        }
        let grid = Grid::new(columns, rows, options.width, if room.is_wide() { "  " } else { " " });
        Self { grid, time_column, started: false }
    }

    /// The line of titles.
    pub fn head(&self) -> Vec<StyledText> {
        self.grid.head()
    }

    /// The line of the next row.
    pub fn row(&mut self, row: &RowRef<'_>) -> Vec<StyledText> {
        let time = self.time_column.cell(row);
        self.time_column.advance(row);
        self.grid.row(row, &time)
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
            if let Some(day) = self.time_column.day(&row) {
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
    TransactionValues::new(ColumnLookup(TableKind::Transactions)).values(row, base).fitting_text(width)
}
