//! Every validation case has a page under `docs/cases`: its row in the table of cases, and what stands at the top of its
//! file. `GLEBE_WRITE_PAGES=1` writes them anew.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use glebe::validate::{Case, cases};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn file(case: &Case) -> String {
    format!("{}-{}.md", case.id, case.name)
}

/// What the case's file says of it: where its numbers come from, what was chosen.
fn header(case: &Case) -> String {
    let source = root().join(format!("crates/glebe/src/validate/{}.rs", case.id.to_lowercase()));
    let text = fs::read_to_string(&source).unwrap();
    let lines = text.lines().map_while(|line| line.strip_prefix("//!"));
    let lines: Vec<&str> = lines.map(|line| line.strip_prefix(' ').unwrap_or(line)).collect();
    assert!(lines.len() > 1, "{} says nothing of its case", source.display());
    lines.join("\n")
}

/// The scenes and studies of a case, as links.
fn files(case: &Case) -> Vec<String> {
    let all = fs::read_dir(root().join("validation")).unwrap().map(|entry| entry.unwrap());
    let own = all.filter(|entry| {
        entry.file_name().to_string_lossy().strip_prefix(case.id).is_some_and(|rest| rest.starts_with('-'))
    });
    let mut files: Vec<String> = own
        .flat_map(|folder| {
            let name = folder.file_name().into_string().unwrap();
            let inside = fs::read_dir(folder.path()).unwrap();
            inside.map(move |entry| format!("{name}/{}", entry.unwrap().file_name().into_string().unwrap()))
        })
        .collect();
    files.sort();
    files
}

fn page(case: &Case) -> String {
    let mut text =
        format!("# {}: {}\n\nShows: {}.\n\nSource: {}.\n\n", case.id, case.name, case.shows, case.source);
    text += &header(case);
    write!(text, "\n\n```sh\nglebe validate {} --quick\nglebe validate {}\n```\n", case.id, case.id).unwrap();
    let files = files(case);
    if !files.is_empty() {
        text += "\nScenes and studies, as they are run:";
        for file in files {
            write!(text, "\n- [{file}](../../validation/{file})").unwrap();
        }
        text.push('\n');
    }
    text
}

fn index() -> String {
    let mut text = "# Validation cases\n\n`glebe validate` runs all, `--quick` in small sizes: numbers with reference, \
                    tolerance and verdict, and figures beside the\nsource's. A are cases of GPUDEM, B of Chrono::GPU, C \
                    of periodic samples, P of properties that any engine must have.\n\n| case | shows | source |\n\
                    |---|---|---|\n"
        .to_owned();
    for case in cases() {
        let Case { id, name, shows, source, .. } = case;
        writeln!(text, "| [{id} {name}]({}) | {shows} | {source} |", file(case)).unwrap();
    }
    text
}

#[test]
fn every_case_has_its_page() {
    let folder = root().join("docs/cases");
    let mut pages: Vec<(String, String)> = cases().iter().map(|case| (file(case), page(case))).collect();
    pages.push(("README.md".to_owned(), index()));
    if std::env::var_os("GLEBE_WRITE_PAGES").is_some() {
        fs::create_dir_all(&folder).unwrap();
        for (name, text) in &pages {
            fs::write(folder.join(name), text).unwrap();
        }
    }
    for (name, text) in &pages {
        let found = fs::read_to_string(folder.join(name)).unwrap_or_default();
        assert_eq!(&found, text, "docs/cases/{name}; GLEBE_WRITE_PAGES=1 writes it");
    }
    for entry in fs::read_dir(&folder).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(pages.iter().any(|(page, _)| *page == name), "docs/cases/{name} is of no case");
    }
}
