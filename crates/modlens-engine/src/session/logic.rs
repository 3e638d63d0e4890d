//! Logic analysers in a session: the lines that are found are one bus.

use std::sync::Arc;

use crate::records::Bus;
use crate::session::{BusOptions, Session};
use modlens_protocol::framing::Mode;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::logic::{Analyser, Character, Found, Wiring};

pub(super) struct LogicState {
    source: String,
    mode: Option<Mode>,
    analyser: Analyser,
    bus: Option<usize>,
}

impl Session {
    /// Adds the samples of a logic analyser; they are numbered from 0.
    pub fn add_logic(&mut self, source: String, mode: Option<Mode>, wiring: Wiring) -> usize {
        self.logics.push(Some(LogicState { source, mode, analyser: Analyser::new(wiring), bus: None }));
        self.logics.len() - 1
    }

    /// Samples, cut anywhere; `last` ends them.
    pub fn feed_logic(&mut self, logic: usize, block: &[u8], last: bool) {
        let Some(mut state) = self.logics[logic].take() else { return };
        let functions = Arc::clone(&self.functions);
        let mut heard = Vec::new();
        state.analyser.push(&functions, block, &mut heard);
        if last {
            state.analyser.finish(&functions, &mut heard);
        }
        if state.bus.is_none() {
            if let Some(found) = state.analyser.found().filter(|found| !found.is_empty()) {
                let (line, rate) = (found[0].settings.line, state.analyser.ns(1.0));
                let (name, source) = (state.source.clone(), state.source.clone());
                let bus = Bus { name, source, place: Place::Offset, clock: Clock::Relative, line: Some(line), network: None };
                let options = BusOptions { bus, mode: state.mode, line: Some(line), resolution: Some(rate.max(1)), rule: None };
                state.bus = Some(self.add_bus(options));
            }
        }
        if let Some(bus) = state.bus {
            self.origin.get_or_insert(0);
            let two = state.analyser.found().is_some_and(|found| found.len() > 1);
            self.heard(bus, two, &state.analyser, &heard);
        }
        self.logics[logic] = Some(state);
    }

    /// The lines that were found, and the channels that carry the same as one of them.
    pub fn logic(&self, logic: usize) -> Option<(&[Found], &[usize])> {
        let state = self.logics.get(logic)?.as_ref()?;
        Some((state.analyser.found().unwrap_or(&[]), state.analyser.copies()))
    }

    /// Feeds runs of characters of one line that are marked alike.
    fn heard(&mut self, bus: usize, two: bool, analyser: &Analyser, heard: &[(usize, Character)]) {
        let (mut bytes, mut times): (Vec<u8>, Vec<Ns>) = (Vec::new(), Vec::new());
        for run in heard.chunk_by(|a, b| (a.0, a.1.marked()) == (b.0, b.1.marked())) {
            bytes.clear();
            times.clear();
            bytes.extend(run.iter().map(|(_, it)| it.byte));
            times.extend(run.iter().map(|(_, it)| analyser.ns(it.end)));
            let line = if two { 1 + run[0].0 as u8 } else { 0 };
            let chunk =
                Chunk { line, bytes: &bytes, times: Times::Bytes(&times), line_error: run[0].1.marked(), ..Chunk::default() };
            self.feed(bus, &chunk);
        }
    }
}
