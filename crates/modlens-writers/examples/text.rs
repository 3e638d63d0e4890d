//! Reads a log as one dialect, for `bench/text_speed.py`, which measures this process.
//!
//! `cargo run --release -p modlens-writers --example text -- engine|session DIALECT FILE`: `engine` stops at byte strings with
//! their times, `session` goes on to transactions.
use std::fs::File;
use std::io::Read;
use std::sync::Arc;

use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::functions::Functions;
use modlens_readers::text::{Dialects, Reader};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [how, dialect, path] = &arguments[..] else { panic!("engine|session DIALECT FILE") };
    let rows = Dialects::embedded().named(dialect).expect("a dialect of the table");
    let mut reader = Reader::new(rows, None, Arc::default());
    let mut file = File::open(path).expect("a readable file");
    let mut block = vec![0; 1 << 18];
    let mut next = |block: &mut [u8]| file.read(block).ok().filter(|&length| length > 0);
    if how == "engine" {
        let (mut records, mut size) = (0usize, 0);
        while let Some(length) = next(&mut block) {
            reader.push(&block[..length]);
            while let Some((_, bytes)) = reader.next(false) {
                records += 1;
                size += bytes.len();
            }
        }
        println!("{records} {size} {}", reader.unread_lines().count);
        return;
    }
    let mut session = Session::new(
        Arc::new(Functions::default()),
        WantedTables { frames: false, transactions: true, findings: false },
        false,
        None,
    );
    let bus = session.add_bus(BusOptions::named("bus"));
    session.open_text(bus, reader, b"");
    let mut transactions = 0;
    while let Some(length) = next(&mut block) {
        session.feed_text(bus, &block[..length], false);
        transactions += session.take().transactions.len();
    }
    session.feed_text(bus, b"", true);
    session.flush();
    transactions += session.take().transactions.len();
    let reader = session.reader(bus).expect("it was opened");
    println!("{} {transactions} {}", reader.records(), reader.unread_lines().count);
}
