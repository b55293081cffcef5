//! What the machine has: memory, processors; and what the process used.

use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::system;
pub use crate::system::peak_resident;

/// Memory that this process may use, in bytes: the machine's, or less if a control group limits it, its own or one above that.
pub fn memory() -> u64 {
    let physical = system::physical_memory();
    group_limit(Path::new("/")).map_or(physical, |limit| limit.min(physical))
}

/// The least limit of memory among the control groups of this process, from its own up to the root of what is mounted, of either version. `root` is the
/// root of the file system.
fn group_limit(root: &Path) -> Option<u64> {
    let below = |path: &str| root.join(path.trim_start_matches('/'));
    let groups = fs::read_to_string(below("/proc/self/cgroup")).unwrap_or_default();
    let mounts = fs::read_to_string(below("/proc/self/mountinfo")).unwrap_or_default();
    let mut limits = Vec::new();
    for group in groups.lines() {
        // Hierarchy, controllers, the group's path: of version 2, there are no controllers.
        let mut parts = group.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next()) else { continue };
        let (kind, names): (_, &[&str]) = match controllers {
            // Above `high`, the process is slowed down until next to nothing moves.
            "" => ("cgroup2", &["memory.max", "memory.high"]),
            _ if controllers.split(',').any(|name| name == "memory") => ("cgroup", &["memory.limit_in_bytes"]),
            _ => continue,
        };
        for (within, at) in mounts.lines().filter_map(|line| mounted(line, kind)) {
            // What is mounted may begin below the root of all groups, as in a container.
            let path = Path::new(path);
            let inner = path.strip_prefix(&within).or(path.strip_prefix("/")).unwrap_or(path);
            let inner: PathBuf = inner.components().filter(|part| matches!(part, Component::Normal(_))).collect();
            for folder in inner.ancestors() {
                for name in names {
                    let limit = fs::read_to_string(below(&at).join(folder).join(name));
                    // Without a limit, it says "max".
                    limits.extend(limit.ok().and_then(|text| text.trim().parse::<u64>().ok()));
                }
            }
        }
    }
    limits.into_iter().min()
}

/// Reads a line about a mount. If it is one of control groups of that kind that knows of memory: the path within, and where it is mounted.
fn mounted(line: &str, kind: &str) -> Option<(String, String)> {
    let (place, what) = line.split_once(" - ")?;
    let mut what = what.split(' ');
    let (found, options) = (what.next()?, what.nth(1).unwrap_or_default());
    let knows = kind == "cgroup2" || options.split(',').any(|option| option == "memory");
    let mut place = place.split(' ').skip(3).map(|path| path.replace("\\040", " "));
    (found == kind && knows).then_some((place.next()?, place.next()?))
}

/// Processors that this process may run on.
pub fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
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

    /// The least limit on the way from the process's group to the root counts, in both versions, also below a mount that begins elsewhere.
    #[test]
    fn the_least_limit_of_nested_groups_counts() {
        let v2 = "30 23 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw,nsdelegate\n";
        let v1 = "33 25 0:28 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n34 25 0:29 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n";
        let part = "30 23 0:26 /docker/ab /sys/fs/cgroup rw - cgroup2 cgroup rw\n";
        for (groups, mounts, limits, expected) in [
            (
                "0::/a.slice/b.scope\n",
                v2,
                &[("a.slice/b.scope/memory.max", "max"), ("a.slice/memory.max", "700")][..],
                Some(700),
            ),
            (
                "0::/a/b\n",
                v2,
                &[("a/b/memory.max", "500"), ("a/memory.max", "700"), ("a/memory.high", "600")],
                Some(500),
            ),
            (
                "0::/a/b\n",
                v2,
                &[("a/b/memory.max", "500"), ("a/memory.max", "700"), ("a/memory.high", "400")],
                Some(400),
            ),
            ("0::/\n", v2, &[("memory.max", "300")], Some(300)),
            ("0::/a\n", v2, &[("b/memory.max", "300"), ("a/memory.max", "max")], None),
            ("0::/docker/ab/job\n", part, &[("job/memory.max", "200"), ("memory.max", "900")], Some(200)),
            ("0::/../../job\n", v2, &[("job/memory.max", "200")], Some(200)),
            (
                "5:cpu:/x\n4:memory:/slurm/uid_0/job_7/step_0\n1:name=systemd:/y\n",
                v1,
                &[
                    ("memory/slurm/uid_0/job_7/memory.limit_in_bytes", "800"),
                    ("memory/slurm/memory.limit_in_bytes", "9223372036854771712"),
                    ("cpu/x/memory.limit_in_bytes", "1"),
                ],
                Some(800),
            ),
            ("", "", &[("memory.max", "300")], None),
        ] {
            let root = tempfile::tempdir().unwrap();
            let put = |path: &str, text: &str| {
                let path = root.path().join(path);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, text).unwrap();
            };
            put("proc/self/cgroup", groups);
            put("proc/self/mountinfo", mounts);
            limits.iter().for_each(|(path, text)| put(&format!("sys/fs/cgroup/{path}"), &format!("{text}\n")));
            assert_eq!(group_limit(root.path()), expected, "{groups}");
        }
    }
}
