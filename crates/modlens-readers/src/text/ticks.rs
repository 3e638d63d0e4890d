//! Whole numbers in front of lines that are times: milliseconds since 1970, and milliseconds since the start of a device, as
//! `[408464]` or as ESP-IDF prints them, `I (12345) TAG:`.

/// Milliseconds since 1970 have so many digits from 2001 to 2286.
const EPOCH_DIGITS: usize = 13;

/// The most digits of a number of milliseconds since any start.
const MAX_DIGITS: usize = 12;

/// How many lines with such a number are looked at.
const MAX_LINES: usize = 2000;

/// Numbers that count lines go up by one; times go up by at least so much on the average.
const MIN_MEAN_STEP: u64 = 2;

/// The digits of milliseconds since 1970 at the start of the line, and the rest of it.
pub(super) fn since_1970(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let digits = line.iter().take(EPOCH_DIGITS + 1).take_while(|b| b.is_ascii_digit()).count();
    let (text, rest) = line.split_at_checked(digits).filter(|_| digits == EPOCH_DIGITS && line[0] != b'0')?;
    rest.first().is_none_or(|b| matches!(b, b' ' | b'\t' | b':' | b']' | b',' | b';' | b'|')).then_some((text, rest))
}

/// The digits of a number at the start of the line that may be a time since any start, and the rest of the line.
pub(super) fn since_start(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let (inner, close) = match line {
        [b'E' | b'W' | b'I' | b'D' | b'V', b' ', b'(', rest @ ..] => (rest, b')'),
        [b'[', rest @ ..] => (rest, b']'),
        _ => return None,
    };
    let inner = inner.trim_ascii_start();
    let digits = inner.iter().take(MAX_DIGITS + 1).take_while(|b| b.is_ascii_digit()).count();
    // The offset of a dump, `[0010]`, has zeros in front.
    let has_zeros = digits > 1 && inner[0] == b'0';
    let is_number = !has_zeros && (1..=MAX_DIGITS).contains(&digits) && inner.get(digits) == Some(&close);
    is_number.then(|| (&inner[..digits], &inner[digits + 1..]))
}

/// Whether such numbers in the lines of a text are times: they go up, now and then by more than one, and begin again at most
/// where a device does.
pub(super) fn are_times<'a>(lines: impl Iterator<Item = &'a [u8]>) -> bool {
    let numbers = lines.filter_map(|line| {
        let (digits, _) = since_start(line.trim_ascii_start())?;
        std::str::from_utf8(digits).ok()?.parse::<u64>().ok()
    });
    let numbers: Vec<u64> = numbers.take(MAX_LINES).collect();
    let steps = || numbers.windows(2).map(|two| (two[0], two[1]));
    let (back, sum) = steps().fold((0, 0u64), |(back, sum), (one, next)| match next.checked_sub(one) {
        Some(step) => (back, sum.saturating_add(step)),
        None => (back + 1, sum),
    });
    let count = steps().count();
    count > 0 && 4 * back <= count && sum >= MIN_MEAN_STEP * count as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_go_up_like_times_are_times() {
        for (text, are) in [
            ("[408464] TX 01\n[408484] RX 02\n", true),
            ("I (312) mb: 01\nW (1312) mb: 02\nI (20) mb: 03\nI (40) mb: 01\nI (40) mb: 01\n", true),
            ("[1000] TX 01\n[1001] RX 02\n[1002] TX 03\n", false),
            ("[1234] TX 01\n[1234] RX 02\n", false),
            ("[0000] 01 03\n[0010] 02 03\n", false),
            ("[12] TX 01\n", false),
            ("TX [8] 01\nTX [5] 03\n", false),
        ] {
            assert_eq!(are_times(text.lines().map(str::as_bytes)), are, "{text}");
        }
    }

    #[test]
    fn thirteen_digits_are_milliseconds_since_1970() {
        assert_eq!(since_1970(b"1763724605250 TX"), Some((&b"1763724605250"[..], &b" TX"[..])));
        assert_eq!(since_1970(b"176372460525 TX"), None);
        assert_eq!(since_1970(b"01030600010002 TX"), None);
    }
}
