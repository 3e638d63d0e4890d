//! Writes logs in Zeek's format: its `modbus.log`, and the `modbus_detailed.log` of the icsnpp-modbus package.
//!
//! Programs that read Zeek's logs identify the fields by the header, in this order. The lines of a TCP connection have its
//! ends, by which they join a `conn.log` of the same capture; its `uid` is our own, because Zeek draws its own at random. A
//! serial line has no addresses and no transaction identifiers, so these are invented: unit n of bus b is 10.b.0.n, its master
//! 10.b.255.254, the identifier is the transaction's number modulo 65536, and each bus is one connection.
//!
//! `endpoints` has the ends and the uid, `icsnpp` the fields of `modbus_detailed.log`,
//! `names` Zeek's words, and `value` how a field is written.

mod endpoints;
mod icsnpp;
mod names;
mod value;

use endpoints::identity;
use icsnpp::detailed;
use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::status::Status;
use modlens_tables::columns::Table;
use names::{exception_name, function_name};
use value::{push_json, push_text, LogValue};

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
