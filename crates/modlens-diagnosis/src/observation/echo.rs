//! Whether what came as the answer is the request itself: as it was sent, or changed on its way back.

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::framing::Mode;
use modlens_protocol::oddity::Altered;
use modlens_protocol::status::Status;

/// Fewer bytes of the request are no echo.
const LEAST_CUT: usize = 3;

/// Whether the damaged answer of a row is the request, cut at its end.
pub(super) fn is_echo(batch: &Batch, row: &Transaction) -> bool {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    row.status == Status::BadResponse && answer.len() >= LEAST_CUT && request.starts_with(answer)
}

/// What the damaged answer of a row is, where it is the request with some of its bits changed.
pub(super) fn altered_echo(batch: &Batch, row: &Transaction) -> Option<Altered> {
    let [request, answer] = [&row.request, &row.response].map(|part| part.wire.of(&batch.arena));
    Altered::of(request, answer).filter(|_| row.status == Status::BadResponse && row.mode == Mode::Rtu)
}
