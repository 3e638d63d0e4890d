//! The command line.

use std::path::PathBuf;
use std::str::FromStr;

use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_recorder::{Retention, Rotation, ServerOptions};

use crate::broker::Broker;

const HELP: &str = "\
usage: modlens-tap [BUS=]PORT [OPTIONS]

Listens to a serial port, or to what another tap serves (modlens://host:port), and decodes its Modbus traffic; it never sends.

  --line 19200-8E1      line settings (default: found by listening)
  --mode rtu|ascii      framing (default: detected)
  -o FILE               append each transaction as a JSON line (default: standard output)
  --quiet               no rows on standard output
  --record FILE         save the raw bytes with timestamps as pcapng, for modlens decode
  --rotate N            start a new file every so often, or at this size: 1h, 64MB
  --keep N              keep the newest N files, or at most this size: 168, 2GB
  --serve [HOST:]PORT   pass the raw bytes on to Wireshark or another modlens, as pcapng over TCP
  --web [[HOST:]PORT]   serve a page that shows the line in any browser (default: 127.0.0.1:4080)
  --serve-token-file FILE     file with the token of its clients (default: $MODLENS_SERVE_TOKEN)
  --mqtt URL            publish to mqtt://[user@]host[:port]/prefix, or mqtts:// for TLS
  --mqtt-password-file FILE   file with the password (default: $MODLENS_MQTT_PASSWORD)
  --mqtt-ca FILE        CA certificates (PEM) to trust (default: those of the system)
  --count N             stop after so many transactions
  --version             print the version

Exit status: 0 done; 2 wrong use; 3 output not writable; 4 port trouble.
";

/// The page that `--web` serves; empty where the program was built without it.
const PAGE: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/page.html"));

/// Where it is served unless another place is named.
const WEB_PLACE: &str = "127.0.0.1:4080";

/// What the command line asks for.
pub enum Wanted {
    /// A tap.
    Tap(Box<Options>),
    /// Only this text.
    Text(String),
}

/// How to tap.
pub struct Options {
    /// The name of the bus.
    pub bus: String,
    /// The port's path.
    pub port: String,
    /// Line settings; found where `None`.
    pub line: Option<LineSettings>,
    /// Framing; detected where `None`.
    pub mode: Option<Mode>,
    /// The file of JSON lines.
    pub output: Option<PathBuf>,
    /// No rows on standard output.
    pub quiet: bool,
    /// The raw recording.
    pub record: Option<PathBuf>,
    /// When a segment of the recording ends.
    pub rotation: Rotation,
    /// Which segments stay.
    pub retention: Retention,
    /// Where the reads are served.
    pub serve: Option<ServerOptions>,
    /// Where the page is served.
    pub web: Option<ServerOptions>,
    /// The token of servers, ours and that of the tap that is listened to.
    pub serve_token: Option<String>,
    /// Where to publish.
    pub broker: Option<Broker>,
    /// Transactions after which the tap ends.
    pub count: Option<usize>,
}

/// Reads the words after the program's name.
pub fn parse(words: &[String]) -> Result<Wanted, String> {
    let mut found = Options {
        bus: String::new(),
        port: String::new(),
        line: None,
        mode: None,
        output: None,
        quiet: false,
        record: None,
        rotation: Rotation::Never,
        retention: Retention::All,
        serve: None,
        web: None,
        serve_token: None,
        broker: None,
        count: None,
    };
    let (mut url, mut password_file, mut authorities) = (None, None, None);
    let (mut serve, mut web, mut token_file) = (None, None, None);
    let mut rest = words.iter().peekable();
    while let Some(word) = rest.next() {
        if word == "--web" {
            web = Some(rest.next_if(|next| is_place(next)).map_or(WEB_PLACE, String::as_str));
            continue;
        }
        let mut value = || rest.next().ok_or(format!("{word}: a value is missing"));
        match word.as_str() {
            "-h" | "--help" => return Ok(Wanted::Text(HELP.into())),
            "-V" | "--version" => return Ok(Wanted::Text(format!("modlens-tap {}\n", env!("CARGO_PKG_VERSION")))),
            "--line" => found.line = Some(told(word, value()?)?),
            "--mode" => found.mode = Some(mode(value()?)?),
            "-o" => found.output = Some(value()?.into()),
            "--quiet" => found.quiet = true,
            "--record" => found.record = Some(value()?.into()),
            "--rotate" => found.rotation = told(word, value()?)?,
            "--keep" => found.retention = told(word, value()?)?,
            "--serve" => serve = Some(value()?),
            "--serve-token-file" => token_file = Some(value()?),
            "--mqtt" => url = Some(value()?.clone()),
            "--mqtt-password-file" => password_file = Some(value()?.clone()),
            "--mqtt-ca" => authorities = Some(PathBuf::from(value()?)),
            "--count" => found.count = Some(value()?.parse().map_err(|_| "--count: write a number")?),
            _ if word.starts_with('-') => return Err(format!("{word}: no such option")),
            _ if found.port.is_empty() => (found.bus, found.port) = named(word),
            _ => return Err(format!("{word}: one port only")),
        }
    }
    if found.port.is_empty() {
        return Err("no port given".into());
    }
    if found.retention != Retention::All && found.rotation == Rotation::Never {
        return Err("--keep is for segments; add --rotate, as --rotate 1h".into());
    }
    found.serve_token = token(token_file)?;
    if let Some(place) = serve {
        let token = found.serve_token.clone();
        found.serve = Some(ServerOptions::parse(place, token).map_err(|why| format!("--serve {place}: {why}"))?);
    }
    if let Some(place) = web {
        if PAGE.is_empty() {
            return Err("--web: this program was built without the page; `make gateway` builds it in".into());
        }
        let token = found.serve_token.clone();
        found.web = Some(ServerOptions::with_page(place, token, PAGE.into()).map_err(|why| format!("--web {place}: {why}"))?);
    }
    if let Some(url) = url {
        found.broker = Some(Broker::parse(&url, password_file.as_deref(), authorities)?);
    }
    Ok(Wanted::Tap(Box::new(found)))
}

/// Whether a word is `[HOST:]PORT`, and not a port to listen to.
fn is_place(word: &str) -> bool {
    word.rsplit(':').next().is_some_and(|port| port.parse::<u16>().is_ok()) && !word.contains('/')
}

/// The token in this file, or else in the environment.
fn token(file: Option<&String>) -> Result<Option<String>, String> {
    let Some(path) = file else { return Ok(std::env::var("MODLENS_SERVE_TOKEN").ok().filter(|token| !token.is_empty())) };
    let text = std::fs::read_to_string(path).map_err(|error| format!("--serve-token-file {path}: {error}"))?;
    Ok(Some(text.trim().to_owned()))
}

/// What the value of an option means.
fn told<T: FromStr<Err = String>>(option: &str, value: &str) -> Result<T, String> {
    value.parse().map_err(|why| format!("{option} {value}: {why}"))
}

/// The name of a bus and its port, in `[BUS=]PORT`.
fn named(word: &str) -> (String, String) {
    match word.split_once('=') {
        Some((bus, port)) if !bus.contains('/') => (bus.into(), port.into()),
        _ => (word.into(), word.into()),
    }
}

fn mode(word: &str) -> Result<Mode, String> {
    match word {
        "rtu" => Ok(Mode::Rtu),
        "ascii" => Ok(Mode::Ascii),
        _ => Err(format!("--mode {word}: rtu or ascii")),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn tap(words: &[&str]) -> Result<Box<Options>, String> {
        match parse(&words.iter().map(ToString::to_string).collect::<Vec<_>>())? {
            Wanted::Tap(options) => Ok(options),
            Wanted::Text(text) => Err(text),
        }
    }

    #[test]
    fn times_sizes_and_names_are_read_as_modlens_tap_reads_them() {
        let found = tap(&["boiler=/dev/ttyUSB0", "--line", "9600-8N1", "--rotate", "1h30m", "--keep", "2GB"]).unwrap();
        assert_eq!((found.bus.as_str(), found.port.as_str()), ("boiler", "/dev/ttyUSB0"));
        assert_eq!(found.line.unwrap().to_string(), "9600-8N1");
        assert_eq!(found.rotation, Rotation::After(Duration::from_secs(5400)));
        assert_eq!(found.retention, Retention::Bytes(2_000_000_000));
        let found = tap(&["/dev/ttyUSB0", "--rotate", "64MB", "--keep", "168"]).unwrap();
        assert_eq!((found.rotation, found.retention), (Rotation::Bytes(64_000_000), Retention::Segments(168)));
    }

    #[test]
    fn the_place_of_the_page_may_be_left_out() {
        for word in ["4080", "0.0.0.0:4080", "[::1]:4080"] {
            assert!(is_place(word), "{word}");
        }
        for word in ["/dev/ttyUSB0", "--quiet", "COM3", "bus=/dev/ttyS1", "modlens://10.0.0.1:4010"] {
            assert!(!is_place(word), "{word}");
        }
    }

    #[test]
    fn the_line_is_served_on_loopback_unless_there_is_a_token() {
        let served = |words: &[&str]| tap(&[&["a"], words].concat()).map(|found| found.serve.unwrap().address.to_string());
        assert_eq!(served(&["--serve", "4010"]), Ok("127.0.0.1:4010".into()));
        assert!(served(&["--serve", "0.0.0.0:4010"]).unwrap_err().contains("set a token"));
        let token = std::env::temp_dir().join(format!("modlens_token_{}", std::process::id()));
        std::fs::write(&token, "a-token-of-sixteen\n").unwrap();
        let words = ["--serve", "0.0.0.0:4010", "--serve-token-file", token.to_str().unwrap()];
        assert_eq!(served(&words), Ok("0.0.0.0:4010".into()));
        std::fs::remove_file(token).unwrap();
    }

    #[test]
    fn wrong_use_is_told() {
        for words in [
            &["--line"][..],
            &[],
            &["a", "b"],
            &["a", "--rotate", "0h"],
            &["a", "--keep", "x"],
            &["a", "--keep", "2"],
            &["a", "--what"],
            &["a", "--serve", "gateway"],
            &["a", "--serve-token-file", "/no/such/file"],
        ] {
            assert!(tap(words).is_err(), "{words:?}");
        }
    }
}
