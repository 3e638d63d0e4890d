//! What is said of a few frames: too few for a verdict, and worth reading all the same.

use modlens_protocol::decimal::thousands;

use crate::claim::were;
use crate::contrast::odd_run::OddRun;
use crate::contrast::told::{Told, REQUEST};
use crate::statistics::Share;

/// The requests whose outcome the recording does not show, beside others.
pub(super) fn beside(share: Share, open: u64) -> String {
    match open {
        _ if share.total == 0 || open == 0 => String::new(),
        1 => String::from("; no answer to another one is in the recording"),
        count => format!("; no answer to {count} others is in the recording"),
    }
}

/// What is said of a few requests with whole frames that were all answered: what they say, and, unless others are `open`, where to
/// look. A program that `overhears` has received its requests, too.
pub(super) fn nothing_wrong(requests: u64, told: Option<&Told>, is_open: bool, overhears: bool) -> String {
    let first = told.and_then(|told| told.answered.as_ref());
    let answered = match requests {
        1 => format!("1 request was answered{}", first.map_or(String::new(), |what| format!(": {what}"))),
        count => {
            format!("all {count} requests were answered{}", first.map_or(String::new(), |what| format!("; the first: {what}")))
        }
    };
    let few = if requests == 1 { "1 request is" } else { "they are" };
    if overhears {
        return format!("{OVERHEARD}. The frames are whole: {answered}; {few} too few to judge the line");
    }
    let rest = if is_open { format!("; {few}") } else { format!(". {OUTSIDE}; {few}") };
    format!("Nothing is wrong in these frames: {answered}{rest} too few to judge the line")
}

/// What is said where a request and its answer were received together.
const OVERHEARD: &str =
    "What was received is a request and, right after it, its answer. That is right in the log of a program that only listens; a \
                         master that receives this hears itself (own_echo), and takes its request for the answer";

/// Where to look if the frames are right.
const OUTSIDE: &str =
    "If something fails, it is not in these bytes: look at what the program makes of them (address, data type, word order), and \
                       at what is not printed here";

/// What is said of whole frames of which each is a request, or an answer, without the other half.
pub(super) fn without_other_half(told: &Told) -> Option<String> {
    let (what, rest) = told.alone.split_first()?;
    let what = if rest.is_empty() { format!("it is {what}") } else { format!("the first is {what}") };
    let has_answers = told.alone.iter().any(|one| !one.starts_with(REQUEST));
    let missing = if has_answers { "what was asked for" } else { "whether an answer came" };
    let frames = if rest.is_empty() { "this frame" } else { "these frames" };
    Some(format!("Nothing is wrong in {frames}: {what}. The recording does not show {missing}."))
}

/// Said where nothing was read.
const NO_FRAME: &str = "no frame of Modbus was read; of a network capture, --port names the port if it is not 502";

/// Why so few requests are no ground for a verdict, and what came of them all the same: who pastes three lines of a log into a
/// file wants to hear that they were read.
pub(super) fn too_few(
    share: Share,
    refused: Share,
    (has_none, is_whole): (bool, bool),
    of_no_frame: u64,
    odd: Option<&OddRun>,
) -> String {
    let requests = match share.total {
        0 if has_none => return NO_FRAME.to_owned(),
        0 if is_whole => {
            return "the recording does not show the outcome of any request; what it holds are whole frames".to_owned()
        }
        0 => return "the recording does not show the outcome of any request".to_owned(),
        1 => "1 request is too few".to_owned(),
        count => format!("{count} requests are too few"),
    };
    let failed = match share.failed {
        0 if refused.failed == 0 && of_no_frame > 1 => {
            let shown = odd.map_or(String::new(), OddRun::words);
            format!("; what was asked was answered, and {} bytes are of no valid frame{shown}", thousands(of_no_frame))
        }
        0 if refused.failed == 0 => String::from("; what was asked was answered"),
        0 => String::new(),
        count => format!("; {count} of {} failed", share.total),
    };
    let refusals = match refused.failed {
        0 => String::new(),
        count => format!("; {} refused (exception)", were(count)),
    };
    format!("{requests}{failed}{refusals}")
}
