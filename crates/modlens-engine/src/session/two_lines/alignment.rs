//! The order of the frames of two lines, inferred from their content where no clock shows it.
//!
//! Within each line the frames are in order, and each side has its own line: requests are on one, responses on the
//! other. Merging the two is a sequence alignment (Needleman and Wunsch): a response repeats unit, function, length and
//! address of its request, so a pair of them scores; a request without response and a response without request cost.
//! Dynamic programming finds the order with the greatest sum of scores in bits.
//!
//! Only a window of each line is aligned at a time, and only the first half of the result is used, since frames after
//! the window could change the rest. Where few frames pair up, because bytes of one line are missing, the window is made
//! far wider: it must be longer than the hole.
//!
//! ```text
//! requests   A B C   D      of requests A to D with responses a to d, c being missing
//! responses  a b     d
//! merged     A a B b C D d
//! ```

use crate::weights;
use modlens_protocol::direction::{match_response, Direction, RequestRef, ResponseMatch};
use modlens_protocol::framing::BROADCAST_UNIT;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

/// Pairs in a narrow window, in parts of its frames, with which its alignment is trusted.
const TRUSTED_PAIR_SHARE: usize = 3;

/// A frame as far as its place among others depends on it.
#[derive(Clone, Debug)]
pub struct LineFrame {
    /// Who sent it.
    pub direction: Direction,
    /// It is whole and its checksum right.
    pub is_good: bool,
    /// Unit and PDU; empty for noise.
    pub adu: Vec<u8>,
}

impl LineFrame {
    fn pdu(&self) -> &[u8] {
        self.adu.get(1..).unwrap_or(&[])
    }

    /// Noise and broadcasts neither want a response nor are one.
    fn is_unpaired(&self) -> bool {
        self.adu.len() < 2 || self.adu[0] == BROADCAST_UNIT
    }
}

/// One step of an alignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// The next frame is of this line (0 or 1) and has no counterpart.
    Single(usize),
    /// The next two frames are a request of this line and its response on the other one.
    Pair(usize),
}

/// The order of the next frames: for each, the index of its line (0 or 1). With `is_complete` nothing follows the frames
/// given, so that all of them are ordered; else the first half.
///
/// If both lines have more than a narrow window of frames, that is aligned first. Its result is taken, whatever `is_complete`
/// says, if it has at least a third as many pairs as the window has frames; else all the frames given are aligned.
pub fn merge_order(functions: &Functions, lines: [&[LineFrame]; 2], is_complete: bool) -> Vec<usize> {
    if lines.iter().all(|line| line.len() > weights::NARROW_WINDOW_FRAMES) {
        let steps = align(functions, lines.map(|line| &line[..weights::NARROW_WINDOW_FRAMES]), false);
        let pairs = steps.iter().filter(|step| matches!(step, Step::Pair(_))).count();
        if TRUSTED_PAIR_SHARE * pairs >= weights::NARROW_WINDOW_FRAMES {
            return lines_of(&steps);
        }
    }
    lines_of(&align(functions, lines, is_complete))
}

/// The line of each frame of an alignment.
fn lines_of(steps: &[Step]) -> Vec<usize> {
    let lines = steps.iter().flat_map(|step| match *step {
        Step::Single(line) => [Some(line), None],
        Step::Pair(request_line) => [Some(request_line), Some(1 - request_line)],
    });
    lines.flatten().collect()
}

/// The alignment of these frames with the greatest score in bits, from the first frame on. Unless `is_complete`, it ends
/// where half as many frames of either line are placed as the first line has, and the frames left over at the end of a line
/// cost nothing.
fn align(functions: &Functions, lines: [&[LineFrame]; 2], is_complete: bool) -> Vec<Step> {
    let grid = best_ways(functions, lines, is_complete);
    let (mut i, mut j, mut steps) = (0, 0, Vec::new());
    while let Some(step) = grid.at(i, j).first_step.filter(|_| is_complete || i.max(j) < lines[0].len() / 2) {
        (i, j) = match step {
            Step::Single(line) => (i + usize::from(line == 0), j + line),
            Step::Pair(_) => (i + 1, j + 1),
        };
        steps.push(step);
    }
    steps
}

/// The best way from a cell of the grid to its end.
#[derive(Clone, Copy)]
struct Way {
    /// Sum of the scores of its steps in bits.
    score: f32,
    /// `None` at the end.
    first_step: Option<Step>,
}

/// The best way from every cell. In cell (i, j), i frames of the first line and j of the second are placed.
struct Grid {
    /// Cells in a row: one more than the second line has frames.
    columns: usize,
    ways: Vec<Way>,
}

impl Grid {
    fn at(&self, i: usize, j: usize) -> Way {
        self.ways[i * self.columns + j]
    }
}

/// Computes the best way from every cell, from the last one back. If more frames may come (not `is_complete`), the frames
/// left over at the edge cost nothing, since what follows the window is not known.
fn best_ways(functions: &Functions, lines: [&[LineFrame]; 2], is_complete: bool) -> Grid {
    let (rows, columns) = (lines[0].len() + 1, lines[1].len() + 1);
    let mut grid = Grid { columns, ways: vec![Way { score: 0.0, first_step: None }; rows * columns] };
    for i in (0..rows).rev() {
        for j in (0..columns).rev() {
            if is_complete || (i + 1 < rows && j + 1 < columns) {
                grid.ways[i * columns + j] = best_way(functions, lines, &grid, i, j);
            }
        }
    }
    grid
}

/// The best way from cell (i, j), given those of the cells after it. Equal scores go to the pair, then to the first line.
fn best_way(functions: &Functions, lines: [&[LineFrame]; 2], grid: &Grid, i: usize, j: usize) -> Way {
    let (in_first, in_second) = (i < lines[0].len(), j < lines[1].len());
    let way = |behind: Way, bits: f32, step| Way { score: behind.score + bits, first_step: Some(step) };
    let second = in_second.then(|| way(grid.at(i, j + 1), -single_cost(lines[1], j), Step::Single(1)));
    let first = in_first.then(|| way(grid.at(i + 1, j), -single_cost(lines[0], i), Step::Single(0)));
    let score = if in_first && in_second { pair_score(functions, &lines[0][i], &lines[1][j]) } else { None };
    let pair = score.map(|(bits, request_line)| way(grid.at(i + 1, j + 1), bits, Step::Pair(request_line)));
    // Of equal scores, `max_by` gives the last one.
    let ways = [second, first, pair].into_iter().flatten();
    ways.max_by(|a, b| a.score.total_cmp(&b.score)).unwrap_or(Way { score: 0.0, first_step: None })
}

/// The cost in bits of the frame at index `at` of a line, if it has no counterpart: none for noise and broadcasts; less for a
/// request that the next frame of its line repeats (a retry) than for another; a frame of unknown direction counts as request.
fn single_cost(line: &[LineFrame], at: usize) -> f32 {
    let frame = &line[at];
    if frame.is_unpaired() {
        return 0.0;
    }
    match frame.direction {
        Direction::Response => weights::SINGLE_RESPONSE_BITS,
        _ if line[at + 1..].iter().find(|next| !next.is_unpaired()).is_some_and(|next| next.adu == frame.adu) => {
            weights::RETRIED_REQUEST_BITS
        }
        _ => weights::SINGLE_REQUEST_BITS,
    }
}

/// The score in bits of two frames, one of each line, as request and response, and which of them (0 or 1) is the request.
/// `None` if they cannot be a pair: noise, a broadcast, an unknown direction, or a response that does not fit. If one of them
/// is damaged, only unit and function are compared.
fn pair_score(functions: &Functions, first: &LineFrame, second: &LineFrame) -> Option<(f32, usize)> {
    let (request, response, request_line) = match (first.direction, second.direction) {
        (Direction::Request, Direction::Response) => (first, second, 0),
        (Direction::Response, Direction::Request) => (second, first, 1),
        _ => return None,
    };
    if request.is_unpaired() || response.is_unpaired() {
        return None;
    }
    if !(request.is_good && response.is_good) {
        let same = request.adu[0] == response.adu[0] && request.adu[1] == response.adu[1] & !EXCEPTION_BIT;
        return same.then_some((weights::PAIR_DAMAGED_BITS, request_line));
    }
    let asked = RequestRef { unit: request.adu[0], pdu: request.pdu() };
    match match_response(functions, asked, response.adu[0], response.pdu()) {
        ResponseMatch::No => None,
        ResponseMatch::Partly => Some((weights::PAIR_PARTIAL_MATCH_BITS, request_line)),
        ResponseMatch::Fully if response.adu[1] & EXCEPTION_BIT != 0 => Some((weights::PAIR_EXCEPTION_BITS, request_line)),
        ResponseMatch::Fully => Some((weights::PAIR_FULL_MATCH_BITS, request_line)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(direction: Direction, adu: &[u8]) -> LineFrame {
        LineFrame { direction, is_good: true, adu: adu.to_vec() }
    }

    fn request(unit: u8, quantity: u8) -> LineFrame {
        frame(Direction::Request, &[unit, 3, 0, 0, 0, quantity])
    }

    fn response(unit: u8, quantity: u8) -> LineFrame {
        let mut adu = vec![unit, 3, 2 * quantity];
        adu.resize(3 + 2 * usize::from(quantity), 7);
        frame(Direction::Response, &adu)
    }

    fn merged(first: &[LineFrame], second: &[LineFrame]) -> Vec<usize> {
        merge_order(Functions::embedded(), [first, second], true)
    }

    #[test]
    fn responses_stand_behind_their_requests() {
        assert_eq!(merged(&[request(1, 1), request(2, 3)], &[response(1, 1), response(2, 3)]), [0, 1, 0, 1]);
        // The requests may be on the second line.
        assert_eq!(merged(&[response(1, 1), response(2, 3)], &[request(1, 1), request(2, 3)]), [1, 0, 1, 0]);
    }

    #[test]
    fn a_frame_missing_on_one_line_does_not_shift_the_pairs_behind_it() {
        let four_requests = [request(1, 1), request(2, 3), request(3, 2), request(1, 1)];
        assert_eq!(merged(&four_requests, &[response(1, 1), response(3, 2), response(1, 1)]), [0, 1, 0, 0, 1, 0, 1]);
        let two_requests = [request(1, 1), request(3, 2)];
        assert_eq!(merged(&two_requests, &[response(1, 1), response(2, 3), response(3, 2)]), [0, 1, 1, 0, 1]);
    }

    #[test]
    fn of_two_equal_requests_with_one_response_the_second_is_the_retry() {
        let requests = [request(1, 1), request(2, 3), request(2, 3), request(1, 1)];
        assert_eq!(merged(&requests, &[response(1, 1), response(2, 3), response(1, 1)]), [0, 1, 0, 0, 1, 0, 1]);
        // With as many responses as requests, each request has its own.
        assert_eq!(merged(&[request(1, 1), request(1, 1)], &[response(1, 1), response(1, 1)]), [0, 1, 0, 1]);
    }

    #[test]
    fn a_hole_in_one_line_leaves_only_its_own_frames_unpaired() {
        let unit_and_quantity = |at: usize| (1 + (at * at) as u8 % 7, 1 + (at * 5 / 3) as u8 % 11);
        let requests = (0..weights::WIDE_WINDOW_FRAMES).map(unit_and_quantity).map(|(unit, quantity)| request(unit, quantity));
        let responses =
            (60..weights::WIDE_WINDOW_FRAMES + 60).map(unit_and_quantity).map(|(unit, quantity)| response(unit, quantity));
        let (requests, responses): (Vec<_>, Vec<_>) = (requests.collect(), responses.collect());
        let order = merge_order(Functions::embedded(), [&requests, &responses], false);
        assert_eq!(order[..60], [0; 60]);
        assert_eq!(order[60..], [0, 1].repeat(order.len() / 2 - 30));
    }

    #[test]
    fn half_a_window_is_ordered_while_more_may_come() {
        let requests: Vec<LineFrame> =
            (0..weights::WIDE_WINDOW_FRAMES).map(|at| request(1 + at as u8 % 5, 1 + at as u8 % 7)).collect();
        let responses: Vec<LineFrame> =
            (0..weights::WIDE_WINDOW_FRAMES).map(|at| response(1 + at as u8 % 5, 1 + at as u8 % 7)).collect();
        let order = merge_order(Functions::embedded(), [&requests, &responses], false);
        assert_eq!(order, [0, 1].repeat(weights::NARROW_WINDOW_FRAMES / 2));
    }
}
