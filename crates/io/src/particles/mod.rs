//! Particles from files: CSV as GPUDEM, ParaView and people write it, VTK's XML formats as GPUDEM, ParaView and glebe
//! itself write them, and PLY.

mod csv;
mod ply;

use std::{
    collections::BTreeMap,
    io,
    path::{Path, PathBuf},
};

use glebe_engine::spec::{MaterialId, ParticleSet, Vec3};
use thiserror::Error;

use crate::sheet::SheetError;
use crate::{input, vtk};

/// The particles of a file, column by column.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct ParticleColumns {
    /// Centres \[m\].
    pub position: Vec<Vec3>,
    /// Radii \[m\], > 0.
    pub radius: Vec<f64>,
    /// Velocities \[m/s\]; empty if the file has none.
    pub velocity: Vec<Vec3>,
    /// Angular velocities \[rad/s\]; empty if the file has none.
    pub spin: Vec<Vec3>,
    /// Names of columns that were not used.
    pub ignored: Vec<String>,
    materials: Materials,
    path: PathBuf,
}

/// What a file says of the particles' materials.
#[derive(Clone, Debug, Default, PartialEq)]
enum Materials {
    #[default]
    Nothing,
    /// Index into `names` for each particle; different names in order of appearance, each with the line that it
    /// is first in.
    Named { index: Vec<usize>, names: Vec<(String, u64)> },
    /// Numbers that count the materials of a scene from 0.
    Numbered(Vec<f64>),
}

/// Why particles could not be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ParticleError {
    /// The file cannot be opened or read.
    #[error("cannot read particle file `{}`: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no particle in it.
    #[error("particle file `{}` is empty: it needs a header `x,y,z,R` and a line for each particle", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A table that cannot be read.
    #[error("particle file `{}`{fault}", path.display())]
    Sheet {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: SheetError,
    },
    /// A PLY file that cannot be read.
    #[error("particle file `{}`{what}", path.display())]
    Ply {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A VTK file that cannot be read.
    #[error("particle file `{}`, line {line}: {what}", path.display())]
    Vtk {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
    /// A VTK file without an array that is needed, or with one of another shape.
    #[error("particle file `{}`: {what}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A number that no particle can have.
    #[error("particle file `{}`, particle {particle} (from 0): {name} is {value}; {problem}", path.display())]
    Particle {
        /// The file.
        path: PathBuf,
        /// Which one, from 0.
        particle: usize,
        /// Name of the array.
        name: String,
        /// The number.
        value: f64,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A file of numbers without a header has not four columns.
    #[error(
        "particle file `{}` has no header and {columns} columns: without a header there must be four (x, y, z, R); \
         add a header",
        path.display()
    )]
    NoHeader {
        /// The file.
        path: PathBuf,
        /// Columns of its first line.
        columns: usize,
    },
    /// A material that the scene does not define.
    #[error(
        "particle file `{}`, line {line}: material `{name}` is not defined; defined are {}",
        path.display(),
        listed(known)
    )]
    UnknownMaterial {
        /// The file.
        path: PathBuf,
        /// First line that names it.
        line: u64,
        /// The material.
        name: String,
        /// Materials that are defined.
        known: Vec<String>,
    },
    /// A material's number that counts beyond the scene's.
    #[error(
        "particle file `{}`, particle {particle} (from 0): its material is number {number}, but the scene has the \
         materials 0 to {}; set the material of all its particles in the scene, or mend the array",
        path.display(),
        known.saturating_sub(1)
    )]
    MaterialNumber {
        /// The file.
        path: PathBuf,
        /// Which one, from 0.
        particle: usize,
        /// The number.
        number: f64,
        /// Materials of the scene.
        known: usize,
    },
    /// Neither the file nor the scene says what the particles are made of.
    #[error("particle file `{}` has no column `material`: add one, or set the material of all its particles in the scene", path.display())]
    NoMaterial {
        /// The file.
        path: PathBuf,
    },
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// Reads the file `path`.
///
/// Files that begin with `<` are taken for VTK's XML (`.vtu`, `.vtp`: text, base64 or raw, uncompressed or with
/// zlib): points \[m\] and their arrays `radius` \[m\], which is needed, `velocity` \[m/s\], `angular_velocity`
/// \[rad/s\] and `material`, the scene's materials counted from 0.
///
/// Files that begin with a line `ply` are taken for PLY, as text or binary: the element `vertex` with the properties
/// `x`, `y`, `z` \[m\], `radius` \[m\] (or `r`), and optionally `vx`, `vy`, `vz` \[m/s\], `wx`, `wy`, `wz` \[rad/s\] and
/// `material`, the scene's materials counted from 0.
///
/// All others are taken for CSV. The first line names the columns, in any order and case: `x`, `y`, `z` \[m\] and `R`
/// \[m\] are needed; `vx`, `vy`, `vz` \[m/s\], `wx`, `wy`, `wz` \[rad/s\] and `material` (a name) are optional. A
/// heading may give its unit, as `x [mm]` or `R (cm)`. Names that ParaView gives are known too (`Points:0`,
/// `velocity:0`). A file of numbers only, in four columns, is taken as x, y, z, R. A `#` before the header is
/// allowed.
///
/// What is not known is left alone and listed in [`ParticleColumns::ignored`].
///
/// # Errors
/// A file that is missing, empty or none of these; a missing or doubled column; a line with another number of
/// fields; a value that is not a finite number; a radius ≤ 0. The message names the place.
pub fn read(path: &Path) -> Result<ParticleColumns, ParticleError> {
    let bytes = input::read(path).map_err(|source| ParticleError::Read { path: path.into(), source })?;
    parse(path, &bytes)
}

/// Like [`read`], of the `bytes` of the file called `path`.
///
/// # Errors
/// As [`read`], but for those of the system.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<ParticleColumns, ParticleError> {
    let columns = if bytes.trim_ascii_start().starts_with(b"<") {
        from_vtk(path, bytes)?
    } else if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r\n") {
        ply::parse(path, bytes)?
    } else {
        csv::parse(path, bytes)?
    };
    if columns.is_empty() {
        return Err(ParticleError::Empty { path: path.into() });
    }
    Ok(columns)
}

/// Names of arrays that mean the same, in lower case.
const RADIUS_ARRAYS: &[&str] = &["radius", "r"];
const VELOCITY_ARRAYS: &[&str] = &["velocity", "v"];
const SPIN_ARRAYS: &[&str] = &["angular_velocity", "angularvelocity", "omega"];
const MATERIAL_ARRAYS: &[&str] = &["material"];

fn from_vtk(path: &Path, bytes: &[u8]) -> Result<ParticleColumns, ParticleError> {
    let is = |names: &[&str], name: &str| names.contains(&name.to_ascii_lowercase().as_str());
    let all = [RADIUS_ARRAYS, VELOCITY_ARRAYS, SPIN_ARRAYS, MATERIAL_ARRAYS];
    let points = vtk::read(bytes, |name| all.iter().any(|names| is(names, name)))
        .map_err(|fault| ParticleError::Vtk { path: path.into(), line: fault.line, what: fault.what })?;
    let mut arrays = points.arrays;
    let mut take = |names: &[&str], components: usize| {
        let wrong = |what: String| ParticleError::Array { path: path.into(), what };
        let Some(at) = arrays.iter().position(|a| is(names, &a.name)) else { return Ok(None) };
        let array = arrays.swap_remove(at);
        if let Some(second) = arrays.iter().find(|a| is(names, &a.name)) {
            return Err(wrong(format!(
                "the arrays `{}` and `{}` mean the same: remove one",
                array.name, second.name
            )));
        }
        if array.components != components {
            let found = array.components;
            return Err(wrong(format!(
                "`{}` has {found} numbers for each point instead of {components}",
                array.name
            )));
        }
        if let Some(at) = array.values.iter().position(|x| !x.is_finite()) {
            let (path, particle, value) = (path.into(), at / components, array.values[at]);
            return Err(ParticleError::Particle {
                path,
                particle,
                name: array.name,
                value,
                problem: "numbers must be finite",
            });
        }
        Ok(Some(array))
    };
    let Some(radius) = take(RADIUS_ARRAYS, 1)? else {
        let mut found = points.others.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        if found.is_empty() {
            "none".clone_into(&mut found);
        }
        let what = format!(
            "no array `radius` belongs to its points; known are radius (needed), velocity, angular_velocity and \
             material, unknown here: {found}"
        );
        return Err(ParticleError::Array { path: path.into(), what });
    };
    let vectors =
        |array: Option<vtk::Array>| array.map(|a| a.values.as_chunks().0.to_vec()).unwrap_or_default();
    let velocity = vectors(take(VELOCITY_ARRAYS, 3)?);
    let spin = vectors(take(SPIN_ARRAYS, 3)?);
    let material = take(MATERIAL_ARRAYS, 1)?;
    let bad = |particle: usize, name: String, value: f64, problem: &'static str| {
        Err(ParticleError::Particle { path: path.into(), particle, name, value, problem })
    };
    if let Some(at) = points.position.iter().position(|x| !x.iter().all(|c| c.is_finite())) {
        let value = points.position[at].into_iter().find(|c| !c.is_finite()).unwrap_or_default();
        return bad(at, "a coordinate".to_owned(), value, "numbers must be finite");
    }
    if let Some(at) = radius.values.iter().position(|r| *r <= 0.0) {
        return bad(at, radius.name, radius.values[at], "it must be greater than 0");
    }
    Ok(ParticleColumns {
        position: points.position,
        radius: radius.values,
        velocity,
        spin,
        ignored: points.others,
        materials: material.map_or(Materials::Nothing, |a| Materials::Numbered(a.values)),
        path: path.into(),
    })
}

impl ParticleColumns {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there is none; never so for a file that was read.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// The materials that the file names, each once, in order of appearance.
    pub fn material_names(&self) -> impl Iterator<Item = &str> {
        let names = match &self.materials {
            Materials::Named { names, .. } => names.as_slice(),
            _ => &[],
        };
        names.iter().map(|(name, _)| name.as_str())
    }

    /// The particles with the ids that `known` gives to the materials' names. `default` is the material
    /// of particles in a file that names none; it replaces numbers, but no names that are there.
    ///
    /// # Errors
    /// A material that is not in `known`, or neither a name nor a default.
    pub fn into_set(
        self,
        known: &BTreeMap<String, MaterialId>,
        default: Option<MaterialId>,
    ) -> Result<ParticleSet, ParticleError> {
        let count = self.len();
        let material = match (self.materials, default) {
            (Materials::Named { index, names }, _) => {
                let mut ids = Vec::new();
                for (name, line) in names {
                    let Some(&id) = known.get(&name) else {
                        let known = known.keys().cloned().collect();
                        return Err(ParticleError::UnknownMaterial { path: self.path, line, name, known });
                    };
                    ids.push(id);
                }
                index.into_iter().map(|index| ids[index]).collect()
            }
            (_, Some(default)) => vec![default; count],
            (Materials::Numbered(numbers), None) => {
                let known = known.len();
                let is_one = |n: &f64| n.fract() == 0.0 && *n >= 0.0 && (*n as usize) < known;
                if let Some(particle) = numbers.iter().position(|n| !is_one(n)) {
                    let number = numbers[particle];
                    return Err(ParticleError::MaterialNumber { path: self.path, particle, number, known });
                }
                numbers.into_iter().map(|n| n as MaterialId).collect()
            }
            (Materials::Nothing, None) => return Err(ParticleError::NoMaterial { path: self.path }),
        };
        Ok(ParticleSet {
            position: self.position,
            radius: self.radius,
            material,
            velocity: self.velocity,
            spin: self.spin,
        })
    }
}
