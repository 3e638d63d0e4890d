//! What WebAssembly exports.
//!
//! The page writes a call into [`input`] and reads the answer at [`output`]; both may move with every call. Every function
//! returns a number that is negative where it failed; the output then holds the message.

use std::cell::RefCell;

use serde_json::{json, Value as Json};

use crate::{answer, check_profile, report, words, Decoding};

/// What the page has opened, and the buffers that both sides share.
#[derive(Default)]
struct Shared {
    input: Vec<u8>,
    output: Vec<u8>,
    decoding: Option<Decoding>,
}

thread_local! {
    static SHARED: RefCell<Shared> = RefCell::default();

    /// What a panic said. The page reads it after the trap, and makes a new instance.
    static PANIC: RefCell<Vec<u8>> = const { RefCell::new(Vec::new()) };
}

/// Makes room for a call of `length` bytes, and returns where they belong.
#[unsafe(no_mangle)]
pub extern "C" fn input(length: usize) -> *mut u8 {
    SHARED.with_borrow_mut(|shared| {
        shared.input.resize(length, 0);
        shared.input.as_mut_ptr()
    })
}

/// Where the answer of the last call is.
#[unsafe(no_mangle)]
pub extern "C" fn output() -> *const u8 {
    SHARED.with_borrow(|shared| shared.output.as_ptr())
}

/// How long the answer of the last call is.
#[unsafe(no_mangle)]
pub extern "C" fn output_length() -> usize {
    SHARED.with_borrow(|shared| shared.output.len())
}

/// Where the message of a panic is.
#[unsafe(no_mangle)]
pub extern "C" fn panic_text() -> *const u8 {
    PANIC.with_borrow(|text| text.as_ptr())
}

/// How long the message of a panic is; 0 where there was none.
#[unsafe(no_mangle)]
pub extern "C" fn panic_length() -> usize {
    PANIC.with_borrow(Vec::len)
}

/// Opens a recording with the settings in the input, as JSON.
#[unsafe(no_mangle)]
pub extern "C" fn open() -> i32 {
    std::panic::set_hook(Box::new(|info| PANIC.with_borrow_mut(|text| *text = info.to_string().into_bytes())));
    call(|shared| {
        let settings = json_of(&shared.input)?;
        shared.decoding = Some(Decoding::open(&settings)?);
        Ok(0)
    })
}

/// Decodes the bytes in the input; returns how many rows have been decided so far.
#[unsafe(no_mangle)]
pub extern "C" fn feed() -> i32 {
    call(|shared| {
        let Shared { input, decoding, .. } = shared;
        opened(decoding)?.feed(input).map(|rows| rows as i32)
    })
}

/// Ends the recording; returns how many rows there are.
#[unsafe(no_mangle)]
pub extern "C" fn finish() -> i32 {
    call(|shared| opened(&mut shared.decoding)?.finish().map(|rows| rows as i32))
}

/// Answers the question in the input, as JSON.
#[unsafe(no_mangle)]
pub extern "C" fn ask() -> i32 {
    call(|shared| {
        let mut question = json_of(&shared.input)?;
        let found = match question["call"].as_str() {
            Some("words") => words(),
            Some("profile") => check_profile(&question)?,
            // Of a document from elsewhere: nothing has to be open.
            Some("report") if !question["document"].is_null() => report(question["document"].take()),
            _ => answer(opened(&mut shared.decoding)?, &question)?,
        };
        shared.output = found.to_string().into_bytes();
        Ok(0)
    })
}

/// The next bytes of the export that `ask` has begun, or of the capture that is being written; returns how many.
#[unsafe(no_mangle)]
pub extern "C" fn export_more() -> i32 {
    call(|shared| {
        let Shared { output, decoding, .. } = shared;
        output.clear();
        opened(decoding)?.export_more(output);
        Ok(output.len() as i32)
    })
}

/// Runs a call; where it fails, its message becomes the output, and -1 is returned.
fn call(run: impl FnOnce(&mut Shared) -> Result<i32, String>) -> i32 {
    SHARED.with_borrow_mut(|shared| {
        run(shared).unwrap_or_else(|message| {
            shared.output = json!({"error": message}).to_string().into_bytes();
            -1
        })
    })
}

fn json_of(bytes: &[u8]) -> Result<Json, String> {
    serde_json::from_slice(bytes).map_err(|error| error.to_string())
}

fn opened(decoding: &mut Option<Decoding>) -> Result<&mut Decoding, String> {
    decoding.as_mut().ok_or_else(|| String::from("nothing is open"))
}
