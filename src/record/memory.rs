//! How much memory the process took at its peak.

/// The largest resident set of this process so far, bytes; `None` where the system does not tell (`VmHWM` of
/// /proc/self/status on Linux).
pub fn peak_rss_bytes() -> Option<u64> {
    parse_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_high_water_mark() {
        assert_eq!(parse_peak("VmPeak:\t 9 kB\nVmHWM:\t  123 kB\nVmRSS:\t 7 kB\n"), Some(123 * 1024));
        assert_eq!(parse_peak("VmPeak:\t 9 kB\n"), None);
    }
}
