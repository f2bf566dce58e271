//! Writes the f64 twin of `src/kernel`: the same source with the scalar type exchanged and the device
//! attributes removed, as one file of nested modules. The reference backend runs on it, so that a formula
//! stands in one place only.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let kernel = Path::new("src/kernel");
    println!("cargo::rerun-if-changed={}", kernel.display());
    println!("cargo::rerun-if-changed=build.rs");
    let out = env::var_os("OUT_DIR").ok_or_else(|| io::Error::other("OUT_DIR is not set by cargo"))?;
    fs::write(PathBuf::from(out).join("kernel64.rs"), folder(kernel)?)
}

/// The modules of a folder, in the order of their names.
fn folder(path: &Path) -> io::Result<String> {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(path)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    entries.sort();
    let mut text = String::new();
    for entry in entries {
        let name = entry.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let body = if entry.is_dir() {
            twin(&fs::read_to_string(entry.join("mod.rs"))?) + &folder(&entry)?
        } else if name == "mod" {
            continue;
        } else {
            twin(&fs::read_to_string(&entry)?)
        };
        write!(text, "#[allow(missing_docs, unused_imports)]\npub mod {name} {{\n{body}\n}}\n")
            .map_err(io::Error::other)?;
    }
    Ok(text)
}

/// One file in f64: no device attributes, no inner documentation, the registry without module files.
fn twin(source: &str) -> String {
    source
        .lines()
        .filter(|line| {
            !line.trim_start().starts_with("#[cfg_attr(feature = \"gpu\"") && !line.starts_with("//!")
        })
        .map(|line| {
            line.replace("f32", "f64")
                .replace("slot! {", "slot_enum! {")
                .replace("crate::cube::", "crate::native::")
                + "\n"
        })
        .collect()
}
