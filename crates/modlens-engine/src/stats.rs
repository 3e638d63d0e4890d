//! Statistics of a session: counters by bus, unit and function. Their memory is bounded, whatever the size of the recording.

mod duration_json;
mod request_indices;
mod requests;
mod rows;

use std::collections::BTreeMap;

use serde_json::{json, Value as Json};

use crate::durations::Durations;
use crate::findings::REFUSED;
use crate::pairing::{ObservedFrame, PendingTransaction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

pub(crate) use requests::RequestKey;
use requests::RequestTable;

/// The transactions of one function with one unit.
#[derive(Clone, Debug, Default)]
struct FunctionCounts {
    function: u8,
    /// By status, in the order of `Status::ALL`.
    statuses: [u64; 8],
    retries: u64,
    /// By exception code.
    exceptions: BTreeMap<u8, u64>,
    response_times: Durations,
}

/// The transactions with one unit, by function.
#[derive(Clone, Debug, Default)]
struct UnitCounts {
    unit: u8,
    functions: Vec<FunctionCounts>,
    /// For each function code, its index in `functions` plus one; 0 where it has not appeared.
    indices: Vec<u8>,
}

/// The counters of one bus.
#[derive(Clone, Debug, Default)]
struct BusCounts {
    name: String,
    mode: Option<Mode>,
    /// By verdict, in the order of `Verdict::ALL`.
    frames: [u64; 5],
    bytes: [u64; 5],
    /// Incomplete frames that the beginning or the end of a recording cuts.
    cut: u64,
    /// For each unit number, its index in `units` plus one; 0 where it has not appeared, empty before the first transaction.
    unit_indices: Vec<u16>,
    units: Vec<UnitCounts>,
    silence: Option<SilenceComparison>,
    requests: RequestTable,
    /// Sum of the durations of all frames.
    busy_ns: Ns,
    first: Option<Ns>,
    last: Option<Ns>,
}

/// How often a receiver that delimits frames by silences of t3.5 alone would have got other frames.
#[derive(Clone, Copy, Debug, Default)]
struct SilenceComparison {
    t35_ns: Ns,
    frames: u64,
    /// Frames that it would have delimited otherwise.
    otherwise: u64,
    /// The last frame was one that it would have delimited in the same way, provided that a silence follows.
    agrees_so_far: bool,
}

/// Where the counters of a request are: they stay there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RequestPlace {
    request: u16,
    unit: u8,
    function: u8,
}

/// The counters of one bus, for exchanges of which the place of the request is known.
pub(crate) struct ExchangeCounts<'a> {
    bus: &'a mut BusCounts,
}

impl ExchangeCounts<'_> {
    /// Counts an exchange with the request at this place, as `Stats::record_exchange` does, but for what only the last one leaves:
    /// see `note_last`.
    #[inline]
    pub(crate) fn count(&mut self, at: RequestPlace) {
        self.bus.requests.count_at(usize::from(at.request), None, None);
        self.bus.answered_function(at);
    }

    /// The same of what `Stats::count_exchange` counts, where both frames have times and took none.
    #[inline]
    pub(crate) fn count_timed(&mut self, at: RequestPlace, [asked, answered]: [Ns; 2], response_time: Option<Ns>) {
        self.bus.requests.count_at(usize::from(at.request), Some(asked), Some(answered - asked));
        let function = self.bus.answered_function(at);
        if let Some(time) = response_time {
            function.response_times.add(time);
        }
    }

    /// Counts an exchange with this request. Gives the place of its counters; `None` if there is no room for the request.
    #[inline]
    pub(crate) fn count_request(&mut self, key: RequestKey) -> Option<RequestPlace> {
        let request = self.bus.requests.find_or_add(key);
        let (unit, function) = self.bus.function_place(key.unit(), key.function());
        self.bus.units[unit].functions[function].statuses[Status::Ok as usize] += 1;
        let request = request?;
        self.bus.requests.count_at(request, None, None);
        Some(RequestPlace { request: request as u16, unit: unit as u8, function: function as u8 })
    }

    /// Notes the last exchange counted.
    #[inline]
    pub(crate) fn note_last(self, key: RequestKey) {
        self.bus.requests.note_answered(key);
    }
}

/// Statistics of a session.
#[derive(Clone, Debug, Default)]
pub struct Stats {
    buses: Vec<BusCounts>,
    /// By finding, in the order of `Finding::ALL`.
    findings: Vec<u64>,
}

impl Stats {
    /// Adds a bus; gives its index here.
    pub fn add_bus(&mut self, name: &str) -> usize {
        self.buses.push(BusCounts { name: name.into(), ..BusCounts::default() });
        self.buses.len() - 1
    }

    /// The index of the bus of this name, which is added if it is new.
    pub fn bus_named(&mut self, name: &str) -> usize {
        self.buses.iter().position(|bus| bus.name == name).unwrap_or_else(|| self.add_bus(name))
    }

    /// Renames a bus.
    pub fn rename_bus(&mut self, bus: usize, name: &str) {
        self.buses[bus].name = name.into();
    }

    /// Counts a frame or noise, on the bus of this index here: its verdict, its bytes and the time that it took.
    pub fn frame(&mut self, bus: usize, mode: Mode, frame: &ObservedFrame<'_>) {
        let counts = &mut self.buses[bus];
        counts.mode = Some(mode);
        counts.frames[frame.verdict as usize] += 1;
        counts.bytes[frame.verdict as usize] += frame.wire.len() as u64;
        counts.cut += u64::from(frame.is_cut);
        if !frame.verdict.is_good() && !frame.is_cut {
            counts.requests.note_damaged_frame(frame.number);
        }
        counts.add_bus_time(frame.start.zip(frame.end));
    }

    /// Counts whether silences of `t35_ns` alone would have delimited this good frame in the same way: whether there is one
    /// `before` it, none `inside` it, and one before the next frame or noise. The last of these shows only with the next call,
    /// which then takes the frame back; the last frame of all needs none. A damaged frame or noise is not counted itself.
    pub fn silence(&mut self, bus: usize, t35_ns: Ns, frame: &ObservedFrame<'_>, before: bool, inside: bool) {
        let counts = self.buses[bus].silence.get_or_insert(SilenceComparison { t35_ns, ..SilenceComparison::default() });
        // Without a silence here, the frame before would not have ended where it did.
        counts.otherwise += u64::from(counts.agrees_so_far && !before);
        let good = frame.verdict.is_good();
        counts.agrees_so_far = good && before && !inside;
        counts.frames += u64::from(good);
        counts.otherwise += u64::from(good && !counts.agrees_so_far);
    }

    /// Counts a closed transaction, on the bus of this index here: by unit and function its status, whether it is a retry, its
    /// exception and its response time; and its request in the table of requests.
    pub fn transaction(&mut self, bus: usize, functions: &Functions, transaction: &PendingTransaction) {
        self.buses[bus].requests.record_transaction(functions, transaction);
        let counts = self.buses[bus].function(transaction.unit, transaction.function);
        counts.statuses[transaction.status as usize] += 1;
        counts.retries += u64::from(transaction.retry_of.is_some());
        if let Some(code) = transaction.exception {
            *counts.exceptions.entry(code).or_default() += 1;
        }
        if let Some(time) = transaction.response_time {
            counts.response_times.add(time);
        }
    }

    /// Counts the frames of a run of the fast path: requests with their responses, all of them good, and their bytes.
    pub(crate) fn record_batch(&mut self, bus: usize, mode: Mode, exchanges: u64, bytes: u64) {
        let counts = &mut self.buses[bus];
        counts.mode = Some(mode);
        counts.frames[Verdict::Ok as usize] += 2 * exchanges;
        counts.bytes[Verdict::Ok as usize] += bytes;
    }

    /// Counts one transaction of the fast path, which has status `ok` and is no retry. `known`: where its counters are, if that
    /// was asked before. `spans`: start and end of the request and of the response, where there is a clock. The frames
    /// themselves are counted by `record_batch`.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As a call, a third of its time goes to passing the arguments.
    pub(crate) fn record_exchange(
        &mut self,
        bus: usize,
        request: (RequestKey, Option<RequestPlace>),
        spans: [Option<(Ns, Ns)>; 2],
        response_time: Option<Ns>,
    ) {
        for span in spans {
            self.buses[bus].add_bus_time(span);
        }
        let start = spans[0].map(|(start, _)| start);
        let taken = spans[0].zip(spans[1]).map(|(request, response)| response.1 - request.0);
        self.count_exchange(bus, request, (start, taken), response_time);
    }

    /// The same without the times of its frames, which are those of its start and of its end, as long as it has `taken`.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    pub(crate) fn count_exchange(
        &mut self,
        bus: usize,
        (key, known): (RequestKey, Option<RequestPlace>),
        (start, taken): (Option<Ns>, Option<Ns>),
        response_time: Option<Ns>,
    ) {
        let counts = &mut self.buses[bus];
        let function = if let Some(at) = known {
            counts.requests.record_exchange_at(usize::from(at.request), key, start, taken);
            &mut counts.units[usize::from(at.unit)].functions[usize::from(at.function)]
        } else {
            counts.requests.record_exchange(key, start, taken);
            counts.function(key.unit(), key.function())
        };
        function.statuses[Status::Ok as usize] += 1;
        if let Some(time) = response_time {
            function.response_times.add(time);
        }
    }

    /// Where the counters of a request are, on the bus of this index here; `None` if there is no room for the request.
    pub(crate) fn place_of(&mut self, bus: usize, key: RequestKey) -> Option<RequestPlace> {
        let counts = &mut self.buses[bus];
        let request = counts.requests.find_or_add(key)?;
        let (unit, function) = counts.function_place(key.unit(), key.function());
        Some(RequestPlace { request: request as u16, unit: unit as u8, function: function as u8 })
    }

    /// The counters of exchanges on the bus of this index here.
    #[inline]
    pub(crate) fn exchange_counts(&mut self, bus: usize) -> ExchangeCounts<'_> {
        ExchangeCounts { bus: &mut self.buses[bus] }
    }

    /// Counts an exchange of the fast path that was refused, and its finding. `times`: those of request and response, each of
    /// which took none, where there is a clock.
    pub(crate) fn record_refusal(
        &mut self,
        bus: usize,
        (key, exception): (RequestKey, u8),
        times: Option<[Ns; 2]>,
        response_time: Option<Ns>,
    ) {
        let counts = &mut self.buses[bus];
        counts.requests.record_refusal(key, times);
        let function = counts.function(key.unit(), key.function());
        function.statuses[Status::Exception as usize] += 1;
        *function.exceptions.entry(exception).or_default() += 1;
        if let Some(time) = response_time {
            function.response_times.add(time);
        }
        self.finding(REFUSED);
    }

    /// Notes the times of a run of the fast path whose frames took none: the first and the last one.
    pub(crate) fn record_run_times(&mut self, bus: usize, first: Ns, last: Ns) {
        self.buses[bus].add_bus_time(Some((first, first)));
        self.buses[bus].add_bus_time(Some((last, last)));
    }

    /// How many transactions with a unit were counted on the bus of this index here, and how many of them with a response.
    fn counts_of(&self, bus: usize, unit: u8) -> (u64, u64) {
        let functions = self.buses[bus].units.get(usize::from(unit)).map_or(&[][..], |counts| &counts.functions);
        let sum = |count: &dyn Fn(&FunctionCounts) -> u64| functions.iter().map(count).sum::<u64>();
        let responses = [Status::Ok, Status::Exception, Status::BadResponse];
        let with_response = |counts: &FunctionCounts| responses.iter().map(|&status| counts.statuses[status as usize]).sum();
        (sum(&|counts| counts.statuses.iter().sum()), sum(&with_response))
    }

    /// How many transactions with a unit were counted on a bus.
    pub(crate) fn transactions_of(&self, bus: usize, unit: u8) -> u64 {
        self.counts_of(bus, unit).0
    }

    /// How many transactions with a unit and its response, sound or damaged, were counted on a bus.
    pub(crate) fn responses_of(&self, bus: usize, unit: u8) -> u64 {
        self.counts_of(bus, unit).1
    }

    /// How many bytes of a bus belong to valid frames, and how many there are.
    pub(crate) fn valid_bytes_of(&self, bus: usize) -> (u64, u64) {
        let bytes = &self.buses[bus].bytes;
        let valid = bytes[Verdict::Ok as usize] + bytes[Verdict::NoChecksum as usize];
        (valid, bytes.iter().sum())
    }

    /// How long the recording of a bus lasts, from the start of its first frame to the end of its last one.
    pub(crate) fn duration_of(&self, bus: usize) -> Option<Ns> {
        let bus = &self.buses[bus];
        Some(bus.last? - bus.first?)
    }

    /// How many valid frames a bus has.
    pub(crate) fn valid_frames_of(&self, bus: usize) -> u64 {
        self.buses[bus].frames[Verdict::Ok as usize]
    }

    /// How many bytes of a bus belong to no valid frame.
    pub(crate) fn damaged_bytes_of(&self, bus: usize) -> u64 {
        let bytes = &self.buses[bus].bytes;
        bytes.iter().sum::<u64>() - bytes[Verdict::Ok as usize]
    }

    /// How many requests on a bus were answered, with data or an exception.
    pub(crate) fn answered_on(&self, bus: usize) -> u64 {
        let functions = self.buses[bus].units.iter().flat_map(|unit| &unit.functions);
        functions.map(|counts| counts.statuses[Status::Ok as usize] + counts.statuses[Status::Exception as usize]).sum()
    }

    /// How often a finding was made.
    pub(crate) fn findings_of(&self, finding: Finding) -> u64 {
        self.findings.get(finding as usize).copied().unwrap_or(0)
    }

    /// Counts a finding.
    pub fn finding(&mut self, finding: Finding) {
        self.findings.resize(Finding::ALL.len(), 0);
        self.findings[finding as usize] += 1;
    }

    /// All counters as JSON; analyzer/views/stats.py documents the keys.
    pub fn json(&self, functions: &Functions) -> Json {
        let mut statuses: BTreeMap<&str, u64> = BTreeMap::new();
        let buses: Vec<Json> = self.buses.iter().map(|bus| bus.json(&mut statuses, functions)).collect();
        let counted = Finding::ALL.iter().zip(&self.findings).filter(|(_, &count)| count > 0);
        let findings: BTreeMap<&str, u64> = counted.map(|(finding, &count)| (finding.doc().code, count)).collect();
        json!({"transactions": statuses, "findings": findings, "buses": buses})
    }
}

impl BusCounts {
    /// Adds the time from start to end in which a frame occupied the bus; nothing without a clock. The start of the first
    /// such frame and the end of the last one bound the duration of the recording.
    #[inline]
    fn add_bus_time(&mut self, span: Option<(Ns, Ns)>) {
        if let Some((start, end)) = span {
            self.busy_ns += (end - start).max(0);
            self.first.get_or_insert(start);
            self.last = Some(end);
        }
    }

    /// Counts that the request at this place was answered; the counters of its function.
    #[inline]
    fn answered_function(&mut self, at: RequestPlace) -> &mut FunctionCounts {
        let function = &mut self.units[usize::from(at.unit)].functions[usize::from(at.function)];
        function.statuses[Status::Ok as usize] += 1;
        function
    }

    /// The counters of a function of a unit, which are added if they are new.
    #[inline]
    fn function(&mut self, unit: u8, function: u8) -> &mut FunctionCounts {
        let (unit, function) = self.function_place(unit, function);
        &mut self.units[unit].functions[function]
    }

    /// The indices of a unit and of a function of it, which are added if they are new.
    #[inline]
    fn function_place(&mut self, unit: u8, function: u8) -> (usize, usize) {
        let at = self.unit_indices.get(usize::from(unit)).map_or(0, |&index| usize::from(index));
        match self.units.get(at.wrapping_sub(1)).and_then(|unit| unit.indices.get(usize::from(function))) {
            Some(&index @ 1..) => (at - 1, usize::from(index) - 1),
            _ => self.add_function(unit, function),
        }
    }

    /// Adds a function of a unit, which is not there yet, with its counters at 0.
    #[cold]
    fn add_function(&mut self, unit: u8, function: u8) -> (usize, usize) {
        self.unit_indices.resize(256, 0);
        let index = &mut self.unit_indices[usize::from(unit)];
        if *index == 0 {
            self.units.push(UnitCounts { unit, ..UnitCounts::default() });
            // There are at most 256 units.
            *index = self.units.len() as u16;
        }
        let unit = usize::from(*index) - 1;
        let UnitCounts { functions, indices, .. } = &mut self.units[unit];
        indices.resize(256, 0);
        functions.push(FunctionCounts { function, ..FunctionCounts::default() });
        // There are at most 128 functions, since their codes have seven bits.
        indices[usize::from(function)] = functions.len() as u8;
        (unit, functions.len() - 1)
    }

    /// Unit number and counters of each function, sorted by unit and function.
    fn functions(&self) -> impl Iterator<Item = (usize, &FunctionCounts)> {
        let mut units: Vec<&UnitCounts> = self.units.iter().collect();
        units.sort_by_key(|counts| counts.unit);
        units.into_iter().flat_map(|counts| {
            let mut functions: Vec<&FunctionCounts> = counts.functions.iter().collect();
            functions.sort_by_key(|counts| counts.function);
            functions.into_iter().map(move |found| (usize::from(counts.unit), found))
        })
    }

    /// The counters of the bus; its statuses are added to `total`. Durations and utilization are null where no frame has a
    /// time.
    fn json(&self, total: &mut BTreeMap<&str, u64>, functions: &Functions) -> Json {
        let units: Vec<Json> = self.functions().map(|(unit, counts)| counts.json(unit, total)).collect();
        let span = self.first.zip(self.last).map(|(first, last)| last - first).filter(|&span| span > 0);
        json!({
            "bus": self.name, "mode": self.mode.map(Mode::text),
            "frames": by_verdict(&self.frames), "bytes": by_verdict(&self.bytes), "cut": self.cut,
            "duration_us": span.map(|ns| ns as f64 / 1000.0), "busy_us": span.map(|_| self.busy_ns as f64 / 1000.0),
            "silence": self.silence.map(SilenceComparison::json),
            "utilization": span.map(|span| self.busy_ns as f64 / span as f64), "units": units,
            "cycle": self.requests.cycle(), "polls": self.requests.polls(functions), "timeouts": self.requests.timeouts(functions),
        })
    }
}

impl FunctionCounts {
    /// The counters of this function of a unit; statuses that do not appear are left out. Its statuses are added to `total`.
    fn json(&self, unit: usize, total: &mut BTreeMap<&str, u64>) -> Json {
        let counts = Status::ALL.iter().map(|status| (status.text(), self.statuses[*status as usize]));
        let statuses: BTreeMap<&str, u64> = counts.filter(|(_, count)| *count > 0).collect();
        for (status, count) in &statuses {
            *total.entry(status).or_default() += count;
        }
        let exceptions: BTreeMap<String, u64> = self.exceptions.iter().map(|(code, &count)| (code.to_string(), count)).collect();
        json!({
            "unit": unit, "function": self.function, "transactions": self.statuses.iter().sum::<u64>(), "statuses": statuses,
            "retries": self.retries, "exceptions": exceptions, "response_time": duration_json::with_buckets(&self.response_times),
        })
    }
}

impl SilenceComparison {
    fn json(self) -> Json {
        json!({
            "t35_us": self.t35_ns as f64 / 1000.0, "frames": self.frames, "delimited_differently": self.otherwise,
        })
    }
}

/// One counter for each verdict, by its name.
fn by_verdict(counts: &[u64; 5]) -> Json {
    let named = Verdict::ALL.iter().map(|verdict| (verdict.text().to_string(), Json::from(counts[*verdict as usize])));
    named.collect::<serde_json::Map<_, _>>().into()
}
