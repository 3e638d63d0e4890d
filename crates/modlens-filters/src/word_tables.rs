//! What people write in filters instead of the right word: tables, and nothing else.

/// Closed sets of values that no table of the core has.
pub const SETS: &[(&str, &[&str])] = &[
    ("severity", &["info", "warning", "error"]),
    ("direction", &["request", "response", "unknown"]),
    ("operation", &["read", "write", "read_write", "other"]),
    ("register_type", &["coil", "discrete_input", "input_register", "holding_register"]),
    ("mode", &["rtu", "ascii", "tcp"]),
    ("closed_by", &["client", "server"]),
    ("client_framing", &["tcp", "rtu", "ascii", "other"]),
    ("server_framing", &["tcp", "rtu", "ascii", "other"]),
];

/// The operations that a word alone means, and functions beside them: file records and the FIFO queue are no registers of a
/// table, so that their operation is `other`.
pub const OPERATIONS: &[(&str, &[&str], &[i64])] =
    &[("read", &["read", "read_write"], &[0x14, 0x18]), ("write", &["write", "read_write"], &[0x15])];

/// The columns in which a word that is alone is looked for, in this order; then those of `SETS`.
pub const COLUMNS_OF_WORDS: &[&str] = &["status", "verdict", "code", "findings", "first_status"];

/// What people write for no value.
pub const NOTHING: &[&str] = &["null", "none", "nil", "nan", "undefined"];

/// What people write for a time.
pub const NOW: &[&str] = &["now", "today"];

/// Column -> value -> what people call it.
pub const VALUES: &[(&str, &[(&str, &str)])] = &[
    (
        "status",
        &[
            ("no_response", "timeout timed_out timedout no_reply no_answer missing unanswered lost"),
            ("ok", "success good answered"),
            ("bad_response", "bad_crc crc crc_error checksum damaged corrupt invalid"),
            ("exception", "error refused"),
        ],
    ),
    (
        "verdict",
        &[
            ("bad_checksum", "bad crc bad_crc crc crc_error crcerror checksum checksum_error lrc invalid error"),
            ("incomplete", "truncated short cut partial"),
            ("ok", "good valid"),
            ("noise", "garbage junk"),
        ],
    ),
    (
        "findings",
        &[
            ("bad_checksum", "bad_crc crc crc_error checksum checksum_error lrc"),
            ("no_response", "timeout timed_out no_reply no_answer"),
            ("retry", "retries retransmission repeat repeated"),
            ("late_response", "late"),
            ("local_echo", "echo"),
            ("exception", "error"),
        ],
    ),
    ("severity", &[("warning", "warn"), ("error", "err critical"), ("info", "information note")]),
    ("direction", &[("request", "req query tx out master"), ("response", "resp rsp reply answer rx in")]),
    ("operation", &[("read_write", "rw r/w readwrite read/write")]),
    (
        "register_type",
        &[
            ("holding_register", "hr 4x holding registers register"),
            ("input_register", "ir 3x input"),
            ("discrete_input", "di 1x discrete"),
            ("coil", "co 0x coils"),
        ],
    ),
    ("mode", &[("tcp", "modbus/tcp modbustcp mbtcp modbus_tcp"), ("rtu", "serial modbus_rtu mbrtu")]),
];

/// Column -> its names in other programs. Of several, the first that the table has counts.
pub const COLUMNS: &[(&str, &str)] = &[
    ("unit", "slave slave_id slaveid unit_id unitid uid device device_id server_id node station slave_address slaveaddr"),
    ("function", "fc func func_code funccode function_code functioncode fcode fn"),
    ("address", "addr start start_address starting_address start_addr reference_num"),
    ("quantity", "count qty length len size word_cnt num_registers"),
    ("byte_length", "length len size num_bytes nbytes"),
    ("client", "src source_ip ip_src src_ip ip master"),
    ("server", "dst dest destination ip_dst dst_ip target"),
    ("exception", "exc exception_code exc_code error_code errcode err"),
    ("response_time_us", "latency rtt duration delay response_ms took"),
    ("elapsed_us", "seconds elapsed relative_time t"),
    ("mbap_id", "transaction_id trans_id transid tid"),
    ("txn", "transaction nr no number index"),
    ("frame", "nr no number index packet"),
    ("time", "timestamp ts date datetime when"),
    ("hex", "bytes raw payload pdu adu"),
    ("response_hex", "bytes raw payload pdu adu"),
    ("bus", "port interface serial_port"),
    ("register_type", "type kind table reg_type"),
    ("direction", "dir"),
    ("client_port", "port source_port srcport src_port sport"),
    ("opened", "time start begin began connected syn"),
    ("closed", "end ended fin rst disconnected"),
    ("code", "finding"),
    ("value", "val"),
];

/// Words that no column has -> table -> what to write. They are looked up first.
pub const EXPRESSIONS: &[(&str, &[(&str, &str)])] = &[
    (
        "timeout timeouts timed_out no_reply no_answer",
        &[
            ("transactions", "`status == 'no_response'`"),
            ("readings", "`status == 'no_response'`"),
            ("frames", "`'no_response' in findings`"),
            ("findings", "`code == 'no_response'`"),
        ],
    ),
    (
        "crc checksum lrc crc_error bad_crc crc_ok checksum_ok",
        &[
            ("transactions", "`'bad_checksum' in findings`"),
            ("frames", "`verdict == 'bad_checksum'`"),
            ("findings", "`code == 'bad_checksum'`"),
        ],
    ),
    (
        "value values val",
        &[
            ("transactions", "`5 in data`, or `value` with --table readings"),
            ("frames", "`value` with --table readings"),
            ("findings", "`value` with --table readings"),
        ],
    ),
    (
        "failed failure failures",
        &[
            ("transactions", "`status in ('no_response', 'bad_response', 'bad_request')`"),
            ("frames", "`verdict != 'ok'`"),
            ("readings", "`status != 'ok'`"),
            ("findings", "`severity == 'error'`"),
        ],
    ),
    (
        "error errors is_error",
        &[
            ("transactions", "`exception`, or `status != 'ok'`"),
            ("frames", "`exception`, or `verdict != 'ok'`"),
            ("readings", "`status != 'ok'`"),
            ("findings", "`severity == 'error'`"),
        ],
    ),
    (
        "reg register registers register_address",
        &[
            ("transactions", "`address == 107`, or `touches(hr, 107)`"),
            ("readings", "`address == 107`, or `touches(hr, 107)`"),
            ("frames", "`touches(hr, 107)` with --table transactions"),
        ],
    ),
    (
        "id",
        &[
            ("transactions", "`unit`, `txn` or `mbap_id`"),
            ("frames", "`unit`, `frame` or `mbap_id`"),
            ("readings", "`unit` or `txn`"),
            ("findings", "`code`, `unit` or `txn`"),
        ],
    ),
    (
        "code",
        &[("transactions", "`function` or `exception`"), ("frames", "`function` or `exception`"), ("readings", "`function`")],
    ),
];

/// Operators of other languages, and what to write.
pub const OPERATORS: &[(&str, &str)] = &[
    ("=", "`==` to compare"),
    ("===", "`==`"),
    ("!==", "`!=`"),
    ("<>", "`!=`"),
    ("~=", "`!=`"),
    ("≠", "`!=`"),
    ("=>", "`>=`"),
    ("≥", "`>=`"),
    ("=<", "`<=`"),
    ("≤", "`<=`"),
    ("&&", "`and`"),
    ("||", "`or`"),
    ("!", "`not`"),
    ("=~", "`'text' in function_name`"),
    ("!~", "`'text' not in function_name`"),
    (";", "`and` or `or`"),
    ("and", "`and`"),
    ("or", "`or`"),
    ("not", "`not`"),
    ("in", "`in`"),
    ("is", "`is None` or `is not None`"),
    ("eq", "`==`"),
    ("ne", "`!=`"),
    ("lt", "`<`"),
    ("gt", "`>`"),
    ("le", "`<=`"),
    ("ge", "`>=`"),
    ("contains", "`'text' in function_name`"),
    ("like", "`'text' in function_name`"),
    ("matches", "`'text' in function_name`"),
    ("between", "`1 <= unit <= 5`"),
];
