//! Transactions that are decided become rows.

use crate::check;
use crate::records::{FindingRow, Transaction};
use crate::session::rows::{elapsed, keep_half, note_detail};
use crate::session::Session;
use modlens_protocol::finding::Finding;
use modlens_protocol::status::Status;

impl Session {
    /// What showed only now of frames whose rows are written.
    fn write_notes(&mut self, bus: usize) {
        for note in self.buses[bus].pairing.notes.drain(..) {
            self.stats.finding(note.finding);
            if self.wanted.findings {
                let seen = note.meeting;
                self.batch.findings.push(FindingRow {
                    frame: Some(seen.frame),
                    txn: Some(seen.txn),
                    bus: bus as u32,
                    start: seen.start,
                    elapsed: elapsed(self.origin, seen.start),
                    unit: Some(seen.unit),
                    finding: note.finding,
                    detail: note_detail(&note),
                    origin: seen.origin,
                });
            }
        }
    }

    /// The rows of transactions that are decided, and what is found on them.
    pub(super) fn write_done(&mut self, bus: usize) {
        self.write_notes(bus);
        let mut done = std::mem::take(&mut self.done);
        let told_apart = 2 * self.buses[bus].coarsest();
        for mut exchange in done.drain(..) {
            self.found.clear();
            // Null, never a guess, where the clock cannot tell.
            for time in [&mut exchange.response_time, &mut exchange.waited, &mut exchange.late_response] {
                *time = time.filter(|&ns| ns >= told_apart);
            }
            self.found.append(&mut exchange.told);
            if !exchange.retold {
                check::pair(&self.functions, &exchange, &mut self.found);
            }
            if exchange.findings.contains(&Finding::NoResponse) && !exchange.retold {
                let waited =
                    exchange.waited.map_or(String::new(), |ns| format!("; the next request came after {} ms", ns / 1_000_000));
                self.found.push((Finding::NoResponse, format!("unit {}{waited}", exchange.unit)));
            }
            if let Some(code) = exchange.exception.filter(|_| exchange.findings.contains(&Finding::Exception)) {
                self.found.push((Finding::Exception, format!("exception {code}")));
            }
            let before = self.found.len();
            let points = self.buses[bus].profiles.on(&self.functions, &exchange, &mut self.found);
            if exchange.retold && self.found[before..].iter().all(|(finding, _)| exchange.findings.contains(finding)) {
                self.found.truncate(before);
            }
            let elapsed = elapsed(self.origin, exchange.request.start.or(exchange.response.start));
            let start = exchange.request.start.or(exchange.response.start);
            for (finding, detail) in self.found.drain(..) {
                self.stats.finding(finding);
                if !exchange.findings.contains(&finding) {
                    exchange.findings.push(finding);
                }
                if self.wanted.findings {
                    let frame = Some(exchange.response.frame).filter(|&n| n > 0).or(Some(exchange.request.frame));
                    self.batch.findings.push(FindingRow {
                        frame,
                        txn: Some(exchange.txn),
                        bus: bus as u32,
                        start,
                        elapsed,
                        unit: Some(exchange.unit),
                        finding,
                        detail,
                        origin: exchange.origin,
                    });
                }
            }
            if exchange.sure && matches!(exchange.status, Status::Ok | Status::Exception) {
                self.buses[bus].paired_units[exchange.unit as usize] = true;
            }
            self.stats.transaction(self.buses[bus].counts, &self.functions, &exchange);
            if self.wanted.transactions {
                let row = Transaction {
                    number: exchange.txn,
                    bus: bus as u32,
                    mode: exchange.mode,
                    start,
                    elapsed,
                    unit: exchange.unit,
                    function: exchange.function,
                    status: exchange.status,
                    exception: exchange.exception,
                    response_time: exchange.response_time,
                    waited: exchange.waited,
                    late_response: exchange.late_response,
                    retry_of: exchange.retry_of,
                    late_for: exchange.late_for,
                    gap: exchange.gap,
                    mbap_id: exchange.mbap_id,
                    request: keep_half(&mut self.batch, &exchange.request),
                    response: keep_half(&mut self.batch, &exchange.response),
                    findings: self.batch.keep_codes(&exchange.findings),
                    points,
                    origin: exchange.origin,
                };
                self.held.push(row);
            }
            self.buses[bus].pairing.recycle(exchange);
        }
        self.done = done;
    }
}
