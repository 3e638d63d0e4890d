//! The bus: its line, its slaves, its poll list and its vendor's functions.

use crate::model::{Framing, Settings};
use crate::rng::Rng;
use crate::sim::reads;
use crate::sim::registers::Registers;
use crate::sim::repeated::Repeated;
use crate::sim::scenario::Scenario;
use crate::sim::slave::{LengthStyle, PollItem, ProprietaryFunction, Slave};

/// Function codes that vendors use: user-defined, reserved and legacy ones (application protocol, 5 and annex A).
const VENDOR_CODES: [u8; 30] = [
    65, 66, 67, 68, 69, 70, 71, 72, 100, 101, 102, 103, 104, 105, 106, 107, 108, 109, 110, 90, 91, 125, 126, 9, 10, 13, 14, 40,
    0x2E, 0x31,
];

/// The bus.
#[derive(Debug)]
pub(crate) struct SimulatedBus {
    pub(crate) settings: Settings,
    pub(crate) slaves: Vec<Slave>,
    pub(crate) poll: Vec<PollItem>,
    pub(crate) proprietary_functions: [ProprietaryFunction; 4],
    /// The next entry of the poll list.
    pub(crate) turn: usize,
}

impl SimulatedBus {
    pub(crate) fn new(scenario: &Scenario, rng: &mut Rng) -> Self {
        let settings = settings(scenario.framing, rng);
        let slaves = slaves(scenario, rng);
        if let Some(repeated) = &scenario.repeated {
            let poll = repeated.cycle(&slaves, rng);
            return Self { settings, slaves, poll, proprietary_functions: proprietary_functions(rng), turn: 0 };
        }
        let proprietary_functions = proprietary_functions(rng);
        let mut poll = Vec::new();
        for (slave, device) in slaves.iter().enumerate() {
            for _ in 0..rng.range(2, 5) {
                let function = [1, 2, 3, 4][rng.weighted(&[10, 10, 55, 25])];
                poll.push(PollItem { slave, pdu: reads::read(function, device, rng) });
            }
        }
        Self { settings, slaves, poll, proprietary_functions, turn: 0 }
    }
}

fn settings(framing: Framing, rng: &mut Rng) -> Settings {
    let baud = [9600, 19_200, 38_400, 57_600, 115_200][rng.weighted(&[5, 4, 1, 1, 2])];
    let eleven = rng.chance(2.0 / 3.0);
    match framing {
        Framing::Rtu => Settings { baud, data_bits: 8, has_even_parity: eleven },
        Framing::Ascii => Settings { baud, data_bits: 7, has_even_parity: true },
    }
}

/// 3 to 8 slaves with different units.
fn slaves(scenario: &Scenario, rng: &mut Rng) -> Vec<Slave> {
    let mut slaves: Vec<Slave> = Vec::new();
    let count = scenario.repeated.as_ref().map_or_else(|| rng.range(3, 8), Repeated::slaves);
    while slaves.len() < count {
        let unit = unit(scenario.quirk > 0.0, rng);
        if slaves.iter().any(|slave| slave.unit == unit) {
            continue;
        }
        slaves.push(Slave {
            unit,
            response_time_ns: match &scenario.repeated {
                Some(repeated) => 1e6 * repeated.response_ms,
                None => rng.log_normal(10e6, 0.6),
            },
            enron: rng.chance(scenario.enron),
            quirk: rng.chance(scenario.quirk),
            lower_case: rng.chance(scenario.lower_case),
            registers: Registers::new(scenario.zero_heavy),
        });
    }
    slaves
}

fn unit(reserved_too: bool, rng: &mut Rng) -> u8 {
    if reserved_too && rng.chance(0.2) {
        rng.range(247, 255) as u8
    } else if rng.chance(0.8) {
        rng.range(1, 30) as u8
    } else {
        rng.range(1, 247) as u8
    }
}

fn proprietary_functions(rng: &mut Rng) -> [ProprietaryFunction; 4] {
    let mut codes = VENDOR_CODES;
    std::array::from_fn(|at| {
        let chosen = rng.range(at, codes.len() - 1);
        codes.swap(at, chosen);
        let style = match rng.below(3) {
            0 => LengthStyle::Fixed { request: rng.range(0, 12), response: rng.range(0, 40) },
            1 => LengthStyle::Counted,
            _ => LengthStyle::Random,
        };
        ProprietaryFunction { code: codes[at], style }
    })
}
