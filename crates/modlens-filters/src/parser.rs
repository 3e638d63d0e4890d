//! Reads the syntax of a filter: a part of Python's expressions, and so much of the rest that its place can be named.

use crate::lexer::{tokens, Token, TokenKind};
use crate::syntax::{level_of, Kind, Node, BINARY, COMPARISONS, KEYWORDS};

/// The deepest nesting that is read.
const MAX_NESTING: usize = 200;

/// Why a text is no expression, and where.
#[derive(Debug)]
pub struct SyntaxError {
    pub message: String,
    pub at: usize,
}

type Parsed = Result<Node, SyntaxError>;

/// Reads a text as one expression.
pub fn parse(text: &str) -> Parsed {
    let letters: Vec<char> = text.chars().collect();
    let mut parser = Parser { tokens: tokens(&letters), at: 0, depth: 0 };
    let found = parser.expressions()?;
    match parser.peek() {
        TokenKind::End => Ok(found),
        _ => Err(parser.unexpected()),
    }
}

struct Parser {
    tokens: Vec<Token>,
    at: usize,
    depth: usize,
}

impl Parser {
    // ---- tokens

    fn peek(&self) -> &TokenKind {
        &self.tokens[self.at].kind
    }

    fn start(&self) -> usize {
        self.tokens[self.at].start
    }

    /// Where the last token ended.
    fn end(&self) -> usize {
        self.at.checked_sub(1).map_or(0, |before| self.tokens[before].end)
    }

    fn is_word(&self, word: &str) -> bool {
        matches!(self.peek(), TokenKind::Word(found) if found == word)
    }

    fn is_sign(&self, sign: &str) -> bool {
        matches!(self.peek(), TokenKind::Sign(found) if *found == sign)
    }

    fn advance(&mut self) {
        self.at = (self.at + 1).min(self.tokens.len() - 1);
    }

    /// Whether the next token is this word or sign; it is taken then.
    fn takes(&mut self, token: &str) -> bool {
        let found = self.is_word(token) || self.is_sign(token);
        if found {
            self.advance();
        }
        found
    }

    fn expect(&mut self, token: &str) -> Result<(), SyntaxError> {
        if self.takes(token) {
            Ok(())
        } else {
            Err(self.unexpected())
        }
    }

    fn unexpected(&self) -> SyntaxError {
        let Token { kind, start, .. } = &self.tokens[self.at];
        if let (TokenKind::End, Some((sign, at))) = (kind, self.open_bracket()) {
            return SyntaxError { message: format!("`{sign}` is never closed"), at };
        }
        let message = match kind {
            TokenKind::Bad(why) => (*why).to_owned(),
            TokenKind::End => String::from("something is missing at its end"),
            TokenKind::Word(word) => format!("`{word}` cannot stand here"),
            TokenKind::Sign(sign) => format!("`{sign}` cannot stand here"),
            _ => String::from("something is missing before this value"),
        };
        SyntaxError { message, at: *start }
    }

    /// The innermost bracket that nothing closes, and its place.
    fn open_bracket(&self) -> Option<(&'static str, usize)> {
        let mut open = Vec::new();
        for token in &self.tokens {
            match token.kind {
                TokenKind::Sign(sign @ ("(" | "[" | "{")) => open.push((sign, token.start)),
                TokenKind::Sign(")" | "]" | "}") => drop(open.pop()),
                _ => {}
            }
        }
        open.pop()
    }

    fn node(&self, kind: Kind, start: usize) -> Node {
        Node { kind, start, end: self.end() }
    }

    /// Reads a part that may hold others of its kind.
    fn nested(&mut self, read: impl FnOnce(&mut Self) -> Parsed) -> Parsed {
        if self.depth == MAX_NESTING {
            return Err(SyntaxError { message: String::from("nested too deeply"), at: self.start() });
        }
        self.depth += 1;
        let found = read(self);
        self.depth -= 1;
        found
    }

    // ---- conditions

    /// One expression, or several with commas between them.
    fn expressions(&mut self) -> Parsed {
        let start = self.start();
        let first = self.element()?;
        if !self.is_sign(",") {
            return Ok(first);
        }
        let items = self.further_items(first)?;
        Ok(self.node(Kind::Tuple(items), start))
    }

    /// The items after a first one, with commas between them.
    fn further_items(&mut self, first: Node) -> Result<Vec<Node>, SyntaxError> {
        let mut items = vec![first];
        while self.takes(",") && !self.is_behind() {
            items.push(self.element()?);
        }
        Ok(items)
    }

    /// Whether no further item can follow.
    fn is_behind(&self) -> bool {
        matches!(self.peek(), TokenKind::End | TokenKind::Sign(")" | "]" | "}"))
    }

    /// An item of a list: an expression, or what Python has beside it.
    fn element(&mut self) -> Parsed {
        let start = self.start();
        if self.takes("*") || self.takes("**") {
            self.binary(1)?;
            return Ok(self.node(Kind::Other, start));
        }
        let found = self.expression()?;
        if matches!(found.kind, Kind::Name(_)) && self.takes(":=") {
            self.expression()?;
            return Ok(self.node(Kind::Other, start));
        }
        Ok(found)
    }

    fn expression(&mut self) -> Parsed {
        self.nested(|parser| {
            let start = parser.start();
            if parser.takes("lambda") {
                return parser.lambda(start);
            }
            let found = parser.joined("or")?;
            if !parser.takes("if") {
                return Ok(found);
            }
            parser.joined("or")?;
            parser.expect("else")?;
            parser.expression()?;
            Ok(parser.node(Kind::Other, start))
        })
    }

    fn lambda(&mut self, start: usize) -> Parsed {
        while !self.takes(":") {
            match self.peek() {
                TokenKind::Word(word) if !KEYWORDS.contains(&word.as_str()) => self.advance(),
                TokenKind::Sign("," | "*" | "**" | "/") => self.advance(),
                TokenKind::Sign("=") => {
                    self.advance();
                    self.expression()?;
                }
                _ => return Err(self.unexpected()),
            }
        }
        self.expression()?;
        Ok(self.node(Kind::Other, start))
    }

    /// Conditions joined by this word.
    fn joined(&mut self, word: &'static str) -> Parsed {
        let start = self.start();
        let mut parts = vec![self.part(word)?];
        while self.takes(word) {
            parts.push(self.part(word)?);
        }
        match parts.pop() {
            Some(only) if parts.is_empty() => Ok(only),
            last => {
                parts.extend(last);
                Ok(self.node(Kind::Joined(word, parts), start))
            }
        }
    }

    fn part(&mut self, word: &str) -> Parsed {
        if word == "or" {
            self.joined("and")
        } else {
            self.inversion()
        }
    }

    fn inversion(&mut self) -> Parsed {
        let start = self.start();
        if !self.takes("not") {
            return self.comparison();
        }
        let operand = self.nested(Self::inversion)?;
        Ok(self.node(Kind::Not(Box::new(operand)), start))
    }

    fn comparison(&mut self) -> Parsed {
        let start = self.start();
        let left = self.binary(1)?;
        let mut rest = Vec::new();
        while let Some(operator) = self.comparison_operator()? {
            rest.push((operator, self.binary(1)?));
        }
        if rest.is_empty() {
            return Ok(left);
        }
        Ok(self.node(Kind::Compare(Box::new(left), rest), start))
    }

    fn comparison_operator(&mut self) -> Result<Option<&'static str>, SyntaxError> {
        if let Some(found) = COMPARISONS.iter().find(|sign| self.is_sign(sign)) {
            self.advance();
            return Ok(Some(found));
        }
        if self.takes("in") {
            return Ok(Some("in"));
        }
        if self.takes("is") {
            return Ok(Some(if self.takes("not") { "is not" } else { "is" }));
        }
        if self.is_word("not") {
            self.advance();
            self.expect("in")?;
            return Ok(Some("not in"));
        }
        Ok(None)
    }

    // ---- values

    fn binary(&mut self, least: u8) -> Parsed {
        self.nested(|parser| {
            let start = parser.start();
            let mut left = parser.factor()?;
            loop {
                let found = BINARY.iter().find(|(sign, level)| *level >= least && parser.is_sign(sign));
                let Some(&(operator, _)) = found else { return Ok(left) };
                parser.advance();
                let right = parser.binary(level_of(operator) + 1)?;
                left = parser.node(Kind::Binary(Box::new(left), operator, Box::new(right)), start);
            }
        })
    }

    fn factor(&mut self) -> Parsed {
        let start = self.start();
        if self.takes("-") {
            let operand = self.nested(Self::factor)?;
            return Ok(self.node(Kind::Negative(Box::new(operand)), start));
        }
        if self.takes("+") || self.takes("~") {
            self.nested(Self::factor)?;
            return Ok(self.node(Kind::Other, start));
        }
        let is_awaited = self.takes("await");
        let found = self.primary()?;
        if self.takes("**") {
            self.nested(Self::factor)?;
            return Ok(self.node(Kind::Other, start));
        }
        Ok(if is_awaited { self.node(Kind::Other, start) } else { found })
    }

    fn primary(&mut self) -> Parsed {
        let start = self.start();
        let mut found = self.atom()?;
        loop {
            found = if self.takes(".") {
                let TokenKind::Word(name) = self.peek().clone() else { return Err(self.unexpected()) };
                if KEYWORDS.contains(&name.as_str()) {
                    return Err(self.unexpected());
                }
                self.advance();
                self.node(Kind::Attribute(name), start)
            } else if self.takes("(") {
                let name = if let Kind::Name(name) = found.kind { Some(name) } else { None };
                let (arguments, is_plain) = self.arguments()?;
                self.node(Kind::Call { name, arguments, is_plain }, start)
            } else if self.takes("[") {
                self.skip_items("]")?;
                self.node(Kind::Subscript, start)
            } else {
                return Ok(found);
            };
        }
    }

    /// The arguments of a call; whether none of them has a name.
    fn arguments(&mut self) -> Result<(Vec<Node>, bool), SyntaxError> {
        let (mut found, mut is_plain) = (Vec::new(), true);
        while !self.takes(")") {
            let start = self.start();
            let argument = self.element()?;
            if matches!(argument.kind, Kind::Name(_)) && self.takes("=") {
                self.expression()?;
                is_plain = false;
            } else if self.skips_comprehension()? {
                found.push(self.node(Kind::Other, start));
            } else {
                found.push(argument);
            }
            if !self.takes(",") {
                self.expect(")")?;
                break;
            }
        }
        Ok((found, is_plain))
    }

    /// Skips what is in brackets or braces that filters do not have.
    fn skip_items(&mut self, closing: &str) -> Result<(), SyntaxError> {
        if closing == "]" && self.is_sign("]") {
            return Err(self.unexpected());
        }
        while !self.takes(closing) {
            if self.takes(",") || self.takes(":") {
                continue;
            }
            self.element()?;
            self.skips_comprehension()?;
            if !self.is_sign(",") && !self.is_sign(":") && !self.is_sign(closing) {
                return Err(self.unexpected());
            }
        }
        Ok(())
    }

    /// Whether `for ... in ...` follows; it is skipped.
    fn skips_comprehension(&mut self) -> Result<bool, SyntaxError> {
        let mut found = false;
        while self.takes("for") {
            found = true;
            self.binary(1)?;
            while self.takes(",") {
                self.binary(1)?;
            }
            self.expect("in")?;
            self.joined("or")?;
            while self.takes("if") {
                self.joined("or")?;
            }
        }
        Ok(found)
    }

    fn atom(&mut self) -> Parsed {
        let start = self.start();
        let kind = match self.peek().clone() {
            TokenKind::Word(word) => match word.as_str() {
                "True" => Kind::Bool(true),
                "False" => Kind::Bool(false),
                "None" => Kind::None,
                _ if KEYWORDS.contains(&word.as_str()) => return Err(self.unexpected()),
                _ => Kind::Name(word),
            },
            TokenKind::Integer(number) => Kind::Integer(number),
            TokenKind::Float(number) => Kind::Float(number),
            TokenKind::Imaginary | TokenKind::Sign("...") => Kind::OtherLiteral,
            TokenKind::Text(_) | TokenKind::Bytes | TokenKind::Template => return self.texts(),
            TokenKind::Sign("(") => return self.group(),
            TokenKind::Sign("[") => return self.list(),
            TokenKind::Sign("{") => {
                self.advance();
                self.skip_items("}")?;
                return Ok(self.node(Kind::Other, start));
            }
            _ => return Err(self.unexpected()),
        };
        self.advance();
        Ok(self.node(kind, start))
    }

    /// Texts that follow each other are one.
    fn texts(&mut self) -> Parsed {
        let start = self.start();
        let mut kind = Kind::Text(String::new());
        loop {
            kind = match (self.peek(), kind) {
                (TokenKind::Text(more), Kind::Text(text)) => Kind::Text(text + more),
                (TokenKind::Text(_), other) => other,
                (TokenKind::Bytes, _) => Kind::OtherLiteral,
                (TokenKind::Template, _) => Kind::Other,
                (_, found) => return Ok(self.node(found, start)),
            };
            self.advance();
        }
    }

    fn group(&mut self) -> Parsed {
        let start = self.start();
        self.advance();
        if self.takes(")") {
            return Ok(self.node(Kind::Tuple(Vec::new()), start));
        }
        if self.takes("yield") {
            if !self.is_sign(")") {
                self.expressions()?;
            }
            self.expect(")")?;
            return Ok(self.node(Kind::Other, start));
        }
        let first = self.element()?;
        if self.is_sign(",") {
            let items = self.further_items(first)?;
            self.expect(")")?;
            // Brackets are a part of a tuple, and of nothing else.
            return Ok(self.node(Kind::Tuple(items), start));
        }
        let is_other = self.skips_comprehension()?;
        self.expect(")")?;
        Ok(if is_other { self.node(Kind::Other, start) } else { first })
    }

    fn list(&mut self) -> Parsed {
        let start = self.start();
        self.advance();
        let mut items = Vec::new();
        while !self.takes("]") {
            items.push(self.element()?);
            if self.skips_comprehension()? {
                self.expect("]")?;
                return Ok(self.node(Kind::Other, start));
            }
            if !self.takes(",") {
                self.expect("]")?;
                break;
            }
        }
        Ok(self.node(Kind::List(items), start))
    }
}
