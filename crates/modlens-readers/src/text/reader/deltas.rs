//! Times as differences to the line before: their sum, as long as it is one run of the program.

use crate::text::timestamps::{delta, TimestampParser};
use modlens_protocol::Ns;

/// Commands that start a program of Node, which prints such differences.
const COMMANDS: [&str; 8] = ["node ", "nodemon", "npm ", "npx ", "yarn ", "ts-node", "pm2 ", "node-red"];

/// Whether a line without bytes ends a run of the program or begins one: a key that stops it, or the command that starts it
/// after the prompt of a shell.
fn is_start(text: &[u8]) -> bool {
    let text = String::from_utf8_lossy(text);
    let command = ["$ ", "# ", "> ", "% "].iter().find_map(|prompt| text.split_once(prompt)).map(|(_, command)| command);
    let is_restart = text.contains("[nodemon]") && text.contains("start");
    text.starts_with("^C") || is_restart || command.is_some_and(|command| COMMANDS.iter().any(|known| command.starts_with(known)))
}

/// The runs of the program that printed a text.
#[derive(Debug, Default)]
pub(super) struct Runs {
    /// It was started again since the last printed difference.
    is_new: bool,
}

impl Runs {
    /// Notes a line without bytes.
    pub fn note(&mut self, text: &[u8]) {
        self.is_new |= is_start(text);
    }

    /// The time at the end of a line with such a difference. The first difference of a run, which is 0, says nothing about the
    /// time since the last one.
    pub fn time(&mut self, text: &[u8], timestamps: &mut TimestampParser) -> Option<Ns> {
        let delta = delta(text)?;
        if std::mem::take(&mut self.is_new) && delta == 0 {
            timestamps.restart_deltas();
        }
        Some(timestamps.add_delta(delta))
    }
}

#[cfg(test)]
mod tests {
    use super::is_start;

    #[test]
    fn a_program_starts_after_a_prompt() {
        for text in ["^C", "root@DietPi:/home# node test.js", "$ npm start", "[nodemon] restarting due to changes..."] {
            assert!(is_start(text.as_bytes()), "{text}");
        }
        for text in ["SID:(1) Timed out", "unitid: 1,", "the node > 5 answers"] {
            assert!(!is_start(text.as_bytes()), "{text}");
        }
    }
}
