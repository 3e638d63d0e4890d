//! Statistics of rows that were emitted before: of those that a user has selected.

use crate::findings::INCOMPLETE;
use crate::pairing::{BufferedFrame, ObservedFrame, PendingTransaction};
use crate::records::{Batch, Frame, FrameRef, Transaction};
use crate::stats::Stats;
use modlens_protocol::framing::Verdict;

impl Stats {
    /// Counts the rows of a batch that has no compact exchanges.
    ///
    /// How silences of t3.5 alone would have delimited the frames is not counted, because rows do not show it.
    pub fn rows(&mut self, batch: &Batch) {
        let Some(functions) = &batch.functions else { return };
        let mut frames = batch.frames.iter().peekable();
        let mut of_next = batch.transactions.iter().skip(1).map(first_frame);
        for row in &batch.transactions {
            // A transaction is over when the next one begins: damage up to there may have been its response.
            let end = of_next.next().unwrap_or(u64::MAX);
            while let Some(frame) = frames.next_if(|frame| frame.number < end) {
                self.frame_row(batch, frame);
            }
            let counts = self.bus_named(&batch.buses[row.bus as usize].name);
            self.transaction(counts, functions, &closed(batch, row));
        }
        frames.for_each(|frame| self.frame_row(batch, frame));
        for row in &batch.findings {
            self.finding(row.finding);
        }
    }

    fn frame_row(&mut self, batch: &Batch, row: &Frame) {
        let counts = self.bus_named(&batch.buses[row.bus as usize].name);
        self.frame(counts, row.mode, &observed(batch, row));
    }
}

/// The number of the request's frame, or of the response's where there is no request.
fn first_frame(row: &Transaction) -> u64 {
    if row.request.frame == 0 {
        row.response.frame
    } else {
        row.request.frame
    }
}

/// The frame of a row, as far as it is counted.
fn observed<'a>(batch: &'a Batch, row: &Frame) -> ObservedFrame<'a> {
    let codes = row.findings.of(&batch.codes);
    ObservedFrame {
        number: row.number,
        wire: row.wire.of(&batch.arena),
        adu: &[],
        verdict: row.verdict,
        direction: row.direction,
        mode: row.mode,
        start: row.start,
        end: row.end,
        clean_start: false,
        gap: row.gap,
        mbap_id: row.mbap_id,
        origin: row.origin,
        unconfirmed: row.unconfirmed,
        confidence: row.confidence,
        // A frame that the recording cuts is the only incomplete one without a finding.
        is_cut: row.verdict == Verdict::Incomplete && !codes.contains(&INCOMPLETE),
        lacks_request: false,
        side: None,
        codes,
    }
}

/// The transaction of a row, as far as it is counted.
fn closed(batch: &Batch, row: &Transaction) -> PendingTransaction {
    let frame = |row: &FrameRef| {
        let mut frame = BufferedFrame::new(row.frame, row.wire.of(&batch.arena), row.pdu.of(&batch.arena), row.start);
        frame.end = row.end;
        frame
    };
    PendingTransaction {
        txn: row.number,
        unit: row.unit,
        function: row.function,
        status: row.status,
        exception: row.exception,
        request: frame(&row.request),
        response: frame(&row.response),
        response_time: row.response_time,
        waited: row.waited,
        late_response: row.late_response,
        retry_of: row.retry_of,
        late_response_to: row.late_response_to,
        ..PendingTransaction::new(row.mode)
    }
}
