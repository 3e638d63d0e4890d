//! What happened on a bus, and with the requests of one function to one unit, in one bucket of time.

use modlens_engine::records::{Exchange, Frame, Transaction};
use modlens_protocol::framing::Verdict;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use super::series::Bucket;
use super::times::TimeCounts;

/// Everything on the bus.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct BusBucket {
    frames: u64,
    bytes: u64,
    pub busy: Ns,
    damaged: u64,
    noise_bytes: u64,
    /// The longest silence before a frame.
    silence: Ns,
    transactions: u64,
    failed: u64,
    exceptions: u64,
}

impl BusBucket {
    pub fn frame(&mut self, row: &Frame) {
        self.frames += u64::from(row.verdict != Verdict::Noise);
        self.bytes += u64::from(row.wire.length);
        self.damaged += u64::from(matches!(row.verdict, Verdict::BadChecksum | Verdict::Incomplete));
        self.noise_bytes += if row.verdict == Verdict::Noise { u64::from(row.wire.length) } else { 0 };
        self.silence = self.silence.max(row.gap.unwrap_or(0));
    }

    /// Adds the frames of exchanges, without silences.
    pub fn good_frames(&mut self, exchanges: &[Exchange]) {
        self.frames += 2 * exchanges.len() as u64;
        self.bytes += exchanges.iter().map(|one| u64::from(one.lengths[0]) + u64::from(one.lengths[1])).sum::<u64>();
    }

    /// Adds compact exchanges.
    pub fn exchanges(&mut self, exchanges: &[Exchange]) {
        self.transactions += exchanges.len() as u64;
        self.exceptions += exchanges.iter().filter(|one| one.status() == Status::Exception).count() as u64;
    }

    pub fn transaction(&mut self, row: &Transaction) {
        self.transactions += 1;
        self.failed += u64::from(is_failure(row.status));
        self.exceptions += u64::from(row.status == Status::Exception);
    }
}

impl Bucket for BusBucket {
    fn merge(&mut self, later: &Self) {
        self.frames += later.frames;
        self.bytes += later.bytes;
        self.busy += later.busy;
        self.damaged += later.damaged;
        self.noise_bytes += later.noise_bytes;
        self.silence = self.silence.max(later.silence);
        self.transactions += later.transactions;
        self.failed += later.failed;
        self.exceptions += later.exceptions;
    }
}

/// Whether the master did not get what it asked for, other than by a refusal.
pub(super) fn is_failure(status: Status) -> bool {
    matches!(status, Status::NoResponse | Status::BadRequest | Status::BadResponse)
}

/// The columns of buckets. Where a bus has no clock, times are left out, and load where the line settings are not known.
pub(super) fn bus_columns(buckets: &[BusBucket], has_clock: bool, has_load: bool) -> Json {
    let column = |read: fn(&BusBucket) -> u64| -> Json { buckets.iter().map(|bucket| Json::from(read(bucket))).collect() };
    let times = |wanted: bool, read: fn(&BusBucket) -> Ns| -> Json {
        if wanted {
            buckets.iter().map(|bucket| us(read(bucket))).collect()
        } else {
            Json::Null
        }
    };
    json!({
        "frames": column(|one| one.frames), "bytes": column(|one| one.bytes), "busy_us": times(has_load, |one| one.busy),
        "damaged": column(|one| one.damaged), "noise_bytes": column(|one| one.noise_bytes),
        "silence_us": times(has_clock, |one| one.silence),
        "transactions": column(|one| one.transactions), "failed": column(|one| one.failed),
        "exceptions": column(|one| one.exceptions),
    })
}

/// The requests of one function to one unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RequestBucket {
    transactions: u64,
    ok: u64,
    exceptions: u64,
    silent: u64,
    damaged: u64,
    timed: u64,
    least: Ns,
    most: Ns,
    sum: Ns,
    times: TimeCounts,
}

impl RequestBucket {
    /// Adds a compact exchange, without a response time.
    #[inline]
    pub fn exchange(&mut self, status: Status) {
        self.transactions += 1;
        self.ok += u64::from(status == Status::Ok);
        self.exceptions += u64::from(status == Status::Exception);
    }

    pub fn transaction(&mut self, row: &Transaction) {
        self.transactions += 1;
        match row.status {
            Status::Ok => self.ok += 1,
            Status::Exception => self.exceptions += 1,
            Status::NoResponse => self.silent += 1,
            Status::BadRequest | Status::BadResponse => self.damaged += 1,
            _ => {}
        }
        if let Some(time) = row.response_time {
            self.timed(1, time, time, time);
            self.times.add(time);
        }
    }

    /// The 95th percentile of the response times, within 2 %; null without any.
    fn p95(&self) -> Json {
        self.times.percentile(0.95).map_or(Json::Null, |ns| us(ns.clamp(self.least, self.most)))
    }

    fn timed(&mut self, count: u64, least: Ns, most: Ns, sum: Ns) {
        self.least = if self.timed == 0 { least } else { self.least.min(least) };
        self.most = self.most.max(most);
        self.timed += count;
        self.sum += sum;
    }
}

impl Bucket for RequestBucket {
    fn merge(&mut self, later: &Self) {
        self.transactions += later.transactions;
        self.ok += later.ok;
        self.exceptions += later.exceptions;
        self.silent += later.silent;
        self.damaged += later.damaged;
        if later.timed > 0 {
            self.timed(later.timed, later.least, later.most, later.sum);
            self.times.merge(&later.times);
        }
    }
}

/// The columns of buckets; response times are null where there is none.
pub(super) fn request_columns(buckets: &[RequestBucket]) -> Json {
    let column = |read: fn(&RequestBucket) -> u64| -> Json { buckets.iter().map(|bucket| Json::from(read(bucket))).collect() };
    let times = |read: fn(&RequestBucket) -> Ns| -> Json {
        buckets.iter().map(|bucket| if bucket.timed == 0 { Json::Null } else { us(read(bucket)) }).collect()
    };
    let has_times = buckets.iter().any(|bucket| bucket.timed > 0);
    let response_time = has_times.then(|| {
        json!({
            "count": column(|one| one.timed), "min_us": times(|one| one.least), "max_us": times(|one| one.most),
            "mean_us": times(|one| one.sum / one.timed as i64), "p95_us": p95_column(buckets),
        })
    });
    json!({
        "transactions": column(|one| one.transactions), "ok": column(|one| one.ok), "exceptions": column(|one| one.exceptions),
        "silent": column(|one| one.silent), "damaged": column(|one| one.damaged), "response_time": response_time,
    })
}

/// The 95th percentiles of the response times, null where there is none.
pub(super) fn p95_column(buckets: &[RequestBucket]) -> Json {
    buckets.iter().map(RequestBucket::p95).collect()
}

/// Microseconds; whole ones where nothing is after the point.
pub(super) fn us(ns: Ns) -> Json {
    if ns % 1000 == 0 {
        (ns / 1000).into()
    } else {
        (ns as f64 / 1000.0).into()
    }
}
