//! What was seen of a unit, table by table.

use crate::learn::{Learned, ObservedTable};
use modlens_protocol::register_type::Space;

/// What was seen of one table of a unit, and learnt from its values.
#[derive(Clone, Copy, Debug)]
pub struct SeenTable<'a> {
    /// The table.
    pub space: Space,
    /// What was seen.
    pub table: &'a ObservedTable,
    /// What was learnt.
    pub learned: &'a [Learned],
}
