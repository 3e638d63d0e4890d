//! Types that simulator, rivals and scorer share: directions, labels, line settings, framing.

/// The direction of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the master to a slave.
    Request,
    /// From a slave to the master.
    Response,
    /// Not decided.
    Unknown,
}

/// The transmission mode of a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// Binary with CRC (serial line specification, 2.5.1).
    Rtu,
    /// Hex characters with LRC (2.5.2).
    Ascii,
}

/// A fault on the bus that users act on, attached to a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Label {
    /// A request without response; attached to the request.
    NoResponse,
    /// A request that repeats one without response; attached to the second request.
    Retry,
    /// A response to a request that had already timed out; attached to it, or to the response to the retry after it.
    Late,
    /// A response that was sent twice; attached to the second one.
    Duplicate,
    /// A request that the adapter's own receiver has picked up; attached to the copy.
    Echo,
    /// A response from another unit than the one addressed; attached to the response.
    WrongUnit,
    /// A request while another master waits for its response; attached to any frame of the two transactions.
    TwoMasters,
    /// Bytes that are missing in the recording; attached to the frame that lacks them.
    LostBytes,
}

impl Label {
    /// All labels.
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

    /// The name in files of the truth.
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
    /// Adds a label.
    pub fn insert(&mut self, label: Label) {
        self.0 |= 1 << label as u8;
    }

    /// Removes a label; returns whether it was in the set.
    pub fn remove(&mut self, label: Label) -> bool {
        let was_present = self.contains(label);
        self.0 &= !(1 << label as u8);
        was_present
    }

    /// Whether the label is in the set.
    pub fn contains(self, label: Label) -> bool {
        self.0 & (1 << label as u8) != 0
    }

    /// The labels in the set.
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
    /// Even parity; without it there is no parity bit.
    pub has_even_parity: bool,
}

impl Settings {
    /// Bits of a character on the line, with one stop bit.
    pub fn bits(self) -> u32 {
        2 + u32::from(self.data_bits) + u32::from(self.has_even_parity)
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

    /// The settings in the form that `modlens --line` takes.
    pub fn text(self) -> String {
        format!("{}-{}{}1", self.baud, self.data_bits, if self.has_even_parity { 'E' } else { 'N' })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_the_line() {
        let line = Settings { baud: 9600, data_bits: 8, has_even_parity: true };
        assert_eq!((line.bits(), line.text().as_str()), (11, "9600-8E1"));
        assert!((line.t35_ns() - 4_010_416.6).abs() < 1.0);
        let fast = Settings { baud: 115_200, data_bits: 7, has_even_parity: true };
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
