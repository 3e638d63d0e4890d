//! `modlens-tap`: a tap for gateways, one binary without Python.
//!
//! It listens to a serial port, whose settings are given or found, and hands each transaction on as a JSON line and to
//! an MQTT broker; `--record` keeps what was read as a raw recording that `modlens decode` reads. Its loop is that of
//! `modlens tap` (`modlens_recorder::LiveRun`), so both give the same rows. It never sends.

#[cfg(target_os = "linux")]
mod broker;
#[cfg(target_os = "linux")]
mod mqtt;
#[cfg(target_os = "linux")]
mod options;
#[cfg(target_os = "linux")]
mod outlet;
#[cfg(target_os = "linux")]
mod rows;
#[cfg(target_os = "linux")]
mod tap;

#[cfg(target_os = "linux")]
fn main() -> std::process::ExitCode {
    use std::process::ExitCode;

    let words: Vec<String> = std::env::args().skip(1).collect();
    match options::parse(&words) {
        Ok(options::Wanted::Tap(options)) => ExitCode::from(tap::run(&options)),
        Ok(options::Wanted::Text(text)) => {
            print!("{text}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("modlens-tap: {message}; see modlens-tap --help");
            ExitCode::from(2)
        }
    }
}

#[cfg(not(target_os = "linux"))]
fn main() {
    eprintln!("modlens-tap is for Linux; use modlens tap here");
    std::process::exit(2);
}
