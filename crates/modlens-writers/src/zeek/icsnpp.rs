//! The lines of `modbus_detailed.log` as icsnpp-modbus writes them: a line for a request with its response, and for
//! functions that it does not pair a line each.
//!
//! icsnpp has the content of functions 22, 23 and 43 in logs of their own, which are not written here: of these functions
//! the line has only what icsnpp has in this log.

use std::sync::OnceLock;

use modlens_engine::records::{Batch, FrameRef, Transaction};
use modlens_protocol::functions::{EXCEPTION_BIT, VOCABULARY};
use modlens_protocol::pdu::u16_at;
use modlens_protocol::status::Status;
use modlens_tables::columns::{read_data, read_range, write_data, write_range, Items};

use super::endpoints::identity;
use super::names::{exception_name, function_name};
use super::value::{escaped_bytes, LogValue};

const WRITE_SINGLE_COIL: u8 = 0x05;
const WRITE_SINGLE_REGISTER: u8 = 0x06;
const DIAGNOSTICS: u8 = 0x08;
const READ_FILE_RECORD: u8 = 0x14;
const WRITE_FILE_RECORD: u8 = 0x15;
const MASK_WRITE_REGISTER: u8 = 0x16;
const READ_WRITE_REGISTERS: u8 = 0x17;
const READ_FIFO_QUEUE: u8 = 0x18;
const ENCAPSULATED: u8 = 0x2B;
const CANOPEN: u8 = 0x0D;
const READ_DEVICE_IDENTIFICATION: u8 = 0x0E;

/// The functions whose request and response are one line.
const PAIRED: [u8; 15] = [
    1,
    2,
    3,
    4,
    WRITE_SINGLE_COIL,
    WRITE_SINGLE_REGISTER,
    DIAGNOSTICS,
    0x0F,
    0x10,
    READ_FILE_RECORD,
    WRITE_FILE_RECORD,
    MASK_WRITE_REGISTER,
    READ_WRITE_REGISTERS,
    READ_FIFO_QUEUE,
    ENCAPSULATED,
];

/// Bytes of a reference to a record in a request of function 20, and in front of the data in one of function 21: reference
/// type, file, record, length (sections 6.14 and 6.15).
const REFERENCE_BYTES: usize = 7;

/// The fields of one line after the identity, each as icsnpp has it where the function says nothing of it.
struct Detail {
    function: String,
    address: Option<u16>,
    quantity: Option<i64>,
    request_values: Option<Vec<i32>>,
    response_values: Option<Vec<i32>>,
    matched: Option<bool>,
    sub_functions: [Option<String>; 2],
    data: [Option<String>; 2],
    exception: Option<u8>,
    mei_type: Option<String>,
}

/// The lines of a transaction in `modbus_detailed.log`.
pub(super) fn detailed(batch: &Batch, t: &Transaction) -> Vec<Vec<LogValue>> {
    if PAIRED.contains(&t.function) {
        let mut values = identity(batch, t, t.start);
        values.extend(pair(batch, t).values());
        return vec![values];
    }
    let halves = [(&t.request, Status::BadRequest), (&t.response, Status::BadResponse)];
    let is_observed = |half: &FrameRef, damaged: Status| half.frame > 0 && t.status != damaged;
    let line = |half: &FrameRef| {
        let code = half.pdu.of(&batch.arena).first().copied().unwrap_or(t.function);
        let exception = t.exception.filter(|_| code & EXCEPTION_BIT != 0);
        let mut values = identity(batch, t, half.start);
        values.extend(Detail { exception, ..Detail::of(function_name(code)) }.values());
        values
    };
    halves.iter().filter(|(half, damaged)| is_observed(half, *damaged)).map(|(half, _)| line(half)).collect()
}

/// The line of a request with its response.
fn pair(batch: &Batch, t: &Transaction) -> Detail {
    let code = if t.exception.is_some() && t.request.frame == 0 { t.function | EXCEPTION_BIT } else { t.function };
    let is_matched = t.request.frame > 0 && t.response.frame > 0 && matches!(t.status, Status::Ok | Status::Exception);
    let body = |half: &FrameRef| half.pdu.of(&batch.arena).get(1..).unwrap_or(&[]);
    let request = if t.status == Status::BadRequest { &[] } else { body(&t.request) };
    let has_answer = matches!(t.status, Status::Ok | Status::Unsolicited) && t.exception.is_none();
    let response = if has_answer { body(&t.response) } else { &[] };
    let mut line = Detail { matched: Some(is_matched), exception: t.exception, ..Detail::of(function_name(code)) };
    match t.function {
        DIAGNOSTICS => diagnostics(request, response, &mut line),
        READ_FILE_RECORD => {
            line.quantity = request.first().map(|&bytes| i64::from(bytes) / REFERENCE_BYTES as i64);
            line.data[1] = joined(&records_read(response));
        }
        WRITE_FILE_RECORD => {
            line.quantity = request.first().map(|_| records_written(request).len() as i64);
            line.data[1] = joined(&records_written(response));
        }
        MASK_WRITE_REGISTER => line.address = u16_at(request, 0).or_else(|| u16_at(response, 0)),
        READ_WRITE_REGISTERS => {}
        READ_FIFO_QUEUE => {
            line.address = u16_at(request, 0);
            let queue: Option<Vec<i32>> = response.get(4..).map(Items::Words).map(counts);
            line.quantity = queue.as_ref().map(|queue| queue.len() as i64);
            line.response_values = queue.filter(|queue| !queue.is_empty());
        }
        ENCAPSULATED => line.mei_type = request.first().or(response.first()).map(|&mei| mei_name(mei)),
        _ => registers_and_bits(batch, t, response, &mut line),
    }
    line
}

/// What is read or written of one block of registers or bits.
fn registers_and_bits(batch: &Batch, t: &Transaction, response: &[u8], line: &mut Detail) {
    let range = read_range(batch, t).or_else(|| write_range(batch, t));
    (line.address, line.quantity) = (range.map(|range| range.0), range.map(|range| i64::from(range.1)));
    line.request_values = write_data(batch, t).map(counts);
    line.response_values = read_data(batch, t).map(counts);
    if matches!(t.function, WRITE_SINGLE_COIL | WRITE_SINGLE_REGISTER) {
        let is_coil = t.function == WRITE_SINGLE_COIL;
        let echoed = u16_at(response, 2).map(|value| if is_coil && value == 0xFF00 { 1 } else { i32::from(value) });
        line.response_values = echoed.map(|value| vec![value]);
    }
    line.data[1] = padding(batch, t);
}

/// Sub-function and data of diagnostics (section 6.8).
fn diagnostics(request: &[u8], response: &[u8], line: &mut Detail) {
    line.sub_functions = [request, response].map(|body| u16_at(body, 0).map(diagnostic_name));
    line.data = [request, response].map(|body| body.get(2..).filter(|data| !data.is_empty()).map(escaped_bytes));
}

/// The records in a response of function 20, as Zeek prints them.
fn records_read(response: &[u8]) -> Vec<String> {
    let (mut rest, mut all) = (response.get(1..).unwrap_or(&[]), Vec::new());
    while let [length, kind, behind @ ..] = rest {
        // The length counts the reference type as well.
        let Some((data, next)) = usize::from(*length).checked_sub(1).and_then(|bytes| behind.split_at_checked(bytes)) else {
            break;
        };
        all.push(format!("[file_len={length}, ref_type={kind}, record_data={}]", escaped_bytes(data)));
        rest = next;
    }
    all
}

/// The records in a request or response of function 21, as Zeek prints them.
fn records_written(body: &[u8]) -> Vec<String> {
    let (mut rest, mut all) = (body.get(1..).unwrap_or(&[]), Vec::new());
    while let Some((head, behind)) = rest.split_at_checked(REFERENCE_BYTES) {
        let [file, record, length] = [1, 3, 5].map(|at| u16_at(head, at).unwrap_or(0));
        let Some((data, next)) = behind.split_at_checked(2 * usize::from(length)) else { break };
        all.push(format!(
            "[ref_type={}, file_num={file}, record_num={record}, record_len={length}, record_data={}]",
            head[0],
            escaped_bytes(data)
        ));
        rest = next;
    }
    all
}

/// Several records as icsnpp joins them.
fn joined(records: &[String]) -> Option<String> {
    (!records.is_empty()).then(|| records.join(" | "))
}

fn counts(items: Items<'_>) -> Vec<i32> {
    (0..items.len()).map(|at| items.get(at)).collect()
}

impl Detail {
    /// A line with nothing but the function.
    fn of(function: String) -> Self {
        Self {
            function,
            address: None,
            quantity: None,
            request_values: None,
            response_values: None,
            matched: None,
            sub_functions: [None, None],
            data: [None, None],
            exception: None,
            mei_type: None,
        }
    }

    /// The fields in their order. There is no log that a link identifier could lead to.
    fn values(self) -> Vec<LogValue> {
        let text = |text: Option<String>| text.map_or(LogValue::Unset, LogValue::Text);
        let list = |list: Option<Vec<i32>>| list.map_or(LogValue::Unset, LogValue::Counts);
        let ([request_code, response_code], [request_data, response_data]) = (self.sub_functions, self.data);
        vec![
            LogValue::Text(self.function),
            self.address.map_or(LogValue::Unset, |address| LogValue::Count(i64::from(address))),
            self.quantity.map_or(LogValue::Unset, LogValue::Count),
            list(self.request_values),
            list(self.response_values),
            LogValue::Unset,
            self.matched.map_or(LogValue::Unset, LogValue::Yes),
            text(request_code),
            text(response_code),
            text(request_data),
            text(response_data),
            text(self.exception.map(exception_name)),
            text(self.mei_type),
        ]
    }
}

/// The padding bits of a response with bits: those after the requested quantity in its last byte, which icsnpp lists
/// separately.
fn padding(batch: &Batch, t: &Transaction) -> Option<String> {
    let Items::Bits(bytes, quantity) = read_data(batch, t)? else { return None };
    let bits: Vec<&str> =
        (quantity..bytes.len() * 8).map(|bit| if bytes[bit / 8] >> (bit % 8) & 1 == 1 { "1" } else { "0" }).collect();
    (!bits.is_empty()).then(|| bits.join(","))
}

/// The name of a diagnostics sub-function in the specification, which icsnpp uses as well.
fn diagnostic_name(code: u16) -> String {
    static NAMES: OnceLock<Vec<(u64, String)>> = OnceLock::new();
    let names = NAMES.get_or_init(|| {
        let file: serde_json::Value = toml::from_str(VOCABULARY).expect("the embedded vocabulary is tested");
        let rows = file["diagnostic"].as_array().cloned().unwrap_or_default();
        rows.iter().filter_map(|row| Some((row["sub_function"].as_u64()?, row["name"].as_str()?.to_owned()))).collect()
    });
    let found = names.iter().find(|(known, _)| *known == u64::from(code));
    found.map_or_else(|| format!("unknown-{code}"), |(_, name)| name.clone())
}

/// The name of a MEI type in icsnpp.
fn mei_name(code: u8) -> String {
    match code {
        CANOPEN => String::from("CANopen"),
        READ_DEVICE_IDENTIFICATION => String::from("Read Device Identification"),
        _ => format!("invalid encapsulated interface transport mei-(0x{code:02x})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sub_functions_have_the_names_that_icsnpp_uses() {
        assert_eq!(diagnostic_name(2), "Return Diagnostic Register");
        assert_eq!(diagnostic_name(0x14), "Clear Overrun Counter and Flag");
        assert_eq!(diagnostic_name(5), "unknown-5");
    }
}
