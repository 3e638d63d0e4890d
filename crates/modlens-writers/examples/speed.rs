//! What decoding costs, and what each writer adds: `cargo run --release --example speed -- FILE [OUT [WRITER...]]`
//!
//! FILE holds raw RTU bytes. Its first megabytes are decoded once; then every writer gets these rows again and again,
//! as whole captures, and the quickest pass counts, in CPU time: what else goes on beside it only makes passes slower.
//! With OUT the text is written to that file as well.
use std::fs::File;
use std::io::{Seek, Write};
use std::sync::Arc;
use std::time::Duration;

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_readers::chunk::Chunk;
use modlens_tables::columns::{Table, TableKind};
use modlens_writers::capture::{Capture, CaptureOptions};
use modlens_writers::csv::Csv;
use modlens_writers::jsonl::Jsonl;
use modlens_writers::line_format::LineFormat;
use modlens_writers::{LineWriter, TextBlock};
use rustix::time::{clock_gettime, ClockId};

/// Takes a batch, or nothing at the end, and hands its text on; gives the rows.
type Writer = Box<dyn FnMut(Option<&Arc<Batch>>, &mut dyn FnMut(&[u8])) -> usize>;
/// Begins a file.
type New = fn() -> Writer;

/// Bytes of the file that are decoded once.
const SAMPLE: usize = 1 << 22;
/// Bytes that a program would feed and write at a time.
const BLOCK: usize = 1 << 18;
const PIECE: usize = 1 << 16;
const PASSES: usize = 15;

const EIGHT: [&str; 8] = ["time", "unit", "function", "exception", "request_frame", "response_time_us", "address", "data"];
const TEN: [&str; 10] =
    ["time", "bus", "unit", "function", "exception", "status", "address", "quantity", "data", "response_time_us"];

/// CPU time of this thread since it began.
fn spent() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec.unsigned_abs(), now.tv_nsec as u32)
}

fn all(kind: TableKind) -> Vec<usize> {
    (0..kind.columns().len()).collect()
}

fn some(columns: &[&str]) -> Vec<usize> {
    columns.iter().map(|key| TableKind::Transactions.column(key).expect("a column")).collect()
}

fn lines<F: LineFormat>(kind: TableKind, columns: Vec<usize>) -> Writer {
    let (mut lines, mut block) = (LineWriter::<F>::new(kind, &columns), TextBlock::default());
    Box::new(move |batch, write| {
        let Some(batch) = batch else { return 0 };
        let table = Table::new(Arc::clone(batch), kind);
        let mut next = 0;
        while next < table.len() {
            block.clear();
            next = lines.rows(&table, next..table.len(), &mut block);
            write(block.text());
        }
        table.len()
    })
}

fn pcapng() -> Writer {
    let (mut capture, mut out) = (Capture::new(CaptureOptions::default()), Vec::new());
    Box::new(move |batch, write| {
        let Some(batch) = batch else {
            out.clear();
            capture.finish(&mut out);
            write(&out);
            return 0;
        };
        capture.add_batch(batch, None);
        loop {
            out.clear();
            capture.append_ready(PIECE, &mut out);
            if out.is_empty() {
                return batch.frames.len();
            }
            write(&out);
        }
    })
}

fn zeek() -> Writer {
    let mut out = Vec::new();
    Box::new(move |batch, write| {
        out.clear();
        let Some(batch) = batch else { return 0 };
        let table = Table::new(Arc::clone(batch), TableKind::Transactions);
        modlens_writers::zeek::Log::Modbus.rows(&table, false, &mut out);
        write(&out);
        table.len()
    })
}

fn file(parquet: bool, columns: Vec<usize>) -> Writer {
    use modlens_arrow::files::RowFile;
    let kind = TableKind::Transactions;
    let made = if parquet { RowFile::parquet(kind, columns, "") } else { RowFile::arrow(kind, columns, "") };
    let (mut file, mut out) = (made.expect("columns that Arrow takes"), Vec::new());
    Box::new(move |batch, write| {
        out.clear();
        let table = batch.map(|batch| Table::new(Arc::clone(batch), kind));
        match &table {
            Some(table) => file.rows(table, &mut out).expect("a buffer in memory"),
            None => file.end(&mut out).expect("a buffer in memory"),
        }
        write(&out);
        table.map_or(0, |table| table.len())
    })
}

const WRITERS: &[(&str, New)] = &[
    ("csv, eight columns", || lines::<Csv>(TableKind::Transactions, some(&EIGHT))),
    ("csv", || lines::<Csv>(TableKind::Transactions, all(TableKind::Transactions))),
    ("jsonl", || lines::<Jsonl>(TableKind::Transactions, all(TableKind::Transactions))),
    ("frames as jsonl", || lines::<Jsonl>(TableKind::Frames, all(TableKind::Frames))),
    ("pcapng", pcapng),
    ("zeek", zeek),
    ("arrow", || file(false, all(TableKind::Transactions))),
    ("parquet, ten columns", || file(true, some(&TEN))),
    ("parquet", || file(true, all(TableKind::Transactions))),
];

fn decode(data: &[u8]) -> (Vec<Arc<Batch>>, Duration) {
    let wanted = WantedTables { frames: true, transactions: true, findings: true };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
    let mut options = BusOptions::named("bus");
    options.mode = Some(Mode::Rtu);
    let bus = session.add_bus(options);
    let start = spent();
    let batches = data.chunks(BLOCK).map(|bytes| {
        session.feed(bus, &Chunk { bytes, ..Chunk::default() });
        Arc::new(session.take())
    });
    let batches = batches.collect();
    (batches, spent().saturating_sub(start))
}

fn main() {
    let mut words = std::env::args().skip(1);
    let data = std::fs::read(words.next().expect("a file of raw RTU bytes")).expect("a readable file");
    let mut file = words.next().map(|path| File::create(path).expect("a place for the output"));
    let chosen: Vec<String> = words.collect();
    let sample = &data[..data.len().min(SAMPLE)];
    let (batches, _) = decode(sample);
    let decoding = (0..5).map(|_| decode(sample).1).min().expect("five passes");
    let frames: usize = batches.iter().map(|batch| batch.frames.len()).sum();
    println!("{frames} frames; decoding, in fresh memory: {:.0} ns a frame", decoding.as_nanos() as f64 / frames as f64);
    for (name, new) in WRITERS.iter().filter(|(name, _)| chosen.is_empty() || chosen.iter().any(|word| word == name)) {
        let (mut best, mut rows, mut bytes) = (Duration::MAX, 0, 0);
        for _ in 0..PASSES {
            let mut writer = new();
            (rows, bytes) = (0, 0);
            if let Some(file) = &mut file {
                file.rewind().expect("a file");
            }
            let start = spent();
            for batch in batches.iter().map(Some).chain([None]) {
                rows += writer(batch, &mut |text| {
                    bytes += text.len();
                    if let Some(file) = &mut file {
                        file.write_all(text).expect("room on the disk");
                    }
                });
            }
            best = best.min(spent().saturating_sub(start));
        }
        let each = best.as_nanos() as f64 / rows as f64;
        println!("{name:<22} {each:5.0} ns a row, {:6.2} M rows/s, {:4.0} bytes a row", 1e3 / each, bytes as f64 / rows as f64);
    }
}
