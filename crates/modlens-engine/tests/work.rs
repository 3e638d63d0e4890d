//! A line at work: a poll cycle with what disturbs one in the field. What is learned from it and the short way that
//! frames without doubt take must not depend on how the bytes came, nor lose a frame.

mod wire;

use modlens_engine::records::Batch;
use modlens_engine::session::Session;
use modlens_protocol::checksum::crc16;
use modlens_protocol::direction::Direction;
use proptest::prelude::*;

use wire::in_pieces;

/// What happens to one poll.
#[derive(Clone, Debug)]
struct Poll {
    /// Which of the cycle's.
    unit: u8,
    value: u16,
    answered: bool,
    /// Bytes that a switched driver leaves in front of the request and of the answer.
    strays: [(u8, usize); 2],
    /// A byte of the request that is not received as it was sent.
    flipped: Option<(usize, u8)>,
}

/// A whole frame: where it begins, its bytes, who sent it.
type Sent = (u64, Vec<u8>, Direction);

fn framed(mut adu: Vec<u8>) -> Vec<u8> {
    adu.extend(crc16(&adu).to_le_bytes());
    adu
}

impl Poll {
    fn request(&self) -> Vec<u8> {
        framed(vec![self.unit, 3, 0, 16 * self.unit, 0, self.unit])
    }

    fn answer(&self) -> Vec<u8> {
        let mut adu = vec![self.unit, 3, 2 * self.unit];
        for _ in 0..self.unit {
            adu.extend(self.value.to_be_bytes());
        }
        framed(adu)
    }

    /// The bytes, and the frames among them that are whole.
    fn put(&self, bytes: &mut Vec<u8>, frames: &mut Vec<Sent>) {
        let mut request = self.request();
        bytes.extend(std::iter::repeat_n(self.strays[0].0, self.strays[0].1));
        if let Some((at, flip)) = self.flipped {
            let at = at % request.len();
            request[at] ^= flip;
        } else {
            frames.push((bytes.len() as u64, request.clone(), Direction::Request));
        }
        bytes.extend(&request);
        if self.answered && self.flipped.is_none() {
            bytes.extend(std::iter::repeat_n(self.strays[1].0, self.strays[1].1));
            frames.push((bytes.len() as u64, self.answer(), Direction::Response));
            bytes.extend(self.answer());
        }
    }
}

fn poll(strays: bool, damage: bool) -> impl Strategy<Value = Poll> {
    let glitch = move || {
        let value = prop_oneof![Just(0u8), Just(0xFF), Just(0xFE), Just(0x80)];
        (value, if strays { prop_oneof![3 => Just(0usize), 1 => 1usize..4].boxed() } else { Just(0).boxed() })
    };
    let flipped =
        if damage { prop_oneof![5 => Just(None), 1 => (0usize..8, 1u8..).prop_map(Some)].boxed() } else { Just(None).boxed() };
    (1u8..6, any::<u16>(), proptest::bool::weighted(0.8), glitch(), glitch(), flipped).prop_map(
        |(unit, value, answered, before, between, flipped)| Poll { unit, value, answered, strays: [before, between], flipped },
    )
}

/// Rounds of the cycle without trouble, then these.
fn recording(polls: &[Poll]) -> (Vec<u8>, Vec<Sent>) {
    let (mut bytes, mut frames) = (Vec::new(), Vec::new());
    for round in 0..8u8 {
        for unit in 1..6 {
            let value = u16::from(round) * 257 + u16::from(unit);
            Poll { unit, value, answered: true, strays: [(0, 0); 2], flipped: None }.put(&mut bytes, &mut frames);
        }
    }
    for poll in polls {
        poll.put(&mut bytes, &mut frames);
    }
    // The last frames have something after them as well.
    Poll { unit: 1, value: 0, answered: true, strays: [(0, 0); 2], flipped: None }.put(&mut bytes, &mut frames);
    (bytes, frames)
}

fn decode(bytes: &[u8], piece: usize) -> Batch {
    in_pieces(&mut Session::default(), bytes, piece)
}

fn shown(batch: &Batch) -> Vec<String> {
    let shown = batch.frames.iter().map(|f| {
        let place = (f.offset, f.wire.length, f.direction, f.verdict, f.delimited_by, f.confidence);
        format!("{place:?} {:?} {:?}", f.txn, f.findings.of(&batch.codes))
    });
    shown.collect()
}

fn good(batch: &Batch) -> Vec<Sent> {
    let good = batch.frames.iter().filter(|frame| frame.verdict.is_good());
    good.map(|frame| (frame.offset, frame.wire.of(&batch.arena).to_vec(), frame.direction)).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn pieces_change_nothing(polls in proptest::collection::vec(poll(true, true), 1..30)) {
        let (bytes, _) = recording(&polls);
        let whole = shown(&decode(&bytes, usize::MAX));
        for piece in [1, 7, 64] {
            prop_assert_eq!(&shown(&decode(&bytes, piece)), &whole);
        }
    }

    #[test]
    fn neither_strays_nor_silent_units_hide_a_frame(polls in proptest::collection::vec(poll(true, false), 1..30)) {
        let (bytes, frames) = recording(&polls);
        prop_assert_eq!(good(&decode(&bytes, usize::MAX)), frames);
    }
}
