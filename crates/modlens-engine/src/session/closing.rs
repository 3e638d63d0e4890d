//! Sources that have ended give back what they took, so that ten thousand small files cost no more memory than one.
//!
//! The bus of such a source keeps its number, its name and its counters, because rows and statistics refer to them. Its
//! framer, its pairing and what it has learned are dropped.

use crate::pairing::Pairing;
use crate::session::bus::BusState;
use crate::session::profiles::Profiles;
use crate::session::sources::CaptureState;
use crate::session::Session;

impl Session {
    /// Gives back what a bus and the buses of its devices took, because their source has ended. Everything on them must have
    /// been decided (`flush`). What its text reader has seen is forgotten, too. A bus of a raw recording stays as it is, since
    /// the next file may go on with it.
    pub fn close_bus(&mut self, bus: usize) {
        if self.recorded.iter().any(|(_, recorded)| *recorded == bus) || !self.decoder.open.remove(&bus) {
            return;
        }
        let devices = std::mem::take(&mut self.decoder.buses[bus].devices);
        let state = &self.decoder.buses[bus];
        let (options, counts) = (state.options.clone(), state.counts);
        self.decoder.buses[bus] =
            BusState::new(options, Pairing::new(self.decoder.timeout, self.decoder.live), counts, Profiles::default());
        for (_, device) in devices {
            self.close_bus(device);
        }
    }

    /// Gives back what a capture took, of which everything has been read and decided.
    pub fn close_capture(&mut self, capture: usize) {
        let Some(state) = self.captures[capture].take() else { return };
        let reimported = state.reimport.buses.into_iter().map(|(_, bus)| bus);
        for bus in state.lines.into_iter().flatten().chain(state.resumable).chain(reimported) {
            self.close_bus(bus);
        }
    }

    /// Gives back what a recording of a logic analyzer took, of which everything has been read and decided.
    pub fn close_logic(&mut self, logic: usize) {
        if let Some(bus) = self.logics[logic].take().and_then(|state| state.bus) {
            self.close_bus(bus);
        }
    }

    /// Ends the serial interfaces before the one with this index, which belong to earlier sections of a pcapng file: packets
    /// name the interfaces of their own section only. An interface of the same name in the next section goes on with their
    /// buses; the others are closed with the section after.
    pub(super) fn end_lines_before(&mut self, state: &mut CaptureState, first: usize) {
        if state.ended_lines >= first {
            return;
        }
        for bus in std::mem::take(&mut state.resumable) {
            self.close_bus(bus);
        }
        while state.ended_lines < first {
            if let Some(bus) = state.lines.get_mut(state.ended_lines).and_then(Option::take) {
                if !self.recorded.iter().any(|(_, recorded)| *recorded == bus) {
                    self.decoder.flush_bus(bus);
                    state.resumable.push(bus);
                }
            }
            state.ended_lines += 1;
        }
    }

    /// The bus of an interface of this name in the section before, if there was one that nobody goes on with yet.
    pub(super) fn resumed_line(&self, state: &mut CaptureState, name: &str) -> Option<usize> {
        let at = state.resumable.iter().position(|&bus| self.decoder.buses[bus].options.bus.name == name)?;
        Some(state.resumable.swap_remove(at))
    }
}
