//! Files of any kind: recordings, profiles, and the recorder's own.

use modlens_engine::session::Session;
use modlens_pcapng::recording::{clock_step, head, port, read, PortRead};
use modlens_profiles::profile::{Profile, ProfileFormat};
use modlens_protocol::source::Clock;
use modlens_recording::{Options, Recording};

use super::{parse_script, session, START_NS};

const FORMATS: [ProfileFormat; 4] = [ProfileFormat::Toml, ProfileFormat::Csv, ProfileFormat::Yaml, ProfileFormat::Json];

/// The frames of a file that is fed so many bytes at once; `None` where it is refused.
fn frames_of_file(data: &[u8], block: usize) -> Option<Vec<(u64, u64, Vec<u8>)>> {
    let (mut session, _) = session(None, Clock::None, false);
    let mut recording = Recording::new(Options { name: String::from("file"), ..Options::default() });
    for block in data.chunks(block) {
        recording.feed(&mut session, block).ok()?;
    }
    recording.finish(&mut session).ok()?;
    Some(frames(&mut session))
}

fn frames(session: &mut Session) -> Vec<(u64, u64, Vec<u8>)> {
    session.flush();
    let batch = session.take();
    batch.frames.iter().map(|frame| (frame.offset, frame.origin, frame.wire.of(&batch.arena).to_vec())).collect()
}

/// A file is recognized by its first bytes and read, or refused, however it is cut.
pub fn recording_holds(data: &[u8]) {
    let whole = frames_of_file(data, usize::MAX);
    assert_eq!(frames_of_file(data, 5), whole);
}

/// A text is a profile, or has mistakes that are named; the first byte chooses the notation.
pub fn profile_holds(data: &[u8]) {
    let (&options, text) = data.split_first().unwrap_or((&0, &[]));
    let text = String::from_utf8_lossy(text);
    if let Err(mistakes) = Profile::parse(&text, FORMATS[usize::from(options) % FORMATS.len()]) {
        assert!(!mistakes.is_empty() && mistakes.windows(2).all(|pair| pair[0].line <= pair[1].line));
    }
}

/// What the recorder writes of reads is read back: all their bytes, whatever the times, marks and holes between them.
pub fn recorder_holds(data: &[u8]) {
    let script = parse_script(data);
    let name = String::from_utf8_lossy(&data[..data.len().min(9)]).into_owned();
    let mut file = Vec::new();
    head("modlens", "0123456789abcdef", u64::from(script.live), &mut file);
    port(&name, (1, &name), None, "19200-8E1".parse().ok().as_ref(), &mut file);
    let mut now = START_NS;
    let mut sent = Vec::new();
    for (number, (pause, bytes)) in script.reads.iter().enumerate() {
        now += pause;
        if *pause < 0 {
            clock_step(0, now, *pause, &mut file);
        }
        let errors: &[u32] = if number % 5 == 4 && !bytes.is_empty() { &[0] } else { &[] };
        read(0, &PortRead { time: now, bytes, errors, hole: number % 7 == 6 }, &mut file);
        sent.extend_from_slice(bytes);
    }
    let found = frames_of_file(&file, usize::MAX).expect("a recording");
    let joined: Vec<u8> = found.into_iter().flat_map(|(_, _, wire)| wire).collect();
    assert_eq!(joined, sent, "the recording has not the bytes of its reads");
}
