//! The lengths of frames as other tools know them, by a table in the program that has no proprietary functions.

/// The length of a request that begins with these bytes, if the table has its function.
pub(crate) fn request_length(frame: &[u8]) -> Option<usize> {
    let counted = |at: usize, base: usize| frame.get(at).map(|&count| base + usize::from(count));
    match frame.get(1)? {
        1..=6 | 8 => Some(8),
        7 | 11 | 12 | 17 => Some(4),
        15 | 16 => counted(6, 9),
        20 | 21 => counted(2, 5),
        22 => Some(10),
        23 => counted(10, 13),
        24 => Some(6),
        _ => None,
    }
}

/// The length of a response that begins with these bytes, if the table has its function.
pub(crate) fn response_length(frame: &[u8]) -> Option<usize> {
    let counted = |at: usize, base: usize| frame.get(at).map(|&count| base + usize::from(count));
    match frame.get(1)? {
        0x80.. | 7 => Some(5),
        1..=4 | 12 | 17 | 20 | 21 | 23 => counted(2, 5),
        5 | 6 | 8 | 11 | 15 | 16 => Some(8),
        22 => Some(10),
        24 => Some(6 + usize::from(u16::from_be_bytes([*frame.get(2)?, *frame.get(3)?]))),
        _ => None,
    }
}

/// Whether a whole frame can be a request; true for functions that the table does not have.
pub(crate) fn fits_request(frame: &[u8]) -> bool {
    match frame[1] {
        0x80.. => false,
        8 => frame.len() >= 8,
        43 if frame.get(2) == Some(&14) => frame.len() == 7,
        _ => request_length(frame).is_none_or(|length| length == frame.len()),
    }
}

/// Whether a whole frame can be a response; true for functions that the table does not have.
pub(crate) fn fits_response(frame: &[u8]) -> bool {
    match frame[1] {
        8 => frame.len() >= 8,
        43 if frame.get(2) == Some(&14) => frame.len() >= 10,
        _ => response_length(frame).is_none_or(|length| length == frame.len()),
    }
}
