"""Decoding inside Apache Spark: `analyzer.batches.decode_batches` with readers and a writer.

    spark = SparkSession.builder.getOrCreate()
    blocks = recordings(spark, "archive")
    write(decode(blocks, BatchSettings(table="transactions")), "transactions")

Spark has no nanoseconds: a column such as `time` is cut to microseconds, and `time_ns` beside it
holds all of them, as whole nanoseconds since 1970. Needs PySpark 4.1, as of the extra `spark`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from analyzer.archive import BUS_NAMES
from analyzer.batches import BatchSettings, decode_batches, schema
from dissectors.errors import UsageError

if TYPE_CHECKING:
    import pyarrow
    from pyspark.sql import DataFrame, SparkSession
    from pyspark.sql.types import StructType

__all__ = ["decode", "decode_lines", "new_recordings", "recordings", "spark_schema", "write"]

ROW_BYTES = 64 << 20
"""Larger files are not sent to a worker as a row, but read by it, where it can open them."""

_MAX_ROW_BYTES = (1 << 31) - (1 << 20)
"""What fits into a row of Spark."""

_FILES = "binaryFile"
_FILE_COLUMNS = "path string, modificationTime timestamp, length long, content binary"
_DAY_NS = 86_400_000_000_000


def recordings(
    spark: SparkSession,
    folder: str,
    *,
    bus_names: str = BUS_NAMES[0],
    row_bytes: int = ROW_BYTES,
) -> DataFrame:
    """The recordings in a folder and those below it, whole, as blocks for `decode`.

    `bus_names` is one of `analyzer.archive.BUS_NAMES`: what names their buses. A file is a row. Of
    one with more than `row_bytes` the row has the path only, and the worker reads it block by
    block: the folder has to be there on each machine under the same name. From stores with a URL
    files come as rows up to 2 GB; larger ones are reported and left out.
    """
    return _pieces(spark.read.format(_FILES), folder, bus_names, row_bytes)


def new_recordings(
    spark: SparkSession,
    folder: str,
    *,
    bus_names: str = BUS_NAMES[0],
    row_bytes: int = ROW_BYTES,
) -> DataFrame:
    """The same as a stream: recordings that are put into the folder, once each.

    A file has to appear complete, as by a rename.
    """
    reader = spark.readStream.format(_FILES).schema(_FILE_COLUMNS)
    return _pieces(reader, folder, bus_names, row_bytes)


def decode(
    pieces: DataFrame,
    settings: BatchSettings | None = None,
    *,
    notify: Callable[[str], None] | None = None,
) -> DataFrame:
    """The rows of a table from blocks of recordings; all blocks of a recording in one partition.

    For `notify` see `decode_batches`; it is called on the workers, and again where a task is tried
    again.
    """
    chosen = settings or BatchSettings()
    return pieces.mapInArrow(partial(_decoded, chosen, notify), spark_schema(chosen.table))


def decode_lines(
    chunks: DataFrame,
    settings: BatchSettings | None = None,
    *,
    notify: Callable[[str], None] | None = None,
) -> DataFrame:
    """The rows of a table from bytes off lines, in any order: each bus is decoded as one stream.

    A bus is in the hands of one worker, which holds a few of its chunks at a time.
    """
    chosen = settings or BatchSettings()

    def decode_bus(batches: Iterator[pyarrow.RecordBatch]) -> Iterator[pyarrow.RecordBatch]:
        yield from _decoded(chosen, notify, batches)

    # The planner finds the order that it needs for the groups, and keeps it. If it ever does not,
    # the decoder refuses bytes that are out of order.
    decode_bus.__annotations__ = _iterators()
    order = ["bus", "time", "offset"] if "line" in chunks.columns else ["bus", "offset"]
    ordered = chunks.repartition("bus").sortWithinPartitions(*order)
    return ordered.groupBy("bus").applyInArrow(decode_bus, spark_schema(chosen.table))


def write(rows: DataFrame, folder: str) -> None:
    """Write rows as Parquet, a subfolder for each date (UTC); files are sorted by bus and time."""
    parted = with_date(rows)
    time, number = _order(rows)
    ordered = parted.repartition("date", "bus").sortWithinPartitions("date", "bus", time, number)
    ordered.write.partitionBy("date").mode("append").parquet(folder)


def with_date(rows: DataFrame) -> DataFrame:
    """The rows with a column `date` as text: the day of their time in UTC, or `unknown`."""
    from pyspark.sql import functions as sql  # noqa: PLC0415 - for those who have it

    days = sql.floor(sql.col(_order(rows)[0]) / _DAY_NS).cast("int")
    date = sql.date_format(sql.date_add(sql.lit("1970-01-01").cast("date"), days), "yyyy-MM-dd")
    return rows.withColumn("date", sql.coalesce(date, sql.lit("unknown")))


def spark_schema(table: str) -> StructType:
    """The columns of a table as Spark has them."""
    from pyspark.sql.pandas.types import from_arrow_schema  # noqa: PLC0415

    return from_arrow_schema(_for_spark(schema(table).empty_table()).schema)


def _pieces(reader: Any, folder: str, bus_names: str, row_bytes: int) -> DataFrame:
    from pyspark.sql import functions as sql  # noqa: PLC0415

    if bus_names not in BUS_NAMES:
        raise UsageError(f"bus_names {bus_names!r}; it is one of {', '.join(BUS_NAMES)}")
    files: DataFrame = reader.option("recursiveFileLookup", "true").load(folder)
    # Files of this machine get their plain path, without `file:`, others their URL.
    path = sql.regexp_replace("path", "^file:(//)?(?=/)", "")
    below = sql.regexp_replace(path, "^.*?" + re.escape(_last_parts(folder)) + "/+", "")
    own = sql.regexp_extract(below, r"([^/.]*)[^/]*$", 1)
    parent = sql.regexp_extract(below, r"^(.*)/[^/]*$", 1)
    buses = {
        "folder": sql.when(parent == "", own).otherwise(parent),
        "stem": own,
        "path": sql.lit(None).cast("string"),
    }
    here = "://" not in folder or folder.startswith("file:")
    most = min(row_bytes, _MAX_ROW_BYTES) if here else _MAX_ROW_BYTES

    def rows(files: DataFrame, content: Any) -> DataFrame:
        return files.select(
            buses[bus_names].alias("bus"),
            path.alias("path"),
            sql.lit(0).cast("long").alias("offset"),
            content.alias("bytes"),
            sql.col("length").alias("size"),
        )

    # Large files come first; of them the content is not read: neither filter nor columns need it.
    large = rows(files.where(sql.col("length") > most), sql.lit(None).cast("binary"))
    return large.unionAll(rows(files.where(sql.col("length") <= most), sql.col("content")))


def _last_parts(folder: str) -> str:
    """The end of a folder's path by which it is found in those of its files."""
    if "://" in folder:
        return folder.partition("://")[2].rstrip("/")
    return os.path.abspath(folder)


def _decoded(
    settings: BatchSettings, notify: Callable[[str], None] | None, batches: Iterator[Any]
) -> Iterator[Any]:
    for batch in decode_batches(batches, settings, notify=notify):
        yield from _for_spark(batch).to_batches()


def _for_spark(rows: Any) -> Any:
    """A table of pyarrow with times in microseconds, and beside them whole nanoseconds."""
    import pyarrow as arrow  # noqa: PLC0415

    columns: dict[str, Any] = {}
    for field in rows.schema:
        column = rows.column(field.name)
        columns[field.name] = column
        if arrow.types.is_timestamp(field.type):
            ns = column.cast(arrow.int64())
            columns[field.name] = _microseconds(ns).cast(arrow.timestamp("us", field.type.tz))
            columns[f"{field.name}_ns"] = ns
    return arrow.table(columns)


def _microseconds(ns: Any) -> Any:
    """Nanoseconds as microseconds, cut, as Python's times are; those of Spark are exact to them."""
    from pyarrow import compute  # noqa: PLC0415

    return compute.floor(compute.divide(ns, 1000)).cast("int64")


def _order(rows: DataFrame) -> tuple[str, str]:
    """The columns with a row's time and number."""
    time = next(name for name in rows.columns if name.endswith("_ns"))
    numbers = ("txn", "frame", "connection", "code")
    return time, next(name for name in (*numbers, time) if name in rows.columns)


def _iterators() -> dict[str, Any]:
    """The types by which Spark knows that a function takes batch for batch."""
    import pyarrow as arrow  # noqa: PLC0415

    return {"batches": Iterator[arrow.RecordBatch], "return": Iterator[arrow.RecordBatch]}
