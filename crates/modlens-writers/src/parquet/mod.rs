//! Parquet (parquet-format 2.12): parts of rows, in each the columns one behind the other, in pages.
//!
//! The layout is ours, because arrow-rs takes a list apart item by item: here a list of registers costs what its bytes
//! cost. Headers, schema and footer are arrow-rs'. How a column becomes bytes is told in `column`, the encodings in
//! `encode` and `distinct`.

mod column;
mod distinct;
mod encode;

use std::sync::Arc;

use arrow_schema::Schema;
use parquet::arrow::{encode_arrow_schema, ArrowSchemaConverter, ARROW_SCHEMA_META_KEY};
use parquet::basic::ColumnOrder;
use parquet::errors::Result;
use parquet::file::metadata::{
    ColumnChunkMetaData, FileMetaData, KeyValue, ParquetMetaData, ParquetMetaDataWriter, RowGroupMetaData,
};
use parquet::schema::types::SchemaDescPtr;

use column::{Column, Packer};
use modlens_tables::columns::{RowRef, Table, TableKind};

/// Rows that a part of a file holds; its columns are in memory, packed, until it is complete.
const PART: usize = 65_536;

/// Rows whose columns are read one after the other: rows and their bytes stay in the processor's cache meanwhile.
const AT_ONCE: usize = 1024;

const MAGIC: &[u8] = b"PAR1";

/// Writes a file, part by part.
pub(super) struct Parquet {
    schema: SchemaDescPtr,
    columns: Vec<Box<dyn Column>>,
    packer: Packer,
    /// Of the part that is being filled.
    rows: usize,
    parts: Vec<RowGroupMetaData>,
    /// Bytes so far.
    written: usize,
    about: Vec<KeyValue>,
    version: String,
}

impl Parquet {
    /// For these columns of a table, which `arrow` describes.
    pub(super) fn new(kind: TableKind, columns: &[usize], arrow: &Schema, version: &str) -> Result<Self> {
        let schema = Arc::new(ArrowSchemaConverter::new().convert(arrow)?);
        let leaves = columns.iter().zip(schema.columns());
        Ok(Self {
            columns: leaves.map(|(&column, leaf)| column::column(kind, column, Arc::clone(leaf))).collect(),
            packer: Packer::new()?,
            schema,
            rows: 0,
            parts: Vec::new(),
            written: 0,
            about: vec![KeyValue::new(ARROW_SCHEMA_META_KEY.to_owned(), encode_arrow_schema(arrow))],
            version: format!("modlens {version}"),
        })
    }

    /// Takes the rows of a table; `out` gets the parts that are complete.
    pub(super) fn rows(&mut self, table: &Table, out: &mut Vec<u8>) -> Result<()> {
        let mut next = 0;
        while next < table.len() {
            let end = table.len().min(next + AT_ONCE.min(PART - self.rows));
            let rows: Vec<RowRef<'_>> = (next..end).map(|row| table.row(row)).collect();
            for column in &mut self.columns {
                column.take(&rows, &mut self.packer)?;
            }
            self.rows += rows.len();
            next = end;
            if self.rows == PART {
                self.part(out)?;
            }
        }
        Ok(())
    }

    /// The last part, and the footer.
    pub(super) fn end(mut self, out: &mut Vec<u8>) -> Result<()> {
        if self.rows > 0 {
            self.part(out)?;
        }
        self.begin(out);
        let orders = self.schema.columns().iter().map(|leaf| ColumnOrder::TYPE_DEFINED_ORDER(leaf.sort_order()));
        let rows = self.parts.iter().map(RowGroupMetaData::num_rows).sum();
        let file =
            FileMetaData::new(1, rows, Some(self.version), Some(self.about), Arc::clone(&self.schema), Some(orders.collect()));
        ParquetMetaDataWriter::new(out, &ParquetMetaData::new(file, self.parts)).finish()
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        if self.written == 0 {
            out.extend_from_slice(MAGIC);
            self.written = MAGIC.len();
        }
    }

    /// The columns of the rows so far become a part.
    fn part(&mut self, out: &mut Vec<u8>) -> Result<()> {
        self.begin(out);
        let mut chunks = Vec::with_capacity(self.columns.len());
        for column in &mut self.columns {
            let before = out.len();
            chunks.push(column.end(self.written, &mut self.packer, out)?);
            self.written += out.len() - before;
        }
        let size = chunks.iter().map(ColumnChunkMetaData::uncompressed_size).sum();
        let part = RowGroupMetaData::builder(Arc::clone(&self.schema));
        let part = part.set_column_metadata(chunks).set_num_rows(self.rows as i64).set_total_byte_size(size);
        self.parts.push(part.build()?);
        self.rows = 0;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use arrow_array::RecordBatchReader as _;
    use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
    use parquet::file::reader::FileReader as _;
    use parquet::file::serialized_reader::SerializedFileReader;
    use proptest::prelude::*;

    use super::*;
    use crate::arrow::{batch_of, schema};
    use modlens_engine::records::{Batch, Bus, FindingRow, Frame, Network, Span};
    use modlens_engine::session::{BusOptions, Session, WantedTables};
    use modlens_protocol::finding::Finding;
    use modlens_protocol::source::{Clock, Place};
    use modlens_readers::chunk::{Chunk, Times};

    const TABLES: [TableKind; 4] = [TableKind::Frames, TableKind::Transactions, TableKind::Readings, TableKind::Findings];

    /// The file of these tables, rows given so many batches at a time.
    fn file(tables: &[Table]) -> Vec<u8> {
        let kind = tables[0].kind;
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        let mut file = Parquet::new(kind, &columns, &schema(kind), "0").unwrap();
        let mut out = Vec::new();
        for table in tables {
            file.rows(table, &mut out).unwrap();
        }
        file.end(&mut out).unwrap();
        out
    }

    /// arrow-rs reads out of the file what goes into its own arrays.
    fn assert_whole(tables: &[Table]) {
        let bytes = bytes::Bytes::from(file(tables));
        let reader = ParquetRecordBatchReaderBuilder::try_new(bytes).unwrap().with_batch_size(1 << 20).build().unwrap();
        let kind = tables[0].kind;
        assert_eq!(reader.schema().fields(), schema(kind).fields());
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        let mut found = reader.map(Result::unwrap);
        let (mut batch, mut at) = (None, 0);
        for table in tables {
            let mut next = 0;
            while next < table.len() {
                let there = batch.get_or_insert_with(|| found.next().expect("more rows"));
                let count = (table.len() - next).min(there.num_rows() - at);
                let expected = batch_of(table, next..next + count, &columns);
                for (column, (is, should)) in there.slice(at, count).columns().iter().zip(expected.columns()).enumerate() {
                    assert_eq!(is, should, "{} {}", kind.name(), kind.columns()[column].key);
                }
                (next, at) = (next + count, at + count);
                if at == there.num_rows() {
                    (batch, at) = (None, 0);
                }
            }
        }
        assert!(found.next().is_none());
    }

    fn decoded(pieces: &[Vec<u8>], with_clock: bool) -> Vec<Arc<Batch>> {
        let mut session =
            Session::new(Arc::default(), WantedTables { frames: true, transactions: true, findings: true }, false, None);
        let mut options = BusOptions::named("bus");
        options.bus.clock = if with_clock { Clock::Utc } else { Clock::None };
        let bus = session.add_bus(options);
        let mut batches = Vec::new();
        for (at, bytes) in pieces.iter().enumerate() {
            let read = Times::Read(1_700_000_000_000_000_000 + at as i64 * 50_000_000);
            let times = if with_clock { read } else { Times::None };
            session.feed(bus, &Chunk { bytes, times, ..Chunk::default() });
            batches.push(Arc::new(session.take()));
        }
        session.flush();
        batches.push(Arc::new(session.take()));
        batches
    }

    fn request(unit: u8, pdu: &[u8]) -> Vec<u8> {
        let mut bytes = [&[unit], pdu].concat();
        bytes.extend_from_slice(&modlens_protocol::checksum::crc16(&bytes).to_le_bytes());
        bytes
    }

    /// A read of registers with its answer, a single write, an exception, noise.
    fn traffic() -> impl Strategy<Value = Vec<u8>> {
        let registers = (1..40_u8, any::<u16>(), proptest::collection::vec(any::<u16>(), 1..20));
        prop_oneof![
            4 => registers.prop_map(|(unit, address, values)| {
                let [high, low] = address.to_be_bytes();
                let data: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
                let answer = [&[3, data.len() as u8], &*data].concat();
                [request(unit, &[3, high, low, 0, values.len() as u8]), request(unit, &answer)].concat()
            }),
            1 => any::<u16>().prop_map(|value| {
                let [high, low] = value.to_be_bytes();
                request(1, &[6, 0, 7, high, low]).repeat(2)
            }),
            1 => Just([request(9, &[1, 0, 0, 0, 8]), request(9, &[0x81, 2])].concat()),
            1 => Just([request(3, &[7]), request(3, &[7, 0x55])].concat()),
            1 => proptest::collection::vec(any::<u8>(), 1..30),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        #[test]
        fn all_tables_of_any_traffic_are_read_back(pieces in proptest::collection::vec(traffic(), 0..60), timed: bool) {
            let batches = decoded(&pieces, timed);
            for kind in TABLES {
                assert_whole(&batches.iter().map(|batch| Table::new(Arc::clone(batch), kind)).collect::<Vec<_>>());
            }
        }

        /// Numbers of all sizes, texts of all lengths, nulls anywhere.
        #[test]
        fn any_rows_are_read_back(rows in proptest::collection::vec((any::<Option<u64>>(), any::<i64>(), ".{0,9}", any::<Option<u8>>()), 1..500)) {
            let mut batch = Batch::default();
        batch.buses = Arc::new([a_bus("one", 0), a_bus("two", u64::MAX)].into_iter().collect());
            batch.findings = rows.into_iter().map(|(number, time, detail, unit)| FindingRow {
                frame: number,
                txn: number.map(|number| number >> 40),
                bus: u32::from(unit.is_some()),
                start: Some(time),
                elapsed: unit.map(|_| time >> 12),
                unit,
                finding: if time % 4 == 0 { Finding::Exception } else { Finding::BadChecksum },
                detail,
                origin: time as u64,
            }).collect();
            assert_whole(&[Table::new(Arc::new(batch), TableKind::Findings)]);
        }
    }

    fn a_bus(name: &str, connection: u64) -> Bus {
        let network = Some(Network { client: String::new(), server: name.to_owned(), connection });
        Bus { name: name.to_owned(), source: "file".to_owned(), place: Place::Line, clock: Clock::Utc, line: None, network }
    }

    /// More rows than a page and a part hold, more values than a dictionary of two bytes has places for.
    #[test]
    fn many_rows_and_values_are_read_back() {
        let buses = (0..70_000).map(|at| a_bus("bus", at)).collect();
        let mut batch = Batch::default();
        batch.buses = Arc::new(buses);
        let pieces: Vec<Vec<u8>> = vec![request(1, &[6, 0, 7, 1, 2]).repeat(2)];
        let one = decoded(&pieces, false).into_iter().find_map(|batch| batch.frames.first().cloned()).expect("a frame");
        batch.frames = (0..70_000).map(|at| Frame { bus: at, wire: Span::default(), ..one.clone() }).collect();
        let table = Table::new(Arc::new(batch), TableKind::Frames);
        let reader = SerializedFileReader::new(bytes::Bytes::from(file(std::slice::from_ref(&table)))).unwrap();
        let parts: Vec<i64> = reader.metadata().row_groups().iter().map(RowGroupMetaData::num_rows).collect();
        assert_eq!(parts, [65_536, 4_464]);
        assert_whole(&[table]);
    }

    /// Every value that a register can have, twice: the last of them has the last place of two bytes.
    #[test]
    fn all_registers_are_read_back() {
        let values: Vec<u8> = (0..=u16::MAX).flat_map(u16::to_be_bytes).collect();
        let exchange = |data: &[u8]| {
            let answer = [&[3, data.len() as u8], data].concat();
            [request(1, &[3, 0, 0, 0, (data.len() / 2) as u8]), request(1, &answer)].concat()
        };
        let pieces: Vec<Vec<u8>> = values.chunks(250).chain(values.chunks(250)).map(exchange).collect();
        let batches = decoded(&pieces, false);
        let tables: Vec<Table> = batches.into_iter().map(|batch| Table::new(batch, TableKind::Transactions)).collect();
        assert!(tables.iter().map(Table::len).sum::<usize>() >= pieces.len() - 2);
        assert_whole(&tables);
    }

    /// Bounds of each part, from the rows themselves.
    #[test]
    fn parts_say_what_is_in_them() {
        let mut batch = Batch::default();
        batch.buses = Arc::new([a_bus("b", 1), a_bus("a", 2)].into_iter().collect());
        let row = |frame, bus, start| FindingRow {
            frame,
            txn: None,
            bus,
            start,
            elapsed: start,
            unit: None,
            finding: Finding::Exception,
            detail: String::new(),
            origin: 0,
        };
        batch.findings = vec![row(Some(7), 0, Some(-5_000)), row(None, 1, Some(3_000)), row(Some(2), 1, None)];
        let kind = TableKind::Findings;
        let reader = SerializedFileReader::new(bytes::Bytes::from(file(&[Table::new(Arc::new(batch), kind)]))).unwrap();
        let said = |key| {
            let chunk = reader.metadata().row_group(0).column(kind.column(key).unwrap()).clone();
            let statistics = chunk.statistics().expect("statistics").clone();
            let bytes = |bound: Option<&[u8]>| bound.map(<[u8]>::to_vec);
            (bytes(statistics.min_bytes_opt()), bytes(statistics.max_bytes_opt()), statistics.null_count_opt())
        };
        let number = |value: i64| Some(value.to_le_bytes().to_vec());
        let float = |value: f64| Some(value.to_le_bytes().to_vec());
        assert_eq!(said("frame"), (number(2), number(7), Some(1)));
        assert_eq!(said("time"), (number(-5_000), number(3_000), Some(1)));
        assert_eq!(said("elapsed_us"), (float(-5.0), float(3.0), Some(1)));
        assert_eq!(said("bus"), (Some(b"a".to_vec()), Some(b"b".to_vec()), Some(0)));
        assert_eq!(said("unit"), (None, None, Some(3)));
        assert_eq!(said("detail"), (None, None, Some(0)));
    }
}
