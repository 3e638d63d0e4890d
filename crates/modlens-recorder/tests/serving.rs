//! What a tap serves, and what another one makes of it.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use modlens_pcapng::recording::PortRead;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;
use modlens_readers::pcap::{Capture, Event, Ports};
use modlens_recorder::{Feed, Inbox, Port, RecordedPort, Recorder, RecorderOptions, Remote, Server, ServerOptions};

const PATIENCE: Duration = Duration::from_secs(20);
const HTTP: &[u8] = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";

fn server(token: Option<&str>, memory: usize) -> Server {
    let options = ServerOptions::parse("0", token.map(str::to_owned)).unwrap();
    Server::start(ServerOptions { memory, ..options }).unwrap()
}

fn port(name: &str) -> RecordedPort {
    RecordedPort { name: name.into(), bus: name.into(), settings: "19200-8E1".parse().ok(), ..RecordedPort::default() }
}

fn read(time: Ns, bytes: &[u8]) -> PortRead<'_> {
    PortRead { time, bytes, ..PortRead::default() }
}

fn now() -> Ns {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as Ns
}

fn until(what: &str, mut is_there: impl FnMut() -> bool) {
    let end = Instant::now() + PATIENCE;
    while !is_there() {
        assert!(Instant::now() < end, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Connects, sends what is asked, and waits until the server says that it serves.
fn client(server: &Server, asked: &[u8]) -> TcpStream {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(asked).unwrap();
    until("a client is served", || server.take_messages().iter().any(|text| text.starts_with("serving")));
    stream
}

/// Everything up to the end of the stream, without the head of HTTP.
fn rest(mut stream: TcpStream) -> Vec<u8> {
    let mut all = Vec::new();
    stream.read_to_end(&mut all).unwrap();
    if all.starts_with(b"HTTP") {
        all.drain(..4 + all.windows(4).position(|four| four == b"\r\n\r\n").unwrap());
    }
    all
}

/// Each read in a stream: port, time, bytes, whether bytes were lost before.
fn reads(stream: &[u8]) -> Vec<(String, Ns, Vec<u8>, bool)> {
    let mut found = Vec::new();
    let mut capture = Capture::new(Ports::default());
    capture.push(Functions::embedded(), stream, &mut |event| {
        if let Event::Line { by, content, time, .. } = event {
            found.push((by.name.clone().unwrap(), time.unwrap(), content.bytes.to_vec(), content.follows_loss));
        }
    });
    let broken = capture.left_out().into_iter().find(|(what, _)| what.contains("damaged") || what.contains("incomplete"));
    assert_eq!(broken, None, "the stream is whole");
    found
}

#[test]
fn clients_that_join_at_different_times_get_the_blocks_of_the_recording() {
    let folder = std::env::temp_dir().join(format!("modlens_serving_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("bus.pcapng");
    let mut recorder = Recorder::start(RecorderOptions::new(&path)).unwrap();
    let mut server = server(None, 1 << 20);
    let feed = Feed::join([recorder.feed(), server.feed()]);
    let early = client(&server, HTTP);
    assert_eq!(feed.add_port(&port("one")), 0);
    feed.write(0, &read(1, b"first"));
    let late = client(&server, b"");
    assert_eq!(feed.add_port(&port("two")), 1);
    feed.write(1, &PortRead { errors: &[0], ..read(2, b"second") });
    feed.write(0, &PortRead { hole: true, ..read(3, b"third") });
    feed.mark_clock_step(0, 4, 7);
    server.close();
    recorder.close(PATIENCE);
    let on_disk = std::fs::read(&path).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let (early, late) = (rest(early), rest(late));
    // The header names the session, which is of the same length everywhere.
    let header = u32::from_le_bytes(*on_disk[4..].first_chunk().unwrap()) as usize;
    assert_eq!(early[header..], on_disk[header..]);
    let names = |stream: &[u8]| reads(stream).into_iter().map(|(name, _, bytes, _)| (name, bytes)).collect::<Vec<_>>();
    assert_eq!(names(&late), names(&early)[1..]);
    assert!(on_disk.ends_with(&late[late.len() - 200..]));
}

#[test]
fn a_client_that_stalls_costs_bounded_memory_and_its_stream_says_what_it_missed() {
    let mut server = server(None, 1 << 20);
    let feed = server.feed();
    feed.add_port(&port("one"));
    let mut stalled = client(&server, HTTP);
    let mut busy = client(&server, HTTP);
    let vanished = client(&server, HTTP);
    drop(vanished);
    let received = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&received);
    let reader = std::thread::spawn(move || {
        let (mut all, mut part) = (Vec::new(), [0; 1 << 14]);
        while let Ok(length @ 1..) = busy.read(&mut part) {
            all.extend_from_slice(&part[..length]);
            counter.store(all.len(), Ordering::Relaxed);
        }
        all.split_off(4 + all.windows(4).position(|four| four == b"\r\n\r\n").unwrap())
    });
    // More than what the kernel holds for the stalled one, and never more ahead of the busy one than the queue holds.
    let (block, count) = (vec![0x55; 40_000], 600);
    for number in 0..count {
        feed.write(0, &read(number, &block));
        let written = number as usize * block.len();
        until("the busy one follows", || written < received.load(Ordering::Relaxed) + (1 << 19));
    }
    let mut said = Vec::new();
    until("the slow one is noticed", || {
        said.extend(server.take_messages());
        said.iter().any(|text| text.contains("too slowly"))
    });
    assert!(said.iter().any(|text| text.ends_with("has left")), "{said:?}");
    // It wakes up: what the kernel held comes first, then a loss, then the end of the queue.
    stalled.set_read_timeout(Some(Duration::from_millis(300))).unwrap();
    let mut late = Vec::new();
    loop {
        let mut part = [0; 1 << 14];
        match stalled.read(&mut part) {
            Ok(length) => late.extend_from_slice(&part[..length]),
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => break,
            Err(error) => panic!("{error}"),
        }
    }
    late.drain(..4 + late.windows(4).position(|four| four == b"\r\n\r\n").unwrap());
    server.close();
    let late = reads(&late);
    assert!(late.iter().any(|(_, _, bytes, follows_loss)| *follows_loss && bytes.is_empty()));
    assert_eq!(late.last().unwrap().1, count - 1);
    let busy = reads(&reader.join().unwrap());
    let lines: Vec<Ns> = busy.iter().filter(|read| !read.2.is_empty()).map(|read| read.1).collect();
    assert_eq!(lines, (0..count).collect::<Vec<_>>());
}

#[test]
fn strangers_are_refused_and_their_number_is_bounded() {
    let server = server(Some("a-token-of-sixteen"), 1 << 16);
    for (asked, status) in [
        (&b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"[..], "401"),
        (b"PUT / HTTP/1.1\r\nAuthorization: Bearer a-token-of-sixteen\r\n\r\n", "405"),
    ] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(asked).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert_eq!(answer.split(' ').nth(1), Some(status));
    }
    let name = format!("modlens://{}", server.address());
    let why = |token| Remote::open(&name, token).map(drop).unwrap_err();
    assert!(why(None).contains("MODLENS_SERVE_TOKEN"));
    assert!(why(Some("another-token-of")).contains("MODLENS_SERVE_TOKEN"));
    let all: Vec<Remote> = (0..8).map(|_| Remote::open(&name, Some("a-token-of-sixteen")).unwrap()).collect();
    assert!(why(Some("a-token-of-sixteen")).contains("as many clients"));
    drop(all);
    until("there is room again", || Remote::open(&name, Some("a-token-of-sixteen")).is_ok());
}

#[test]
fn addresses_that_others_can_reach_need_a_token() {
    let why = |place: &str, token: Option<&str>| ServerOptions::parse(place, token.map(str::to_owned)).map(|it| it.address);
    assert_eq!(why("4010", None), Ok("127.0.0.1:4010".parse().unwrap()));
    assert_eq!(why("localhost:1", None), Ok("127.0.0.1:1".parse().unwrap()));
    assert_eq!(why("[::1]:4010", None), Ok("[::1]:4010".parse().unwrap()));
    assert_eq!(why("0.0.0.0:4010", Some("a-token-of-sixteen")), Ok("0.0.0.0:4010".parse().unwrap()));
    for (place, token) in [("0.0.0.0:4010", None), ("4010", Some("short")), ("gateway:4010", None), ("99999", None), ("", None)] {
        assert!(why(place, token).is_err(), "{place}");
    }
}

#[test]
fn a_remote_port_has_the_reads_of_the_tap_with_their_times_and_marks() {
    let server = server(None, 1 << 20);
    let feed = server.feed();
    feed.add_port(&port("boiler"));
    let start = now();
    feed.advance(start);
    let name = format!("modlens://{}/boiler", server.address());
    let mut remote = Remote::open(&name, None).unwrap();
    assert_eq!(remote.line(), "19200-8E1".parse().ok());
    assert_eq!(remote.advice(), "");
    let inbox = Arc::new(Inbox::new(1 << 20));
    remote.listen(&inbox, 0).unwrap();
    feed.write(0, &read(start + 5, b"first"));
    feed.write(0, &PortRead { errors: &[2], hole: true, ..read(start + 9, b"second") });
    let mut found = Vec::new();
    until("both came", || {
        found.extend(inbox.take(Duration::from_millis(20), Duration::ZERO));
        found.last().is_some_and(|read| read.bytes.as_deref() == Some(b"second"))
    });
    let got: Vec<_> = found.iter().map(|read| (read.time - start, read.bytes.clone().unwrap(), read.follows_loss)).collect();
    assert_eq!(got, [(5, b"first".to_vec(), false), (9, Vec::new(), true), (9, b"second".to_vec(), true)]);
    assert_eq!(found.last().unwrap().errors, [2]);
    // The line is silent, and time goes on.
    feed.advance(start + 1_000_000_000);
    until("time goes on", || inbox.told_ns() == [start + 1_000_000_000]);
    drop(server);
    until("the end", || inbox.take(Duration::from_millis(20), Duration::ZERO).iter().any(|read| read.bytes.is_none()));
    assert!(inbox.told_ns().is_empty());
}

#[test]
fn a_remote_port_says_which_buses_there_are_and_shifts_the_times_of_another_clock() {
    let server = server(None, 1 << 20);
    let feed = server.feed();
    let hour = 3_600_000_000_000;
    feed.add_port(&port("boiler"));
    feed.add_port(&port("pump"));
    feed.add_port(&RecordedPort { line: Some("A".into()), ..port("both") });
    feed.add_port(&RecordedPort { line: Some("B".into()), ..port("both") });
    let open = |bus: &str| {
        feed.advance(now() - hour);
        Remote::open(&format!("modlens://{}{bus}", server.address()), None)
    };
    let why = |bus: &str| open(bus).map(drop).unwrap_err();
    assert!(why("").contains("several buses; add the name of one to the address: boiler, both, pump"));
    assert!(why("/valve").contains("no bus valve"));
    assert!(open("/both").unwrap().has_two_lines());
    let mut remote = open("/pump").unwrap();
    assert!(!remote.has_two_lines());
    assert!(remote.advice().contains("differs from this computer's by 360"), "{}", remote.advice());
    let inbox = Arc::new(Inbox::new(1 << 20));
    remote.listen(&inbox, 0).unwrap();
    feed.write(0, &read(now() - hour, b"other"));
    feed.write(1, &read(now() - hour, b"ours"));
    let found = inbox.take(PATIENCE, Duration::ZERO);
    assert_eq!(found[0].bytes.as_deref(), Some(&b"ours"[..]));
    assert!((found[0].time - now()).abs() < 2_000_000_000);
}

#[test]
fn the_lines_of_a_bus_that_is_tapped_on_two_come_as_neighbouring_ports_in_order() {
    let server = server(None, 1 << 20);
    let feed = server.feed();
    for letter in ["A", "B"] {
        feed.add_port(&RecordedPort { line: Some(letter.into()), ..port("both") });
    }
    let start = now();
    feed.advance(start);
    let mut remote = Remote::open(&format!("modlens://{}", server.address()), None).unwrap();
    let inbox = Arc::new(Inbox::new(1 << 20));
    remote.listen(&inbox, 4).unwrap();
    feed.write(0, &read(start + 5, b"request"));
    feed.write(1, &read(start + 5, b"answer"));
    feed.write(0, &read(start + 9, b"next"));
    drop(server);
    let mut found = Vec::new();
    until("the end", || {
        found.extend(inbox.take(Duration::from_millis(20), Duration::ZERO));
        found.last().is_some_and(|read| read.bytes.is_none())
    });
    let got: Vec<_> = found.iter().map(|read| (read.port, read.bytes.as_deref(), read.follows_loss)).collect();
    let [request, answer, next]: [&[u8]; 3] = [b"request", b"answer", b"next"];
    // Both lines end with the connection.
    let end: &[u8] = b"";
    assert_eq!(
        got,
        [(4, Some(request), false), (5, Some(answer), false), (4, Some(next), false), (5, Some(end), true), (4, None, false)]
    );
}

/// What a request is answered, all of it or as much as comes in a second.
fn asked(server: &Server, request: &str) -> String {
    let mut stream = TcpStream::connect(server.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(1))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = Vec::new();
    let mut block = [0; 4096];
    while let Ok(length @ 1..) = stream.read(&mut block) {
        answer.extend_from_slice(&block[..length]);
    }
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn a_page_is_served_with_its_stream_beside_it() {
    let page: Arc<[u8]> = b"<p>the page</p>".as_slice().into();
    let server = Server::start(ServerOptions::with_page("0", None, page).unwrap()).unwrap();
    assert_eq!(server.url(), format!("http://{}/", server.address()));
    let found = asked(&server, "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert!(found.starts_with("HTTP/1.1 200 OK\r\nContent-Type: text/html"), "{found}");
    assert!(found.ends_with("<p>the page</p>"), "{found}");
    let found = asked(&server, "GET /recording.pcapng HTTP/1.1\r\nHost: localhost\r\n\r\n");
    assert!(found.starts_with("HTTP/1.1 200 OK\r\nContent-Type: application/x-pcapng"), "{found}");
    assert!(found.contains("recording session="), "{found}");
}

#[test]
fn a_page_that_others_can_reach_has_a_token_of_its_own() {
    let token_of = |token: Option<&str>| {
        let page: Arc<[u8]> = b"page".as_slice().into();
        ServerOptions::with_page("0.0.0.0:0", token.map(str::to_owned), page).unwrap().token.unwrap()
    };
    assert!(token_of(None).len() >= 32);
    assert_ne!(token_of(None), token_of(None));
    assert_eq!(token_of(Some("sixteen-characters")), "sixteen-characters");
}
