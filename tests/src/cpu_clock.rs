//! Time that the processor spent on us, as the system tells it: what else runs on the machine does
//! not count, as it would on the clock on the wall. Linux only; elsewhere the wall clock.

use std::sync::OnceLock;
use std::time::Instant;

/// Seconds spent in this thread so far.
pub fn thread_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let spent = text
        .split_whitespace()
        .next()
        .and_then(|ns| ns.parse::<f64>().ok());
    spent.map_or_else(wall_s, |ns| ns * 1e-9)
}

/// Seconds spent in all threads of this process so far, to a hundredth.
pub fn process_s() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The second field is a name in brackets that may hold anything; user and system time are the
    // 12th and 13th after it, in ticks of a hundredth.
    let after = text.rsplit_once(')').map_or("", |(_, rest)| rest);
    let fields: Vec<f64> = after
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|f| f.parse().ok())
        .collect();
    match fields[..] {
        [user, system] => (user + system) / 100.0,
        _ => wall_s(),
    }
}

fn wall_s() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}
