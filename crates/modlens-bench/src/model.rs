//! The words that simulator, rivals and scorer share: directions, labels, line settings, framing.

/// Who sent a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// The master.
    Request,
    /// A unit.
    Response,
    /// Not said.
    Unknown,
}

/// How frames are put on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// Binary with CRC (serial line specification, 2.5.1).
    Rtu,
    /// Hex characters with LRC (2.5.2).
    Ascii,
}

/// What people act on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Label {
    /// A request that nobody answered; stands at the request.
    NoResponse,
    /// The same request again after no answer; at the second one.
    Retry,
    /// The answer to a request that the master had given up; at it, or at the retry's own answer behind it.
    Late,
    /// The same answer twice; at the second one.
    Duplicate,
    /// The request as the adapter's own receiver heard it; at the copy.
    Echo,
    /// Another unit answered than the one asked; at the answer.
    WrongUnit,
    /// A request while another master waits for its answer; at any frame of the two exchanges.
    TwoMasters,
    /// Bytes are missing in the recording; at the frame that is short of them.
    LostBytes,
}

impl Label {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NoResponse,
        Self::Retry,
        Self::Late,
        Self::Duplicate,
        Self::Echo,
        Self::WrongUnit,
        Self::TwoMasters,
        Self::LostBytes,
    ];

    /// As truth files spell it.
    pub fn text(self) -> &'static str {
        match self {
            Self::NoResponse => "no_response",
            Self::Retry => "retry",
            Self::Late => "late",
            Self::Duplicate => "duplicate",
            Self::Echo => "echo",
            Self::WrongUnit => "wrong_unit",
            Self::TwoMasters => "two_masters",
            Self::LostBytes => "lost_bytes",
        }
    }
}

/// A set of labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Labels(u8);

impl Labels {
    /// Adds one.
    pub fn insert(&mut self, label: Label) {
        self.0 |= 1 << label as u8;
    }

    /// Takes one away; says whether it was there.
    pub fn remove(&mut self, label: Label) -> bool {
        let there = self.contains(label);
        self.0 &= !(1 << label as u8);
        there
    }

    /// Whether it is there.
    pub fn contains(self, label: Label) -> bool {
        self.0 & (1 << label as u8) != 0
    }

    /// Those that are there.
    pub fn iter(self) -> impl Iterator<Item = Label> {
        Label::ALL.into_iter().filter(move |&label| self.contains(label))
    }
}

/// Settings of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Bits per second.
    pub baud: u32,
    /// Data bits of a character.
    pub data_bits: u8,
    /// With even parity, or none.
    pub parity: bool,
}

impl Settings {
    /// Bits of a character on the line, with one stop bit.
    pub fn bits(self) -> u32 {
        2 + u32::from(self.data_bits) + u32::from(self.parity)
    }

    /// The time of a character, in ns.
    pub fn char_ns(self) -> f64 {
        f64::from(self.bits()) * 1e9 / f64::from(self.baud)
    }

    /// The shortest silence between frames, in ns (serial line specification, 2.5.1.1).
    pub fn t35_ns(self) -> f64 {
        if self.baud > 19_200 {
            1_750_000.0
        } else {
            3.5 * self.char_ns()
        }
    }

    /// As `modlens --line` takes it.
    pub fn text(self) -> String {
        format!("{}-{}{}1", self.baud, self.data_bits, if self.parity { 'E' } else { 'N' })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_the_line() {
        let line = Settings { baud: 9600, data_bits: 8, parity: true };
        assert_eq!((line.bits(), line.text().as_str()), (11, "9600-8E1"));
        assert!((line.t35_ns() - 4_010_416.6).abs() < 1.0);
        let fast = Settings { baud: 115_200, data_bits: 7, parity: true };
        assert_eq!((fast.bits(), fast.t35_ns() as u32), (10, 1_750_000));
    }

    #[test]
    fn sets_of_labels() {
        let mut set = Labels::default();
        set.insert(Label::Late);
        set.insert(Label::NoResponse);
        assert_eq!(set.iter().collect::<Vec<_>>(), [Label::NoResponse, Label::Late]);
        assert!(!set.contains(Label::Retry));
    }
}
