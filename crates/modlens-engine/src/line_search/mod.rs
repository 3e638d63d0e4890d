//! Finds the settings of a line by listening: what every live tap does where none are given.
//!
//! The only evidence that counts is frames with valid checksums. Which settings are tried next follows from the bytes that
//! wrong settings gave (`rates`). At the right rate the character formats are tried (`character_format`). There is no I/O
//! here: the owner of the port sets it to [`LineSearch::line`] whenever that has changed, and shows what it reads.
//!
//! ```
//! use modlens_engine::line_search::{LineSearch, SearchOptions};
//! let search = LineSearch::new(SearchOptions { marks_errors: true, ..SearchOptions::default() });
//! assert_eq!(search.line().to_string(), "115200-8E1");
//! ```

mod character_format;
mod check;
mod evidence;
mod offline;
mod options;
mod rates;
mod read;
mod trial;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use modlens_protocol::decimal::thousands;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use character_format::{CharacterFormat, FormatSearch, FORMATS};
use evidence::Listener;
use trial::Trial;

pub use check::LineCheck;
pub use evidence::proof_in;
pub use offline::{is_inverted, readings, Reading};
pub use options::SearchOptions;
pub use rates::{is_slower, likely_rates, RATES};
pub use read::SearchRead;

/// The first rate is a high one: a slower line shows its bit time in the bytes received at it.
const FIRST_RATE: u32 = 115_200;
/// Bytes after which a wrong rate may be left; bytes after which a character format is given up.
const MIN_BYTES: usize = 24;
const MAX_BYTES: usize = 48;
/// Another rate must be more likely by this factor before the present one is left.
const MIN_ODDS: f64 = 30.0;
/// What a format that was tried in vain takes from the log odds of its rate.
const FAILED_TRIAL_COST: f64 = 2.0;
/// Bursts after which their ends tell of swapped wires, and the share of them that has to end in 00.
const INVERTED_BURSTS: usize = 6;
const INVERTED_SHARE: f64 = 0.7;
/// A trial that looks like Modbus ASCII may be so many times longer: its frames are.
const TEXT_FACTOR: usize = 3;
/// Fewer bytes than these say nothing about a line.
const MIN_TO_JUDGE: usize = 200;
/// How long settings are tried that prove nothing, where a port drops damaged bytes.
const PATIENCE_NS: Ns = 3_000_000_000;
const MAX_KEPT_BYTES: usize = 1 << 20;
/// A silence that may complete a frame.
const IDLE_NS: Ns = 30_000_000;
/// Bytes that come so soon after a change of the settings may have been received with the old ones: an adapter holds them
/// back for up to 16 ms.
const SETTLE_NS: Ns = 20_000_000;

/// The settings found.
#[derive(Clone, Debug)]
pub struct FoundLine {
    /// The settings.
    pub line: LineSettings,
    /// RTU or ASCII.
    pub mode: Mode,
    /// What they rest on, in words.
    pub evidence: String,
    /// The reads made with them, which are the first of the tap.
    pub reads: Vec<Arc<SearchRead>>,
}

/// A search that goes on until `found` gives something.
pub struct LineSearch {
    options: SearchOptions,
    found: Option<FoundLine>,
    messages: Vec<String>,
    /// The present trial, and a listener for each framing.
    trial: Trial,
    listeners: Vec<Listener>,
    /// The search for the character format, once the rate is known, with what had shown that.
    formats: Option<FormatSearch>,
    evidence: String,
    reads: Vec<Arc<SearchRead>>,
    /// By rate, what was received at it.
    pulses: BTreeMap<u32, rates::PulseLengths>,
    /// Rates and numbers in `FORMATS` that were tried in vain.
    tried: BTreeSet<(u32, usize)>,
    /// Bytes after which a trial is given up.
    limit: usize,
    /// By rate: bursts, and those that ended in 00.
    burst_ends: BTreeMap<u32, (usize, usize)>,
    has_told_of_swap: bool,
    heard: VecDeque<(LineSettings, Arc<SearchRead>)>,
    heard_bytes: usize,
    kept_bytes: usize,
    /// Reads up to here belong to the settings before.
    unsettled: Option<Ns>,
    /// When the present trial began, once it is known.
    begun: Option<Ns>,
}

impl LineSearch {
    /// A search that has heard nothing yet.
    pub fn new(options: SearchOptions) -> Self {
        let line = FORMATS[0].at(FIRST_RATE);
        Self {
            options,
            found: None,
            messages: Vec::new(),
            trial: Trial::new(line),
            listeners: Listener::all(line, options.mode),
            formats: None,
            evidence: String::new(),
            reads: Vec::new(),
            pulses: BTreeMap::new(),
            tried: BTreeSet::new(),
            limit: MAX_BYTES,
            burst_ends: BTreeMap::new(),
            has_told_of_swap: false,
            heard: VecDeque::new(),
            heard_bytes: 0,
            kept_bytes: 0,
            unsettled: None,
            begun: None,
        }
    }

    /// The settings to listen with now.
    pub fn line(&self) -> LineSettings {
        self.found.as_ref().map_or(self.trial.line, |found| found.line)
    }

    /// The settings, once they are known.
    pub fn found(&self) -> Option<&FoundLine> {
        self.found.as_ref()
    }

    /// What was tried and why it was given up, since the last call.
    pub fn take_messages(&mut self) -> Vec<String> {
        std::mem::take(&mut self.messages)
    }

    /// The port was set to [`Self::line`] at this time; what comes right after is not counted.
    pub fn line_was_set(&mut self, now: Ns) {
        self.unsettled = Some(now + SETTLE_NS);
    }

    /// Takes a read that was made with the present settings.
    pub fn feed(&mut self, read: SearchRead) {
        if self.found.is_some() || read.bytes.is_empty() || self.unsettled.is_some_and(|until| read.time <= until) {
            return;
        }
        let read = Arc::new(read);
        self.keep(&read);
        self.trial.add(&read);
        for listener in &mut self.listeners {
            listener.feed(read.line, &read.bytes, Some(read.time));
        }
        if self.formats.is_some() {
            self.reads.push(read);
        }
        self.decide();
    }

    /// Nothing was received until now: a silence may complete a frame.
    pub fn advance(&mut self, now: Ns) {
        let is_idle = self.trial.last.is_some_and(|last| now - last > IDLE_NS);
        if self.found.is_none() && is_idle {
            for listener in &mut self.listeners {
                listener.poll(now);
            }
            self.decide();
        }
        self.lose_patience(now);
    }

    /// Ends a trial that has lasted for too long.
    fn lose_patience(&mut self, now: Ns) {
        let begun = *self.begun.get_or_insert(now);
        if self.found.is_none() && self.formats.is_none() && self.options.drops_damaged && now - begun > PATIENCE_NS {
            self.give_up("nothing was proven in time");
        }
    }

    /// All reads so far, or the newest where they are too many, with the settings of the time.
    pub fn heard(&self) -> impl Iterator<Item = (LineSettings, &SearchRead)> {
        self.heard.iter().map(|(line, read)| (*line, &**read))
    }

    /// What can be said when the search ends without a result.
    pub fn diagnosis(&self) -> String {
        if self.heard_bytes == 0 {
            return "nothing was received: check the wires (A, B, ground), and that a master polls".into();
        }
        let (bursts, to_zero) = self.burst_ends.values().fold((0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let text = format!("no line settings fit the {} bytes received", thousands(self.heard_bytes as u64));
        if bursts >= INVERTED_BURSTS && to_zero as f64 >= INVERTED_SHARE * bursts as f64 {
            return format!("{text}; most bursts end in 00: A and B (D- and D+) may be swapped");
        }
        if self.heard_bytes < MIN_TO_JUDGE {
            return format!("{text}, which are few: listen longer, or give the settings by --line");
        }
        format!(
            "{text}: noise, another protocol, or a rate that was not tried; --line gives settings, and modlens decode --detect \
             tries them on a recording"
        )
    }

    /// Keeps a read for the end of a search without a result; the oldest beyond a bound go.
    fn keep(&mut self, read: &Arc<SearchRead>) {
        self.heard.push_back((self.trial.line, Arc::clone(read)));
        self.heard_bytes += read.bytes.len();
        self.kept_bytes += read.bytes.len();
        while self.kept_bytes > MAX_KEPT_BYTES {
            let Some((_, oldest)) = self.heard.pop_front() else { break };
            self.kept_bytes -= oldest.bytes.len();
        }
    }

    fn begin(&mut self, line: LineSettings) {
        self.trial = Trial::new(line);
        self.listeners = Listener::all(line, self.options.mode);
        self.begun = None;
    }

    /// Evaluates the trial so far: goes on with it, changes the rate, or the character format.
    fn decide(&mut self) {
        let proof = self.listeners.iter().find_map(|listener| Some((listener.mode, listener.proof()?)));
        if let Some(mut formats) = self.formats.take() {
            let is_decided = formats.evaluate(&self.trial, proof.is_some());
            if is_decided {
                self.follow(&formats);
            }
            self.formats = Some(formats);
        } else if let Some((mode, proof)) = proof {
            let formats = FormatSearch::new(&self.trial, mode, self.options);
            self.evidence = format!("{proof} in {} bytes", self.trial.bytes.len());
            self.reads.clone_from(&self.trial.reads);
            self.follow(&formats);
            self.formats = Some(formats);
        } else if self.trial.bytes.len() >= MIN_BYTES {
            self.change_rate();
        }
    }

    /// Begins the next trial of the character format, or ends the search.
    fn follow(&mut self, formats: &FormatSearch) {
        let Some(line) = formats.line else {
            self.begin(formats.candidate);
            return;
        };
        let errors = match formats.error_shares.join(", ") {
            shares if shares.is_empty() => shares,
            shares => format!("; line errors: {shares}"),
        };
        let evidence = format!("{line}, {}: {}{errors}", formats.mode.text(), self.evidence);
        self.found = Some(FoundLine { line, mode: formats.mode, evidence, reads: std::mem::take(&mut self.reads) });
    }

    /// Ends the trial of the present rate and format, or lets it go on. It ends if a rate with a format that is not tried yet is
    /// more likely than the present one by more than `MIN_ODDS`, or else if as many bytes as a trial may take have come
    /// (`limit`, times `TEXT_FACTOR` where they look like text). Only in the second case rate and format count as tried, and
    /// swapped wires are looked for. Which trial is next is decided by `begin_next`, which gets the reason for the user.
    fn change_rate(&mut self) {
        let rate = self.trial.line.baud;
        self.pulses.insert(rate, rates::pulse_lengths(&self.trial.bytes));
        let log_odds = self.log_odds();
        let here = log_odds.iter().find(|one| one.0 == rate).map_or(f64::NEG_INFINITY, |one| one.1);
        let untried =
            log_odds.iter().filter(|one| (0..self.formats_tried()).any(|format| !self.tried.contains(&(one.0, format))));
        // The first of equals, as the most usual rates are first.
        let best = untried.copied().reduce(|best, one| if one.1 > best.1 { one } else { best });
        let limit = self.limit * if self.trial.looks_like_text() { TEXT_FACTOR } else { 1 };
        match best {
            Some((likely, odds)) if odds - here > MIN_ODDS.ln() => self.begin_next(&format!("looks like {likely} baud")),
            _ if self.trial.bytes.len() >= limit => self.give_up("no checksum matches"),
            _ => {}
        }
    }

    /// Counts rate and format as tried, and begins the next trial.
    fn give_up(&mut self, why: &str) {
        if let Some(format) = FORMATS.iter().position(|format| *format == CharacterFormat::of(self.trial.line)) {
            self.tried.insert((self.trial.line.baud, format));
        }
        self.check_swapped_wires();
        self.begin_next(why);
    }

    /// How many of `FORMATS` are tried: the last one is received with that before, unless damaged bytes are missing.
    fn formats_tried(&self) -> usize {
        FORMATS.len() - usize::from(!self.options.drops_damaged)
    }

    /// The log odds of each rate: how usual it is, the pulse lengths seen, and failed trials.
    fn log_odds(&self) -> Vec<(u32, f64)> {
        let of = |&(rate, usual): &(u32, f64)| {
            let failed = (0..self.formats_tried()).filter(|&format| self.tried.contains(&(rate, format))).count();
            let seen = self.pulses.iter().map(|(at, counts)| rates::log_likelihood(counts, f64::from(*at) / f64::from(rate)));
            (rate, usual.ln() - FAILED_TRIAL_COST * failed as f64 + seen.sum::<f64>())
        };
        RATES.iter().map(of).collect()
    }

    fn begin_next(&mut self, why: &str) {
        let trial = &self.trial;
        let zeros = trial.zeros() as f64 / trial.bytes.len().max(1) as f64;
        let marked = if trial.marked_bytes > 0 { format!(", {} with line errors", trial.marked_bytes) } else { String::new() };
        let text = format!("{}: {} bytes, {:.0}% are 00{marked}: {why}", trial.line, trial.bytes.len(), 100.0 * zeros);
        self.messages.push(text);
        let next = self.next_line();
        self.begin(next);
    }

    /// The next settings to try: the most likely rate with a character format that is left. After all have been tried the
    /// search starts again and listens four times as long to each.
    fn next_line(&mut self) -> LineSettings {
        let mut log_odds = self.log_odds();
        log_odds.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (rate, _) in log_odds {
            if let Some(format) = (0..self.formats_tried()).find(|&format| !self.tried.contains(&(rate, format))) {
                return FORMATS[format].at(rate);
            }
        }
        self.tried.clear();
        self.pulses.clear();
        self.limit *= 4;
        self.messages.push("no settings fit so far; trying all of them again for longer".into());
        FORMATS[0].at(FIRST_RATE)
    }

    /// Says that A and B may be swapped: such a line idles at 0, so that bursts end in 00.
    fn check_swapped_wires(&mut self) {
        let (trial, rate) = (&self.trial, self.trial.line.baud);
        let (bursts, to_zero) = self.burst_ends.entry(rate).or_default();
        *bursts += trial.bursts;
        *to_zero += trial.bursts_ending_in_zero;
        let at_rest = *to_zero as f64 >= INVERTED_SHARE * (*bursts).max(INVERTED_BURSTS) as f64;
        let mixed = 2 * trial.zeros() < trial.bytes.len();
        if at_rest && mixed && !self.has_told_of_swap {
            self.has_told_of_swap = true;
            self.messages.push(format!(
                "every burst at {rate} baud ends in a spurious 00: A and B (D- and D+) may be swapped; the other wiring is \
                 worth a try"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A port that takes damaged bytes out may give none at wrong settings: all others are tried, each for some seconds. Where a
    /// port gives what it receives, silence says nothing about its settings.
    #[test]
    fn settings_that_give_no_bytes_are_left_where_a_port_drops_damaged_ones() {
        for (drops_damaged, tried) in [(true, RATES.len() * FORMATS.len()), (false, 1)] {
            let mut search = LineSearch::new(SearchOptions { drops_damaged, ..SearchOptions::default() });
            let mut lines = BTreeSet::new();
            for second in 0..6 * (RATES.len() * FORMATS.len()) as Ns {
                lines.insert(search.line().to_string());
                search.advance(second * 1_000_000_000);
            }
            assert_eq!(lines.len(), tried, "{lines:?}");
        }
    }
}
