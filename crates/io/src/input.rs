//! Files that people give, and how much of them is read.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// The whole of a file. What is no ordinary file has no end, and what does not fit into memory is not begun with.
pub(crate) fn read(path: &Path) -> io::Result<Vec<u8>> {
    let found = fs::metadata(path)?;
    if !found.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is a folder or a device, not a file"));
    }
    if let Some(free) = free_memory().filter(|free| found.len() > *free) {
        let what = format!("it takes {}, but only {} of memory are free", size(found.len()), size(free));
        return Err(io::Error::new(ErrorKind::OutOfMemory, what));
    }
    fs::read(path)
}

/// A text of at most so many bytes, from anything that can be read.
pub(crate) fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let mut bytes = Vec::new();
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let what = format!("it is larger than {}: is it another file?", size(most));
        return Err(io::Error::new(ErrorKind::FileTooLarge, what));
    }
    String::from_utf8(bytes).map_err(|_| io::Error::new(ErrorKind::InvalidData, "it is not text (UTF-8)"))
}

/// Memory that the program may still take \[bytes\]: what the system can spare, and no more than its container
/// is allowed. None where that is not known.
pub fn free_memory() -> Option<u64> {
    let row = |path: &str, name: &str| {
        let text = fs::read_to_string(path).ok()?;
        let value = text.lines().find_map(|line| line.strip_prefix(name))?;
        value.trim().trim_end_matches("kB").trim().parse::<u64>().ok()
    };
    let spare = || Some(1024 * row("/proc/meminfo", "MemAvailable:")?);
    // The second version of control groups; `memory.max` is a word where there is no limit. Files that the system
    // keeps in memory count as used there, but give way.
    let allowed = || {
        let most = row("/sys/fs/cgroup/memory.max", "")?;
        Some(most.saturating_sub(row("/sys/fs/cgroup/memory.stat", "anon ")?))
    };
    [spare(), allowed()].into_iter().flatten().min()
}

/// A number of bytes for people.
pub(crate) fn size(bytes: u64) -> String {
    match bytes {
        0..10_000_000 => format!("{} kB", bytes.div_ceil(1000)),
        10_000_000..10_000_000_000 => format!("{} MB", bytes / 1_000_000),
        _ => format!("{} GB", bytes / 1_000_000_000),
    }
}
