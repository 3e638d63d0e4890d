//! The kinds of compact exchanges. Most columns of an exchange follow from its bus, framing and kind, or are missing
//! in all exchanges that have these in common, so that this is read once for each kind.

use std::collections::HashMap;

use modlens_protocol::framing::Mode;
use modlens_tables::columns::{ExchangeChunk, ExchangeRef};

/// Numbers for the kinds of compact exchanges of each bus and framing, in the order in which they come.
pub(super) struct Kinds {
    /// All that came.
    known: HashMap<((u32, Mode), usize), u32>,
    /// Bus and framing of the last exchanges.
    bus_and_mode: Option<(u32, Mode)>,
    /// Of these the number of each kind, and `UNKNOWN` for those that have not come since the bus changed.
    numbers: Vec<u32>,
    /// The kinds that are not `UNKNOWN`.
    seen: Vec<usize>,
    /// The numbers of the last exchanges.
    of_exchanges: Vec<u32>,
}

const UNKNOWN: u32 = u32::MAX;

impl Default for Kinds {
    fn default() -> Self {
        Self {
            known: HashMap::new(),
            bus_and_mode: None,
            numbers: vec![UNKNOWN; ExchangeChunk::KINDS],
            seen: Vec::new(),
            of_exchanges: Vec::new(),
        }
    }
}

impl Kinds {
    /// Forgets all kinds.
    pub(super) fn clear(&mut self) {
        self.known.clear();
        self.turn_to(None);
    }

    /// The number of the kind of each of these exchanges. `learn` gets an exchange of each kind that comes for the first time;
    /// the first kind has the number 0, and the others the next ones.
    pub(super) fn of(&mut self, exchanges: &ExchangeChunk<'_>, mut learn: impl FnMut(&ExchangeRef<'_>)) -> &[u32] {
        let bus_and_mode = exchanges.bus_and_mode();
        if self.bus_and_mode != Some(bus_and_mode) {
            self.turn_to(Some(bus_and_mode));
        }
        self.of_exchanges.clear();
        self.of_exchanges.extend(exchanges.kinds().map(|kind| self.numbers[kind]));
        if self.of_exchanges.contains(&UNKNOWN) {
            for (place, kind) in exchanges.kinds().enumerate() {
                if self.numbers[kind] == UNKNOWN {
                    let next = self.known.len() as u32;
                    self.numbers[kind] = *self.known.entry((bus_and_mode, kind)).or_insert_with(|| {
                        learn(&exchanges.at(place));
                        next
                    });
                    self.seen.push(kind);
                }
                self.of_exchanges[place] = self.numbers[kind];
            }
        }
        &self.of_exchanges
    }

    /// Goes on with another bus.
    fn turn_to(&mut self, bus_and_mode: Option<(u32, Mode)>) {
        self.bus_and_mode = bus_and_mode;
        self.seen.drain(..).for_each(|kind| self.numbers[kind] = UNKNOWN);
    }
}
