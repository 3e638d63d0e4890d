//! Finds the `SunSpec` models of a device from the traffic: the marker `SunS` and the chain of models after it, as a
//! master reads them.
//!
//! The marker is at address 40000, 50000 or 0 of the holding registers. After it the models follow each other,
//! each with its number and its length; model number 65535 ends the chain (`SunSpec` Device Information Model
//! Specification, 2021, section 6).

use crate::profile::{Device, Profile, ProfileFormat, SUNSPEC};

/// The addresses at which the specification allows the marker.
const BASES: [u16; 3] = [40_000, 50_000, 0];

/// The two registers of the marker.
const MARKER: [u8; 4] = *b"SunS";

/// The model number that ends the chain.
const END_OF_CHAIN: u16 = 0xFFFF;

/// The address of the marker, if this block of holding registers contains it.
pub fn marker(first: u16, bytes: &[u8]) -> Option<u16> {
    BASES.into_iter().find(|&base| two_registers(first, bytes, base).is_some_and(|two_registers| two_registers == MARKER))
}

/// Whether a block of this many registers contains an address at which the marker may begin.
pub fn may_begin_in(first: u16, count: usize) -> bool {
    BASES.into_iter().any(|base| base >= first && usize::from(base - first) < count)
}

/// The models of one unit, as far as they were read.
#[derive(Debug, Default)]
pub struct Chain {
    /// Number and address of each model.
    models: Vec<(u16, u16)>,
    /// Address of the next model header; `None` before the marker and after the end of the chain.
    next: Option<u16>,
}

impl Chain {
    /// Follows the chain through a block of holding registers that was read. Returns whether a new model was found.
    pub fn follow(&mut self, first: u16, bytes: &[u8]) -> bool {
        if self.next.is_none() && self.models.is_empty() {
            self.next = marker(first, bytes).map(|base| base + 2);
        }
        let known = self.models.len();
        while let Some(at) = self.next {
            let Some(header) = two_registers(first, bytes, at) else { break };
            let (number, length) = (u16::from_be_bytes([header[0], header[1]]), u16::from_be_bytes([header[2], header[3]]));
            let next_address = u32::from(at) + 2 + u32::from(length);
            if number != END_OF_CHAIN {
                self.models.push((number, at));
            }
            self.next = u16::try_from(next_address).ok().filter(|_| number != END_OF_CHAIN && number != 0);
        }
        self.models.len() > known
    }

    /// The profile of all models so far, moved to their addresses. Models that modlens has no profile of are left out.
    pub fn profile(&self) -> Profile {
        let device = Device { id: Some("sunspec".into()), vendor: Some("SunSpec".into()), ..Device::default() };
        let mut whole = Profile { device, points: Vec::new() };
        for (scope, (number, at)) in self.models.iter().enumerate() {
            let text = SUNSPEC.iter().find(|(known, _)| known == number).map(|(_, text)| text);
            let model = text.and_then(|text| Profile::parse(text, ProfileFormat::Toml).ok());
            for mut point in model.into_iter().flat_map(|model| model.points) {
                point.scope = scope as u16;
                let Some(address) = point.address.checked_add(*at) else { continue };
                point.address = address;
                whole.points.push(point);
            }
        }
        whole
    }
}

/// The bytes of two registers of a block; `None` if the block does not contain both.
fn two_registers(first: u16, bytes: &[u8], at: u16) -> Option<&[u8]> {
    let start = 2 * usize::from(at.checked_sub(first)?);
    bytes.get(start..start + 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_is_followed_over_several_reads() {
        let mut chain = Chain::default();
        assert!(!chain.follow(39_999, b"\0\0Su"));
        assert!(chain.follow(40_000, b"SunS\x00\x01\x00\x42"));
        assert!(!chain.follow(40_002, &[0; 132]));
        assert!(chain.follow(40_070, &[0, 103, 0, 50]));
        assert!(!chain.follow(40_122, &[0xFF, 0xFF, 0, 0]));
        assert_eq!(chain.models, [(1, 40_002), (103, 40_070)]);
        let profile = chain.profile();
        let named = |name: &str| profile.points.iter().find(|point| point.name == name).unwrap().address;
        assert_eq!(named("Mn"), 40_004);
        assert_eq!(named("A"), 40_072);
    }
}
