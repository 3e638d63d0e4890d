//! The table of weights: every weight, threshold and margin by which the engine decides, with its unit and its reason.
//!
//! A hypothesis about the bytes is scored by the bits that it saves over reading the same bytes as line noise: a
//! log2-likelihood ratio. Noise bytes and payload bytes have the same probability model, so payload neither gains nor loses
//! score. A field with a predicted value gains the information content of its bytes (-log2 p). Frequent values such as 00
//! have little of it, so a run of zeros cannot score high. What a line teaches on top of these values is in `traffic_model`.
//!
//! A row is a doc comment (the reason) and a constant whose name ends in its unit; [`UNITS`] lists the units. `TABLE` is made
//! of the same rows, and `docs/segmentation.md` shows it: to add a weight, write a row here, and run the documentation test
//! with `MODLENS_UPDATE=1`. A value that only bounds memory or a cache is no weight and stays where it is used.

use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// The units that the name of a weight may end in, and what each counts.
pub const UNITS: [(&str, &str); 9] = [
    ("_BITS", "bits of evidence: log2 of a likelihood ratio"),
    ("_BYTES", "bytes on the line"),
    ("_NS", "nanoseconds"),
    ("_FRAMES", "committed frames"),
    ("_SHARE", "probability"),
    ("_FACTOR", "ratio of two counts or times"),
    ("_REQUESTS", "distinct requests"),
    ("_HYPOTHESES", "hypotheses held at one time"),
    ("_FLIPS", "inverted bits"),
];

/// A weight as the documentation shows it.
#[derive(Clone, Copy, Debug)]
pub struct Weight {
    /// The constant's name; its end is the unit.
    pub name: &'static str,
    /// The constant's value as the code spells it.
    pub value: &'static str,
    /// Why it is what it is.
    pub reason: &'static str,
}

/// Weights of one kind of decision.
#[derive(Clone, Copy, Debug)]
pub struct WeightGroup {
    /// What they decide.
    pub title: &'static str,
    /// The rows, in the order of the code.
    pub weights: &'static [Weight],
}

/// Makes the constants, and `TABLE` of the same rows.
macro_rules! weights {
    ($($title:literal { $($(#[doc = $reason:literal])+ $name:ident: $type:ty = $value:expr;)+ })+) => {
        $($($(#[doc = $reason])+ pub const $name: $type = $value;)+)+

        /// All weights, in groups.
        pub const TABLE: &[WeightGroup] = &[$(WeightGroup {
            title: $title,
            weights: &[$(Weight { name: stringify!($name), value: stringify!($value), reason: concat!($($reason),+) }),+],
        }),+];
    };
}

weights! {
    "Information content of a byte" {
        /// A quarter of all bytes on real lines are 00.
        ZERO_BYTE_BITS: f32 = 2.0;
        /// A twelfth of all bytes on real lines are FF.
        FF_BYTE_BITS: f32 = 3.6;
        /// All other values share what is left evenly.
        OTHER_BYTE_BITS: f32 = 8.56;
        /// On a wrong baud rate or a floating line few values make all of the noise. After this many bytes of noise what was
        /// counted weighs as much as the three values above.
        NOISE_PRIOR_BYTES: f32 = 256.0;
        /// The bits of all byte values are computed again after this many bytes of noise; once per byte would cost too much.
        NOISE_UPDATE_BYTES: f32 = 128.0;
        /// The counts of noise bytes are halved here, so that old noise is forgotten.
        NOISE_HALVE_BYTES: f32 = 8192.0;
    }

    "What a line teaches" {
        /// Frames that the prior is worth: after as many, what was counted weighs as much as the prior.
        PRIOR_WEIGHT_FRAMES: f32 = 6.0;
        /// Counts of units and functions are halved here: they may change after hours.
        HALVE_COUNTS_FRAMES: f32 = 4000.0;
        /// Counts of unanswered requests and unsolicited responses are halved earlier: timeouts come in bursts.
        HALVE_TURNS_FRAMES: f32 = 500.0;
        /// A unit and a function seen this often, each, are familiar: such a header needs no further proof.
        FAMILIAR_FRAMES: f32 = 3.0;
        /// A request found in the dictionary saves its body at most, less the bits that choose it among those polled.
        POLL_CHOICE_BITS: f32 = 3.0;
        /// The most that a request from the dictionary is worth: two of the bytes that it is looked up by.
        MAX_POLLED_REQUEST_BITS: f32 = 12.0;
        /// At first one frame in forty stands after bytes that belong to no frame.
        PRIOR_UNFRAMED_SHARE: f32 = 1.0 / 40.0;
        /// A learned share of frames after unframed bytes is not believed to be smaller: the next line noise will come.
        MIN_UNFRAMED_SHARE: f32 = 0.002;
        /// A learned share of frames after unframed bytes is not believed to be larger.
        MAX_UNFRAMED_SHARE: f32 = 0.9;
        /// At first one frame in sixty is an unsolicited response where no request is outstanding.
        PRIOR_UNSOLICITED_SHARE: f32 = 1.0 / 60.0;
        /// As above, after unframed bytes, among which a damaged request may be.
        PRIOR_UNSOLICITED_AFTER_UNFRAMED_SHARE: f32 = 1.0 / 20.0;
        /// At first one frame in thirty is another request where one is outstanding.
        PRIOR_UNANSWERED_SHARE: f32 = 1.0 / 30.0;
        /// As above, after unframed bytes, among which a damaged response may be.
        PRIOR_UNANSWERED_AFTER_UNFRAMED_SHARE: f32 = 1.0 / 12.0;
        /// At first an answered request is the next one, too, in one case of four: heartbeats, watchdogs, a single poll.
        PRIOR_SAME_AGAIN_SHARE: f32 = 1.0 / 4.0;
        /// Weight of the newest request in the learned share of requests that are sent again once they are answered.
        SAME_AGAIN_NEWEST_SHARE: f32 = 1.0 / 32.0;
        /// At first the late response follows the response to a retry in one case of ten.
        PRIOR_LATE_RESPONSE_SHARE: f32 = 1.0 / 10.0;
        /// Where no request is outstanding, so small a share of requests, relative to half of that on other lines, says that only
        /// responses are heard.
        ONE_SIDE_SHARE: f32 = 0.5;
        /// A learned share of unsolicited, unanswered or late frames is not believed to be smaller.
        MIN_TURN_SHARE: f32 = 0.004;
        /// A learned share of unsolicited, unanswered or late frames is not believed to be larger.
        MAX_TURN_SHARE: f32 = 0.9;
        /// Requests to a unit by which is counted how often it is silent are halved here: units die and come back.
        HALVE_SILENCES_FRAMES: f32 = 32.0;
        /// On one line in two hundred the tap's own adapter echoes what it sends, so that each request is heard twice.
        PRIOR_ECHO_SHARE: f32 = 1.0 / 200.0;
        /// A learned share of requests heard twice is not believed to be smaller.
        MIN_ECHO_SHARE: f32 = 0.001;
        /// A learned share of requests heard twice is not believed to be larger.
        MAX_ECHO_SHARE: f32 = 0.99;
        /// Frames that the prior of any length is worth for a function without public layout.
        LENGTH_PRIOR_FRAMES: f32 = 2.0;
        /// A length seen once may be chance: half a frame is taken off its count.
        LENGTH_DISCOUNT_FRAMES: f32 = 0.5;
        /// Counts of lengths are halved here: devices may be replaced.
        HALVE_LENGTHS_FRAMES: f32 = 64.0;
        /// A frame that stood alone in noise and comes again after the same bytes is the same accident of the checksum, unless
        /// at least one in this many was answered.
        LONE_FRAMES_PER_ANSWER_FACTOR: u32 = 4;
        /// Counts of a frame that stood alone in noise are halved here.
        MAX_LONE_FRAMES: u32 = 64;
        /// A request that is not seen again is dropped from the dictionary after at most this many others for its slot.
        MAX_REQUEST_COUNT_FRAMES: u32 = 15;
    }

    "Prior of a unit or function" {
        /// Function 3, read holding registers: the most common one.
        READ_HOLDING_REGISTERS_SHARE: f32 = 0.30;
        /// Function 4, read input registers.
        READ_INPUT_REGISTERS_SHARE: f32 = 0.15;
        /// Each of functions 1, 2, 6 and 16.
        COMMON_FUNCTION_SHARE: f32 = 0.08;
        /// Each of functions 5 and 15.
        WRITE_COILS_SHARE: f32 = 0.04;
        /// Function 23, read and write in one.
        READ_WRITE_REGISTERS_SHARE: f32 = 0.02;
        /// Each of the other functions that the table names.
        NAMED_FUNCTION_SHARE: f32 = 0.006;
        /// Each user-defined code (application protocol, 5).
        USER_DEFINED_FUNCTION_SHARE: f32 = 0.003;
        /// Each of the codes that are left.
        UNKNOWN_FUNCTION_SHARE: f32 = 0.0005;
        /// Unit 0, a broadcast.
        BROADCAST_UNIT_SHARE: f32 = 0.01;
        /// Each unit from 1 to 30: masters are seldom set up for more than the first addresses.
        LOW_UNIT_SHARE: f32 = 0.7 / 30.0;
        /// Each unit from 31 to 247.
        HIGH_UNIT_SHARE: f32 = 0.28 / 217.0;
        /// Each of the reserved units 248 to 255 (serial line specification, 2.2): they are seen in the field all the same.
        RESERVED_UNIT_SHARE: f32 = 0.01 / 8.0;
    }

    "Score of a frame by itself" {
        /// A rule of the specification that a frame breaks: this happens, but seldom.
        BROKEN_RULE_BITS: f32 = 7.0;
        /// A response that repeats another address than the request has: rather the next frame of a side that is heard alone.
        OTHER_ADDRESS_BITS: f32 = 16.0;
        /// A response that repeats another value than the request writes: some devices do so, but rather it is the next write.
        OTHER_VALUE_BITS: f32 = 11.0;
        /// Each byte of a CRC that continues a pattern: where the bytes before it repeat themselves, it was to be expected.
        PATTERN_BYTE_BITS: f32 = 0.3;
        /// A frame that lacks the last byte of its layout. If that byte is 00, its CRC is valid with and without it.
        CUT_SHORT_BITS: f32 = 40.0;
        /// Choice of a length where the layout fixes none and nothing was learned of it.
        OPEN_LENGTH_BITS: f32 = 7.5;
        /// An exception response among responses.
        EXCEPTION_BITS: f32 = 4.0;
        /// Exception codes 1 to 6, 8, 10 and 11 of the specification (application protocol, 7).
        SPECIFIED_EXCEPTION_CODE_BITS: f32 = 3.5;
        /// Any other exception code: vendors have their own.
        VENDOR_EXCEPTION_CODE_BITS: f32 = 9.0;
        /// Exception code 0: nobody uses it, and runs of zeros are full of it.
        ZERO_EXCEPTION_CODE_BITS: f32 = 16.0;
        /// A broadcast that reads, or a response of unit 0: nobody may respond to either.
        BROADCAST_READ_BITS: f32 = 9.0;
        /// A pause or a record's start in front of a frame: most frames have one there.
        PAUSE_BEFORE_BITS: f32 = 2.0;
        /// A pause or a record's start inside a frame, where none should be.
        PAUSE_INSIDE_BITS: f32 = 2.0;
        /// A frame of the other side on a line that carries one direction only.
        WRONG_LINE_BITS: f32 = 25.0;
        /// A frame with an invalid CRC where everything else fits: one frame in two hundred, and no CRC to prove it.
        DAMAGED_BITS: f32 = 9.0;
        /// A frame that contains whole frames of this line: one file transfer or loopback in a thousand.
        NESTING_BITS: f32 = 10.0;
    }

    "Score of a frame among others" {
        /// The response to the outstanding request: nine in ten requests get one.
        ANSWERED_BITS: f32 = 0.1;
        /// A response while a request to somebody else is outstanding: one frame in sixty.
        UNSOLICITED_BITS: f32 = 5.9;
        /// A damaged request while another one is outstanding: one frame in thirty.
        UNANSWERED_BITS: f32 = 4.9;
        /// A unit that was silent for a request and its retry may well be silent again: one in four.
        STILL_SILENT_BITS: f32 = 2.0;
        /// The most that a request costs for coming as early as responses do: a second master's, or a look-alike response.
        TOO_SOON_BITS: f32 = 6.0;
        /// The most that an unsolicited response costs for coming after a silence in which the outstanding request was given up.
        GIVEN_UP_BITS: f32 = 6.0;
        /// Says that a request is the outstanding one or the one before it, repeated.
        RETRY_CHOICE_BITS: f32 = 1.0;
        /// No response and no new request comes sooner than the silence between frames: one line in thirty does not keep to that.
        TOO_SOON_FOR_FRAME_BITS: f32 = 4.0;
        /// A new request in one read with the response before it: adapters hide the time of a unit, but hardly the pause of a
        /// master.
        TOO_SOON_IN_READ_BITS: f32 = 8.0;
        /// Odds of a direction that nothing puts in doubt.
        CERTAIN_DIRECTION_BITS: f32 = 60.0;
        /// In a row of equal frames, a response is sent twice: one in a thousand.
        COPIED_RESPONSE_BITS: f32 = 10.0;
        /// A response that equals its request, after a whole exchange of another unit: only a late response, one in three
        /// hundred. The same request again looks like it.
        SPANS_EXCHANGE_BITS: f32 = 8.0;
        /// If a request was heard twice before its response, the same request is heard twice again in one case of two.
        ECHO_AGAIN_BITS: f32 = 1.0;
        /// If a request was heard twice before its response, the same request is heard once in one case of eight.
        ECHO_MISSING_BITS: f32 = 3.0;
        /// The most that the copy of a request costs for coming as late as a response: an echo comes at once.
        LATE_ECHO_BITS: f32 = 6.0;
        /// The same response again: one in a hundred.
        REPEATED_RESPONSE_BITS: f32 = 6.6;
        /// Unit and function of an unsolicited response are among the unframed bytes before it: its request was damaged.
        DAMAGED_REQUEST_BITS: f32 = 4.0;
        /// This many unframed bytes between two frames may be a damaged frame; fewer are stray bytes.
        MAY_HIDE_FRAME_BYTES: u64 = 4;
    }

    "Cost of bytes between frames" {
        /// Enters a short run of stray bytes.
        ENTER_STRAY_RUN_BITS: f32 = 0.5;
        /// Each further byte of a short run.
        STRAY_BYTE_BITS: f32 = 1.2;
        /// Leaves a short run into a frame.
        LEAVE_STRAY_RUN_BITS: f32 = 0.8;
        /// Enters a long run of noise. Its bytes cost nothing: otherwise a long chance match would pay.
        ENTER_NOISE_BITS: f32 = 1.8;
        /// Leaves a long run of noise into a frame.
        LEAVE_NOISE_BITS: f32 = 5.0;
    }

    "Habits of a line" {
        /// If more than one valid frame in a hundred has a pause inside, pauses inside frames prove nothing on this line.
        FRAMES_PER_INNER_PAUSE_FACTOR: f32 = 100.0;
        /// If stray bytes are in front of more than one frame in fifty, the line counts as noisy.
        FRAMES_PER_STRAY_RUN_FACTOR: f32 = 50.0;
        /// Stray bytes that usually are in one place of a noisy line, at most: four random ones are common there.
        MAX_STRAY_NOISY_BYTES: usize = 7;
        /// Stray bytes that usually are in one place of a quiet line, at most.
        MAX_STRAY_QUIET_BYTES: usize = 2;
        /// Frames with lost bytes that have to be seen before a line is said to lose bytes.
        MIN_LOSSES_FRAMES: f32 = 3.0;
        /// Frames with lost bytes for each collision before a line is said to lose bytes.
        LOSSES_PER_COLLISION_FACTOR: f32 = 4.0;
        /// Truncated responses after which the master went on, before truncation is put down to the tap.
        MIN_TAP_TRUNCATIONS_FRAMES: f32 = 2.0;
        /// Truncated responses after which the master went on, for each that it asked for again.
        TAP_TRUNCATIONS_PER_RETRY_FACTOR: f32 = 4.0;
    }

    "Lattice" {
        /// Hypotheses further below the best path are dropped.
        BEAM_BITS: f32 = 60.0;
        /// Hypotheses further below are dropped where the best path has no frame: noise makes such hypotheses all the time.
        BEAM_IN_NOISE_BITS: f32 = 30.0;
        /// Hypotheses that are kept when noise or crafted bytes have made too many.
        BEAM_HYPOTHESES: usize = 16;
        /// More hypotheses at one time than this are no traffic: the best path is committed.
        MAX_HYPOTHESES: usize = 96;
        /// The shortest frame with a length of its own is a request of eight bytes, or its response of five.
        MIN_DAMAGED_FRAME_BYTES: u64 = 5;
        /// Sums of the same numbers in another order differ by less.
        ROUNDING_BITS: f32 = 0.01;
    }

    "Commit" {
        /// Lead over all rivals that commits a frame live; the chance of committing too early is about 2 to the minus this.
        COMMIT_MARGIN_BITS: f32 = 14.0;
        /// Lead over all rivals that commits a frame of a recording, where nobody waits.
        OFFLINE_COMMIT_MARGIN_BITS: f32 = 30.0;
        /// Lead over unfinished frames whose completion is looked up in a recording: those that come have a valid CRC, too.
        LOOKAHEAD_MARGIN_BITS: f32 = 35.0;
        /// Lead of a fast-path frame over a frame that begins in the stray bytes before it.
        STRAY_RIVAL_MARGIN_BITS: f32 = 18.0;
        /// A valid frame with this score is not outscored by a header inside it.
        CERTAIN_FRAME_BITS: f32 = 34.0;
        /// Lead that a frame in the middle of noise needs to be firm, even where its unit is known. Accidents of the checksum
        /// after a known unit reach 9 bits in a few megabytes of uniform noise.
        FIRM_IN_NOISE_BITS: f32 = 12.0;
        /// No header is worth more.
        MAX_HEADER_BITS: f32 = 60.0;
        /// Advantage of an unfinished frame that begins right after another one: a frame is due there.
        FRAME_DUE_BITS: f32 = 14.0;
        /// Without a clock, the same bytes in the other direction this close wait for the next frame, which distinguishes a response
        /// that equals its request from a retry.
        OPPOSITE_DIRECTION_MARGIN_BITS: f32 = 40.0;
        /// A lead below this leaves the direction of a frame undecided between its two hypotheses.
        UNDECIDED_DIRECTION_BITS: f32 = 1.0;
        /// Hypotheses that stay equally good for this long will not be distinguished: the better one is committed.
        TIE_PATIENCE_BYTES: u64 = 640;
        /// Patience with equally good hypotheses in a recording.
        OFFLINE_TIE_PATIENCE_BYTES: u64 = 1280;
        /// The cost of bytes after a frame no longer grows from here on: only a new hypothesis changes the order.
        SETTLED_BEHIND_BYTES: u64 = 3;
        /// Unit, function code and two more bytes: a frame that contains others has a longer header than stray bytes are.
        MIN_OUTER_HEADER_BYTES: u64 = 4;
        /// Bytes without a frame are committed in blocks of this length.
        UNFRAMED_PIECE_BYTES: u64 = 4096;
        /// In a recording, unframed bytes up to this many are held back until the frame after them is known.
        OFFLINE_HOLD_BACK_BYTES: u64 = 4096;
        /// This many valid frames without a byte between them do not come by chance.
        CHAIN_FRAMES: u8 = 4;
    }

    "Confidence" {
        /// The evidence ends here: among a few million frames of simulated lines about so many bits of odds can be counted.
        MAX_CONFIDENCE_BITS: u8 = 15;
        /// Rows with less are unconfirmed: odds of 32 to 1.
        MIN_FIRM_BITS: u8 = 5;
        /// Confidence by lead, where length and direction are specified: points (lead, odds), counted on simulated lines.
        SPECIFIED_ODDS_BITS: [(f32, f32); 5] = [(0.0, 3.0), (5.0, 7.2), (20.0, 11.0), (40.0, 12.0), (60.0, 15.0)];
        /// The same where the response may equal the request.
        EQUAL_LAYOUTS_ODDS_BITS: [(f32, f32); 5] = [(0.0, 3.0), (5.0, 6.5), (20.0, 8.2), (40.0, 8.6), (60.0, 10.0)];
        /// The same where any length would do.
        OPEN_LENGTH_ODDS_BITS: [(f32, f32); 5] = [(0.0, 3.0), (5.0, 6.5), (10.0, 7.5), (20.0, 8.0), (60.0, 10.0)];
        /// The most by the odds of its direction, in a row of equal frames: points (log2 odds of the search, counted odds).
        DIRECTION_ODDS_BITS: [(f32, f32); 6] = [(2.0, 2.0), (2.5, 5.0), (4.5, 5.4), (5.0, 7.4), (10.0, 8.0), (12.0, 15.0)];
        /// Log2 odds of a response to a write that answers no outstanding request, and may as well be a request.
        UNASKED_MIRROR_ODDS_BITS: f32 = 2.5;
        /// Where all frames may be requests or responses, so small a share of answered requests leaves open which side is heard.
        ONE_SIDE_ANSWERED_SHARE: f32 = 0.5;
        /// Log2 odds of directions on such a line: both sides are heard, as on nearly all lines, ...
        TWO_SIDES_ODDS_BITS: f32 = 4.8;
        /// ... or by the frames after its first request nothing is known.
        ONE_SIDE_ODDS_BITS: f32 = 1.0;
        /// So many requests left for others without a response leave open which side is heard ...
        MIN_LEFT_FRAMES: f32 = 1.0;
        /// ... where so few were answered for each of them: then not even their direction is reported.
        UNKNOWN_SIDE_ANSWERED_SHARE: f32 = 1.0 / 16.0;
        /// What a frame loses in the middle of noise.
        NOISE_ODDS_BITS: f32 = 2.0;
        /// The most for an unconfirmed frame.
        UNCONFIRMED_ODDS_BITS: u8 = 6;
        /// A frame that stood alone in the same noise before: six of seven are accidents.
        RECURRING_ODDS_BITS: u8 = 0;
        /// A damaged frame: 97 of 100 stand where they are said to.
        DAMAGED_CONFIDENCE_BITS: u8 = 5;
        /// A record of a recording without checksums, which its program has printed as a frame.
        NO_CHECKSUM_CONFIDENCE_BITS: u8 = 7;
        /// A frame that a silence ended and of which only the CRC was checked, and a Modbus/TCP frame whose header and layout disagree.
        CRC_CONFIDENCE_BITS: u8 = 5;
        /// A Modbus ASCII frame with a valid LRC, which has eight bits.
        LRC_CONFIDENCE_BITS: u8 = 9;
        /// A Modbus/TCP frame whose header agrees with the layout of its function.
        MBAP_CONFIDENCE_BITS: u8 = 15;
    }

    "Confidence of a transaction" {
        /// A response with the transaction identifier of its request, which it fits: no line was simulated that shows more.
        ANSWER_BY_ID_BITS: u8 = 11;
        /// A response that fits the request before it, on a serial line.
        ANSWER_IN_TURN_BITS: u8 = 13;
        /// As above, on two lines whose reads come late: their order is not certain.
        ANSWER_IN_LATE_READS_BITS: u8 = 9;
        /// A response that would also be the response to the request before, to the same unit, which had none.
        ANSWER_AFTER_SILENCE_BITS: u8 = 7;
        /// As above, to a retry: it may be the late response to the first request.
        ANSWER_AFTER_RETRY_BITS: u8 = 10;
        /// A response that agrees in unit and function, but not in what was requested.
        ANSWER_PARTLY_BITS: u8 = 8;
        /// A response to a request that arrived damaged.
        ANSWER_TO_DAMAGED_BITS: u8 = 6;
        /// A response with another transaction identifier than its request, from a server that is known for that.
        ANSWER_BY_HABIT_BITS: u8 = 6;
        /// A response on the other of two lines without a clock, whose order is inferred.
        ANSWER_IN_INFERRED_ORDER_BITS: u8 = 7;
        /// No response, since the same request followed.
        SILENCE_BEFORE_RETRY_BITS: u8 = 9;
        /// No response to a retry, since another request followed.
        SILENCE_OF_RETRY_BITS: u8 = 6;
        /// No response, since another request followed, from a master that seldom retries.
        SILENCE_BY_HABIT_BITS: u8 = 9;
        /// No response, since another request followed after the time of a timeout.
        SILENCE_BEFORE_ANOTHER_BITS: u8 = 9;
        /// As above without that evidence, of a unit that was never heard.
        SILENCE_OF_UNKNOWN_UNIT_BITS: u8 = 3;
        /// No response, on a line that has shown none so far: perhaps it carries one side only, or something else.
        SILENCE_OF_ALL_BITS: u8 = 1;
        /// Evidence in the time before the next request that shows a timeout rather than a response that was not recorded.
        TIMEOUT_EVIDENCE_BITS: f32 = 3.0;
        /// No response within the waiting time.
        SILENCE_TIMED_OUT_BITS: u8 = 9;
        /// A response that came after the waiting time, or after a retry.
        LATE_RESPONSE_BITS: u8 = 7;
        /// A response that was sent twice.
        DUPLICATE_RESPONSE_BITS: u8 = 4;
        /// A late response, or a copy of one, that equals its request: as a rule it is one of the two, or an echo.
        BELATED_MIRROR_BITS: u8 = 2;
        /// A response that nobody asked for.
        UNEXPECTED_RESPONSE_BITS: u8 = 4;
        /// As above, where its request may only be seen later, since two lines' reads come late or have no times, or where hardly
        /// any request is heard.
        UNEXPECTED_IN_ANY_ORDER_BITS: u8 = 2;
        /// A transaction with less is unconfirmed.
        UNCONFIRMED_TRANSACTION_BITS: u8 = 5;
    }

    "Silence" {
        /// Without line settings, or with reads of several bytes, shorter pauses prove nothing.
        COARSE_MIN_GAP_NS: Ns = 5_000_000;
        /// The longest pause that may stand inside a frame: USB adapters and schedulers hold bytes back that long.
        FRAME_BREAK_NS: Ns = 90_000_000;
        /// A silence in a stream over TCP proves nothing before it is this long.
        TCP_FRAME_BREAK_NS: Ns = 1_000_000_000;
        /// On a very slow line a frame ends after this many character times instead.
        FRAME_BREAK_CHARACTERS_FACTOR: Ns = 10;
    }

    "Fast path" {
        /// Threshold of the log2 odds timeout : response. At or below it, the pause before a repeated request-like frame is at
        /// least 1000 times more likely before a response than after a timeout, so the frame is taken as the response.
        RESPONSE_LOG_ODDS_BITS: f32 = -10.0;
        /// The most stray bytes to skip in front of a frame: fewer than the shortest frame has.
        MAX_SKIPPED_STRAY_BYTES: usize = 3;
        /// The longest request that is accepted while another one is outstanding. Requests of a poll cycle are short, so nobody
        /// has to wait long for the rest of one.
        MAX_POLL_REQUEST_BYTES: usize = 16;
    }

    "Noise or a damaged frame" {
        /// Wrong bits of a damaged exception response: five bytes come as close to one by chance once in ten million cases.
        MAX_EXCEPTION_FLIPS: u32 = 3;
        /// Score that a damaged frame needs to be reported. Noise looks like one with a probability of about 2 to the minus this.
        MIN_DAMAGED_FRAME_BITS: f32 = 10.0;
        /// Cost of a further damaged frame in the same region: damage is rare, so two damaged frames need more evidence than one.
        FURTHER_DAMAGED_FRAME_BITS: f32 = 8.0;
        /// Damaged frames are searched for in so many bytes at each end of a region; what lies between in a longer one is noise.
        SEARCHED_BYTES: usize = 320;
        /// Unframed bytes within which a driver that takes out flow control bytes has damaged some frame: among so many,
        /// a line that loses 1 byte in 128 loses 16. Then no place is tried any more.
        FLOW_CONTROL_SEARCH_BYTES: usize = 2048;
        /// Gain of a candidate that ends exactly where a pause, a valid frame or the end of the recording is.
        FRAME_END_BITS: f32 = 4.0;
        /// The most that the stray bytes in front of a candidate cost together.
        MAX_STRAY_BITS: f32 = 6.8;
        /// Cost of a frame that begins before the announced end of the damaged frame in front of it.
        OVERLAP_BITS: f32 = 3.0;
        /// A line driver that is switched leaves at most so many stray bytes of one value next to a frame.
        MAX_GLITCH_BYTES: usize = 3;
        /// In a longer frame, one inserted byte makes the CRC valid by chance in too many places to mean anything.
        MAX_INSERTION_CHECK_BYTES: usize = 40;
        /// USB adapters and schedulers seldom delay the rest of a frame for longer than this.
        COARSE_FRAME_GAP_NS: Ns = 45_000_000;
        /// Selection cost of the response to the outstanding request, or of the frame that the next one repeats or answers.
        DUE_FRAME_BITS: f32 = 1.0;
        /// Selection cost of a retry of the outstanding request.
        RETRY_BITS: f32 = 4.0;
        /// Selection cost of any request of the poll cycle.
        POLL_REQUEST_BITS: f32 = 5.0;
        /// A burst in a place where a frame is due nearly for certain: a response between two requests, a request in front of a
        /// response.
        DUE_BURST_BITS: f32 = 4.0;
        /// As above, where a unit may as well have been silent, because the same request follows.
        UNPROVEN_RESPONSE_BITS: f32 = 0.0;
        /// As above, on a line that one side has to itself: any frame of it may stand there, or none.
        ONE_SIDED_BURST_BITS: f32 = -2.0;
        /// As above, where nothing but a timeout shows that there was a request that nobody could read.
        UNPROVEN_REQUEST_BITS: f32 = -3.0;
        /// Gain for each byte of a burst after the first: noise seldom comes in a row.
        BURST_BYTE_BITS: f32 = 2.0;
        /// The most that the number of bytes of a burst is worth.
        MAX_BURST_BITS: f32 = 12.0;
        /// Gain for a burst that begins with the unit that is due.
        DUE_UNIT_BITS: f32 = 8.0;
        /// Gain for a burst whose second byte is the function that is due.
        DUE_FUNCTION_BITS: f32 = 6.0;
        /// Gain for a burst with the length that is due, or a few bytes less.
        BURST_LENGTH_BITS: f32 = 3.0;
        /// The most that the time of a burst is worth, for it or against it.
        MAX_BURST_TIME_BITS: f32 = 4.0;
        /// The most that a timeout after a burst is worth, and that a pause that is none is worth against it.
        MAX_BURST_TIMEOUT_BITS: f32 = 6.0;
        /// Cost of each stray byte between a pause and a burst.
        BURST_STRAY_BITS: f32 = 1.5;
        /// At most so many stray bytes stand between a pause and a burst.
        MAX_BURST_STRAY_BYTES: usize = 6;
        /// A burst among more noise than this is noise, too.
        MAX_BURST_NOISE_BYTES: usize = 16;
        /// A second transmitter sends at most so many bytes after the end of a burst.
        MAX_BURST_OVERHANG_BYTES: usize = 48;
        /// In a longer region without recognised frames, no burst is a frame by its place.
        MAX_BURST_REGION_BYTES: usize = 300;
        /// Cost of bytes that are missing in front of a frame.
        MISSING_HEAD_BITS: f32 = 5.0;
        /// Cost of one to three bytes that are missing inside a frame: what happened, and where.
        MISSING_INSIDE_BITS: f32 = 6.0;
        /// Cost of a byte that was received twice: what happened, and where.
        DOUBLED_BYTE_BITS: f32 = 8.0;
        /// Cost of a second transmitter from some byte of a frame on.
        COLLISION_BITS: f32 = 5.0;
        /// Cost of a byte in which a collision seems to have set bits to 1, which it cannot do.
        COLLISION_MISFIT_BITS: f32 = 4.0;
        /// Cost of each byte that both transmitters may have sent, beside one bit for each of its ones.
        COLLISION_BYTE_BITS: f32 = 0.5;
        /// Cost of a byte with one flipped bit.
        ONE_FLIP_BITS: f32 = 9.0;
        /// Cost of a byte with two flipped bits.
        TWO_FLIPS_BITS: f32 = 13.0;
        /// Cost of a byte with three flipped bits. Bytes with more flipped bits do not agree at all.
        THREE_FLIPS_BITS: f32 = 17.0;
        /// The most flipped bits in unit and function code together at which the two are still recognised.
        MAX_HEADER_FLIPS: u32 = 3;
        /// The most bits in which a damaged colon of an ASCII message differs from a colon.
        MAX_COLON_FLIPS: u32 = 1;
        /// Gain for a CRC that is valid once the damage is corrected.
        CRC_MATCH_BITS: f32 = 16.0;
        /// Gain for a single flipped bit that explains the wrong CRC. The bits that say which one it is are subtracted from it.
        CRC_CORRECTABLE_BITS: f32 = 13.0;
        /// Gain for one more byte of a run of equal values, which was to be expected.
        RUN_BYTE_BITS: f32 = 0.3;
        /// Comparison stops where the score has fallen so far below its maximum.
        MAX_SCORE_DROP_BITS: f32 = 12.0;
    }

    "Choice of the transmission mode" {
        /// The first number of bytes by which the mode is chosen; it doubles until a valid frame is among them.
        FIRST_MODE_CHECK_BYTES: usize = 8;
        /// Without a valid frame in this many bytes, the look of the bytes decides.
        LAST_MODE_CHECK_BYTES: usize = 4096;
        /// A row of noise has to be as long as this, two short frames, before another mode is looked for in it.
        MIN_OTHER_MODE_BYTES: usize = 16;
    }

    "Search for damaged requests" {
        /// A long request of the poll cycle is aligned only where its first bytes agree in this many bits.
        LONG_REQUEST_PREFIX_BITS: f32 = 11.0;
    }

    "Order of two lines" {
        /// A response that agrees in everything it repeats of a request (unit, function, length, address) is nearly certain to
        /// be its response.
        PAIR_FULL_MATCH_BITS: f32 = 16.0;
        /// An exception response repeats no more than unit and function.
        PAIR_EXCEPTION_BITS: f32 = 10.0;
        /// If one of the two frames is damaged, its unit and function agree by chance more easily.
        PAIR_DAMAGED_BITS: f32 = 5.0;
        /// A response of the right unit and function that contradicts the request otherwise is rather that of another one.
        PAIR_PARTIAL_MATCH_BITS: f32 = 4.0;
        /// The cost of a request without response: a silent unit, or bytes that are missing from the other line.
        SINGLE_REQUEST_BITS: f32 = 5.0;
        /// The cost of a request without response whose retry follows at once, which is what masters do.
        RETRIED_REQUEST_BITS: f32 = 2.0;
        /// The cost of a response without request: only missing bytes explain it.
        SINGLE_RESPONSE_BITS: f32 = 6.0;
        /// Frames of each line that are aligned at once, where most of them pair up.
        NARROW_WINDOW_FRAMES: usize = 24;
        /// Frames of each line that are aligned where few pair up: more than are missing from one line at a time.
        WIDE_WINDOW_FRAMES: usize = 192;
        /// The lead in frames that only a master, or only a unit, can send, with which it is settled who speaks on which line.
        SPEAKER_LEAD_FRAMES: i32 = 3;
        /// The survey of who speaks on which line ends after this many bytes of a line.
        SURVEY_BYTES: usize = 4096;
        /// Live, the survey ends after this time, since somebody waits for the first rows.
        SURVEY_NS: Ns = 1_000_000_000;
    }
}

/// The information content of a byte before any noise was seen.
pub fn usual_bits(byte: u8) -> f32 {
    match byte {
        0 => ZERO_BYTE_BITS,
        0xFF => FF_BYTE_BITS,
        _ => OTHER_BYTE_BITS,
    }
}

/// How common a function is before anything was learned.
pub fn function_prior(functions: &Functions, code: u8) -> f32 {
    match code {
        3 => READ_HOLDING_REGISTERS_SHARE,
        4 => READ_INPUT_REGISTERS_SHARE,
        1 | 2 | 6 | 16 => COMMON_FUNCTION_SHARE,
        5 | 15 => WRITE_COILS_SHARE,
        23 => READ_WRITE_REGISTERS_SHARE,
        _ if functions.name(code).is_some() => NAMED_FUNCTION_SHARE,
        65..=72 | 100..=110 => USER_DEFINED_FUNCTION_SHARE,
        _ => UNKNOWN_FUNCTION_SHARE,
    }
}

/// How common a unit is before anything was learned.
pub fn unit_prior(unit: u8) -> f32 {
    match unit {
        0 => BROADCAST_UNIT_SHARE,
        1..=30 => LOW_UNIT_SHARE,
        31..=247 => HIGH_UNIT_SHARE,
        248..=255 => RESERVED_UNIT_SHARE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_weight_names_its_unit_and_has_a_reason() {
        for weight in TABLE.iter().flat_map(|group| group.weights) {
            assert!(UNITS.iter().any(|(unit, _)| weight.name.ends_with(unit)), "{} ends in no unit", weight.name);
            assert!(weight.reason.trim().ends_with('.'), "{} has no sentence as its reason", weight.name);
        }
    }

    #[test]
    fn no_name_stands_twice() {
        let mut names: Vec<&str> = TABLE.iter().flat_map(|group| group.weights).map(|weight| weight.name).collect();
        names.sort_unstable();
        assert!(names.windows(2).all(|pair| pair[0] != pair[1]), "{names:?}");
    }
}
