//! Which templates may begin at a place, told from two bytes: nearly everywhere it is none.

use crate::framer::rtu::autopsy::align::MOST_LOST;
use crate::framer::rtu::autopsy::template::Template;

/// Templates, one bit each.
type Set = u128;

/// The most templates that are told apart.
pub const MOST: usize = Set::BITS as usize;

/// For the first bytes of a template and every value: the templates that have it there.
pub struct Index {
    values: Vec<[Set; 256]>,
}

impl Index {
    /// The index of these templates, `MOST` of them at most.
    pub fn new(templates: &[Template]) -> Self {
        let mut values = vec![[0; 256]; MOST_LOST + 2];
        for (at, template) in templates.iter().enumerate() {
            for (place, &byte) in template.bytes.iter().enumerate().take(MOST_LOST + 2) {
                values[place][usize::from(byte)] |= 1 << at;
            }
            // Behind the bytes that are known anything may stand.
            for set in values.iter_mut().skip(template.bytes.len()).flatten() {
                *set |= 1 << at;
            }
        }
        Self { values }
    }

    /// Templates whose unit or function code stands here, or two of whose next bytes do, the first ones missing.
    pub fn possible(&self, bytes: &[u8]) -> Set {
        let Some(&first) = bytes.first() else { return 0 };
        let second = bytes.get(1).copied();
        let has = |place: usize, byte: u8| self.values[place][usize::from(byte)];
        let mut set = has(0, first);
        if let Some(second) = second {
            set |= has(1, second);
            set |= (1..=MOST_LOST).fold(0, |set, head| set | has(head, first) & has(head + 1, second));
        }
        // A single byte left of a short template.
        set | if second.is_none() { has(1, first) } else { 0 }
    }
}
