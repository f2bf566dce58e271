//! The columns of `series.csv` and of the curves of periodic samples: their names, in order, and what they hold.

use crate::units::Dimension;

/// A column: its name and what it holds.
pub type Column = (&'static str, Dimension);

const NONE: Dimension = Dimension::NONE;
const ENERGY: Dimension = Dimension::ENERGY;
const FORCE: Dimension = Dimension::FORCE;
const LENGTH: Dimension = Dimension::LENGTH;
const PRESSURE: Dimension = Dimension::PRESSURE;
const TORQUE: Dimension = Dimension::TORQUE;

/// The first columns of a series.
const WORLD: [Column; 23] = [
    ("time", Dimension::TIME),
    ("step", NONE),
    ("stage", NONE),
    ("particles", NONE),
    ("kinetic_translation", ENERGY),
    ("kinetic_rotation", ENERGY),
    ("potential", ENERGY),
    ("elastic_normal", ENERGY),
    ("elastic_tangential", ENERGY),
    ("friction", ENERGY),
    ("dashpots", ENERGY),
    ("rolling", ENERGY),
    ("damping", ENERGY),
    ("dissipated", ENERGY),
    ("stiffness_change", ENERGY),
    ("work", ENERGY),
    ("removed", ENERGY),
    ("integrator", ENERGY),
    ("contacts", NONE),
    ("surface_contacts", NONE),
    ("coordination", NONE),
    ("overlap", NONE),
    ("speed", Dimension::VELOCITY),
];

/// Columns of each surface, behind its name and a dot.
const SURFACE: [Column; 16] = [
    ("fx", FORCE),
    ("fy", FORCE),
    ("fz", FORCE),
    ("tx", TORQUE),
    ("ty", TORQUE),
    ("tz", TORQUE),
    ("draught", FORCE),
    ("path", LENGTH),
    ("present", NONE),
    ("x", LENGTH),
    ("y", LENGTH),
    ("z", LENGTH),
    ("qw", NONE),
    ("qx", NONE),
    ("qy", NONE),
    ("qz", NONE),
];

/// Column of a surface that wears, behind its name and a dot: the volume that it has lost.
const WEAR: Column = ("wear", Dimension::VOLUME);

/// Columns of the inside of a world that is periodic along all axes, before its tensors.
const INSIDE: [Column; 7] = [
    ("p", PRESSURE),
    ("q", PRESSURE),
    ("volumetric_strain", NONE),
    ("deviatoric_strain", NONE),
    ("void_ratio", NONE),
    ("mechanical_coordination", NONE),
    ("rattlers", NONE),
];

/// Its tensors, each a column for each component.
const TENSORS: [Column; 4] =
    [("stress", PRESSURE), ("kinetic_stress", PRESSURE), ("strain", NONE), ("fabric", NONE)];

/// Components of a symmetric tensor, and their names.
pub const SYMMETRIC: [([usize; 2], &str); 6] =
    [([0, 0], "xx"), ([1, 1], "yy"), ([2, 2], "zz"), ([1, 2], "yz"), ([0, 2], "xz"), ([0, 1], "xy")];

/// Columns of bonds, where there may be some.
const BONDS: [Column; 2] = [("bonds_made", NONE), ("bonds_broken", NONE)];

/// Column of what inlets brought, where there are inlets or outlets.
const ENTERED: Column = ("entered", ENERGY);

/// Columns of each inlet and outlet, behind its name and a dot.
const DOOR: [Column; 3] = [("particles", NONE), ("mass", Dimension::MASS), ("rate", Dimension::MASS_RATE)];

/// What a series has columns for.
#[derive(Clone, Debug, Default)]
pub struct Shown<'a> {
    /// Surfaces by name, and whether they wear.
    pub surfaces: Vec<(&'a str, bool)>,
    /// Inlets, then outlets, by name.
    pub doors: Vec<&'a str>,
    /// Whether there may be bonds.
    pub bonds: bool,
    /// Whether stress and strain of the inside are known.
    pub sample: bool,
}

/// The columns of `series.csv`, in order.
pub fn series(shown: &Shown<'_>) -> Vec<String> {
    let mut names: Vec<String> = WORLD.iter().map(|(name, _)| (*name).to_owned()).collect();
    if shown.bonds {
        names.extend(BONDS.map(|(name, _)| name.to_owned()));
    }
    for (surface, wears) in &shown.surfaces {
        let wear = wears.then_some(&WEAR);
        names.extend(SURFACE.iter().chain(wear).map(|(part, _)| format!("{surface}.{part}")));
    }
    if !shown.doors.is_empty() {
        names.push(ENTERED.0.to_owned());
    }
    for door in &shown.doors {
        names.extend(DOOR.iter().map(|(part, _)| format!("{door}.{part}")));
    }
    if shown.sample {
        names.extend(INSIDE.iter().map(|(name, _)| (*name).to_owned()));
        for (tensor, _) in TENSORS {
            names.extend(SYMMETRIC.map(|(_, component)| format!("{tensor}_{component}")));
        }
    }
    names
}

/// What a column of `series.csv` holds; none if no scene has one of that name.
pub fn in_series(name: &str) -> Option<Dimension> {
    let of = |columns: &[Column], name: &str| columns.iter().find(|(n, _)| *n == name).map(|(_, d)| *d);
    if let Some((_, part)) = name.rsplit_once('.') {
        return of(&SURFACE, part).or_else(|| of(&[WEAR], part)).or_else(|| of(&DOOR, part));
    }
    let tensor = || {
        let (tensor, component) = name.rsplit_once('_')?;
        SYMMETRIC.iter().any(|(_, c)| *c == component).then(|| of(&TENSORS, tensor))?
    };
    of(&WORLD, name)
        .or_else(|| of(&BONDS, name))
        .or_else(|| of(&[ENTERED], name))
        .or_else(|| of(&INSIDE, name))
        .or_else(tensor)
}

/// The columns of the curve of a periodic sample, in order: time, stage, strain along what the loading drives, volumetric
/// and deviatoric strain, mean and deviatoric stress, strain and stress by component, void ratio, mechanical coordination,
/// particles with fewer than two contacts, kinetic over elastic energy. Time and strain begin with the loading.
pub const CURVE: [Column; 23] = [
    ("time", Dimension::TIME),
    ("stage", NONE),
    ("strain", NONE),
    ("eps_v", NONE),
    ("eps_q", NONE),
    ("p", PRESSURE),
    ("q", PRESSURE),
    ("eps_xx", NONE),
    ("eps_yy", NONE),
    ("eps_zz", NONE),
    ("eps_yz", NONE),
    ("eps_xz", NONE),
    ("eps_xy", NONE),
    ("stress_xx", PRESSURE),
    ("stress_yy", PRESSURE),
    ("stress_zz", PRESSURE),
    ("stress_yz", PRESSURE),
    ("stress_xz", PRESSURE),
    ("stress_xy", PRESSURE),
    ("void_ratio", NONE),
    ("coordination", NONE),
    ("rattlers", NONE),
    ("kinetic_over_elastic", NONE),
];

/// What a column of the curve of a periodic sample holds.
pub fn in_curve(name: &str) -> Option<Dimension> {
    CURVE.iter().find(|(n, _)| *n == name).map(|(_, d)| *d)
}

/// Numbers that a periodic sample comes to, by which `worlds.csv` and calibrations know them.
pub const SAMPLE_NUMBERS: [Column; 15] = [
    ("prepared.friction", NONE),
    ("prepared.void_ratio", NONE),
    ("consolidated.void_ratio", NONE),
    ("consolidated.coordination", NONE),
    ("consolidated.p", PRESSURE),
    ("consolidated.q", PRESSURE),
    ("consolidated.chi_square_xy", NONE),
    ("consolidated.chi_square_xz", NONE),
    ("peak.q_over_p", NONE),
    ("peak.strain", NONE),
    ("last.q_over_p", NONE),
    ("last.p", PRESSURE),
    ("last.q", PRESSURE),
    ("last.void_ratio", NONE),
    ("last.eps_v", NONE),
];
