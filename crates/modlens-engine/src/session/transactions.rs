//! Emission of transactions: those that are closed become rows, with the findings on them.

use std::sync::Arc;

use crate::findings::{self, words};
use crate::pairing::PendingTransaction;
use crate::records::Transaction;
use crate::session::decoder::Decoder;
use crate::session::rows::{elapsed, store_frame, FindingPlace};
use modlens_profiles::points::PlanInstance;
use modlens_protocol::status::Status;

impl Decoder {
    /// Emits the transactions in `self.done`, all of which are of this bus, and the delayed findings of its pairing.
    /// `self.done` is empty afterwards, and pairing has the buffers back.
    pub(super) fn emit_transactions(&mut self, bus: usize) {
        self.emit_delayed_findings(bus);
        let mut done = std::mem::take(&mut self.done);
        let min_measurable_ns = 2 * self.buses[bus].coarsest_resolution();
        for mut transaction in done.drain(..) {
            // Null rather than a guess, where the clock is too coarse. Times that are read back are kept: their bus has no
            // lines here and thus no step.
            for time in [&mut transaction.response_time, &mut transaction.waited, &mut transaction.late_response] {
                *time = time.filter(|&ns| ns >= min_measurable_ns);
            }
            self.emit_transaction(bus, &mut transaction);
            self.buses[bus].pairing.recycle(transaction);
        }
        self.done = done;
    }

    /// Emits one transaction: its findings are completed and emitted; its unit counts as paired if a response that is not
    /// unconfirmed answered it; it is counted; and it gets a row, if transactions are wanted.
    fn emit_transaction(&mut self, bus: usize, transaction: &mut PendingTransaction) {
        let points = self.find_on_transaction(bus, transaction);
        self.emit_findings(bus, transaction);
        if transaction.confirms_unit && transaction.status != Status::BadRequest {
            self.buses[bus].paired_units[transaction.unit as usize] = true;
        }
        if self.buses[bus].options.bus.network.is_some() {
            self.buses[bus].connection.note_transaction(transaction);
        }
        self.stats.transaction(self.buses[bus].counts, &self.functions, transaction);
        if self.wanted.transactions {
            self.emit_row(bus, transaction, points);
        }
    }

    /// Emits findings that have shown only now, on frames whose rows are already written. They are counted in any case, but
    /// get a row only if findings are wanted. Neither the row of the frame nor that of its transaction is changed.
    fn emit_delayed_findings(&mut self, bus: usize) {
        for delayed in self.buses[bus].pairing.delayed_findings.drain(..) {
            self.stats.finding(delayed.finding);
            if self.wanted.findings {
                let location = delayed.location;
                let place = FindingPlace {
                    frame: Some(location.frame),
                    txn: Some(location.txn),
                    bus,
                    start: location.start,
                    recording_start: self.origin,
                    unit: Some(location.unit),
                    origin: location.origin,
                };
                self.batch.findings.push(place.row(delayed.finding, words::delayed(&delayed)));
            }
        }
    }

    /// Fills `self.found` with the findings on a transaction that get a row now; those on its frames have theirs already.
    /// Gives the profile of its unit as it is after it has learned from this transaction, or `None` if the unit has no
    /// profile.
    ///
    /// `imported_findings`, which only a transaction that is read back has, come first; of those that `findings::transaction`
    /// has, only the exception is added to them. What the profile finds is dropped for such a transaction if the file has all
    /// of it: it would be reported twice. If the profile finds anything new, all of its findings are kept.
    fn find_on_transaction(&mut self, bus: usize, transaction: &mut PendingTransaction) -> Option<Arc<PlanInstance>> {
        self.found.clear();
        self.found.append(&mut transaction.imported_findings);
        findings::transaction::find(&self.functions, transaction, &mut self.found);
        let without_profile = self.found.len();
        let points = self.buses[bus].profiles.learn_from(&self.functions, transaction, &mut self.found);
        let are_known = self.found[without_profile..].iter().all(|(finding, _)| transaction.findings.contains(finding));
        if transaction.is_reimported && are_known {
            self.found.truncate(without_profile);
        }
        points
    }

    /// Takes the findings out of `self.found`: each is counted, is added to those of the transaction unless it is among them,
    /// and gets a row if findings are wanted. The row names the response, or the request where there is no response; its time
    /// is the start of the request, or of the response where the request has no time.
    fn emit_findings(&mut self, bus: usize, transaction: &mut PendingTransaction) {
        let response = Some(transaction.response.number).filter(|_| transaction.response.is_present());
        let place = FindingPlace {
            frame: response.or(Some(transaction.request.number)),
            txn: Some(transaction.txn),
            bus,
            start: transaction.request.start.or(transaction.response.start),
            recording_start: self.origin,
            unit: Some(transaction.unit),
            origin: transaction.origin,
        };
        for (finding, detail) in self.found.drain(..) {
            self.stats.finding(finding);
            if !transaction.findings.contains(&finding) {
                transaction.findings.push(finding);
            }
            if self.wanted.findings {
                self.batch.findings.push(place.row(finding, detail));
            }
        }
    }

    /// Adds the row of a transaction to `held`, from which `take` gives it out: at once in a live session; in a recording
    /// once no older transaction is open, since a file is in the order of the requests.
    ///
    /// `points` is the profile of the unit at this moment. Bytes and findings of the transaction are copied to the batch, so
    /// that its buffers can be used again. The row's time is that of the request, or of the response where the request has
    /// none.
    fn emit_row(&mut self, bus: usize, transaction: &PendingTransaction, points: Option<Arc<PlanInstance>>) {
        let start = transaction.request.start.or(transaction.response.start);
        self.held.push(Transaction {
            number: transaction.txn,
            bus: bus as u32,
            mode: transaction.mode,
            start,
            elapsed: elapsed(self.origin, start),
            unit: transaction.unit,
            function: transaction.function,
            status: transaction.status,
            exception: transaction.exception,
            confidence: transaction.confidence(),
            unconfirmed: transaction.is_unconfirmed(),
            response_time: transaction.response_time,
            waited: transaction.waited,
            late_response: transaction.late_response,
            retry_of: transaction.retry_of,
            late_response_to: transaction.late_response_to,
            gap: transaction.gap,
            mbap_id: transaction.mbap_id,
            request: store_frame(&mut self.batch, &transaction.request),
            response: store_frame(&mut self.batch, &transaction.response),
            findings: self.batch.store_findings(&transaction.findings),
            points,
            origin: transaction.origin,
        });
    }
}
