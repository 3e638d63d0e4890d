//! The layout of a table that is printed line by line while it is still growing.
//!
//! The column widths are derived from the first rows and never changed. A number that is wider than its column shifts
//! the rest of its line; a text is cut. So memory does not grow, and a live table does not change its layout.

use crate::view::safe_text::{named, push_fitted, width};
use crate::view::style::{Style, StyledText};
use crate::view::value_list::ValueList;
use modlens_tables::columns::RowRef;

/// A text cut to fewer columns than this is left out, because it would be meaningless.
const MIN_CUT_COLUMNS: usize = 4;

/// The content of a cell.
pub enum CellContent<'a> {
    /// A text.
    Text(String),
    /// A list of values.
    ValueList(ValueList<'a>),
    /// A name, which is cut where there is no room, and its value, which never is.
    Named(String, String),
    /// Texts and lists, each in its own style and separated by spaces; what does not fit is cut.
    Run(Vec<(CellContent<'a>, Style)>),
    /// The time of the row, which `Grid::row` is given because it depends on previous rows.
    Time,
}

impl CellContent<'_> {
    /// The complete text, from which the width of a column is derived.
    fn full_text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::ValueList(values) => values.full_text(),
            Self::Named(name, value) => named(name, " ", value, usize::MAX),
            Self::Run(_) | Self::Time => String::new(),
        }
    }
}

/// The head of a column: its title, its least and greatest width, its alignment, and its share of the free room.
///
/// A column with `max_width` and `room_share` 0 is never cut. Where the terminal is too narrow for all columns, those with
/// a `drop_rank` are left out, the lowest first; 0 is never left out.
#[derive(Clone, Debug)]
pub struct ColumnHead {
    pub title: String,
    pub min_width: usize,
    pub max_width: usize,
    pub room_share: usize,
    pub drop_rank: u8,
    pub is_right_aligned: bool,
}

impl ColumnHead {
    /// A column of left-aligned text, as wide as its widest cell in the first rows.
    pub fn left(title: &str, min_width: usize) -> Self {
        Self { title: title.to_owned(), min_width, max_width: 0, room_share: 0, drop_rank: 0, is_right_aligned: false }
    }

    /// A column of right-aligned numbers.
    pub fn right(title: &str, min_width: usize) -> Self {
        Self { is_right_aligned: true, ..Self::left(title, min_width) }
    }

    /// Limits the width.
    pub fn at_most(self, max_width: usize) -> Self {
        Self { max_width, ..self }
    }

    /// Gives the column a share of the room that is left.
    pub fn sharing(self) -> Self {
        Self { room_share: 1, ..self }
    }

    /// Lets the column be left out where the terminal is too narrow, after those with a lower rank.
    pub fn dropped(self, drop_rank: u8) -> Self {
        Self { drop_rank, ..self }
    }

    /// The width of the column for these cells.
    fn width(&self, cells: impl Iterator<Item = String>) -> usize {
        let min_width = self.min_width.max(width(&self.title));
        if self.room_share > 0 {
            return min_width;
        }
        let widest = cells.map(|cell| width(&cell)).max().unwrap_or(0);
        min_width.max(if self.max_width > 0 { widest.min(self.max_width) } else { widest })
    }
}

/// Makes the cell of a row.
type Read = Box<dyn for<'a> Fn(&RowRef<'a>) -> (CellContent<'a>, Style) + Send + Sync>;

/// A column of a grid: its head, and the function that makes its cells.
pub struct GridColumn {
    head: ColumnHead,
    read: Read,
}

impl GridColumn {
    /// A column with this head, whose cells are made by `read`.
    pub fn new(head: ColumnHead, read: impl for<'a> Fn(&RowRef<'a>) -> (CellContent<'a>, Style) + Send + Sync + 'static) -> Self {
        Self { head, read: Box::new(read) }
    }
}

/// The columns of a table with their widths.
pub struct Grid {
    columns: Vec<GridColumn>,
    column_widths: Vec<usize>,
    gap: &'static str,
}

impl Grid {
    /// Derives the widths from the first rows, for `room` columns of the terminal.
    pub fn new(mut columns: Vec<GridColumn>, rows: &[RowRef<'_>], room: usize, gap: &'static str) -> Self {
        let mut column_widths: Vec<usize> =
            columns.iter().map(|column| column.head.width(rows.iter().map(|row| (column.read)(row).0.full_text()))).collect();
        let mut taken = column_widths.iter().sum::<usize>() + gap.len() * (columns.len() - 1);
        while taken > room {
            let ranks = columns.iter().map(|column| column.head.drop_rank).enumerate();
            let Some((index, _)) = ranks.filter(|&(_, rank)| rank > 0).min_by_key(|&(_, rank)| rank) else { break };
            columns.remove(index);
            taken -= column_widths.remove(index) + gap.len();
        }
        let mut room_left = room.saturating_sub(taken);
        let mut shares: usize = columns.iter().map(|column| column.head.room_share).sum();
        for (column, width) in columns.iter().zip(&mut column_widths) {
            if column.head.room_share > 0 {
                let additional = room_left * column.head.room_share / shares;
                *width += additional;
                room_left -= additional;
                shares -= column.head.room_share;
            }
        }
        Self { columns, column_widths, gap }
    }

    /// The line of titles.
    pub fn head(&self) -> Vec<StyledText> {
        let titles = self.columns.iter().map(|column| (CellContent::Text(column.head.title.clone()), Style::ColumnHead));
        self.line(titles)
    }

    /// The line of a row, whose time is shown as `time`.
    pub fn row(&self, row: &RowRef<'_>, time: &str) -> Vec<StyledText> {
        self.line(self.columns.iter().map(|column| match (column.read)(row) {
            (CellContent::Time, style) => (CellContent::Text(time.to_owned()), style),
            cell => cell,
        }))
    }

    /// The parts of a line.
    fn line<'a>(&self, cells: impl Iterator<Item = (CellContent<'a>, Style)>) -> Vec<StyledText> {
        let mut parts = Vec::with_capacity(2 * self.columns.len() + 4);
        for ((column, &room), (cell, style)) in self.columns.iter().zip(&self.column_widths).zip(cells) {
            if !parts.is_empty() {
                parts.push((self.gap.to_owned(), Style::Plain));
            }
            match cell {
                CellContent::Run(pieces) => push_run(&pieces, room, &mut parts),
                CellContent::ValueList(values) => {
                    parts.push((fit_to_width(values.fitting_text(room), &column.head, room), style));
                }
                CellContent::Named(name, value) => {
                    let mut shown = named(&name, " ", &value, room);
                    shown.extend(std::iter::repeat_n(' ', room.saturating_sub(width(&shown))));
                    parts.push((shown, style));
                }
                CellContent::Time => {}
                CellContent::Text(text) => parts.push((fit_to_width(text, &column.head, room), style)),
            }
        }
        parts
    }
}

/// A text in the width of its column; a number that does not fit is not cut.
fn fit_to_width(text: String, head: &ColumnHead, room: usize) -> String {
    if width(&text) > room && head.room_share == 0 && head.max_width == 0 {
        return text;
    }
    let mut out = String::with_capacity(room.max(text.len()));
    push_fitted(&text, room, head.is_right_aligned, &mut out);
    out
}

/// Appends the blocks with spaces between them, in at most `room` columns; a named value may take more.
fn push_run(pieces: &[(CellContent<'_>, Style)], room: usize, parts: &mut Vec<StyledText>) {
    let mut end = None; // the columns that are used, once there is a block
    for (piece, style) in pieces {
        let start_column = end.map_or(0, |end| end + 1);
        let Some(columns_left) = room.checked_sub(start_column) else { break };
        let text = match piece {
            CellContent::ValueList(values) => values.fitting_text(columns_left),
            CellContent::Text(text) => text.clone(),
            CellContent::Named(name, value) => named(name, " ", value, columns_left),
            CellContent::Run(_) | CellContent::Time => continue,
        };
        let text_width = width(&text);
        let text = match piece {
            // A value is never left out, and no part of it is.
            CellContent::Named(..) => text,
            _ if text_width <= columns_left => text,
            CellContent::Text(_) if columns_left >= MIN_CUT_COLUMNS => {
                let mut cut = String::new();
                push_fitted(&text, columns_left, false, &mut cut);
                cut
            }
            _ => continue,
        };
        if text.is_empty() {
            continue;
        }
        if end.is_some() {
            if let Some(before) = parts.last_mut() {
                before.0.push(' ');
            }
        }
        end = Some(start_column + width(&text));
        parts.push((text, *style));
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn texts(values: &[(&str, usize)]) -> ValueList<'static> {
        ValueList::Texts(values.iter().map(|(text, count)| ((*text).to_owned(), *count)).collect())
    }

    fn run(pieces: Vec<(CellContent<'_>, Style)>, room: usize) -> Vec<StyledText> {
        let mut parts = Vec::new();
        push_run(&pieces, room, &mut parts);
        parts
    }

    #[test]
    fn a_run_keeps_its_styles_and_its_room() {
        let pieces = vec![
            (CellContent::Text("ok".into()), Style::Good),
            (CellContent::Text("retry".into()), Style::Odd),
            (CellContent::Text(String::new()), Style::Bad),
            (CellContent::ValueList(texts(&[("555", 1), ("0", 1), ("100", 1)])), Style::Plain),
        ];
        let found = run(pieces, 17);
        assert_eq!(found, [("ok ".into(), Style::Good), ("retry ".into(), Style::Odd), ("555 … +2".into(), Style::Plain)]);
    }

    proptest! {
        #[test]
        fn a_run_never_takes_more_than_its_room(words in proptest::collection::vec("[abc温]{0,9}", 0..5), room in 0usize..40) {
            let mut pieces: Vec<(CellContent<'_>, Style)> = words.into_iter().map(|word| (CellContent::Text(word), Style::Plain)).collect();
            pieces.push((CellContent::ValueList(texts(&[("1", 1), ("2", 1), ("3", 1)])), Style::Plain));
            let taken: usize = run(pieces, room).iter().map(|part| width(&part.0)).sum();
            prop_assert!(taken <= room);
        }
    }
}
