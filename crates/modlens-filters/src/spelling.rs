//! Writes a filter in its normalized spelling, and texts in quotes.

use std::fmt::Write;

use crate::syntax::{level_of, Kind, Node};

// How tightly things bind; the operators of `BINARY` are between.
const OR: u8 = 1;
const AND: u8 = 2;
const NOT: u8 = 3;
const COMPARE: u8 = 4;
const BINARY: u8 = 5;
const FACTOR: u8 = 20;

/// The normalized spelling of a filter.
pub fn spelled(node: &Node) -> String {
    let mut out = String::new();
    write(node, 0, &mut out);
    out
}

/// Appends a part, in brackets where what is around it binds tighter.
fn write(node: &Node, around: u8, out: &mut String) {
    let own = match &node.kind {
        Kind::Joined("or", _) => OR,
        Kind::Joined(..) => AND,
        Kind::Not(_) => NOT,
        Kind::Compare(..) => COMPARE,
        Kind::Binary(_, operator, _) => BINARY + level_of(operator),
        Kind::Negative(_) => FACTOR,
        _ => u8::MAX,
    };
    if own < around {
        out.push('(');
    }
    match &node.kind {
        Kind::Joined(word, parts) => {
            for (at, part) in parts.iter().enumerate() {
                if at > 0 {
                    let _ = write!(out, " {word} ");
                }
                write(part, own + 1, out);
            }
        }
        Kind::Not(operand) => {
            out.push_str("not ");
            write(operand, NOT, out);
        }
        Kind::Compare(left, rest) => {
            write(left, COMPARE + 1, out);
            for (operator, right) in rest {
                let _ = write!(out, " {operator} ");
                write(right, COMPARE + 1, out);
            }
        }
        Kind::Negative(operand) => {
            out.push('-');
            write(operand, FACTOR, out);
        }
        Kind::Binary(left, operator, right) => {
            write(left, own, out);
            let _ = write!(out, " {operator} ");
            write(right, own + 1, out);
        }
        Kind::Call { name, arguments, .. } => {
            out.push_str(name.as_deref().unwrap_or_default());
            write_items('(', arguments, ')', out);
        }
        Kind::Tuple(items) => {
            write_items('(', items, ')', out);
            if items.len() == 1 {
                out.insert(out.len() - 1, ',');
            }
        }
        Kind::List(items) => write_items('[', items, ']', out),
        Kind::Name(name) => out.push_str(name),
        Kind::Integer(number) => {
            let _ = write!(out, "{}", number.unwrap_or(i64::MAX));
        }
        Kind::Float(number) => out.push_str(&float_text(*number)),
        Kind::Text(text) => out.push_str(&quoted(text)),
        Kind::Bool(yes) => out.push_str(if *yes { "True" } else { "False" }),
        Kind::None => out.push_str("None"),
        Kind::OtherLiteral | Kind::Attribute(_) | Kind::Subscript | Kind::Other => out.push_str("..."),
    }
    if own < around {
        out.push(')');
    }
}

fn write_items(opening: char, items: &[Node], closing: char, out: &mut String) {
    out.push(opening);
    for (at, item) in items.iter().enumerate() {
        if at > 0 {
            out.push_str(", ");
        }
        write(item, 0, out);
    }
    out.push(closing);
}

/// A float as Python writes it: with an exponent where it is long.
fn float_text(number: f64) -> String {
    if number == 0.0 || (1e-4..1e16).contains(&number.abs()) {
        return format!("{number:?}");
    }
    let text = format!("{number:e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let (sign, exponent) = exponent.strip_prefix('-').map_or(('+', exponent), |exponent| ('-', exponent));
    format!("{digits}e{sign}{exponent:0>2}")
}

/// A text in quotes: in double ones if it holds single ones only, with escapes for what cannot be seen.
pub fn quoted(text: &str) -> String {
    let quote = if text.contains('\'') && !text.contains('"') { '"' } else { '\'' };
    let mut out = String::from(quote);
    for letter in text.chars() {
        match letter {
            '\n' => out.push_str("\\n"),
            '\r' => out.push_str("\\r"),
            '\t' => out.push_str("\\t"),
            '\\' => out.push_str("\\\\"),
            _ if letter == quote => out.extend(['\\', quote]),
            _ if is_visible(letter) => out.push(letter),
            _ => {
                let code = letter as u32;
                let _ = match code {
                    0..=0xFF => write!(out, "\\x{code:02x}"),
                    0x100..=0xFFFF => write!(out, "\\u{code:04x}"),
                    _ => write!(out, "\\U{code:08x}"),
                };
            }
        }
    }
    out.push(quote);
    out
}

fn is_visible(letter: char) -> bool {
    if letter.is_ascii() {
        return !letter.is_ascii_control();
    }
    // After another letter an accent is visible, too.
    format!("a{letter}").escape_debug().count() == 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parser::parse;

    #[test]
    fn brackets_stay_where_they_are_needed() {
        for text in [
            "a and (b or c)",
            "a and b or c",
            "not (a and b)",
            "(a == 1) == 1",
            "a - (b - c) * -d == (1,)",
            "-(a + b) < 2 <= [1, 'x']",
            "touches(hr, range(1, 5)) and a not in (1, 2)",
        ] {
            assert_eq!(spelled(&parse(text).expect(text)), text);
        }
        assert_eq!(spelled(&parse("((a))and(not (b))or 0x1F>.5").expect("valid")), "a and not b or 31 > 0.5");
    }

    #[test]
    fn texts_are_quoted_as_python_does() {
        for (text, wanted) in [
            ("it's", "\"it's\""),
            ("'\"", "'\\'\"'"),
            ("a\\\n\t", "'a\\\\\\n\\t'"),
            ("ü\u{301}\u{200b}\u{7f}", "'ü\u{301}\\u200b\\x7f'"),
        ] {
            assert_eq!(quoted(text), wanted);
        }
    }

    #[test]
    fn floats_have_an_exponent_where_they_are_long() {
        let cases =
            [(5.0, "5.0"), (0.1, "0.1"), (1e16, "1e+16"), (1.5e-7, "1.5e-07"), (123_456.75, "123456.75"), (1e300, "1e+300")];
        for (number, text) in cases {
            assert_eq!(float_text(number), text);
        }
    }
}
