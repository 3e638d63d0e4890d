//! The last date and second of a log, which the next line nearly always repeats.

use modlens_protocol::Ns;

/// The text of the last timestamp up to its seconds, with its value. Most lines are logged within the same second as the
/// line before, so comparing texts replaces parsing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CachedSecond {
    text: [u8; MAX_SECOND_CHARS],
    length: usize,
    /// Days since 1970-01-01, where the timestamp has a date.
    days: Option<i64>,
    /// Nanoseconds since midnight.
    ns_of_day: Ns,
}

/// The longest cached text: a date, a separator and a time of day, with room for long separators.
const MAX_SECOND_CHARS: usize = 24;

impl CachedSecond {
    /// The cached date and second, and the rest of the line, if the line begins with the cached text.
    pub fn lookup<'a>(&self, line: &'a [u8]) -> Option<(Option<i64>, Ns, &'a [u8])> {
        let rest = line.strip_prefix(&self.text[..self.length])?;
        (self.length > 0).then_some((self.days, self.ns_of_day, rest))
    }

    /// Caches the value of a text; a text that is too long clears the cache.
    pub fn store(&mut self, text: &[u8], days: Option<i64>, ns_of_day: Ns) {
        self.length = 0;
        if let Some(place) = self.text.get_mut(..text.len()) {
            place.copy_from_slice(text);
            (self.length, self.days, self.ns_of_day) = (text.len(), days, ns_of_day);
        }
    }
}
