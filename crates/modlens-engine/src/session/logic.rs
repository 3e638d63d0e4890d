//! Recordings of logic analyzers: the serial lines detected in the samples become the lines of one bus.

use std::sync::Arc;

use crate::records::Bus;
use crate::session::sources::LogicState;
use crate::session::{BusOptions, Session};
use modlens_protocol::framing::Mode;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::logic::{Analyzer, Character, Wiring};

/// The options of the bus of a recording; `None` before its lines are detected, and if there are none.
fn bus_options(state: &LogicState, name: String) -> Option<BusOptions> {
    let line = state.analyzer.lines()?.first()?.settings.line;
    let sample_ns = state.analyzer.ns(1.0);
    let source = state.source.clone();
    let bus = Bus { name, source, place: Place::Offset, clock: Clock::Relative, line: Some(line), network: None };
    Some(BusOptions { bus, mode: state.mode, line: Some(line), resolution: Some(sample_ns.max(1)), rule: None })
}

impl Session {
    /// Adds a recording of a logic analyzer; these are numbered from 0.
    pub fn add_logic(&mut self, source: String, mode: Option<Mode>, wiring: Wiring) -> usize {
        self.logics.push(Some(LogicState { source, mode, analyzer: Analyzer::new(wiring), bus: None }));
        self.logics.len() - 1
    }

    /// Takes a block of samples, cut anywhere; `last` ends the recording. The bus is added once its lines are detected, with
    /// the settings of the first of them and the duration of a sample as the step of its clock. Without any line there is no
    /// bus, and nothing is emitted. The recording begins at time 0, its first sample.
    pub fn feed_logic(&mut self, logic: usize, block: &[u8], last: bool) {
        let Some(mut state) = self.logics[logic].take() else { return };
        let functions = Arc::clone(&self.decoder.functions);
        let mut characters = Vec::new();
        state.analyzer.push(&functions, block, &mut characters);
        if last {
            state.analyzer.finish(&functions, &mut characters);
        }
        if state.bus.is_none() {
            state.bus = bus_options(&state, self.name_after(&state.source)).map(|options| self.decoder.add_bus(options));
        }
        if let Some(bus) = state.bus {
            self.decoder.origin.get_or_insert(0);
            let has_several_lines = state.analyzer.lines().is_some_and(|found| found.len() > 1);
            self.feed_characters(bus, has_several_lines, &state.analyzer, &characters);
        }
        self.logics[logic] = Some(state);
    }

    /// What was found in a recording of a logic analyzer.
    pub fn logic(&self, logic: usize) -> Option<&Analyzer> {
        Some(&self.logics.get(logic)?.as_ref()?.analyzer)
    }

    /// Feeds the characters, each with its own time, in runs of one line, all with or all without a line error. A line's
    /// number is its index plus one, or 0 if it is the only one.
    fn feed_characters(&mut self, bus: usize, has_several_lines: bool, analyzer: &Analyzer, characters: &[(usize, Character)]) {
        let (mut bytes, mut times): (Vec<u8>, Vec<Ns>) = (Vec::new(), Vec::new());
        for run in characters.chunk_by(|a, b| (a.0, a.1.has_error()) == (b.0, b.1.has_error())) {
            bytes.clear();
            times.clear();
            bytes.extend(run.iter().map(|(_, character)| character.byte));
            times.extend(run.iter().map(|(_, character)| analyzer.ns(character.end)));
            let line = if has_several_lines { 1 + run[0].0 as u8 } else { 0 };
            let chunk = Chunk {
                line,
                bytes: &bytes,
                times: Times::Bytes(&times),
                has_line_error: run[0].1.has_error(),
                ..Chunk::default()
            };
            self.decoder.feed(bus, &chunk);
        }
    }
}
