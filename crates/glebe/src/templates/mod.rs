//! Scenes and studies to start from. One text per template, with the values that differ between its full and its quick
//! size marked `@name@`.

use std::path::Path;

use glebe_io::mesh::{StlFormat, write_stl};
use glebe_io::output::OutputError;
use glebe_io::tool::Sweep;

/// Name of the scene file.
pub const SCENE: &str = "scene.toml";
/// Name of the study file.
pub const STUDY: &str = "study.toml";

/// A scene to start from.
pub struct Template {
    /// Its name.
    pub name: &'static str,
    /// What it is, in a line.
    pub summary: &'static str,
    text: &'static str,
    /// Name of a value; the value in full and in quick size.
    values: &'static [(&'static str, &'static str, &'static str)],
    /// Name of the file that the parametric sweep is written to, if the scene has one.
    sweep: Option<&'static str>,
    /// The study of the scene, if it is one: the verb that runs it, and its text.
    study: Option<(&'static str, &'static str)>,
}

/// Every template.
pub const TEMPLATES: &[Template] = &[
    Template {
        name: "tillage",
        summary: "a sweep drawn through settled soil: draught force and furrow",
        text: include_str!("tillage.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A sweep through sandy soil", "A sweep through sandy soil, coarse"),
            ("step", "100 us", "200 us"),
            ("count", "38912", "4864"),
            ("radius", "\"7 mm\", \"10 mm\"", "\"14 mm\", \"20 mm\""),
        ],
        sweep: Some("sweep.stl"),
        study: None,
    },
    Template {
        name: "drum",
        summary: "grains in a rotating drum: torque",
        text: include_str!("drum.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A rotating drum", "A rotating drum, coarse"),
            ("count", "11000", "1400"),
            ("radius", "\"3.5 mm\", \"4.5 mm\"", "\"7 mm\", \"9 mm\""),
            ("step", "50 us", "100 us"),
            ("duration", "4 s", "1.2 s"),
            ("window", "2.0, 4.0", "0.6, 1.2"),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "silo",
        summary: "a silo that empties through a hopper: loads on its wall, mass flow",
        text: include_str!("silo.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A silo", "A silo, coarse"),
            ("step", "50 us", "100 us"),
            ("count", "22000", "2500"),
            ("radius", "\"4 mm\", \"5.5 mm\"", "\"8 mm\", \"10 mm\""),
            ("duration", "3 s", "1 s"),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "conveyor",
        summary: "a belt fed through a chute: mass flow, load on the belt",
        text: include_str!("conveyor.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A conveyor", "A conveyor, coarse and short"),
            ("end", "1.6", "0.7"),
            ("length", "1.5", "0.6"),
            ("openings", "\"8 mm\", \"12 mm\", \"20 mm\"", "\"16 mm\", \"20 mm\", \"30 mm\""),
            ("rate", "2 kg/s", "1.5 kg/s"),
            ("duration", "8 s", "3 s"),
            ("window", "5, 8", "2, 3"),
            ("spacing", "10 mm", "20 mm"),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "plate",
        summary: "a plate pressed into soil of a sieve curve: force over sinkage",
        text: include_str!("plate.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A plate on graded soil", "A plate on graded soil, coarse"),
            ("span", "1:20", "1:10"),
            ("half", "0.19", "0.14"),
            ("step", "20 us", "40 us"),
            ("count", "40000", "6000"),
            (
                "openings",
                "\"2 mm\", \"4 mm\", \"10 mm\", \"20 mm\", \"40 mm\"",
                "\"4 mm\", \"10 mm\", \"20 mm\", \"40 mm\"",
            ),
            ("passing", "0, \"1 %\", \"8 %\", \"35 %\", 1", "0, \"8 %\", \"35 %\", 1"),
            ("plate", "75 mm", "60 mm"),
            ("surface", "0.22", "0.12"),
            ("above", "0.255", "0.155"),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "deposition",
        summary: "a cloud of grains that settles in a box: energies",
        text: include_str!("deposition.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "Deposition", "Deposition, few"),
            ("count", "8519", "2000"),
            ("radius", "\"28 mm\", \"52 mm\"", "\"45 mm\", \"85 mm\""),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "triaxial",
        summary: "a periodic sample in a drained triaxial test: stress and volume over strain",
        text: include_str!("triaxial.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A drained triaxial test", "A drained triaxial test, few grains"),
            ("count", "2000", "400"),
            ("side", "39.5 mm", "23 mm"),
            ("rate", "2.4 1/s", "7.2 1/s"),
            ("inertial", "1e-3", "3e-3"),
            ("duration", "84 ms", "28 ms"),
            ("series", "0.5 ms", "0.2 ms"),
        ],
        sweep: None,
        study: None,
    },
    Template {
        name: "sweep",
        summary: "a study: the draught force of a blade over its width and speed",
        text: include_str!("blade.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("title", "A blade in dry soil", "A blade in dry soil, coarse"),
            ("step", "50 us", "80 us"),
            ("count", "13000", "1700"),
            ("radius", "\"4 mm\", \"5 mm\"", "\"8 mm\", \"10 mm\""),
            ("widths", "5", "4"),
            ("speeds", "5", "3"),
        ],
        sweep: None,
        study: Some(("sweep", include_str!("sweep.toml"))),
    },
    Template {
        name: "rve",
        summary: "a study: drained triaxial tests on periodic samples of several void ratios",
        text: include_str!("grains.toml"),
        values: &[
            ("small", "", ", in a size that ends within a minute"),
            ("count", "2000", "300"),
            ("side", "39.5 mm", "21 mm"),
            ("seeds", "5", "2"),
            ("pressure", "10 kPa", "50 kPa"),
            ("strain", "0.2", "0.1"),
            ("inertial", "1e-3", "1e-2"),
            ("void_ratios", "0.58, 0.62, 0.66, 0.70", "0.58, 0.66"),
        ],
        sweep: None,
        study: Some(("rve", include_str!("rve.toml"))),
    },
    Template {
        name: "calibration",
        summary: "a calibration: the soil for which a blade takes the draught forces that were measured",
        text: include_str!("blade.toml"),
        values: &[
            ("small", "", ", in a size that ends within some minutes"),
            ("title", "A blade in dry soil", "A blade in dry soil, coarse"),
            ("step", "50 us", "80 us"),
            ("count", "13000", "1700"),
            ("radius", "\"4 mm\", \"5 mm\"", "\"8 mm\", \"10 mm\""),
            ("population", "20", "6"),
            ("rounds", "30", "4"),
        ],
        sweep: None,
        study: Some(("calibrate", include_str!("calibration.toml"))),
    },
];

impl Template {
    /// The template of that name.
    pub fn named(name: &str) -> Option<&'static Self> {
        TEMPLATES.iter().find(|t| t.name == name)
    }

    /// The scene file.
    pub fn scene(&self, quick: bool) -> String {
        self.filled(self.text, quick)
    }

    /// The study file, if it is a study.
    pub fn study(&self, quick: bool) -> Option<String> {
        self.study.map(|(_, text)| self.filled(text, quick))
    }

    /// The verb that runs it, with the file that it takes.
    pub fn run_by(&self) -> (&'static str, &'static str) {
        self.study.map_or(("run", SCENE), |(verb, _)| (verb, STUDY))
    }

    fn filled(&self, text: &str, quick: bool) -> String {
        let value = |text: String, (name, full, small): &(&str, &str, &str)| {
            text.replace(&format!("@{name}@"), if quick { small } else { full })
        };
        self.values.iter().fold(text.to_owned(), value)
    }

    /// Writes the scene with its study and meshes into a folder that is there; returns the names of the files.
    ///
    /// # Errors
    /// [`OutputError::Io`].
    pub fn write(&self, folder: &Path, quick: bool) -> Result<Vec<&'static str>, OutputError> {
        let texts =
            self.study(quick).map(|text| (STUDY, text)).into_iter().chain([(SCENE, self.scene(quick))]);
        let mut files = Vec::new();
        for (name, text) in texts {
            glebe_io::output::write_atomic(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
            files.push(name);
        }
        if let Some(name) = self.sweep {
            let path = folder.join(name);
            // The default sweep is within its own limits.
            if let Ok(mesh) = Sweep::default().mesh() {
                write_stl(&path, &mesh, "sweep", StlFormat::Binary)
                    .map_err(|e| OutputError::Malformed { path: path.clone(), what: e.to_string() })?;
                files.push(name);
            }
        }
        Ok(files)
    }
}

#[cfg(test)]
mod tests {
    use super::TEMPLATES;
    use glebe_io::scene::Scene;

    #[test]
    fn every_template_is_a_scene_without_a_warning() {
        for template in TEMPLATES {
            for quick in [false, true] {
                let text = template.scene(quick);
                assert!(!text.contains('@'), "{}: a value is not filled in", template.name);
                let scene = Scene::parse(template.name, &text, &[]).expect(template.name);
                assert!(scene.warnings.is_empty(), "{}: {:?}", template.name, scene.warnings);
            }
        }
    }
}
