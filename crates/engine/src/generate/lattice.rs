//! Spheres on a regular grid.

use std::f64::consts::PI;

use super::{FillInfo, FillRequest, GenerateError, solid_volume};
use crate::spec::Vec3;

pub(super) const INFO: FillInfo = FillInfo {
    name: "lattice",
    summary: "cubic grid with the largest sphere's diameter as pitch, from the floor up; no overlap",
    fraction_max: PI / 6.0,
    fraction_default: None,
    place,
};

/// A share of a pitch by which the last row may miss the wall: rounding.
const SLACK: f64 = 1e-9;

fn place(request: &FillRequest) -> Result<Vec<Vec3>, GenerateError> {
    let region = &request.region;
    let largest = request.largest();
    let mean_volume = solid_volume(request.radii) / request.radii.len() as f64;
    let tightest = 2.0 * largest;
    // With a solid fraction asked for, each sphere has the cube that this gives it.
    let pitch = request.solid_fraction.map_or(tightest, |fraction| libm::cbrt(mean_volume / fraction));
    if pitch < tightest * (1.0 - SLACK) {
        let most = mean_volume / (tightest * tightest * tightest);
        let allowed =
            format!("at most {most:.4} on a lattice whose pitch is the largest sphere's diameter [-]");
        return Err(GenerateError::invalid(
            "solid_fraction",
            request.solid_fraction.unwrap_or(most),
            allowed,
        ));
    }
    let rows = [0, 1, 2].map(|k| {
        let room = region.width(k) / pitch + SLACK;
        // Between walls the outermost spheres touch them; along a periodic axis the last row is a pitch
        // from the first.
        let rows = if region.periodic[k] { room } else { (region.width(k) - tightest) / pitch + SLACK + 1.0 };
        rows.max(1.0) as usize
    });
    let count = request.radii.len();
    let places = rows[0].saturating_mul(rows[1]).saturating_mul(rows[2]);
    if count > places {
        let whole = solid_volume(request.radii) / region.volume();
        return Err(GenerateError::NoRoom {
            fill: INFO.name,
            placed: places,
            count,
            reached: whole * places as f64 / count as f64,
            asked: whole,
            advice: "enlarge the region, take fewer or smaller spheres, or another fill".into(),
        });
    }
    let (up, a, b) = (request.up, (request.up + 1) % 3, (request.up + 2) % 3);
    let at = |k: usize, row: usize| {
        let (low, high) = region.reach(k, largest);
        (low + row as f64 * pitch).min(high)
    };
    let place = |i: usize| {
        let mut x = [0.0; 3];
        x[a] = at(a, i % rows[a]);
        x[b] = at(b, i / rows[a] % rows[b]);
        x[up] = at(up, i / (rows[a] * rows[b]));
        x
    };
    Ok((0..count).map(place).collect())
}
