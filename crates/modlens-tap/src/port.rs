//! A serial port that is only read: opened without the right to write, and set by termios.

use std::io;
use std::os::fd::OwnedFd;

use modlens_protocol::line::{LineSettings, Parity};
use rustix::fs::{open, Mode, OFlags};
use rustix::termios::{tcgetattr, tcsetattr, ControlModes, InputModes, OptionalActions, SpecialCodeIndex, Termios};

/// Opens a port for reading only.
pub fn open_port(path: &str) -> io::Result<OwnedFd> {
    Ok(open(path, OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())?)
}

/// Sets the line; whether the driver marks bytes with errors (PARMRK).
pub fn set_line(port: &OwnedFd, line: LineSettings) -> io::Result<bool> {
    let mut settings = tcgetattr(port)?;
    settings.make_raw();
    settings.set_speed(line.baud)?;
    set_character(&mut settings, line);
    settings.input_modes |= InputModes::INPCK | InputModes::PARMRK;
    settings.input_modes -= InputModes::IGNPAR | InputModes::IGNBRK | InputModes::BRKINT | InputModes::ISTRIP;
    settings.special_codes[SpecialCodeIndex::VMIN] = 0;
    settings.special_codes[SpecialCodeIndex::VTIME] = 0;
    tcsetattr(port, OptionalActions::Now, &settings)?;
    Ok(tcgetattr(port)?.input_modes.contains(InputModes::PARMRK))
}

/// Data bits, parity and stop bits.
fn set_character(settings: &mut Termios, line: LineSettings) {
    let modes = &mut settings.control_modes;
    *modes -= ControlModes::CSIZE | ControlModes::PARENB | ControlModes::PARODD | ControlModes::CMSPAR;
    *modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
    *modes |= ControlModes::CREAD | ControlModes::CLOCAL;
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
