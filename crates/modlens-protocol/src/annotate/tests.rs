use proptest::prelude::*;

use super::*;
use crate::framing::{Direction, Mode};
use crate::functions::Functions;
use crate::hex::parse_hex;

const DIRECTIONS: [Direction; 3] = [Direction::Request, Direction::Response, Direction::Unknown];

fn body(direction: Direction, request: Option<&[u8]>) -> Body<'_> {
    Body { functions: Functions::embedded(), direction, request }
}

fn wrapped(mode: Mode) -> Wrapping {
    Wrapping::Frame { mode, has_checksum: true }
}

/// The request of the application protocol's section 6.3 in each mode: 3 registers from 107 on.
#[test]
fn a_read_request_in_every_mode() {
    let names = |wrapping, frame: &[u8]| -> Vec<(usize, String, String)> {
        let pieces = annotate(frame, wrapping, body(Direction::Request, None));
        assert!(pieces.iter().all(|piece| piece.meaning.is_valid), "{pieces:?}");
        pieces.into_iter().map(|piece| (piece.offset, piece.name, piece.value)).collect()
    };
    let place = |offset: usize, name: &str, value: &str| (offset, name.to_owned(), value.to_owned());
    assert_eq!(
        names(wrapped(Mode::Rtu), &parse_hex("1103006B00037687").unwrap()),
        [
            place(0, "unit", "17"),
            place(1, "function", "3"),
            place(2, "address", "107"),
            place(4, "quantity", "3"),
            place(6, "checksum", "0x8776"),
        ]
    );
    assert_eq!(
        names(wrapped(Mode::Ascii), b":1103006B00037E\r\n"),
        [
            place(0, "start", ":"),
            place(1, "unit", "17"),
            place(3, "function", "3"),
            place(5, "address", "107"),
            place(9, "quantity", "3"),
            place(13, "checksum", "0x7E"),
            place(15, "end", "CR LF"),
        ]
    );
    assert_eq!(
        names(wrapped(Mode::Tcp), &parse_hex("0001000000061103006B0003").unwrap()),
        [
            place(0, "mbap_id", "1"),
            place(2, "protocol", "0"),
            place(4, "length", "6"),
            place(6, "unit", "17"),
            place(7, "function", "3"),
            place(8, "address", "107"),
            place(10, "quantity", "3"),
        ]
    );
}

#[test]
fn registers_of_a_response_get_their_numbers_from_the_request() {
    let request = parse_hex("03006B0002").unwrap();
    let response = parse_hex("0304022BFFFF").unwrap();
    let pieces = annotate(&response, Wrapping::None, body(Direction::Response, Some(&request)));
    assert_eq!(pieces[3].meaning.text, "400109: u16 65535, s16 -1, 0xFFFF");
}

#[test]
fn the_pdu_of_a_frame_is_without_what_is_around_it() {
    let pdu = parse_hex("03006B0003").unwrap();
    assert_eq!(pdu_of(&parse_hex("1103006B00037687").unwrap(), Mode::Rtu, true), Some(pdu.clone()));
    assert_eq!(pdu_of(b":1103006B00037E\r\n", Mode::Ascii, true), Some(pdu.clone()));
    assert_eq!(pdu_of(&parse_hex("0001000000061103006B0003").unwrap(), Mode::Tcp, true), Some(pdu));
    assert_eq!(pdu_of(b":11x", Mode::Ascii, true), None);
    assert_eq!(pdu_of(b"", Mode::Rtu, true), None);
    assert_eq!(pdu_of(b"\x11", Mode::Rtu, true), Some(Vec::new()));
}

/// A recording that prints no checksums has sound frames without one.
#[test]
fn a_sound_frame_without_its_checksum_is_unit_and_pdu() {
    let (bare, whole) = (parse_hex("1103006B0003").unwrap(), parse_hex("1103006B00037687").unwrap());
    assert!(!has_checksum(&bare, Mode::Rtu, true));
    assert!(has_checksum(&bare, Mode::Rtu, false));
    assert!(has_checksum(&whole, Mode::Rtu, true));
    assert_eq!(pdu_of(&bare, Mode::Rtu, false), parse_hex("03006B0003"));
    assert!(has_checksum(b":1103006B00037E\r\n", Mode::Ascii, true));
    assert!(!has_checksum(b":1103006B0003\r\n", Mode::Ascii, true));
}

/// The examples of all functions, vendors' too, have nothing wrong and nothing extra; each direction is found by layout.
#[test]
fn examples_of_the_table_are_valid() {
    for row in Functions::embedded().rows() {
        for (key, direction) in [("request", Direction::Request), ("response", Direction::Response)] {
            let Some(text) = row.source["example"].get(key).and_then(serde_json::Value::as_str) else { continue };
            let pdu = parse_hex(text).unwrap();
            for piece in annotate(&pdu, Wrapping::None, body(direction, None)) {
                assert!(piece.meaning.is_valid, "{text}: {piece:?}");
            }
            assert!([direction, Direction::Unknown].contains(&guess_direction(Functions::embedded(), &pdu)), "{text}");
        }
    }
}

proptest! {
    /// Whatever the bytes are, the blocks joined are the frame.
    #[test]
    fn pieces_cover_any_frame(
        frame in proptest::collection::vec(any::<u8>(), 0..260),
        request in proptest::option::of(proptest::collection::vec(any::<u8>(), 0..12)),
        direction in 0..3_usize,
        with_checksum: bool,
        is_text: bool,
    ) {
        let text = [b":".as_slice(), crate::hex::hex(&frame).as_bytes(), b"\r\n"].concat();
        let frame = if is_text { text } else { frame };
        let modes = [Mode::Rtu, Mode::Ascii, Mode::Tcp].map(|mode| Wrapping::Frame { mode, has_checksum: with_checksum });
        for wrapping in modes.into_iter().chain([Wrapping::None]) {
            let pieces = annotate(&frame, wrapping, body(DIRECTIONS[direction], request.as_deref()));
            let mut joined = Vec::new();
            for piece in pieces {
                prop_assert_eq!(piece.offset, joined.len());
                joined.extend(piece.bytes);
            }
            prop_assert_eq!(&joined, &frame);
        }
        for mode in [Mode::Rtu, Mode::Ascii, Mode::Tcp] {
            pdu_of(&frame, mode, with_checksum);
            has_checksum(&frame, mode, true);
        }
    }
}
