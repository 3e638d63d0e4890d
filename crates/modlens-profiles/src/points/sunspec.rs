//! `SunSpec` without a file: the marker `SunS` and the chain of models behind it, as a master reads them.
//!
//! The marker stands at 40000, 50000 or 0 of the holding registers; behind it models follow each other, each with its
//! number and its length, the last one with number 65535 (`SunSpec` Device Information Model Specification, 2021, 6).

use crate::profile::{Device, Form, Profile, SUNSPEC};

/// Where the marker may stand.
const BASES: [u16; 3] = [40_000, 50_000, 0];

/// The marker.
const MARKER: [u8; 4] = *b"SunS";

/// The number that ends the chain.
const END: u16 = 0xFFFF;

/// Where the marker stands in a block of holding registers.
pub fn marker(first: u16, bytes: &[u8]) -> Option<u16> {
    BASES.into_iter().find(|&base| words(first, bytes, base).is_some_and(|words| words == MARKER))
}

/// Whether the marker may begin in a block of so many registers.
pub fn may_begin_in(first: u16, count: usize) -> bool {
    BASES.into_iter().any(|base| base >= first && usize::from(base - first) < count)
}

/// What is known of a unit's models.
#[derive(Debug, Default)]
pub struct Chain {
    models: Vec<(u16, u16)>,
    next: Option<u16>,
}

impl Chain {
    /// A block of holding registers; whether a model was found that was not known before.
    pub fn see(&mut self, first: u16, bytes: &[u8]) -> bool {
        if self.next.is_none() && self.models.is_empty() {
            self.next = marker(first, bytes).map(|base| base + 2);
        }
        let before = self.models.len();
        while let Some(at) = self.next {
            let Some(head) = words(first, bytes, at) else { break };
            let (number, length) = (u16::from_be_bytes([head[0], head[1]]), u16::from_be_bytes([head[2], head[3]]));
            let behind = u32::from(at) + 2 + u32::from(length);
            if number != END {
                self.models.push((number, at));
            }
            self.next = u16::try_from(behind).ok().filter(|_| number != END && number != 0);
        }
        self.models.len() > before
    }

    /// The profile of all models so far, at their addresses; those that are not shipped have none.
    pub fn profile(&self) -> Profile {
        let device = Device { id: Some("sunspec".into()), vendor: Some("SunSpec".into()), ..Device::default() };
        let mut whole = Profile { device, points: Vec::new() };
        for (scope, (number, at)) in self.models.iter().enumerate() {
            let text = SUNSPEC.iter().find(|(known, _)| known == number).map(|(_, text)| text);
            let model = text.and_then(|text| Profile::parse(text, Form::Toml).ok());
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

/// Two registers of a block.
fn words(first: u16, bytes: &[u8], at: u16) -> Option<&[u8]> {
    let start = 2 * usize::from(at.checked_sub(first)?);
    bytes.get(start..start + 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_is_followed_over_several_reads() {
        let mut chain = Chain::default();
        assert!(!chain.see(39_999, b"\0\0Su"));
        assert!(chain.see(40_000, b"SunS\x00\x01\x00\x42"));
        assert!(!chain.see(40_002, &[0; 132]));
        assert!(chain.see(40_070, &[0, 103, 0, 50]));
        assert!(!chain.see(40_122, &[0xFF, 0xFF, 0, 0]));
        assert_eq!(chain.models, [(1, 40_002), (103, 40_070)]);
        let profile = chain.profile();
        let named = |name: &str| profile.points.iter().find(|point| point.name == name).unwrap().address;
        assert_eq!(named("Mn"), 40_004);
        assert_eq!(named("A"), 40_072);
    }
}
