//! Recordings in text: the records of their reader become chunks of one bus, or of one bus for each device named in them.

use std::sync::Arc;

use crate::session::{BusOptions, Session};
use modlens_protocol::source::Place;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::text::{LogEntry, Reader};

impl Session {
    /// Opens a recording in text on a bus; `sample` is its beginning, from which the meaning of `sent` is learned.
    pub fn open_text(&mut self, bus: usize, mut reader: Reader, sample: &[u8]) {
        self.decoder.buses[bus].side_votes = reader.look_ahead(sample);
        self.decoder.buses[bus].reader = Some(Box::new(reader));
    }

    /// Takes text of a recording, cut anywhere; `last` ends the last line. Without `open_text` before, it is ignored.
    ///
    /// Each record that the reader completes is fed to the bus of its device. The step of that bus's clock is that of the
    /// time stamps, as far as the reader has seen it, unless the source has stated a step. A change of clock or step has what
    /// was fed before decided first. At the end nothing is left undecided but what the framer holds back itself.
    pub fn feed_text(&mut self, bus: usize, data: &[u8], last: bool) {
        let Some(mut reader) = self.decoder.buses[bus].reader.take() else { return };
        reader.push(data);
        while let Some(entry) = reader.advance(last) {
            self.take_entry(bus, &entry, reader.entry_bytes(), reader.resolution(), reader.keys());
        }
        self.decoder.decide_waiting();
        self.decoder.buses[bus].reader = Some(reader);
    }

    /// Feeds one record of the recording of `bus` to the bus of its device. `resolution` is the step of the time stamps so far,
    /// `keys` are the names of the devices so far.
    pub(super) fn take_entry(&mut self, bus: usize, entry: &LogEntry, bytes: &[u8], resolution: Option<Ns>, keys: &[Vec<u8>]) {
        let to = self.device_bus(bus, entry, keys);
        let is_stated = self.decoder.buses[bus].options.resolution.is_some();
        let stamps = if is_stated { self.decoder.buses[to].stamps_resolution } else { resolution };
        let has_clock = self.decoder.buses[to].has_clock_of(entry.clock);
        if self.decoder.buses[to].stamps_resolution != stamps || !has_clock {
            self.decoder.decide_waiting();
        }
        self.decoder.buses[to].stamps_resolution = stamps;
        if !has_clock {
            self.decoder.describe_bus(to, entry.clock, Place::Line);
        }
        let chunk = chunk_of(entry, bytes);
        if !self.decoder.take_message(to, &chunk) {
            self.decoder.feed_later(to, &chunk);
        }
    }

    /// Decides what the reader and the framer hold back for text that may follow, because none has come for a while: on the
    /// bus of the recording and on those of its devices. Time does not advance.
    pub fn settle_text(&mut self, bus: usize) {
        if let Some(reader) = &mut self.decoder.buses[bus].reader {
            reader.settle();
        }
        self.feed_text(bus, b"", false);
        let devices: Vec<usize> = self.decoder.buses[bus].devices.iter().map(|(_, device)| *device).collect();
        for bus in devices.into_iter().chain([bus]) {
            for (_, line) in &mut self.decoder.buses[bus].lines {
                line.input.is_closed = true;
            }
            self.decoder.emit_frames(bus);
        }
    }

    /// The index of the bus of the device that a record names; that of the recording, `bus`, for a record without device. The
    /// first device takes the recording's own bus, which is renamed, if that has no bytes yet; every further one gets a bus
    /// of its own with the same options. What `sent` means is taken over from the recording's bus as it is known then.
    #[inline]
    fn device_bus(&mut self, bus: usize, entry: &LogEntry, keys: &[Vec<u8>]) -> usize {
        if entry.key == 0 {
            return bus;
        }
        if let Some(&(_, known)) = self.decoder.buses[bus].devices.iter().find(|(key, _)| *key == entry.key) {
            return known;
        }
        let name = String::from_utf8_lossy(&keys[entry.key - 1]).into_owned();
        let to = self.add_device_bus(bus, &name);
        self.decoder.buses[bus].devices.push((entry.key, to));
        to
    }

    /// Adds the bus of the device of this name in the recording of `bus`, or renames that bus if it has neither devices nor
    /// bytes yet; gives its index.
    fn add_device_bus(&mut self, bus: usize, name: &str) -> usize {
        let own = &self.decoder.buses[bus].options;
        let row = crate::records::Bus { name: format!("{}:{name}", self.name_after(&own.bus.source)), ..own.bus.clone() };
        let options = BusOptions { bus: row.clone(), ..own.clone() };
        if self.decoder.buses[bus].devices.is_empty() && self.decoder.buses[bus].lines.is_empty() {
            Arc::make_mut(&mut self.decoder.bus_rows)[bus] = row.clone();
            self.decoder.stats.rename_bus(self.decoder.buses[bus].counts, &row.name);
            self.decoder.buses[bus].options.bus = row;
            return bus;
        }
        let to = self.decoder.add_bus(options);
        self.decoder.buses[to].side_votes = self.decoder.buses[bus].side_votes;
        to
    }

    /// The text reader of a bus, for what it reports about the recording.
    pub fn reader(&self, bus: usize) -> Option<&Reader> {
        self.decoder.buses[bus].reader.as_deref()
    }
}

/// Returns a record of a text with its bytes as a chunk.
#[inline]
fn chunk_of<'a>(entry: &LogEntry, bytes: &'a [u8]) -> Chunk<'a> {
    Chunk {
        bytes,
        times: entry.time.map_or(Times::None, Times::Read),
        line: entry.line,
        side: entry.side,
        starts_record: entry.starts_record,
        follows_loss: entry.follows_loss,
        lacks_checksum: entry.lacks_checksum,
        proven_framing: entry.proven_framing,
        origin: entry.number,
        ..Chunk::default()
    }
}
