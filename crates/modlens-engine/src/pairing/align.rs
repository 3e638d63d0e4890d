//! The order of frames on the two lines of a bus where no clock tells it.
//!
//! On each line frames come in order, and each side has its own line: requests stand on one, answers on the other. What
//! an answer repeats of its request (unit, function, length, address) says which belong together, and the two lines
//! are laid beside each other as sequences are: pairs save bits, requests without an answer and answers without a
//! request cost some. A window of each line is looked at, and the first half of what comes out best is told; where
//! little fits, because bytes of one line are missing, a far wider one.

use modlens_protocol::direction::{answers, Asked, Direction, Match};
use modlens_protocol::framing::BROADCAST;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

/// Frames of each line that are weighed at once, where most of them are paired.
const NEAR: usize = 24;

/// Frames of each line that are weighed where not: that many must be known before any is told.
pub const WINDOW: usize = 192;

/// Bits that an answer is worth which agrees in all that it repeats, in part, or in unit and function only.
const FULLY: f32 = 16.0;
const PARTLY: f32 = 4.0;
/// An exception repeats no more than unit and function.
const REFUSAL: f32 = 10.0;
/// One of the two is damaged: unit and function are all that is known for sure.
const DAMAGED: f32 = 5.0;

/// Costs of a request without an answer, of one that comes again at once, and of an answer without request.
const UNANSWERED: f32 = 5.0;
const ASKED_AGAIN: f32 = 2.0;
const ORPHAN: f32 = 6.0;

/// A frame as far as its place among others needs it.
#[derive(Clone, Debug)]
pub struct Heard {
    /// Who sent it.
    pub direction: Direction,
    /// Its checksum is right.
    pub good: bool,
    /// Unit and PDU; empty for noise.
    pub adu: Vec<u8>,
}

impl Heard {
    fn pdu(&self) -> &[u8] {
        self.adu.get(1..).unwrap_or(&[])
    }

    /// Neither asks for an answer nor is one.
    fn passes(&self) -> bool {
        self.adu.len() < 2 || self.adu[0] == BROADCAST
    }
}

/// What comes next: a frame of the first line or of the second, or a request and its answer, the first on this line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    One(usize),
    Pair(usize),
}

/// The lines (0 or 1) that the next frames are of. With `all`, nothing comes behind the frames given.
pub fn order(functions: &Functions, lines: [&[Heard]; 2], all: bool) -> Vec<usize> {
    if lines.iter().all(|line| line.len() > NEAR) {
        let near = aligned(functions, lines.map(|line| &line[..NEAR]), false);
        let pairs = near.iter().filter(|step| matches!(step, Step::Pair(_))).count();
        if 3 * pairs >= NEAR {
            return told(&near);
        }
    }
    told(&aligned(functions, lines, all))
}

/// Lines of the frames of some steps.
fn told(steps: &[Step]) -> Vec<usize> {
    let lines = steps.iter().flat_map(|step| match *step {
        Step::One(line) => [Some(line), None],
        Step::Pair(first) => [Some(first), Some(1 - first)],
    });
    lines.flatten().collect()
}

/// The best way through these frames; the first half of it, unless nothing comes behind them.
fn aligned(functions: &Functions, lines: [&[Heard]; 2], all: bool) -> Vec<Step> {
    let (rows, columns) = (lines[0].len(), lines[1].len());
    let at = |i: usize, j: usize| i * (columns + 1) + j;
    // From the back: what the rest is worth at best, and by which step.
    let mut best = vec![(0.0f32, None); (rows + 1) * (columns + 1)];
    for i in (0..=rows).rev() {
        for j in (0..=columns).rev() {
            // At the edge of the window it is open what comes, unless nothing does.
            if !all && (i == rows || j == columns) {
                continue;
            }
            let mut steps: [Option<(f32, Step)>; 3] = [None; 3];
            if j < columns {
                steps[0] = Some((best[at(i, j + 1)].0 - alone(lines[1], j), Step::One(1)));
            }
            if i < rows {
                steps[1] = Some((best[at(i + 1, j)].0 - alone(lines[0], i), Step::One(0)));
            }
            if i < rows && j < columns {
                steps[2] = pair(functions, &lines[0][i], &lines[1][j])
                    .map(|(bits, first)| (best[at(i + 1, j + 1)].0 + bits, Step::Pair(first)));
            }
            let step = steps.into_iter().flatten().max_by(|a, b| a.0.total_cmp(&b.0));
            best[at(i, j)] = step.map_or((0.0, None), |(bits, step)| (bits, Some(step)));
        }
    }
    let (mut i, mut j, mut steps) = (0, 0, Vec::new());
    while let Some(step) = best[at(i, j)].1.filter(|_| all || i.max(j) < rows / 2) {
        (i, j) = match step {
            Step::One(line) => (i + usize::from(line == 0), j + line),
            Step::Pair(_) => (i + 1, j + 1),
        };
        steps.push(step);
    }
    steps
}

/// What a frame costs that is not one of a pair.
fn alone(line: &[Heard], at: usize) -> f32 {
    let frame = &line[at];
    if frame.passes() {
        return 0.0;
    }
    match frame.direction {
        Direction::Response => ORPHAN,
        _ if line[at + 1..].iter().find(|next| !next.passes()).is_some_and(|next| next.adu == frame.adu) => ASKED_AGAIN,
        _ => UNANSWERED,
    }
}

/// What two frames are worth as request and answer, and which line's is the request.
fn pair(functions: &Functions, one: &Heard, other: &Heard) -> Option<(f32, usize)> {
    let (request, answer, first) = match (one.direction, other.direction) {
        (Direction::Request, Direction::Response) => (one, other, 0),
        (Direction::Response, Direction::Request) => (other, one, 1),
        _ => return None,
    };
    if request.passes() || answer.passes() {
        return None;
    }
    if !(request.good && answer.good) {
        let same = request.adu[0] == answer.adu[0] && request.adu[1] == answer.adu[1] & !EXCEPTION_BIT;
        return same.then_some((DAMAGED, first));
    }
    let asked = Asked { unit: request.adu[0], pdu: request.pdu() };
    match answers(functions, asked, answer.adu[0], answer.pdu()) {
        Match::No => None,
        Match::Partly => Some((PARTLY, first)),
        Match::Fully if answer.adu[1] & EXCEPTION_BIT != 0 => Some((REFUSAL, first)),
        Match::Fully => Some((FULLY, first)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(direction: Direction, adu: &[u8]) -> Heard {
        Heard { direction, good: true, adu: adu.to_vec() }
    }

    fn asks(unit: u8, quantity: u8) -> Heard {
        heard(Direction::Request, &[unit, 3, 0, 0, 0, quantity])
    }

    fn tells(unit: u8, quantity: u8) -> Heard {
        let mut adu = vec![unit, 3, 2 * quantity];
        adu.resize(3 + 2 * usize::from(quantity), 7);
        heard(Direction::Response, &adu)
    }

    fn told(requests: &[Heard], answers: &[Heard]) -> Vec<usize> {
        order(Functions::embedded(), [requests, answers], true)
    }

    #[test]
    fn answers_stand_behind_their_requests() {
        assert_eq!(told(&[asks(1, 1), asks(2, 3)], &[tells(1, 1), tells(2, 3)]), [0, 1, 0, 1]);
        // The lines may be the other way round.
        assert_eq!(told(&[tells(1, 1), tells(2, 3)], &[asks(1, 1), asks(2, 3)]), [1, 0, 1, 0]);
    }

    #[test]
    fn what_is_missing_on_one_line_shifts_nothing() {
        let silent = [asks(1, 1), asks(2, 3), asks(3, 2), asks(1, 1)];
        assert_eq!(told(&silent, &[tells(1, 1), tells(3, 2), tells(1, 1)]), [0, 1, 0, 0, 1, 0, 1]);
        let unheard = [asks(1, 1), asks(3, 2)];
        assert_eq!(told(&unheard, &[tells(1, 1), tells(2, 3), tells(3, 2)]), [0, 1, 1, 0, 1]);
    }

    #[test]
    fn a_request_again_is_a_retry() {
        let requests = [asks(1, 1), asks(2, 3), asks(2, 3), asks(1, 1)];
        assert_eq!(told(&requests, &[tells(1, 1), tells(2, 3), tells(1, 1)]), [0, 1, 0, 0, 1, 0, 1]);
        // As many answers as requests: it was asked twice.
        assert_eq!(told(&[asks(1, 1), asks(1, 1)], &[tells(1, 1), tells(1, 1)]), [0, 1, 0, 1]);
    }

    #[test]
    fn bytes_missing_on_one_line_cost_their_own_frames_only() {
        let kinds = |at: usize| (1 + (at * at) as u8 % 7, 1 + (at * 5 / 3) as u8 % 11);
        let requests: Vec<Heard> = (0..WINDOW).map(|at| asks(kinds(at).0, kinds(at).1)).collect();
        let answers: Vec<Heard> = (60..WINDOW + 60).map(|at| tells(kinds(at).0, kinds(at).1)).collect();
        let told = order(Functions::embedded(), [&requests, &answers], false);
        assert_eq!(told[..60], [0; 60]);
        assert_eq!(told[60..], [0, 1].repeat(told.len() / 2 - 30));
    }

    #[test]
    fn half_a_window_is_told_while_more_may_come() {
        let requests: Vec<Heard> = (0..WINDOW).map(|at| asks(1 + at as u8 % 5, 1 + at as u8 % 7)).collect();
        let answers: Vec<Heard> = (0..WINDOW).map(|at| tells(1 + at as u8 % 5, 1 + at as u8 % 7)).collect();
        let told = order(Functions::embedded(), [&requests, &answers], false);
        assert_eq!(told, [0, 1].repeat(NEAR / 2));
    }
}
