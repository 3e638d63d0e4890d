//! The known word that a misspelled one is most similar to.

/// A name in lower case without spaces and punctuation.
pub fn normalized(text: &str) -> String {
    text.to_lowercase().chars().filter(char::is_ascii_alphanumeric).collect()
}

/// The known name most similar to a misspelled one; `None` if none shares `least` of its letters with it.
pub fn similar_name<'a>(word: &str, known: impl IntoIterator<Item = &'a str>, least: f64) -> Option<&'a str> {
    let wanted: Vec<char> = normalized(word).chars().collect();
    let mut best: Option<(f64, String, &str)> = None;
    for name in known {
        let plain = normalized(name);
        let likeness = likeness(&plain.chars().collect::<Vec<_>>(), &wanted);
        let is_better = best.as_ref().is_none_or(|(most, other, _)| (likeness, &plain) >= (*most, other));
        if likeness >= least && is_better {
            best = Some((likeness, plain, name));
        }
    }
    best.map(|(_, _, name)| name)
}

/// The share of letters of two words that are in common parts of them, which do not cross (Ratcliff and Obershelp).
fn likeness(a: &[char], b: &[char]) -> f64 {
    if a.is_empty() && b.is_empty() {
        return 1.0;
    }
    2.0 * common(a, b) as f64 / (a.len() + b.len()) as f64
}

/// How many letters the longest common part has, and those before it and after it.
fn common(a: &[char], b: &[char]) -> usize {
    let (mut at, mut length) = ((0, 0), 0);
    let mut before = vec![0; b.len() + 1];
    for (i, letter) in a.iter().enumerate() {
        let mut row = vec![0; b.len() + 1];
        for (j, other) in b.iter().enumerate() {
            if letter == other {
                row[j + 1] = before[j] + 1;
                if row[j + 1] > length {
                    length = row[j + 1];
                    at = (i + 1 - length, j + 1 - length);
                }
            }
        }
        before = row;
    }
    if length == 0 {
        return 0;
    }
    let (i, j) = at;
    common(&a[..i], &b[..j]) + length + common(&a[i + length..], &b[j + length..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelled_word_is_recognised() {
        assert_eq!(similar_name("quantitty", ["address", "quantity"], 0.6), Some("quantity"));
        assert_eq!(similar_name("retyr", ["retry", "exception"], 0.6), Some("retry"));
        assert_eq!(similar_name("zzz", ["retry", "exception"], 0.6), None);
    }

    #[test]
    fn likeness_is_the_share_of_common_letters() {
        let letters = |text: &str| text.chars().collect::<Vec<_>>();
        // `ab` and `d` of four letters each: twice three of eight.
        assert!((likeness(&letters("abcd"), &letters("abxd")) - 0.75).abs() < 1e-12);
        assert!((likeness(&[], &[]) - 1.0).abs() < 1e-12);
    }
}
