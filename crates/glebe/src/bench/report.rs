//! Results of a benchmark as a table and as JSON.

use std::fmt::Write as _;

use glebe_engine::spec::Search;
use serde_json::{Value, json};

use super::bed::{Bed, Mode, SAMPLE_STEPS, WARM_UP};
use super::drum::FROUDE;
use super::grading::BedKind;
use super::timing::Row;
use super::{BenchArgs, BenchError};
use crate::device::processor;
use crate::validate::power_law;

/// What was asked for, on what: what must be the same in two runs for their rates to compare.
pub fn settings(args: &BenchArgs, device: &str) -> Value {
    json!({
        "optimised": !cfg!(debug_assertions),
        "device": device,
        "processor": processor(),
        "threads": rayon::current_num_threads(),
        "steps": args.steps,
        "warm_up_steps": WARM_UP,
        "sample_every_steps": SAMPLE_STEPS,
        "energy_ledger": args.ledger,
        "integrator": "euler",
    })
}

/// What a bed is.
pub fn bed(bed: &Bed, search: Search, worlds: usize) -> Result<Value, BenchError> {
    let drum = bed.drum()?.map(|drum| {
        json!({
            "radius_m": drum.radius,
            "length_m": drum.length(),
            "rate_rad_per_s": drum.rate(),
            "froude": FROUDE,
        })
    });
    let tool = bed.tool()?.map(|tool| json!({ "name": bed.mode.name(), "triangles": tool.triangles }));
    Ok(json!({
        "bed": bed.kind.name(),
        "mode": bed.mode.name(),
        "particles": bed.count,
        "search": search.name(),
        "worlds": worlds,
        "radii_m": bed.kind.radii(),
        "grading": bed.kind.grading(),
        "drum": drum,
        "tool": tool,
        "material": bed.kind.material(),
        "laws": ["hertz", "mindlin", bed.kind.rolling().law],
        "step_s": bed.kind.step(),
    }))
}

/// What a bed is called, by how results define it.
pub fn bed_name(bed: &Value) -> String {
    let word = |key: &str| bed[key].as_str().unwrap_or("?").to_owned();
    format!("{} {} bed of {} particles, {}", word("mode"), word("bed"), bed["particles"], word("search"))
}

pub fn json(rows: &[Row], args: &BenchArgs, device: &str) -> Result<Value, BenchError> {
    let mut beds = Vec::new();
    for r in rows {
        let [least, largest] = r.range();
        let mut found = bed(&r.bed, r.search, r.worlds)?;
        let measured = json!({
            "lost": r.lost,
            "first_step_s": r.first_step,
            "particle_steps_per_second": {
                "median": r.median(),
                "min": least,
                "max": largest,
                "all": r.rates,
            },
            "rate_over_settled": over_settled(rows, r),
            "phases": object(r.shares()),
            "rebuilds": r.rebuilds,
            "steps_per_rebuild": r.steps_per_rebuild(),
            "coordination": r.coordination,
            "ns_per_contact": 1e9 * r.time_per_contact(),
            "time_per_contact_over_mono": over_mono(rows, r),
            "bytes_per_particle": r.bytes_per_particle,
            "prepared_in_steps": r.prepare_steps,
            "bed_from_cache": r.cached,
        });
        if let (Value::Object(found), Value::Object(measured)) = (&mut found, measured) {
            found.extend(measured);
        }
        beds.push(found);
    }
    let of_search = |search: Search| {
        let exponents = Mode::ALL.map(|mode| {
            let fitted = exponents(rows, search).into_iter().filter(|fit| fit.1 == mode);
            (mode.name().to_owned(), object(fitted.map(|(kind, _, p)| (kind.name(), p))))
        });
        (search.name().to_owned(), Value::from(serde_json::Map::from_iter(exponents)))
    };
    Ok(json!({
        "version": env!("CARGO_PKG_VERSION"),
        "settings": settings(args, device),
        "repeat": args.repeat,
        "beds": beds,
        "cost_exponent": args.search.iter().map(|search| of_search(*search)).collect::<serde_json::Map<_, _>>(),
    }))
}

fn object(entries: impl Iterator<Item = (&'static str, f64)>) -> Value {
    entries.map(|(name, value)| (name.to_owned(), json!(value))).collect::<serde_json::Map<_, _>>().into()
}

/// The row of the settled bed of that kind and as many particles as `r`.
fn settled<'a>(rows: &'a [Row], kind: BedKind, r: &Row) -> Option<&'a Row> {
    let bed = Bed { kind, mode: Mode::Settled, count: r.bed.count };
    rows.iter().find(|s| s.bed == bed && s.search == r.search)
}

/// Of a flowing bed, its rate over that of the same spheres settled.
fn over_settled(rows: &[Row], r: &Row) -> Option<f64> {
    let settled = settled(rows, r.bed.kind, r).filter(|_| r.bed.mode == Mode::Flowing)?;
    Some(r.rate_over(settled))
}

/// The time of a contact over that in the settled mono bed.
fn over_mono(rows: &[Row], r: &Row) -> Option<f64> {
    Some(r.time_per_contact_over(settled(rows, BedKind::Mono, r)?))
}

pub fn table(rows: &[Row], args: &BenchArgs, device: &str) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let mut line = |l: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{l}");
    };
    let debug = if cfg!(debug_assertions) { ", a build with debug assertions" } else { "" };
    line(format_args!("glebe {}{debug} on {}, {}", env!("CARGO_PKG_VERSION"), processor(), device));
    let ledger = if args.ledger { "with" } else { "without" };
    line(format_args!(
        "{} steps, {} times, {ledger} energy ledger, a sample every {SAMPLE_STEPS} steps; rates in million \
         particle-steps/s{}",
        args.steps,
        args.repeat,
        if args.worlds > 1 {
            format!("; {} worlds of each bed together", args.worlds)
        } else {
            String::new()
        }
    ));
    let mut head = format!(
        "{:<5} {:<10} {:<9} {:>9} {:>7} {:>7} {:>7} {:>10} {:>8} {:>10} {:>7} {:>10} {:>7} {:>6}",
        "bed",
        "mode",
        "search",
        "particles",
        "rate",
        "best",
        "spread",
        "steps/list",
        "contacts",
        "ns/contact",
        "of mono",
        "of settled",
        "bytes/p",
        "first"
    );
    for (name, _) in rows.first().map_or(&[][..], |r| &r.phases) {
        let _ = write!(head, " {name:>11}");
    }
    line(format_args!("{head}"));
    for r in rows {
        let mut row = format!(
            "{:<5} {:<10} {:<9} {:>9} {:>7.2} {:>7.2} {:>6.1}% {:>10} {:>8.2} {:>10.1} {:>7} {:>10} {:>7.0} {:>6.2}",
            r.bed.kind.name(),
            r.bed.mode.name(),
            r.search.name(),
            r.bed.count,
            1e-6 * r.median(),
            1e-6 * r.range()[1],
            100.0 * r.spread(),
            shown(r.steps_per_rebuild(), |steps| format!("{steps:.0}")),
            r.coordination,
            1e9 * r.time_per_contact(),
            shown(over_mono(rows, r), |ratio| format!("{ratio:.2}")),
            shown(over_settled(rows, r), |ratio| format!("{:.0}%", 100.0 * ratio)),
            r.bytes_per_particle,
            r.first_step
        );
        for (_, share) in r.shares() {
            let _ = write!(row, " {:>10.1}%", 100.0 * share);
        }
        line(format_args!("{row}"));
    }
    for search in &args.search {
        for (kind, mode, exponent) in exponents(rows, *search) {
            let (kind, mode) = (kind.name(), mode.name());
            line(format_args!(
                "{mode} {kind}, {}: the cost of a step grows as N^{exponent:.3}",
                search.name()
            ));
        }
    }
    text
}

fn shown(value: Option<f64>, format: impl Fn(f64) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), format)
}

/// For beds of two or more sizes and a search, the exponent p of `time of a step ∝ N^p`.
fn exponents(rows: &[Row], search: Search) -> Vec<(BedKind, Mode, f64)> {
    let beds = BedKind::ALL.into_iter().flat_map(|kind| Mode::ALL.map(|mode| (kind, mode)));
    let fitted = beds.map(|(kind, mode)| {
        let of_kind = || rows.iter().filter(|r| (r.bed.kind, r.bed.mode, r.search) == (kind, mode, search));
        let n: Vec<f64> = of_kind().map(|r| r.bed.count as f64).collect();
        let cost: Vec<f64> = of_kind().map(|r| r.bed.count as f64 / r.median()).collect();
        (kind, mode, power_law(&n, &cost))
    });
    // One size, or the same twice, has no slope.
    fitted.filter(|fit| fit.2.is_finite()).collect()
}
