//! Where the time goes: session alone, and with CSV. `cargo run --release --example speed -- FILE`
use std::sync::Arc;
use std::time::Instant;

use modlens_core::chunk::Chunk;
use modlens_core::columns::{Table, TableKind};
use modlens_core::framer::Mode;
use modlens_core::functions::Functions;
use modlens_core::session::{BusOptions, Session, Wanted};

fn main() {
    let path = std::env::args().nth(1).expect("a file of raw RTU bytes");
    let data = std::fs::read(path).expect("a readable file");
    for csv in [false, true] {
        let wanted = Wanted { frames: false, transactions: true, findings: false };
        let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
        let mut options = BusOptions::named("bus");
        options.mode = Some(Mode::Rtu);
        let bus = session.add_bus(options);
        let columns: Vec<usize> = (0..TableKind::Transactions.columns().len()).collect();
        let start = Instant::now();
        let (mut rows, mut bytes) = (0, 0);
        let mut out = Vec::new();
        for block in data.chunks(1 << 18) {
            session.feed(bus, &Chunk { bytes: block, ..Chunk::default() });
            let batch = Arc::new(session.take());
            let table = Table::new(batch, TableKind::Transactions);
            rows += table.len();
            if csv {
                out.clear();
                modlens_core::write::csv::rows(&table, &columns, &mut out);
                bytes += out.len();
            }
        }
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "csv {csv}: {rows} rows, {bytes} bytes, {:.0} MB/s, {:.0} ns/row",
            data.len() as f64 / seconds / 1e6,
            seconds * 1e9 / rows as f64
        );
    }
}
