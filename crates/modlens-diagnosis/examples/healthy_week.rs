//! A simulated healthy week on four lines, through the code that makes a tap's events: how many troubles are reported.
//!
//!     cargo run --release -p modlens-diagnosis --example healthy_week -- [SEED] [DAYS]
//!
//! The clock is that of the recording, so a week takes minutes. What is healthy here: each unit answers in its own time, but for
//! single accidents that know nothing of each other, one answer in 20,000 lost and one in 20,000 damaged, after which the master
//! asks again. Masters are restarted, rest at night, change what they ask for, and get a new unit; units refuse a little at the
//! start.

use modlens_diagnosis::events::{Change, Events};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::checksum::crc16;
use modlens_protocol::line::LineSettings;
use modlens_protocol::mix::mix;
use modlens_protocol::source::Clock;
use modlens_protocol::timestamp::time_text;
use modlens_readers::chunk::{Chunk, Times};

const MS: i64 = 1_000_000;
const S: i64 = 1000 * MS;
const HOUR: i64 = 3600 * S;
const DAY: i64 = 24 * HOUR;
/// A Monday, 00:00 UTC.
const START: i64 = 1_794_787_200 * S;
/// One answer in so many is lost, and one in so many is damaged.
const ACCIDENTS: u64 = 20_000;

/// A request: unit, function, address, quantity; asked in every so many cycles.
#[derive(Clone, Copy)]
struct Poll {
    unit: u8,
    function: u8,
    address: u16,
    quantity: u16,
    every: i64,
}

/// Numbers that look random.
struct Dice(u64);

impl Dice {
    fn number(&mut self) -> u64 {
        self.0 += 1;
        mix(self.0)
    }

    /// A time between these, mostly nearer to the shorter one.
    fn time(&mut self, least: i64, most: i64) -> i64 {
        let share = (self.number() % 1_000_000) as f64 / 1e6;
        least + ((most - least) as f64 * share * share * share) as i64
    }

    fn is_one_in(&mut self, count: u64) -> bool {
        self.number().is_multiple_of(count)
    }
}

/// A line with its master and its units.
struct Line {
    session: Session,
    events: Events,
    bus: usize,
    character: i64,
    timeout: i64,
    dice: Dice,
    now: i64,
    exchanges: u64,
    accidents: u64,
    reported: Vec<String>,
}

impl Line {
    fn new(settings: &str, timeout: i64, seed: u64) -> Self {
        let settings: LineSettings = settings.parse().expect("line settings");
        let wanted = WantedTables { frames: true, transactions: true, findings: false };
        let mut session = Session::new(std::sync::Arc::default(), wanted, true, None);
        let mut options = BusOptions::named("line");
        options.line = Some(settings);
        options.bus.clock = Clock::Utc;
        let bus = session.add_bus(options);
        Self {
            session,
            events: Events::default(),
            bus,
            character: settings.char_ns(),
            timeout,
            dice: Dice(seed << 40),
            now: 0,
            exchanges: 0,
            accidents: 0,
            reported: Vec::new(),
        }
    }

    /// Sends a frame: the read returns a little after its end.
    fn send(&mut self, body: &[u8], flipped: Option<u64>) {
        let mut frame = [body, &crc16(body).to_le_bytes()].concat();
        if let Some(bit) = flipped {
            let at = bit as usize % (frame.len() * 8);
            frame[at / 8] ^= 1 << (at % 8);
        }
        self.now += self.character * frame.len() as i64 + self.dice.time(0, MS);
        self.session.feed(self.bus, &Chunk { bytes: &frame, times: Times::Read(START + self.now), ..Chunk::default() });
    }

    /// Asks, and asks again once where no good answer comes. `delay` are the shortest and the longest response time.
    fn exchange(&mut self, request: &[u8], answer: &[u8], delay: (i64, i64)) {
        for _ in 0..2 {
            self.exchanges += 1;
            self.send(request, None);
            let sent = self.now;
            let (is_lost, is_damaged) = (self.dice.is_one_in(ACCIDENTS), self.dice.is_one_in(ACCIDENTS));
            self.accidents += u64::from(is_lost || is_damaged);
            if !is_lost {
                self.now += self.dice.time(delay.0, delay.1);
                let bit = self.dice.number();
                self.send(answer, is_damaged.then_some(bit));
            }
            self.now += 4 * self.character + self.dice.time(MS, 4 * MS);
            if !is_lost && !is_damaged {
                break;
            }
            self.now = self.now.max(sent + self.timeout);
        }
        if self.exchanges.is_multiple_of(16) {
            self.look();
        }
    }

    fn look(&mut self) {
        self.session.poll(START + self.now);
        self.events.observe(&self.session.take());
        for event in self.events.take() {
            if event.change != Change::End {
                self.reported.push(format!("{} {}: {}", time_text(event.time), event.change.text(), event.trouble.row.sentence));
            }
        }
    }

    fn ask(&mut self, poll: Poll, delay: (i64, i64)) {
        let Poll { unit, function, address, quantity, .. } = poll;
        let request = [&[unit, function][..], &address.to_be_bytes(), &quantity.to_be_bytes()].concat();
        let mut answer = vec![unit, function];
        if function <= 2 {
            let count = quantity.div_ceil(8) as u8;
            answer.push(count);
            answer.extend((0..count).map(|at| (self.now / (600 * S)) as u8 >> at & 1));
        } else {
            answer.push(2 * quantity as u8);
            for register in address..address + quantity {
                answer.extend(self.value(unit, register).to_be_bytes());
            }
        }
        self.exchange(&request, &answer, delay);
    }

    /// What a register says: a measurement that drifts, a constant, a counter, or a state.
    fn value(&mut self, unit: u8, register: u16) -> u16 {
        let seconds = self.now / S;
        let slow = ((seconds as f64 / 3000.0 + f64::from(unit)).sin() * 80.0) as i64;
        let noise = (self.dice.number() % 5) as i64;
        match register % 4 {
            0 => (2300 + slow + noise) as u16,
            1 => 100 + u16::from(unit),
            2 => (seconds / 7) as u16,
            _ => u16::from(seconds % 7200 > 3600),
        }
    }

    /// Writes one register, which a unit repeats.
    fn write(&mut self, unit: u8, address: u16, delay: (i64, i64)) {
        let value = (400 + self.now / (60 * S) % 50) as u16;
        let request = [&[unit, 6][..], &address.to_be_bytes(), &value.to_be_bytes()].concat();
        self.exchange(&request, &request, delay);
    }

    fn wait_for(&mut self, moment: i64) {
        self.now = self.now.max(moment);
    }
}

fn poll(unit: u8, function: u8, address: u16, quantity: u16) -> Poll {
    Poll { unit, function, address, quantity, every: 1 }
}

/// One unit, asked as fast as a controller does: three requests each 100 ms.
fn fast(seed: u64, length: i64) -> Line {
    let mut line = Line::new("115200-8N1", 100 * MS, seed);
    let polls = [poll(1, 3, 0, 10), poll(1, 4, 0, 4), poll(1, 1, 0, 16)];
    while line.now < length {
        let next = line.now + 100 * MS;
        for poll in polls {
            line.ask(poll, (2 * MS, 8 * MS));
        }
        line.wait_for(next);
    }
    line
}

/// Thirty units at 9600, each asked for two blocks, one request right after the other: the line is busy all the time.
fn thirty(seed: u64, length: i64) -> Line {
    let mut line = Line::new("9600-8E1", 500 * MS, seed);
    while line.now < length {
        for unit in 1..=30 {
            let fastest = (3 + i64::from(unit) % 7) * MS;
            line.ask(poll(unit, 3, 0, 8), (fastest, 3 * fastest));
            line.ask(poll(unit, 4, 20, 4), (fastest, 3 * fastest));
            line.wait_for(line.now + 20 * MS);
        }
    }
    line
}

/// A plant whose master is restarted once a day, rests from 23:00 to 05:00, writes setpoints and changes its lists every six
/// hours. Unit 5 is slow, unit 6 is added on the third day, units 2 and 3 refuse what they are asked first after a restart.
fn plant(seed: u64, length: i64) -> Line {
    let mut line = Line::new("19200-8E1", S, seed);
    let delay = |unit: u8| if unit == 5 { (200 * MS, 700 * MS) } else { (8 * MS, 30 * MS) };
    let (mut cycle, mut restarts) = (0, 9 * HOUR);
    while line.now < length {
        let next = line.now + 2 * S;
        let hour = line.now % DAY / HOUR;
        if !(5..23).contains(&hour) {
            line.look();
            line.wait_for(if hour < 5 { line.now - line.now % DAY + 5 * HOUR } else { line.now - line.now % DAY + 29 * HOUR });
            continue;
        }
        if line.now >= restarts {
            restarts = line.now - line.now % DAY + DAY + 6 * HOUR + line.dice.time(0, 16 * HOUR);
            restart(&mut line, delay);
        }
        let list = (line.now / (6 * HOUR)) % 3;
        let units = if line.now < 2 * DAY + 10 * HOUR { 1..=5 } else { 1..=6 };
        for unit in units {
            line.ask(Poll { unit, function: 3, address: 0, quantity: 12, every: 1 }, delay(unit));
            let more = Poll { unit, function: 4, address: 40 * list as u16, quantity: 6 + 2 * list as u16, every: 2 };
            if cycle % more.every == 0 {
                line.ask(more, delay(unit));
            }
        }
        if cycle % 150 == 0 {
            line.write(4, 100, delay(4));
        }
        cycle += 1;
        line.wait_for(next);
    }
    line
}

/// The master goes away in the middle of a request, and asks who is there when it returns.
fn restart(line: &mut Line, delay: impl Fn(u8) -> (i64, i64)) {
    line.send(&[1, 3, 0, 0, 0, 12], None);
    line.now += 20 * S + line.dice.time(0, 40 * S);
    for unit in 1..=3 {
        let refusal = if unit == 1 { vec![1, 0x11, 3, 9, 255, 1] } else { vec![unit, 0x91, 1] };
        line.exchange(&[unit, 0x11], &refusal, delay(unit));
    }
    for _ in 0..3 {
        line.exchange(&[2, 3, 0, 0, 0, 12], &[2, 0x83, 6], delay(2));
        line.now += S;
    }
}

/// A meter, and an inverter that is only asked from 06:00 to 20:00, with a line of its own.
fn solar(seed: u64, length: i64) -> Line {
    let mut line = Line::new("9600-8N1", S, seed);
    while line.now < length {
        let next = line.now + 5 * S;
        line.ask(poll(1, 4, 0, 20), (20 * MS, 60 * MS));
        line.ask(poll(1, 4, 60, 12), (20 * MS, 60 * MS));
        if (6..20).contains(&(line.now % DAY / HOUR)) {
            line.ask(poll(3, 3, 5000, 30), (60 * MS, 250 * MS));
            line.ask(poll(3, 4, 5100, 10), (60 * MS, 250 * MS));
        }
        line.wait_for(next);
    }
    line
}

/// A line of this seed for so long.
type Week = fn(u64, i64) -> Line;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|word| word.parse::<u64>().expect("a number"));
    let (seed, days) = (numbers.next().unwrap_or(1), numbers.next().unwrap_or(7));
    let length = days as i64 * DAY;
    let mut all = 0;
    let lines: [(&str, Week); 4] = [("plant", plant), ("solar", solar), ("thirty", thirty), ("fast", fast)];
    for (name, week) in lines {
        let line = week(seed, length);
        println!(
            "{name}: {days} days, {} requests, {} accidents: {} reported",
            line.exchanges,
            line.accidents,
            line.reported.len()
        );
        line.reported.iter().for_each(|event| println!("  {event}"));
        all += line.reported.len();
    }
    println!("{all} false events on four lines");
}
