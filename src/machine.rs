//! What the machine has: memory, processors; and what the process used.

use std::fs;

/// Memory that this process may use, in bytes: the machine's, or less if a control group limits it.
pub fn memory() -> u64 {
    let info = rustix::system::sysinfo();
    let physical = info.totalram as u64 * u64::from(info.mem_unit);
    let limits = ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];
    limits.iter().filter_map(|path| fs::read_to_string(path).ok()?.trim().parse().ok()).fold(physical, u64::min)
}

/// Processors that this process may run on.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The most memory of the process that was resident at a time, in bytes. Pages of mapped input files count while they are
/// resident, although the system can take them back at any time.
pub fn peak_resident() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_has_something() {
        assert!(memory() > 1 << 20);
        assert!(processors() >= 1);
        if cfg!(target_os = "linux") {
            assert!(peak_resident().unwrap() > 1 << 16);
        }
    }
}
