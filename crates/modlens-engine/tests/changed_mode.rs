//! The framing of a line that is detected: what is in front must not decide for the rest.

mod wire;

use modlens_engine::records::Batch;
use modlens_engine::session::BusOptions;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::source::Clock;
use modlens_readers::chunk::Chunk;

use wire::{read_request, read_response, session};

/// Exchanges of RTU.
const EXCHANGES: u16 = 300;

/// The rows of these bytes and of some RTU after them, fed `piece` bytes at a time, where the framing has to be found.
fn detected(front: &[u8], piece: usize) -> Batch {
    let (mut session, _) = session(false, Clock::None);
    let bus = session.add_bus(BusOptions::named("detected"));
    let mut bytes = front.to_vec();
    for value in 0..EXCHANGES {
        bytes.extend(read_request(1 + (value % 3) as u8, 100 + value % 7, 2));
        bytes.extend(read_response(1 + (value % 3) as u8, &[value, 0x1234]));
    }
    bytes.chunks(piece).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    session.flush();
    session.take()
}

/// Three ASCII requests with right LRCs: 01 03 00 0n 00 02 sums to 06 + n.
const ASCII: &[u8] = b":010300000002FA\r\n:010300010002F9\r\n:010300020002F8\r\n";

/// Five requests with an MBAP header (messaging on TCP/IP, 3.1.3).
fn mbap() -> Vec<u8> {
    (1..=5u8).flat_map(|id| [0, id, 0, 0, 0, 6, 1, 3, 0, id, 0, 2]).collect()
}

/// The rows of these bytes on a line whose framing has to be found, with or without line settings.
fn framed(bytes: &[u8], has_settings: bool, piece: usize) -> Batch {
    let (mut session, _) = session(false, Clock::None);
    let mut options = BusOptions::named("detected");
    options.line = has_settings.then(|| "19200-8E1".parse().unwrap());
    let bus = session.add_bus(options);
    bytes.chunks(piece).for_each(|bytes| session.feed(bus, &Chunk { bytes, ..Chunk::default() }));
    session.flush();
    session.take()
}

/// How many good frames there are of each mode: RTU, ASCII, TCP.
fn good_by_mode(batch: &Batch) -> [usize; 3] {
    [Mode::Rtu, Mode::Ascii, Mode::Tcp].map(|mode| {
        let of_mode = |frame: &&modlens_engine::records::Frame| frame.mode == mode && frame.verdict == Verdict::Ok;
        batch.frames.iter().filter(of_mode).count()
    })
}

#[test]
fn rtu_is_given_up_where_another_framing_follows() {
    let rtu: Vec<u8> = (0..10).flat_map(|at| [read_request(5, at, 1), read_response(5, &[at])].concat()).collect();
    for piece in [7, 100_000] {
        let ascii = [&rtu[..], &ASCII.repeat(100)].concat();
        let good = good_by_mode(&framed(&ascii, true, piece));
        assert!(good[0] >= 20 && good[1] >= 298, "{good:?}");
        let tcp = [&rtu[..], &mbap().repeat(60)].concat();
        let good = good_by_mode(&framed(&tcp, false, piece));
        assert!(good[0] >= 20 && good[2] >= 298, "{good:?}");
    }
}

#[test]
fn line_settings_rule_tcp_out() {
    // Truncated requests of a serial line: at the wrong place they look like MBAP headers (messaging on TCP/IP, 3.1.3).
    let truncated: Vec<u8> = (0..200u8).flat_map(|id| [0, id, 0, 0, 0, 6, 1, 3, 0, id, 0, 2]).collect();
    assert_eq!(good_by_mode(&framed(&truncated, true, 64))[2], 0);
    assert_eq!(good_by_mode(&framed(&truncated, false, 64))[2], 200);
}

#[test]
fn another_framing_in_front_does_not_hide_rtu() {
    for front in [ASCII.to_vec(), mbap()] {
        for piece in [7, 64, 100_000] {
            let batch = detected(&front, piece);
            let good = batch.frames.iter().filter(|frame| frame.mode == Mode::Rtu && frame.verdict == Verdict::Ok).count();
            assert!(good >= 2 * usize::from(EXCHANGES) - 2, "{front:02x?} {piece}: {good}");
        }
    }
}
