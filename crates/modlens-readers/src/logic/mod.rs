//! Logic analysers: samples of channels to the bytes of serial lines.
//!
//! `edges` (samples to changes of channels), `autobaud` (which channels are lines, with what settings), `uart` (changes to
//! characters). The first stretch is kept until the settings are certain; from there on nothing is.

mod autobaud;
mod edges;
mod level_table;
mod uart;

pub use autobaud::ChannelSettings;
pub use edges::{Edge, EdgeDetector, CHANNELS};
pub use level_table::{is_table, LevelTable};
pub use uart::Character;

use autobaud::guess;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::Line;
use uart::UartReceiver;

/// The settings are judged on so many changes of a channel.
const ENOUGH: usize = 20_000;

/// Fewer changes are no traffic.
const FEWEST: usize = 20;

/// The lines of one bus at most: one wire, or one for each direction.
pub const LINES: usize = 2;

/// What is known of the analyser's channels beforehand.
#[derive(Clone, Debug, Default)]
pub struct Wiring {
    /// Samples a second.
    pub rate: f64,
    /// Bytes of a sample; 0 for rows of text with a time in seconds and a level a channel, whose rate is 1e9.
    pub unit: usize,
    /// Channels to look at; all where `None`.
    pub channels: Option<Vec<usize>>,
    /// Line settings, where they are known.
    pub line: Option<Line>,
    /// Whether lines idle low, where that is known.
    pub inverted: Option<bool>,
}

/// A line that was found.
#[derive(Clone, Copy, Debug)]
pub struct DetectedLine {
    /// The channel.
    pub channel: usize,
    /// Its settings.
    pub settings: ChannelSettings,
}

/// A character of a line, 0 or 1.
pub type LineCharacter = (usize, Character);

#[derive(Debug, Default)]
struct Channel {
    edges: Vec<Edge>,
    uart: Option<(usize, UartReceiver)>,
}

/// Reads the samples of a logic analyser.
#[derive(Debug)]
pub struct Analyser {
    wiring: Wiring,
    edges: EdgeDetector,
    /// In place of samples.
    table: Option<LevelTable>,
    channels: Vec<Channel>,
    /// The lines, once they are decided.
    found: Option<Vec<DetectedLine>>,
    /// Channels that carry the same as a line: the other wire of a pair, an echo.
    copies: Vec<usize>,
}

impl Analyser {
    /// An analyser with this wiring.
    pub fn new(wiring: Wiring) -> Self {
        let channels = (0..CHANNELS).map(|_| Channel::default()).collect();
        let table = (wiring.unit == 0).then(LevelTable::default);
        Self { edges: EdgeDetector::new(wiring.unit), table, wiring, channels, found: None, copies: Vec::new() }
    }

    /// The lines, once they are decided.
    pub fn found(&self) -> Option<&[DetectedLine]> {
        self.found.as_deref()
    }

    /// Channels that carry the same as a line.
    pub fn copies(&self) -> &[usize] {
        &self.copies
    }

    /// Nanoseconds of a place.
    pub fn ns(&self, place: f64) -> modlens_protocol::Ns {
        (place * 1e9 / self.wiring.rate).round() as modlens_protocol::Ns
    }

    /// Takes samples, cut anywhere; `heard` gets the characters that are whole, in the order of their ends.
    pub fn push(&mut self, functions: &Functions, block: &[u8], heard: &mut Vec<LineCharacter>) {
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
        // A fixed number of changes decides, however the blocks are cut.
        if self.found.is_none() && self.channels.iter().any(|channel| channel.edges.len() >= ENOUGH) {
            self.decide(functions);
        }
        self.characters(heard);
    }

    /// The samples have ended.
    pub fn finish(&mut self, functions: &Functions, heard: &mut Vec<LineCharacter>) {
        let Self { table, channels, wiring, .. } = self;
        if let Some(table) = table {
            table.finish(&mut |channel, edge| {
                if wiring.channels.as_ref().is_none_or(|chosen| chosen.contains(&channel)) {
                    channels[channel].edges.push(edge);
                }
            });
        }
        if self.found.is_none() {
            self.decide(functions);
        }
        self.characters(heard);
    }

    /// How far the channels are known.
    fn samples(&self) -> u64 {
        self.table.as_ref().map_or(self.edges.samples, |table| table.samples)
    }

    fn decide(&mut self, functions: &Functions) {
        // Everybody is judged up to the change that was enough for the busiest.
        let full = self.channels.iter().filter_map(|channel| channel.edges.get(ENOUGH - 1)).map(|edge| edge.sample).min();
        let now = full.unwrap_or_else(|| self.samples());
        let mut found: Vec<(DetectedLine, Vec<u8>)> = Vec::new();
        for (number, channel) in self.channels.iter().enumerate() {
            let count = channel.edges.partition_point(|edge| edge.sample < now);
            let edges = &channel.edges[..count];
            if edges.len() < FEWEST {
                continue;
            }
            let (rate, line, inverted) = (self.wiring.rate, self.wiring.line, self.wiring.inverted);
            let Some(settings) = guess(functions, edges, now, rate, line, inverted) else { continue };
            // Named channels are believed; others have to show frames.
            if settings.good == 0 && self.wiring.channels.is_none() {
                continue;
            }
            let mut uart = UartReceiver::new(settings.line, rate, settings.inverted);
            for &edge in edges {
                uart.edge(edge);
            }
            let bytes: Vec<u8> = std::iter::from_fn(|| uart.next(now)).map(|it| it.byte).collect();
            if found.iter().any(|(_, other)| *other == bytes) {
                self.copies.push(number);
            } else {
                found.push((DetectedLine { channel: number, settings }, bytes));
            }
        }
        // The best two are the lines of the bus.
        found.sort_by_key(|(it, _)| (std::cmp::Reverse(it.settings.good), it.channel));
        found.truncate(LINES);
        found.sort_by_key(|(it, _)| it.channel);
        let found: Vec<DetectedLine> = found.into_iter().map(|(it, _)| it).collect();
        for (line, it) in found.iter().enumerate() {
            let uart = UartReceiver::new(it.settings.line, self.wiring.rate, it.settings.inverted);
            self.channels[it.channel].uart = Some((line, uart));
        }
        self.found = Some(found);
    }

    /// Moves edges to the receivers and takes what they have heard, oldest first.
    fn characters(&mut self, heard: &mut Vec<LineCharacter>) {
        if self.found.is_none() {
            return;
        }
        let now = self.samples();
        let before = heard.len();
        for channel in &mut self.channels {
            let edges = channel.edges.drain(..);
            let Some((line, uart)) = &mut channel.uart else { continue };
            edges.for_each(|edge| uart.edge(edge));
            while let Some(character) = uart.next(now) {
                heard.push((*line, character));
            }
        }
        heard[before..].sort_by(|a, b| a.1.end.total_cmp(&b.1.end));
    }
}
