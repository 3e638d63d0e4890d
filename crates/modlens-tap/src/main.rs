//! `modlens-tap`: a tap for gateways, one binary without Python.
//!
//! It listens to a serial port, whose settings are given or found, and hands each transaction on as a JSON line and to
//! an MQTT broker; `--record` keeps what was read as a raw recording that `modlens decode` reads. Engine, clock, readers
//! and recorder are those of `modlens tap`, so both give the same rows. It never sends.

#[cfg(unix)]
mod broker;
#[cfg(unix)]
mod decoding;
#[cfg(unix)]
mod listening;
#[cfg(unix)]
mod mqtt;
#[cfg(unix)]
mod options;
#[cfg(unix)]
mod port;
#[cfg(unix)]
mod rows;

#[cfg(unix)]
fn main() -> std::process::ExitCode {
    use std::process::ExitCode;

    let words: Vec<String> = std::env::args().skip(1).collect();
    let wanted = match options::parse(&words) {
        Ok(options::Wanted::Tap(options)) => options,
        Ok(options::Wanted::Text(text)) => {
            print!("{text}");
            return ExitCode::SUCCESS;
        }
        Err(message) => {
            eprintln!("modlens-tap: {message}; see modlens-tap --help");
            return ExitCode::from(2);
        }
    };
    match listening::run(&wanted) {
        Ok(()) => ExitCode::SUCCESS,
        Err(trouble) => {
            eprintln!("modlens-tap: {}", trouble.message);
            ExitCode::from(trouble.status)
        }
    }
}

#[cfg(not(unix))]
fn main() {
    eprintln!("modlens-tap needs termios; use modlens tap here");
    std::process::exit(2);
}
