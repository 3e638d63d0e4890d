//! Which values a quantity may have, and how much less likely they are in registers of another meaning.

use std::ops::RangeInclusive;

/// Units, the values that devices of plants and houses may have in them, and the usual sizes of values that are not zero.
const RANGES: [(&[&str], RangeInclusive<f64>, RangeInclusive<f64>); 15] = [
    (&["V"], -1500.0..=1500.0, 1.0..=1500.0),
    (&["mV"], -60_000.0..=60_000.0, 10.0..=60_000.0),
    (&["A"], -5000.0..=5000.0, 0.01..=5000.0),
    (&["mA"], -100_000.0..=100_000.0, 1.0..=100_000.0),
    (&["W", "var", "VA"], -5e6..=5e6, 1.0..=5e6),
    (&["kW", "kvar", "kVA"], -1e5..=1e5, 0.01..=1e5),
    (&["Wh", "varh", "VAh"], -1e11..=1e11, 1.0..=1e10),
    (&["kWh", "kvarh", "kVAh"], -1e8..=1e8, 0.1..=1e7),
    (&["Hz"], 0.0..=500.0, 0.1..=500.0),
    (&["%"], -101.0..=201.0, 0.1..=150.0),
    (&["degC", "°C", "C"], -60.0..=400.0, 0.5..=200.0),
    (&["deg", "°"], -361.0..=361.0, 1.0..=360.0),
    (&["1/min", "rpm"], -30_000.0..=30_000.0, 10.0..=10_000.0),
    (&["bar"], -1.0..=1000.0, 0.01..=400.0),
    (&["Ah"], -1e6..=1e6, 0.1..=1e5),
];

/// Units of what only grows.
const TOTALS: [&str; 8] = ["Wh", "kWh", "MWh", "varh", "kvarh", "VAh", "kVAh", "Ah"];

/// The sizes of floats that devices hold.
const MAGNITUDES: RangeInclusive<f64> = 1e-6..=1e12;

/// The powers of two that floats of single precision have.
const FLOAT_OCTAVES: f64 = 254.0;

/// The frequencies of the mains.
const MAINS: RangeInclusive<f64> = 45.0..=65.0;

/// Whether a float may be a measured value.
pub(super) fn is_usual_float(number: f64) -> bool {
    number == 0.0 || MAGNITUDES.contains(&number.abs())
}

/// Whether a number may be a value in this unit.
pub(super) fn is_in_range(unit: &str, number: f64) -> bool {
    RANGES.iter().find(|row| row.0.contains(&unit)).is_none_or(|row| row.1.contains(&number))
}

/// What numbers say for their unit, in bits. Registers of another meaning are taken to hold numbers of every size alike:
/// each power of two of an integer of `bits` bits, of which `scale` is one, or of a float.
pub(super) fn worth(unit: &str, numbers: &[f64], bits: u32, scale: f64, is_float: bool) -> f64 {
    let is_mains = unit == "Hz" && numbers.iter().all(|number| MAINS.contains(number));
    let known = RANGES.iter().find(|row| row.0.contains(&unit)).map(|row| &row.2);
    let usual = if is_mains { Some(&MAINS) } else { known.or(is_float.then_some(&MAGNITUDES)) };
    let Some(usual) = usual.filter(|usual| numbers.iter().all(|number| *number == 0.0 || usual.contains(&number.abs()))) else {
        return 0.0;
    };
    if is_float {
        return (FLOAT_OCTAVES / (usual.end() / usual.start()).log2()).log2();
    }
    let all = f64::from(bits);
    let octave = |value: f64| (value / scale.abs()).log2().clamp(0.0, all);
    (all / (octave(*usual.end()) - octave(*usual.start())).max(0.25)).log2()
}

/// Whether what has this unit only grows.
pub(super) fn is_total(unit: &str) -> bool {
    TOTALS.contains(&unit)
}
