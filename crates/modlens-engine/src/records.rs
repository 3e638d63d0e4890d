//! Rows as they leave the session: plain structs over one arena of bytes.
//!
//! Columns are not stored: `columns` reads them off the rows on demand.

mod batch;
mod buses;
mod connection;
mod exchange;
mod rows;

pub(crate) use batch::MemoryPool;
pub use batch::{Batch, Part};
pub use buses::{Bus, Buses, Network};
pub use connection::{Connection, End, FirstWait};
pub use exchange::{Exchange, ExchangeFrame, ExchangeRun, ExchangeTiming, OptionalNs, PacketPair, PacketsOfRun, NOT_REFUSED};
pub use modlens_readers::chunk::Side;
pub use rows::{DiagnosisRow, FindingRow, Frame, FrameRef, InnerPauses, Span, Transaction};
