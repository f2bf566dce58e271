//! Tools that scenes can name: their keys, and what becomes of them.

use super::check::Record;
use super::fields::{ANGLE, LENGTH};
use super::table::{Field, Kind, Rule, TableSpec};
use crate::tool::{Blade, Drum, Mixer, Plough, Sweep, Tool, Wheel};

pub(super) static SWEEP: TableSpec = TableSpec {
    doc: "A cultivator sweep. Its nose is the origin, x the direction of travel, z up. Defaults are those of `tool::Sweep`.",
    fields: &[
        Field::new("width", LENGTH, "Between the ends of the wings, along y [m].").or("0.313").above(0.0),
        Field::new("length", LENGTH, "From the nose to the rear of the wings, along x [m].")
            .or("0.289")
            .above(0.0),
        Field::new("sweep_angle", ANGLE, "Full angle between the leading edges, seen from above [rad].")
            .or("\"66 deg\"")
            .above(0.0)
            .usual(0.0, 3.2),
        Field::new("lift_angle", ANGLE, "Rise of the plate from its leading edges [rad].")
            .or("\"25 deg\"")
            .at_least(0.0)
            .usual(0.0, 1.6),
        Field::new("body_length", LENGTH, "Length of the plate on its middle line, along x [m].")
            .or("0.150")
            .above(0.0),
        Field::new("thickness", LENGTH, "Thickness of the plate [m].").or("0.006").above(0.0),
        Field::new("edge_thickness", LENGTH, "Thickness at the leading edges [m].").or("0.0008").above(0.0),
        Field::new("bevel", LENGTH, "Width of the ground strip along the leading edges [m].")
            .or("0.010")
            .above(0.0),
        Field::new("shank_width", LENGTH, "Size of the shank along the travel [m].").or("0.050").above(0.0),
        Field::new("shank_thickness", LENGTH, "Size of the shank across the travel [m].")
            .or("0.020")
            .above(0.0),
        Field::new("shank_height", LENGTH, "Height of the shank's upper end above the leading edges [m].")
            .or("0.400")
            .above(0.0),
        Field::new("shank_setback", LENGTH, "From the nose back to the front of the shank's foot [m].")
            .or("0.075")
            .above(0.0),
        Field::new(
            "shank_lean",
            ANGLE,
            "Inclination of the shank [rad], positive with its upper end forward.",
        )
        .or("0.0")
        .usual(-1.6, 1.6),
        Field::new("resolution", LENGTH, "Length aimed at for the lines of the mesh [m].")
            .or("0.012")
            .above(0.0),
    ],
    rules: &[],
};

pub(super) static BLADE: TableSpec = TableSpec {
    doc: "A flat plate across the travel, such as a bulldozer's blade. The lower edge of its front is the origin, x the direction of travel, z up. Defaults are those of `tool::Blade`.",
    fields: &[
        Field::new("width", LENGTH, "Along y [m].").or("0.3").above(0.0),
        Field::new("height", LENGTH, "Along z [m].").or("0.3").above(0.0),
        Field::new("thickness", LENGTH, "Across the plate [m].").or("0.01").above(0.0),
        Field::new(
            "rake_angle",
            ANGLE,
            "Between the ground ahead and the front [rad]; below 90 deg the upper edge leans back.",
        )
        .or("\"90 deg\"")
        .above(0.0)
        .usual(0.0, 3.2),
        Field::new("resolution", LENGTH, "Length aimed at for the lines of the mesh [m].")
            .or("0.05")
            .above(0.0),
    ],
    rules: &[],
};

const TURNS: &[&str] = &["right", "left"];

pub(super) static PLOUGH: TableSpec = TableSpec {
    doc: "Share and mouldboard of a plough as one sheet. The point of the share is the origin, x the direction of travel, z up; it turns the slice to -y. Defaults are those of `tool::Plough`.",
    fields: &[
        Field::new("width", LENGTH, "Working width, along y [m].").or("0.35").above(0.0),
        Field::new("height", LENGTH, "Along z [m].").or("0.35").above(0.0),
        Field::new("share_angle", ANGLE, "Between the cutting edge and the travel [rad].")
            .or("\"42 deg\"")
            .above(0.0)
            .usual(0.0, 1.6),
        Field::new("top_angle", ANGLE, "Between the upper edge and the travel [rad].")
            .or("\"48 deg\"")
            .above(0.0)
            .usual(0.0, 1.6),
        Field::new("lift_angle", ANGLE, "Inclination of the board at the point of the share [rad].")
            .or("\"25 deg\"")
            .above(0.0)
            .usual(0.0, 1.6),
        Field::new(
            "curl_angle",
            ANGLE,
            "Inclination of the board at its top [rad]; it hangs over beyond 90 deg.",
        )
        .or("\"105 deg\"")
        .above(0.0)
        .usual(0.0, 3.2),
        Field::new("thickness", LENGTH, "Along the travel [m].").or("0.012").above(0.0),
        Field::new("turn", Kind::Words(TURNS), "To which side the slice is turned: -y is right.")
            .or("\"right\""),
        Field::new("resolution", LENGTH, "Length aimed at for the lines of the mesh [m].")
            .or("0.025")
            .above(0.0),
    ],
    rules: &[],
};

pub(super) static WHEEL: TableSpec = TableSpec {
    doc: "A rigid wheel about y, its centre the origin; a positive rate about y rolls it forward. Defaults are those of `tool::Wheel`.",
    fields: &[
        Field::new("radius", LENGTH, "Of the rim, without grousers [m].").or("0.15").above(0.0),
        Field::new("width", LENGTH, "Along y [m].").or("0.16").above(0.0),
        Field::new("grousers", Kind::Integer, "How many grousers; 0 for a smooth wheel.")
            .or("24")
            .at_least(0.0)
            .at_most(1e4),
        Field::new("grouser_height", LENGTH, "How far they stand out from the rim [m].")
            .or("0.01")
            .above(0.0),
        Field::new("grouser_thickness", LENGTH, "Along the rim [m].").or("0.003").above(0.0),
        Field::new("segments", Kind::Integer, "Flat pieces of the rim.").or("72").at_least(3.0).at_most(1e5),
    ],
    rules: &[],
};

pub(super) static DRUM: TableSpec = TableSpec {
    doc: "A cylinder shell centred at the origin, with straight lifters inside or without.",
    fields: &[
        Field::new("radius", LENGTH, "Inner radius [m].").above(0.0),
        Field::new("length", LENGTH, "Length along the axis [m].").above(0.0),
        Field::new("axis", Kind::Direction, "Its axis.").or("\"y\""),
        Field::new("segments", Kind::Integer, "Flat pieces around.").or("72").at_least(3.0).at_most(1e5),
        Field::new("ends", Kind::Bool, "Whether its ends are closed.").or("true"),
        Field::new("lifters", Kind::Integer, "How many lifters; 0 for a smooth drum.")
            .optional("no lifters")
            .at_least(0.0)
            .at_most(1e4),
        Field::new("lifter_height", LENGTH, "How far they stand inwards from the shell [m].")
            .optional("no lifters")
            .above(0.0),
        Field::new("lifter_thickness", LENGTH, "Along the shell [m].").optional("no lifters").above(0.0),
    ],
    rules: &[Rule::Needs("lifter_height", &["lifters"]), Rule::Needs("lifter_thickness", &["lifters"])],
};

pub(super) static MIXER: TableSpec = TableSpec {
    doc: "Rows of blades on a shaft about z, the middle of its lower end the origin. Defaults are those of `tool::Mixer`.",
    fields: &[
        Field::new("radius", LENGTH, "Of the blades' tips [m].").or("0.1").above(0.0),
        Field::new("shaft_radius", LENGTH, "Of the shaft [m].").or("0.015").above(0.0),
        Field::new("shaft_length", LENGTH, "Of the shaft, along z [m].").or("0.3").above(0.0),
        Field::new("blades", Kind::Integer, "Blades in a row.").or("4").at_least(1.0).at_most(64.0),
        Field::new("blade_height", LENGTH, "Of a blade, along z [m].").or("0.04").above(0.0),
        Field::new("blade_thickness", LENGTH, "Of a blade, across it seen from above [m].").or("0.006").above(0.0),
        Field::new(
            "pitch",
            ANGLE,
            "Inclination of the blades' tips from the axis [rad]; positive lifts when they turn positively about z.",
        )
        .or("0.0")
        .usual(-1.6, 1.6),
        Field::new("rows", Kind::Integer, "Rows of blades.").or("1").at_least(1.0).at_most(1e3),
        Field::new("first_row", LENGTH, "From the shaft's lower end to the lowest row [m].").or("0.0").at_least(0.0),
        Field::new("row_spacing", LENGTH, "From a row's lower edge to that of the next [m].").or("0.08").above(0.0),
        Field::new("segments", Kind::Integer, "Flat pieces of the shaft.").or("32").at_least(3.0).at_most(360.0),
    ],
    rules: &[],
};

/// A number of things.
pub(super) fn count(t: &Record, key: &str) -> u32 {
    u32::try_from(t.integer(key)).unwrap_or(u32::MAX)
}

/// The tool that a table of this key describes, if it is one.
pub(super) fn read(key: &str, t: &Record) -> Option<Tool> {
    let angle = |key| t.number(key).to_degrees();
    Some(match key {
        "sweep" => Tool::Sweep(Sweep {
            width: t.number("width"),
            length: t.number("length"),
            sweep_angle: angle("sweep_angle"),
            lift_angle: angle("lift_angle"),
            body_length: t.number("body_length"),
            thickness: t.number("thickness"),
            edge_thickness: t.number("edge_thickness"),
            bevel: t.number("bevel"),
            shank_width: t.number("shank_width"),
            shank_thickness: t.number("shank_thickness"),
            shank_height: t.number("shank_height"),
            shank_setback: t.number("shank_setback"),
            shank_lean: angle("shank_lean"),
            resolution: t.number("resolution"),
        }),
        "blade" => Tool::Blade(Blade {
            width: t.number("width"),
            height: t.number("height"),
            thickness: t.number("thickness"),
            rake_angle: angle("rake_angle"),
            resolution: t.number("resolution"),
        }),
        "plough" => Tool::Plough(Plough {
            width: t.number("width"),
            height: t.number("height"),
            share_angle: angle("share_angle"),
            top_angle: angle("top_angle"),
            lift_angle: angle("lift_angle"),
            curl_angle: angle("curl_angle"),
            thickness: t.number("thickness"),
            left: t.text("turn") == TURNS[1],
            resolution: t.number("resolution"),
        }),
        "wheel" => Tool::Wheel(Wheel {
            radius: t.number("radius"),
            width: t.number("width"),
            grousers: count(t, "grousers"),
            grouser_height: t.number("grouser_height"),
            grouser_thickness: t.number("grouser_thickness"),
            segments: count(t, "segments"),
        }),
        "drum" => Tool::Drum(Drum {
            radius: t.number("radius"),
            length: t.number("length"),
            axis: t.vector("axis"),
            segments: count(t, "segments"),
            ends: t.flag("ends"),
            lifters: if t.has("lifters") { count(t, "lifters") } else { 0 },
            lifter_height: t.number_if("lifter_height").unwrap_or(0.0),
            lifter_thickness: t.number_if("lifter_thickness").unwrap_or(0.0),
        }),
        "mixer" => Tool::Mixer(Mixer {
            radius: t.number("radius"),
            shaft_radius: t.number("shaft_radius"),
            shaft_length: t.number("shaft_length"),
            blades: count(t, "blades"),
            blade_height: t.number("blade_height"),
            blade_thickness: t.number("blade_thickness"),
            pitch: angle("pitch"),
            rows: count(t, "rows"),
            first_row: t.number("first_row"),
            row_spacing: t.number("row_spacing"),
            segments: count(t, "segments"),
        }),
        _ => return None,
    })
}
