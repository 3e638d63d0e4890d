//! Finds what the rules of a dialect match in a line.

use crate::text::dialect::Dialect;
use crate::text::frame_evidence;
use crate::text::reader::{counts, Reader};
use crate::text::role::LineRole;
use crate::text::template::{LineMatch, MatchContext, Template};

/// The most matches that are taken from one line.
const MAX_MATCHES_PER_LINE: usize = 64;

impl Reader {
    /// Collects all matches of a row in the line. Returns false, and forgets what the timestamps of the line have shown, if
    /// there is none or if the row cannot read the line to its end.
    pub(super) fn collect_matches(&mut self, dialect: &Dialect, line: &[u8]) -> bool {
        self.matches.clear();
        self.found.clear();
        let (mut from, mut front, mut must_reach_line_end) = (0, 0, false);
        let saved_state = self.timestamps.state;
        while from < line.len() && self.matches.len() < MAX_MATCHES_PER_LINE {
            let Some((role, mut found, to_line_end)) = self.next_match(dialect, line, from) else { break };
            // Plain bytes count as announced only if a header line announced them or they prove themselves.
            if role == LineRole::Continuation
                && dialect.has_headers
                && found.offset.is_none()
                && !self.assembler.expects_continuation()
                && !frame_evidence::is_whole_frame(&self.bytes)
            {
                self.timestamps.state = saved_state;
                return false;
            }
            let are_numbers = dialect.is_plain_hex && found.side.is_none() && counts::are_numbers(line, &self.bytes);
            if are_numbers || counts::are_time(line, &found, &self.bytes) {
                (from, must_reach_line_end) = (found.end.max(from + 1), to_line_end);
                continue;
            }
            let skipped = usize::from(dialect.generic && counts::begins_with_count(line, &found, &self.bytes));
            self.found.extend_from_slice(&self.bytes[skipped..]);
            if let Some((start, end)) = found.key {
                found.key = Some((self.assembler.key(line[start..end].trim_ascii()), 0));
            }
            if found.time.is_none() && found.start > front {
                found.time = self.timestamps.find(&line[front..found.start]);
            }
            (from, must_reach_line_end) = (found.end.max(from + 1), to_line_end);
            front = from;
            self.matches.push((role, found, self.found.len()));
        }
        self.tail = self.matches.last().map_or(from, |(_, found, _)| if found.bytes_end > 0 { found.bytes_end } else { from });
        let tail = line.get(from..).unwrap_or(&[]);
        let is_read_to_end =
            if must_reach_line_end { tail.iter().all(|b| b" \t\r.,;*`_|]}\"'".contains(b)) } else { may_follow(tail) };
        let is_read = is_read_to_end && !self.matches.is_empty();
        if !is_read {
            self.timestamps.state = saved_state;
        }
        is_read
    }

    /// The match to be taken next: that of the first rule without bytes that matches, or else the match with bytes that
    /// begins first, where the earlier rule wins a tie. Its bytes are in `self.bytes`. The boolean says that the match has
    /// to reach the end of the line.
    fn next_match(&mut self, dialect: &Dialect, line: &[u8], from: usize) -> Option<(LineRole, LineMatch, bool)> {
        let anchors = &dialect.anchors;
        for i in 0..anchors.first_rule_with_bytes {
            let found = self.try_rule(dialect, i, |template, scratch| template.find(line, from, scratch));
            if found.is_some() {
                return found;
            }
        }
        let mut unanchored = None;
        for &i in &anchors.unanchored {
            unanchored =
                self.try_rule(dialect, i, |template, scratch| template.find(line, from, scratch)).map(|found| (i, found));
            if unanchored.is_some() {
                break;
            }
        }
        let mut at = from;
        while let Some(start) = anchors.next(line, at) {
            let before = |i: usize| unanchored.as_ref().is_none_or(|(rule, (_, found, _))| (start, i) < (found.start, *rule));
            for i in anchors.rules(line, start, dialect.rules.len()).take_while(|&i| before(i)) {
                if !dialect.rules[i].1.may_begin(line, start) {
                    continue;
                }
                let found = self.try_rule(dialect, i, |template, scratch| template.match_at(line, start, scratch));
                if found.is_some() {
                    return found;
                }
            }
            if !before(0) {
                break;
            }
            at = start + 1;
        }
        let (i, found) = unanchored?;
        // The attempts at later positions have overwritten `self.bytes`, so the match is repeated.
        if at > from {
            return self.try_rule(dialect, i, |template, scratch| template.find(line, from, scratch));
        }
        Some(found)
    }

    /// Tries one rule. If it does not match, what its timestamps have shown is forgotten.
    fn try_rule(
        &mut self,
        dialect: &Dialect,
        index: usize,
        find: impl FnOnce(&Template, &mut MatchContext<'_>) -> Option<LineMatch>,
    ) -> Option<(LineRole, LineMatch, bool)> {
        let (role, template) = &dialect.rules[index];
        let saved_state = self.timestamps.state;
        let found = find(template, &mut MatchContext::new(&mut self.timestamps, &mut self.bytes, &mut self.preferred));
        if found.is_none() {
            self.timestamps.state = saved_state;
        }
        found.map(|found| (*role, found, template.must_reach_line_end))
    }
}

/// Whether `tail` may follow the last bytes of a line: nothing, text in a column of its own, or text that begins with
/// punctuation, such as the bytes as characters, their count, or a comment.
fn may_follow(tail: &[u8]) -> bool {
    let text = tail.trim_ascii();
    let is_own_column = tail.len() - tail.trim_ascii_start().len() >= 2 || tail.starts_with(b"\t");
    is_own_column || text.first().is_none_or(|b| !b.is_ascii() || b"([{|<>\"',.;)]}*#".contains(b))
}
