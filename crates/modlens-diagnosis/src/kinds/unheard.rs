//! Answers that a master does not hear: they come when it has stopped waiting for them, and before its next request, so that a line
//! shows them as good ones. The master's clock shows which they are. After an answer that it takes, it goes on by the answer; after
//! one that it does not hear, by its timeout, whenever the answer comes.

use modlens_protocol::Ns;

use crate::claim::View;
use crate::contrast::Followed;
use crate::statistics::{fisher, Share};

/// So many answers in time, and not in time, show how each are followed.
const FEWEST_IN_TIME: usize = 8;
const FEWEST_LATE: usize = 5;

/// So many requests of a unit are looked at beside those of others, and so many of others.
const REFERENCES: usize = 8;

/// Transactions that are named.
const EXAMPLES: usize = 4;

/// Times vary by less than this on any system.
const STEADY: Ns = 2_000_000;

/// What varies so many times as much as another time does not go with it.
const TIMES_AS_MUCH: Ns = 4;

/// Answers to a request that its master did not wait for.
pub(super) struct Unheard {
    /// The response time of the fastest of them.
    pub least: Ns,
    /// How many of those that were looked at.
    pub seen: u64,
    /// How long the master waits, from the end of its request on.
    pub timeout: Option<Ns>,
    /// Transactions that show it.
    pub examples: Vec<u64>,
    /// How probable it is that the pauses that follow them differ by chance.
    pub chance: f64,
}

impl Unheard {
    /// Those of the request to a unit that shows it best: beside others of its own answers, else beside those of another unit.
    pub(super) fn of_unit(view: &View<'_>, unit: u8) -> Option<Self> {
        let timed = view.requests.iter().filter(|(_, counts)| !counts.followed.is_empty());
        let own: Vec<Vec<Answer>> =
            timed.clone().filter(|(key, _)| key.unit == unit).map(|(_, counts)| counts.followed.by_response()).collect();
        let of_unit = own.iter().filter_map(|answers| {
            let (in_time, late) = split(answers)?;
            Self::beside(in_time, late)
        });
        let Some(best) = least_probable(of_unit) else {
            let others =
                timed.filter(|(key, _)| key.unit != unit).take(REFERENCES).map(|(_, counts)| counts.followed.by_response());
            let others: Vec<Vec<Answer>> = others.filter(|answers| answers.len() >= FEWEST_IN_TIME).collect();
            let late = own.iter().filter(|answers| answers.len() >= FEWEST_LATE).take(REFERENCES);
            let tried = late.clone().count() * others.len();
            let found = late.flat_map(|late| others.iter().filter_map(|in_time| Self::all_late(in_time, late)));
            return least_probable(found).map(|best| Self { chance: best.chance * tried as f64, ..best });
        };
        Some(Self { chance: best.chance * own.len() as f64, ..best })
    }

    /// All answers to a request, beside those of another unit, which are faster.
    fn all_late(in_time: &[Answer], late: &[Answer]) -> Option<Self> {
        let is_slower = in_time.last()?.1.response < late.first()?.1.response;
        // The answers of the other unit may have another length.
        let length = Spread::of(late.iter().map(|(_, seen)| seen.length)).middle;
        let in_time: Vec<Answer> = in_time.iter().map(|(number, seen)| (*number, Followed { length, ..*seen })).collect();
        Self::beside(&in_time, late).filter(|found| is_slower && found.timeout.is_some() && gain(&in_time) >= 0.5)
    }

    /// Those that are taken for late, beside some that came in time.
    fn beside(in_time: &[Answer], late: &[Answer]) -> Option<Self> {
        let (own, other) = (Times::of(in_time), Times::of(late));
        let steady = own.after.width().max(other.next.width()).max(STEADY);
        if other.next.middle < own.next.middle + TIMES_AS_MUCH * steady {
            return None;
        }
        let timeout = other.next.middle - own.pause.middle;
        let is_between = own.response.most <= timeout && timeout <= other.response.least + other.length.middle + steady;
        // The next request goes with the answers in time, or is seen to by how little it varies otherwise.
        let goes_along = is_between && own.next.width() >= 2 * other.next.width() && gain(in_time) >= 0.5;
        let goes_by_clock = other.response.width() >= TIMES_AS_MUCH * steady
            || (goes_along && other.after.width() >= 2 * other.next.width() && gain(late) <= 0.25);
        if !goes_by_clock {
            return None;
        }
        // A master that asks in step with a clock of its own takes any answer, and its next request does not go with it.
        let goes_by_answer = goes_along || own.response.width() >= STEADY.max(TIMES_AS_MUCH * own.after.width());
        if !goes_by_answer && !asks_again(in_time, late) && (!is_between || may_be_in_step(&own, &other, steady)) {
            return None;
        }
        let strays = |(_, seen): &&Answer| (seen.after() - own.after.middle).abs() > steady;
        let share = |side: &[Answer]| Share { failed: side.iter().filter(strays).count() as u64, total: side.len() as u64 };
        Some(Self {
            least: late[0].1.response,
            seen: late.len() as u64,
            timeout: Some(timeout).filter(|_| is_between),
            examples: late.iter().map(|(number, _)| *number).take(EXAMPLES).collect(),
            chance: fisher(share(late), share(in_time)) * (in_time.len() + late.len()) as f64,
        })
    }
}

fn least_probable(found: impl Iterator<Item = Unheard>) -> Option<Unheard> {
    found.min_by(|one, other| one.chance.total_cmp(&other.chance))
}

/// How much later the next request comes for each nanosecond that the answer does: the median of all pairs of answers (Theil and
/// Sen). It is 1 where the master goes by the answer, 0 where it goes by its clock.
fn gain(answers: &[Answer]) -> f64 {
    let pairs =
        answers.iter().enumerate().flat_map(|(at, (_, one))| answers[at + 1..].iter().map(move |(_, other)| (one, other)));
    let differing = pairs.filter(|(one, other)| one.response < other.response);
    let mut gains: Vec<f64> =
        differing.map(|(one, other)| (other.next() - one.next()) as f64 / (other.response - one.response) as f64).collect();
    gains.sort_by(f64::total_cmp);
    gains.get(gains.len() / 2).copied().unwrap_or_default()
}

type Answer = (u64, Followed);

/// Where the times after answers are steadiest: those after the faster ones from the answer on, those after the others from the
/// request on.
fn split(answers: &[Answer]) -> Option<(&[Answer], &[Answer])> {
    let last = answers.len().checked_sub(FEWEST_LATE)?;
    let splits = (FEWEST_IN_TIME..=last).filter(|at| answers[at - 1].1.response < answers[*at].1.response);
    let sides = splits.map(|at| answers.split_at(at));
    sides.min_by_key(|(in_time, late)| unsteadiness(in_time, Followed::after) + unsteadiness(late, Followed::next))
}

/// The sum of what times are away from the middle one.
fn unsteadiness(answers: &[Answer], time: impl Fn(&Followed) -> Ns) -> Ns {
    let times: Vec<Ns> = answers.iter().map(|(_, seen)| time(seen)).collect();
    let middle = Spread::of(times.iter().copied()).middle;
    times.iter().map(|time| (time - middle).abs()).sum()
}

/// Whether the same request comes again after the answers that are taken for late, and another one after the others.
fn asks_again(in_time: &[Answer], late: &[Answer]) -> bool {
    let again = |side: &[Answer]| side.iter().filter(|(_, seen)| seen.is_repeated).count();
    again(in_time) * 5 <= in_time.len() && again(late) * 5 >= late.len() * 4
}

/// Whether both kinds of answers may be followed by the next beat of one clock, so slow that the late ones lie within one of its
/// periods: as of a controller that looks for answers once in each of its cycles.
fn may_be_in_step(in_time: &Times, late: &Times, steady: Ns) -> bool {
    let most = in_time.next.middle / late.response.width().max(1);
    (1..=most).any(|beats| {
        let period = in_time.next.middle / beats;
        let off = late.next.middle % period;
        off.min(period - off) <= 2 * steady
    })
}

/// The times of some answers.
struct Times {
    response: Spread,
    length: Spread,
    pause: Spread,
    after: Spread,
    next: Spread,
}

impl Times {
    fn of(answers: &[Answer]) -> Self {
        let spread = |time: fn(&Followed) -> Ns| Spread::of(answers.iter().map(|(_, seen)| time(seen)));
        Self {
            response: spread(|seen| seen.response),
            length: spread(|seen| seen.length),
            pause: spread(|seen| seen.pause),
            after: spread(Followed::after),
            next: spread(Followed::next),
        }
    }
}

/// How far most of some times are apart: one in ten at each end is left out.
struct Spread {
    least: Ns,
    middle: Ns,
    most: Ns,
}

impl Spread {
    fn of(times: impl Iterator<Item = Ns>) -> Self {
        let mut times: Vec<Ns> = times.collect();
        times.sort_unstable();
        let (left_out, last) = (times.len() / 10, times.len() - 1);
        Self { least: times[left_out], middle: times[times.len() / 2], most: times[last - left_out] }
    }

    fn width(&self) -> Ns {
        self.most - self.least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    /// Answers in so many ms, after each of which the next request comes when the function says, counted from the request.
    fn answers(responses: &[Ns], next: impl Fn(Ns) -> Ns) -> Vec<Answer> {
        let mut all: Vec<Answer> = (1..)
            .zip(responses)
            .map(|(number, &ms)| {
                let pause = (next(ms) - ms) * MS + number as Ns % 3 * MS / 4;
                (number, Followed { response: ms * MS, pause, ..Followed::default() })
            })
            .collect();
        all.sort_by_key(|(_, seen)| seen.response);
        all
    }

    /// Most answers are fast, and some slow, as of a unit that is busy now and then.
    fn of_busy_unit() -> Vec<Ns> {
        (0..40).map(|turn| if turn % 4 == 0 { 310 + 17 * (turn * 7 % 10) } else { 8 }).collect()
    }

    /// The answers are of any time up to twice the timeout.
    fn of_slow_unit() -> Vec<Ns> {
        (0..40).map(|turn| 20 + 14 * (turn * 11 % 40)).collect()
    }

    fn timeout(responses: &[Ns], next: impl Fn(Ns) -> Ns) -> Option<Ns> {
        let all = answers(responses, next);
        split(&all)
            .and_then(|(in_time, late)| Unheard::beside(in_time, late))
            .filter(|found| found.chance < 1e-4)
            .and_then(|found| found.timeout)
    }

    #[test]
    fn a_master_that_goes_by_its_timeout_has_not_heard_the_answer() {
        for responses in [of_busy_unit(), of_slow_unit()] {
            let found = timeout(&responses, |ms| if ms <= 300 { ms + 750 } else { 300 + 750 });
            assert!(found.is_some_and(|found| (found - 300 * MS).abs() < 2 * MS), "{found:?}");
        }
    }

    #[test]
    fn a_master_that_goes_by_each_answer_has_heard_all() {
        for responses in [of_busy_unit(), of_slow_unit()] {
            assert_eq!(timeout(&responses, |ms| ms + 750), None);
            assert_eq!(timeout(&responses, |ms| ms + 3), None);
        }
    }

    #[test]
    fn a_master_that_asks_in_step_with_a_clock_has_heard_all() {
        for responses in [of_busy_unit(), of_slow_unit()] {
            for period in [1, 20, 50, 100, 200, 300, 1000] {
                assert_eq!(timeout(&responses, |ms| (ms / period + 1) * period), None, "each {period} ms");
                assert_eq!(timeout(&responses, |ms| (ms + 5).max(period)), None, "{period} ms at least");
            }
        }
    }

    /// Fast answers that vary by a few ms, and slow ones that do so, too.
    fn of_steady_unit() -> Vec<Ns> {
        (0..40).map(|turn| if turn % 3 == 0 { 560 + turn * 7 % 9 } else { 31 + turn * 7 % 9 }).collect()
    }

    #[test]
    fn answers_that_vary_little_show_what_the_master_goes_by() {
        let found = timeout(&of_steady_unit(), |ms| if ms <= 400 { ms + 250 } else { 400 + 250 });
        assert!(found.is_some_and(|found| (found - 400 * MS).abs() < 3 * MS), "{found:?}");
        assert_eq!(timeout(&of_steady_unit(), |ms| (ms + 48).max(326)), None, "each 326 ms, or right after the answer");
        assert_eq!(timeout(&of_steady_unit(), |ms| if ms < 400 { 326 } else { 652 }), None, "each 326 ms");
    }

    #[test]
    fn all_answers_of_a_unit_are_late_beside_those_of_another_one() {
        let (fast, slow): (Vec<Ns>, Vec<Ns>) =
            ((0..40).map(|turn| 24 + turn * 7 % 9).collect(), (0..40).map(|turn| 310 + turn * 31 % 90).collect());
        let found = |next_fast: fn(Ns) -> Ns, next_slow: fn(Ns) -> Ns| {
            Unheard::all_late(&answers(&fast, next_fast), &answers(&slow, next_slow)).and_then(|found| found.timeout)
        };
        let waited = found(|ms| ms + 260, |_| 250 + 260);
        assert!(waited.is_some_and(|waited| (waited - 250 * MS).abs() < 3 * MS), "{waited:?}");
        assert_eq!(found(|ms| ms + 260, |ms| ms + 260), None, "a slow unit, which is heard");
        assert_eq!(found(|_| 290, |_| 512), None, "a schedule with a time for each");
        assert_eq!(found(|_| 290, |ms| ms + 120), None, "a schedule for one, the answers of the other");
    }
}
