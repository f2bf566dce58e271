//! What a stage surveys at its end, and what makes no sense of it.

use glebe_engine::spec::{Class, Surveyed, Vec3};

use super::check::{Checker, Record};
use super::error::{Located, SceneError};
use super::model::{SurveyPart, corners};

/// Most samples of a Lacey index.
const MOST_SAMPLES: f64 = 1e6;

/// A survey of a stage; none if something is wrong with it.
pub(super) fn survey(
    name: &Located<String>,
    record: &Record,
    file: &Record,
    checker: &mut Checker,
) -> Option<SurveyPart> {
    let survey = One { path: format!("survey.{}", name.value), record };
    let of = match record.text("of").as_str() {
        "bulk-density" => {
            survey.without(&["spacing", "material", "radius_above"], "a bulk density", checker);
            let (min, max) = survey.region("of which part of the bed?", checker)?;
            Surveyed::BulkDensity { min, max }
        }
        "lacey-index" => survey.lacey(file, checker)?,
        _ => {
            let keys = ["region", "spacing", "material", "radius_above"];
            survey.without(&keys, "an angle of repose", checker);
            Surveyed::AngleOfRepose
        }
    };
    Some(SurveyPart { name: name.value.clone(), of })
}

struct One<'a> {
    path: String,
    record: &'a Record,
}

impl One<'_> {
    /// Refuses keys that mean nothing here.
    fn without(&self, keys: &[&str], of: &str, checker: &mut Checker) {
        for key in keys.iter().filter(|key| self.record.written(key)) {
            let message = format!("`{}.{key}` means nothing of {of}", self.path);
            let help = if *key == "region" {
                "take it away: the slope is that of the heap of all particles"
            } else {
                "take it away: only `lacey-index` has samples of a class"
            };
            checker.error(
                SceneError::new("conflict", self.record.place(key), message)
                    .label("has no effect")
                    .help(help),
            );
        }
    }

    fn missing(&self, key: &str, label: &str, help: &str, checker: &mut Checker) {
        if !self.record.written(key) {
            let message = format!("`{}` needs `{key}`", self.path);
            checker
                .error(SceneError::new("missing", self.record.place("of"), message).label(label).help(help));
        }
    }

    fn region(&self, label: &str, checker: &mut Checker) -> Option<(Vec3, Vec3)> {
        let Some(region) = self.record.table("region") else {
            let help = "write region = { min = [0, 0, 0], max = [0.1, 0.1, 0.1] }, inside the bed";
            self.missing("region", label, help, checker);
            return None;
        };
        Some(corners(region, &format!("{}.region", self.path), checker))
    }

    fn lacey(&self, file: &Record, checker: &mut Checker) -> Option<Surveyed> {
        let record = self.record;
        let region = self.region("mixed in which part of the bed?", checker);
        let spacing = record.number_if("spacing");
        if spacing.is_none() {
            let help = "write spacing = \"20 mm\": samples of a few tens of particles are usual";
            self.missing("spacing", "how large is a sample?", help, checker);
        }
        let class = self.class(file, checker);
        let ((min, max), spacing, class) = (region?, spacing?, class?);
        let count = [0, 1, 2].map(|k| ((max[k] - min[k]) / spacing).round().max(1.0));
        let number: f64 = count.iter().product();
        if !(2.0..=MOST_SAMPLES).contains(&number) {
            let message = format!("`{}` has {number:.0} samples", self.path);
            checker.error(
                SceneError::new("range", record.place("spacing"), message).label("this width").help(format!(
                    "2 to {MOST_SAMPLES:.0} are compared with each other; take another `spacing` or `region`"
                )),
            );
            return None;
        }
        Some(Surveyed::LaceyIndex { class, min, max, samples: count.map(|n| n as usize) })
    }

    fn class(&self, file: &Record, checker: &mut Checker) -> Option<Class> {
        let record = self.record;
        if let Some(radius) = record.number_if("radius_above") {
            return Some(Class::RadiusAbove(radius));
        }
        let Some(material) = record.located_if("material") else {
            if !record.written("radius_above") {
                let help =
                    "write material = \"NAME\", or radius_above = \"3 mm\", for the class that is counted";
                self.missing("material", "which class of particles?", help, checker);
            }
            return None;
        };
        let found = file.named("material").iter().position(|(name, _)| name.value == material.value);
        if found.is_none() {
            let message = format!("`{}` is built in, and no class of this scene", material.value);
            checker.error(
                SceneError::new("unknown", &material.place, message)
                    .label("this material")
                    .help(format!("write [material.{}] with its values", material.value)),
            );
        }
        found.map(Class::Material)
    }
}
