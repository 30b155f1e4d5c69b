//! What a process holds on to.

use std::fs;
use std::time::Duration;

/// Resident memory, bytes.
pub fn resident_bytes(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB"));
    kib.unwrap().parse::<u64>().unwrap() << 10
}

/// Open files, sockets and pipes.
pub fn descriptors(pid: u32) -> usize {
    fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count()
}

/// Threads.
pub fn threads(pid: u32) -> usize {
    fs::read_dir(format!("/proc/{pid}/task")).unwrap().count()
}

/// How long its threads have been running on a core.
pub fn running_time(pid: u32) -> Duration {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    let of_task = |task: &fs::DirEntry| {
        // One that has just ended counts for nothing.
        let said = fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
        said.split(' ').next()?.parse::<u64>().ok()
    };
    let nanoseconds: u64 = tasks.filter_map(|task| of_task(&task.unwrap())).sum();
    Duration::from_nanos(nanoseconds)
}
