"""What the test of Spark runs in one session, because a session takes ten seconds to start.

`python -m tests.support.spark_run ARCHIVE LATER OUT`: the archive as it is, with a worker that is
killed, and as a stream to which the files of LATER are added; bytes off lines in a random order.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from random import Random

from analyzer.batches import BatchSettings
from analyzer.spark import decode, decode_lines, new_recordings, recordings, with_date, write
from docs.examples.spark_job import session
from tests.support.fleet import Traffic

BUSES = range(4)
REQUESTS = 300
ROW_BYTES = 3000
"""Some of the archive's files are larger, and read where they lie."""


class KillOnce:
    """Kills the worker that finds a recording to be cut off, after most of its rows."""

    def __init__(self, mark: str) -> None:
        self._mark = mark

    def __call__(self, trouble: str) -> None:
        """Leave a mark, so that it happens once only."""
        if "cut.jsonl.gz" in trouble and not os.path.exists(self._mark):
            Path(self._mark).write_text(trouble)
            os.kill(os.getpid(), signal.SIGKILL)


def chunks() -> list[tuple[str, int, int, bytes]]:
    """Reads of some buses (bus, offset, ns, bytes), which no order holds together."""
    found = []
    for bus in BUSES:
        at = 0
        for now, data in Traffic(bus, 0, REQUESTS).reads():
            found.append((f"bus-{bus}", at, now, data))
            at += len(data)
    Random(3).shuffle(found)
    return found


def main() -> None:
    """Each way writes its rows into a folder of its own; times go to standard output."""
    archive, later, out = map(Path, sys.argv[1:])
    clock = {"begin": time.monotonic()}
    spark = session()
    spark.sparkContext.setLogLevel("OFF")
    settings = BatchSettings()
    clock["started"] = time.monotonic()
    pieces = recordings(spark, str(archive), row_bytes=ROW_BYTES)
    (out / "in_place.json").write_text(
        json.dumps([row.path for row in pieces.where("bytes IS NULL").select("path").collect()])
    )
    write(decode(pieces, settings), str(out / "files"))
    clock["files"] = time.monotonic()
    killed = decode(
        recordings(spark, str(archive / "bus-00"), bus_names="path"),
        settings,
        notify=KillOnce(str(out / "killed.txt")),
    )
    write(killed, str(out / "killed"))
    lines = spark.createDataFrame(chunks(), "bus string, offset long, time long, bytes binary")
    write(decode_lines(lines, settings), str(out / "lines"))
    clock["lines"] = time.monotonic()
    for turn in range(2):
        if turn:
            shutil.copytree(later, archive, dirs_exist_ok=True)
        rows = with_date(decode(new_recordings(spark, str(archive), row_bytes=ROW_BYTES), settings))
        stream = rows.writeStream.partitionBy("date").format("parquet")
        stream = stream.option("checkpointLocation", str(out / "checkpoint"))
        stream.trigger(availableNow=True).start(str(out / "stream")).awaitTermination()
    clock["stream"] = time.monotonic()
    spark.stop()
    seconds = {name: round(at - clock["begin"], 1) for name, at in clock.items()}
    print(json.dumps(seconds))  # noqa: T201 - for the test


if __name__ == "__main__":
    main()
