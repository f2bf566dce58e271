//! Rates beside those of an earlier run, where both did the same.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::BenchError;
use super::report::bed_name;
use super::timing::Row;

/// A file of results is not larger \[bytes\].
const LARGEST: u64 = 16 << 20;
/// What is told of differences at most.
const TOLD: usize = 8;

/// Results that `--out` wrote.
#[derive(Debug)]
pub struct Earlier {
    path: String,
    version: String,
    settings: Map<String, Value>,
    beds: Vec<Map<String, Value>>,
}

impl Earlier {
    /// Reads results.
    ///
    /// # Errors
    /// [`BenchError::Compare`] for what cannot be read, or is no such file.
    pub fn read(path: &Path) -> Result<Self, BenchError> {
        let name = path.display().to_string();
        let wrong = |why: String| BenchError::Compare { path: name.clone(), why };
        let mut text = String::new();
        let found = File::open(path).and_then(|file| file.take(LARGEST + 1).read_to_string(&mut text));
        found.map_err(|e| wrong(format!("cannot be read: {e}")))?;
        if text.len() as u64 > LARGEST {
            return Err(wrong("is larger than results are: is it another file?".to_owned()));
        }
        let none = |what: &str| wrong(format!("is not what `glebe bench --out` writes: {what}"));
        let value: Value = serde_json::from_str(&text).map_err(|e| none(&e.to_string()))?;
        let settings = value["settings"].as_object().ok_or_else(|| none("it has no `settings`"))?.clone();
        let beds = value["beds"].as_array().ok_or_else(|| none("it has no `beds`"))?;
        let bed = |bed: &Value| match bed.as_object() {
            Some(bed) if rates(bed).is_some() => Ok(bed.clone()),
            _ => Err(none("a bed has no rates above 0")),
        };
        let beds = beds.iter().map(bed).collect::<Result<_, _>>()?;
        let version = value["version"].as_str().unwrap_or("of unknown version").to_owned();
        Ok(Self { path: name, version, settings, beds })
    }

    /// Whether what will be done now is what was done then; `beds` are defined as in results. Beds that were not timed
    /// then are let through, as long as there is one that was.
    ///
    /// # Errors
    /// [`BenchError::Compare`] with everything that differs.
    pub fn fits(&self, settings: &Value, beds: &[Value]) -> Result<(), BenchError> {
        let mut differ = differences("", settings, &self.settings);
        let mut common = 0;
        for bed in beds {
            if let Some(then) = self.beds.iter().find(|then| same_name(bed, then)) {
                common += 1;
                differ.extend(differences(&format!("{}: ", bed_name(bed)), bed, then));
            }
        }
        let why = if !differ.is_empty() {
            let more = differ.len().saturating_sub(TOLD);
            let more = if more > 0 { format!("\n  and {more} more") } else { String::new() };
            differ.truncate(TOLD);
            format!(
                "does not compare with this run, as what was measured is not the same:\n  {}{more}\nGive the options that \
                 it was written with, or leave --compare out",
                differ.join("\n  ")
            )
        } else if common == 0 {
            let names: Vec<_> = self.beds.iter().map(|bed| bed_name(&Value::Object(bed.clone()))).collect();
            format!("has none of the beds asked for; it has: {}", names.join("; "))
        } else {
            return Ok(());
        };
        Err(BenchError::Compare { path: self.path.clone(), why })
    }

    /// Adds to the beds of `results` what `rows` came to beside the earlier rates, and tells it as lines.
    pub fn compare(&self, results: &mut Value, rows: &[Row]) -> String {
        let mut text = format!("rates over those in {} (glebe {}):\n", self.path, self.version);
        let Some(beds) = results["beds"].as_array_mut() else { return text };
        for (bed, row) in beds.iter_mut().zip(rows) {
            let Some(then) = self.beds.iter().find(|then| same_name(bed, then)).and_then(rates) else {
                let _ = writeln!(text, "  {}: not timed then", bed_name(bed));
                continue;
            };
            let [least, largest] = row.range();
            let ratio = row.median() / then.median;
            let range = [least / then.largest, largest / then.least];
            let within = range[0] <= 1.0 && 1.0 <= range[1];
            bed["rate_over_earlier"] = json!({ "median": ratio, "min": range[0], "max": range[1] });
            let _ = writeln!(
                text,
                "  {}: {ratio:.3}, from {:.3} to {:.3} by the spread of both{}",
                bed_name(bed),
                range[0],
                range[1],
                if within { ": no difference that repeats would show" } else { "" }
            );
        }
        text
    }
}

/// Rates of a bed \[particle-steps/s\].
struct Rates {
    median: f64,
    least: f64,
    largest: f64,
}

fn rates(bed: &Map<String, Value>) -> Option<Rates> {
    let rate = |key: &str| {
        bed.get("particle_steps_per_second")?.get(key)?.as_f64().filter(|x| x.is_finite() && *x > 0.0)
    };
    Some(Rates { median: rate("median")?, least: rate("min")?, largest: rate("max")? })
}

/// Whether two beds are meant to be the same.
fn same_name(bed: &Value, then: &Map<String, Value>) -> bool {
    ["bed", "mode", "particles", "search"].into_iter().all(|key| then.get(key) == Some(&bed[key]))
}

/// What of `now` is another then.
fn differences(whose: &str, now: &Value, then: &Map<String, Value>) -> Vec<String> {
    let keys = now.as_object().into_iter().flatten();
    let other = keys.filter(|(key, value)| then.get(*key).unwrap_or(&Value::Null) != *value);
    let none = Value::Null;
    other
        .map(|(key, value)| {
            format!("{whose}{key} is {value} now and {} there", then.get(key).unwrap_or(&none))
        })
        .collect()
}
