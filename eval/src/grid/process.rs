//! What has this process used so far, by what Linux says of it?

/// Seconds of processor time of all threads; 0 elsewhere.
pub(super) fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program, in parentheses, may have blanks.
    let fields: Vec<&str> = (stat.rsplit(')').next().unwrap_or_default())
        .split_whitespace()
        .collect();
    let ticks = |at: usize| fields.get(at).and_then(|it| it.parse::<f64>().ok());
    // User and system time, in hundredths of a second on every Linux.
    (ticks(11).unwrap_or(0.0) + ticks(12).unwrap_or(0.0)) / 100.0
}

/// The most memory that it had at once.
pub(super) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1_024 * kilobytes)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_process_has_used_something() {
        let start = cpu_s();
        let mut sum = 0_u64;
        while cpu_s() < start + 0.05 {
            sum = std::hint::black_box(sum.wrapping_add(1));
        }
        assert!(peak_bytes().is_some_and(|bytes| bytes > 1 << 20));
    }
}
