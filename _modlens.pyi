"""The border: what the Rust core shows to Python. Private; use `analyzer` and `dissectors`.

Checked against the built module by tests/border. Times are integer nanoseconds; offsets and sizes
are bytes.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, final

from typing_extensions import disjoint_base

__version__: str

def vocabulary(part: str) -> str:
    """A part of the texts that the core embeds, as JSON; `ValueError` for an unknown one.

    Parts: `functions` (rows of functions.toml as the core understood them), `exceptions`,
    `diagnostics`, `mei_types`, `object_ids`, `read_device_id_codes`, `conformity_levels`, `columns`
    (table name -> list of {key, type, title, help}), `findings` (list of {code, severity, title,
    why, advice, section}), `diagnoses`, `vendors` (names that `Functions.load_vendor` knows),
    `statuses` and `verdicts` (lists of {code, meaning}), `renamed` (list of {vocabulary, former,
    current}: spellings that are still accepted), `version` (of the schema).
    """

def crc16(data: bytes) -> int:
    """CRC-16/MODBUS of `data` (serial line specification, 6.2.2); sent low byte first."""

def lrc(data: bytes) -> int:
    """LRC of `data`, the binary bytes of an ASCII frame (serial line specification, 6.2.1)."""

def pdu_of(frame: bytes, mode: str, has_checksum: bool = True) -> bytes | None:
    """The PDU in a frame; None where the frame is empty, or cannot be decoded."""

def has_checksum(frame: bytes, mode: str, is_sound: bool) -> bool:
    """Whether the frame of a transaction has its checksum, right or wrong.

    Where one that is sound does not end in it, the recording prints none.
    """

def is_text(sample: bytes) -> bool:
    """Whether these bytes can be text: hardly any control characters, UTF-8 or mostly ASCII.

    A bell, an end-of-file mark or the zeros after a log that lost power do not make it binary.
    """

def line_timing(baud: int, data_bits: int, parity: str, stop_bits: float) -> tuple[int, int, int]:
    """Character time, t1.5 and t3.5 in nanoseconds (serial line specification, 2.5.1.1)."""

def parse_line(text: str) -> tuple[int, int, str, float]:
    """Baud, data bits, parity and stop bits of `19200-8E1`, `9600,8,N,1` or `9600/7O2`.

    `ValueError` if the text is not of this form.
    """

def parse_filter(
    text: str, table: str, local_changes: Callable[[], Sequence[tuple[int, int]]]
) -> str:
    """A filter for the rows of a table, as JSON: `text` (normalized), `tree`, `notes`.

    One that cannot be understood: `error`, `text`, `column` (from 0, or null), `hint`.
    `local_changes` gives the changes of this computer's offset from UTC, in nanoseconds; it is
    asked where the filter has a time of day that is `local`.
    """

def similar_name(text: str, known: Sequence[str], least: float) -> str | None:
    """The known name most similar to a misspelled one; None if none is `least` similar, of 1."""

def parse_duration(text: str) -> int | None:
    """Nanoseconds of `500ms`, `1h30m` or `0.3` (seconds); None if it is no time up to ten years."""

def parse_rotation(text: str) -> tuple[int | None, int | None]:
    """Seconds of `1h30m`, or bytes of `64MB`; `ValueError` says what to write."""

def parse_retention(text: str) -> tuple[int | None, int | None]:
    """Segments of `168`, or bytes of `2GB`; `ValueError` says what to write."""

def parse_broker(
    text: str, password: str | None = None
) -> tuple[bool, str, int, str | None, str | None, str, bool]:
    """TLS, host, port, user, password, prefix, and whether the address holds a password.

    `text` is `mqtt[s]://[user[:password]@]host[:port][/prefix]`; `password` goes before that of the
    address. `ValueError` for another text or a prefix that is no topic.
    """

def topic_level(name: str) -> str:
    """A name as one level of a topic of MQTT, without wildcards and separators."""

def report_document(
    core: str, statuses: str, functions: Functions, title: str | None = None
) -> str:
    """The document of a recording as JSON (docs/stats.schema.json).

    - `core`: what `Session.document` returned
    - `statuses`: a list of objects with `name`, `format`, `confidence`, `reason`, `forced` and
    `details` (`Session.reading`); the last one of each name counts
    - `title`: the name at the top; else one is made of the names of buses or files

    `ValueError` where one of them is no JSON.
    """

def report_html(document: str) -> tuple[str, str]:
    """The title and the body of the page of a document (JSON; docs/stats.schema.json), as HTML.

    `ValueError` where it is no JSON.
    """

def report_layout() -> str:
    """The table of the sections of a report (analyzer/report/layout.toml), as JSON."""

def usual_rates() -> list[tuple[int, float]]:
    """The baud rates that `LineSearch` tries, and how probable each is beforehand."""

def likely_rates(data: bytes, receiver: int) -> list[int]:
    """The rates that bytes look like that were received at the rate `receiver`, likeliest first."""

def proof_in(
    reads: Sequence[tuple[bytes, int | None]], line: tuple[int, int, str, float]
) -> tuple[str, str] | None:
    """Whether reads (bytes, time in ns) are Modbus at these settings: framing, evidence in words.

    `ValueError` for settings that mean nothing.
    """

@final
class LineSearch:
    """Finds the settings of a line by listening (see modlens-engine/src/line_search).

    A read is (port, bytes, time in ns, positions of marked bytes, loss before, recorded).
    """

    def __new__(cls, *, marks_errors: bool = True) -> LineSearch: ...
    def line(self) -> str:
        """The settings to listen with now, as `19200-8E1`."""
    def line_was_set(self, now_ns: int) -> None:
        """The port was set to `line()`; what comes right after is not counted."""
    def feed(
        self,
        port: int,
        data: bytes,
        time_ns: int,
        *,
        line: str | None = None,
        errors: Sequence[int] | None = None,
        hole: bool = False,
        recorded: bool = False,
    ) -> None:
        """Take a read made with the present settings; `line` is A or B on a two-line tap."""
    def advance(self, now_ns: int) -> None:
        """Nothing was received until now: a silence may complete a frame."""
    def found(
        self,
    ) -> tuple[str, str, str, list[tuple[int, bytes, int, list[int], bool, bool]]] | None:
        """Settings, framing, evidence in words, and the reads made with them; None before."""
    def heard(self) -> list[tuple[str, tuple[int, bytes, int, list[int], bool, bool]]]:
        """The settings of the time and the read, of all reads or the newest MiB of them."""
    def take_messages(self) -> list[str]:
        """What was tried and why it was given up, since the last call."""
    def diagnosis(self) -> str:
        """What can be said when the search ends without a result."""

@final
class Dialects:
    """The table of text formats: the embedded rows and further ones."""

    def __new__(cls) -> Dialects: ...
    def load(self, text: str, origin: str) -> None:
        """Add the rows of a TOML text; rows of the same name are replaced.

        `ValueError` says which row and key is wrong, and the known words.
        """
    def rows(self) -> str:
        """All rows as JSON.

        [{name, title, clock, sample, bytes: [[side, hex]...], generic, checksum}].
        """
    def read(
        self, format: str, text: bytes
    ) -> tuple[list[tuple[int, str | None, int | None, bytes]], list[tuple[int, bytes, str]], int]:
        """What the rows of this name, joined by `+`, find in a text; nothing is decoded.

        The byte strings as (line, `sent` or `received` where it is said, time in ns, bytes), those
        that were left out as (line, bytes, reason), and the number of lines not understood.
        `ValueError` for an unknown name.
        """
    def detect(self, sample: bytes, name: str) -> list[tuple[str, float, str]]:
        """What these first bytes of a file are: (format, confidence 0..1, reason), best first.

        A format is `raw`, or the names of rows joined by `+`. Never empty. `name` is the file's
        name: its suffix counts as evidence.
        """
    def decide(self, sample: bytes, name: str, forced: str | None = None) -> tuple[str, float, str]:
        """The format that is chosen: its name, the confidence (0 to 1), the reason.

        `LookupError` with the name of a `forced` format that does not exist; `ValueError` where no
        format fits, or the forced one cannot be right: why, and what to do.
        """

def profile_schema() -> str:
    """The JSON Schema of profiles, as `dissectors/profiles/profile-1.json` has it."""

def shipped_profiles() -> list[tuple[str, str]]:
    """The profiles that are shipped: (name, TOML text)."""

def convert(type: str, order: str, data: bytes) -> tuple[float | None, str | None]:
    """Registers (two bytes each, as on the wire) as one value of a type in an order.

    The number, where a float holds it exactly, and the exact text; None where there is none.
    `ValueError` for an unknown word or a wrong number of bytes.
    """

def judge(rows: Sequence[Sequence[int]]) -> str:
    """Which type in which order: claims on rows of two or four registers, best first, as JSON.

    A list of {type, order, bits, sure, reason}.
    """

def sunspec_models() -> list[tuple[int, str]]:
    """The SunSpec models that are shipped: (number, TOML text)."""

@final
class RegisterMap:
    """The register map as last seen."""

    def __new__(cls) -> RegisterMap: ...
    def add(self, batch: Batch) -> None:
        """What a batch read and wrote; it needs its transactions."""
    def rows(self, first: int = 0, most: int = ...) -> str:
        """A JSON list, by bus, unit, table and address: `most` rows from number `first` on.

        {bus, unit, register_type, address, name, value, value_text, unit_of_measure, age_us, reads,
        writes, count, min, max, changes}.
        """

@final
class Finder:
    """Values of all registers of a recording, and the search for the one that holds a value.

    Around the times in `kept` (from, to; nanoseconds) every sample is kept; others are thinned out
    where they would take too much memory.
    """

    def __new__(cls, kept: Sequence[tuple[int, int]]) -> Finder: ...
    def add(self, batch: Batch) -> None:
        """Add what a batch read and wrote; it needs its transactions."""
    @property
    def span(self) -> tuple[int, int] | None:
        """The first and the last time of a sample."""
    @property
    def dropped(self) -> int:
        """The number of samples that were dropped to save memory."""
    def find(self, query: str) -> str:
        """Returns the candidates as JSON, best first; `ValueError` if the query is malformed.

        `query`: {shown: [[value, decimals, at, within]], moves: [[word, from, to]],
        history: null or {times, values, has_zone}}. Result: {readings, registers, candidates:
        [{unit, register_type, space, address, count, bit, type, order, scale, offset, odds_bits,
        chance, r2, lag_ns}], look: null or {time_ns, values}}.
        """

@final
class Survey:
    """What traffic shows of the registers of each unit."""

    def __new__(cls) -> Survey: ...
    def add(self, batch: Batch) -> None:
        """What a batch read and wrote; it needs its transactions."""
    def tables(self) -> str:
        """A JSON list, one item a unit and table.

        {unit, register_type, space, blocks: [{first, count, reads, writes, exceptions}], registers,
        together: [[a, b]]}.
        """
    def points(self, unit: int, space: str, first: int, most: int) -> str:
        """What was learned of a table: a JSON list of points, `most` from number `first` on.

        {address, count, type, order, layout_bits, is_certain, role, role_bits, scale, unit_symbol,
        scale_bits, quantity, quantity_bits, min, max, reason, scale_reason, samples, changes,
        distinct, raw_min, raw_max, looks, read, written, values}; null where the data do not say.
        `samples` and what follows are those of the first register. Bits have `address` and these
        only. `ValueError` for another table.
        """
    def movements(self, unit: int, space: str, parts: int) -> str:
        """How a table moved: {spans, equations}; `ValueError` for another table.

        `spans` has a list for each point, in the order of `points`: [low, high] of each part of the
        time, or null. An equation is {kind, address, of: [addresses], factor, residual}; `kind` is
        sum, product or integral.
        """
    def anchor(self, unit: int, space: str, address: int, factor: float, bits: float) -> None:
        """Take the scale of a point as known; `ValueError` for another table."""
    def fit(self, unit: int, profile: Profile) -> str:
        """How well a profile fits a unit, as JSON: {percent, bits, share, fits, reasons}."""
    @property
    def most_rows(self) -> int:
        """The samples that are kept of each block, at most."""

@final
class Days:
    """What the doctor reports about each bus and day (UTC), from frames and transactions.

    Of each bus the latest `kept` days are kept, all by default.
    """

    def __new__(cls, kept: int | None = None) -> Days: ...
    def add(self, batch: Batch) -> None:
        """Count the rows of a batch."""
    def rows(self) -> str:
        """A JSON list, by bus and day.

        {date, bus, seconds} and the keys of docs/doctor.schema.json; `date` is null without one,
        `seconds` are those from the first to the last frame.
        """
    def changed(self) -> list[tuple[str, str]]:
        """The flat rows that have changed since the last call: bus, and the row as JSON.

        Of a bus the latest day comes last.
        """

@final
class Watch:
    """Security rules and usage, from batches with transactions, frames and connections.

    `rules` is a JSON list of {code, table, tree, pdu, per, distinct, count, within_s, only_once};
    `tree` is a filter as `analyzer.filters` compiles it. `ValueError` names the rule and the key.
    With `usual`, a usage as JSON, `news` also has the deviations from it as they begin.
    """

    def __new__(cls, rules: str = "[]", usual: str | None = None) -> Watch: ...
    def add(self, batch: Batch) -> None:
        """Look at the rows of a batch."""
    def finish(self) -> None:
        """Decide what waits for more rows."""
    def alerts(self) -> str:
        """JSON: {"alerts": [...], "not_judged": [code, ...], "not_kept": number}.

        An alert is {code, bus, client, unit, function, address, count, items, since_ns, until_ns,
        examples}.
        """
    def news(self) -> str:
        """The alerts and deviations that have begun since the last call, as a JSON list."""
    def usage(self) -> str:
        """What was asked, by bus, as JSON: what `compare` takes, and what a baseline holds."""
    def compare(self, usual: str, *, values: bool = False) -> str:
        """The differences from a usage, as a JSON list; `ValueError` if `usual` is none.

        A difference is {code, bus, client, unit, function, address, quantity, usual, now, count,
        since_ns, examples, requests}. With `values`, it also lists registers that began or stopped
        to change.
        """

@final
class Join:
    """Both sides of a gateway: transactions on the network matched with those on its serial line.

    `filter` is a filter of transactions as `analyzer.filters` compiles it; `ValueError` if not.
    `side` is network or line.
    """

    def __new__(cls, filter: str | None = None) -> Join: ...
    def add(self, side: str, batch: Batch) -> None:
        """Take the transactions of a batch; `ValueError` for another side."""
    def end(self, side: str) -> None:
        """Note that the recording of one side has ended."""
    def wants(self) -> str | None:
        """The side of which more is needed; None when both have ended."""
    def is_aligned(self) -> bool | None:
        """Whether the two have traffic in common; None while that is not known."""
    def rows(self) -> str:
        """The rows that are certain by now, as a JSON list."""
    def summary(self) -> str:
        """What was found about the gateway, as JSON: clocks, units, outcomes, timeouts."""

def bus_day_columns() -> list[tuple[str, str]]:
    """Key and meaning of each column of `bus_day_row`, in order."""

def bus_day_row(day: str) -> str:
    """The flat row of an item of `Days.rows`, both as JSON; `ValueError` for what is no JSON."""

@final
class Functions:
    """The table of functions: the embedded rows and further ones."""

    def __new__(cls) -> Functions: ...
    def load(self, text: str, origin: str) -> None:
        """Add the rows of a TOML text; later rows win.

        `ValueError` says which row and key is wrong, and the known words.
        """
    def load_vendor(self, name: str) -> None:
        """Add an embedded vendor's rows; `ValueError` lists the known names."""
    @property
    def loads(self) -> int:
        """How often rows have been added: what was made of `rows()` holds as long as this stays."""
    def rows(self) -> str:
        """All rows as JSON."""
    def decode(self, pdu: bytes, direction: str) -> str:
        """A PDU as JSON.

        {function, name, exception, complete,
        fields: [{name, offset, length, value, word, children}]}.

        `direction` is "request" or "response". Offsets count from the function code. Bytes that the
        layout does not cover are in a last field named "extra"; bytes that are missing make
        `complete` false.
        """
    def guess_direction(self, pdu: bytes) -> str:
        """The direction whose layout fits; "unknown" where both or none fit."""
    def annotate(
        self,
        frame: bytes,
        mode: str,
        direction: str,
        request: bytes | None = None,
        has_checksum: bool = True,
    ) -> list[tuple[int, bytes, str, str, str, str, bool]]:
        """The blocks of a frame: offset, bytes, name, value, meaning, layer, whether it is valid.

        See `dissectors.describe`. `mode` "pdu" stands for a PDU alone.
        """
    def encode(self, function: int, direction: str, values: str) -> bytes:
        """The PDU of these values (JSON object: field -> number, list, hex text).

        Lengths and counts are filled in.

        `ValueError` names the field and what it takes.
        """

@final
class Predicate:
    """A compiled `--where` filter for one table; made by analyzer.filters."""

    def __new__(cls, table: str, tree: str) -> Predicate:
        """`tree` is the JSON syntax tree of analyzer/filters.py."""

@final
class Profile:
    """A device profile without mistakes, compiled."""

    def __new__(cls, text: str, form: str) -> Profile:
        """`form` is toml, yaml, csv or json.

        `ValueError` with all mistakes as a JSON list of {line, key, message, hint}.
        """
    def model(self) -> str:
        """The profile as JSON in the words of the file, with wire addresses."""

@final
class Row:
    """One row, made when somebody looks at it.

    Every column of its table is an attribute, None where empty. Attributes have the columns' Python
    types: int, float (`*_us`), str, bool, `datetime` (UTC) for `time`, list[int],
    list[str], dict for maps, bytes for `hex` columns.
    """

    def __getattr__(self, name: str) -> Any: ...
    def as_dict(self) -> dict[str, Any]:
        """Column -> value, in the table's order."""

@final
class Table:
    """Rows of one table; immutable, cheap to pass on."""

    @property
    def name(self) -> str: ...
    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> Row: ...
    def __iter__(self) -> Iterator[Row]: ...
    def where(self, predicate: Predicate) -> Table:
        """The rows for which the predicate holds."""
    def slice(self, start: int, count: int) -> Table:
        """At most `count` rows from row `start` on, which may be after the last one."""
    def have_values(self, columns: Sequence[str]) -> list[bool]:
        """For each column whether it has a value in any row; ValueError for one not there."""
    def lines(
        self,
        format: str,
        columns: Sequence[str],
        *,
        header: bool = False,
    ) -> Pieces:
        """Rows as lines of text, in blocks of about 128 KiB that end with a row.

        `csv`: RFC 4180, lists joined by single spaces, null is empty; `header` puts the names of
        the columns in front. `jsonl`: a JSON object a line, null omitted. ValueError for others.
        """
    def tuples(
        self, columns: Sequence[str], start: int = 0, count: int = ...
    ) -> list[tuple[int | float | str | None, ...]]:
        """Rows as a database takes them: numbers, text, None; lists and maps as CSV spells them."""
    def origins(self) -> list[tuple[str, int, int | None, list[int]]]:
        """Where frames stand: file, frame, transaction, the packets (or lines) with their bytes."""
    def influx(self) -> tuple[bytes, int]:
        """InfluxDB line protocol of readings or transactions, and how many rows have no time."""
    def zeek(self, log: str, *, json: bool, header: bool) -> bytes:
        """Transactions as Zeek's log `modbus` or `modbus_detailed`, tab-separated or JSON lines."""
    def partitions(self) -> list[tuple[str | None, str, Table]]:
        """The rows by day (UTC, as `2026-11-21`; None without a clock) and bus."""
    def __arrow_c_schema__(self) -> object: ...
    def __arrow_c_array__(
        self, requested_schema: object | None = None
    ) -> tuple[object, object]: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...

@final
class OutputFile:
    """A file that is open for writing; `OSError` as Python's own functions raise it.

    `way` is `whole` for one that nobody reads before it is complete, `growing` for a new one that
    grows by whole rows, `special` for a device, a pipe or the like.
    """

    def __new__(cls, path: str, way: str) -> OutputFile: ...
    def append(self, data: bytes) -> None:
        """Write these bytes. Of a growing file, bytes that do not fit are taken off again."""
    def append_lines(self, lines: Pieces) -> None:
        """Write these lines; of a whole file the last ones may be written later."""
    def close(self) -> None:
        """Write what is left, and close."""
    def discard(self) -> None:
        """Close, whatever is left."""

@final
class LineEncoder:
    """Makes lines of rows of a table, batch by batch; `Table.lines` says which."""

    def __new__(cls, format: str, table: str, columns: Sequence[str]) -> LineEncoder:
        """`table` is the name of the table. ValueError for what is not there."""
    def pieces(self, table: Table, *, header: bool = False) -> Pieces:
        """The lines of these rows, also beside those of others."""

@final
class Pieces:
    """Text of a table's rows, block by block."""

    def __iter__(self) -> Pieces: ...
    def __next__(self) -> bytes: ...

@final
class ArrowStream:
    """A lazy Arrow C stream over an iterator of Tables (all of the table called `name`).

    `columns` are the keys of the columns that it carries, in order; None for all of them.
    """

    def __new__(
        cls, name: str, tables: Iterator[Table], columns: Sequence[str] | None = None
    ) -> ArrowStream: ...
    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...

@final
class RowFile:
    """A Parquet or Arrow file of rows of one table, which gives its bytes block by block.

    Not there where the extension was built without its feature `files`.
    """

    def __new__(cls, format: str, table: str, columns: Sequence[str]) -> RowFile: ...
    def rows(self, table: Table) -> bytes:
        """Take rows; gives what is complete of the file."""
    def end(self) -> bytes:
        """The end of the file."""

@final
class Capture:
    """Frames as pcapng, or as classic pcap (`classic`), that Wireshark opens as it is.

    `style` is udp, rtu or tcp. Without `live` a frame waits until its transaction is complete.
    `context` frames are written before and after those that a filter keeps.
    """

    def __new__(
        cls, style: str = "udp", *, classic: bool = False, live: bool = False, context: int = 0
    ) -> Capture: ...
    def put(self, batch: Batch, kept: Table | None = None) -> None:
        """Take a batch; `kept` are the transactions or frames of a filter."""
    def more(self) -> bytes:
        """About 64 KiB of the packets that are decided; nothing when there are no more."""
    def end(self) -> bytes:
        """The rest."""
    @property
    def written(self) -> int:
        """Frames written so far."""

@final
class Lines:
    """Rows of one table as lines for people, while the table grows; the first rows decide it all.

    `width` are the columns of the terminal, `address` is `wire`, `5digit`, `6digit` or `hex`,
    `times` is `clock`, `elapsed` or `delta`. `labels` are buses' names with their short ones, for a
    column that says the bus. `shift` gives how far clocks are ahead of UTC at a moment, both in ns;
    it is asked once for each minute. ValueError for no rows, rows of several tables, or other
    words.
    """

    def __new__(
        cls,
        rows: Sequence[Row],
        width: int,
        *,
        address: str = "wire",
        times: str = "elapsed",
        labels: Sequence[tuple[str, str]] | None = None,
        shift: Callable[[int], int] | None = None,
    ) -> Lines: ...
    def text(self, table: Table, start: int = 0, count: int = ...) -> str:
        """The lines of `count` rows from `start` on, without colours.

        In front of the first of all come the titles, and in front of each day its date.
        """
    def parts(self, table: Table, start: int = 0, count: int = ...) -> list[list[tuple[str, str]]]:
        """The same as parts: each a text and the name of its style."""
    def head(self) -> list[tuple[str, str]]:
        """The line of titles."""
    def row(self, row: Row) -> list[tuple[str, str]]:
        """The line of a row."""

def register_number(wire: int, register_type: str | None, notation: str) -> str:
    """A wire address in a notation: wire, hex, 5digit or 6digit."""

def carried(row: Row, address: str, width: int) -> str:
    """The values that a transaction carried, as many as fit into so many columns."""

@final
class Inbox:
    """What has come in at several ports, in order of arrival; it only reads.

    `limit` is the memory (bytes) that may be waiting; what comes in beyond it is lost and counted.
    """

    def __new__(cls, limit: int = 1 << 26) -> Inbox: ...
    def listen(self, port: int, fd: int, *, marked: bool = False) -> None:
        """Read a copy of the descriptor in a thread of its own, outside of Python's lock.

        `marked` takes the escapes of PARMRK apart (termios(3)). POSIX only (NotImplementedError);
        OSError for a descriptor that is not open.
        """
    def put(self, port: int, data: bytes | None, time_ns: int | None = None) -> None:
        """Queue what somebody else has read just now; None is the end of the port.

        `time_ns` is the time (ns since 1970) that the source has given it; without it, it is now.
        """
    def tell(self, port: int, time_ns: int) -> None:
        """Say that a source which gives times has queued all its reads before this one."""
    def take(self, timeout: float) -> list[tuple[int, int, bytes | None, list[int], bool, bool]]:
        """Return what has come in, waiting at most `timeout` seconds for the first of it.

        Each is (port, ns since 1970 right after the read, bytes, places of marked bytes, whether
        bytes were lost before, whether a recorder has it). Where a port has ended, bytes are None
        and the places hold the system's number of the error, 0 for the end of the stream. Bytes
        are empty where a loss was noticed without a read.
        """
    def hole(self, port: int) -> None:
        """Bytes were lost before what is read next at this port."""
    def now_ns(self) -> int:
        """The present time (ns since 1970) on the clock of the reads that were taken last."""
    def lost(self) -> int:
        """Bytes that did not fit into `limit`."""
    def close(self) -> None:
        """End all threads; what they have read stays in the queue."""

@final
class LiveRun:
    """The loop of a tap: opens ports, finds line settings, feeds the session, waits for lost ports.

    Each of `buses` is (name, source, ports, framing, line settings, silences of 3.5 and 1.5
    characters in ns). `open_port` is called with a name and settings (`19200-8E1`, or None) and
    returns an `analyzer.sources.schemes.LivePort`. Settings that are None are found by listening.
    After `idle_ns` and 1.5 s without bytes, times may follow a clock that was set. Only one thread
    may use it at a time. OSError(port, reason) if a port cannot be opened.
    """

    def __new__(
        cls,
        session: Session,
        buses: Sequence[
            tuple[
                str,
                str,
                Sequence[str],
                str,
                tuple[int, int, str, float] | None,
                tuple[int, int] | None,
            ]
        ],
        open_port: Callable[[str, str | None], object],
        *,
        reconnect: bool = True,
        detect: bool = False,
        idle_ns: int = 0,
    ) -> LiveRun: ...
    def step(self, session: Session, timeout: float) -> None:
        """Wait until there are rows or messages, at most `timeout` seconds.

        Without `reconnect`, OSError(port, reason) if a port is lost.
        """
    def finish(self, session: Session) -> None:
        """Stop reading, decode what was read, and decide what is still open."""
    def record(
        self, recorder: Recorder | None = None, servers: Sequence[Server] | None = None
    ) -> None:
        """Record or serve all reads from now on, and those that are not decoded yet."""
    def take_messages(self) -> list[str]:
        """Sentences for the user since the last call."""
    def statuses(
        self,
    ) -> list[tuple[str, int | None, str | None, str, float | None, dict[str, int]]]:
        """The state of each bus.

        Each is (name, number in the session, line settings, their origin, seconds for which a port
        has been away, what the drivers of its ports have counted).
        """
    def pretend(self, wall_ns: int, suspended_ns: int) -> None:
        """For tests: as if the wall clock had been set forward, and the machine had slept."""
    def close(self) -> None:
        """End all threads and close the ports."""

@disjoint_base
class CorePort:
    """A port that the core has opened; an `analyzer.sources.schemes.LivePort`."""

    @property
    def line(self) -> str | None:
        """The line settings, where another program reads the line and reports them."""
    @property
    def has_two_lines(self) -> bool:
        """Whether it reads both lines of a bus; those of B have the next number."""
    @property
    def takes_line_settings(self) -> bool: ...
    @property
    def marks_errors(self) -> bool:
        """Whether bytes with line errors are marked (PARMRK, termios(3))."""
    @property
    def advice(self) -> str:
        """What limits the port, or the resolution of its times; empty where nothing does."""
    def listen(self, inbox: Inbox, number: int) -> None:
        """Start to read the port into the inbox, under this number."""
    def set_line(self, line: str) -> None:
        """Change the line settings; OSError if the port does not take them."""
    def counters(self) -> dict[str, int]:
        """The driver's error counters since the system started; empty where it has none."""
    def stop(self) -> None:
        """End a thread of its own, if it has one."""
    def close(self) -> None:
        """Close the port."""

@final
class Tty(CorePort):
    """A serial port of this machine, opened for this program alone, for reading only. Linux only.

    It is set raw and DTR and RTS are lowered before anything else is done with it
    (modlens-recorder/src/tty.rs). OSError with the reason if it cannot be opened.
    """

    def __new__(cls, name: str, line: str | None = None) -> Tty: ...

@final
class Remote(CorePort):
    """A line that another tap serves, `modlens://host:port/BUS` (modlens-recorder/src/remote.rs).

    `token` is that of the other tap. OSError with the reason if it cannot be reached, or has no
    such bus.
    """

    def __new__(cls, name: str, token: str | None = None) -> Remote: ...

def port_advice(number: int, line: str | None = None) -> str | None:
    """Return what the user can do about an error of the system at a port, by its `errno`."""

def latency_timer(name: str) -> int | None:
    """Return the milliseconds for which an adapter may hold bytes back; None without a timer."""

@final
class Server:
    """Serves the reads of a live run at `[HOST:]PORT`, in a thread (modlens-recorder/src/serve).

    `memory` is that of what clients have not got yet, in bytes. With a `page`, browsers get that,
    and it gets the stream; a token is made where other computers can reach the address and none is
    given. ValueError for an address that means nothing, or without a page one that other computers
    can reach without a token; OSError if it is in use.
    """

    def __new__(
        cls,
        place: str,
        *,
        token: str | None = None,
        memory: int | None = None,
        page: bytes | None = None,
    ) -> Server: ...
    @property
    def url(self) -> str:
        """What to open in a browser, with the token."""
    @property
    def address(self) -> str:
        """The address and port that it listens at."""
    def take_messages(self) -> list[str]:
        """Sentences for the user since the last call: clients that have come and gone."""
    def close(self) -> None:
        """Give clients a second to take the rest, and end all connections."""

@final
class Recorder:
    """A raw recording, written by a thread of its own (see modlens-recorder/src/lib.rs).

    A segment ends after `rotate_seconds`, or before it has more than `rotate_bytes`; the newest
    `keep_segments`, or `keep_bytes` of them, are kept. `memory` is that of what waits for the disk,
    in bytes. OSError if the first file cannot be created.
    """

    def __new__(
        cls,
        path: str,
        *,
        rotate_seconds: int | None = None,
        rotate_bytes: int | None = None,
        keep_segments: int | None = None,
        keep_bytes: int | None = None,
        memory: int | None = None,
    ) -> Recorder: ...
    def add_port(
        self, name: str, bus: str, line: str | None = None, settings: str | None = None
    ) -> int:
        """Add a port of a bus, its line (A or B) on a two-line tap, and settings as `19200-8E1`.

        Gives its number. ValueError for settings that mean nothing.
        """
    def write(
        self,
        port: int,
        time_ns: int,
        data: bytes,
        *,
        errors: Sequence[int] | None = None,
        hole: bool = False,
    ) -> None:
        """Record one read of the port of this number, without waiting for the disk.

        `time_ns` is when the read returned; `errors` are the places of bytes that the receiver
        marked, `hole` says that bytes were lost before these.
        """
    def status(self) -> tuple[str, str | None, bool, int, int, int]:
        """How it is going: file, trouble now, trouble ever, bytes recorded, lost, and waiting."""
    def take_messages(self) -> list[str]:
        """Sentences for the user since the last call."""
    def flush(self, timeout: float) -> bool:
        """Wait until all that was recorded is written; False if it is not after `timeout` s."""
    def close(self, timeout: float) -> tuple[str, str | None, bool, int, int, int]:
        """Write what is waiting, for at most `timeout` seconds; gives the last `status`."""

@final
class Batch:
    """What was decided since the last `take()`: one Table of each kind."""

    @property
    def row_count(self) -> int:
        """The rows of all tables that were decided, without readings."""
    @property
    def frames(self) -> Table: ...
    @property
    def transactions(self) -> Table: ...
    @property
    def readings(self) -> Table: ...
    @property
    def findings(self) -> Table: ...
    @property
    def connections(self) -> Table: ...
    @property
    def diagnoses(self) -> Table: ...

@final
class Reader:
    """Reads the blocks of a recording, while its session decides what was in others."""

    def read(self, blocks: Sequence[bytes]) -> list[ReadBlock]:
        """What is in each of the next blocks, cut anywhere.

        `ValueError` once the session has the reader back.
        """

@final
class ReadBlock:
    """What a `Reader` has found in one block; see `Session.take_read`."""

@final
class Session:
    """Framer, decoder, pairing and statistics after one `feed`; no I/O, never fails on bytes.

    Buses are numbered from 0 in the order in which they were added. Rows of several buses share
    their numbering.
    """

    def __new__(
        cls,
        functions: Functions,
        *,
        live: bool = False,
        timeout_ns: int | None = None,
        tables: Sequence[str] | None = None,
        bus_name: str | None = None,
        overview: Literal["none", "series", "all"] = "none",
        select: Sequence[Predicate] | None = None,
    ) -> Session:
        """A session of no bus yet.

        - `live`: rows in order of completion, no hold-back
        - `tables`: those worth building (readings need transactions); all but diagnoses by default
        - `bus_name`: of buses that a capture, samples or a text would name after its source
        - `overview`: collect for `document` what reports draw, or without values of registers and
          examples the `courses` that `modlens stats` draws
        - `select`: a condition, compiled for transactions and for each other table that has its
          columns; rows that do not meet it are neither emitted nor counted. `ValueError` without
          the one for transactions
        """
    def bind(self, profile: Profile, units: Sequence[int], *, bus: str | None = None) -> None:
        """A profile for these units of one bus (by name) or of all; the last one wins.

        Before `add_bus`.
        """
    def add_bus(
        self,
        name: str,
        *,
        source: str,
        mode: str = "auto",
        line: tuple[int, int, str, float] | None = None,
        clock: str = "none",
        resolution_ns: int | None = None,
        silence_ns: tuple[int, int] | None = None,
    ) -> int:
        """A bus; gives its number.

        - `source`: the file or port as `source` columns name it
        - `line`: baud, data bits, parity, stop bits
        - `clock`: utc, relative or none
        - `resolution_ns`: of that clock; None lets the core judge from the reads
        - `silence_ns`: t3.5 and t1.5, if RTU frames end at silences only; None for all evidence
        """
    def begin_at(self, bus: int, offset: int, *, line: str | None = None) -> None:
        """The first byte of a line will have this stream offset; before its first `feed`."""
    def feed(
        self,
        bus: int,
        data: bytes,
        time_ns: int | None = None,
        *,
        line: str | None = None,
        errors: Sequence[int] | None = None,
        hole: bool = False,
    ) -> None:
        """Bytes off the line.

        `time_ns` is when the read returned, never before the last byte's stop bit. `errors` are the
        places in `data` of bytes that the receiver marked (parity, framing, break), rising. `hole`
        says that bytes were lost before these.
        """
    def open_text(
        self,
        bus: int,
        format: str,
        *,
        dialects: Dialects | None = None,
        ordered: bool = False,
        sample: bytes | None = None,
        zone: Sequence[tuple[int, int]] | None = None,
        date: str | None = None,
    ) -> None:
        """Say how the text of a bus is to be read, before the first `feed_text`.

        - `format`: rows of `dialects` joined by `+`; unless `ordered`, others are tried where they
          do not fit
        - `sample`: the first bytes, which say how dates are written and whether lines are quoted
        - `zone`: of times without one: from which ns since 1970 on which offset in ns holds
        - `date`: the first day of times without one, as 2026-11-21

        `ValueError` for an unknown format or a date that is none.
        """
    def feed_text(self, bus: int, data: bytes, *, final: bool = False) -> None:
        """Text of a recording, cut anywhere.

        `final` ends the last line.
        """
    def settle_text(self, bus: int) -> None:
        """Nothing more has come for a while: decide what waits for a further line or a silence."""

    def add_capture(
        self,
        source: str,
        *,
        ports: Sequence[int] | None = None,
        mode: str = "auto",
        line: tuple[int, int, str, float] | None = None,
        silence_ns: tuple[int, int] | None = None,
    ) -> int:
        """A capture (pcap or pcapng); gives its number, from 0. Its buses are made as they show.

        - `source`: the file as `source` columns name it
        - `ports`: where Modbus is looked for; None is 502, an empty list is everywhere
        - `mode`, `line`, `silence_ns`: of serial interfaces in it, as for `add_bus`
        """
    def feed_capture(self, capture: int, data: bytes, *, final: bool = False) -> None:
        """Bytes of a capture, cut anywhere; `final` says that it has ended."""
    def capture(self, capture: int) -> str:
        """What a capture has shown, as JSON with the keys of `reading`.

        `records` are packets; `dropped` says what was left out or is missing, by reason.
        """
    def lend_reader(self, bus: int) -> Reader:
        """The reader of the text of a bus, or one for its raw bytes, for another thread.

        Until `take_back`, the session gets what it has read by `take_read`.
        """
    def lend_capture_reader(self, capture: int) -> Reader:
        """The same of a capture."""
    def take_back(self, reader: Reader) -> None:
        """End what `lend_reader` or `lend_capture_reader` began: all it has read was fed."""
    def take_read(self, block: ReadBlock) -> Batch:
        """Feed what the reader has found in the next block, and `take` the rows."""
    def add_logic(
        self,
        source: str,
        *,
        rate: float,
        unit: int,
        channels: Sequence[int] | None = None,
        inverted: bool | None = None,
        mode: str = "auto",
        line: tuple[int, int, str, float] | None = None,
    ) -> int:
        """Samples of a logic analyzer; gives their number, from 0. Two lines that talk are one bus.

        - `rate`: samples a second; `unit`: bytes of a sample, lowest first, a bit a channel;
          0 for rows of text: a time in seconds and a level a channel, with a rate of 1e9
        - `channels`: those to look at, all by default; `inverted`: whether lines idle low
        - `line`: baud and the rest, found out where None
        """
    def feed_logic(self, logic: int, data: bytes, *, final: bool = False) -> None:
        """Samples, cut anywhere; `final` says that they have ended."""
    def logic(self, logic: int) -> str:
        """What was found, as JSON.

        {lines: [{channel, line, inverted}], copies: [channel...], surplus: [channel...]}: copies
        carry what a line does; surplus are lines that a bus has no room for.
        """
    def poll(self, now_ns: int) -> None:
        """Time goes on without bytes: ends silences and timeouts of every live bus."""
    def flush(self, *, file: bool = False) -> None:
        """The end of the recording: decides everything that is still open.

        With `file`, the end of a file: raw recordings in it may go on in the next one.
        """
    def close(self, bus: int) -> None:
        """The source of a bus has ended and was flushed: gives back its memory, but its counters.

        `reading` knows nothing of the bus any more. A raw recording may go on in the next file: its
        bus stays open.
        """
    def close_capture(self, capture: int) -> None:
        """The same for a capture and all its buses; `capture` does not know it any more."""
    def close_logic(self, logic: int) -> None:
        """The same for samples of a logic analyzer."""
    def take(self) -> Batch: ...
    def conclude(self) -> Batch:
        """The last rows, and the diagnoses of the whole session where these are wanted."""
    def doctor(self) -> str:
        """The verdict, the diagnoses and the margins so far, as JSON; null if not wanted."""
    def take_events(self) -> list[str]:
        """The events of troubles since the last call, each as JSON, the oldest first.

        Only of a live session with `diagnoses` among its tables.
        """
    def troubles(self) -> str:
        """The troubles that are open, as a JSON list; see `take_events`."""
    def document(self) -> str:
        """What `doctor` and `stats` say, with the overview of reports, in one JSON object.

        {doctor, statistics, overview}, of which doctor and overview are null if not wanted. With
        the time series alone, which text shows, the doctor the worst one of each kind.
        """
    def stats(self) -> str:
        """Statistics so far, as JSON (see analyzer/views/stats.py for the keys)."""
    def reading(self, bus: int) -> str:
        """What a text reader saw, as JSON.

        {lines, records, unparsed, unparsed_with_hex, unparsed_hex_bytes,
        unparsed_examples: [[line, text, bytes of hex]...], dropped: {reason: n},
        dropped_bytes: {reason: bytes}, left_out: [[line, hex, reason]...] (1000 at most), formats,
        clock, resolution_ns, mode}.
        """
