//! ASCII and MBAP streams with damage, after which the framer has to resynchronise.

use modlens_engine::records::Batch;
use modlens_engine::session::{BusOptions, Session};
use modlens_protocol::checksum::{crc16, lrc};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::hex::parse_hex;
use modlens_readers::chunk::{Chunk, Times};

fn decoded(mode: Option<Mode>, bytes: &[u8]) -> Batch {
    let mut session = Session::default();
    let mut options = BusOptions::named("bus");
    options.mode = mode;
    let bus = session.add_bus(options);
    for piece in bytes.chunks(5) {
        session.feed(bus, &Chunk { bytes: piece, ..Chunk::default() });
    }
    session.flush();
    session.take()
}

/// The good frames; asserts that all frames together are the input.
fn good(batch: &Batch, bytes: &[u8]) -> Vec<Vec<u8>> {
    let joined: Vec<u8> = batch.frames.iter().flat_map(|frame| frame.wire.of(&batch.arena).to_vec()).collect();
    assert_eq!(joined, bytes, "frames tile the stream");
    let good = batch.frames.iter().filter(|frame| frame.verdict == Verdict::Ok);
    good.map(|frame| frame.wire.of(&batch.arena).to_vec()).collect()
}

fn ascii(body: &str) -> Vec<u8> {
    let mut adu = parse_hex(body).unwrap();
    adu.push(lrc(&adu));
    let text = adu.iter().fold(String::new(), |text, byte| text + &format!("{byte:02X}"));
    format!(":{text}\r\n").into_bytes()
}

fn mbap(id: u16, body: &str) -> Vec<u8> {
    let adu = parse_hex(body).unwrap();
    let mut frame = id.to_be_bytes().to_vec();
    frame.extend([0, 0]);
    frame.extend((adu.len() as u16).to_be_bytes());
    frame.extend(adu);
    frame
}

fn rtu(body: &str) -> Vec<u8> {
    let mut frame = parse_hex(body).unwrap();
    frame.extend(crc16(&frame).to_le_bytes());
    frame
}

const REQUEST: &str = "01 03 000A 0001";
const RESPONSE: &str = "01 03 02 1234";

#[test]
fn ascii_resynchronises_behind_every_kind_of_damage() {
    let (request, response) = (ascii(REQUEST), ascii(RESPONSE));
    let no_colon = request[1..].to_vec();
    let no_end = request[..request.len() - 2].to_vec();
    let mut wrong_colon = request.clone();
    wrong_colon[0] = b';';
    let mut high_bits = request.clone();
    for byte in &mut high_bits {
        *byte |= 0x80;
    }
    let mut wrong_digit = request.clone();
    wrong_digit[4] = b'G';
    let noise = vec![0xFF, 0x00, 0x3A, 0x80, 0x13];
    for damage in [no_colon, no_end, wrong_colon, high_bits, wrong_digit, noise, b":".to_vec(), b"::::".to_vec()] {
        let bytes = [&request[..], &response, &damage, &request, &response].concat();
        let found = good(&decoded(Some(Mode::Ascii), &bytes), &bytes);
        assert!(found.ends_with(&[request.clone(), response.clone()]), "{damage:02x?}: {found:02x?}");
        assert!(found.len() >= 4, "{damage:02x?}");
    }
}

#[test]
fn lower_case_digits_and_another_delimiter_are_accepted() {
    let lower: Vec<u8> = ascii("01 03 02 ABCD").to_ascii_lowercase();
    // Sub-function 3 of diagnostics makes the line feed a hash (application protocol, 6.8.1).
    let change = ascii("01 08 0003 2300");
    let mut changed = ascii(RESPONSE);
    *changed.last_mut().unwrap() = b'#';
    let bytes = [&ascii(REQUEST)[..], &lower, &change, &change, &changed, &ascii(REQUEST)].concat();
    let found = good(&decoded(Some(Mode::Ascii), &bytes), &bytes);
    assert_eq!(found, [ascii(REQUEST), lower, change.clone(), change, changed, ascii(REQUEST)]);
}

#[test]
fn ascii_characters_may_come_a_second_apart() {
    let mut session = Session::default();
    let mut options = BusOptions::named("bus");
    options.mode = Some(Mode::Ascii);
    let bus = session.add_bus(options);
    for (i, byte) in ascii(REQUEST).iter().enumerate() {
        let time = 1_700_000_000_000_000_000 + i as i64 * 900_000_000;
        session.feed(bus, &Chunk { bytes: &[*byte], times: Times::Read(time), ..Chunk::default() });
    }
    session.flush();
    let batch = session.take();
    assert_eq!(batch.frames.iter().map(|frame| frame.verdict).collect::<Vec<_>>(), [Verdict::Ok]);
}

#[test]
fn rtu_data_that_holds_colons_stays_rtu() {
    let request = rtu(REQUEST);
    let response = rtu("01 03 02 3A3A");
    let bytes = [request.clone(), response.clone(), request.clone(), response.clone()].concat();
    assert_eq!(good(&decoded(None, &bytes), &bytes), [request.clone(), response.clone(), request, response]);
}

#[test]
fn a_wrong_mbap_length_costs_no_later_frame() {
    let frames: Vec<Vec<u8>> = (0..6).flat_map(|id| [mbap(id, REQUEST), mbap(id, RESPONSE)]).collect();
    for victim in [2, 3, 4, 5] {
        for lie in [0u8, 1, 2, 4, 9, 30, 254, 255] {
            if lie == frames[victim][5] {
                continue;
            }
            let mut damaged = frames.clone();
            damaged[victim][5] = lie;
            let bytes = damaged.concat();
            let found = good(&decoded(Some(Mode::Tcp), &bytes), &bytes);
            let rest = &frames[victim + 1..];
            assert!(found.ends_with(rest), "frame {victim} says {lie}: {} of {} after it", found.len(), rest.len());
        }
    }
}

#[test]
fn a_wrong_mbap_length_hides_no_end_of_the_longest_frame() {
    // Header (100 bytes) and byte count (10) both lie about a frame of 260 bytes, the most that there is (3.1.3).
    let mut frame = [&[0, 1, 0, 0, 0, 94, 17, 3, 10][..], &[0xFF; 251]].concat();
    frame.extend(mbap(0x1234, REQUEST));
    let batch = decoded(Some(Mode::Tcp), &frame);
    assert_eq!(batch.frames[0].wire.length, 260);
    assert_eq!(good(&batch, &frame), [mbap(0x1234, REQUEST)]);
}

#[test]
fn mbap_resynchronises_behind_noise_and_lost_bytes() {
    let frames: Vec<Vec<u8>> = (0..4).flat_map(|id| [mbap(id, REQUEST), mbap(id, RESPONSE)]).collect();
    for damage in [vec![0xFF], vec![0; 3], vec![0; 7], frames[2][3..].to_vec(), frames[3][..8].to_vec()] {
        let bytes = [&frames[..2].concat()[..], &damage, &frames[4..].concat()].concat();
        let found = good(&decoded(Some(Mode::Tcp), &bytes), &bytes);
        assert!(found.ends_with(&frames[4..]), "{damage:02x?}: {}", found.len());
    }
}

#[test]
fn rtu_over_tcp_is_rtu() {
    let frames: Vec<Vec<u8>> = (0..3).flat_map(|_| [rtu(REQUEST), rtu(RESPONSE)]).collect();
    let batch = decoded(None, &frames.concat());
    assert!(batch.frames.iter().all(|frame| frame.mode == Mode::Rtu && frame.verdict == Verdict::Ok));
    assert_eq!(batch.frames.len(), 6);
}

#[test]
fn an_mbap_frame_with_a_wrong_length_is_not_taken_for_rtu() {
    // One PDU, pasted, whose header says five bytes where six follow; and one that says seven.
    for lie in [5u8, 7, 20] {
        let mut frame = mbap(1, REQUEST);
        frame[5] = lie;
        let batch = decoded(None, &frame);
        assert!(batch.frames.iter().all(|row| row.mode == Mode::Tcp), "{lie}");
        assert!(batch.frames.iter().all(|row| row.direction != Direction::Response), "{lie}");
    }
}
