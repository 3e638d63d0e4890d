"""What people write in filters instead of the right word, and what the error message suggests.

Closed sets of values (statuses, findings, modes), names that other programs give to the columns,
and operators of other languages. Everything here gives words for messages; nothing is compiled.

>>> nearest_value("status", "no_respons")
'no_response'
>>> instead_of_column("slave", "transactions")
'`unit`'
>>> wrong_operator("unit == 1 && function == 3")
(10, 'write `and`, not `&&`')
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache

from analyzer.addresses import REGISTER_TYPES
from analyzer.columns import TABLES, columns
from dissectors.function_lookup import normalized, similar_name
from dissectors.texts import Vocabulary, respelled
from dissectors.vocabulary import diagnoses, findings, statuses, verdicts

__all__ = [
    "VOCABULARIES",
    "closed_set",
    "column_of_word",
    "instead_of_column",
    "nearest_value",
    "operations_of_word",
    "wrong_operator",
]

VOCABULARIES: Mapping[str, Vocabulary] = {
    "status": "status",
    "first_status": "status",
    "findings": "finding",
    "code": "finding",
}
"""Columns whose words may be given in their former spelling."""

_SETS: Mapping[str, tuple[str, ...]] = {
    "severity": ("info", "warning", "error"),
    "direction": ("request", "response", "unknown"),
    "operation": ("read", "write", "read_write", "other"),
    "register_type": REGISTER_TYPES,
    "mode": ("rtu", "ascii", "tcp"),
    "closed_by": ("client", "server"),
    "client_framing": ("tcp", "rtu", "ascii", "other"),
    "server_framing": ("tcp", "rtu", "ascii", "other"),
}

_OPERATIONS: Mapping[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "read": (("read", "read_write"), (0x14, 0x18)),
    "write": (("write", "read_write"), (0x15,)),
}
"""Word -> the operations that it means when it is alone, and functions beside them: file
records and the FIFO queue are no registers of a table, so that their operation is `other`."""

# The order in which a word that is alone is looked for.
_COLUMNS_OF_WORDS = ("status", "verdict", "code", "findings", "first_status", *_SETS)

_VALUES: Mapping[str, Mapping[str, str]] = {
    "status": {
        "no_response": "timeout timed_out timedout no_reply no_answer missing unanswered lost",
        "ok": "success good answered",
        "bad_response": "bad_crc crc crc_error checksum damaged corrupt invalid",
        "exception": "error refused",
    },
    "verdict": {
        "bad_checksum": "bad crc bad_crc crc crc_error crcerror checksum checksum_error lrc invalid"
        " error",
        "incomplete": "truncated short cut partial",
        "ok": "good valid",
        "noise": "garbage junk",
    },
    "findings": {
        "bad_checksum": "bad_crc crc crc_error checksum checksum_error lrc",
        "no_response": "timeout timed_out no_reply no_answer",
        "retry": "retries retransmission repeat repeated",
        "late_response": "late",
        "local_echo": "echo",
        "exception": "error",
    },
    "severity": {"warning": "warn", "error": "err critical", "info": "information note"},
    "direction": {"request": "req query tx out master", "response": "resp rsp reply answer rx in"},
    "operation": {"read_write": "rw r/w readwrite read/write"},
    "register_type": {
        "holding_register": "hr 4x holding registers register",
        "input_register": "ir 3x input",
        "discrete_input": "di 1x discrete",
        "coil": "co 0x coils",
    },
    "mode": {"tcp": "modbus/tcp modbustcp mbtcp modbus_tcp", "rtu": "serial modbus_rtu mbrtu"},
}
"""Column -> value -> what people call it."""

_COLUMNS = {
    "unit": "slave slave_id slaveid unit_id unitid uid device device_id server_id node station"
    " slave_address slaveaddr",
    "function": "fc func func_code funccode function_code functioncode fcode fn",
    "address": "addr start start_address starting_address start_addr reference_num",
    "quantity": "count qty length len size word_cnt num_registers",
    "byte_length": "length len size num_bytes nbytes",
    "client": "src source_ip ip_src src_ip ip master",
    "server": "dst dest destination ip_dst dst_ip target",
    "exception": "exc exception_code exc_code error_code errcode err",
    "response_time_us": "latency rtt duration delay response_ms took",
    "elapsed_us": "seconds elapsed relative_time t",
    "mbap_id": "transaction_id trans_id transid tid",
    "txn": "transaction nr no number index",
    "frame": "nr no number index packet",
    "time": "timestamp ts date datetime when",
    "hex": "bytes raw payload pdu adu",
    "response_hex": "bytes raw payload pdu adu",
    "bus": "port interface serial_port",
    "register_type": "type kind table reg_type",
    "direction": "dir",
    "client_port": "port source_port srcport src_port sport",
    "opened": "time start begin began connected syn",
    "closed": "end ended fin rst disconnected",
    "code": "finding",
    "value": "val",
}
"""Column -> its names in other programs. Of several, the first that the table has counts."""

_EXPRESSIONS: Mapping[str, Mapping[str, str]] = {
    "timeout timeouts timed_out no_reply no_answer": {
        "transactions": "`status == 'no_response'`",
        "readings": "`status == 'no_response'`",
        "frames": "`'no_response' in findings`",
        "findings": "`code == 'no_response'`",
    },
    "crc checksum lrc crc_error bad_crc crc_ok checksum_ok": {
        "transactions": "`'bad_checksum' in findings`",
        "frames": "`verdict == 'bad_checksum'`",
        "findings": "`code == 'bad_checksum'`",
    },
    "value values val": {
        "transactions": "`5 in data`, or `value` with --table readings",
        "frames": "`value` with --table readings",
        "findings": "`value` with --table readings",
    },
    "error errors is_error failed": {
        "transactions": "`exception`, or `status != 'ok'`",
        "frames": "`exception`, or `verdict != 'ok'`",
        "readings": "`status != 'ok'`",
        "findings": "`severity == 'error'`",
    },
    "reg register registers register_address": {
        "transactions": "`address == 107`, or `touches(hr, 107)`",
        "readings": "`address == 107`, or `touches(hr, 107)`",
        "frames": "`touches(hr, 107)` with --table transactions",
    },
    "id": {
        "transactions": "`unit`, `txn` or `mbap_id`",
        "frames": "`unit`, `frame` or `mbap_id`",
        "readings": "`unit` or `txn`",
        "findings": "`code`, `unit` or `txn`",
    },
    "code": {
        "transactions": "`function` or `exception`",
        "frames": "`function` or `exception`",
        "readings": "`function`",
    },
    "now today": dict.fromkeys(TABLES, "a time in quotes, such as '2023-10-11T14:00:00Z'"),
}
"""Words that no column has -> table -> what to write. They are looked up first."""

_NOTHING = ("null", "none", "nil", "nan", "undefined")

# Quotation marks of word processors: single and double, high and low, and angle ones.
_CURLY_QUOTES = "\u2018\u2019\u201a\u201c\u201d\u201e\u00ab\u00bb"
_TOKEN = re.compile(
    r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*"|[=!<>~&|]+|[≥≤≠;:/]|[\w.]+"""
    rf"|[{_CURLY_QUOTES}]"
)

_OPERATORS = {
    "=": "`==` to compare",
    "===": "`==`",
    "!==": "`!=`",
    "<>": "`!=`",
    "~=": "`!=`",
    "≠": "`!=`",
    "=>": "`>=`",
    "≥": "`>=`",
    "=<": "`<=`",
    "≤": "`<=`",
    "&&": "`and`",
    "||": "`or`",
    "!": "`not`",
    "=~": "`'text' in function_name`",
    "!~": "`'text' not in function_name`",
    ";": "`and` or `or`",
    "and": "`and`",
    "or": "`or`",
    "not": "`not`",
    "in": "`in`",
    "is": "`is None` or `is not None`",
    "eq": "`==`",
    "ne": "`!=`",
    "lt": "`<`",
    "gt": "`>`",
    "le": "`<=`",
    "ge": "`>=`",
    "contains": "`'text' in function_name`",
    "like": "`'text' in function_name`",
    "matches": "`'text' in function_name`",
    "between": "`1 <= unit <= 5`",
}
_RIGHT_WORDS = ("and", "or", "not", "in", "is")
_WITH_MEASURE = re.compile(r"\d[\d.]*(?:ms|us|s|h|m)")
_DURATION = re.compile(r"(\d{1,12}(?:\.\d{1,6})?)(us|ms|s|m|h)")
_MICROSECONDS = {"us": 1, "ms": 1e3, "s": 1e6, "m": 60e6, "h": 3600e6}


@cache
def closed_set(column: str) -> tuple[str, ...]:
    """All values that a column can have; empty for a column that can have any."""
    if column in ("status", "first_status"):
        return tuple(statuses())
    if column == "verdict":
        return tuple(verdicts())
    if column == "findings":
        return tuple(one.code for one in findings())
    if column == "code":
        codes = [*(one.code for one in findings()), *(one.code for one in diagnoses())]
        return tuple(dict.fromkeys(codes))
    return _SETS.get(column, ())


def nearest_value(column: str, word: str) -> str | None:
    """The value of a closed set that a word most probably means."""
    known = closed_set(column)
    plain = normalized(word)
    called = _VALUES.get({"code": "findings", "first_status": "status"}.get(column, column), {})
    for value, names in called.items():
        if plain in map(normalized, names.split()):
            return value
    begins = [value for value in known if plain and normalized(value).startswith(plain)]
    return begins[0] if len(begins) == 1 else similar_name(word, known)


def column_of_word(word: str, table: str) -> tuple[str, str] | None:
    """The column of a table that has this word among its values, and the word as it spells it.

    >>> column_of_word("retry", "transactions"), column_of_word("ok", "frames")
    (('findings', 'retry'), ('verdict', 'ok'))
    """
    there = {column.key for column in columns(table)}
    for column in _COLUMNS_OF_WORDS:
        if column in there:
            value = respelled(VOCABULARIES[column], word) if column in VOCABULARIES else word
            if value in closed_set(column):
                return column, value
    return None


def operations_of_word(word: str) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """The operations, and functions of other operations, that a word alone means.

    >>> operations_of_word("write"), operations_of_word("other")
    ((('write', 'read_write'), (21,)), (('other',), ()))
    """
    return _OPERATIONS.get(word, ((word,), ()))


def instead_of_column(word: str, table: str) -> str | None:
    """What to write instead of a name that no column of the table has; None if nothing is known."""
    plain = word.rsplit(".", 1)[-1].lower()
    if plain in _NOTHING:
        return "`is None` or `is not None`"
    for words, by_table in _EXPRESSIONS.items():
        if plain in words.split() and table in by_table:
            return by_table[table]
    there = {column.key for column in columns(table)}
    for column, names in _COLUMNS.items():
        if column in there and plain in names.split():
            return f"`{column}`"
    if plain in there:
        return f"`{plain}`"
    meant = next((column for column, names in _COLUMNS.items() if plain in names.split()), plain)
    for other in TABLES:
        if meant in {column.key for column in columns(other)}:
            return f"`{meant}` with --table {other}"
    return None


def wrong_operator(text: str) -> tuple[int, str] | None:
    """The first operator of another language in a text that is no expression, and what to write."""
    previous = ""
    for token in _TOKEN.finditer(text):
        advice = _instead_of_token(token[0], previous)
        if advice is not None:
            return token.start(), advice
        previous = token[0]
    return None


def _microseconds(word: str) -> str:
    """What to write for a duration such as `200ms`; empty for numbers with other units."""
    match = _DURATION.fullmatch(word)
    if match is None:
        return ""
    return f"{word} is {float(match[1]) * _MICROSECONDS[match[2]]:.0f}, because "


def _instead_of_token(word: str, previous: str) -> str | None:
    """What to write instead of a token of a text that is no expression; None for a right one."""
    if word in _CURLY_QUOTES:
        return "write texts in straight quotes, as in 'ok'"
    if _WITH_MEASURE.fullmatch(word):
        return f"write numbers without a unit; {_microseconds(word)}_us columns count microseconds"
    if word == ":" or (word == "/" and previous in ("==", "!=")):
        return "write times, names and other texts in quotes"
    if word.isdecimal() and word.startswith("0") and word.strip("0"):
        return "a number has no leading zeros; bytes are a text, as '01 03'"
    name = word.lower()
    # A first word such as `between` may be meant for a column.
    is_name = not previous and word.isalpha() and name not in _RIGHT_WORDS
    if name in _OPERATORS and word not in _RIGHT_WORDS and not is_name:
        return f"write {_OPERATORS[name]}, not `{word}`"
    return None
