//! Small recordings with a known register.

use super::*;
use modlens_protocol::register_type::Space;

const SECOND: i64 = 1_000_000_000;

/// A block of four registers for an hour, a sample every ten seconds: a voltage in tenths, a copy of it that is off, a
/// constant, and a state that changes at 1200 s and 2400 s.
fn blocks() -> Vec<BlockSeries> {
    let (mut times, mut cells) = (Vec::new(), Vec::new());
    for i in 0..360i64 {
        let wave = (i as f64 / 40.0).sin() * 25.0 + (i as f64 / 7.0).cos() * 6.0;
        times.push(i * 10 * SECOND);
        let state = 256 + u16::from((120..240).contains(&i));
        cells.extend([(2300.0 + wave) as u16, (2306.0 - wave) as u16, 2314, state]);
    }
    vec![BlockSeries { unit: 1, space: Space::Holding, first: 100, width: 4, times, cells }]
}

fn found(query: &Query) -> Vec<(u16, f64, f64)> {
    let blocks = blocks();
    let found = find(&blocks, &[], query);
    found.candidates.iter().map(|one| (100 + one.reading.at, one.scale, one.odds_bits)).collect()
}

fn shown_at(sample: i64) -> Shown {
    let value = f64::from(blocks()[0].cells[4 * sample as usize]) / 10.0;
    Shown { value, decimals: 1, at: Some((sample * 10 * SECOND, 5 * SECOND)) }
}

#[test]
fn two_values_decide_and_one_names_the_time_to_look() {
    let one = Query { shown: vec![shown_at(50)], ..Query::default() };
    assert_eq!(found(&one)[0].0, 100);
    let two = Query { shown: vec![shown_at(50), shown_at(200)], ..Query::default() };
    let best = found(&two)[0];
    assert_eq!((best.0, best.1), (100, 0.1));
    assert!(best.2 > 3.0, "{best:?}");
}

#[test]
fn a_value_nobody_sent_has_no_firm_candidate() {
    let shown = vec![Shown { value: 77.31, decimals: 2, at: Some((500 * SECOND, 5 * SECOND)) }];
    assert!(found(&Query { shown, ..Query::default() }).iter().all(|one| one.2 < 0.0));
}

#[test]
fn candidates_that_agree_now_are_told_apart_later() {
    let blocks = blocks();
    let moment = (0..360).find(|&i| blocks[0].cells[4 * i] == blocks[0].cells[4 * i + 1]).unwrap_or(2);
    let at = Some((moment as i64 * 10 * SECOND, SECOND));
    let shown = vec![Shown { value: 231.4, decimals: 1, at: None }, Shown { value: 231.4, decimals: 1, at }];
    let found = find(&blocks, &[], &Query { shown, ..Query::default() });
    if found.candidates.len() > 1 && found.candidates[1].chance > 0.003 {
        let look = found.look.expect("registers that move differently differ at some time");
        assert!((look.values[0] - look.values[1]).abs() > 0.1);
    }
}

#[test]
fn a_state_is_found_by_what_changed() {
    let moves = vec![
        Move { change: Change::Same, from: 100 * SECOND, to: 1100 * SECOND },
        Move { change: Change::Up, from: 1100 * SECOND, to: 1300 * SECOND },
        Move { change: Change::Same, from: 1300 * SECOND, to: 2300 * SECOND },
        Move { change: Change::Down, from: 2300 * SECOND, to: 2500 * SECOND },
    ];
    assert_eq!(found(&Query { moves, ..Query::default() })[0].0, 103);
}

#[test]
fn a_history_is_found_with_lag_scale_and_an_unknown_zone() {
    let blocks = blocks();
    for zone in [0i64, 2] {
        let shift = zone * 3_600 * SECOND + 40 * SECOND;
        let times: Vec<i64> = (5..55).map(|i| i * 60 * SECOND + shift).collect();
        let values = (5..55).map(|i| f64::from(blocks[0].cells[4 * 6 * i]) / 10.0).collect();
        let history = Some(History { times, values, has_zone: zone == 0 });
        let found = find(&blocks, &[], &Query { history, ..Query::default() });
        let best = &found.candidates[0];
        assert_eq!((best.reading.at, best.scale, best.offset), (0, 0.1, 0.0));
        let (r2, lag) = best.fit.unwrap();
        assert!(r2 > 0.99 && (lag - shift).abs() < 6 * SECOND, "{r2} {}", lag / SECOND);
    }
}
