//! Writes logs in Zeek's format: its `modbus.log`, and the `modbus_detailed.log` of the icsnpp-modbus package.
//!
//! Programs that read Zeek's logs identify the fields by the header, in this order. The lines of a TCP connection have its
//! ends, by which they join a `conn.log` of the same capture; its `uid` is our own, because Zeek draws its own at random. A
//! serial line has no addresses and no transaction identifiers, so these are invented: unit n of bus b is 10.b.0.n, its master
//! 10.b.255.254, the identifier is the transaction's number modulo 65536, and each bus is one connection.
//!
//! `endpoints` has the ends and the uid, `icsnpp` the fields of `modbus_detailed.log`.

mod endpoints;
mod icsnpp;

use endpoints::identity;
use icsnpp::detailed;
use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::decimal::push_int;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_tables::columns::Table;

/// One of Zeek's logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Log {
    /// One line per PDU.
    Modbus,
    /// One line per transaction, or per PDU of a function that icsnpp does not pair.
    Detailed,
}

const MODBUS: [(&str, &str); 11] = [
    ("ts", "time"),
    ("uid", "string"),
    ("id.orig_h", "addr"),
    ("id.orig_p", "port"),
    ("id.resp_h", "addr"),
    ("id.resp_p", "port"),
    ("tid", "count"),
    ("unit", "count"),
    ("func", "string"),
    ("pdu_type", "string"),
    ("exception", "string"),
];

const DETAILED: [(&str, &str); 21] = [
    ("ts", "time"),
    ("uid", "string"),
    ("id.orig_h", "addr"),
    ("id.orig_p", "port"),
    ("id.resp_h", "addr"),
    ("id.resp_p", "port"),
    ("tid", "count"),
    ("unit", "count"),
    ("func", "string"),
    ("address", "count"),
    ("quantity", "count"),
    ("request_values", "vector[count]"),
    ("response_values", "vector[count]"),
    ("modbus_detailed_link_id", "string"),
    ("matched", "bool"),
    ("request_subfunction_code", "string"),
    ("response_subfunction_code", "string"),
    ("request_data", "string"),
    ("response_data", "string"),
    ("exception_code", "string"),
    ("mei_type", "string"),
];

/// Zeek's names of the functions (base/protocols/modbus/consts.zeek).
const FUNCTIONS: [(u8, &str); 30] = [
    (0x01, "READ_COILS"),
    (0x02, "READ_DISCRETE_INPUTS"),
    (0x03, "READ_HOLDING_REGISTERS"),
    (0x04, "READ_INPUT_REGISTERS"),
    (0x05, "WRITE_SINGLE_COIL"),
    (0x06, "WRITE_SINGLE_REGISTER"),
    (0x07, "READ_EXCEPTION_STATUS"),
    (0x08, "DIAGNOSTICS"),
    (0x09, "PROGRAM_484"),
    (0x0A, "POLL_484"),
    (0x0B, "GET_COMM_EVENT_COUNTER"),
    (0x0C, "GET_COMM_EVENT_LOG"),
    (0x0D, "PROGRAM_584_984"),
    (0x0E, "POLL_584_984"),
    (0x0F, "WRITE_MULTIPLE_COILS"),
    (0x10, "WRITE_MULTIPLE_REGISTERS"),
    (0x11, "REPORT_SLAVE_ID"),
    (0x12, "PROGRAM_884_U84"),
    (0x13, "RESET_COMM_LINK_884_U84"),
    (0x14, "READ_FILE_RECORD"),
    (0x15, "WRITE_FILE_RECORD"),
    (0x16, "MASK_WRITE_REGISTER"),
    (0x17, "READ_WRITE_MULTIPLE_REGISTERS"),
    (0x18, "READ_FIFO_QUEUE"),
    (0x28, "PROGRAM_CONCEPT"),
    (0x2B, "ENCAP_INTERFACE_TRANSPORT"),
    (0x5A, "PROGRAM_UNITY"),
    (0x7D, "FIRMWARE_REPLACEMENT"),
    (0x7E, "PROGRAM_584_984_2"),
    (0x7F, "REPORT_LOCAL_ADDRESS"),
];

/// Zeek's names of the exception codes (base/protocols/modbus/consts.zeek).
const EXCEPTIONS: [(u8, &str); 9] = [
    (0x01, "ILLEGAL_FUNCTION"),
    (0x02, "ILLEGAL_DATA_ADDRESS"),
    (0x03, "ILLEGAL_DATA_VALUE"),
    (0x04, "SLAVE_DEVICE_FAILURE"),
    (0x05, "ACKNOWLEDGE"),
    (0x06, "SLAVE_DEVICE_BUSY"),
    (0x08, "MEMORY_PARITY_ERROR"),
    (0x0A, "GATEWAY_PATH_UNAVAILABLE"),
    (0x0B, "GATEWAY_TARGET_DEVICE_FAILED_TO_RESPOND"),
];

/// The value of one field of a log.
enum LogValue {
    Unset,
    Count(i64),
    Time(Ns),
    Text(String),
    Yes(bool),
    Counts(Vec<i32>),
}

impl Log {
    /// The names and types of the log's fields.
    fn fields(self) -> &'static [(&'static str, &'static str)] {
        match self {
            Self::Modbus => &MODBUS,
            Self::Detailed => &DETAILED,
        }
    }

    /// The name of the log in its header.
    fn path(self) -> &'static str {
        match self {
            Self::Modbus => "modbus",
            Self::Detailed => "modbus_detailed",
        }
    }

    /// Appends the header of a log with tab-separated values.
    pub fn head(self, out: &mut Vec<u8>) {
        let names =
            |at: fn(&(&'static str, &'static str)) -> &'static str| self.fields().iter().map(at).collect::<Vec<_>>().join("\t");
        let head = format!(
            "#separator \\x09\n#set_separator\t,\n#empty_field\t(empty)\n#unset_field\t-\n#path\t{}\n#fields\t{}\n#types\t{}\n",
            self.path(),
            names(|field| field.0),
            names(|field| field.1)
        );
        out.extend_from_slice(head.as_bytes());
    }

    /// Appends the rows of a table of transactions. With `json`, each line is a JSON object instead of tab-separated
    /// values.
    pub fn rows(self, table: &Table, json: bool, out: &mut Vec<u8>) {
        for row in 0..table.len() {
            let Some(transaction) = table.transaction(row) else { continue };
            match self {
                Self::Modbus => self.pdus(&table.batch, transaction, json, out),
                Self::Detailed => {
                    for values in detailed(&table.batch, transaction) {
                        self.line(&values, json, out);
                    }
                }
            }
        }
    }

    /// Appends a line for the request and one for the response, if they were observed undamaged.
    fn pdus(self, batch: &Batch, t: &Transaction, json: bool, out: &mut Vec<u8>) {
        let request = t.request.frame > 0 && t.status != Status::BadRequest;
        let response = t.response.frame > 0 && t.status != Status::BadResponse;
        for (is_observed, half, kind) in [(request, &t.request, "REQ"), (response, &t.response, "RESP")] {
            if !is_observed {
                continue;
            }
            let is_response = kind == "RESP";
            let code = half.pdu.of(&batch.arena).first().copied().unwrap_or(t.function);
            let mut values = identity(batch, t, half.start);
            values.push(LogValue::Text(function_name(code)));
            values.push(LogValue::Text(kind.to_owned()));
            values.push(t.exception.filter(|_| is_response).map_or(LogValue::Unset, |code| LogValue::Text(exception_name(code))));
            self.line(&values, json, out);
        }
    }

    /// Appends one line.
    fn line(self, values: &[LogValue], json: bool, out: &mut Vec<u8>) {
        if json {
            let mut first = true;
            out.push(b'{');
            for ((key, _), value) in self.fields().iter().zip(values).filter(|(_, value)| !matches!(value, LogValue::Unset)) {
                if !std::mem::take(&mut first) {
                    out.push(b',');
                }
                out.extend_from_slice(format!("\"{key}\":").as_bytes());
                push_json(value, out);
            }
            out.push(b'}');
        } else {
            for (i, value) in values.iter().enumerate() {
                if i > 0 {
                    out.push(b'\t');
                }
                push_text(value, out);
            }
        }
        out.push(b'\n');
    }
}

/// Zeek's name of a function code, which may have the exception bit.
fn function_name(code: u8) -> String {
    let name = |code: u8| FUNCTIONS.iter().find(|(known, _)| *known == code).map(|(_, name)| *name);
    match (name(code), name(code & !EXCEPTION_BIT)) {
        (Some(name), _) => name.to_owned(),
        (None, Some(name)) => format!("{name}_EXCEPTION"),
        _ => format!("unknown-{code}"),
    }
}

/// Zeek's name of an exception code.
fn exception_name(code: u8) -> String {
    let name = EXCEPTIONS.iter().find(|(known, _)| *known == code).map(|(_, name)| (*name).to_owned());
    name.unwrap_or_else(|| format!("unknown-{code}"))
}

/// Bytes as Zeek prints them: `\xNN` for everything that is not printable ASCII.
fn escaped_bytes(bytes: &[u8]) -> String {
    let escape = |&byte: &u8| match byte {
        b'\\' => String::from("\\\\"),
        b' '..=b'~' => (byte as char).to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    bytes.iter().map(escape).collect()
}

/// Appends a time as seconds since 1970 with six decimals.
fn push_epoch(ns: Ns, out: &mut Vec<u8>) {
    push_int(ns.div_euclid(1_000_000_000), out);
    out.extend_from_slice(format!(".{:06}", ns.rem_euclid(1_000_000_000) / 1000).as_bytes());
}

/// Appends numbers separated by commas.
fn push_counts(values: &[i32], out: &mut Vec<u8>) {
    for (i, value) in values.iter().enumerate() {
        if i > 0 {
            out.push(b',');
        }
        push_int(i64::from(*value), out);
    }
}

/// Appends a value for a tab-separated log.
fn push_text(value: &LogValue, out: &mut Vec<u8>) {
    match value {
        LogValue::Unset => out.push(b'-'),
        LogValue::Count(count) => push_int(*count, out),
        LogValue::Time(ns) => push_epoch(*ns, out),
        LogValue::Text(text) => out.extend_from_slice(text.as_bytes()),
        LogValue::Yes(yes) => out.push(if *yes { b'T' } else { b'F' }),
        LogValue::Counts(values) if values.is_empty() => out.extend_from_slice(b"(empty)"),
        LogValue::Counts(values) => push_counts(values, out),
    }
}

/// Appends a value as JSON.
fn push_json(value: &LogValue, out: &mut Vec<u8>) {
    match value {
        LogValue::Text(text) => out.extend_from_slice(serde_json::Value::from(text.as_str()).to_string().as_bytes()),
        LogValue::Yes(yes) => out.extend_from_slice(if *yes { b"true" } else { b"false" }),
        LogValue::Counts(values) => {
            out.push(b'[');
            push_counts(values, out);
            out.push(b']');
        }
        other => push_text(other, out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_have_the_names_that_zeek_uses() {
        assert_eq!(function_name(3), "READ_HOLDING_REGISTERS");
        assert_eq!(function_name(0x83), "READ_HOLDING_REGISTERS_EXCEPTION");
        assert_eq!(function_name(0x41), "unknown-65");
        assert_eq!(exception_name(2), "ILLEGAL_DATA_ADDRESS");
        // Every public function of the table has Zeek's name.
        for code in modlens_protocol::functions::Functions::embedded().rows().map(|row| row.code) {
            assert!(!function_name(code).starts_with("unknown"), "{code}");
        }
    }

    #[test]
    fn bytes_are_escaped_as_in_zeek() {
        assert_eq!(escaped_bytes(b"\x00A\\"), "\\x00A\\\\");
    }
}
