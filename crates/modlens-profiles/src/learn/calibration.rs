//! What evidence is worth: stated bits are those of `calibration_table`, never more.

use crate::learn::calibration_table::{LAYOUTS, QUANTITIES, ROLES, SCALES};
use crate::learn::role::Role;

/// What a class with so many claims and mistakes is worth, in bits: the odds that one more claim is right, with one
/// right and one wrong claim added that nobody saw.
fn worth(claims: u32, wrong: u32) -> f64 {
    (f64::from(claims - wrong + 1) / f64::from(wrong + 1)).log2()
}

/// What the evidence for a layout is worth, in bits.
pub(super) fn layout_bits(raw: f64) -> f64 {
    LAYOUTS.iter().find(|class| raw >= class.0).map_or(0.0, |class| worth(class.1, class.2)).min(raw)
}

/// What the evidence for a role is worth, in bits.
pub(super) fn role_bits(role: Role) -> f64 {
    ROLES.iter().find(|row| row.0 == role).map_or(0.0, |row| worth(row.1, row.2))
}

/// What the evidence for a scale is worth, in bits.
pub(super) fn scale_bits(raw: f64) -> f64 {
    worth(SCALES.0, SCALES.1).min(raw)
}

/// What the evidence for a quantity is worth, in bits.
pub(super) fn quantity_bits(raw: f64) -> f64 {
    worth(QUANTITIES.0, QUANTITIES.1).min(raw)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_states_more_than_was_counted() {
        assert!((worth(127, 0) - 7.0).abs() < 1e-9 && worth(3, 3) < 0.0);
        assert!(layout_bits(60.0) <= worth(LAYOUTS[0].1, LAYOUTS[0].2) && layout_bits(1.0) <= 1.0);
        assert!(role_bits(Role::Measurement) > role_bits(Role::Heartbeat));
        assert!(scale_bits(60.0) <= worth(SCALES.0, SCALES.1) && quantity_bits(7.0) <= 7.0);
    }
}
