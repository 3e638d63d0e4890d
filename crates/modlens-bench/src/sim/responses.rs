//! The responses of the slaves (application protocol, section 6).

use crate::rng::Rng;
use crate::sim::bus::SimulatedBus;
use crate::sim::registers::{anything, character, draw, COILS};
use crate::sim::requests::mask_padding;
use crate::sim::scenario::Scenario;
use crate::sim::slave::{LengthStyle, Slave};

/// Exception codes; repeated ones are more likely.
const EXCEPTIONS: [u8; 12] = [1, 2, 2, 2, 3, 3, 4, 5, 6, 8, 10, 11];

/// The most registers of a response.
const MAX_REGISTERS: u16 = 125;

impl SimulatedBus {
    /// The PDU of a slave's response to a request.
    pub(crate) fn respond(&mut self, slave: usize, request: &[u8], scenario: &Scenario, rng: &mut Rng) -> Vec<u8> {
        let code = request[0];
        let device = &mut self.slaves[slave];
        if rng.chance(scenario.exceptions) {
            let vendor = device.quirk && rng.chance(0.5);
            let exception = if vendor { rng.range(12, 255) as u8 } else { rng.pick(&EXCEPTIONS) };
            return vec![code | 0x80, exception];
        }
        if let Some(custom) = self.proprietary_functions.iter().find(|custom| custom.code == code) {
            return proprietary_response(code, custom.style, scenario.zero_heavy, rng);
        }
        device.answer(request, scenario.zero_heavy, rng)
    }
}

impl Slave {
    /// The PDU of a normal response to a request.
    fn answer(&mut self, request: &[u8], zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
        let code = request[0];
        match code {
            1 | 2 => {
                let (address, count) = (word(request, 1), word(request, 3));
                let mut data = self.coils(address, count, rng);
                mask_padding(&mut data, count);
                counted(code, &data)
            }
            3 | 4 | 23 => self.registers_response(code, word(request, 1), word(request, 3), rng),
            6 if self.quirk && rng.chance(0.3) => {
                let mut answer = request.to_vec();
                let value = draw(zero_heavy, rng);
                answer[3..5].copy_from_slice(&value.to_be_bytes());
                answer
            }
            5 | 6 | 21 | 22 => request.to_vec(),
            15 | 16 => request[..5].to_vec(),
            7 => vec![code, rng.byte()],
            8 => diagnostics_response(request, rng),
            11 => {
                let events = rng.range(0, 5000) as u16;
                [&[code][..], &rng.pick(&[0u16, 0xFFFF]).to_be_bytes(), &events.to_be_bytes()].concat()
            }
            12 => {
                let length = rng.range(0, 64);
                let mut data = [rng.pick(&[0u16, 0xFFFF]), rng.range(0, 5000) as u16, rng.range(0, 5000) as u16]
                    .map(u16::to_be_bytes)
                    .concat();
                data.extend((0..length).map(|_| rng.pick(&[0x20, 0x40, 0x80, 0xA0, 0x00, 0x04])));
                counted(code, &data)
            }
            17 => {
                let length = rng.range(2, 32);
                let mut data: Vec<u8> = (0..length).map(|_| character(rng)).collect();
                // Run indicator: off or on (application protocol, 6.13).
                data[length - 1] = rng.pick(&[0, 0xFF]);
                counted(code, &data)
            }
            20 => self.file_response(request, rng),
            24 => {
                let count = rng.range(0, 31) as u16;
                let data: Vec<u8> = (0..count).flat_map(|_| draw(zero_heavy, rng).to_be_bytes()).collect();
                [&[code][..], &(2 + 2 * count).to_be_bytes(), &count.to_be_bytes(), &data].concat()
            }
            _ if request.get(1) == Some(&0x0E) => identification(request[2], rng),
            _ => {
                let length = rng.range(4, 30);
                [&[code, 0x0D][..], &anything(length - 1, false, rng)].concat()
            }
        }
    }

    fn coils(&mut self, address: u16, count: u16, rng: &mut Rng) -> Vec<u8> {
        let first = COILS + u32::from(address) / 8;
        (0..u32::from(count.div_ceil(8))).map(|at| self.registers.read(first + at, rng) as u8).collect()
    }

    /// The response to a read of registers; slaves that violate the specification may return fewer than requested.
    fn registers_response(&mut self, code: u8, address: u16, asked: u16, rng: &mut Rng) -> Vec<u8> {
        let mut count = asked;
        if asked > MAX_REGISTERS {
            // 126 registers do not fit into 256 bytes: the device returns an exception, or as many as fit.
            if rng.chance(0.5) {
                return vec![code | 0x80, 3];
            }
            count = MAX_REGISTERS;
        } else if self.quirk && asked > 1 && rng.chance(0.2) {
            count = rng.range(1, usize::from(asked) - 1) as u16;
        }
        let wide = if self.enron && code != 23 { 2 } else { 1 };
        let mut data = Vec::with_capacity(4 * usize::from(count));
        for at in 0..u32::from(count) * wide {
            data.extend(self.registers.read(u32::from(address) + at, rng).to_be_bytes());
        }
        counted(code, &data)
    }

    fn file_response(&mut self, request: &[u8], rng: &mut Rng) -> Vec<u8> {
        let mut data = Vec::new();
        for group in request[2..].chunks_exact(7) {
            let (record, count) = (word(group, 3), word(group, 5));
            data.extend([1 + 2 * count as u8, 6]);
            for at in 0..u32::from(count) {
                data.extend(self.registers.read(u32::from(record) + at, rng).to_be_bytes());
            }
        }
        counted(20, &data)
    }
}

fn proprietary_response(code: u8, style: LengthStyle, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    let length = match style {
        LengthStyle::Fixed { response, .. } => response,
        LengthStyle::Counted => {
            let length = rng.range(0, 80);
            return counted(code, &anything(length, zero_heavy, rng));
        }
        LengthStyle::Random => {
            let most = if rng.chance(0.3) { 200 } else { 30 };
            rng.range(0, most)
        }
    };
    [&[code][..], &anything(length, zero_heavy, rng)].concat()
}

fn diagnostics_response(request: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut answer = request.to_vec();
    let sub = request[2];
    // The diagnostic register and the counters have values; the other sub-functions repeat the request.
    if sub == 2 || (11..=18).contains(&sub) {
        let value = if rng.chance(0.5) { 0 } else { rng.range(0, 2000) as u16 };
        answer[3..5].copy_from_slice(&value.to_be_bytes());
    }
    answer
}

/// Read Device Identification (application protocol, 6.21).
fn identification(code: u8, rng: &mut Rng) -> Vec<u8> {
    let objects = rng.range(1, 3) as u8;
    let more = rng.chance(0.2);
    let next = if more { objects } else { 0 };
    let mut pdu = vec![0x2B, 0x0E, code, 0x80 | code.min(3), if more { 0xFF } else { 0 }, next, objects];
    for object in 0..objects {
        let length = rng.range(1, 24);
        pdu.extend([object, length as u8]);
        pdu.extend((0..length).map(|_| character(rng)));
    }
    pdu
}

fn counted(code: u8, data: &[u8]) -> Vec<u8> {
    [&[code, data.len() as u8], data].concat()
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([bytes[at], bytes[at + 1]])
}
