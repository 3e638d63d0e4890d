//! Recordings in text: their reader's records become chunks, of one bus or of one for each device that is named.

use std::sync::Arc;

use crate::session::{BusOptions, Session};
use modlens_protocol::source::Place;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::text::{Reader, Record};

impl Session {
    /// The text that is to come on a bus is read by this reader; `sample` is its beginning.
    pub fn open_text(&mut self, bus: usize, mut reader: Reader, sample: &[u8]) {
        let sides = reader.look_ahead(sample);
        self.buses[bus].sides = sides;
        self.buses[bus].reader = Some(Box::new(reader));
    }

    /// Text of a recording, cut anywhere; `last` ends the last line. Nothing happens before `open_text`.
    pub fn feed_text(&mut self, bus: usize, data: &[u8], last: bool) {
        let Some(mut reader) = self.buses[bus].reader.take() else { return };
        reader.push(data);
        let resolution = self.buses[bus].options.resolution;
        while let Some((record, bytes)) = reader.next(last) {
            // They borrow the reader, and the names of devices are its, too.
            let mut own = std::mem::take(&mut self.text);
            own.clear();
            own.extend_from_slice(bytes);
            let to = self.device(bus, &record, &reader);
            let stamps = if resolution.is_none() { reader.resolution() } else { self.buses[to].stamps_resolution };
            if self.buses[to].stamps_resolution != stamps || !self.described(to, &record) {
                // The records before were read by another clock.
                self.decide_waiting();
            }
            self.buses[to].stamps_resolution = stamps;
            self.feed_record(to, &record, &own);
            self.text = own;
        }
        self.decide_waiting();
        self.buses[bus].reader = Some(reader);
    }

    /// Nothing more has come for a while: what the text and the framer hold back for what may follow is decided.
    pub fn settle_text(&mut self, bus: usize) {
        if let Some(reader) = &mut self.buses[bus].reader {
            reader.settle();
        }
        self.feed_text(bus, b"", false);
        let devices: Vec<usize> = self.buses[bus].devices.iter().map(|(_, device)| *device).collect();
        for bus in devices.into_iter().chain([bus]) {
            for (_, line) in &mut self.buses[bus].lines {
                line.input.closed = true;
            }
            self.frames_of(bus);
        }
    }

    /// Whether a bus is known to have the clock and the places of this record.
    fn described(&self, bus: usize, record: &Record) -> bool {
        let row = &self.buses[bus].options.bus;
        row.clock == record.clock && row.place == Place::Line
    }

    fn feed_record(&mut self, bus: usize, record: &Record, bytes: &[u8]) {
        if !self.described(bus, record) {
            self.describe_bus(bus, record.clock, Place::Line);
        }
        let chunk = Chunk {
            bytes,
            times: record.time.map_or(Times::None, Times::Read),
            line: record.line,
            side: record.side,
            record: record.record,
            hole: record.hole,
            no_checksum: record.no_checksum,
            framing: record.framing,
            origin: record.number,
            ..Chunk::default()
        };
        self.feed_later(bus, &chunk);
    }

    /// The bus of the device that a record names: the first name is that of the recording's own bus.
    fn device(&mut self, bus: usize, record: &Record, reader: &Reader) -> usize {
        if record.key == 0 {
            return bus;
        }
        if let Some(&(_, known)) = self.buses[bus].devices.iter().find(|(key, _)| *key == record.key) {
            return known;
        }
        let name = String::from_utf8_lossy(&reader.keys()[record.key - 1]).into_owned();
        let own = &self.buses[bus].options;
        let row = crate::records::Bus { name: format!("{}:{name}", own.bus.source), ..own.bus.clone() };
        let options = BusOptions { bus: row.clone(), ..own.clone() };
        let unused = self.buses[bus].devices.is_empty() && self.buses[bus].lines.is_empty();
        let sides = self.buses[bus].sides;
        let to = if unused { bus } else { self.add_bus(options) };
        self.buses[to].sides = sides;
        if unused {
            Arc::make_mut(&mut self.bus_rows)[bus] = row.clone();
            self.stats.rename_bus(bus, &row.name);
            self.buses[bus].options.bus = row;
        }
        self.buses[bus].devices.push((record.key, to));
        to
    }

    /// What the text reader of a bus has seen.
    pub fn reader(&self, bus: usize) -> Option<&Reader> {
        self.buses[bus].reader.as_deref()
    }
}
