//! The runs of bytes in a line: in the first notation in which it holds frames, and how many bytes of hex it has.

use std::ops::Range;

use crate::text::notation::{Notation, NotationFlags};
use crate::text::proved::frames;
use crate::text::proved::runs::{half_prefixed_runs, hex_runs, number_runs, Run, Style};
use crate::text::proved::sender::sender;
use crate::text::timestamps::delta;
use modlens_protocol::checksum::lrc;
use modlens_protocol::hex::decode_pairs;

/// Longer lines are read in parts of this length.
const MAX_PART_CHARS: usize = 1 << 15;

/// The most escaped strings that are read in one line.
const MAX_STRINGS: usize = 16;

/// The characters of a byte that stands apart: two digits and what separates it from the next one.
const CHARS_OF_BYTE: usize = 3;

/// A string with escape sequences holds bytes from so many on.
const MIN_ESCAPED_BYTES: usize = 4;

/// A word of so many hex digits is more than a number.
const MIN_ODD_DIGITS: usize = 7;

/// After a word that says who sent them, so few bytes count although other words follow.
const MIN_NAMED_BYTES: usize = 3;

/// A list of so many decimal numbers in brackets may be bytes.
const MIN_LIST_BYTES: usize = 4;

/// The digits of unit, function and LRC.
const MIN_ASCII_DIGITS: usize = 6;

/// So many words of two hex digits in a line are bytes, whatever stands between them.
const MIN_SCATTERED_BYTES: usize = 8;

/// Where the part of the line that begins at `start` ends: at its end, or at a blank.
pub(super) fn part_end(line: &[u8], start: usize) -> usize {
    let limit = line.len().min(start + MAX_PART_CHARS);
    if limit == line.len() {
        return limit;
    }
    line[start..limit].iter().rposition(|b| matches!(b, b' ' | b'\t' | b'"' | b'\'')).map_or(limit, |at| start + at + 1)
}

/// The longest run of bytes in a line, in hex or in a string with escape sequences.
pub(in crate::text) fn longest_hex(line: &[u8]) -> Option<Vec<u8>> {
    let part = &line[..part_end(line, 0)];
    let escaped = escaped_runs(part).into_iter().filter(|run| !is_path(part, run));
    let runs = hex_runs(part).into_iter().chain(escaped);
    runs.map(Run::without_number).map(|run| run.bytes).max_by_key(Vec::len)
}

/// The longest run of hex in a line that is no date; of short ones, which may be parts of a time, the last.
pub(in crate::text) fn hex_beside_dates(line: &[u8]) -> Option<Vec<u8>> {
    let part = &line[..part_end(line, 0)];
    let mut runs = hex_runs(part);
    runs.retain(|run| !is_other_text(part, &run.text));
    let all = runs.into_iter().map(Run::without_number).map(|run| run.bytes);
    all.max_by_key(|bytes| if bytes.len() < MIN_ESCAPED_BYTES { 0 } else { bytes.len() })
}

/// The bytes of a line that holds nothing else but the mark of a comment in front of them.
pub(in crate::text) fn only_hex(line: &[u8]) -> Option<Vec<u8>> {
    let is_mark = |b: &u8| matches!(b, b' ' | b'\t' | b'/' | b'#' | b'*' | b';');
    let start = line.iter().position(|b| !is_mark(b))?;
    let text = line[start..].trim_ascii_end();
    let [run] = <[Run; 1]>::try_from(hex_runs(text)).ok()?;
    (run.text == (0..text.len())).then_some(run.bytes)
}

/// The text of a line in front of its longest run of hex.
pub(in crate::text) fn hex_front(line: &[u8]) -> Option<&[u8]> {
    let run = hex_runs(&line[..part_end(line, 0)]).into_iter().max_by_key(|run| run.bytes.len())?;
    Some(&line[..run.text.start])
}

/// Characters that make an escape sequence after a backslash.
const ESCAPES: &[u8] = b"\\'\"0123456789abefnrtuvxX";

/// Whether a run that looks like a string with escape sequences is a path of Windows: after the letter of a drive, or with a
/// backslash before a letter that makes no sequence.
fn is_path(line: &[u8], run: &Run) -> bool {
    let text = &line[run.text.clone()];
    let Some(first) = memchr::memchr(b'\\', text).map(|at| run.text.start + at) else { return false };
    // A single letter: `RX:\x01` is none.
    let has_drive = match line[..first] {
        [b'A'..=b'Z', b':'] => true,
        [.., before, b'A'..=b'Z', b':'] => !before.is_ascii_alphanumeric(),
        _ => false,
    };
    let mut sequences = text.windows(2).filter(|pair| pair[0] == b'\\');
    has_drive || sequences.any(|pair| !ESCAPES.contains(&pair[1]))
}

/// The longest run of hex in a line whose bytes stand apart, so that it is no word or number.
pub(in crate::text) fn single_bytes(line: &[u8]) -> Option<Vec<u8>> {
    let runs = hex_runs(&line[..part_end(line, 0)]);
    let apart = |run: &Run| run.text.len() + 1 >= CHARS_OF_BYTE * run.bytes.len();
    runs.into_iter().filter(apart).map(Run::without_number).map(|run| run.bytes).max_by_key(Vec::len)
}

/// The bytes of a line that holds nothing but bytes in hex without leading zeros, `83 3 60 F2`.
pub(in crate::text) fn single_digits(line: &[u8]) -> Option<Vec<u8>> {
    let text = line.trim_ascii();
    let [run] = <[Run; 1]>::try_from(number_runs(text, Style::Loose)).ok()?;
    (run.text == (0..text.len())).then_some(run.bytes)
}

/// The bytes after a name and a sign that ends it, in hex without leading zeros: `wind : 83 3 6 F2`. One of them has a letter, and one
/// is a single digit.
pub(in crate::text) fn named_digits(line: &[u8]) -> Option<Vec<u8>> {
    let part = &line[..part_end(line, 0)];
    let is_named = |run: &Run| matches!(part[..run.text.start].trim_ascii_end(), [.., b':' | b'=' | b'>']);
    let words = |run: &Run| part[run.text.clone()].split(|b| !b.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    let is_hex =
        |run: &Run| words(run).any(|word| word.len() == 1) && words(run).any(|word| word.iter().any(u8::is_ascii_alphabetic));
    let runs = number_runs(part, Style::Loose).into_iter().filter(|run| is_named(run) && is_hex(run));
    runs.map(|run| run.bytes).max_by_key(Vec::len)
}

/// The runs with the positions of a line whose text from `start` on was searched.
pub(super) fn shifted(runs: Vec<Run>, start: usize) -> Vec<Run> {
    runs.into_iter().map(|run| run.shifted(start)).collect()
}

/// Runs, each with the positions of its frames.
type Proved = Vec<(Run, Vec<Range<usize>>)>;

/// The runs of the first notation in which the line holds frames, each with the positions of its frames; runs without a
/// frame stand among them.
pub(super) fn proved_runs(line: &[u8], start: usize) -> Proved {
    let part = &line[start..];
    let read: [&dyn Fn() -> Vec<Run>; 9] = [
        &|| hex_runs(part),
        &|| ascii_runs(part),
        &|| escaped_runs(part),
        &|| number_runs(part, Style::Decimal).into_iter().filter(|run| is_decimal(part, run)).collect(),
        &|| number_runs(part, Style::Loose),
        &|| number_runs(part, Style::Decimal),
        &|| number_runs(part, Style::Binary),
        &|| base64_runs(part),
        &|| half_prefixed_runs(part),
    ];
    for read in read {
        let found = proved(read(), start);
        if frame_bytes(&found) > 0 {
            return with_other_notations(part, start, found);
        }
    }
    Vec::new()
}

/// Finds the frames in runs of the text from `start` on.
fn proved(runs: Vec<Run>, start: usize) -> Proved {
    let frames = |run: &Run| if run.style == Style::Ascii { whole(run) } else { frames::prove(&run.bytes, &run.edges) };
    shifted(runs, start).into_iter().map(|run| (frames(&run), run)).map(|(frames, run)| (run, frames)).collect()
}

/// How many bytes the frames of these runs have.
fn frame_bytes(found: &Proved) -> usize {
    found.iter().flat_map(|(_, frames)| frames).map(Range::len).sum()
}

/// What was found as hex, or what else the line shows: its strings with escape sequences if they hold more, because a string
/// of which each byte is escaped looks like hex, and frames of Modbus ASCII in place of hex that is no frame.
fn with_other_notations(part: &[u8], start: usize, found: Proved) -> Proved {
    if !matches!(style_of_frames(&found), Style::Pairs | Style::Prefixed) {
        return found;
    }
    if memchr::memmem::find(part, b"\\x").is_some() {
        let strings = proved(escaped_runs(part), start);
        if frame_bytes(&strings) > frame_bytes(&found) {
            return strings;
        }
    }
    let is_free = |ascii: &Run| {
        let mut frames = found.iter().filter(|(_, frames)| !frames.is_empty());
        frames.all(|(run, _)| run.text.end <= ascii.text.start || ascii.text.end <= run.text.start)
    };
    let is_word = |run: &Run| !part[run.text.clone()].contains(&b' ');
    let ascii: Vec<Run> = ascii_runs(part).into_iter().filter(is_word).map(|run| run.shifted(start)).filter(is_free).collect();
    if ascii.is_empty() {
        return found;
    }
    let is_inside = |run: &Run| ascii.iter().any(|own| run.text.start < own.text.end && own.text.start < run.text.end);
    let mut all: Proved = found.into_iter().filter(|(run, _)| !is_inside(run)).collect();
    all.extend(ascii.iter().map(|run| (run.clone(), whole(run))));
    all.sort_by_key(|(run, _)| run.text.start);
    all
}

/// The notation of the runs that hold frames.
pub(super) fn style_of_frames(proved: &[(Run, Vec<Range<usize>>)]) -> Style {
    proved.iter().find(|(_, frames)| !frames.is_empty()).map_or(Style::Pairs, |(run, _)| run.style)
}

/// The position of a frame that is the whole run.
fn whole(run: &Run) -> Vec<Range<usize>> {
    std::iter::once(0..run.bytes.len()).collect()
}

/// Whether the numbers are decimal rather than hex without leading zeros: there are commas, or numbers of three digits.
fn is_decimal(line: &[u8], run: &Run) -> bool {
    let text = &line[run.text.clone()];
    text.contains(&b',')
        || text.chunk_by(|a, b| a.is_ascii_digit() == b.is_ascii_digit()).any(|part| part.len() == 3 && part[0].is_ascii_digit())
}

/// Frames of Modbus ASCII: a colon and pairs of hex digits with a valid LRC and a known layout.
fn ascii_runs(line: &[u8]) -> Vec<Run> {
    let mut runs = Vec::new();
    for colon in memchr::memchr_iter(b':', line) {
        // People put a blank in front of the LRC, or between all bytes.
        let may_stand = |at: usize| {
            let is_between =
                line[at] == b' ' && line[at - 1].is_ascii_hexdigit() && line.get(at + 1).is_some_and(u8::is_ascii_hexdigit);
            line[at].is_ascii_hexdigit() || is_between
        };
        let end = (colon + 1..line.len()).find(|&at| !may_stand(at)).unwrap_or(line.len());
        let digits: Vec<u8> = line[colon + 1..end].iter().copied().filter(u8::is_ascii_hexdigit).collect();
        let mut bytes = Vec::new();
        let is_word = !line.get(end).is_some_and(u8::is_ascii_alphanumeric);
        let are_bytes = digits.len() >= 8 && digits.len().is_multiple_of(2) && decode_pairs(&digits, &mut bytes);
        if is_word && are_bytes && lrc(&bytes) == 0 && frames::fits_known_function(&bytes[1..bytes.len() - 1]) {
            let bytes = [b":", &digits[..], b"\r\n"].concat();
            runs.push(Run::whole(Style::Ascii, colon..end, bytes));
        }
    }
    runs
}

/// What looks like a frame of Modbus ASCII and is none, because of its checksum or because it is cut: a colon that ends no word, and
/// hex digits. Other lines of the text have to show that it prints such frames.
pub(super) fn damaged_ascii_runs(line: &[u8]) -> Vec<Run> {
    let starts = memchr::memchr_iter(b':', line).filter(|&colon| colon == 0 || !line[colon - 1].is_ascii_alphanumeric());
    let run = |colon: usize| {
        let digits = line[colon + 1..].iter().take_while(|b| b.is_ascii_hexdigit()).count();
        let end = colon + 1 + digits;
        let is_word = !line.get(end).is_some_and(u8::is_ascii_alphanumeric);
        (is_word && digits >= MIN_ASCII_DIGITS)
            .then(|| Run::whole(Style::Ascii, colon..end, [&line[colon..end], b"\r\n"].concat()))
    };
    starts.filter_map(run).collect()
}

/// Words of base64 that are a whole frame. They end with its padding or a quote, and not all of their letters are small, as
/// those of other words are.
fn base64_runs(line: &[u8]) -> Vec<Run> {
    let is_mark = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'+' | b'/' | b'=');
    let mut runs = Vec::new();
    let mut at = 0;
    while let Some(start) = line[at..].iter().position(u8::is_ascii_alphanumeric).map(|front| at + front) {
        let text = &line[start..];
        let text = &text[..text.iter().position(|b| !is_mark(b)).unwrap_or(text.len())];
        at = start + text.len();
        let ends = text.ends_with(b"=") || matches!(line.get(at), Some(b'"' | b'\''));
        let mut bytes = Vec::new();
        if ends
            && text.iter().any(u8::is_ascii_uppercase)
            && Notation::Base64.read(text, None, &mut bytes, &mut NotationFlags::default()) == Some(text.len())
            && frames::prove(&bytes, &[0, bytes.len()]).contains(&(0..bytes.len()))
        {
            runs.push(Run::whole(Style::Base64, start..at, bytes));
        }
    }
    runs
}

/// Strings with escape sequences, in quotes or up to the end of the line.
pub(super) fn escaped_runs(line: &[u8]) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut from = 0;
    while let Some(escape) = memchr::memchr(b'\\', &line[from..]).filter(|_| runs.len() < MAX_STRINGS).map(|at| from + at) {
        let quote = line[from..escape].iter().rposition(|b| matches!(b, b'"' | b'\'' | b'`')).map(|at| from + at);
        let start = quote.map_or(escape, |quote| quote + 1);
        let mut bytes = Vec::new();
        let stop = quote.map(|quote| line[quote]);
        let length = Notation::Escaped.read(&line[start..], stop, &mut bytes, &mut NotationFlags::default()).unwrap_or(0);
        // After the last quote of a line there may be further text, which is no byte.
        runs.push(Run::whole(Style::Escaped, start..start + length, bytes));
        from = (start + length).max(escape + 1);
    }
    runs
}

/// How many bytes of hex a line holds, but for short runs, for dates and times of day, and for UUIDs.
pub(in crate::text) fn hex_bytes(line: &[u8]) -> usize {
    let part = &line[..part_end(line, 0)];
    let counts = |run: &Run| run.bytes.len() >= 4 && !is_other_text(part, &run.text);
    let count: usize = hex_runs(part).iter().filter(|run| counts(run)).map(|run| run.bytes.len()).sum();
    let lists: usize = decimal_lists(part).iter().map(|run| run.bytes.len()).sum();
    if count > 0 {
        return count.max(lists);
    }
    // Bytes with other text between them, such as `00: 02, 01: 02`.
    let words = part.split(u8::is_ascii_whitespace).map(without_marks);
    let words = words.filter(|word| word.len() == 2 && word.iter().all(u8::is_ascii_hexdigit));
    let numbers = number_runs(part, Style::Decimal).into_iter().map(|run| run.bytes.len());
    let numbers: usize = numbers.filter(|count| *count >= MIN_SCATTERED_BYTES).sum();
    let scattered = words.count().max(numbers);
    if scattered.max(lists) >= MIN_SCATTERED_BYTES {
        return scattered.max(lists);
    }
    let escaped = escaped_strings(part).map(|run| run.bytes.len()).sum();
    digits_without_zeros(part).max(lists).max(escaped).max(labelled_bytes(part))
}

/// The strings of a line with escape sequences that hold more than a few bytes.
pub(super) fn escaped_strings(line: &[u8]) -> impl Iterator<Item = Run> + '_ {
    escaped_runs(line).into_iter().filter(|run| run.bytes.len() >= MIN_ESCAPED_BYTES && !is_path(line, run))
}

/// The lists of decimal numbers in a line that may be bytes: `[7, 131, 2, 97, 49]`.
pub(super) fn decimal_lists(line: &[u8]) -> Vec<Run> {
    let is_list = |run: &Run| {
        let text = &line[run.text.clone()];
        let is_open = line[..run.text.start].trim_ascii_end().last().is_some_and(|b| matches!(b, b'[' | b'{'));
        let as_hex: usize = hex_runs(text).iter().map(|run| run.bytes.len()).sum();
        is_open && run.bytes.len() >= MIN_LIST_BYTES && text.contains(&b',') && 2 * as_hex < run.bytes.len()
    };
    number_runs(line, Style::Decimal).into_iter().filter(is_list).collect()
}

/// About how many bytes are in a line that is a single word of hex without leading zeros, as `114BA4134`: an odd number of digits.
fn digits_without_zeros(line: &[u8]) -> usize {
    let word = without_marks(line.trim_ascii());
    let has = |is: fn(&u8) -> bool| word.iter().any(is);
    let is_hex = word.len() >= MIN_ODD_DIGITS && word.iter().all(u8::is_ascii_hexdigit);
    if is_hex && has(u8::is_ascii_alphabetic) && has(u8::is_ascii_digit) {
        word.len().div_ceil(2)
    } else {
        0
    }
}

/// How many bytes are at the end of a line after a colon, an arrow or `Buffer` and a word that says who sent them, be they ever
/// so few: `<--129-4`, `rx buffer <Buffer 01>`.
fn labelled_bytes(line: &[u8]) -> usize {
    // The time since the line before may follow: `<Buffer 01> +2ms`.
    let end = delta(line).and_then(|_| memchr::memrchr(b' ', line)).unwrap_or(line.len());
    let line = &line[..end];
    let is_last = |run: &Run| !line[run.text.end..].iter().any(u8::is_ascii_alphanumeric);
    let is_labelled = |run: &Run| {
        let front = line[..run.text.start].trim_ascii_end();
        let ends_label = front.ends_with(b"<Buffer") || matches!(front.last(), Some(b':' | b'>' | b'<' | b'-' | b'='));
        ends_label && (front.ends_with(b"<Buffer") || sender(front).is_some())
    };
    // `9600` is a number.
    let are_pairs = |run: &Run| run.text.len() + 1 >= CHARS_OF_BYTE * run.bytes.len() && run.style != Style::Suffixed;
    let hex = hex_runs(line).into_iter().filter(are_pairs);
    let decimal = number_runs(line, Style::Decimal).into_iter().filter(|run| run.bytes.len() > 1);
    let all = hex.chain(decimal).filter(|run| !is_other_text(line, &run.text));
    // After three bytes and more there may be names for those that the program puts in.
    let is_end = |run: &Run| is_last(run) || (run.style == Style::Pairs && run.bytes.len() >= MIN_NAMED_BYTES);
    all.filter(|run| is_end(run) && is_labelled(run)).map(|run| run.bytes.len()).max().unwrap_or(0)
}

/// Whether a line has words that are no hex, several of them.
pub(in crate::text) fn is_words(line: &[u8]) -> bool {
    let words = line.split(|b| !b.is_ascii_alphanumeric());
    words
        .filter(|word| word.len() > 2 && word.iter().all(u8::is_ascii_alphabetic))
        .filter(|word| !word.iter().all(u8::is_ascii_hexdigit))
        .take(2)
        .count()
        == 2
}

/// A word without the punctuation around it.
pub(super) fn without_marks(word: &[u8]) -> &[u8] {
    let Some(start) = word.iter().position(u8::is_ascii_alphanumeric) else { return &[] };
    let end = word.iter().rposition(u8::is_ascii_alphanumeric).map_or(start, |last| last + 1);
    &word[start..end]
}

/// Whether a text begins with a date such as `21.11.2026` or `11/21/2026`.
fn starts_with_day(text: &[u8]) -> bool {
    let mut parts = text.chunk_by(|one, other| one.is_ascii_digit() == other.is_ascii_digit()).map(<[u8]>::len);
    let lengths: [usize; 5] = std::array::from_fn(|_| parts.next().unwrap_or(0));
    matches!(lengths, [1 | 2, 1, 1 | 2, 1, 4]) && text[0].is_ascii_digit()
}

/// Whether a run of digits is a date, a time of day, a UUID, or the name of a program in front of its number, as syslog prints
/// that of a container: `be7606b67c2f[691]:`.
pub(super) fn is_other_text(line: &[u8], place: &Range<usize>) -> bool {
    let text = &line[place.clone()];
    let has_letters = text.iter().any(u8::is_ascii_alphabetic);
    let has_time = memchr::memchr_iter(b':', text).count() == 2;
    let has_year = matches!(text, [b'1' | b'2', b'9' | b'0', _, _, b'-' | b'/' | b'.', ..]);
    let has_day = starts_with_day(text);
    let is_uuid = text.len() == 36 && [8, 13, 18, 23].iter().all(|&at| text[at] == b'-');
    let behind = &line[place.end..];
    let number = behind.iter().skip(1).take_while(|b| b.is_ascii_digit()).count();
    let is_program = behind.first() == Some(&b'[') && number > 0 && behind[number + 1..].starts_with(b"]:");
    let is_word = text.iter().all(u8::is_ascii_alphanumeric);
    is_uuid || (is_word && is_program) || (!has_letters && text.len() < 30 && (has_time || has_year || has_day))
}
