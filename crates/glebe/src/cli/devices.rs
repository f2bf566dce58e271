//! `glebe devices`: what can compute, and what cannot.

use std::fmt::Write as _;

use serde_json::json;

use super::Ui;
use crate::device::{Found, Listing};

/// Shows what hardware can be used, what cannot and why, and how to get it
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  glebe devices
  glebe devices --json")]
pub(super) struct Args {}

pub(super) fn run(ui: &Ui) {
    let listing = Listing::look();
    ui.result(&json!(listing), &told(&listing));
}

fn told(listing: &Listing) -> String {
    let mut text = String::new();
    for device in &listing.devices {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{:<8}{}", device.name, row(device, &listing.auto));
    }
    for missing in &listing.unavailable {
        let _ = writeln!(
            text,
            "{:<8}not usable: {}\n        to get it: {}",
            missing.what, missing.why, missing.remedy
        );
    }
    text
}

fn row(device: &Found, auto: &str) -> String {
    let size = |bytes: u64, what: &str| format!("{what}{:.1} GB", bytes as f64 / 1e9);
    let use_of_it = match (device.usable, device.name == auto) {
        (true, true) => "used by --device auto".to_owned(),
        (true, false) => format!("used by --device {}", device.name),
        (false, _) => "not usable".to_owned(),
    };
    let kind = (device.kind != "cpu").then(|| device.kind.to_owned());
    let facts = [
        Some(device.model.clone()),
        kind,
        device.threads.map(|threads| format!("{threads} threads")),
        device.through.clone(),
        device.memory_bytes.map(|bytes| size(bytes, "")),
        device.largest_buffer_bytes.map(|bytes| size(bytes, "buffers up to ")),
        Some(use_of_it),
    ];
    let facts = facts.into_iter().flatten().collect::<Vec<_>>().join(", ");
    device.remark.as_ref().map_or(facts.clone(), |remark| format!("{facts}: {remark}"))
}
