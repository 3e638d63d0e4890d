//! What a client asks for: nothing, which is the plain stream, or a request of HTTP (RFC 9112).

/// The longest request that is read.
pub const MAX_REQUEST_BYTES: usize = 4096;

/// The path of streams that also say how time advances while the line is silent.
pub const TIMED_PATH: &str = "/timed";

/// The path of the stream beside a page.
const RECORDING_PATH: &str = "/recording.pcapng";

const PAGE: &str = "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nCache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\nX-Frame-Options: DENY\r\nReferrer-Policy: no-referrer\r\nConnection: close\r\n\r\n";

const OK: &str = "HTTP/1.1 200 OK\r\nContent-Type: application/x-pcapng\r\nCache-Control: no-store\r\n\
    X-Content-Type-Options: nosniff\r\nCross-Origin-Resource-Policy: same-origin\r\nConnection: close\r\n\r\n";

/// How a request is answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The stream, after this head; `is_timed` as [`TIMED_PATH`].
    Stream { head: &'static str, is_timed: bool },
    /// The page, after this head.
    Page { head: &'static str },
    /// This text, and the end of the connection.
    Refused(String),
}

/// What requests are answered by.
#[derive(Clone, Copy, Debug)]
pub struct Terms<'a> {
    /// What clients have to know.
    pub token: Option<&'a str>,
    /// The page, which asks for the stream beside it.
    pub page: Option<&'a [u8]>,
}

/// The answer to a client that has sent nothing by now. A browser may open connections before it asks for something.
pub fn answer_silence(terms: Terms<'_>) -> Option<Answer> {
    (terms.token.is_none() && terms.page.is_none()).then_some(Answer::Stream { head: "", is_timed: false })
}

/// The answer to these bytes of a client; `None` while its request is not complete.
pub fn answer(bytes: &[u8], terms: Terms<'_>) -> Option<Answer> {
    let text = String::from_utf8_lossy(bytes);
    let Some((head, _)) = text.split_once("\r\n\r\n") else {
        return (bytes.len() >= MAX_REQUEST_BYTES).then(|| refuse("431 Request Header Fields Too Large", ""));
    };
    let mut lines = head.split("\r\n");
    let mut words = lines.next().unwrap_or_default().split(' ');
    let (method, target) = (words.next(), words.next().unwrap_or_default());
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let fields: Vec<(&str, &str)> = lines.filter_map(|line| line.split_once(':')).collect();
    let field = |name: &str| fields.iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value.trim());
    if method != Some("GET") {
        return Some(refuse("405 Method Not Allowed", "Allow: GET\r\n"));
    }
    let is_allowed = match terms.token {
        Some(token) => {
            let in_field = field("authorization").and_then(|value| value.strip_prefix("Bearer "));
            // A page cannot be opened with a field, so that its token is in its address.
            let in_query = query.split('&').find_map(|part| part.strip_prefix("token=")).filter(|_| terms.page.is_some());
            in_field.or(in_query).is_some_and(|it| is_same(it, token))
        }
        // A page in a browser that has its own name resolved to this computer must not read the line.
        None => field("host").is_none_or(is_address),
    };
    if !is_allowed {
        return Some(refuse("401 Unauthorized", "WWW-Authenticate: Bearer\r\n"));
    }
    Some(match path {
        "/" if terms.page.is_some() => Answer::Page { head: PAGE },
        RECORDING_PATH if terms.page.is_some() => Answer::Stream { head: OK, is_timed: true },
        _ if terms.page.is_some() => refuse("404 Not Found", ""),
        _ => Answer::Stream { head: OK, is_timed: path == TIMED_PATH },
    })
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
        answered(text, Terms { token, page: None })
    }

    fn answered(text: &str, terms: Terms<'_>) -> String {
        match answer(text.as_bytes(), terms) {
            None => "waits".into(),
            Some(Answer::Page { .. }) => "page".into(),
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
        assert_eq!(answer_silence(Terms { token: Some("secret"), page: None }), None);
    }

    #[test]
    fn a_page_has_its_stream_beside_it() {
        let local = Terms { token: None, page: Some(b"page") };
        let remote = Terms { token: Some("secret"), page: Some(b"page") };
        for (text, terms, expected) in [
            ("GET / HTTP/1.1\r\nHost: 127.0.0.1:4080\r\n\r\n", local, "page"),
            ("GET /recording.pcapng HTTP/1.1\r\nHost: localhost:4080\r\n\r\n", local, "stream true"),
            ("GET /recording.pcapng HTTP/1.1\r\nHost: evil.example:4080\r\n\r\n", local, "401"),
            ("GET /favicon.ico HTTP/1.1\r\nHost: localhost:4080\r\n\r\n", local, "404"),
            ("GET /timed HTTP/1.1\r\nHost: localhost:4080\r\n\r\n", local, "404"),
            ("POST / HTTP/1.1\r\nHost: localhost:4080\r\n\r\n", local, "405"),
            ("GET /?token=secret HTTP/1.1\r\nHost: gateway:4080\r\n\r\n", remote, "page"),
            ("GET /recording.pcapng?token=secret HTTP/1.1\r\nHost: gateway\r\n\r\n", remote, "stream true"),
            ("GET /recording.pcapng?token=secreT HTTP/1.1\r\nHost: gateway\r\n\r\n", remote, "401"),
            ("GET / HTTP/1.1\r\nHost: 127.0.0.1:4080\r\n\r\n", remote, "401"),
        ] {
            assert_eq!(answered(text, terms), expected, "{text:?}");
        }
        assert_eq!(asked("GET /?token=secret HTTP/1.1\r\nHost: gateway\r\n\r\n", Some("secret")), "401");
        assert_eq!(answer_silence(local), None);
    }
}
