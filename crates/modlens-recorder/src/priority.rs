//! The priority of threads that must not wait for others.

/// Lets this thread run before all others: in real time where the user may (`LimitRTPRIO=` of systemd, `CAP_SYS_NICE`), or
/// else with a better nice value, or else as before. It is for threads that sleep nearly always.
#[allow(unsafe_code)]
pub fn raise() {
    // SAFETY: `sched_param` is plain numbers, for which zero is valid.
    let mut wanted: libc::sched_param = unsafe { std::mem::zeroed() };
    wanted.sched_priority = 1;
    // SAFETY: this thread is running, and `wanted` lives longer than the call.
    let refused = unsafe { libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_FIFO, &raw const wanted) };
    if refused != 0 {
        // Linux has a nice value for each thread.
        let _ = rustix::process::setpriority_process(None, -10);
    }
}
