//! What odd transactions and bytes look like: the words of the table.

macro_rules! symptoms {
    ($($(#[$doc:meta])* $name:ident = $word:literal),* $(,)?) => {
        /// What an odd transaction or run of bytes looks like. `dissectors/diagnoses.toml` says how often each cause shows each.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Symptom { $($(#[$doc])* $name),* }

        impl Symptom {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// The word in the table.
            pub fn word(self) -> &'static str {
                match self { $(Self::$name => $word),* }
            }
        }
    };
}

symptoms! {
    /// No answer came.
    NoAnswer = "no_answer",
    /// No answer of the unit is in the recording; only a first sight separates this from the others (`sight`).
    NeverAnswered = "never_answered",
    /// The answer is damaged from its first byte on, and no answer of the unit is valid; a first sight names this, too.
    NeverValid = "never_valid",
    /// A frame of another framing than the one before.
    OtherFraming = "other_framing",
    /// The answer came after the master had given up.
    LateAnswer = "late_answer",
    /// The answer equals the request, whole or cut.
    Echo = "echo",
    /// The answer is that to the request before.
    StepBehind = "step_behind",
    /// The answer carries the identifier of no open request.
    OtherId = "other_id",
    /// The answer carries the identifier of the request with its two bytes swapped.
    SwappedId = "swapped_id",
    /// The answer carries the identifier of the request, but neither its unit nor its function.
    OtherHead = "other_head",
    /// Another unit answered.
    OtherUnit = "other_unit",
    /// An answer of another unit than the one that was asked last, and to another request.
    LoneAnswer = "lone_answer",
    /// The answer carries the identifier of the request and another unit.
    OtherUnitNumber = "other_unit_number",
    /// Another function was answered.
    OtherFunction = "other_function",
    /// The answer has another length than asked for, and a right checksum.
    OtherLength = "other_length",
    /// The answer lacks the byte count, and its checksum is right.
    CountMissing = "count_missing",
    /// The byte count has two bytes, and the checksum is right.
    CountWide = "count_wide",
    /// The byte count is not that of the bytes that follow, and the checksum is right.
    CountWrong = "count_wrong",
    /// The byte count of registers is odd, and the checksum is right.
    CountOdd = "count_odd",
    /// The layout is not that of the function in another way, and the checksum is right.
    OtherLayout = "other_layout",
    /// The length field of an MBAP header is wrong.
    HeaderLength = "header_length",
    /// Over Modbus/TCP, a request or an answer without its MBAP header.
    HeaderMissing = "header_missing",
    /// The checksum is right but for the order of its two bytes.
    ChecksumSwapped = "checksum_swapped",
    /// Bytes follow a frame over Modbus/TCP whose header announces no more.
    BytesAfter = "bytes_after",
    /// A write is confirmed with another address or value.
    OtherValue = "other_value",
    /// A request without a checksum.
    RequestBare = "request_bare",
    /// The byte count, the quantity and the data of a request do not agree.
    RequestLayout = "request_layout",
    /// A request that was not answered asks for more than its function allows, or for nothing.
    RequestLimit = "request_limit",
    /// A write of a coil that was not answered has a value other than FF00 and 0000.
    RequestCoil = "request_coil",
    /// The byte count of the answer is not that of what was asked for, and the reader has stopped where the right one would end it.
    AnswerCounted = "answer_counted",
    /// In ASCII, the byte count of an answer that stops before its end is not that of what was asked for.
    AnswerAnnounces = "answer_announces",
    /// The answer is whole but for its checksum, which is missing.
    AnswerBare = "answer_bare",
    /// A refusal without a checksum.
    RefusalBare = "refusal_bare",
    /// A refusal with a wrong checksum.
    RefusalChecksum = "refusal_checksum",
    /// A refusal without its code, and with a right checksum.
    RefusalShort = "refusal_short",
    /// Each byte of the answer is there twice.
    AnswerDoubled = "answer_doubled",
    /// What came as the answer is a frame in hex digits.
    AnswerDigits = "answer_digits",
    /// The answer is the request with some of its bits changed.
    AlteredEcho = "altered_echo",
    /// The same, and the first byte is among those that are changed.
    DistortedEcho = "distorted_echo",
    /// The answer begins as a refusal of the request and stops before its end.
    RefusalCut = "refusal_cut",
    /// The answer stops before its end, and is right as far as it goes.
    AnswerCut = "answer_cut",
    /// After such an answer, what came as the next one does not begin as an answer.
    AnswerRest = "answer_rest",
    /// The answer begins with the unit and lacks bytes after it.
    AnswerShort = "answer_short",
    /// A single byte after an answer: the unit's number, with which the next one begins.
    NextStart = "next_start",
    /// A valid answer that nobody asked for.
    SecondAnswer = "second_answer",
    /// The answer is damaged in its first one or two bytes, or lacks them.
    AnswerStart = "answer_start",
    /// The answer is damaged in its last bytes, or lacks them.
    AnswerEnd = "answer_end",
    /// One bit of the answer is wrong.
    AnswerBit = "answer_bit",
    /// The answer lacks the highest bit of each byte.
    AnswerSeven = "answer_seven",
    /// The highest bit of each byte of the answer is the parity of the others.
    AnswerParity = "answer_parity",
    /// In ASCII, the checksum of the answer is wrong, and its layout is right.
    AnswerLrc = "answer_lrc",
    /// The answer is right but for one byte too many.
    AnswerAdded = "answer_added",
    /// The answer is damaged after an intact beginning.
    AnswerInside = "answer_inside",
    /// The answer is damaged from its first byte on.
    AnswerWhole = "answer_whole",
    /// The answer begins with the unit, and is damaged after it.
    AnswerUnit = "answer_unit",
    /// The answer begins one or two bytes late: strays came before it.
    AnswerShifted = "answer_shifted",
    /// The answer begins after a run of bytes as a line leaves that nobody drives.
    AnswerBehind = "answer_behind",
    /// What came as the answer is the request with all levels inverted.
    EchoSwapped = "echo_swapped",
    /// What came is the beginning of the answer with all levels inverted.
    AnswerSwapped = "answer_swapped",
    /// What came as the answer is a frame of another protocol.
    AnswerForeign = "answer_foreign",
    /// What came as the answer is text.
    AnswerText = "answer_text",
    /// What came as the answer consists of 00, FF and bytes with one run of equal bits.
    AnswerInverted = "answer_inverted",
    /// The same of a unit with other answers that are whole; only a first sight names this (`sight`).
    AnswerIdle = "answer_idle",
    /// Such bytes in front of a whole request, in one line with it.
    RequestBehind = "request_behind",
    /// The request is damaged in its last bytes, or lacks them.
    RequestEnd = "request_end",
    /// The request stops before its end.
    RequestCut = "request_cut",
    /// The request is damaged elsewhere.
    RequestInside = "request_inside",
    /// A whole request is among what a program received that sends requests itself.
    ForeignRequest = "foreign_request",
    /// The request was sent while another one was open.
    RequestCrossed = "request_crossed",
    /// The answer collided with another frame.
    Collision = "collision",
    /// Refused: exception 1.
    RefusedFunction = "refused_function",
    /// Refused: exception 2.
    RefusedAddress = "refused_address",
    /// The same of an address that is the number of such a register in manuals.
    RefusedReference = "refused_reference",
    /// Refused: exception 3.
    RefusedValue = "refused_value",
    /// The same of a quantity that the protocol does not allow.
    RefusedQuantity = "refused_quantity",
    /// The same of a request that writes one value: there is no quantity to refuse.
    RefusedOneValue = "refused_one_value",
    /// Refused: exception 4.
    RefusedFailure = "refused_failure",
    /// Refused: exception 5 or 6.
    RefusedBusy = "refused_busy",
    /// Refused: exception 10.
    RefusedPath = "refused_path",
    /// Refused: exception 11.
    RefusedGateway = "refused_gateway",
    /// Refused with another exception.
    RefusedOther = "refused_other",
    /// One or two bytes between frames, as a driver leaves when it is switched.
    Stray = "stray",
    /// Text between frames.
    Text = "text",
    /// Three or more bytes of no frame in the line or packet of a whole answer, after it.
    AfterAnswer = "after_answer",
    /// Other bytes between frames.
    Noise = "noise",
    /// A few of them beside whole frames; only a first sight names this (`sight`).
    Extra = "extra",
}

impl Symptom {
    /// Whether a frame is built wrongly, by the program that made it.
    pub fn is_of_layout(self) -> bool {
        (Self::CountMissing..=Self::AnswerDigits).contains(&self)
    }

    /// Whether no checksum proves it: damage makes a few frames look like that, too.
    pub fn is_like_damage(self) -> bool {
        matches!(self, Self::RequestBare | Self::AnswerCounted | Self::AnswerBare | Self::RefusalBare | Self::RefusalChecksum)
    }

    /// Whether a frame shows it by itself, whatever came before it.
    pub fn is_of_frame(self) -> bool {
        self.is_of_layout() || self.is_refusal() || matches!(self, Self::Stray | Self::Text)
    }

    /// Whether it is bytes between frames, which take nothing from those.
    pub fn is_between_frames(self) -> bool {
        self == Self::NextStart || (Self::Stray..=Self::Extra).contains(&self)
    }

    /// Whether the request was refused by an exception.
    pub fn is_refusal(self) -> bool {
        (Self::RefusedFunction..=Self::RefusedOther).contains(&self)
    }
}
