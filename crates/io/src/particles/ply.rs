//! Particles from PLY: the vertices, each with a radius.

use std::path::Path;

use super::{MATERIAL_ARRAYS, Materials, ParticleColumns, ParticleError, RADIUS_ARRAYS};
use crate::ply::{self, Body, Element, PlyFault};

/// Names of properties, in lower case, by the number that they are.
const NUMBERS: [&[&str]; 11] = [
    &["x"],
    &["y"],
    &["z"],
    RADIUS_ARRAYS,
    &["vx"],
    &["vy"],
    &["vz"],
    &["wx"],
    &["wy"],
    &["wz"],
    MATERIAL_ARRAYS,
];

/// Reads a whole file.
pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<ParticleColumns, ParticleError> {
    let of_file = |fault: PlyFault| ParticleError::Ply { path: path.into(), what: fault.to_string() };
    let columns = ply::read(bytes, vertices).map_err(of_file)?;
    let bad = |particle: usize, name: &str, value: f64, problem: &'static str| {
        Err(ParticleError::Particle { path: path.into(), particle, name: name.to_owned(), value, problem })
    };
    for k in 0..columns.len() {
        let moving = columns.velocity.get(k).into_iter().chain(columns.spin.get(k)).flatten();
        let numbers = columns.position[k].iter().chain([&columns.radius[k]]).chain(moving);
        if let Some(value) = numbers.into_iter().find(|x| !x.is_finite()) {
            return bad(k, "a number", *value, "numbers must be finite");
        }
        if columns.radius[k] <= 0.0 {
            return bad(k, "radius", columns.radius[k], "it must be greater than 0");
        }
    }
    Ok(ParticleColumns { path: path.into(), ..columns })
}

/// The element `vertex`; others are passed over.
fn vertices(elements: &[Element], body: &mut Body<'_>) -> Result<ParticleColumns, PlyFault> {
    let mut columns = ParticleColumns::default();
    let mut materials = Vec::new();
    for element in elements {
        if element.name != "vertex" {
            element.skip(body)?;
            continue;
        }
        let at = NUMBERS.map(|names| element.find(names).filter(|k| element.properties[*k].list.is_none()));
        let all = |range: std::ops::Range<usize>| at[range].iter().all(Option::is_some);
        if !all(0..4) {
            return Err(element.missing("vertices with the properties x, y, z and radius"));
        }
        let some = |range: std::ops::Range<usize>| at[range].iter().any(Option::is_some);
        for (range, expected) in [
            (4..7, "vertices with vx, vy and vz, or none of them"),
            (7..10, "vertices with wx, wy and wz, or none of them"),
        ] {
            if some(range.clone()) && !all(range) {
                return Err(element.missing(expected));
            }
        }
        let used = |k: usize| at.contains(&Some(k));
        let unused = element.properties.iter().enumerate().filter(|(k, _)| !used(*k));
        columns.ignored = unused.map(|(_, p)| p.name.clone()).collect();
        let mut row = Vec::new();
        for _ in 0..element.count {
            let mut numbers = [0.0; NUMBERS.len()];
            for (k, property) in element.properties.iter().enumerate() {
                property.read(body, &mut row)?;
                if let Some(which) = at.iter().position(|p| *p == Some(k)) {
                    numbers[which] = row[0];
                }
            }
            let vector = |first: usize| [numbers[first], numbers[first + 1], numbers[first + 2]];
            columns.position.push(vector(0));
            columns.radius.push(numbers[3]);
            if all(4..7) {
                columns.velocity.push(vector(4));
            }
            if all(7..10) {
                columns.spin.push(vector(7));
            }
            if all(10..11) {
                materials.push(numbers[10]);
            }
        }
    }
    if !materials.is_empty() {
        columns.materials = Materials::Numbered(materials);
    }
    Ok(columns)
}
