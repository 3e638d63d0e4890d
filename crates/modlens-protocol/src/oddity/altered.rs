//! Requests that came back with some of their bits changed.

/// So many bytes of an altered request, and this share of them (in quarters), are those that were sent.
const LEAST_ALIKE: usize = 6;
const LEAST_QUARTERS: usize = 3;

/// A distorted request that comes about by chance more often than this is none.
const MAX_CHANCE: f64 = 0.002;

/// A request that came back with some of its bits changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Altered {
    /// So many of its bytes are changed or missing.
    pub changed: u32,
    /// The bytes of the request.
    pub sent: u32,
    /// The first byte is among them, as where a driver is switched on late; not where all bytes lack their upper bits.
    pub is_from_first: bool,
}

impl Altered {
    /// How the bytes differ from the request, where they are the request with some of its bits changed.
    pub fn of(request: &[u8], bytes: &[u8]) -> Option<Self> {
        let same = request.iter().zip(bytes).filter(|(one, other)| one == other).count();
        is_altered(request, bytes).then(|| Self {
            changed: (request.len() - same) as u32,
            sent: request.len() as u32,
            is_from_first: request.first() != bytes.first() && !lacks_upper_bits(request, bytes),
        })
    }
}

/// Whether bytes are others without their upper bits, as a port with too few data bits reads them.
fn lacks_upper_bits(whole: &[u8], bytes: &[u8]) -> bool {
    [0x7F, 0x3F, 0x1F].iter().any(|mask| whole.iter().zip(bytes).all(|(one, other)| one & mask == *other))
}

/// Whether these bytes are an RTU request to read with some of its bits changed: in a byte or two, or in many, but all in the
/// same sense, as a wrong level or a weak driver changes them. A write is confirmed by its own bytes.
pub(super) fn is_altered(request: &[u8], bytes: &[u8]) -> bool {
    let same = request.iter().zip(bytes).filter(|(one, other)| one == other).count();
    let is_read = request.get(1).is_some_and(|function| (1..=4).contains(function));
    let is_alike = same >= LEAST_ALIKE && same * 4 >= bytes.len() * LEAST_QUARTERS && bytes.len() <= request.len();
    let is_distorted = bytes.len() == request.len() && bytes.len() >= LEAST_ALIKE && in_one_sense(request, bytes) < MAX_CHANCE;
    is_read && same < bytes.len() && (is_alike || is_distorted)
}

/// The chance that unrelated bytes, of which as many bits are 1, have a 1 wherever the request has one, or a 0 wherever it has
/// one; 1 where they have not.
fn in_one_sense(request: &[u8], bytes: &[u8]) -> f64 {
    let ones = |bytes: &[u8]| bytes.iter().map(|byte| byte.count_ones()).sum::<u32>();
    let share = f64::from(ones(bytes)) / (8 * bytes.len()) as f64;
    let all = |is: fn(u8, u8) -> bool| request.iter().zip(bytes).all(|(one, other)| is(*one, *other));
    let (sent_ones, sent_zeros) = (ones(request), 8 * request.len() as u32 - ones(request));
    if all(|one, other| one & !other == 0) {
        share.powi(sent_ones as i32)
    } else if all(|one, other| other & !one == 0) {
        (1.0 - share).powi(sent_zeros as i32)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unit 1, input registers 1000 and 1001; the checksum by the specification's algorithm.
    const SENT: [u8; 8] = [1, 4, 3, 0xE8, 0, 2, 0xF1, 0xBB];

    #[test]
    fn a_request_with_changed_bits_is_known() {
        let with = |mask: [u8; 8]| -> Vec<u8> { SENT.iter().zip(mask).map(|(byte, mask)| byte | mask).collect() };
        // One byte; then bits that were 0 and came as 1 all over the frame, and bits that were 1 and came as 0.
        assert!(is_altered(&SENT, &[1, 4, 3, 0xE8, 0, 2, 0x31, 0xBB]));
        assert!(is_altered(&SENT, &with([0xE0, 0xF0, 0xC0, 0x01, 0x80, 0x7C, 0x08, 0x40])));
        let without: Vec<u8> = SENT.iter().map(|byte| byte & 0x6D).collect();
        assert!(is_altered(&SENT, &without));
    }

    #[test]
    fn other_bytes_and_plain_levels_are_no_echo() {
        let write = [1, 6, 0, 1, 0, 3, 0x98, 0x0B];
        assert!(!is_altered(&write, &[1, 6, 0, 1, 0, 7, 0x98, 0x0B]));
        for other in
            [[0xFF; 8], [0; 8], [0x9A, 0x3C, 0xE1, 0x55, 0x47, 0xB2, 0x0D, 0x66], [0xF8, 0, 0xFF, 0xFE, 0, 0xFF, 0xFC, 0]]
        {
            assert!(!is_altered(&SENT, &other), "{other:?}");
        }
        assert!(!is_altered(&SENT, &SENT));
        // The answer of unit 1 with two input registers has nine bytes, and one that is cut has fewer of the same.
        assert!(!is_altered(&SENT, &[1, 4, 4, 0, 7, 0, 9, 0x5B]));
    }
}
