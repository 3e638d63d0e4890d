//! Readers that work beside the session: one thread reads the next blocks of a recording while another decides what it has
//! read. The rows are the same: a reader never asks what the session makes of its records.

use std::sync::Arc;

use crate::session::Session;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;
use modlens_readers::chunk::Chunk;
use modlens_readers::pcap::{Capture, KeptEvents};
use modlens_readers::text::{LogEntry, Reader};

/// The reader of a text or of a capture, or one that hands raw bytes on, lent by its session between two blocks of the recording.
#[derive(Debug)]
pub struct BorrowedReader {
    lent: Lent,
    /// How many records or events the last block had, and how many bytes of Modbus: the next one has about as many. Memory that
    /// grows is copied and touched again.
    last_size: (usize, usize),
}

#[derive(Debug)]
enum Lent {
    Raw { bus: usize },
    Text { bus: usize, reader: Box<Reader>, keys: Arc<Vec<Vec<u8>>> },
    Capture { capture: usize, reader: Box<Capture>, functions: Arc<Functions> },
}

/// What a reader has found in one block.
#[derive(Debug)]
pub struct ReadBlock(Found);

#[derive(Debug)]
enum Found {
    Raw { bus: usize, bytes: Vec<u8> },
    Text { bus: usize, entries: Vec<OwnedEntry>, bytes: Vec<u8>, keys: Arc<Vec<Vec<u8>>> },
    Capture { capture: usize, events: KeptEvents },
}

/// A record of a text, the number of its bytes, and the step of the time stamps up to it.
#[derive(Debug)]
struct OwnedEntry {
    entry: LogEntry,
    length: usize,
    resolution: Option<Ns>,
}

impl BorrowedReader {
    /// Reads a block of the recording, cut anywhere.
    pub fn read(&mut self, block: &[u8]) -> ReadBlock {
        let room = (self.last_size.0 * 9 / 8, self.last_size.1 * 9 / 8);
        let found = match &mut self.lent {
            Lent::Raw { bus } => Found::Raw { bus: *bus, bytes: block.to_vec() },
            Lent::Text { bus, reader, keys } => read_text(*bus, reader, keys, block, room),
            Lent::Capture { capture, reader, functions } => {
                let mut events = KeptEvents::with_room_of(room);
                reader.push(functions, block, &mut |event| events.push(event));
                Found::Capture { capture: *capture, events }
            }
        };
        self.last_size = match &found {
            Found::Raw { .. } => (0, 0),
            Found::Text { entries, bytes, .. } => (entries.len(), bytes.len()),
            Found::Capture { events, .. } => events.size(),
        };
        ReadBlock(found)
    }
}

fn read_text(bus: usize, reader: &mut Reader, keys: &mut Arc<Vec<Vec<u8>>>, block: &[u8], room: (usize, usize)) -> Found {
    let (mut entries, mut bytes) = (Vec::with_capacity(room.0), Vec::with_capacity(room.1));
    reader.push(block);
    while let Some(entry) = reader.advance(false) {
        let own = reader.entry_bytes();
        bytes.extend_from_slice(own);
        entries.push(OwnedEntry { entry, length: own.len(), resolution: reader.resolution() });
    }
    if reader.keys().len() > keys.len() {
        *keys = Arc::new(reader.keys().to_vec());
    }
    Found::Text { bus, entries, bytes, keys: Arc::clone(keys) }
}

impl Session {
    /// Lends the reader of the text of a bus; without `open_text` before, one for its raw bytes.
    pub fn lend_reader(&mut self, bus: usize) -> BorrowedReader {
        let lent = match self.decoder.buses[bus].reader.take() {
            Some(reader) => Lent::Text { bus, reader, keys: Arc::default() },
            None => Lent::Raw { bus },
        };
        BorrowedReader { lent, last_size: (0, 0) }
    }

    /// Lends the reader of a capture; `None` if it is closed.
    pub fn lend_capture_reader(&mut self, capture: usize) -> Option<BorrowedReader> {
        let reader = Box::new(std::mem::take(&mut self.captures.get_mut(capture)?.as_mut()?.reader));
        let lent = Lent::Capture { capture, reader, functions: Arc::clone(&self.decoder.functions) };
        Some(BorrowedReader { lent, last_size: (0, 0) })
    }

    /// Takes a reader back. All blocks that it has read have been fed.
    pub fn take_back(&mut self, reader: BorrowedReader) {
        match reader.lent {
            Lent::Raw { .. } => {}
            Lent::Text { bus, reader, .. } => self.decoder.buses[bus].reader = Some(reader),
            Lent::Capture { capture, reader, .. } => {
                if let Some(state) = &mut self.captures[capture] {
                    state.reader = *reader;
                }
            }
        }
    }

    /// Takes what a lent reader has found in the next block, as `feed`, `feed_text` and `feed_capture` take the block itself.
    pub fn feed_read(&mut self, block: &ReadBlock) {
        match &block.0 {
            Found::Raw { bus, bytes } => self.decoder.feed(*bus, &Chunk { bytes, ..Chunk::default() }),
            Found::Text { bus, entries, bytes, keys } => {
                let mut bytes = bytes.as_slice();
                for OwnedEntry { entry, length, resolution } in entries {
                    let (own, rest) = bytes.split_at(*length);
                    bytes = rest;
                    self.take_entry(*bus, entry, own, *resolution, keys);
                }
            }
            Found::Capture { capture, events } => {
                let Some(mut state) = self.captures[*capture].take() else { return };
                events.replay(|event| self.handle_event(&mut state, event));
                self.captures[*capture] = Some(state);
            }
        }
        self.decoder.decide_waiting();
    }
}
