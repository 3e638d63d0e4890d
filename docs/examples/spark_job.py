"""An archive of recordings to Parquet by Spark: `spark-submit spark_job.py ARCHIVE OUT`.

Runs as it is on a cluster; where no master is given, on two cores of this machine. With `--stream`
it takes the recordings that have been put into the folder since the last time, and ends.
"""

from __future__ import annotations

import argparse
import os
import sys

# The workers run the same Python as this program; on a cluster, what is set there.
os.environ.setdefault("PYSPARK_PYTHON", sys.executable)

from pyspark.sql import SparkSession

from analyzer.batches import BatchSettings
from analyzer.spark import decode, new_recordings, recordings, with_date, write


def main() -> None:
    """Decode every recording of the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("archive")
    parser.add_argument("out")
    parser.add_argument("--table", default="transactions")
    parser.add_argument("--line", help="as 19200-8E1")
    parser.add_argument("--bus-names", default="folder")
    parser.add_argument("--stream", action="store_true")
    options = parser.parse_args()
    settings = BatchSettings(table=options.table, line=options.line)
    spark = session()
    if options.stream:
        rows = with_date(
            decode(new_recordings(spark, options.archive, bus_names=options.bus_names), settings)
        )
        stream = rows.writeStream.partitionBy("date").format("parquet")
        stream = stream.option("checkpointLocation", f"{options.out}/_checkpoint")
        stream.trigger(availableNow=True).start(options.out).awaitTermination()
    else:
        pieces = recordings(spark, options.archive, bus_names=options.bus_names)
        write(decode(pieces, settings), options.out)
    spark.stop()


def session() -> SparkSession:
    """A session whose batches are a few recordings, not ten thousand: they are in memory."""
    builder = SparkSession.builder.appName("modlens")
    if not any(name in os.environ for name in ("MASTER", "SPARK_ENV_LOADED")):
        builder = builder.master("local[2,4]").config("spark.driver.bindAddress", "127.0.0.1")
        builder = builder.config("spark.driver.host", "127.0.0.1").config("spark.ui.enabled", False)
    settings = {
        "spark.sql.session.timeZone": "UTC",
        "spark.sql.execution.arrow.maxRecordsPerBatch": 16,
        "spark.sql.execution.arrow.maxBytesPerBatch": 64 << 20,
        "spark.sql.files.maxPartitionBytes": 32 << 20,
        "spark.sql.files.openCostInBytes": 1 << 20,
        "spark.task.maxFailures": 4,
        "spark.sql.shuffle.partitions": 8,
    }
    for name, value in settings.items():
        builder = builder.config(name, value)
    return builder.getOrCreate()


if __name__ == "__main__":
    main()
