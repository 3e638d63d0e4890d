//! Whether what came as the answer is the request itself: as it was sent, or changed on its way back.

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::framing::Mode;
use modlens_protocol::oddity::is_altered;
use modlens_protocol::status::Status;

/// Fewer bytes of the request are no echo.
const LEAST_CUT: usize = 3;

/// Whether the damaged answer of a row is the request, cut at its end.
pub(super) fn is_echo(batch: &Batch, row: &Transaction) -> bool {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    row.status == Status::BadResponse && answer.len() >= LEAST_CUT && request.starts_with(answer)
}

/// Whether the damaged answer of a row is the request with some of its bits changed.
pub(super) fn is_altered_echo(batch: &Batch, row: &Transaction) -> bool {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    row.status == Status::BadResponse && row.mode == Mode::Rtu && is_altered(request, answer)
}
