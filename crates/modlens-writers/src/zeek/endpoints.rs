//! The fields with which every line of Zeek's logs begins: time, connection with its ends, transaction identifier, unit.

use std::net::SocketAddr;

use modlens_engine::records::{Batch, Bus, Network, Transaction};
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

use super::value::LogValue;

/// Ports where there are none: of a serial line's master, and of its units.
const MASTER_PORT: u16 = 50_000;
const SERVER_PORT: u16 = 502;

/// The letters and digits of Zeek's uids.
const UID_LETTERS: &[u8; 62] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";

/// The length of a uid after its first letter.
const UID_LENGTH: usize = 16;

/// The parameters of FNV-1a with 64 bits (draft-eastlake-fnv).
const FNV_OFFSET: u64 = 0xCBF2_9CE4_8422_2325;
const FNV_PRIME: u64 = 0x0100_0000_01B3;

/// The eight fields with which every log begins.
pub(super) fn identity(batch: &Batch, t: &Transaction, start: Option<Ns>) -> Vec<LogValue> {
    let bus = &batch.buses[t.bus as usize];
    let tid = t.mbap_id.map_or(t.number as i64 & 0xFFFF, i64::from);
    let mut values = vec![start.filter(|_| bus.clock != Clock::None).map_or(LogValue::Unset, LogValue::Time)];
    values.extend(bus.network.as_ref().map_or_else(|| of_line(t), |network| of_connection(bus, network)));
    values.extend([LogValue::Count(tid), LogValue::Count(i64::from(t.unit))]);
    values
}

/// Uid and ends of a serial line, which are invented.
fn of_line(t: &Transaction) -> [LogValue; 5] {
    [
        LogValue::Text(format!("CMBUS{}", t.bus)),
        LogValue::Text(format!("10.{}.255.254", t.bus as u8)),
        LogValue::Count(i64::from(MASTER_PORT)),
        LogValue::Text(format!("10.{}.0.{}", t.bus as u8, t.unit)),
        LogValue::Count(i64::from(SERVER_PORT)),
    ]
}

/// Uid and ends of a TCP connection. Rows that are read back do not have the port of the client, which is unset then.
fn of_connection(bus: &Bus, network: &Network) -> [LogValue; 5] {
    let server = network.server.parse::<SocketAddr>().ok();
    [
        LogValue::Text(uid(bus, network)),
        LogValue::Text(network.client.clone()),
        network.client_port.map_or(LogValue::Unset, |port| LogValue::Count(i64::from(port))),
        LogValue::Text(server.map_or_else(|| network.server.clone(), |server| server.ip().to_string())),
        LogValue::Count(i64::from(server.map_or(SERVER_PORT, |server| server.port()))),
    ]
}

/// A uid as Zeek's: `C` and letters and digits, which are the same each time that the same file is read.
fn uid(bus: &Bus, network: &Network) -> String {
    let port = network.client_port.unwrap_or(0);
    let named = format!("{}|{}|{port}|{}|{}", bus.source, network.client, network.server, network.connection);
    let hash = |start: u64| named.bytes().fold(start, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(FNV_PRIME));
    let mut rest = u128::from(hash(FNV_OFFSET)) << 64 | u128::from(hash(!FNV_OFFSET));
    let mut text = String::from("C");
    for _ in 0..UID_LENGTH {
        text.push(char::from(UID_LETTERS[(rest % 62) as usize]));
        rest /= 62;
    }
    text
}
