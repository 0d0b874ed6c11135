//! What this process has needed: memory and processor time.

/// The most resident memory that this process has had so far; `None` where the system does not tell.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    kilobytes.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kb| kb * 1024)
}

/// Seconds that processors have worked for this process so far, in all its threads; `None` where the system does
/// not tell.
pub fn cpu_seconds() -> Option<f64> {
    /// Linux counts in hundredths, whatever its own clock is.
    const PER_SECOND: f64 = 100.0;
    let stat = Stat::read("/proc/self/stat")?;
    Some((stat.field::<f64>(14)? + stat.field::<f64>(15)?) / PER_SECOND)
}

/// The nice value of this thread, −20 to 19; `None` where the system does not tell.
pub(crate) fn niceness() -> Option<i8> {
    Stat::read("/proc/thread-self/stat")?.field(19)
}

/// What Linux says of a process or thread in one line.
struct Stat(String);

impl Stat {
    fn read(path: &str) -> Option<Self> {
        std::fs::read_to_string(path).ok().map(Self)
    }

    /// A field by its number in proc(5), 3 at least.
    fn field<T: std::str::FromStr>(&self, number: usize) -> Option<T> {
        // The second field is the program's name in brackets, which may hold anything.
        let (_, rest) = self.0.rsplit_once(')')?;
        rest.split_whitespace().nth(number - 3)?.parse().ok()
    }
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
