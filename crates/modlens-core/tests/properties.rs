//! What holds for any bytes: frames tile the input, chunk sizes change nothing, nothing panics.

use modlens_core::checksum::{crc16, lrc};
use modlens_core::chunk::{Chunk, Times};
use modlens_core::framer::Mode;
use modlens_core::records::{Batch, Clock};
use modlens_core::session::{BusOptions, Session};
use proptest::prelude::*;

/// One read: bytes and the pause before it in microseconds.
type Read = (Vec<u8>, u32);

fn options(mode: Option<Mode>) -> BusOptions {
    let mut options = BusOptions::named("bus");
    options.mode = mode;
    options.line = Some("19200-8E1".parse().unwrap());
    options.bus.clock = Clock::Utc;
    options
}

/// A row without what only names the batch: everything that a table would show.
fn shown(batch: &Batch) -> Vec<String> {
    let frames = batch.frames.iter().map(|f| {
        format!(
            "{} {} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
            f.number,
            f.offset,
            f.wire.of(&batch.arena),
            f.start,
            f.gap,
            f.direction,
            f.verdict,
            f.cut_by,
            f.confidence,
            f.txn,
            f.findings.of(&batch.codes)
        )
    });
    let transactions = batch.transactions.iter().map(|t| {
        format!(
            "{} {:?} {:?} {:?} {:?} {:?}",
            t.number,
            t.status,
            t.response_time,
            t.waited,
            t.retry_of,
            t.findings.of(&batch.codes)
        )
    });
    frames.chain(transactions).collect()
}

fn untimed(data: &[u8], mode: Option<Mode>, piece: usize) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(options(mode));
    for bytes in data.chunks(piece) {
        session.feed(bus, &Chunk { bytes, ..Chunk::default() });
    }
    session.flush();
    session.take()
}

/// The same bytes with the same byte times, each read given whole or byte by byte.
fn timed(reads: &[Read], mode: Option<Mode>, piece: usize) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(options(mode));
    let mut now = 1_700_000_000_000_000_000i64;
    for (bytes, pause) in reads {
        now += i64::from(*pause) * 1000;
        let times: Vec<i64> = bytes
            .iter()
            .map(|_| {
                now += 572_917;
                now
            })
            .collect();
        for (bytes, times) in bytes.chunks(piece).zip(times.chunks(piece)) {
            session.feed(bus, &Chunk { bytes, times: Times::Bytes(times), ..Chunk::default() });
        }
    }
    session.flush();
    session.take()
}

fn assert_tiles(batch: &Batch, data: &[u8]) {
    let mut joined = Vec::new();
    for frame in &batch.frames {
        assert_eq!(frame.offset, joined.len() as u64);
        joined.extend_from_slice(frame.wire.of(&batch.arena));
        assert!(frame.wire.length as usize <= 4096);
    }
    assert_eq!(joined, data);
}

/// Bytes of a bus: good frames, noise, damage, in any order.
fn traffic() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![Just(0u8), Just(0xFF), 0u8..8, any::<u8>()];
    let frame =
        (1u8..5, prop_oneof![Just(3u8), 1u8..25, Just(43), Just(65), Just(0x83)], proptest::collection::vec(byte.clone(), 0..12))
            .prop_map(|(unit, code, body)| {
                let mut frame = vec![unit, code];
                frame.extend(body);
                frame.extend(crc16(&frame).to_le_bytes());
                frame
            });
    let poll = (1u8..4, 0u16..200, 1u16..6).prop_map(|(unit, address, quantity)| {
        let mut request = vec![unit, 3];
        request.extend(address.to_be_bytes());
        request.extend(quantity.to_be_bytes());
        request.extend(crc16(&request).to_le_bytes());
        let mut response = vec![unit, 3, 2 * quantity as u8];
        response.extend((0..2 * quantity).map(|i| i as u8));
        response.extend(crc16(&response).to_le_bytes());
        request.extend(response);
        request
    });
    let ascii = (1u8..4, proptest::collection::vec(any::<u8>(), 1..8)).prop_map(|(unit, body)| {
        let mut adu = vec![unit];
        adu.extend(body);
        adu.push(lrc(&adu));
        format!(":{}\r\n", modlens_core::pdu::hex(&adu).to_uppercase()).into_bytes()
    });
    let noise = proptest::collection::vec(byte, 0..40);
    proptest::collection::vec(prop_oneof![3 => poll, 2 => frame, 1 => ascii, 1 => noise], 0..12).prop_map(|parts| parts.concat())
}

fn mode() -> impl Strategy<Value = Option<Mode>> {
    prop_oneof![Just(None), Just(Some(Mode::Rtu)), Just(Some(Mode::Ascii)), Just(Some(Mode::Tcp))]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn untimed_bytes_tile_and_chunk_sizes_change_nothing(data in traffic(), mode in mode()) {
        let whole = untimed(&data, mode, usize::MAX);
        assert_tiles(&whole, &data);
        for piece in [1, 7, 64] {
            prop_assert_eq!(shown(&untimed(&data, mode, piece)), shown(&whole));
        }
    }

    #[test]
    fn timed_bytes_tile_and_chunk_sizes_change_nothing(
        reads in proptest::collection::vec((traffic(), prop_oneof![Just(0u32), 500u32..4000, 20_000u32..400_000, Just(1_200_000u32)]), 0..6),
        mode in mode(),
    ) {
        let data: Vec<u8> = reads.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let whole = timed(&reads, mode, usize::MAX);
        assert_tiles(&whole, &data);
        for piece in [1, 7, 64] {
            prop_assert_eq!(shown(&timed(&reads, mode, piece)), shown(&whole));
        }
    }

    #[test]
    fn any_bytes_tile(data in proptest::collection::vec(any::<u8>(), 0..3000), mode in mode()) {
        assert_tiles(&untimed(&data, mode, 512), &data);
    }

    #[test]
    fn times_never_run_back(reads in proptest::collection::vec((traffic(), 0u32..50_000), 0..6)) {
        let batch = timed(&reads, Some(Mode::Rtu), usize::MAX);
        let starts: Vec<i64> = batch.frames.iter().filter_map(|frame| frame.start).collect();
        prop_assert!(starts.windows(2).all(|pair| pair[0] <= pair[1]));
    }
}

#[test]
fn long_noise_is_cut_into_rows_of_4096_bytes() {
    for byte in [0x00, 0xFF, 0x55] {
        let data = vec![byte; 100_000];
        for mode in [None, Some(Mode::Rtu), Some(Mode::Ascii), Some(Mode::Tcp)] {
            assert_tiles(&untimed(&data, mode, 1000), &data);
        }
    }
}
