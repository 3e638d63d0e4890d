//! Parquet (parquet-format 2.12), by the library's column writers.
//!
//! They are fed without the library's own way from Arrow (its feature `arrow`), which would bring kernels for arrays that
//! nothing here calls. How rows become values and levels is in `column`.

mod column;
mod footer;

use std::io::Write as _;
use std::sync::Arc;

use parquet::basic::{Compression, Encoding, Type, ZstdLevel};
use parquet::errors::Result;
use parquet::file::metadata::{FileMetaData, KeyValue};
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterPropertiesBuilder, WriterPropertiesPtr};
use parquet::file::writer::{SerializedRowGroupWriter, TrackedWrite};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::{SchemaDescPtr, SchemaDescriptor};

use crate::rows_to_columns::RowsToColumns;
use column::Column;
use footer::Footer;
use modlens_tables::columns::{ColumnType, Table, TableKind};

/// Rows of a row group; its columns are in memory, compressed, until it is complete.
const ROW_GROUP_ROWS: usize = 65_536;

/// Rows whose columns are read one after the other: rows and their bytes stay in the processor's cache meanwhile.
const ROWS_AT_ONCE: usize = 1024;

/// A page is full with so many rows, or so many bytes of values: it is to stay in the processor's cache.
const PAGE_ROWS: usize = 8192;
const PAGE_BYTES: usize = 1 << 17;

/// Levels that the library takes at a time; what a thousand rows hold is small enough as it is.
const BATCH_LEVELS: usize = 1 << 16;

/// zstd: higher levels take twice the time for a twentieth less.
const ZSTD_LEVEL: i32 = 1;

/// Columns with few different values: a dictionary makes them small. On all others it costs time and room.
const FEW_VALUES: [&str; 25] = [
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
    "closed_by",
    "first_status",
    "client_framing",
    "server_framing",
];

/// Writes a file, row group by row group.
pub(super) struct Parquet {
    schema: SchemaDescPtr,
    properties: WriterPropertiesPtr,
    /// What has not been given away of the file.
    bytes: TrackedWrite<Vec<u8>>,
    footer: Footer,
    columns: Vec<Box<dyn Column>>,
    adding: RowsToColumns,
    /// Of the row group that is being filled.
    rows: usize,
}

impl Parquet {
    /// For these columns of a table; `metadata` is kept as it is.
    pub(super) fn new(kind: TableKind, columns: &[usize], metadata: &[(&str, String)], version: &str) -> Result<Self> {
        let schema = Arc::new(SchemaDescriptor::new(Arc::new(parse_message_type(&message(kind, columns))?)));
        let properties = Arc::new(properties(kind, columns, &schema, version)?.build());
        let metadata = metadata.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
        let (made_by, version) = (properties.created_by().to_owned(), properties.writer_version().as_num());
        let file = FileMetaData::new(version, 0, Some(made_by), Some(metadata), Arc::clone(&schema), None);
        let mut bytes = TrackedWrite::new(Vec::new());
        bytes.write_all(b"PAR1")?;
        let leaves = columns.iter().zip(schema.columns());
        Ok(Self {
            columns: leaves.map(|(&column, leaf)| column::column(kind, column, leaf, &properties)).collect(),
            schema,
            properties,
            bytes,
            footer: Footer::new(file),
            adding: RowsToColumns::default(),
            rows: 0,
        })
    }

    /// Takes the rows of a table; `out` gets the row groups that are complete.
    pub(super) fn rows(&mut self, table: &Table, out: &mut Vec<u8>) -> Result<()> {
        let mut next = 0;
        while next < table.len() {
            let end = table.len().min(next + ROWS_AT_ONCE.min(ROW_GROUP_ROWS - self.rows));
            self.adding.add(table, next..end, &mut self.columns);
            for column in &mut self.columns {
                column.write()?;
            }
            self.rows += end - next;
            next = end;
            if self.rows == ROW_GROUP_ROWS {
                self.row_group()?;
            }
        }
        give_away(&mut self.bytes, out)
    }

    /// The last row group, and the footer.
    pub(super) fn end(mut self, out: &mut Vec<u8>) -> Result<()> {
        if self.rows > 0 {
            self.row_group()?;
        }
        give_away(&mut self.bytes, out)?;
        self.footer.finish(out)
    }

    /// The columns of the rows so far become a row group.
    fn row_group(&mut self) -> Result<()> {
        let (schema, properties) = (Arc::clone(&self.schema), Arc::clone(&self.properties));
        let mut row_group = SerializedRowGroupWriter::new(schema, properties, &mut self.bytes, self.footer.count() as i32, None);
        for column in &mut self.columns {
            let (pages, close) = column.close()?;
            row_group.append_column(&pages, close)?;
        }
        self.footer.add(Arc::unwrap_or_clone(row_group.close()?))?;
        self.rows = 0;
        Ok(())
    }
}

/// Moves what was written to `out`.
fn give_away(bytes: &mut TrackedWrite<Vec<u8>>, out: &mut Vec<u8>) -> Result<()> {
    bytes.flush()?;
    if out.is_empty() {
        std::mem::swap(out, bytes.inner_mut());
    } else {
        out.append(bytes.inner_mut());
    }
    Ok(())
}

/// The schema as Parquet's own language has it ("Logical Types" of parquet-format).
fn message(kind: TableKind, columns: &[usize]) -> String {
    let fields = columns.iter().map(|&column| field(&kind.columns()[column].key, kind.columns()[column].kind));
    format!("message arrow_schema {{ {} }}", fields.collect::<String>())
}

fn field(key: &str, kind: ColumnType) -> String {
    let list = |item: &str| format!("optional group {key} (LIST) {{ repeated group list {{ optional {item}; }} }} ");
    match kind {
        ColumnType::Int => format!("optional int64 {key}; "),
        ColumnType::Us | ColumnType::Float => format!("optional double {key}; "),
        ColumnType::Time => format!("optional int64 {key} (TIMESTAMP(NANOS,true)); "),
        ColumnType::Bool => format!("optional boolean {key}; "),
        ColumnType::Text | ColumnType::Map => format!("optional binary {key} (STRING); "),
        ColumnType::Ints => list("int32 item"),
        ColumnType::Texts => list("binary item (STRING)"),
    }
}

/// How each column is written.
fn properties(kind: TableKind, columns: &[usize], schema: &SchemaDescriptor, version: &str) -> Result<WriterPropertiesBuilder> {
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("modlens {version}"))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(ZSTD_LEVEL)?))
        .set_data_page_row_count_limit(PAGE_ROWS)
        .set_data_page_size_limit(PAGE_BYTES)
        .set_write_batch_size(BATCH_LEVELS)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true);
    for (leaf, what) in schema.columns().iter().zip(columns.iter().map(|&column| &kind.columns()[column])) {
        let path = leaf.path();
        let few = what.kind == ColumnType::Texts || FEW_VALUES.contains(&what.key.as_str());
        properties = properties.set_column_dictionary_enabled(path.clone(), few);
        // Counters, times and registers that hardly change take next to no room as differences.
        if matches!(leaf.physical_type(), Type::INT32 | Type::INT64) {
            properties = properties.set_column_encoding(path.clone(), Encoding::DELTA_BINARY_PACKED);
        }
        // The least and the greatest of all registers of a device help no query.
        if leaf.max_rep_level() > 0 {
            properties = properties.set_column_statistics_enabled(path.clone(), EnabledStatistics::None);
        }
    }
    Ok(properties)
}

#[cfg(test)]
mod tests {
    use arrow_array::cast::AsArray as _;
    use arrow_array::types::{Float64Type, Int32Type, Int64Type, TimestampNanosecondType};
    use arrow_array::Array;
    use arrow_schema::DataType;
    use parquet::file::metadata::RowGroupMetaData;
    use parquet::file::reader::FileReader as _;
    use parquet::file::serialized_reader::SerializedFileReader;
    use parquet::record::Field;
    use proptest::prelude::*;

    use super::*;
    use crate::batch::batch_of;
    use modlens_engine::records::{Batch, Bus, FindingRow, Frame, Network, Span};
    use modlens_engine::session::{BusOptions, Session, WantedTables};
    use modlens_protocol::finding::Finding;
    use modlens_protocol::source::{Clock, Place};
    use modlens_readers::chunk::{Chunk, Times};

    #[test]
    fn columns_with_few_values_are_columns_of_a_table() {
        for key in FEW_VALUES {
            assert!(TableKind::ALL.iter().any(|table| table.column(key).is_ok()), "{key}");
        }
    }

    /// The file of these tables, rows given so many batches at a time.
    fn file(tables: &[Table]) -> Vec<u8> {
        let kind = tables[0].kind;
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        let mut file = Parquet::new(kind, &columns, &[("modlens.table", kind.name().to_owned())], "0").unwrap();
        let mut out = Vec::new();
        for table in tables {
            file.rows(table, &mut out).unwrap();
        }
        file.end(&mut out).unwrap();
        out
    }

    /// The library reads out of the file what goes into Arrow's arrays.
    fn assert_whole(tables: &[Table]) {
        let reader = SerializedFileReader::new(bytes::Bytes::from(file(tables))).unwrap();
        let kind = tables[0].kind;
        let columns: Vec<usize> = (0..kind.columns().len()).collect();
        let mut rows = reader.get_row_iter(None).unwrap();
        for table in tables {
            let expected = batch_of(table, 0..table.len(), &columns);
            for at in 0..table.len() {
                let row = rows.next().expect("more rows").unwrap();
                for ((key, is), should) in row.get_column_iter().zip(expected.columns()) {
                    assert!(same(is, should, at), "{} {key}: {is} is not {should:?} {at}", kind.name());
                }
            }
        }
        assert!(rows.next().is_none());
    }

    fn same(is: &Field, array: &dyn Array, at: usize) -> bool {
        let there = array.is_valid(at);
        match is {
            Field::Null => !there,
            Field::Bool(yes) => there && array.as_boolean().value(at) == *yes,
            Field::Int(number) => there && array.as_primitive::<Int32Type>().value(at) == *number,
            Field::Long(number) if matches!(array.data_type(), DataType::Timestamp(..)) => {
                there && array.as_primitive::<TimestampNanosecondType>().value(at) == *number
            }
            Field::Long(number) => there && array.as_primitive::<Int64Type>().value(at) == *number,
            Field::Double(number) => there && array.as_primitive::<Float64Type>().value(at).to_bits() == number.to_bits(),
            Field::Str(text) => there && array.as_string::<i32>().value(at) == text,
            Field::ListInternal(list) => {
                let items = array.as_list::<i32>().value(at);
                there && list.len() == items.len() && list.elements().iter().enumerate().all(|(i, one)| same(one, &items, i))
            }
            _ => false,
        }
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
            for kind in TableKind::ALL {
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
        let network = Some(Network { client: String::new(), client_port: None, server: name.to_owned(), connection });
        Bus { name: name.to_owned(), source: "file".to_owned(), place: Place::Line, clock: Clock::Utc, line: None, network }
    }

    /// More rows than a page and a row group hold, and many values in a dictionary.
    #[test]
    fn many_rows_and_values_are_read_back() {
        let buses = (0..70_000).map(|at| a_bus("bus", at)).collect();
        let mut batch = Batch::default();
        batch.buses = Arc::new(buses);
        let pieces: Vec<Vec<u8>> = vec![request(1, &[6, 0, 7, 1, 2]).repeat(2)];
        let one = decoded(&pieces, false).into_iter().find_map(|batch| batch.frames.first().cloned()).expect("a frame");
        batch.frames =
            (0..70_000).map(|at| Frame { bus: at, wire: Span::default(), findings: Span::default(), ..one.clone() }).collect();
        let table = Table::new(Arc::new(batch), TableKind::Frames);
        let reader = SerializedFileReader::new(bytes::Bytes::from(file(std::slice::from_ref(&table)))).unwrap();
        let row_groups: Vec<i64> = reader.metadata().row_groups().iter().map(RowGroupMetaData::num_rows).collect();
        assert_eq!(row_groups, [65_536, 4_464]);
        assert_whole(&[table]);
    }

    /// Every value that a register can have, twice: the greatest of them has all bits.
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

    /// Bounds of each row group, from the rows themselves.
    #[test]
    fn row_groups_say_what_is_in_them() {
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
        assert_eq!(said("detail"), (Some(Vec::new()), Some(Vec::new()), Some(0)));
    }
}
