//! Spheres at random places, one after another, where there is room.

use super::grid::Grid;
use super::rng::{Purpose, Rng};
use super::{FillInfo, FillRequest, GenerateError, solid_volume};
use crate::spec::Vec3;

pub(super) const INFO: FillInfo = FillInfo {
    name: "random",
    summary: "random places, drawn again until there is no overlap; up to a solid fraction of about 0.35",
    fraction_max: 0.45,
    fraction_default: None,
    place,
};

/// Places tried for one sphere. Equal spheres stop at a fraction of 0.384 (Torquato, Uche and Stillinger
/// 2006, Phys. Rev. E 74, 061308) after endless trials; these suffice for 0.35.
const MOST_TRIALS: usize = 200_000;

fn place(request: &FillRequest) -> Result<Vec<Vec3>, GenerateError> {
    let region = request.filled();
    let images = region.images();
    let radii = request.radii;
    let mut rng = Rng::new(request.seed, Purpose::Positions);
    let mut positions = vec![[0.0; 3]; radii.len()];
    let mut grid = Grid::new(region, radii, 0.0);
    // Large spheres first: small ones find room between them, not the other way round.
    let order = grid.coarse_first();
    for (placed, &i) in order.iter().enumerate() {
        let found = (0..MOST_TRIALS).find_map(|_| {
            let x = [0, 1, 2].map(|k| {
                let (low, high) = region.reach(k, radii[i]);
                rng.between(low, high)
            });
            let mut free = true;
            grid.visit(i, x, |j| {
                let touch = radii[i] + radii[j];
                free &= images.distance_squared(x, positions[j]) >= touch * touch;
            });
            free.then_some(x)
        });
        let Some(x) = found else {
            let volume =
                |spheres: &[usize]| solid_volume(&spheres.iter().map(|&i| radii[i]).collect::<Vec<_>>());
            return Err(GenerateError::NoRoom {
                fill: INFO.name,
                placed,
                count: radii.len(),
                reached: volume(&order[..placed]) / region.volume(),
                asked: volume(&order) / region.volume(),
                advice:
                    "enlarge the region, take fewer or smaller spheres, or the fill `rain` (up to 0.45) or \
                         `dense`"
                        .into(),
            });
        };
        positions[i] = x;
        grid.insert(i, x);
    }
    Ok(positions)
}
