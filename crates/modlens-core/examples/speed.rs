//! Where the time goes: the session alone, and what each writer adds. `cargo run --release --example speed -- FILE`
use std::sync::Arc;
use std::time::{Duration, Instant};

use modlens_core::chunk::Chunk;
use modlens_core::columns::{Table, TableKind};
use modlens_core::framer::Mode;
use modlens_core::functions::Functions;
use modlens_core::records::Batch;
use modlens_core::session::{BusOptions, Session, Wanted};
use modlens_core::write::capture::{Capture, Options};

/// Takes a batch, appends what it makes of it; gives the rows.
type Writer = Box<dyn FnMut(&Arc<Batch>, &mut Vec<u8>) -> usize>;

fn all(kind: TableKind) -> Vec<usize> {
    (0..kind.columns().len()).collect()
}

fn csv(kind: TableKind) -> Writer {
    let columns = all(kind);
    Box::new(move |batch, out| {
        let table = Table::new(Arc::clone(batch), kind);
        modlens_core::write::csv::rows(&table, &columns, out);
        table.len()
    })
}

fn jsonl(kind: TableKind) -> Writer {
    let columns = all(kind);
    Box::new(move |batch, out| {
        let table = Table::new(Arc::clone(batch), kind);
        modlens_core::write::jsonl::rows(&table, &columns, out);
        table.len()
    })
}

fn pcapng() -> Writer {
    let mut capture = Capture::new(Options::default());
    Box::new(move |batch, out| {
        capture.put(batch, None, out);
        batch.frames.len()
    })
}

#[cfg(feature = "files")]
fn file(parquet: bool, columns: Option<&[&str]>) -> Writer {
    use modlens_core::write::files::RowFile;
    let kind = TableKind::Transactions;
    let some = columns.map(|keys| keys.iter().map(|key| kind.column(key).expect("a column")).collect());
    let columns = some.unwrap_or_else(|| all(kind));
    let made = if parquet { RowFile::parquet(kind, columns, "") } else { RowFile::arrow(kind, columns, "") };
    let mut file = made.expect("columns that Arrow takes");
    Box::new(move |batch, out| {
        let table = Table::new(Arc::clone(batch), kind);
        file.rows(&table, out).expect("a buffer in memory");
        table.len()
    })
}

fn main() {
    let path = std::env::args().nth(1).expect("a file of raw RTU bytes");
    let data = std::fs::read(path).expect("a readable file");
    let mut writers: Vec<(&str, Writer)> = vec![
        ("csv", csv(TableKind::Transactions)),
        ("jsonl", jsonl(TableKind::Transactions)),
        ("frames as jsonl", jsonl(TableKind::Frames)),
        ("pcapng", pcapng()),
    ];
    #[cfg(feature = "files")]
    writers.extend([
        ("arrow", file(false, None)),
        ("parquet", file(true, None)),
        ("parquet, no hex", file(true, Some(&["time", "bus", "unit", "function", "address", "quantity", "data", "status"]))),
    ]);
    let mut session =
        Session::new(Arc::new(Functions::default()), Wanted { frames: true, transactions: true, findings: true }, false, None);
    let mut options = BusOptions::named("bus");
    options.mode = Some(Mode::Rtu);
    let bus = session.add_bus(options);
    let mut decoding = Duration::ZERO;
    let mut frames = 0;
    let mut spent = vec![(Duration::ZERO, 0, 0); writers.len()];
    let mut out = Vec::new();
    for block in data.chunks(1 << 18) {
        let start = Instant::now();
        session.feed(bus, &Chunk { bytes: block, ..Chunk::default() });
        let batch = Arc::new(session.take());
        decoding += start.elapsed();
        frames += batch.frames.len();
        for ((_, writer), (time, rows, bytes)) in writers.iter_mut().zip(&mut spent) {
            out.clear();
            let start = Instant::now();
            *rows += writer(&batch, &mut out);
            *time += start.elapsed();
            *bytes += out.len();
        }
    }
    let seconds = decoding.as_secs_f64();
    println!(
        "decoding: {frames} frames, {:.0} MB/s, {:.0} ns/frame",
        data.len() as f64 / seconds / 1e6,
        seconds * 1e9 / frames as f64
    );
    for ((name, _), (time, rows, bytes)) in writers.iter().zip(&spent) {
        let seconds = time.as_secs_f64();
        println!(
            "{name:<16} {rows} rows, {:.1} MB, {:.0} ns/row, {:.2} M rows/s",
            *bytes as f64 / 1e6,
            seconds * 1e9 / *rows as f64,
            *rows as f64 / seconds / 1e6
        );
    }
}
