//! The connection to a broker, in the clear or by TLS, and where its password comes from.

use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use modlens_writers::mqtt::Address;
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
#[derive(Clone)]
pub struct Broker {
    /// Where it is, and how to log in.
    pub address: Address,
    /// The certificates to trust; those of the system where `None`.
    pub authorities: Option<PathBuf>,
}

/// A connection, read with a short timeout.
pub trait Stream: Read + Write + Send {}
impl<T: Read + Write + Send> Stream for T {}

impl Broker {
    /// Reads `mqtt[s]://[user@]host[:port]/prefix`. A password has no place in it: everybody on the machine could read it,
    /// for as long as the service runs.
    pub fn parse(url: &str, password_file: Option<&str>, authorities: Option<PathBuf>) -> Result<Self, String> {
        let address = Address::parse(url, password(password_file)?).map_err(|why| format!("--mqtt: {why}"))?;
        if address.has_password {
            return Err("--mqtt: a password in the URL can be read by everybody here; use --mqtt-password-file".into());
        }
        if authorities.is_some() && !address.tls {
            return Err("--mqtt-ca needs TLS: write mqtts://host".into());
        }
        Ok(Self { address, authorities })
    }

    /// Connects; a broker that cannot prove its name is refused.
    pub fn connect(&self) -> io::Result<Box<dyn Stream>> {
        let mut last = io::Error::other("no address");
        for address in (self.address.host.as_str(), self.address.port).to_socket_addrs()? {
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
        if !self.address.tls {
            stream.set_read_timeout(Some(READ_TIMEOUT))?;
            return Ok(Box::new(stream));
        }
        let name = ServerName::try_from(self.address.host.clone()).map_err(io::Error::other)?;
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
    fn a_password_in_the_url_is_refused_and_not_repeated() {
        let found = Broker::parse("mqtts://plant@broker.example:8884/site/a", None, Some("ca.pem".into())).unwrap();
        assert_eq!((found.address.port, found.address.prefix.as_str()), (8884, "site/a"));
        for url in ["http://host", "mqtt://", "mqtt://user:secret@host", "mqtt://host:x", "mqtt://host/a/#"] {
            let said = Broker::parse(url, None, None).err().unwrap();
            assert!(said.starts_with("--mqtt: ") && !said.contains("secret"), "{url}: {said}");
        }
        assert!(Broker::parse("mqtt://host", None, Some("ca.pem".into())).is_err());
    }
}
