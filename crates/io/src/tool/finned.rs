//! Bodies of flat pieces around an axis, with fins along it.

use std::f64::consts::{FRAC_PI_3, TAU};

use glebe_engine::spec::Vec3;

use super::sheet;
use crate::mesh::Corners;

/// How a circle is divided: into fins, whose sides are parallel, and the flat pieces between them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Around {
    fins: u32,
    thickness: f64,
    /// Pieces from one fin to the next.
    pieces: u32,
}

impl Around {
    /// About `segments` pieces around, and `fins` of a `thickness` \[m\] besides; none makes all pieces alike.
    pub(super) fn new(fins: u32, thickness: f64, segments: u32) -> Self {
        let pieces = segments.checked_div(fins).map_or(segments, |each| each.max(1));
        Self { fins, thickness, pieces }
    }

    /// The largest thickness of fins that leaves a tenth of the circle of `radius` free between them.
    pub(super) fn thickest(fins: u32, radius: f64) -> f64 {
        2.0 * radius * (0.45 * TAU / f64::from(fins)).min(FRAC_PI_3).sin()
    }

    /// Pieces around, fins included.
    fn cells(self) -> usize {
        (if self.fins == 0 { self.pieces } else { self.fins * (1 + self.pieces) }) as usize
    }

    /// Whether a piece is a fin.
    pub(super) fn is_fin(self, cell: usize) -> bool {
        self.fins > 0 && cell.is_multiple_of(1 + self.pieces as usize)
    }

    /// Where a piece begins at a radius \[rad\].
    fn angle(self, cell: usize, radius: f64) -> f64 {
        let cell = cell % self.cells();
        if self.fins == 0 {
            return TAU * cell as f64 / f64::from(self.pieces);
        }
        let (fin, piece) = (cell / (1 + self.pieces as usize), cell % (1 + self.pieces as usize));
        let pitch = TAU / f64::from(self.fins);
        let half = (0.5 * self.thickness / radius).asin();
        let within = match piece {
            0 => -half,
            k => half + (k - 1) as f64 / f64::from(self.pieces) * (pitch - 2.0 * half),
        };
        fin as f64 * pitch + within
    }
}

/// A body around an axis: a core up to the first of `radii` \[m\], and in the ring up to the second what `filled` says
/// of each piece and layer. `point` gives the place of an angle \[rad\], a radius \[m\] and a level; angles go
/// right-handed about the way from level to level. Only ends that are `closed` have faces.
pub(super) fn body(
    around: Around,
    radii: [f64; 2],
    layers: usize,
    closed: [bool; 2],
    filled: impl Fn(usize, usize) -> bool,
    point: impl Fn(f64, f64, usize) -> Vec3,
) -> Vec<Corners> {
    let cells = around.cells();
    let at =
        |cell: usize, ring: usize, level: usize| point(around.angle(cell, radii[ring]), radii[ring], level);
    let mut soup = Vec::new();
    for (cell, layer) in (0..cells).flat_map(|cell| (0..layers).map(move |layer| (cell, layer))) {
        let next = cell + 1;
        let ends = [(layer == 0, layer), (layer + 1 == layers, layer + 1)];
        for (end, (is_end, level)) in ends.into_iter().enumerate() {
            if is_end && closed[end] {
                let middle = point(0.0, 0.0, level);
                let [a, b] = if end == 0 { [next, cell] } else { [cell, next] };
                soup.push([middle, at(a, 0, level), at(b, 0, level)]);
            }
        }
        let outer = usize::from(filled(cell, layer));
        sheet(&mut soup, 0..1, 0..1, |u, v| at(cell + u, outer, layer + v));
        if outer == 0 {
            continue;
        }
        // Both sides of a fin are cut alike, so that one that is twisted keeps its thickness.
        for (side, beside) in [(cell, (cell + cells - 1) % cells), (next, next % cells)] {
            if !filled(beside, layer) {
                let [a, b] = [at(side, 0, layer), at(side, 1, layer)];
                let [c, d] = [at(side, 1, layer + 1), at(side, 0, layer + 1)];
                soup.extend(if side == cell { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
            }
        }
        let bare_below = if layer == 0 { closed[0] } else { !filled(cell, layer - 1) };
        if bare_below {
            sheet(&mut soup, 0..1, 0..1, |u, v| at(cell + u, v, layer));
        }
        let bare_above = if layer + 1 == layers { closed[1] } else { !filled(cell, layer + 1) };
        if bare_above {
            sheet(&mut soup, 0..1, 0..1, |u, v| at(cell + v, u, layer + 1));
        }
    }
    soup
}
