//! Plain exchanges in characters (serial line specification, 2.5.2).

use memchr::memchr;

use crate::framer::ascii::LIMIT;
use crate::framer::exchange::Exchange;
use crate::session::bus::{said, BusState};
use crate::session::routine::{both, unmarked, Found, Run};
use crate::session::Session;
use modlens_protocol::checksum::lrc;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::solid;
use modlens_protocol::Ns;

/// Colon, the characters of a checksum, and the line end.
const AROUND: usize = 5;

/// Characters of a frame whose unit and PDU have so many bytes.
fn characters(bytes: usize) -> usize {
    AROUND + 2 * bytes
}

/// Unit and PDU of a frame of so many characters, if nothing is to be said of it.
fn decode(text: &[u8], length: usize, adu: &mut Vec<u8>) -> bool {
    adu.clear();
    let Some(([b':', digits @ ..], b"\r\n")) = text.get(..length).and_then(|text| text.split_last_chunk()) else { return false };
    // Small letters are a finding.
    let capital = digits.iter().fold(true, |all, digit| all & !digit.is_ascii_lowercase());
    let right = capital && digits.len() % 2 == 0 && solid(digits, adu) && lrc(adu) == 0;
    adu.pop();
    right
}

/// The exchange at the head of a line, if nothing is to be said of it; `adus` gets the request and its answer.
fn plain(state: &mut BusState, functions: &Functions, patience: Ns, adus: &mut [Vec<u8>; 2]) -> Option<Found> {
    let input = &state.lines[0].1.input;
    let text = input.bytes();
    let [request, response] = adus;
    let asked = 2 + memchr(b'\r', &text[..text.len().min(LIMIT)])?;
    let known = decode(text, asked, request)
        .then(|| Exchange::of(functions, Mode::Ascii, request))?
        .filter(|known| unmarked(known) && !known.ambiguous)?;
    let answered = characters(known.answered);
    let whole = request.len() == known.asked && decode(&text[asked..], answered, response);
    if !whole || !known.is_answered(request, response) || !input.holds_exchange(Mode::Ascii, asked, answered, patience) {
        return None;
    }
    if known.mirrored {
        let said = |index| input.read(index).and_then(|read| read.side).map(|side| said(state.sides, side));
        let pause = state.pairing.tempo.judge(input.pause_before(asked));
        let doubtful = said(0) == Some(Direction::Response) || said(asked) == Some(Direction::Request) || pause > 0.0;
        if doubtful {
            return None;
        }
    }
    let quiet = state.profiles.take(functions, request, known.block(response));
    quiet.then_some(Found { known, mode: Mode::Ascii, id: None, lines: [0, 0], lengths: [asked, answered] })
}

impl Session {
    /// On one line, request and answer follow each other.
    pub(super) fn routine_ascii(&mut self, bus: usize) {
        let mut adus = std::mem::take(&mut self.adus);
        let state = &mut self.buses[bus];
        let setting = state.setting(0);
        let told_apart = 2 * state.coarsest();
        let mut run = Run::default();
        loop {
            let state = &mut self.buses[bus];
            let patience = if setting.clocked { state.pairing.patience() } else { Ns::MAX };
            let Some(found) = plain(state, &self.functions, patience, &mut adus) else { break };
            let whole = &state.lines[0].1.input.bytes()[..found.lengths[0] + found.lengths[1]];
            let wires = both(self.batch.keep(whole).start as usize, found.lengths);
            let pdus = adus.each_ref().map(|adu| self.batch.keep(&adu[1..]));
            self.exchange(bus, &found, wires, Some(pdus), &setting, told_apart, &mut run);
            let response = &adus[1];
            self.buses[bus].pairing.resume(response[0], &response[1..]);
        }
        self.adus = adus;
        if run.exchanges > 0 {
            self.stats.run(self.buses[bus].counts, Mode::Ascii, run.exchanges, run.bytes as u64);
        }
    }
}
