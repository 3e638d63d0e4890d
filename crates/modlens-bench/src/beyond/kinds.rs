//! The kinds of lines. Each is a habit of devices, masters or taps that the scenarios do not have; all else is left to chance.

use super::line::Line;
use crate::checksum::rtu;
use crate::model::Direction;

/// A kind of line: its name, and what makes it.
pub type Kind = (&'static str, fn(&mut Line));

/// The kind whose frames were chosen by their checksum: noise has ten thousand times fewer of them, so that they say nothing of
/// stated odds.
pub const CHOSEN_BY_CHECKSUM: &str = "chance_frames";

/// All kinds.
pub const KINDS: [Kind; 20] = [
    ("only_answers", only_answers),
    ("dead_twin", dead_twin),
    ("late_by_one", late_by_one),
    ("answers_as_255", answers_as_255),
    ("damaged_retry", damaged_retry),
    ("torn_file_write", torn_file_write),
    ("identification", identification),
    ("counts_registers", counts_registers),
    ("bad_exceptions", bad_exceptions),
    ("equal_runs", equal_runs),
    (CHOSEN_BY_CHECKSUM, chance_frames),
    ("constant_write", constant_write),
    ("stepped_write", stepped_write),
    ("dying_unit", dying_unit),
    ("nobody_there", nobody_there),
    ("echoing_adapter", echoing_adapter),
    ("deaf_tap", deaf_tap),
    ("same_address", same_address),
    ("bad_answers", bad_answers),
    ("long_pauses", long_pauses),
];

fn read(unit: u8, address: u16, quantity: u8) -> Vec<u8> {
    let [high, low] = address.to_be_bytes();
    rtu(unit, &[3, high, low, 0, quantity])
}

fn values(line: &mut Line, unit: u8, quantity: u8) -> Vec<u8> {
    let mut pdu = vec![3, 2 * quantity];
    for _ in 0..quantity {
        pdu.extend([line.rng.below(3) as u8, line.rng.byte()]);
    }
    rtu(unit, &pdu)
}

fn write(unit: u8, address: u16, value: u16) -> Vec<u8> {
    let ([high, low], [first, second]) = (address.to_be_bytes(), value.to_be_bytes());
    rtu(unit, &[6, high, low, first, second])
}

/// Some exchanges that nothing is odd about.
fn polls(line: &mut Line, unit: u8, count: usize) {
    for at in 0..count {
        let quantity = 1 + (at % 4) as u8;
        let response = values(line, unit, quantity);
        let pause = line.rng.uniform(15.0, 60.0);
        let time = line.rng.uniform(4.0, 12.0);
        line.exchange(pause, time, [&read(unit, 10 * (at % 3) as u16, quantity), &response]);
    }
}

fn flipped(line: &mut Line, frame: &[u8], flips: usize) -> Vec<u8> {
    let mut bytes = frame.to_vec();
    for _ in 0..flips {
        let at = line.rng.below(bytes.len());
        bytes[at] ^= 1 << line.rng.below(8);
    }
    if bytes == frame {
        bytes[2] ^= 0x11;
    }
    bytes
}

fn only_answers(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let registers = line.rng.range(2, 9) as u16;
    let hears_reads = line.rng.chance(0.3);
    for at in 0..80u16 {
        let silence = line.rng.uniform(20.0, 200.0);
        let value = line.rng.below(4) as u16;
        let frame = match line.rng.below(10) {
            0 if hears_reads => values(line, unit, 3),
            1 => rtu(unit, &[5, 0, (at % registers) as u8, if value > 1 { 0xFF } else { 0 }, 0]),
            2 => rtu(unit, &[16, 0, (at % registers) as u8, 0, 1 + value as u8]),
            _ => write(unit, at % registers, value),
        };
        line.answer_unheard(silence, &frame);
    }
}

fn dead_twin(line: &mut Line) {
    let first = line.rng.range(1, 20) as u8;
    let (dead, timeout) = (first + 1, line.rng.uniform(100.0, 400.0));
    for at in 0..40u16 {
        let reference = 500 + at / 7;
        let time = line.rng.uniform(4.0, 9.0);
        let pause = if at == 0 { 10.0 } else { timeout };
        line.exchange(pause, time, [&write(first, 1, reference), &write(first, 1, reference)]);
        line.ask(12.0, &write(dead, 1, reference));
    }
}

fn late_by_one(line: &mut Line) {
    let units = [line.rng.range(1, 9) as u8, line.rng.range(10, 19) as u8];
    for at in 0..40u16 {
        polls(line, units[usize::from(at % 2)], 2);
        let asked = [line.ask(40.0, &read(units[0], 4, 1)), line.ask(120.0, &read(units[1], 7, 2))];
        let first = values(line, units[0], 1);
        let mut second = values(line, units[1], 2);
        while second[second.len() - 1] != 0 {
            second = values(line, units[1], 2);
        }
        line.answer(15.0, asked[0], &first);
        line.answer(10.0, asked[1], &second);
    }
}

fn answers_as_255(line: &mut Line) {
    let answering = line.rng.pick(&[255, 0, 1, 247]);
    for at in 0..60u16 {
        let unit = 2 + line.rng.below(4) as u8;
        let quantity = line.rng.range(1, 9) as u8;
        let response = values(line, answering, quantity);
        let (pause, time) = (line.rng.uniform(10.0, 30.0), line.rng.uniform(4.0, 15.0));
        line.exchange(pause, time, [&read(unit, 20 * (at % 4), quantity), &response]);
    }
}

fn damaged_retry(line: &mut Line) {
    let unit = line.rng.range(1, 20) as u8;
    let timeout = line.rng.uniform(200.0, 900.0);
    for at in 0..30u16 {
        polls(line, unit, 3);
        let request = if at % 2 == 0 { read(unit, 30, 2) } else { write(unit, 7, 3 + at) };
        line.ask(40.0, &request);
        let copy = flipped(line, &request, 2);
        let txn = line.ask(timeout, &request);
        // The tap hears the second copy damaged, the unit does not.
        line.spoil_last(&copy);
        let response = if at % 2 == 0 { values(line, unit, 2) } else { request };
        line.answer(8.0, txn, &response);
    }
}

fn torn_file_write(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let registers = line.rng.range(8, 28) as u8;
    let mut pdu = vec![21, 2 * registers + 7, 6, 0, 4, 0, 7, 0, registers];
    (0..2 * registers).for_each(|_| pdu.push(line.rng.byte()));
    let frame = rtu(unit, &pdu);
    let (pause, at) = (line.rng.pick(&[2.0, 6.0, 20.0, 45.0, 80.0]), line.rng.range(4, frame.len() - 2));
    for _ in 0..10 {
        polls(line, unit, 1);
        let txn = line.ask(40.0, &frame);
        line.pause_inside(frame.len() - at, pause);
        line.answer(20.0, txn, &frame);
        if line.rng.chance(0.5) {
            line.pause_inside(frame.len() - at, pause);
        }
    }
}

fn identification(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    for at in 0..30u8 {
        polls(line, unit, 2);
        let (code, object) = (line.rng.pick(&[1, 2, 3, 4]), at % 3);
        let mut pdu = vec![43, 14, code, 0x83, 0, 0, 1 + object];
        for id in 0..=object {
            let text = &b"Acme meter 4711"[..line.rng.range(3, 15)];
            pdu.extend([&[id, text.len() as u8], text].concat());
        }
        line.exchange(40.0, 15.0, [&rtu(unit, &[43, 14, code, 0]), &rtu(unit, &pdu)]);
    }
}

fn counts_registers(line: &mut Line) {
    let units = [line.rng.range(1, 9) as u8, line.rng.range(10, 19) as u8];
    for at in 0..60 {
        let quantity = line.rng.range(2, 12) as u8;
        let right = values(line, units[at % 2], quantity);
        let mut pdu = right[1..right.len() - 2].to_vec();
        pdu[1] = if at % 2 == 0 { quantity } else { 2 * quantity };
        let time = line.rng.uniform(4.0, 12.0);
        line.exchange(30.0, time, [&read(units[at % 2], 100, quantity), &rtu(units[at % 2], &pdu)]);
    }
}

fn bad_exceptions(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    for _ in 0..40 {
        polls(line, unit, 2);
        let exception = rtu(unit, &[0x83, line.rng.range(1, 4) as u8]);
        let txn = line.ask(30.0, &read(unit, 900, 1));
        if line.rng.chance(0.5) {
            line.answer(8.0, txn, &exception);
        } else {
            let bytes = flipped(line, &exception, 2);
            line.damaged(8.0, Direction::Response, txn, &bytes);
        }
    }
}

fn equal_runs(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    polls(line, unit, 30);
    let (first, second) = (line.rng.byte(), line.rng.byte());
    for _ in 0..12 {
        let lengths = [line.rng.range(10, 90), line.rng.range(10, 90)];
        line.noise(20.0, &[vec![first; lengths[0]], vec![second; lengths[1]], vec![0xFF; 40]].concat());
        polls(line, unit, 1);
    }
}

fn chance_frames(line: &mut Line) {
    let units = [3, 7, 12];
    for unit in units {
        polls(line, unit, 25);
    }
    for _ in 0..30 {
        let noise: Vec<u8> = (0..line.rng.range(40, 200)).map(|_| line.rng.byte()).collect();
        let body: Vec<u8> = (0..line.rng.range(1, 20)).map(|_| line.rng.byte()).collect();
        let code = line.rng.pick(&[43, 67, 100, 8]);
        let chance = rtu(line.rng.pick(&units), &[&[code], &body[..]].concat());
        line.noise(30.0, &[&noise[..20], &chance, &noise[20..]].concat());
    }
    polls(line, 3, 5);
}

fn constant_write(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let frame = match line.rng.below(3) {
        0 => rtu(unit, &[8, 0, 0, 0xA5, 0x37]),
        1 => rtu(unit, &[5, 0, 4, 0xFF, 0]),
        _ => write(unit, 10, 1),
    };
    let pause = line.rng.uniform(20.0, 150.0);
    for _ in 0..60 {
        let time = line.rng.uniform(4.0, 8.0);
        line.exchange(pause, time, [&frame, &frame]);
    }
}

fn stepped_write(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let (every, pause) = (line.rng.range(3, 12) as u16, line.rng.uniform(30.0, 150.0));
    for at in 0..60u16 {
        let frame = write(unit, 10, 100 + at / every);
        let time = line.rng.uniform(4.0, 9.0);
        line.exchange(pause, time, [&frame, &frame]);
        if at % every == 0 {
            polls(line, unit + 1, 1);
        }
    }
}

fn dying_unit(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let period = line.rng.uniform(150.0, 600.0);
    for at in 0..80 {
        let frame = write(unit, 10, 1);
        let txn = line.ask(period, &frame);
        if at < 40 {
            let time = line.rng.uniform(4.0, 9.0);
            line.answer(time, txn, &frame);
        }
    }
}

fn nobody_there(line: &mut Line) {
    let (unit, period) = (line.rng.range(1, 30) as u8, line.rng.uniform(300.0, 1500.0));
    (0..60).for_each(|_| {
        line.ask(period, &write(unit, 3, 1));
    });
}

fn echoing_adapter(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    for at in 0..50u16 {
        let frame = write(unit, 10, 7 + at / 6);
        let txn = line.ask(60.0, &frame);
        line.echo(0.1, txn, &frame);
        let time = line.rng.uniform(5.0, 10.0);
        line.answer(time, txn, &frame);
    }
}

fn deaf_tap(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let (quantity, share) = (line.rng.range(2, 12) as u8, line.rng.uniform(0.15, 0.45));
    let period = line.rng.uniform(60.0, 90.0);
    for _ in 0..100 {
        let response = values(line, unit, quantity);
        let txn = line.ask(period, &read(unit, 40, quantity));
        let time = line.rng.uniform(4.0, 7.0);
        if line.rng.chance(share) {
            line.unheard(time, response.len());
        } else {
            line.answer(time, txn, &response);
        }
    }
}

fn same_address(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    for _ in 0..60 {
        let (one, other) = (values(line, unit, 3), values(line, unit, 3));
        let shift = line.rng.below(5);
        let length = one.len() + shift;
        let of = |frame: &[u8], at: usize| frame.get(at).copied().unwrap_or(0xFF);
        let both: Vec<u8> = (0..length).map(|at| of(&one, at) & if at < shift { 0xFF } else { of(&other, at - shift) }).collect();
        let txn = line.ask(60.0, &read(unit, 40, 3));
        let time = line.rng.uniform(4.0, 8.0);
        if one == both {
            line.answer(time, txn, &both);
        } else {
            line.damaged(time, Direction::Response, txn, &both);
        }
    }
}

fn bad_answers(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let request = read(unit, 40, 2);
    for _ in 0..60 {
        let response = values(line, unit, 2);
        let pause = line.rng.uniform(10.0, 30.0);
        let txn = line.ask(pause, &request);
        if line.rng.chance(0.6) {
            let bytes = flipped(line, &response, 2);
            line.damaged(6.0, Direction::Response, txn, &bytes);
        } else {
            line.answer(6.0, txn, &response);
        }
    }
}

fn long_pauses(line: &mut Line) {
    let unit = line.rng.range(1, 30) as u8;
    let pause = line.rng.pick(&[2.0, 5.0, 20.0, 40.0, 80.0, 150.0, 400.0]);
    for _ in 0..40 {
        polls(line, unit + 1, 1);
        let response = values(line, unit, 6);
        let txn = line.ask(40.0, &read(unit, 40, 6));
        line.answer(8.0, txn, &response);
        if line.rng.chance(0.5) {
            let behind = line.rng.range(1, response.len() - 2);
            line.pause_inside(behind, pause);
        }
    }
}
