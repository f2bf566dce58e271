//! Curves that were measured.
#![no_main]

use glebe_io::study::measured::{Headings, parse};
use glebe_io::units::Dimension;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let x = ("displacement", Dimension::LENGTH);
    let headings = Headings { x, y: ("force", Dimension::FORCE), scatter: Some("sd") };
    let _ = parse("fuzz.csv".as_ref(), data, headings);
});
