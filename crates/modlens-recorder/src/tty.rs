//! Serial ports of Linux, opened so that as little as possible reaches the line.
//!
//! A port is opened without the right to write. Two things may still reach the line, and both end as soon as the kernel
//! allows:
//!
//! - **Echo.** A port that no program has used since it was plugged in has the kernel's default settings, which send back
//!   what arrives. So the first call after `open` sets the port raw, without asking for its present settings, and the second
//!   one drops what the driver has not sent yet. Linux keeps a port's settings when it is closed: later openings have no
//!   echo at all.
//! - **DTR and RTS.** The kernel raises both in `open` (`tty_port_block_til_ready`), and no setting prevents that. The third
//!   call lowers them again, because many RS-485 adapters enable their transmitter by one of them.
//!
//! The page on wiring says what remains on which adapter.

use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use modlens_protocol::line::{LineSettings, Parity};
use rustix::fs::{flock, open, FlockOperation, Mode, OFlags};
use rustix::pty::{openpt, OpenptFlags};
use rustix::termios::{
    tcflush, tcgetattr, tcsetattr, ControlModes, InputModes, OptionalActions, QueueSelector, SpecialCodeIndex, Termios,
};

use crate::driver;
use crate::inbox::Inbox;
use crate::port::{reason, Counts, Port};
use crate::priority;

/// Settings to open a port with whose own are not known yet.
const PLACEHOLDER: LineSettings = LineSettings { baud: 9600, data_bits: 8, parity: Parity::None, half_stop_bits: 2 };

/// A rate that differs by a larger share (in percent) from the one that was asked for does not decode.
const MAX_RATE_ERROR: u32 = 3;

/// An open serial port of this machine, for reading only.
pub struct Tty {
    file: OwnedFd,
    line: Option<LineSettings>,
    is_pseudo_terminal: bool,
    marks_errors: bool,
    advice: String,
}

impl Tty {
    /// Opens a port for this program alone. Without settings they are not known yet.
    pub fn open(name: &str, line: Option<LineSettings>) -> Result<Self, String> {
        // In a thread of its own, which is not interrupted between the calls, where the user may have that.
        let opening = || {
            priority::raise();
            Self::open_quietly(name, line).map_err(|error| reason(&error, line))
        };
        std::thread::scope(|scope| scope.spawn(opening).join().unwrap_or_else(|_| Err("the port cannot be opened".into())))
    }

    fn open_quietly(name: &str, line: Option<LineSettings>) -> io::Result<Self> {
        let settings = line.unwrap_or(PLACEHOLDER);
        // Everything is prepared before the port is open. A pseudo terminal of our own lends its settings as the form to
        // fill in: asking the port for its own would take a further call.
        let form = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).and_then(tcgetattr).ok();
        let mut raw = form.map(|form| raw(form, settings)).transpose()?;
        let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = open(name, flags, Mode::empty())?;
        // A program that has the port already must not lose its settings. This is no call to the driver.
        flock(&file, FlockOperation::NonBlockingLockExclusive)?;
        let raw = match raw.take() {
            Some(raw) => raw,
            None => self::raw(tcgetattr(&file)?, settings)?,
        };
        tcsetattr(&file, OptionalActions::Now, &raw)?;
        tcflush(&file, QueueSelector::IOFlush)?;
        let modem_lines = driver::lower_modem_lines(file.as_fd());
        let is_pseudo_terminal = std::fs::canonicalize(name).is_ok_and(|path| path.starts_with("/dev/pts"));
        let mut tty = Self { file, line, is_pseudo_terminal, marks_errors: false, advice: String::new() };
        tty.check_settings(settings)?;
        if let Err(error) = modem_lines {
            tty.advice = format!("DTR and RTS could not be lowered ({error}): the adapter may hold the line");
        } else if !is_pseudo_terminal {
            tty.advice = driver::reduce_latency(tty.file.as_fd(), name);
        }
        Ok(tty)
    }

    /// Reads back what the driver has made of the settings.
    fn check_settings(&mut self, wanted: LineSettings) -> io::Result<()> {
        let present = tcgetattr(&self.file)?;
        self.marks_errors = present.input_modes.contains(InputModes::PARMRK);
        let difference = present.output_speed().abs_diff(wanted.baud);
        // A pseudo terminal has no rate.
        if !self.is_pseudo_terminal && difference > wanted.baud / 100 * MAX_RATE_ERROR {
            return Err(io::Error::from(rustix::io::Errno::INVAL));
        }
        Ok(())
    }

    fn change_line(&mut self, line: LineSettings) -> io::Result<()> {
        tcsetattr(&self.file, OptionalActions::Now, &raw(tcgetattr(&self.file)?, line)?)?;
        self.check_settings(line)
    }
}

impl Port for Tty {
    fn listen(&mut self, inbox: &Arc<Inbox>, number: usize) -> Result<(), String> {
        inbox.listen(number, self.file.as_fd(), self.marks_errors).map_err(|error| reason(&error, self.line))
    }

    fn set_line(&mut self, line: LineSettings) -> Result<(), String> {
        self.line = Some(line);
        self.change_line(line).map_err(|error| reason(&error, Some(line)))
    }

    fn marks_errors(&self) -> bool {
        self.marks_errors
    }

    fn counters(&self) -> Counts {
        driver::counters(self.file.as_fd())
    }

    fn advice(&self) -> String {
        self.advice.clone()
    }
}

/// Fills in these settings of a line: raw, without echo or flow control, with line errors marked.
fn raw(mut settings: Termios, line: LineSettings) -> io::Result<Termios> {
    settings.make_raw();
    settings.set_speed(line.baud)?;
    set_character(&mut settings, line);
    settings.input_modes |= InputModes::INPCK | InputModes::PARMRK;
    settings.input_modes -= InputModes::IGNPAR | InputModes::IGNBRK | InputModes::BRKINT | InputModes::ISTRIP;
    settings.input_modes -= InputModes::IXON | InputModes::IXOFF | InputModes::IXANY;
    settings.special_codes[SpecialCodeIndex::VMIN] = 1;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    Ok(settings)
}

/// Data bits, parity and stop bits.
fn set_character(settings: &mut Termios, line: LineSettings) {
    let modes = &mut settings.control_modes;
    *modes -= ControlModes::CSIZE | ControlModes::PARENB | ControlModes::PARODD | ControlModes::CMSPAR;
    *modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    *modes |= ControlModes::CREAD | ControlModes::CLOCAL | ControlModes::HUPCL;
    *modes |= match line.data_bits {
        5 => ControlModes::CS5,
        6 => ControlModes::CS6,
        7 => ControlModes::CS7,
        _ => ControlModes::CS8,
    };
    *modes |= match line.parity {
        Parity::None => ControlModes::empty(),
        Parity::Even => ControlModes::PARENB,
        Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
        Parity::Mark => ControlModes::PARENB | ControlModes::PARODD | ControlModes::CMSPAR,
        Parity::Space => ControlModes::PARENB | ControlModes::CMSPAR,
    };
    if line.half_stop_bits > 2 {
        *modes |= ControlModes::CSTOPB;
    }
}
