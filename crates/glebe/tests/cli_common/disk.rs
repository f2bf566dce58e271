//! Disks that fill, and that may only be read: file systems in memory, mounted where nobody else sees them.

use std::fs;
use std::io::Write as _;
use std::process::{Command, Stdio};

use super::{Ended, Place};

/// Runs a program on a disk of so many kB, `sizes[0]`, then again on one of `sizes[1]`, and so on with what is there;
/// after the last the disk may only be read, and it is run once more. Copies the disk to `kept`.
const SCRIPT: &str = r#"
program=$1 sizes=$2
shift 2
mkdir -p disk kept
mount -t tmpfs -o size=64k tmpfs disk || exit 77
mkdir disk/out
try() {
    code=0
    "$program" "$@" >try.stdout 2>try.stderr || code=$?
    ls -RA disk >try.left
    for what in stdout stderr left; do mv "try.$what" "try$number.$what"; done
    echo $code >"try$number.code"
    number=$((number + 1))
}
number=0
for size in $sizes; do
    mount -o "remount,size=${size}k" tmpfs disk || exit 77
    try "$@"
done
cp -R disk/. kept
mount -o remount,ro tmpfs disk || exit 77
try "$@"
"#;

/// A try to run a program, and all files that it left.
#[derive(Debug)]
pub struct Try {
    pub ended: Ended,
    pub left: String,
}

impl Try {
    fn read(place: &Place, number: usize) -> Self {
        let part = |name: &str| fs::read_to_string(place.path(&format!("try{number}.{name}"))).unwrap();
        let ended = Ended {
            code: part("code").trim().parse().unwrap(),
            stdout: part("stdout"),
            stderr: part("stderr"),
        };
        Self { ended, left: part("left") }
    }
}

/// Runs a command that goes on where it was and writes into `disk/out`, on disks that are larger each time (kB) and all
/// too small but the last one; there it must end well. At last it is run where nothing may be written. What is on the
/// disk then lies in `kept/out`. False, and a line about it, where no file system can be mounted: that takes Linux with
/// user namespaces, or the rights of root.
#[must_use]
pub fn on_disks_that_fill(place: &Place, args: &[&str], sizes: &[u32]) -> bool {
    let sizes_text = sizes.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
    let mounted = ["-rm", "-m"].into_iter().any(|spaces| {
        let mut shell = Command::new("unshare");
        shell.args([spaces, "sh", "-c", SCRIPT, "sh", env!("CARGO_BIN_EXE_glebe"), &sizes_text]).args(args);
        shell.current_dir(place.path("")).env("GLEBE_CACHE", place.path("cache"));
        let status = shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
        status.is_ok_and(|s| s.success())
    });
    if !mounted {
        // Tests that pass are not shown; this is.
        let _ = writeln!(
            std::io::stderr(),
            "not tested: no file system can be mounted here (`unshare -rm` or `unshare -m`), so no disk fills"
        );
        return false;
    }
    for (number, size) in sizes.iter().enumerate() {
        let Try { ended, left } = Try::read(place, number);
        let last = number + 1 == sizes.len();
        assert!(!left.contains("partial"), "half-written on a disk of {size} kB:\n{left}");
        if last {
            ended.expect(0);
        } else {
            ended.expect(1).says(&["the disk is full: free some space on it, then go on with --resume"]);
        }
    }
    let Try { ended, left } = Try::read(place, sizes.len());
    ended.expect(1).says(&["the disk is mounted read-only: choose another place with --out"]);
    assert_eq!(left, Try::read(place, sizes.len() - 1).left, "what was there is gone");
    true
}
