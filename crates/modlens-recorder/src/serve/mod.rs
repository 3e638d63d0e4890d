//! Serves what a tap reads to other programs: the raw recording as a stream of pcapng over TCP, for reading only.
//!
//! A client that sends nothing gets the plain stream (`wireshark -k -i TCP@host:port`), unless a token is demanded. `GET /`
//! gets it by HTTP, with `Authorization: Bearer TOKEN`; `GET /timed` as well, with packets that say how time advances while
//! the line is silent, for [`Remote`](crate::Remote). Each stream begins with the header and the descriptions of the ports.
//!
//! With a page, which decodes the stream in a browser, `GET /` gets the page, and `GET /recording.pcapng` the timed stream
//! (`modlens tap --web`). The token of a page is in its address, since a browser sends no field that it is not asked for.
//!
//! One thread serves all clients, and the readers of ports only append to a bounded queue (`hub`). A client that is too slow
//! misses blocks, which its stream marks as a loss; one that takes nothing is disconnected.

mod client;
mod hub;
pub(crate) mod request;

use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener, UdpSocket};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::feed::{Feed, ReadSink};
use crate::segments::new_session;
use client::{Client, Gone};
use hub::Hub;
use request::Terms;

/// The thread looks after clients so often, or after new ones where there are none.
const INTERVAL: Duration = Duration::from_millis(10);
const IDLE_INTERVAL: Duration = Duration::from_millis(100);
/// The end waits so long for clients to take the rest.
const CLOSE: Duration = Duration::from_secs(1);
/// Connections beside the clients that have not asked yet, or are being refused.
const MAX_ASKING: usize = 8;
/// A shorter token could be guessed.
const MIN_TOKEN_BYTES: usize = 16;
/// Sentences that wait for the user.
const MAX_MESSAGES: usize = 100;

/// How to serve.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// The address to listen at.
    pub address: SocketAddr,
    /// What clients have to know; `None` serves everybody who can reach the address.
    pub token: Option<String>,
    /// The most clients at once.
    pub clients: usize,
    /// The memory of blocks that clients have not got yet, in bytes.
    pub memory: usize,
    /// The page that shows the stream.
    pub page: Option<Arc<[u8]>>,
}

impl ServerOptions {
    /// Eight clients and 4 MiB: five minutes of a line that is full at 9600 baud.
    pub fn new(address: SocketAddr) -> Self {
        Self { address, token: None, clients: 8, memory: 1 << 22, page: None }
    }

    /// Parses `[HOST:]PORT`, on loopback unless a host is given. Other computers need a token to read the line.
    pub fn parse(place: &str, token: Option<String>) -> Result<Self, String> {
        let (host, port) = Self::address_of(place)?;
        Self::at(SocketAddr::new(host, port), token)
    }

    /// Parses where a page is served, as `parse`. Where other computers can reach it without a token, one is made, which is
    /// in the address to open.
    pub fn with_page(place: &str, token: Option<String>, page: Arc<[u8]>) -> Result<Self, String> {
        let (host, port) = Self::address_of(place)?;
        let token = token.or_else(|| (!host.is_loopback()).then(|| new_session() + &new_session()));
        Ok(Self { page: Some(page), ..Self::at(SocketAddr::new(host, port), token)? })
    }

    fn address_of(place: &str) -> Result<(IpAddr, u16), String> {
        let (host, port) = place.rsplit_once(':').unwrap_or(("127.0.0.1", place));
        let host = if host.eq_ignore_ascii_case("localhost") { "127.0.0.1" } else { host.trim_matches(['[', ']']) };
        let (Ok(host), Ok(port)) = (host.parse::<IpAddr>(), port.parse()) else {
            return Err("write a port as 4010, or address:port as 0.0.0.0:4010".into());
        };
        Ok((host, port))
    }

    fn at(address: SocketAddr, token: Option<String>) -> Result<Self, String> {
        if token.is_none() && !address.ip().is_loopback() {
            return Err(
                "other computers can reach this address: set a token, as with MODLENS_SERVE_TOKEN=$(openssl rand -hex 16)".into(),
            );
        }
        if token.as_ref().is_some_and(|token| token.len() < MIN_TOKEN_BYTES || !token.bytes().all(|byte| byte.is_ascii_graphic()))
        {
            return Err(format!("the token needs {MIN_TOKEN_BYTES} or more characters without spaces: openssl rand -hex 16"));
        }
        Ok(Self { token, ..Self::new(address) })
    }
}

struct Shared {
    messages: Mutex<Vec<String>>,
    is_closing: Mutex<bool>,
}

/// Serves the reads of ports in a thread of its own, which nothing waits for but `close`.
pub struct Server {
    hub: Arc<Hub>,
    shared: Arc<Shared>,
    address: SocketAddr,
    token: Option<String>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Listens at the address and starts the thread.
    pub fn start(options: ServerOptions) -> io::Result<Self> {
        let listener = TcpListener::bind(options.address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let hub = Arc::new(Hub::new(format!("modlens {}", env!("CARGO_PKG_VERSION")), options.memory));
        let token = options.token.clone();
        let shared = Arc::new(Shared { messages: Mutex::default(), is_closing: Mutex::new(false) });
        let mut worker = Worker { listener, options, hub: Arc::clone(&hub), shared: Arc::clone(&shared), clients: Vec::new() };
        let thread = std::thread::Builder::new().name("modlens server".into()).spawn(move || worker.run())?;
        Ok(Self { hub, shared, address, token, thread: Some(thread) })
    }

    /// Where the reads go that it serves.
    pub fn feed(&self) -> Feed {
        Feed::from(Arc::clone(&self.hub) as Arc<dyn ReadSink>)
    }

    /// The address that it listens at; the port is one of the system's where port 0 was asked for.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What to open in a browser.
    pub fn url(&self) -> String {
        let mut address = self.address;
        if address.ip().is_unspecified() {
            address.set_ip(own_address().unwrap_or(address.ip()));
        }
        let token = self.token.as_ref().map(|token| format!("?token={token}")).unwrap_or_default();
        format!("http://{address}/{token}")
    }

    /// Sentences for the user since the last call: clients that have come and gone.
    pub fn take_messages(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.shared.messages))
    }

    /// Gives clients a second to take the rest, and ends their connections.
    pub fn close(&mut self) {
        *lock(&self.shared.is_closing) = true;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.close();
    }
}

/// The address by which others most probably reach this computer. Nothing is sent to find out.
fn own_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind("0.0.0.0:0").ok()?;
    socket.connect("192.0.2.1:9").ok()?;
    Some(socket.local_addr().ok()?.ip())
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The thread.
struct Worker {
    listener: TcpListener,
    options: ServerOptions,
    hub: Arc<Hub>,
    shared: Arc<Shared>,
    clients: Vec<Client>,
}

impl Worker {
    fn run(&mut self) {
        while !*lock(&self.shared.is_closing) {
            self.accept();
            self.serve();
            std::thread::sleep(if self.clients.is_empty() { IDLE_INTERVAL } else { INTERVAL });
        }
        let until = Instant::now() + CLOSE;
        self.serve();
        while self.clients.iter().any(|client| !client.is_served(&self.hub)) && Instant::now() < until {
            std::thread::sleep(INTERVAL);
            self.serve();
        }
    }

    fn accept(&mut self) {
        while self.clients.len() < self.options.clients + MAX_ASKING {
            let Ok((stream, address)) = self.listener.accept() else { return };
            self.clients.extend(Client::new(stream, address.to_string()));
        }
    }

    fn serve(&mut self) {
        let (token, page) = (self.options.token.clone(), self.options.page.clone());
        let terms = Terms { token: token.as_deref(), page: page.as_deref() };
        let mut streaming = self.clients.iter().filter(|client| client.is_streaming()).count();
        for mut client in std::mem::take(&mut self.clients) {
            let (lost, was_streaming) = (client.lost(), client.is_streaming());
            let done = client.serve(&self.hub, terms, streaming < self.options.clients);
            if lost == 0 && client.lost() > 0 {
                self.say(format!("{} reads too slowly: bytes are missing in its stream", client.name));
            }
            match done {
                Ok(begins) => {
                    if begins {
                        streaming += 1;
                        self.say(format!("serving {}", client.name));
                    }
                    self.clients.push(client);
                    continue;
                }
                Err(Gone::Left) if was_streaming => self.say(left(&client)),
                Err(Gone::Stalled) => self.say(format!("{} took nothing for a minute and was disconnected", client.name)),
                Err(Gone::Answered | Gone::Left) => {}
            }
            if client.is_streaming() {
                self.hub.leave();
            }
        }
    }

    fn say(&self, text: String) {
        let mut messages = lock(&self.shared.messages);
        if messages.len() < MAX_MESSAGES {
            messages.push(text);
        }
    }
}

fn left(client: &Client) -> String {
    match client.lost() {
        0 => format!("{} has left", client.name),
        lost => format!("{} has left; it read too slowly and did not get {lost} bytes", client.name),
    }
}
