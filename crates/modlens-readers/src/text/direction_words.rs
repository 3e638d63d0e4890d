//! The words and arrows by which a text says who sent bytes, in the languages in which people and programs write logs.
//!
//! This is the only such table: what is in front of plain bytes (`prefix`), in the rest of a line (`proved::sender`), on a line
//! of its own (`reader::label`) and in what people expect (`reader::expectation`) is looked up here.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::sync::LazyLock;

use crate::chunk::Side;
use Rank::{Near, Noun, Party, Verb};
use Side::{Received, Sent};

/// How much a word shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rank {
    /// A verb, or an abbreviation of one: it says who sent the bytes after it.
    Verb,
    /// A name for a message: what counts where there is no verb. A request is what the program sends.
    Noun,
    /// It says so only next to the bytes.
    Near,
    /// Somebody who sends, if the word is next to the bytes and does not name the receiver: `to slave`.
    Party,
}

/// What a word says.
pub(super) type Meaning = (Side, Rank);

/// The words in lower case, with a blank between them.
const WORDS: &[(Side, Rank, &str)] = &[
    (Sent, Verb, "tx txd send sends sent sending transmit transmits transmitted transmitting writing wrote written outgoing"),
    (Received, Verb, "rx rxd recv rcvd rcv recd receive receives received receiving incoming answered answers replied replies"),
    (Received, Verb, "returned returns got gets"),
    (Sent, Noun, "request requests req query queries command cmd poll transmission"),
    (Received, Noun, "response responses resp rsp reply answer reception"),
    (Sent, Near, "write out"),
    (Received, Near, "read in"),
    (Sent, Party, "master client host pc"),
    (Received, Party, "slave device server"),
    // German
    (Sent, Verb, "gesendet gesendete sende senden sendet sendung versendet geschickt"),
    (Received, Verb, "empfangen empfangene empfange empfängt empfang erhalten erhalte erhält bekomme bekommt"),
    (Sent, Noun, "anfrage anforderung abfrage befehl"),
    (Received, Noun, "antwort rückmeldung"),
    // Dutch
    (Sent, Verb, "verzonden verstuurd verzenden"),
    (Received, Verb, "ontvangen ontvang ontvangt"),
    (Sent, Noun, "verzoek"),
    (Received, Noun, "antwoord"),
    // French
    (Sent, Verb, "envoyé envoyée envoi envoie émis émise"),
    (Received, Verb, "reçu reçue recu recue reçois reçoit réception"),
    (Sent, Noun, "requête requete demande"),
    (Received, Noun, "réponse reponse"),
    // Spanish and Portuguese
    (Sent, Verb, "enviado enviada enviando enviar envío envio transmitido"),
    (Received, Verb, "recibido recibida recibiendo recibir recibo recibe recebido recebida recebendo"),
    (Sent, Noun, "solicitud petición peticion consulta requisição requisicao pedido"),
    (Received, Noun, "respuesta resposta"),
    // Italian
    (Sent, Verb, "inviato inviata invio trasmesso"),
    (Received, Verb, "ricevuto ricevuta ricevo riceve ricezione"),
    (Sent, Noun, "richiesta"),
    (Received, Noun, "risposta"),
    // Polish and Czech
    (Sent, Verb, "wysłano wysłane wyslano wysyłam wysyłanie nadano odesláno odeslano odesílám"),
    (Received, Verb, "odebrano odebrane otrzymano otrzymane přijato prijato přijímám"),
    (Sent, Noun, "zapytanie żądanie zadanie dotaz"),
    (Received, Noun, "odpowiedź odpowiedz odpověď odpoved"),
    // Russian and Ukrainian
    (Sent, Verb, "отправлено отправил отправляю отправка послано послал передано передача передаю надіслано"),
    (Received, Verb, "получено получил получаю принято принял прием приём отримано"),
    (Sent, Noun, "запрос запит команда"),
    (Received, Noun, "ответ відповідь"),
    // Turkish, Hungarian, Swedish, Danish and Norwegian
    (Sent, Verb, "gönderildi gönderilen gonderildi gonderilen küldve küldött skickat sänt sendt"),
    (Received, Verb, "alındı alınan alindi alinan fogadva fogadott mottaget mottagen modtaget mottatt"),
    (Sent, Noun, "istek sorgu kérés"),
    (Received, Noun, "cevap yanıt válasz svar"),
    // Chinese, Japanese and Korean, also inside a word: between their words is no blank
    (Sent, Verb, "发送 發送 发出 发 發 送信 송신 전송"),
    (Received, Verb, "接收 收到 返回 回复 回應 回应 收 受信 수신"),
    (Sent, Noun, "请求 請求 询问 问询 要求 요청"),
    (Received, Noun, "响应 響應 应答 應答 応答 응답"),
    (Sent, Party, "主机 主站 上位机"),
    (Received, Party, "从机 从站 下位机"),
];

/// Arrows, longer ones before those that they begin or end with.
pub(super) const ARROWS: &[(&str, Side)] = &[
    ("\u{2192}", Sent),
    ("\u{2190}", Received),
    (">>>", Sent),
    ("<<<", Received),
    ("-->", Sent),
    ("<--", Received),
    ("==>", Sent),
    ("<==", Received),
    (">>", Sent),
    ("<<", Received),
    ("->", Sent),
    ("<-", Received),
    ("=>", Sent),
    ("<=", Received),
    (">", Sent),
    ("<", Received),
];

/// Words for the bytes themselves, which may be between them and the word that says who sent them, or end it: `txbuf`.
pub(super) const CONTAINERS: &[&str] = &[
    "buffer",
    "buf",
    "bytes",
    "byte",
    "data",
    "hex",
    "array",
    "raw",
    "frame",
    "packet",
    "payload",
    "message",
    "msg",
    "adu",
    "length",
    "len",
    "success",
    "status",
    "serial",
    "up",
    "down",
    "daten",
    "datos",
    "dane",
    "данные",
];

/// The letters from here on are of scripts without blanks between words.
const FIRST_UNSPACED: char = '\u{2E80}';

/// The longest word of the table in bytes.
const MAX_WORD_BYTES: usize = 24;

static MEANINGS: LazyLock<HashMap<&str, Meaning>> = LazyLock::new(|| {
    let each = |(side, rank, words): &(Side, Rank, &'static str)| {
        let (side, rank) = (*side, *rank);
        words.split(' ').map(move |word| (word, (side, rank)))
    };
    WORDS.iter().flat_map(each).collect()
});

/// The words that may be inside others: those for what somebody does before those for who it is, longer ones first.
static UNSPACED: LazyLock<Vec<(&str, Meaning)>> = LazyLock::new(|| {
    let is_unspaced = |word: &str| word.starts_with(|first| first >= FIRST_UNSPACED);
    let mut all: Vec<_> =
        MEANINGS.iter().filter(|(word, _)| is_unspaced(word)).map(|(word, meaning)| (*word, *meaning)).collect();
    all.sort_by_key(|(word, (_, rank))| (*rank == Party, Reverse(word.len()), *word));
    all
});

/// What a word in lower case says.
pub(super) fn meaning(word: &str) -> Option<Meaning> {
    let of_buffer = || CONTAINERS.iter().find_map(|name| MEANINGS.get(word.strip_suffix(name)?));
    MEANINGS.get(word).or_else(of_buffer).copied().or_else(|| unspaced(word, |word, known| word.contains(known)))
}

/// The meaning of the longest word without blanks around it that `has` finds.
fn unspaced(word: &str, has: impl Fn(&str, &str) -> bool) -> Option<Meaning> {
    if word.is_ascii() {
        return None;
    }
    let is_long = |known: &str| known.chars().nth(1).is_some() || known == word;
    UNSPACED.iter().find(|(known, _)| is_long(known) && has(word, known)).map(|(_, meaning)| *meaning)
}

/// Who sent what follows the word or arrow at the beginning of a text, and how long that is.
pub(super) fn leading(text: &[u8]) -> Option<(Side, usize)> {
    let first = *text.first()?;
    if first.is_ascii_alphabetic() || first >= 0xC3 {
        if let Some(found) = leading_word(text) {
            return Some(found);
        }
    }
    ARROWS.iter().find(|(sign, _)| text.starts_with(sign.as_bytes())).map(|(sign, side)| (*side, sign.len()))
}

/// The same of a word, after which no letter or digit stands.
fn leading_word(text: &[u8]) -> Option<(Side, usize)> {
    let end = text.iter().position(|b| !(b.is_ascii_alphabetic() || *b >= 0x80)).unwrap_or(text.len());
    let whole = String::from_utf8_lossy(&text[..end.min(2 * MAX_WORD_BYTES)]);
    let word: String = whole.chars().take_while(|c| c.is_alphabetic()).collect();
    if text.get(word.len()).is_some_and(u8::is_ascii_digit) {
        return None;
    }
    let known = MEANINGS.get(word.to_lowercase().as_str()).map(|meaning| (*meaning, word.len()));
    let begins = || UNSPACED.iter().find(|(known, _)| word.starts_with(known)).map(|(known, meaning)| (*meaning, known.len()));
    let ((side, rank), length) = known.or_else(|| if word.is_ascii() { None } else { begins() })?;
    (rank != Party).then_some((side, length))
}

/// The words of a text in lower case, each with the place where it begins. A word ends at a change from lower to upper case, as
/// in `onRxData`.
pub(super) fn words(text: &str) -> Vec<(usize, String)> {
    let mut words: Vec<(usize, String)> = Vec::new();
    let mut before = ' ';
    for (at, c) in text.char_indices() {
        if c.is_alphabetic() {
            let begins = !before.is_alphabetic() || (c.is_uppercase() && before.is_lowercase());
            if begins {
                words.push((at, String::new()));
            }
            if let Some((_, word)) = words.last_mut() {
                word.extend(c.to_lowercase());
            }
        }
        before = c;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_known_in_several_languages_and_inside_others() {
        for (word, expected) in [
            ("txbuf", Some((Sent, Verb))),
            ("rxdata", Some((Received, Verb))),
            ("antwort", Some((Received, Noun))),
            ("ответ", Some((Received, Noun))),
            ("发送帧", Some((Sent, Verb))),
            ("主机发送", Some((Sent, Verb))),
            ("从机", Some((Received, Party))),
            ("开发", None),
            ("text", None),
            ("buffer", None),
        ] {
            assert_eq!(meaning(word), expected, "{word}");
        }
    }

    #[test]
    fn a_text_begins_with_a_whole_word_or_an_arrow() {
        assert_eq!(leading(b"Tx: 01 03"), Some((Sent, 2)));
        assert_eq!(leading("Запрос: 01".as_bytes()), Some((Sent, 12)));
        assert_eq!(leading("发→◇01".as_bytes()), Some((Sent, 3)));
        assert_eq!(leading(b"<<< 01"), Some((Received, 3)));
        assert_eq!(leading(b"TX1 01 03"), None);
        assert_eq!(leading(b"master 01 03"), None);
        assert_eq!(leading(b"01 03"), None);
    }

    #[test]
    fn no_word_is_in_the_table_twice() {
        let all = WORDS.iter().map(|(_, _, words)| words.split(' ').count()).sum::<usize>();
        assert_eq!(MEANINGS.len(), all);
    }
}
