//! How much a table shows, by the width of the terminal.

/// From this terminal width on, columns have two spaces between them, names are longer, and times have microseconds.
const WIDE_COLUMNS: usize = 120;

/// Below this terminal width times have seconds only, and titles are shorter.
const NARROW_COLUMNS: usize = 60;

/// How much a table can show in the width of the terminal.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Room {
    Narrow,
    Usual,
    Wide,
}

impl Room {
    pub(super) fn of(width: usize) -> Self {
        match width {
            ..NARROW_COLUMNS => Self::Narrow,
            WIDE_COLUMNS.. => Self::Wide,
            _ => Self::Usual,
        }
    }

    pub(super) fn is_wide(self) -> bool {
        self == Self::Wide
    }
}
