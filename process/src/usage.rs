//! Memory and processor time of this process.

/// Peak resident memory of this process; `None` if the system does not report it.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    kilobytes.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb * 1024)
}

/// Processor seconds of this process so far, in all its threads; `None` if the system does not report them.
pub fn cpu_seconds() -> Option<f64> {
    /// Linux reports hundredths of a second.
    const PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field is the program's name in brackets, which may hold anything. proc(5) numbers the first one
    // after it 3, and the times in user and in system mode 14 and 15.
    let (_, rest) = stat.rsplit_once(')')?;
    let times: Vec<f64> = rest.split_whitespace().skip(14 - 3).take(2).flat_map(str::parse).collect();
    (times.len() == 2).then(|| times.iter().sum::<f64>() / PER_SECOND)
}

#[cfg(test)]
mod tests {
    #[test]
    #[cfg(target_os = "linux")]
    fn processor_time_grows_with_work_and_not_faster_than_the_clock() {
        let (before, start) = (super::cpu_seconds().expect("Linux tells"), std::time::Instant::now());
        let mut sum = 0u64;
        while super::cpu_seconds().expect("Linux tells") - before < 0.05 {
            sum = (0..100_000u64).fold(sum, |sum, k| sum.wrapping_mul(31) ^ k);
            assert!(start.elapsed().as_secs() < 60, "no time counted for {sum}");
        }
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn peak_memory_is_at_least_what_was_touched() {
        let touched = vec![1u8; 64 << 20];
        assert!(
            super::peak_memory_bytes().expect("Linux tells") >= touched.iter().map(|&b| u64::from(b)).sum()
        );
    }
}
