//! Decodes the samples of logic analyzers to the characters of serial lines.
//!
//! `edges` finds the level changes in binary samples and `level_table` those in exported text; `autobaud` finds the settings
//! of one channel, `decide` here takes the one or two channels with most bytes in valid frames; `uart` decodes level
//! changes to characters. Edges are kept in memory
//! only until the settings are decided.

mod autobaud;
mod edges;
mod level_table;
mod uart;

pub use autobaud::ChannelSettings;
pub use edges::{Edge, EdgeDetector, CHANNELS};
pub use level_table::{is_table, LevelTable};
pub use uart::Character;

use autobaud::detect_settings;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use uart::UartReceiver;

/// The settings are decided once a channel has so many edges.
const DECISION_EDGES: usize = 20_000;

/// A channel with fewer edges carries no traffic.
const MIN_EDGES: usize = 20;

/// The most lines of a bus: one wire, or one wire per direction.
pub const MAX_LINES: usize = 2;

/// What the operator and the recording state about the channels.
#[derive(Clone, Debug, Default)]
pub struct Wiring {
    /// Samples per second.
    pub rate: f64,
    /// Bytes per sample. 0 stands for rows of text with a time in seconds and a level per channel, whose rate is 1e9.
    pub unit: usize,
    /// The channels to decode; `None` for all of them.
    pub channels: Option<Vec<usize>>,
    /// The line settings, where they are known.
    pub line: Option<LineSettings>,
    /// Whether the idle level is low, where that is known.
    pub inverted: Option<bool>,
}

/// A channel that was detected to be a serial line.
#[derive(Clone, Copy, Debug)]
pub struct DetectedLine {
    /// Number of the channel.
    pub channel: usize,
    /// The detected settings.
    pub settings: ChannelSettings,
}

/// A decoded character and its line, 0 or 1.
pub type LineCharacter = (usize, Character);

/// A channel of the analyzer.
#[derive(Debug, Default)]
struct Channel {
    /// Edges that the receiver has not seen yet.
    edges: Vec<Edge>,
    /// Number of the line and the receiver, once the channel is known to be a serial line.
    uart: Option<(usize, UartReceiver)>,
}

/// Decodes the samples of a logic analyzer, which arrive in blocks.
#[derive(Debug)]
pub struct Analyzer {
    wiring: Wiring,
    edges: EdgeDetector,
    /// The parser of exported text, which takes the place of `edges` for such files.
    table: Option<LevelTable>,
    channels: Vec<Channel>,
    /// The detected lines, once they are decided.
    lines: Option<Vec<DetectedLine>>,
    /// Channels whose bytes another line carries, too: the other wire of a differential pair, or RX and TX beside the bus.
    copies: Vec<usize>,
    /// Channels with a line of their own that is left out, because a bus has two at most.
    surplus: Vec<usize>,
}

/// A channel is a part of another one if that has so many of a hundred of its characters.
const MIN_PERCENT_OF_PART: usize = 95;

/// Whether the line `whole` has nearly all characters of another line at the same time. Each line is in the order of time.
fn is_part_of(part: &[Character], whole: &[Character]) -> bool {
    let mut at = 0;
    let mut is_shared = |one: &Character| {
        // Drivers and level shifters delay a signal, by less than half a character.
        let tolerance = (one.end - one.start) / 2.0;
        while whole.get(at).is_some_and(|other| other.start < one.start - tolerance) {
            at += 1;
        }
        whole.get(at).is_some_and(|other| other.byte == one.byte && other.start <= one.start + tolerance)
    };
    let shared = part.iter().map(&mut is_shared).filter(|&is_shared| is_shared).count();
    !part.is_empty() && shared * 100 >= part.len() * MIN_PERCENT_OF_PART
}

impl Analyzer {
    /// A decoder for channels that are wired like this.
    pub fn new(wiring: Wiring) -> Self {
        let channels = (0..CHANNELS).map(|_| Channel::default()).collect();
        let table = (wiring.unit == 0).then(LevelTable::default);
        Self {
            edges: EdgeDetector::new(wiring.unit),
            table,
            wiring,
            channels,
            lines: None,
            copies: Vec::new(),
            surplus: Vec::new(),
        }
    }

    /// The detected lines; `None` until they are decided.
    pub fn lines(&self) -> Option<&[DetectedLine]> {
        self.lines.as_deref()
    }

    /// Channels whose bytes a detected line carries, too.
    pub fn copies(&self) -> &[usize] {
        &self.copies
    }

    /// Channels with a line of their own that is left out.
    pub fn surplus(&self) -> &[usize] {
        &self.surplus
    }

    /// Converts a position in samples to ns since the first sample.
    pub fn ns(&self, sample: f64) -> modlens_protocol::Ns {
        (sample * 1e9 / self.wiring.rate).round() as modlens_protocol::Ns
    }

    /// Takes a block of samples, cut anywhere; appends the characters that are complete to `decoded`, in the order of their
    /// ends.
    pub fn push(&mut self, functions: &Functions, block: &[u8], decoded: &mut Vec<LineCharacter>) {
        let Self { edges, table, channels, wiring, .. } = self;
        let mut each = |channel: usize, edge| {
            if wiring.channels.as_ref().is_none_or(|chosen| chosen.contains(&channel)) {
                channels[channel].edges.push(edge);
            }
        };
        match table {
            Some(table) => table.push(block, &mut each),
            None => edges.push(block, &mut each),
        }
        // The decision is taken at a fixed number of edges, so that it does not depend on how the blocks are cut.
        if self.lines.is_none() && self.channels.iter().any(|channel| channel.edges.len() >= DECISION_EDGES) {
            self.decide(functions);
        }
        self.decode(decoded);
    }

    /// Decides and decodes what is left, because the samples have ended.
    pub fn finish(&mut self, functions: &Functions, decoded: &mut Vec<LineCharacter>) {
        let Self { table, channels, wiring, .. } = self;
        if let Some(table) = table {
            table.finish(&mut |channel, edge| {
                if wiring.channels.as_ref().is_none_or(|chosen| chosen.contains(&channel)) {
                    channels[channel].edges.push(edge);
                }
            });
        }
        if self.lines.is_none() {
            self.decide(functions);
        }
        self.decode(decoded);
    }

    /// The number of samples up to which the levels are known.
    fn samples(&self) -> u64 {
        self.table.as_ref().map_or(self.edges.samples, |table| table.samples)
    }

    /// Decides which channels are serial lines: those with most bytes in valid frames, two at most. A channel that carries
    /// the same bytes as another one is a copy.
    fn decide(&mut self, functions: &Functions) {
        // All channels are examined up to the sample at which the busiest one had enough edges.
        let decision_sample =
            self.channels.iter().filter_map(|channel| channel.edges.get(DECISION_EDGES - 1)).map(|edge| edge.sample).min();
        let now = decision_sample.unwrap_or_else(|| self.samples());
        let mut lines: Vec<(DetectedLine, Vec<Character>)> = Vec::new();
        for (number, channel) in self.channels.iter().enumerate() {
            let count = channel.edges.partition_point(|edge| edge.sample < now);
            let edges = &channel.edges[..count];
            if edges.len() < MIN_EDGES {
                continue;
            }
            let (rate, line, inverted) = (self.wiring.rate, self.wiring.line, self.wiring.inverted);
            let Some(settings) = detect_settings(functions, edges, now, rate, line, inverted) else { continue };
            // Channels that the operator named count as lines even without valid frames.
            if settings.valid_frame_bytes == 0 && self.wiring.channels.is_none() {
                continue;
            }
            let mut uart = UartReceiver::new(settings.line, rate, settings.inverted);
            for &edge in edges {
                uart.push_edge(edge);
            }
            let characters: Vec<Character> = std::iter::from_fn(|| uart.next(now)).collect();
            let has_bytes_of = |other: &[Character]| other.iter().map(|it| it.byte).eq(characters.iter().map(|it| it.byte));
            if lines.iter().any(|(_, other)| has_bytes_of(other)) {
                self.copies.push(number);
            } else {
                lines.push((DetectedLine { channel: number, settings }, characters));
            }
        }
        let lines = self.choose(lines);
        for (line, it) in lines.iter().enumerate() {
            let uart = UartReceiver::new(it.settings.line, self.wiring.rate, it.settings.inverted);
            self.channels[it.channel].uart = Some((line, uart));
        }
        self.lines = Some(lines);
    }

    /// Chooses the lines of the bus: the two channels with most bytes in valid frames. Where the first of them carries what
    /// others do, as the bus carries what RX and TX do, these are left out.
    fn choose(&mut self, mut lines: Vec<(DetectedLine, Vec<Character>)>) -> Vec<DetectedLine> {
        lines.sort_by_key(|(it, _)| (std::cmp::Reverse(it.settings.valid_frame_bytes), it.channel));
        let mut chosen: Vec<(DetectedLine, Vec<Character>)> = Vec::new();
        for (line, characters) in lines {
            let is_part = chosen.first().is_some_and(|(_, whole)| is_part_of(&characters, whole));
            match chosen.len() {
                _ if is_part => self.copies.push(line.channel),
                MAX_LINES => self.surplus.push(line.channel),
                _ => chosen.push((line, characters)),
            }
        }
        chosen.sort_by_key(|(it, _)| it.channel);
        chosen.into_iter().map(|(it, _)| it).collect()
    }

    /// Passes new edges to the receivers and appends the characters that they complete, oldest first.
    fn decode(&mut self, decoded: &mut Vec<LineCharacter>) {
        if self.lines.is_none() {
            return;
        }
        let now = self.samples();
        let before = decoded.len();
        for channel in &mut self.channels {
            let edges = channel.edges.drain(..);
            let Some((line, uart)) = &mut channel.uart else { continue };
            edges.for_each(|edge| uart.push_edge(edge));
            while let Some(character) = uart.next(now) {
                decoded.push((*line, character));
            }
        }
        decoded[before..].sort_by(|a, b| a.1.end.total_cmp(&b.1.end));
    }
}
