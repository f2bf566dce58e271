//! Tells the program which commit it was built from, for the provenance in its results; silent outside a checkout.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=../../.git/HEAD");
    println!("cargo::rerun-if-changed=../../.git/refs/heads");
    let git = Command::new("git").args(["rev-parse", "--short=12", "HEAD"]).output();
    if let Ok(out) = git
        && out.status.success()
        && let Ok(commit) = String::from_utf8(out.stdout)
    {
        println!("cargo::rustc-env=GLEBE_COMMIT={}", commit.trim());
    }
}
