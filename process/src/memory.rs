//! How much memory this process has needed.

/// The most resident memory that this process has had so far; `None` where the system does not tell.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    kilobytes.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb * 1024)
}

#[cfg(test)]
mod tests {
    #[test]
    #[cfg(target_os = "linux")]
    fn peak_memory_is_at_least_what_was_touched() {
        let touched = vec![1u8; 64 << 20];
        assert!(
            super::peak_memory_bytes().expect("Linux tells") >= touched.iter().map(|&b| u64::from(b)).sum()
        );
    }
}
