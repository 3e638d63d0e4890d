//! The footer of a file. What it reports about a row group is encoded as soon as that is complete: as the library holds it, it takes ten times
//! the memory, and a long recording has a thousand of them.
//!
//! The footer is a struct of Thrift's compact protocol, in which the number of all rows is followed by the list of row groups
//! (parquet-format, `FileMetaData`). The library encodes it with a single row group, of which the bytes are taken.

use parquet::errors::{ParquetError, Result};
use parquet::file::metadata::{FileMetaData, ParquetMetaDataBuilder, ParquetMetaDataWriter, RowGroupMetaData};

/// The header of a list field after the field before it.
const LIST_FIELD: u8 = 0x19;

/// The header of a list of structs, without the number of its items in the upper half; 15 there says that the number follows.
const OF_STRUCTS: u8 = 0x0C;

/// The length of the footer and the magic number, which the library writes after it.
const TAIL_BYTES: usize = 8;

/// What a file ends with.
pub(super) struct Footer {
    file: FileMetaData,
    /// What is in front of the number of rows, and after the list of row groups.
    around: [Vec<u8>; 2],
    /// The encoded row groups.
    row_groups: Vec<u8>,
    count: u64,
    rows: u64,
}

impl Footer {
    /// Of a file without row groups so far.
    pub(super) fn new(file: FileMetaData) -> Self {
        Self { file, around: [Vec::new(), Vec::new()], row_groups: Vec::new(), count: 0, rows: 0 }
    }

    /// How many row groups there are.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// The next row group is complete.
    pub(super) fn add(&mut self, row_group: RowGroupMetaData) -> Result<()> {
        let rows = row_group.num_rows() as u64;
        let [empty, one] = [self.encoded(None)?, self.encoded(Some(row_group))?];
        let (before, behind) = around_row_groups(&empty, &one)?;
        // After the number of rows, which has seven bits a byte.
        let number = one[before.len()..].iter().position(|byte| byte & 0x80 == 0).ok_or_else(unknown)? + 1;
        let list = &one[before.len() + number..one.len() - behind.len()];
        let [LIST_FIELD, 0x1C, row_group @ ..] = list else { return Err(unknown()) };
        self.row_groups.extend_from_slice(row_group);
        self.around = [before.to_vec(), behind.to_vec()];
        self.count += 1;
        self.rows += rows;
        Ok(())
    }

    /// The end of the file.
    pub(super) fn finish(&self, out: &mut Vec<u8>) -> Result<()> {
        let start = out.len();
        let [before, behind] = &self.around;
        if self.count == 0 {
            out.extend_from_slice(&self.encoded(None)?);
        } else {
            out.extend_from_slice(before);
            // Signed numbers are doubled.
            push_number(2 * self.rows, out);
            out.push(LIST_FIELD);
            if self.count < 15 {
                out.push((self.count as u8) << 4 | OF_STRUCTS);
            } else {
                out.push(0xF0 | OF_STRUCTS);
                push_number(self.count, out);
            }
            out.extend_from_slice(&self.row_groups);
            out.extend_from_slice(behind);
        }
        let length = (out.len() - start) as u32;
        out.extend_from_slice(&length.to_le_bytes());
        out.extend_from_slice(b"PAR1");
        Ok(())
    }

    /// The footer with this row group alone, or none, as the library encodes it.
    fn encoded(&self, row_group: Option<RowGroupMetaData>) -> Result<Vec<u8>> {
        let row_groups = row_group.into_iter().collect();
        let metadata = ParquetMetaDataBuilder::new(self.file.clone()).set_row_groups(row_groups).build();
        let mut bytes = Vec::new();
        ParquetMetaDataWriter::new(&mut bytes, &metadata).finish()?;
        bytes.truncate(bytes.len() - TAIL_BYTES);
        Ok(bytes)
    }
}

/// What is in front of the number of rows and after the list of row groups, of a footer without any and one that has some.
fn around_row_groups<'a>(empty: &'a [u8], other: &[u8]) -> Result<(&'a [u8], &'a [u8])> {
    let number = empty.iter().zip(other).position(|(one, other)| one != other).ok_or_else(unknown)?;
    match empty.split_at(number) {
        (before, [0, LIST_FIELD, OF_STRUCTS, behind @ ..]) if other.ends_with(behind) => Ok((before, behind)),
        _ => Err(unknown()),
    }
}

fn unknown() -> ParquetError {
    ParquetError::General(String::from("the footer is encoded in an unknown way"))
}

/// Appends a number, seven bits a byte, the lowest first.
fn push_number(mut number: u64, out: &mut Vec<u8>) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use parquet::file::metadata::{ColumnChunkMetaData, KeyValue};
    use parquet::schema::parser::parse_message_type;
    use parquet::schema::types::SchemaDescriptor;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// The library encodes all row groups at once.
        #[test]
        fn the_footer_is_that_of_the_library(
            row_groups in proptest::collection::vec((1i64..1 << 40, any::<u32>()), 0..40),
            value in ".{0,200}",
        ) {
            let message = parse_message_type("message m { optional int64 a; optional binary b (STRING); }").unwrap();
            let schema = Arc::new(SchemaDescriptor::new(Arc::new(message)));
            let metadata = vec![KeyValue::new(String::from("key"), value)];
            let file = FileMetaData::new(1, 0, Some(String::from("me")), Some(metadata), Arc::clone(&schema), None);
            let row_groups: Vec<RowGroupMetaData> = row_groups.into_iter().map(|(rows, offset)| {
                let column = |leaf| {
                    let builder = ColumnChunkMetaData::builder(Arc::clone(leaf)).set_num_values(rows);
                    builder.set_data_page_offset(i64::from(offset)).build().unwrap()
                };
                let columns = schema.columns().iter().map(column).collect();
                RowGroupMetaData::builder(Arc::clone(&schema)).set_num_rows(rows).set_column_metadata(columns).build().unwrap()
            }).collect();
            let mut footer = Footer::new(file.clone());
            for row_group in &row_groups {
                footer.add(row_group.clone()).unwrap();
            }
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            footer.finish(&mut found).unwrap();
            let all = ParquetMetaDataBuilder::new(file).set_row_groups(row_groups).build();
            ParquetMetaDataWriter::new(&mut expected, &all).finish().unwrap();
            prop_assert_eq!(found, expected);
        }
    }
}
