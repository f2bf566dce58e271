//! Results of a benchmark as a table and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::BenchArgs;
use super::bed::{Bed, BedKind, SAMPLE_STEPS, WARM_UP};
use super::timing::Row;
use crate::validate::power_law;

pub fn json(rows: &[Row], args: &BenchArgs) -> Value {
    let beds = rows.iter().map(|r| {
        json!({
            "bed": r.bed.kind.name(),
            "particles": r.bed.count,
            "step_s": r.bed.kind.step(),
            "particle_steps_per_second": {
                "median": r.median(),
                "min": r.rates.first(),
                "max": r.rates.last(),
                "all": r.rates,
            },
            "phases": object(r.phases.iter().copied()),
            "rebuilds": r.rebuilds,
            "coordination": r.coordination,
            "bytes_per_particle": r.bytes_per_particle,
            "settled_in_steps": r.settle_steps,
            "bed_from_cache": r.cached,
        })
    });
    let m = Bed::material();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "optimised": !cfg!(debug_assertions),
        "device": crate::run::device(),
        "processor": processor(),
        "threads": rayon::current_num_threads(),
        "settings": {
            "steps": args.steps,
            "warm_up_steps": WARM_UP,
            "repeat": args.repeat,
            "sample_every_steps": SAMPLE_STEPS,
            "energy_ledger": args.ledger,
            "integrator": "euler",
            "laws": ["hertz", "mindlin", "constant-torque"],
            "material": m,
        },
        "beds": beds.collect::<Vec<_>>(),
        "cost_exponent": object(exponents(rows).into_iter().map(|(kind, p)| (kind.name(), p))),
    })
}

fn object(entries: impl Iterator<Item = (&'static str, f64)>) -> Value {
    entries.map(|(name, value)| (name.to_owned(), json!(value))).collect::<serde_json::Map<_, _>>().into()
}

pub fn table(rows: &[Row], args: &BenchArgs) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let mut line = |l: std::fmt::Arguments<'_>| {
        let _ = writeln!(text, "{l}");
    };
    let debug = if cfg!(debug_assertions) { ", a build with debug assertions" } else { "" };
    line(format_args!(
        "glebe {}{debug} on {}, {}",
        env!("CARGO_PKG_VERSION"),
        processor(),
        crate::run::device()
    ));
    let ledger = if args.ledger { "with" } else { "without" };
    line(format_args!(
        "{} steps, {} times, {ledger} energy ledger, a sample every {SAMPLE_STEPS} steps; rates in million \
         particle-steps/s",
        args.steps, args.repeat
    ));
    let phases: Vec<&str> = rows.first().map_or(Vec::new(), |r| r.phases.iter().map(|p| p.0).collect());
    let mut head = format!(
        "{:<5} {:>10} {:>8} {:>7} {:>9} {:>8} {:>9}",
        "bed", "particles", "rate", "spread", "rebuilds", "contacts", "bytes/p"
    );
    for name in &phases {
        let _ = write!(head, " {name:>12}");
    }
    line(format_args!("{head}"));
    for r in rows {
        let mut row = format!(
            "{:<5} {:>10} {:>8.2} {:>6.1}% {:>9} {:>8.2} {:>9.0}",
            r.bed.kind.name(),
            r.bed.count,
            1e-6 * r.median(),
            100.0 * r.spread(),
            r.rebuilds,
            r.coordination,
            r.bytes_per_particle
        );
        for (_, share) in &r.phases {
            let _ = write!(row, " {:>11.1}%", 100.0 * share);
        }
        line(format_args!("{row}"));
    }
    for (kind, exponent) in exponents(rows) {
        line(format_args!("{}: the cost of a step grows as N^{exponent:.3}", kind.name()));
    }
    text
}

/// For beds of two or more sizes, the exponent p of `time of a step ∝ N^p`.
fn exponents(rows: &[Row]) -> Vec<(BedKind, f64)> {
    let kinds = [BedKind::Mono, BedKind::Poly];
    let fitted = kinds.into_iter().map(|kind| {
        let of_kind = || rows.iter().filter(|r| r.bed.kind == kind);
        let n: Vec<f64> = of_kind().map(|r| r.bed.count as f64).collect();
        let cost: Vec<f64> = of_kind().map(|r| r.bed.count as f64 / r.median()).collect();
        (kind, power_law(&n, &cost))
    });
    // One size, or the same twice, has no slope.
    fitted.filter(|(_, p)| p.is_finite()).collect()
}

/// The processor's name where the system tells it, else its architecture.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let named =
        info.lines().find_map(|l| l.strip_prefix("model name")?.split_once(':').map(|(_, n)| n.trim()));
    named.unwrap_or(std::env::consts::ARCH).to_owned()
}
