//! Where to publish: the URL of a broker, and the connection to it, in the clear or by TLS.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned};

/// Where systems keep the certificates that they trust.
const SYSTEM_AUTHORITIES: [&str; 4] =
    ["/etc/ssl/certs/ca-certificates.crt", "/etc/pki/tls/certs/ca-bundle.crt", "/etc/ssl/ca-bundle.pem", "/etc/ssl/cert.pem"];
const PASSWORD_VARIABLE: &str = "MODLENS_MQTT_PASSWORD";
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Reading waits for so long, so that the writer has its turn.
const READ_TIMEOUT: Duration = Duration::from_millis(20);
const WRITE_TIMEOUT: Duration = Duration::from_secs(20);

/// A broker.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broker {
    /// Its name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The topics begin with it.
    pub prefix: String,
    /// The user, if there is one.
    pub user: Option<String>,
    /// The password, if there is one.
    pub password: Option<String>,
    /// By TLS.
    pub tls: bool,
    /// The certificates to trust; those of the system where `None`.
    pub authorities: Option<PathBuf>,
}

/// A connection, read with a short timeout.
pub trait Stream: Read + Write + Send {}
impl<T: Read + Write + Send> Stream for T {}

impl Broker {
    /// Reads `mqtt[s]://[user@]host[:port]/prefix`. A password has no place in it: everybody on the machine could read it.
    pub fn parse(url: &str, password_file: Option<&str>, authorities: Option<PathBuf>) -> Result<Self, String> {
        let help = || format!("--mqtt {url}: write mqtt://host or mqtts://user@host:8883/prefix");
        let (tls, rest) = match url.split_once("://") {
            Some(("mqtt", rest)) => (false, rest),
            Some(("mqtts", rest)) => (true, rest),
            _ => return Err(help()),
        };
        let (place, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let (user, place) = place.rsplit_once('@').map_or((None, place), |(user, place)| (Some(user.to_owned()), place));
        if user.as_ref().is_some_and(|user| user.contains(':')) {
            return Err("--mqtt: a password in the URL can be read by everybody here; use --mqtt-password-file".into());
        }
        let default = if tls { 8883 } else { 1883 };
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) if !port.contains(']') => (host, port.parse().map_err(|_| help())?),
            _ => (place, default),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
        let prefix = if prefix.is_empty() { "modlens" } else { prefix.trim_end_matches('/') }.to_owned();
        if host.is_empty() || prefix.contains(['#', '+']) {
            return Err(help());
        }
        let password = password(password_file)?;
        Ok(Self { host, port, prefix, user, password, tls, authorities })
    }

    /// Connects; a broker that cannot prove its name is refused.
    pub fn connect(&self) -> io::Result<Box<dyn Stream>> {
        let mut last = io::Error::other("no address");
        for address in (self.host.as_str(), self.port).to_socket_addrs()? {
            match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
                Ok(stream) => return self.secured(stream),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    fn secured(&self, mut stream: TcpStream) -> io::Result<Box<dyn Stream>> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
        if !self.tls {
            stream.set_read_timeout(Some(READ_TIMEOUT))?;
            return Ok(Box::new(stream));
        }
        let name = ServerName::try_from(self.host.clone()).map_err(io::Error::other)?;
        let mut session = ClientConnection::new(self.tls_settings()?, name).map_err(io::Error::other)?;
        stream.set_read_timeout(Some(CONNECT_TIMEOUT))?;
        while session.is_handshaking() {
            session.complete_io(&mut stream)?;
        }
        stream.set_read_timeout(Some(READ_TIMEOUT))?;
        Ok(Box::new(StreamOwned::new(session, stream)))
    }

    fn tls_settings(&self) -> io::Result<Arc<ClientConfig>> {
        let path = match &self.authorities {
            Some(path) => path.clone(),
            None => SYSTEM_AUTHORITIES
                .iter()
                .map(PathBuf::from)
                .find(|path| path.exists())
                .ok_or_else(|| io::Error::other("no certificates of the system; give --mqtt-ca FILE"))?,
        };
        let mut roots = RootCertStore::empty();
        for one in CertificateDer::pem_file_iter(&path).map_err(io::Error::other)? {
            // The system's file may hold certificates that nobody can use any more.
            let _ = roots.add(one.map_err(io::Error::other)?);
        }
        if roots.is_empty() {
            return Err(io::Error::other(format!("{}: no certificate in it", path.display())));
        }
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let settings = ClientConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .map_err(io::Error::other)?
            .with_root_certificates(roots)
            .with_no_client_auth();
        Ok(Arc::new(settings))
    }
}

fn password(file: Option<&str>) -> Result<Option<String>, String> {
    match file {
        Some(path) => {
            let text = std::fs::read_to_string(path).map_err(|error| format!("--mqtt-password-file {path}: {error}"))?;
            Ok(Some(text.trim_end_matches(['\r', '\n']).to_owned()))
        }
        None => Ok(std::env::var(PASSWORD_VARIABLE).ok()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_url_are_read() {
        let found = Broker::parse("mqtts://plant@broker.example:8884/site/a", None, None).unwrap();
        assert_eq!((found.host.as_str(), found.port, found.prefix.as_str()), ("broker.example", 8884, "site/a"));
        assert_eq!((found.user.as_deref(), found.tls), (Some("plant"), true));
        let found = Broker::parse("mqtt://[::1]", None, None).unwrap();
        assert_eq!((found.host.as_str(), found.port, found.prefix.as_str()), ("::1", 1883, "modlens"));
        for url in ["http://host", "mqtt://", "mqtt://user:secret@host", "mqtt://host:x", "mqtt://host/a/#"] {
            assert!(Broker::parse(url, None, None).is_err(), "{url}");
        }
    }
}
