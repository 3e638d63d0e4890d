//! Cuts the text of a filter into tokens.

/// A token with its place, in characters.
#[derive(Clone, Debug)]
pub struct Token {
    pub kind: TokenKind,
    pub start: usize,
    pub end: usize,
}

#[derive(Clone, Debug, PartialEq)]
pub enum TokenKind {
    Word(String),
    /// A whole number; `None` if it needs more than 64 bits.
    Integer(Option<i64>),
    Float(f64),
    Imaginary,
    Text(String),
    Bytes,
    /// A text with places for values.
    Template,
    Sign(&'static str),
    /// What cannot be read, and why. It is the last token.
    Bad(&'static str),
    End,
}

/// Signs, the longest first.
const SIGNS: &[&str] = &[
    "...", "**", "//", "==", "!=", "<=", ">=", "<<", ">>", ":=", "(", ")", "[", "]", "{", "}", ",", ":", ".", "+", "-", "*", "/",
    "%", "&", "|", "^", "~", "<", ">", "=", "@",
];

const TOO_FEW_QUOTES: &str = "a text without its closing quote";
const NO_NUMBER: &str = "a number with something after it";
const LEADING_ZEROS: &str = "a number has no leading zeros";

/// The tokens of a text; the last one is `End` or `Bad`.
pub fn tokens(text: &[char]) -> Vec<Token> {
    let mut lexer = Lexer { text, at: 0, open: 0 };
    let mut found = Vec::new();
    loop {
        let token = lexer.next();
        let is_last = matches!(token.kind, TokenKind::End | TokenKind::Bad(_));
        found.push(token);
        if is_last {
            return found;
        }
    }
}

struct Lexer<'a> {
    text: &'a [char],
    at: usize,
    /// Brackets that are open: lines may end inside of them.
    open: usize,
}

impl Lexer<'_> {
    fn peek(&self, ahead: usize) -> char {
        self.text.get(self.at + ahead).copied().unwrap_or('\0')
    }

    fn next(&mut self) -> Token {
        self.skip_blanks();
        let start = self.at;
        let kind = self.kind();
        Token { kind, start, end: self.at }
    }

    fn skip_blanks(&mut self) {
        loop {
            match self.peek(0) {
                ' ' | '\t' | '\u{c}' => self.at += 1,
                '\n' | '\r' if self.open > 0 => self.at += 1,
                '#' => {
                    while self.at < self.text.len() && self.peek(0) != '\n' {
                        self.at += 1;
                    }
                }
                _ => return,
            }
        }
    }

    fn kind(&mut self) -> TokenKind {
        let Some(&first) = self.text.get(self.at) else { return TokenKind::End };
        if first.is_ascii_digit() || (first == '.' && self.peek(1).is_ascii_digit()) {
            return self.number();
        }
        if first == '_' || first.is_alphabetic() {
            return self.word();
        }
        if first == '\'' || first == '"' {
            return self.string("");
        }
        let rest: String = self.text[self.at..].iter().take(3).collect();
        let Some(sign) = SIGNS.iter().find(|sign| rest.starts_with(**sign)) else {
            return TokenKind::Bad("a sign that filters do not have");
        };
        self.at += sign.len();
        match *sign {
            "(" | "[" | "{" => self.open += 1,
            ")" | "]" | "}" => self.open = self.open.saturating_sub(1),
            _ => {}
        }
        TokenKind::Sign(sign)
    }

    fn word(&mut self) -> TokenKind {
        let start = self.at;
        while self.peek(0) == '_' || self.peek(0).is_alphanumeric() {
            self.at += 1;
        }
        let word: String = self.text[start..self.at].iter().collect();
        let is_prefix = word.len() <= 2 && word.chars().all(|letter| "rRbBfFuU".contains(letter));
        if is_prefix && matches!(self.peek(0), '\'' | '"') {
            return self.string(&word.to_lowercase());
        }
        TokenKind::Word(word)
    }

    // ---- numbers

    fn digits(&mut self, radix: u32) -> String {
        let mut found = String::new();
        while self.peek(0).is_digit(radix) || (self.peek(0) == '_' && self.peek(1).is_digit(radix)) {
            if self.peek(0) != '_' {
                found.push(self.peek(0));
            }
            self.at += 1;
        }
        found
    }

    fn number(&mut self) -> TokenKind {
        let radix = match self.peek(1) {
            'x' | 'X' => 16,
            'o' | 'O' => 8,
            'b' | 'B' => 2,
            _ => 10,
        };
        let kind = if self.peek(0) == '0' && radix != 10 { self.with_radix(radix) } else { self.decimal() };
        // A word such as `and` may follow without a space.
        let word: String = self.text[self.at..].iter().take_while(|one| one.is_alphanumeric() || **one == '_').collect();
        let is_apart = word.is_empty() || ["and", "else", "for", "if", "in", "is", "not", "or"].contains(&&*word);
        if is_apart {
            kind
        } else {
            TokenKind::Bad(NO_NUMBER)
        }
    }

    fn with_radix(&mut self, radix: u32) -> TokenKind {
        self.at += 2;
        if self.peek(0) == '_' {
            self.at += 1;
        }
        let digits = self.digits(radix);
        if digits.is_empty() {
            return TokenKind::Bad(NO_NUMBER);
        }
        TokenKind::Integer(i64::from_str_radix(&digits, radix).ok())
    }

    fn decimal(&mut self) -> TokenKind {
        let mut text = self.digits(10);
        let mut is_whole = true;
        if self.peek(0) == '.' {
            self.at += 1;
            is_whole = false;
            text = format!("{text}.{}", self.digits(10));
        }
        let sign = usize::from(matches!(self.peek(1), '+' | '-'));
        if matches!(self.peek(0), 'e' | 'E') && self.peek(1 + sign).is_ascii_digit() {
            is_whole = false;
            text.push('e');
            if self.peek(1) == '-' {
                text.push('-');
            }
            self.at += 1 + sign;
            text += &self.digits(10);
        }
        if matches!(self.peek(0), 'j' | 'J') {
            self.at += 1;
            return TokenKind::Imaginary;
        }
        if !is_whole {
            return text.parse().map_or(TokenKind::Bad(NO_NUMBER), TokenKind::Float);
        }
        if text.starts_with('0') && text.bytes().any(|digit| digit != b'0') {
            return TokenKind::Bad(LEADING_ZEROS);
        }
        TokenKind::Integer(text.parse().ok())
    }

    // ---- texts

    fn string(&mut self, prefix: &str) -> TokenKind {
        let quote = self.peek(0);
        let is_long = self.peek(1) == quote && self.peek(2) == quote;
        self.at += if is_long { 3 } else { 1 };
        let mut found = String::new();
        loop {
            let Some(&letter) = self.text.get(self.at) else { return TokenKind::Bad(TOO_FEW_QUOTES) };
            if letter == '\n' && !is_long {
                return TokenKind::Bad(TOO_FEW_QUOTES);
            }
            let is_end = letter == quote && (!is_long || (self.peek(1) == quote && self.peek(2) == quote));
            if is_end {
                self.at += if is_long { 3 } else { 1 };
                break;
            }
            self.at += 1;
            if letter != '\\' {
                found.push(letter);
            } else if prefix.contains('r') {
                found.push(letter);
                found.extend(self.text.get(self.at));
                self.at += 1;
            } else if self.escape(&mut found).is_none() {
                return TokenKind::Bad("an escape that cannot be read");
            }
        }
        match prefix {
            _ if prefix.contains('b') => TokenKind::Bytes,
            _ if prefix.contains('f') => TokenKind::Template,
            _ => TokenKind::Text(found),
        }
    }

    /// Appends what stands for the letters after a backslash.
    fn escape(&mut self, out: &mut String) -> Option<()> {
        let letter = self.peek(0);
        self.at += 1;
        let length = match letter {
            '\n' => return Some(()),
            'x' => 2,
            'u' => 4,
            'U' => 8,
            '0'..='7' => {
                let mut code = letter.to_digit(8)?;
                for _ in 0..2 {
                    let Some(digit) = self.peek(0).to_digit(8) else { break };
                    code = code * 8 + digit;
                    self.at += 1;
                }
                out.push(char::from_u32(code)?);
                return Some(());
            }
            'N' => return None,
            _ => {
                match "abfnrtv\\'\"".find(letter) {
                    Some(place) => out.push(char::from(b"\x07\x08\x0c\n\r\t\x0b\\'\""[place])),
                    None => out.extend(['\\', letter]),
                }
                return Some(());
            }
        };
        let digits: String = self.text.get(self.at..self.at + length)?.iter().collect();
        self.at += length;
        out.push(char::from_u32(u32::from_str_radix(&digits, 16).ok()?)?);
        Some(())
    }
}
