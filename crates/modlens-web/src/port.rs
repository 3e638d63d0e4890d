//! What is known of a port that the page listens to.

use modlens_engine::line_search::LineSearch;
use modlens_protocol::line::LineSettings;

/// The port that is listened to.
pub struct Port {
    pub name: String,
    pub line: Option<LineSettings>,
    /// While its settings are not known.
    pub search: Option<LineSearch>,
    /// The number of its next description in the recording: one for each setting that was decoded with.
    pub next_interface: u32,
}
