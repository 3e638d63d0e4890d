//! What every publisher by MQTT says alike: how a broker's address is written, and which topics there are.
//!
//! - `PREFIX/status`: `online`, retained; `offline` as the last will
//! - `PREFIX/BUS/transaction`: a JSON object for each transaction
//! - `PREFIX/BUS/day`: the row of the bus and its day so far, retained
//! - `PREFIX/BUS/UNIT/NAME`: the last value of a register or coil, retained
//!
//! The connection is the publisher's matter.

/// Topics begin with it where the address names nothing else.
const DEFAULT_PREFIX: &str = "modlens";
const MAX_TOPIC_BYTES: usize = 65_535;
/// The registered ports (IANA): in the clear, and by TLS.
const PORTS: [u16; 2] = [1883, 8883];
const HELP: &str = "not the address of a broker; write mqtt://host or mqtts://user@host:8883/prefix";

/// Where a broker is, and how to log in.
#[derive(Clone, PartialEq, Eq)]
pub struct Address {
    /// By TLS.
    pub tls: bool,
    /// Its name or address.
    pub host: String,
    /// Its port.
    pub port: u16,
    /// The user, if there is one.
    pub user: Option<String>,
    /// The password, if there is one.
    pub password: Option<String>,
    /// A password is in the address, used or not, where everybody on the machine can read it.
    pub has_password: bool,
    /// The topics begin with it.
    pub prefix: String,
}

/// No password is printed.
impl std::fmt::Debug for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mqtt{}://{}:{}/{}", if self.tls { "s" } else { "" }, self.host, self.port, self.prefix)
    }
}

impl Address {
    /// Reads `mqtt[s]://[user[:password]@]host[:port][/prefix]`. A password from elsewhere goes before that of the address.
    /// What is wrong is said without repeating the address.
    ///
    /// ```
    /// use modlens_writers::mqtt::Address;
    /// let found = Address::parse("mqtts://tap@broker.example/plant", Some("secret".into())).unwrap();
    /// assert_eq!((found.to_string().as_str(), found.user.as_deref()), ("mqtts://broker.example:8883/plant", Some("tap")));
    /// ```
    pub fn parse(text: &str, password: Option<String>) -> Result<Self, String> {
        let (scheme, rest) = text.split_once("://").unwrap_or(("mqtt", text));
        let tls = match scheme.to_ascii_lowercase().as_str() {
            "mqtt" => false,
            "mqtts" => true,
            _ => return Err(HELP.into()),
        };
        let (place, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let (login, place) = place.rsplit_once('@').map_or((None, place), |(login, place)| (Some(login), place));
        let (user, written) =
            match login.map(|login| login.split_once(':').map_or((login, None), |(user, word)| (user, Some(word)))) {
                Some((user, word)) => (Some(decoded(user)?), word.map(decoded).transpose()?),
                None => (None, None),
            };
        let (host, port) = host_and_port(place)?;
        let has_password = written.is_some();
        let password = password.or(written);
        if password.is_some() && user.is_none() {
            return Err("a password without a user; write mqtt://user@host".into());
        }
        let port = port.unwrap_or(PORTS[usize::from(tls)]);
        Ok(Self { tls, host, port, user, password, has_password, prefix: checked_prefix(&decoded(prefix)?)? })
    }

    /// The topic of the state of the tap.
    pub fn status(&self) -> String {
        format!("{}/status", self.prefix)
    }

    /// A topic of a bus: `transaction` or `day`.
    pub fn of_bus(&self, bus: &str, what: &str) -> String {
        format!("{}/{}/{what}", self.prefix, level(bus))
    }
}

/// A name as one level of a topic, without wildcards and separators.
///
/// ```
/// assert_eq!(modlens_writers::mqtt::level("/dev/ttyUSB0"), "dev_ttyUSB0");
/// ```
pub fn level(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    let mut is_replacing = false;
    for one in name.chars() {
        let stays = one.is_alphanumeric() || matches!(one, '_' | '.' | '-');
        if stays || !is_replacing {
            text.push(if stays { one } else { '_' });
        }
        is_replacing = !stays;
    }
    let text = text.trim_matches('_');
    if text.is_empty() { "_" } else { text }.to_owned()
}

/// The host without the brackets of an IPv6 address, and the port if one is written.
fn host_and_port(place: &str) -> Result<(String, Option<u16>), String> {
    let (host, port) = match place.strip_prefix('[') {
        Some(rest) => {
            let (host, behind) = rest.split_once(']').ok_or(HELP)?;
            match behind.strip_prefix(':') {
                Some(port) => (host, port),
                None if behind.is_empty() => (host, ""),
                None => return Err(HELP.into()),
            }
        }
        None => place.split_once(':').unwrap_or((place, "")),
    };
    let port = match port {
        "" => None,
        port => Some(port.parse().ok().filter(|port| *port > 0).ok_or(HELP)?),
    };
    if host.is_empty() || host.contains(char::is_whitespace) {
        return Err(HELP.into());
    }
    Ok((host.to_ascii_lowercase(), port))
}

/// The prefix, if it can begin a topic that is published to (MQTT 5.0, 4.7).
fn checked_prefix(text: &str) -> Result<String, String> {
    let prefix = match text.trim_matches('/') {
        "" => DEFAULT_PREFIX,
        prefix => prefix,
    };
    if let Some(wrong) = ['+', '#', '\0'].into_iter().find(|one| prefix.contains(*one)) {
        return Err(format!("the prefix {prefix:?} holds {wrong:?}, a wildcard of topics"));
    }
    if prefix.starts_with('$') {
        return Err(format!("the prefix {prefix:?} begins with $, which is for the broker"));
    }
    if prefix.contains("//") || prefix.len() > MAX_TOPIC_BYTES / 2 {
        return Err(format!("the prefix {prefix:?} has an empty level or is too long"));
    }
    Ok(prefix.to_owned())
}

/// Percent-encoded text of a URL (RFC 3986, 2.1).
fn decoded(text: &str) -> Result<String, String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, behind @ ..] = rest {
        let digits = behind.get(..2).filter(|digits| digits.iter().all(u8::is_ascii_hexdigit));
        let digits = digits.and_then(|digits| std::str::from_utf8(digits).ok());
        match digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()) {
            Some(byte) if *first == b'%' => {
                bytes.push(byte);
                rest = &behind[2..];
            }
            _ => {
                bytes.push(*first);
                rest = behind;
            }
        }
    }
    String::from_utf8(bytes).map_err(|_| HELP.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_an_address_are_read() {
        let found = Address::parse("mqtts://plant@broker.example:8884/site/a", None).unwrap();
        assert_eq!((found.host.as_str(), found.port, found.prefix.as_str()), ("broker.example", 8884, "site/a"));
        assert_eq!((found.user.as_deref(), found.tls, found.has_password), (Some("plant"), true, false));
        let found = Address::parse("mqtt://[::1]", None).unwrap();
        assert_eq!((found.host.as_str(), found.port, found.prefix.as_str()), ("::1", 1883, "modlens"));
        let found = Address::parse("broker", None).unwrap();
        assert_eq!((found.host.as_str(), found.port, found.tls), ("broker", 1883, false));
    }

    #[test]
    fn a_password_from_elsewhere_goes_first() {
        let url = "mqtt://tap:of%20the%20URL@broker";
        assert_eq!(Address::parse(url, None).unwrap().password.as_deref(), Some("of the URL"));
        let found = Address::parse(url, Some("of the file".into())).unwrap();
        assert_eq!((found.password.as_deref(), found.has_password), (Some("of the file"), true));
        assert!(!format!("{found} {found:?}").contains("file"));
        assert!(Address::parse("mqtt://broker", Some("secret".into())).is_err());
    }

    #[test]
    fn what_is_no_address_is_refused_without_repeating_it() {
        for url in ["http://host", "mqtt://", "mqtt://u:secret@host:x", "mqtt://[::1", "mqtt://host:0", "mqtt://a b"] {
            let said = Address::parse(url, None).unwrap_err();
            assert!(said.contains("not the address") && !said.contains("secret"), "{url}: {said}");
        }
        for (url, why) in [
            ("mqtt://host/a/#", "wildcard"),
            ("mqtt://host/a/%2B/b", "wildcard"),
            ("mqtt://host/$SYS", "for the broker"),
            ("mqtt://host/a//b", "empty level"),
        ] {
            assert!(Address::parse(url, None).unwrap_err().contains(why), "{url}");
        }
    }

    #[test]
    fn a_name_is_one_level_of_a_topic() {
        for (name, expected) in
            [("/dev/ttyUSB0", "dev_ttyUSB0"), ("a/+ #b", "a_b"), ("Süd.1-a_b", "Süd.1-a_b"), ("#", "_"), ("a_/b", "a__b")]
        {
            assert_eq!(level(name), expected);
        }
    }
}
