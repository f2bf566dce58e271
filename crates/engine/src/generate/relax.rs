//! Spheres at random, pushed apart until they no longer overlap.
//!
//! The start is an even scatter; overlaps cost energy as the square of their depth, and FIRE (Bitzek et
//! al. 2006, Phys. Rev. Lett. 97, 170201) goes downhill. Below random close packing, about 0.64 for
//! equal spheres, the energy vanishes (O'Hern et al. 2003, Phys. Rev. E 68, 011306).

use super::grid::Grid;
use super::region::{Images, Region};
use super::rng::{Purpose, Rng};
use super::{FillRequest, GenerateError, solid_fraction};
use crate::spec::Vec3;

/// Steps of one descent; what still overlaps then is shaken and descends again. Most packings need fewer
/// steps, but flat walls some ten spheres apart jam random ones below 0.60 (Desmond and Weeks 2009, Phys.
/// Rev. E 80, 051305), and shaking lets layers form along them.
const DESCENT: usize = 400;

/// Largest displacement in a shake along each axis, as a share of the radius.
const SHAKE: f64 = 0.55;

/// Descents before a packing is given up: as many as move this number of spheres in all, within bounds.
const MOST_MOVES: usize = 40_000_000;
const DESCENTS: [usize; 2] = [10, 50];

/// Packs the request's spheres into its filled part until no two overlap by more than `tolerance` of the
/// smaller radius. Spheres push each other as if their radii were larger by the factor `inflation`,
/// which leaves room between them and ends in fewer steps. Returns centres \[m\] in the order of the radii.
pub(super) fn pack(
    fill: &'static str,
    request: &FillRequest,
    inflation: f64,
    tolerance: f64,
) -> Result<Vec<Vec3>, GenerateError> {
    let region = request.filled();
    let count = request.radii.len();
    let mut rng = Rng::new(request.seed, Purpose::Positions);
    let (order, start) = scatter(&region, request.radii, &mut rng);
    let radii: Vec<f64> = order.iter().map(|&i| request.radii[i]).collect();
    let mut descent = Descent::new(&region, &radii, start, inflation);
    let mut overlap = f64::INFINITY;
    for _ in 0..(MOST_MOVES / (DESCENT * count)).clamp(DESCENTS[0], DESCENTS[1]) {
        for _ in 0..DESCENT {
            overlap = descent.forces();
            if overlap <= tolerance {
                return Ok(in_order(&order, descent.positions.iter().map(|&x| region.wrap(x))));
            }
            descent.advance();
        }
        descent.shake(&mut rng);
    }
    let asked = solid_fraction(&radii, &region);
    Err(GenerateError::Jammed { fill, count, asked, overlap: 100.0 * overlap })
}

/// Puts what belongs to sphere `order[k]` from place `k` to place `order[k]`.
fn in_order(order: &[usize], positions: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
    let mut sorted = vec![[0.0; 3]; order.len()];
    for (&i, x) in order.iter().zip(positions) {
        sorted[i] = x;
    }
    sorted
}

/// Multiples of these fill a cube evenly, however many are taken: powers of 1/g, where g⁴ = g + 1, the
/// additive recurrence of M. Roberts (2018, "The unreasonable effectiveness of quasirandom sequences").
const RATES: Vec3 = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2];

/// Spheres in random order and where they start: spread evenly and disordered, from the low side of the
/// last axis to its high side, so that neighbours in space are near in memory.
fn scatter(region: &Region, radii: &[f64], rng: &mut Rng) -> (Vec<usize>, Vec<Vec3>) {
    let n = radii.len();
    let shift = [rng.unit(), rng.unit(), rng.unit()];
    // Half a spacing either way takes their order away.
    let spacing = libm::cbrt(1.0 / n as f64);
    let mut points: Vec<Vec3> = (0..n)
        .map(|i| {
            [0, 1, 2].map(|k| {
                let jitter = rng.between(-0.5, 0.5) * spacing;
                (shift[k] + (i + 1) as f64 * RATES[k] + jitter).rem_euclid(1.0)
            })
        })
        .collect();
    points.sort_by(|a, b| a[2].total_cmp(&b[2]));
    let order = rng.permutation(n);
    for (x, &i) in points.iter_mut().zip(&order) {
        *x = [0, 1, 2].map(|k| {
            let (low, high) = region.reach(k, radii[i]);
            low + (high - low) * x[k]
        });
    }
    (order, points)
}

/// FIRE's state. Lengths are in metres, the stiffness of an overlap is 1, and a sphere's mass is the
/// square of its radius over the smallest one: large spheres have as many more contacts.
struct Descent<'a> {
    region: &'a Region,
    images: Images,
    radii: &'a [f64],
    inflation: f64,
    positions: Vec<Vec3>,
    velocities: Vec<Vec3>,
    forces: Vec<Vec3>,
    masses: Vec<f64>,
    /// Pairs that may overlap before one of them has moved half the skin, and where they were then.
    pairs: Vec<(u32, u32)>,
    listed_at: Vec<Vec3>,
    skin: f64,
    dt: f64,
    mixing: f64,
    downhill: u32,
}

impl<'a> Descent<'a> {
    // FIRE's published parameters, with time in units of the contact's sqrt(mass / stiffness).
    const DT_START: f64 = 0.1;
    const DT_MAX: f64 = 0.4;
    const MIXING: f64 = 0.1;
    const PATIENCE: u32 = 5;

    fn new(region: &'a Region, radii: &'a [f64], positions: Vec<Vec3>, inflation: f64) -> Self {
        let n = radii.len();
        let smallest = radii.iter().copied().fold(f64::INFINITY, f64::min);
        Self {
            region,
            images: region.images(),
            radii,
            inflation,
            positions,
            velocities: vec![[0.0; 3]; n],
            forces: vec![[0.0; 3]; n],
            masses: radii.iter().map(|r| (r / smallest) * (r / smallest)).collect(),
            pairs: Vec::new(),
            listed_at: Vec::new(),
            skin: 0.5 * smallest,
            dt: Self::DT_START,
            mixing: Self::MIXING,
            downhill: 0,
        }
    }

    /// Forces at the current positions; returns the deepest true overlap as a share of the smaller radius.
    fn forces(&mut self) -> f64 {
        if self.list_is_stale() {
            self.list();
        }
        self.forces.fill([0.0; 3]);
        let mut worst = 0.0_f64;
        for &(i, j) in &self.pairs {
            let (i, j) = (i as usize, j as usize);
            let d = self.images.difference(self.positions[i], self.positions[j]);
            let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let touch = self.radii[i] + self.radii[j];
            let apart = touch * self.inflation;
            if square < apart * apart {
                let distance = square.sqrt();
                if distance < touch {
                    worst = worst.max((touch - distance) / self.radii[i].min(self.radii[j]));
                }
                // Two centres in one point have no direction: any will do.
                let (push, d) = if distance > 0.0 {
                    ((apart - distance) / distance, d)
                } else {
                    (apart, [0.0, 0.0, 1.0])
                };
                for (k, d) in d.into_iter().enumerate() {
                    self.forces[i][k] += push * d;
                    self.forces[j][k] -= push * d;
                }
            }
        }
        worst
    }

    /// One step of FIRE; centres slide along walls.
    fn advance(&mut self) {
        let (mut power, mut speed, mut pull) = (0.0, 0.0, 0.0);
        for ((f, v), m) in self.forces.iter().zip(&self.velocities).zip(&self.masses) {
            for k in 0..3 {
                power += f[k] * v[k];
                speed += v[k] * v[k];
                pull += (f[k] / m) * (f[k] / m);
            }
        }
        let mut turn = 0.0;
        if power > 0.0 {
            self.downhill += 1;
            turn = self.mixing * (speed / pull).sqrt();
            if self.downhill > Self::PATIENCE {
                self.dt = (self.dt * 1.1).min(Self::DT_MAX);
                self.mixing *= 0.99;
            }
        } else {
            self.downhill = 0;
            self.dt = (self.dt * 0.5).max(0.02 * Self::DT_MAX);
            self.mixing = Self::MIXING;
            self.velocities.fill([0.0; 3]);
        }
        let keep = if power > 0.0 { 1.0 - self.mixing } else { 0.0 };
        // No centre jumps past a neighbour.
        let longest = 0.5 * self.skin;
        for i in 0..self.positions.len() {
            for k in 0..3 {
                let push = self.forces[i][k] / self.masses[i];
                let v = keep * self.velocities[i][k] + (turn + self.dt) * push;
                let held = self.shift(i, k, (v * self.dt).clamp(-longest, longest));
                self.velocities[i][k] = if held { 0.0 } else { v };
            }
        }
    }

    /// Moves every centre a little at random, and stops all.
    fn shake(&mut self, rng: &mut Rng) {
        for i in 0..self.positions.len() {
            for k in 0..3 {
                self.shift(i, k, SHAKE * self.radii[i] * rng.between(-1.0, 1.0));
            }
        }
        self.velocities.fill([0.0; 3]);
    }

    /// Moves centre `i` along axis `k`, at most to the wall; returns whether a wall held it.
    fn shift(&mut self, i: usize, k: usize, by: f64) -> bool {
        let (low, high) = self.region.reach(k, self.radii[i]);
        let to = self.positions[i][k] + by;
        let held = !self.region.periodic[k] && (to < low || to > high);
        self.positions[i][k] = if held { to.clamp(low, high) } else { to };
        held
    }

    fn list_is_stale(&self) -> bool {
        let far = 0.25 * self.skin * self.skin;
        let moved = |(a, b): (&Vec3, &Vec3)| {
            let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > far
        };
        self.listed_at.is_empty() || self.positions.iter().zip(&self.listed_at).any(moved)
    }

    fn list(&mut self) {
        for x in &mut self.positions {
            *x = self.region.wrap(*x);
        }
        let grown: Vec<f64> = self.radii.iter().map(|r| r * self.inflation).collect();
        let mut grid = Grid::new(*self.region, &grown, self.skin);
        self.pairs.clear();
        for i in grid.coarse_first() {
            let x = self.positions[i];
            grid.visit(i, x, |j| {
                let near = grown[i] + grown[j] + self.skin;
                if self.images.distance_squared(x, self.positions[j]) < near * near {
                    self.pairs.push((i as u32, j as u32));
                }
            });
            grid.insert(i, x);
        }
        self.listed_at.clone_from(&self.positions);
    }
}
