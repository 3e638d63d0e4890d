//! What holds for any bytes: frames tile the input, chunk sizes change nothing, nothing panics.

use std::collections::VecDeque;
use std::sync::Arc;

use modlens_engine::records::{Batch, Frame, FrameRef, Span, Transaction};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::checksum::{crc16, lrc};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::source::Clock;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::text::{Dialects, Reader};
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
            f.delimited_by,
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

/// The same, in blocks of these lengths, again and again, on a line without settings, which may as well be a connection.
fn untimed_cut(data: &[u8], cuts: &[usize]) -> Batch {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions::named("bus"));
    let mut rest = data;
    for &cut in cuts.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (bytes, behind) = rest.split_at(cut.min(rest.len()));
        session.feed(bus, &Chunk { bytes, ..Chunk::default() });
        rest = behind;
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
    // The CRC over a frame and its own right CRC is 0: a bad checksum is never the one expected.
    let is_bad = |frame: &&Frame| frame.mode == Mode::Rtu && frame.verdict == Verdict::BadChecksum;
    for frame in batch.frames.iter().filter(is_bad) {
        assert_ne!(crc16(frame.wire.of(&batch.arena)), 0, "a valid checksum is called bad");
    }
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
        format!(":{}\r\n", modlens_protocol::hex::hex(&adu).to_uppercase()).into_bytes()
    });
    let noise = proptest::collection::vec(byte, 0..40);
    proptest::collection::vec(prop_oneof![3 => poll, 2 => frame, 1 => ascii, 1 => noise], 0..12).prop_map(|parts| parts.concat())
}

/// Some exchanges in one framing, whole or cut short, or bytes in none; and the microseconds of pause before them.
fn changing_framing() -> impl Strategy<Value = Read> {
    let poll = (1u8..4, prop_oneof![Just(3u8), Just(6), Just(16)], 0u16..300, 1u8..6, any::<u8>());
    let polls = proptest::collection::vec(poll, 1..8);
    let noise = proptest::collection::vec(prop_oneof![Just(0u8), Just(b':'), Just(b'\r'), Just(b'0'), any::<u8>()], 0..60);
    let cut = prop_oneof![3 => Just(usize::MAX), 1 => 1usize..80];
    let pause = prop_oneof![2 => Just(0u32), 1 => 500u32..400_000, 1 => Just(1_200_000u32)];
    (polls, 0u8..4, noise, cut, pause).prop_map(|(polls, framing, noise, cut, pause)| {
        let frames = polls.iter().enumerate().flat_map(|(id, &(unit, code, address, quantity, value))| {
            let (request, response) = exchange(unit, code, address, quantity, value);
            [request, response].map(|frame| match framing {
                0 => frame,
                1 => in_ascii(&[(frame, 0)]).remove(0).0,
                2 => in_mbap(id as u8, &frame),
                _ => Vec::new(),
            })
        });
        let mut bytes = frames.collect::<Vec<_>>().concat();
        bytes.truncate(cut);
        bytes.extend(if framing == 3 { noise } else { Vec::new() });
        (bytes, pause)
    })
}

/// A frame after an MBAP header (messaging on TCP/IP, 3.1.3).
fn in_mbap(id: u8, frame: &[u8]) -> Vec<u8> {
    let adu = &frame[..frame.len() - 2];
    [&[0, id, 0, 0, 0, adu.len() as u8], adu].concat()
}

/// All rows of these bytes, given `piece` bytes at a time: frames, transactions and findings with their bytes, and the
/// statistics.
fn all_rows(data: &[u8], mode: Mode, piece: usize) -> Vec<String> {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions { mode: Some(mode), ..BusOptions::named("bus") });
    data.chunks(piece).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    rows_and_statistics(session)
}

/// The transactions of these bytes, the findings and the statistics, if nobody wants frames.
fn rows_without_frames(data: &[u8], piece: usize) -> Vec<String> {
    let wanted = WantedTables { frames: false, transactions: true, findings: true };
    let mut session = Session::new(Arc::default(), wanted, false, None);
    let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("bus") });
    data.chunks(piece).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    rows_and_statistics(session)
}

/// All rows of a log with one record a line, given `lines` lines at a time.
fn all_rows_of_log(log: &[String], mode: Mode, lines: usize) -> Vec<String> {
    rows_of_log(Session::default(), log, mode, lines)
}

/// The same without frames.
fn rows_of_log_without_frames(log: &[String], mode: Mode, lines: usize) -> Vec<String> {
    let wanted = WantedTables { frames: false, transactions: true, findings: true };
    rows_of_log(Session::new(Arc::default(), wanted, false, None), log, mode, lines)
}

/// The same with frames, beside compact transactions.
fn rows_of_log_beside_frames(log: &[String], mode: Mode, lines: usize) -> Vec<String> {
    let mut session = Session::default();
    session.emit_compact();
    rows_of_log(session, log, mode, lines)
}

fn rows_of_log(mut session: Session, log: &[String], mode: Mode, lines: usize) -> Vec<String> {
    let bus = session.add_bus(BusOptions { mode: Some(mode), ..BusOptions::named("bus") });
    let dialect = if mode == Mode::Ascii { "ascii-lines" } else { "hex" };
    let rows = Dialects::embedded().named(dialect).unwrap();
    session.open_text(bus, Reader::new(rows, None, Arc::default()), b"");
    log.chunks(lines).for_each(|lines| session.feed_text(bus, lines.concat().as_bytes(), false));
    session.feed_text(bus, b"", true);
    rows_and_statistics(session)
}

/// The same with a reader that is lent for all lines but the first ones, and so many blocks ahead of the session.
fn all_rows_read_ahead(log: &[String], mode: Mode, lines: usize, ahead: usize) -> Vec<String> {
    let mut session = Session::default();
    let bus = session.add_bus(BusOptions { mode: Some(mode), ..BusOptions::named("bus") });
    let dialect = if mode == Mode::Ascii { "ascii-lines" } else { "hex" };
    let rows = Dialects::embedded().named(dialect).unwrap();
    session.open_text(bus, Reader::new(rows, None, Arc::default()), b"");
    let mut blocks = log.chunks(lines).map(<[String]>::concat);
    session.feed_text(bus, blocks.next().unwrap_or_default().as_bytes(), false);
    let mut reader = session.lend_reader(bus);
    let mut waiting = VecDeque::new();
    for block in blocks {
        waiting.push_back(reader.read(block.as_bytes()));
        if waiting.len() > ahead {
            session.feed_read(&waiting.pop_front().unwrap());
        }
    }
    for block in &waiting {
        session.feed_read(block);
    }
    session.take_back(reader);
    session.feed_text(bus, b"", true);
    rows_and_statistics(session)
}

/// All rows of a session and its statistics as text, without what only names places in the batch.
fn rows_and_statistics(mut session: Session) -> Vec<String> {
    session.flush();
    let batch = session.take();
    let (bytes, codes) = (|span: Span| span.of(&batch.arena), |span: Span| span.of(&batch.codes));
    let place = Span::default();
    let frames = batch.frames.iter().map(|row| {
        format!("{:?} {:?} {:?}", bytes(row.wire), codes(row.findings), Frame { wire: place, findings: place, ..row.clone() })
    });
    let transactions = batch.all_transactions().iter().map(|row| {
        let half = |half: FrameRef| format!("{:?} {:?}", bytes(half.wire), bytes(half.pdu));
        let bare = |half: FrameRef| FrameRef { wire: place, pdu: place, ..half };
        let (request, response) = (bare(row.request), bare(row.response));
        let plain = Transaction { request, response, findings: place, ..row.clone() };
        format!("{} {} {plain:?}", half(row.request), half(row.response))
    });
    let findings = batch.all_transactions().iter().map(|row| format!("{:?}", codes(row.findings)));
    let rows = batch.findings.iter().map(|row| format!("{row:?}"));
    frames.chain(transactions).chain(findings).chain(rows).chain([session.stats_json().to_string()]).collect()
}

fn framed(body: &[u8]) -> Vec<u8> {
    [body, &crc16(body).to_le_bytes()].concat()
}

/// A plain read or write request, or both in one, and its response.
fn exchange(unit: u8, code: u8, address: u16, quantity: u8, value: u8) -> (Vec<u8>, Vec<u8>) {
    let [high, low] = address.to_be_bytes();
    let head = [unit, code, high, low, 0, quantity];
    let count = if matches!(code, 1 | 2 | 15) { quantity.div_ceil(8) } else { 2 * quantity };
    // Most devices leave the bits after the last one asked for at zero.
    let data = (0..count).map(|at| if code < 3 && at + 1 == count { value & 1 } else { value ^ at });
    let (request, response) = match code {
        1..=4 => (head.to_vec(), [unit, code, count].into_iter().chain(data).collect()),
        5 => ([unit, 5, high, low, if value > 99 { 0xFF } else { 0 }, value / 200].to_vec(), Vec::new()),
        6 => ([unit, 6, high, low, value, quantity].to_vec(), Vec::new()),
        23 => {
            let written = [0, value, 0, 2, 4, value, 0, low, quantity];
            (head.into_iter().chain(written).collect(), [unit, code, count].into_iter().chain(data).collect())
        }
        _ => (head.into_iter().chain([count]).chain(data).collect(), head.to_vec()),
    };
    (framed(&request), framed(if response.is_empty() { &request } else { &response }))
}

/// A poll cycle in which one exchange in five is disturbed: the bytes that each side sends, and the milliseconds of pause
/// before them. On some lines the adapter echoes each request.
fn cycle() -> impl Strategy<Value = Vec<(Vec<u8>, u32)>> {
    let code = prop_oneof![4 => 1u8..5, 1 => prop_oneof![Just(5u8), Just(6), Just(15), Just(16), Just(23)]];
    // From 0x300 on a read has the length of a response, from 0xC00 on one with function 23; from 0xD00 on it is a byte shorter.
    let address = prop_oneof![8 => 0u16..4, 8 => 0x2FE..0x301u16, 1 => 0xBFF..0xC01u16, 1 => 0xCFF..0xD01u16];
    let poll = (1u8..4, code, address, 1u8..20);
    let accident = (0u8..60, any::<u8>(), any::<u16>());
    let (polls, turns) = (proptest::collection::vec(poll, 1..5), proptest::collection::vec(accident, 4..60));
    (polls, turns, proptest::bool::weighted(0.2)).prop_map(|(polls, turns, echo)| {
        let mut bursts = Vec::new();
        for (turn, (accident, value, place)) in turns.into_iter().enumerate() {
            let pauses = if accident == 12 { (2_000, 900) } else { (10 + u32::from(value) % 7, 3 + u32::from(place) % 20) };
            let (unit, code, address, quantity) = polls[turn % polls.len()];
            let (request, mut response) = exchange(unit, code, address, quantity, value);
            bursts.push((request.clone(), pauses.0));
            if echo {
                bursts.push((request.clone(), 1));
            }
            match accident {
                0 => continue,
                1 => bursts.push((request, 400)),
                2 | 13..16 => response = framed(&[unit, code | 0x80, value % 13]),
                3 => *response.last_mut().unwrap() ^= 1,
                4 => response.insert(0, value),
                5 => response.push(value),
                6 => response = response.repeat(2),
                7 => response.truncate(usize::from(place) % response.len()),
                8 => response = framed(&[unit, code, 1, value]),
                9 => response.extend(framed(&[0, 6, 0, 1, 0, value])),
                10 => response.extend(framed(&[unit, 6, 0, 1, 0, value]).repeat(2)),
                11 => response[0] ^= 3,
                _ => {}
            }
            bursts.push((response, pauses.1));
        }
        bursts
    })
}

/// Exchanges of a few units of which half of the frames are cut short, mostly to less than the shortest frame, with the
/// milliseconds of pause before each burst.
fn torn_exchanges() -> impl Strategy<Value = Vec<Read>> {
    let code = prop_oneof![3 => Just(3u8), 1 => 1u8..7, 1 => Just(15), 1 => Just(16)];
    let poll = (0u8..4, code, prop_oneof![Just(0u16), 0u16..300], 0u8..4, prop_oneof![Just(0u8), any::<u8>()]);
    let length = prop_oneof![4 => Just(usize::MAX), 3 => 0usize..5, 1 => 5usize..9];
    let pause = prop_oneof![3 => Just(0u32), 1 => 500u32..4000, 1 => 20_000u32..400_000];
    let turn = (poll, proptest::bool::weighted(0.15), (length.clone(), length), (pause.clone(), pause));
    proptest::collection::vec(turn, 1..12).prop_map(|turns| {
        let bursts = turns.into_iter().flat_map(|((unit, code, address, quantity, value), is_refused, cut, pauses)| {
            let (mut request, response) = exchange(unit, code, address, quantity, value);
            let mut response = if is_refused { framed(&[unit, code | 0x80, value % 12]) } else { response };
            request.truncate(cut.0);
            response.truncate(cut.1);
            [(request, pauses.0), (response, pauses.1)]
        });
        bursts.collect()
    })
}

/// The same bursts in ASCII framing; bytes that are no frame stay as they are.
fn in_ascii(bursts: &[(Vec<u8>, u32)]) -> Vec<(Vec<u8>, u32)> {
    let frame = |bytes: &[u8]| {
        let content = bytes.split_last_chunk::<2>().filter(|(content, sum)| crc16(content).to_le_bytes() == **sum)?.0;
        let mut adu = content.to_vec();
        adu.push(lrc(&adu));
        let text = modlens_protocol::hex::hex(&adu);
        Some(format!(":{}\r\n", if adu.last() == Some(&7) { text } else { text.to_uppercase() }).into_bytes())
    };
    bursts.iter().map(|(bytes, pause)| (frame(bytes).unwrap_or_else(|| bytes.clone()), *pause)).collect()
}

fn bytes_of(bursts: &[(Vec<u8>, u32)]) -> Vec<u8> {
    bursts.iter().flat_map(|(bytes, _)| bytes).copied().collect()
}

/// A log of them, a line each.
fn log_of(bursts: &[(Vec<u8>, u32)], stamped: bool) -> Vec<String> {
    let mut ms = 0;
    let lines = bursts.iter().map(|(bytes, pause)| {
        ms += pause;
        let stamp = format!("2026-11-21 12:{:02}:{:02}.{:03} ", ms / 60_000, ms / 1000 % 60, ms % 1000);
        let side = if matches!(bytes.len(), 8 | 17) { "Tx" } else { "Rx" };
        let hex = || bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<String>>().join(" ");
        let shown = if bytes.starts_with(b":") { String::from_utf8_lossy(bytes).trim_end().to_owned() } else { hex() };
        format!("{}{side}: {shown}\n", if stamped { &stamp } else { "" })
    });
    lines.collect()
}

fn mode() -> impl Strategy<Value = Option<Mode>> {
    prop_oneof![Just(None), Just(Some(Mode::Rtu)), Just(Some(Mode::Ascii)), Just(Some(Mode::Tcp))]
}

// A silence that closes the input is none after the frames in front of others.
#[test]
fn what_ends_a_frame_does_not_depend_on_how_much_comes_with_it() {
    let exchange = [1, 3, 0, 0, 0, 1, 0x84, 0x0A, 1, 3, 2, 0, 1, 0x79, 0x84];
    let text = b":0100FF\r\n";
    let first = [&text[..], &[1, 0x15, 0xC1, 0xEF], &exchange, &exchange].concat();
    let reads = [(first, 0), (text.to_vec(), 90_000)];
    let whole = timed(&reads, None, usize::MAX);
    for piece in [1, 7, 64] {
        assert_eq!(shown(&timed(&reads, None, piece)), shown(&whole));
    }
}

// After text among its frames the line is RTU again, where a shorter silence ends a frame: here the response that breaks off.
#[test]
fn what_ends_a_frame_is_known_as_soon_as_the_framing_changes_back() {
    let exchange = [1, 3, 0, 0, 0, 1, 0x84, 0x0A, 1, 3, 2, 0, 1, 0x79, 0x84];
    let text = [&[1, 3, 0, 0, 0xFF, 0, 4, 0x3A][..], b":010000000000FF\r\n"].concat();
    let torn = [&[1, 0x2B, 0, 0x3E, 0xF0, 2, 3, 0xFF, 0, 0, 0xFF, 0x35, 0xAD][..], &[1, 0x83, 0, 0, 0xF0, 0x30]].concat();
    let reads = [(exchange.repeat(2), 0), (text, 0), (torn, 0), ([&exchange[..], b":0100FF\r\n"].concat(), 90_000)];
    let whole = timed(&reads, None, usize::MAX);
    for piece in [1, 7, 64] {
        assert_eq!(shown(&timed(&reads, None, piece)), shown(&whole));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: ProptestConfig::default().cases.max(400), ..ProptestConfig::default() })]

    #[test]
    fn untimed_bytes_tile_and_chunk_sizes_change_nothing(data in traffic(), mode in mode()) {
        let whole = untimed(&data, mode, usize::MAX);
        assert_tiles(&whole, &data);
        for piece in [1, 7, 64] {
            prop_assert_eq!(shown(&untimed(&data, mode, piece)), shown(&whole));
        }
    }

    // The oracle of the fast path. A request and its response that come in one block may take the fast path; if they come
    // byte by byte, each frame takes the slow path.
    #[test]
    fn the_fast_path_gives_the_rows_of_the_slow_path(bursts in cycle(), piece in 2usize..70) {
        for (mode, bursts) in [(Mode::Rtu, bursts.clone()), (Mode::Ascii, in_ascii(&bursts))] {
            let data = bytes_of(&bursts);
            let slow = all_rows(&data, mode, 1);
            prop_assert_eq!(&all_rows(&data, mode, usize::MAX), &slow);
            prop_assert_eq!(&all_rows(&data, mode, piece), &slow);
        }
    }

    // Without frames, exchanges are emitted compact, and their rows are made when somebody reads them.
    #[test]
    fn compact_exchanges_give_the_rows_of_full_ones(bursts in cycle(), piece in 2usize..70) {
        let data = bytes_of(&bursts);
        let in_full: Vec<String> = all_rows(&data, Mode::Rtu, 1).into_iter().filter(|row| !row.contains(" Frame {")).collect();
        for piece in [usize::MAX, piece, 1] {
            prop_assert_eq!(&rows_without_frames(&data, piece), &in_full);
        }
    }

    #[test]
    fn the_fast_path_gives_the_rows_of_the_slow_path_for_logs(bursts in cycle(), lines in 2usize..9, stamped in any::<bool>()) {
        for (mode, bursts) in [(Mode::Rtu, bursts.clone()), (Mode::Ascii, in_ascii(&bursts))] {
            let log = log_of(&bursts, stamped);
            let slow = all_rows_of_log(&log, mode, 1);
            prop_assert_eq!(&all_rows_of_log(&log, mode, usize::MAX), &slow);
            prop_assert_eq!(&all_rows_of_log(&log, mode, lines), &slow);
            prop_assert_eq!(&all_rows_read_ahead(&log, mode, lines, 3), &slow);
            prop_assert_eq!(&rows_of_log_beside_frames(&log, mode, usize::MAX), &slow);
            prop_assert_eq!(&rows_of_log_beside_frames(&log, mode, lines), &slow);
            let without_frames: Vec<String> = slow.into_iter().filter(|row| !row.contains(" Frame {")).collect();
            for lines in [1, lines, usize::MAX] {
                prop_assert_eq!(&rows_of_log_without_frames(&log, mode, lines), &without_frames);
            }
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
    fn torn_exchanges_tile_and_chunk_sizes_change_nothing(reads in torn_exchanges(), mode in mode()) {
        let data: Vec<u8> = reads.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let (whole, untimed_whole) = (timed(&reads, mode, usize::MAX), untimed(&data, mode, usize::MAX));
        assert_tiles(&whole, &data);
        assert_tiles(&untimed_whole, &data);
        for piece in [1, 3] {
            prop_assert_eq!(shown(&timed(&reads, mode, piece)), shown(&whole));
            prop_assert_eq!(shown(&untimed(&data, mode, piece)), shown(&untimed_whole));
        }
    }

    // What a line carries may change: rows of one framing, and after them rows of another.
    #[test]
    fn where_a_read_is_cut_changes_nothing_on_lines_that_change_their_framing(
        parts in proptest::collection::vec(changing_framing(), 1..6),
        cuts in proptest::collection::vec(1usize..40, 1..8),
    ) {
        let data: Vec<u8> = parts.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let (whole, untimed_whole) = (timed(&parts, None, usize::MAX), untimed(&data, None, usize::MAX));
        assert_tiles(&whole, &data);
        assert_tiles(&untimed_whole, &data);
        prop_assert_eq!(shown(&untimed_cut(&data, &cuts)), shown(&untimed_cut(&data, &[usize::MAX])));
        for piece in [1, cuts[0]] {
            prop_assert_eq!(shown(&untimed(&data, None, piece)), shown(&untimed_whole));
            prop_assert_eq!(shown(&timed(&parts, None, piece)), shown(&whole));
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

// A damaged frame may be shorter than any frame is: here a response of three bytes, in front of which its request is looked for.
#[test]
fn a_damaged_response_shorter_than_a_frame_tells_what_it_can_of_its_request() {
    let reads = [
        &[3, 3, 0, 0, 0, 1, 133, 232, 3, 3, 2, 0, 1, 0, 68][..],
        &[1, 3, 0, 0, 0, 0, 69, 202],
        &[0, 3, 0, 0, 1, 3, 0, 0, 0, 1, 132, 10, 1, 3, 2, 0, 1, 121, 132],
    ];
    let data = reads.concat();
    let reads: Vec<Read> = reads.iter().map(|bytes| (bytes.to_vec(), 0)).collect();
    assert_tiles(&timed(&reads, Some(Mode::Rtu), usize::MAX), &data);
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
