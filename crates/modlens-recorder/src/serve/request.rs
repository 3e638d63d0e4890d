//! What a client asks for: nothing, which is the plain stream, or a request of HTTP (RFC 9112).

/// The longest request that is read.
pub const MAX_REQUEST_BYTES: usize = 4096;

/// The path of streams that also say how time advances while the line is silent.
pub const TIMED_PATH: &str = "/timed";

const OK: &str = "HTTP/1.1 200 OK\r\nContent-Type: application/x-pcapng\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n";

/// How a request is answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The stream, after this head; `is_timed` as [`TIMED_PATH`].
    Stream { head: &'static str, is_timed: bool },
    /// This text, and the end of the connection.
    Refused(String),
}

/// The answer to a client that has sent nothing by now.
pub fn answer_silence(token: Option<&str>) -> Option<Answer> {
    token.is_none().then_some(Answer::Stream { head: "", is_timed: false })
}

/// The answer to these bytes of a client; `None` while its request is not complete.
pub fn answer(bytes: &[u8], token: Option<&str>) -> Option<Answer> {
    let text = String::from_utf8_lossy(bytes);
    let Some((head, _)) = text.split_once("\r\n\r\n") else {
        return (bytes.len() >= MAX_REQUEST_BYTES).then(|| refuse("431 Request Header Fields Too Large", ""));
    };
    let mut lines = head.split("\r\n");
    let mut words = lines.next().unwrap_or_default().split(' ');
    let (method, path) = (words.next(), words.next().unwrap_or_default());
    let fields: Vec<(&str, &str)> = lines.filter_map(|line| line.split_once(':')).collect();
    let field = |name: &str| fields.iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value.trim());
    if method != Some("GET") {
        return Some(refuse("405 Method Not Allowed", "Allow: GET\r\n"));
    }
    let is_allowed = match token {
        Some(token) => {
            field("authorization").and_then(|value| value.strip_prefix("Bearer ")).is_some_and(|it| is_same(it, token))
        }
        // A page in a browser that has its own name resolved to this computer must not read the line.
        None => field("host").is_none_or(is_address),
    };
    if !is_allowed {
        return Some(refuse("401 Unauthorized", "WWW-Authenticate: Bearer\r\n"));
    }
    Some(Answer::Stream { head: OK, is_timed: path == TIMED_PATH })
}

/// A refusal with further header fields.
pub fn refuse(status: &str, fields: &str) -> Answer {
    Answer::Refused(format!("HTTP/1.1 {status}\r\n{fields}Content-Length: 0\r\nConnection: close\r\n\r\n"))
}

/// Compares a secret in a time that does not tell how much of it is right.
fn is_same(given: &str, secret: &str) -> bool {
    let differing = given.bytes().zip(secret.bytes()).fold(0, |found, (one, other)| found | (one ^ other));
    given.len() == secret.len() && differing == 0
}

/// Whether a `Host` field names an address or this computer.
fn is_address(host: &str) -> bool {
    let name = host.parse::<std::net::SocketAddr>().is_ok() || host.parse::<std::net::IpAddr>().is_ok();
    let bare = host.rsplit_once(':').map_or(host, |(bare, _)| bare);
    name || bare.eq_ignore_ascii_case("localhost") || bare.trim_matches(['[', ']']).parse::<std::net::IpAddr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(text: &str, token: Option<&str>) -> String {
        match answer(text.as_bytes(), token) {
            None => "waits".into(),
            Some(Answer::Stream { is_timed, .. }) => format!("stream {is_timed}"),
            Some(Answer::Refused(text)) => text[9..12].into(),
        }
    }

    #[test]
    fn requests_are_answered_as_http_says() {
        for (text, token, expected) in [
            ("GET / HTTP/1.1\r\nHost: 127.0.0.1:4010\r\n\r\n", None, "stream false"),
            ("GET /timed HTTP/1.1\r\nhost: localhost:4010\r\n\r\n", None, "stream true"),
            ("GET / HTTP/1.0\r\n\r\n", None, "stream false"),
            ("GET / HTTP/1.1\r\nHost: [::1]:4010\r\n\r\n", None, "stream false"),
            ("GET / HTTP/1.1\r\nHost: evil.example:4010\r\n\r\n", None, "401"),
            ("GET / HTTP/1.1\r\nHost: gateway:4010\r\nAuthorization: Bearer secret\r\n\r\n", Some("secret"), "stream false"),
            ("GET / HTTP/1.1\r\nHost: 10.0.0.1\r\nAuthorization: Bearer secre\r\n\r\n", Some("secret"), "401"),
            ("GET / HTTP/1.1\r\nHost: 10.0.0.1\r\n\r\n", Some("secret"), "401"),
            ("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", None, "405"),
            ("GET / HTTP/1.1\r\nHost: 127", None, "waits"),
        ] {
            assert_eq!(asked(text, token), expected, "{text:?}");
        }
        assert_eq!(asked(&"x".repeat(MAX_REQUEST_BYTES), None), "431");
        assert_eq!(answer_silence(Some("secret")), None);
    }
}
