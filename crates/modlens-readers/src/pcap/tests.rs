//! Plain packets, which take the short way, against the general way, and events that are kept against those that are handled at
//! once, on connections with all that happens to segments.

use pcap_parser::{parse_pcap_frame, parse_pcap_frame_be};
use proptest::prelude::*;

use crate::pcap::classic::numbers_of_header;
use crate::pcap::{Capture, Event, KeptEvents, Ports};
use modlens_protocol::functions::Functions;

const FIN: u8 = 1;
const SYN: u8 = 2;
const RST: u8 = 4;
const ACK: u8 = 0x10;

/// Both ends of a connection while it is written into a capture.
#[derive(Clone)]
struct Talk {
    port: u16,
    /// The next sequence number of the client and of the server.
    next: [u32; 2],
    id: u16,
}

/// A capture in the making.
#[derive(Default)]
struct File {
    packets: Vec<Vec<u8>>,
    ident: u16,
}

impl File {
    /// A packet of one side of a connection; `sequence` is its number, which may be an old one.
    fn packet(&mut self, talk: &Talk, side: usize, sequence: u32, flags: u8, payload: &[u8]) -> Vec<u8> {
        self.ident += 1;
        let ends = [([10, 0, 0, 1], talk.port), ([10, 0, 0, 2], 502)];
        let (from, to) = (ends[side], ends[1 - side]);
        let mut packet = vec![0; 12];
        packet.extend([8, 0, 0x45, 0]);
        packet.extend((40 + payload.len() as u16).to_be_bytes());
        packet.extend(self.ident.to_be_bytes());
        packet.extend([0x40, 0, 64, 6, 0, 0]);
        packet.extend(from.0.into_iter().chain(to.0));
        packet.extend(from.1.to_be_bytes().into_iter().chain(to.1.to_be_bytes()));
        packet.extend(sequence.to_be_bytes());
        packet.extend(if flags & ACK == 0 { [0; 4] } else { talk.next[1 - side].to_be_bytes() });
        packet.extend([0x50, flags, 0x20, 0, 0, 0, 0, 0]);
        packet.extend(payload);
        packet
    }

    /// The next bytes of a side.
    fn say(&mut self, talk: &mut Talk, side: usize, payload: &[u8]) {
        let packet = self.packet(talk, side, talk.next[side], ACK | 8, payload);
        talk.next[side] = talk.next[side].wrapping_add(payload.len() as u32);
        self.packets.push(packet);
    }

    fn control(&mut self, talk: &mut Talk, side: usize, flags: u8) {
        let packet = self.packet(talk, side, talk.next[side], flags, b"");
        talk.next[side] = talk.next[side].wrapping_add(u32::from(flags & (SYN | FIN) != 0));
        self.packets.push(packet);
    }

    /// The file, a packet each `step` ns; the packets of `cut` lack their last bytes.
    fn bytes(&self, step: u64, cut: &[usize]) -> Vec<u8> {
        let mut file = 0xA1B2_3C4Du32.to_le_bytes().to_vec();
        file.extend([2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 4, 0, 1, 0, 0, 0]);
        for (at, packet) in self.packets.iter().enumerate() {
            let time = 1_700_000_000_000_000_000 + at as u64 * step;
            let kept = if cut.contains(&at) { packet.len().min(60) } else { packet.len() };
            for word in [time / 1_000_000_000, time % 1_000_000_000, kept as u64, packet.len() as u64] {
                file.extend((word as u32).to_le_bytes());
            }
            file.extend(&packet[..kept]);
        }
        file
    }
}

fn request(id: u16) -> Vec<u8> {
    [&id.to_be_bytes()[..], &[0, 0, 0, 6, 1, 3, 0, 0, 0, 2]].concat()
}

fn response(id: u16) -> Vec<u8> {
    [&id.to_be_bytes()[..], &[0, 0, 0, 7, 1, 3, 4, 0, 1, 0, 2]].concat()
}

/// Lets something happen on a connection.
fn happen(file: &mut File, talk: &mut Talk, what: usize) {
    let polls = |file: &mut File, talk: &mut Talk| {
        talk.id += 1;
        file.say(talk, 0, &request(talk.id));
    };
    match what {
        0..24 => {
            polls(file, talk);
            file.say(talk, 1, &response(talk.id));
        }
        24 => polls(file, talk),
        25 => file.say(talk, 1, &response(talk.id)),
        26 => file.control(talk, 0, ACK),
        27 => file.control(talk, 1, ACK),
        // The same packet again, and its bytes again.
        28 => file.packets.extend(file.packets.last().cloned()),
        29 => {
            let bytes = request(talk.id);
            let again = file.packet(talk, 0, talk.next[0].wrapping_sub(bytes.len() as u32), ACK, &bytes);
            file.packets.push(again);
        }
        // Bytes that the capture lacks.
        30 => talk.next[0] = talk.next[0].wrapping_add(12),
        31 => talk.next[1] = talk.next[1].wrapping_add(13),
        // Two packets in the other order.
        32 => {
            polls(file, talk);
            file.say(talk, 1, &response(talk.id));
            let length = file.packets.len();
            file.packets.swap(length - 1, length - 2);
        }
        33 => {
            polls(file, talk);
            let (first, second) = (&response(talk.id)[..5], &response(talk.id)[5..]);
            file.say(talk, 1, first);
            file.say(talk, 1, second);
        }
        34 => file.say(talk, 0, &[request(talk.id), request(talk.id + 1)].concat()),
        35 => file.control(talk, 0, ACK | FIN),
        36 => file.control(talk, 1, ACK | FIN),
        37 => file.control(talk, 1, ACK | RST),
        38 => {
            talk.next = [talk.next[0].wrapping_add(70_000_000), talk.next[1].wrapping_add(90_000_000)];
            file.control(talk, 0, SYN);
            file.control(talk, 1, SYN | ACK);
        }
        // The same bytes, but for the last one.
        39 => {
            let bytes = [&response(talk.id)[..12], &[9]].concat();
            let again = file.packet(talk, 1, talk.next[1].wrapping_sub(bytes.len() as u32), ACK, &bytes);
            file.packets.push(again);
        }
        // A keep-alive probe: the byte before the next one.
        _ => {
            let probe = file.packet(talk, 0, talk.next[0].wrapping_sub(1), ACK, &[0]);
            file.packets.push(probe);
        }
    }
}

/// An event as text; packets that came in turn as the events that they mean.
fn list(event: Event<'_>, all: &mut Vec<String>) {
    if let Event::InTurn(packets, by) = event {
        let events = packets.iter().flat_map(|packet| packet.events(by));
        all.extend(events.map(|event| format!("{event:?}")));
    } else {
        all.push(format!("{event:?}"));
    }
}

/// All events of a capture, what was left out, and how many packets took the short way.
fn read(file: &[u8], is_general: bool) -> (Vec<String>, u64) {
    let mut capture = Capture::new(Ports::default());
    capture.is_general = is_general;
    let functions = Functions::default();
    let mut all = Vec::new();
    capture.push(&functions, file, &mut |event| list(event, &mut all));
    capture.finish(&functions, &mut |event| list(event, &mut all));
    all.push(format!("{:?} {}", capture.left_out(), capture.packets()));
    (all, capture.plain)
}

/// The same events as `read` gives, kept block by block and handled later.
fn read_later(file: &[u8], block: usize) -> Vec<String> {
    let mut capture = Capture::new(Ports::default());
    let functions = Functions::default();
    let mut blocks: Vec<KeptEvents> = Vec::new();
    for block in file.chunks(block) {
        let mut kept = KeptEvents::default();
        capture.push(&functions, block, &mut |event| kept.push(event));
        blocks.push(kept);
    }
    let mut last = KeptEvents::default();
    capture.finish(&functions, &mut |event| last.push(event));
    let mut all = Vec::new();
    blocks.iter().chain([&last]).for_each(|kept| kept.replay(|event| list(event, &mut all)));
    all.push(format!("{:?} {}", capture.left_out(), capture.packets()));
    all
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    #[test]
    fn plain_packets_give_the_events_of_the_general_way(
        events in prop::collection::vec((0usize..3, 0usize..41), 1..80),
        step in prop_oneof![Just(1_000u64), Just(3_000_000), Just(900_000_000)],
        cut in prop::collection::vec(0usize..100, 0..3),
        padded in any::<bool>(),
        block in 1usize..2000,
    ) {
        let mut file = File::default();
        let talk = |at: u16| Talk { port: 40_000 + at, next: [u32::MAX - 100 * u32::from(at), 7_000], id: 0 };
        let mut talks = [talk(0), talk(1), talk(2)];
        for (at, what) in events {
            happen(&mut file, &mut talks[at], what);
        }
        if padded {
            file.packets.iter_mut().for_each(|packet| packet.resize(packet.len().max(60), 0));
        }
        let bytes = file.bytes(step, &cut);
        let events = read(&bytes, false).0;
        prop_assert_eq!(&events, &read(&bytes, true).0);
        prop_assert_eq!(&events, &read_later(&bytes, block));
    }
}

#[test]
fn nearly_all_packets_of_polling_are_plain() {
    let mut file = File::default();
    let mut talk = Talk { port: 40_000, next: [1, 1], id: 0 };
    for _ in 0..50 {
        happen(&mut file, &mut talk, 0);
    }
    assert_eq!(read(&file.bytes(1_000_000, &[]), false).1, 98);
}

proptest! {
    #[test]
    fn a_record_of_pcap_is_read_as_the_parser_reads_it(
        numbers in any::<[u32; 3]>(),
        data in prop::collection::vec(any::<u8>(), 0..90),
        is_big_endian in any::<bool>(),
    ) {
        let [seconds, fraction, length] = numbers;
        let bytes = if is_big_endian { u32::to_be_bytes } else { u32::to_le_bytes };
        let record = [[seconds, fraction, data.len() as u32, length].map(bytes).concat(), data].concat();
        let expected = if is_big_endian { parse_pcap_frame_be(&record) } else { parse_pcap_frame(&record) }.unwrap().1;
        let (header, rest) = record.split_first_chunk().unwrap();
        prop_assert_eq!(numbers_of_header(header, is_big_endian), [expected.ts_sec, expected.ts_usec, expected.caplen, expected.origlen]);
        prop_assert_eq!(rest, expected.data);
    }
}
