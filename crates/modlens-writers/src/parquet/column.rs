//! A column: values are gathered until they are a page; pages wait, packed, until the part of the file is complete.
//!
//! A page is repetition levels (of lists), definition levels, values (parquet-format, README, "Data Pages"), and all of it
//! goes through zstd.

use std::io::Result as IoResult;

use arrow_buffer::NullBuffer;
use parquet::basic::{Compression, Encoding, ZstdLevel};
use parquet::column::page::{CompressedPage, Page, PageWriter};
use parquet::errors::Result;
use parquet::file::metadata::ColumnChunkMetaData;
use parquet::file::statistics::Statistics;
use parquet::file::writer::{SerializedPageWriter, TrackedWrite};
use parquet::schema::types::ColumnDescPtr;
use zstd::bulk::Compressor;
use zstd::zstd_safe::compress_bound;

use super::distinct::{Numbers, Words};
use super::encode::{push_varint, Deltas, Lengths, Plain, Runs};
use crate::values::ColumnBuilder;
use modlens_tables::columns::{CellSink, ColumnReader, ColumnType, RowRef, TableKind};

/// zstd: higher levels take twice the time for a twentieth less.
const LEVEL: i32 = 1;

/// A page is full with so many rows, or so many bytes of values: it is to stay in the processor's cache.
const PAGE_ROWS: usize = 8192;
const PAGE_BYTES: usize = 1 << 17;

/// Columns with few different values: a dictionary makes them small. On all others it costs time and room.
const FEW_VALUES: [&str; 21] = [
    "bus",
    "line",
    "client",
    "server",
    "connection",
    "mode",
    "direction",
    "unit",
    "function",
    "function_name",
    "exception",
    "exception_name",
    "verdict",
    "delimited_by",
    "operation",
    "register_type",
    "status",
    "code",
    "severity",
    "impact",
    "advice",
];

/// A column of a file.
pub(super) trait Column: Send {
    /// Takes the values of some more rows.
    fn take(&mut self, rows: &[RowRef<'_>], packer: &mut Packer) -> Result<()>;

    /// All rows of a part are there: `out`, at this place of the file, gets the column; the next part begins.
    fn end(&mut self, place: usize, packer: &mut Packer, out: &mut Vec<u8>) -> Result<ColumnChunkMetaData>;
}

/// The column of a table that a leaf of the schema stands for.
pub(super) fn column(table: TableKind, column: usize, leaf: ColumnDescPtr) -> Box<dyn Column> {
    let what = &table.columns()[column];
    match (what.kind, FEW_VALUES.contains(&what.key.as_str())) {
        (ColumnType::Int, true) => new(table, column, leaf, Numbers::<i64>::default()),
        (ColumnType::Int | ColumnType::Time, _) => new(table, column, leaf, Deltas::default()),
        (ColumnType::Us | ColumnType::Float, _) => new::<f64, _>(table, column, leaf, Plain::default()),
        (ColumnType::Bool, _) => new::<bool, _>(table, column, leaf, Plain::default()),
        (ColumnType::Text | ColumnType::Map, true) => new::<u8, _>(table, column, leaf, Words::default()),
        (ColumnType::Text | ColumnType::Map, false) => new(table, column, leaf, Lengths::default()),
        // Registers have 16 bits: a dictionary halves them, and no page has more than its values.
        (ColumnType::Ints, _) => new(table, column, leaf, Numbers::<i32>::default()),
        (ColumnType::Texts, _) => new::<&'static str, _>(table, column, leaf, Words::default()),
    }
}

/// How values become bytes.
pub(super) trait Encoder<T> {
    /// What it is called.
    const ENCODING: Encoding;

    /// Appends the values of a page that are not null.
    fn encode(&mut self, values: &ColumnBuilder<T>, nulls: Option<&NullBuffer>, out: &mut Vec<u8>);

    /// Appends the dictionary of the part, if it has one; gives the number of values. The next part has another.
    fn dictionary(&mut self, _out: &mut Vec<u8>) -> Option<usize> {
        None
    }

    /// The least and the greatest value of the part, where a query may ask for them.
    fn statistics(&mut self, nulls: u64) -> Option<Statistics>;
}

struct Chunk<T, E> {
    leaf: ColumnDescPtr,
    reader: ColumnReader<ColumnBuilder<T>>,
    values: ColumnBuilder<T>,
    encoder: E,
    /// Pages that are complete.
    pages: Vec<u8>,
    /// Bytes before they were packed, values with nulls, nulls among them: of these pages.
    size: usize,
    entries: usize,
    nulls: usize,
}

fn new<T, E>(table: TableKind, column: usize, leaf: ColumnDescPtr, encoder: E) -> Box<dyn Column>
where
    ColumnBuilder<T>: CellSink,
    T: Send + 'static,
    E: Encoder<T> + Send + 'static,
{
    let values = ColumnBuilder::with_capacity(0);
    Box::new(Chunk { leaf, reader: table.reader(column), values, encoder, pages: Vec::new(), size: 0, entries: 0, nulls: 0 })
}

impl<T, E: Encoder<T>> Chunk<T, E> {
    /// The values so far become a page.
    fn page(&mut self, packer: &mut Packer) -> Result<()> {
        let rows = self.values.rows();
        let nulls = self.values.nulls.finish();
        packer.plain.clear();
        let entries = if self.leaf.max_rep_level() > 0 {
            list_levels(&self.values.offsets, nulls.as_ref(), &mut packer.plain)
        } else {
            levels(rows, nulls.as_ref(), &mut packer.plain);
            rows
        };
        self.encoder.encode(&self.values, nulls.as_ref(), &mut packer.plain);
        let page = Page::DataPage {
            buf: packer.packed()?.into(),
            num_values: entries as u32,
            encoding: E::ENCODING,
            def_level_encoding: Encoding::RLE,
            rep_level_encoding: Encoding::RLE,
            statistics: None,
        };
        self.size += packer.write(page, &mut self.pages)?;
        self.entries += entries;
        self.nulls += nulls.map_or(0, |nulls| nulls.null_count());
        self.values.items.clear();
        self.values.offsets.truncate(1);
        Ok(())
    }
}

impl<T, E> Column for Chunk<T, E>
where
    ColumnBuilder<T>: CellSink,
    T: Send,
    E: Encoder<T> + Send,
{
    fn take(&mut self, rows: &[RowRef<'_>], packer: &mut Packer) -> Result<()> {
        self.values.take(rows, &self.reader);
        if self.values.rows() >= PAGE_ROWS || size_of_val(&*self.values.items) >= PAGE_BYTES {
            self.page(packer)?;
        }
        Ok(())
    }

    fn end(&mut self, place: usize, packer: &mut Packer, out: &mut Vec<u8>) -> Result<ColumnChunkMetaData> {
        if self.values.rows() > 0 {
            self.page(packer)?;
        }
        let start = out.len();
        let mut column = ColumnChunkMetaData::builder(self.leaf.clone());
        let mut encodings = vec![Encoding::RLE, E::ENCODING];
        if let Some(statistics) = self.encoder.statistics(self.nulls as u64) {
            column = column.set_statistics(statistics);
        }
        packer.plain.clear();
        if let Some(values) = self.encoder.dictionary(&mut packer.plain) {
            let buf = packer.packed()?.into();
            let page = Page::DictionaryPage { buf, num_values: values as u32, encoding: Encoding::PLAIN, is_sorted: false };
            self.size += packer.write(page, out)?;
            encodings.push(Encoding::PLAIN);
            column = column.set_dictionary_page_offset(Some(place as i64));
        }
        let data = place + out.len() - start;
        out.append(&mut self.pages);
        let column = column
            .set_encodings(encodings)
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(LEVEL)?))
            .set_num_values(self.entries as i64)
            .set_data_page_offset(data as i64)
            .set_total_compressed_size((out.len() - start) as i64)
            .set_total_uncompressed_size(self.size as i64);
        (self.size, self.entries, self.nulls) = (0, 0, 0);
        column.build()
    }
}

/// What all columns share: zstd's memory, and that of a page before it.
pub(super) struct Packer {
    zstd: Compressor<'static>,
    plain: Vec<u8>,
}

impl Packer {
    pub(super) fn new() -> IoResult<Self> {
        Ok(Self { zstd: Compressor::new(LEVEL)?, plain: Vec::new() })
    }

    /// What is in `plain`, packed.
    fn packed(&mut self) -> IoResult<Vec<u8>> {
        let mut packed = Vec::with_capacity(compress_bound(self.plain.len()));
        self.zstd.compress_to_buffer(&self.plain, &mut packed)?;
        Ok(packed)
    }

    /// Appends a page of what is in `plain`, behind its header; gives their size without zstd.
    fn write(&self, page: Page, out: &mut Vec<u8>) -> Result<usize> {
        let mut out = TrackedWrite::new(out);
        let mut writer = SerializedPageWriter::new(&mut out);
        let size = writer.write_page(CompressedPage::new(page, self.plain.len()))?.uncompressed_size;
        writer.close()?;
        Ok(size)
    }
}

/// Appends which rows have a value: 1, or 0 for null.
fn levels(rows: usize, nulls: Option<&NullBuffer>, out: &mut Vec<u8>) {
    let mut runs = Runs::begin(out);
    match nulls {
        None => runs.put(1, rows),
        Some(nulls) if nulls.null_count() == rows => runs.put(0, rows),
        Some(nulls) => {
            let bytes = rows.div_ceil(8);
            push_varint((bytes << 1 | 1) as u64, runs.out);
            runs.out.extend_from_slice(&nulls.validity()[..bytes]);
        }
    }
    runs.end();
}

/// Appends where lists begin, and what is in them: 0 for null, 1 for an empty one, 3 for an item; gives their number.
fn list_levels(offsets: &[i32], nulls: Option<&NullBuffer>, out: &mut Vec<u8>) -> usize {
    let lengths = || offsets.windows(2).map(|ends| (ends[1] - ends[0]) as usize);
    let (mut runs, mut entries) = (Runs::begin(out), 0);
    for length in lengths() {
        runs.put(0, 1);
        runs.put(1, length.saturating_sub(1));
        entries += length.max(1);
    }
    runs.end();
    let mut runs = Runs::begin(out);
    for (row, length) in lengths().enumerate() {
        match length {
            0 => runs.put(u8::from(nulls.is_none_or(|nulls| nulls.is_valid(row))), 1),
            _ => runs.put(3, length),
        }
    }
    runs.end();
    entries
}
