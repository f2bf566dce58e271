//! Fields of a world by coarse graining: density, momentum, stress and fabric on a regular grid.
//!
//! Every particle and every contact is spread by a kernel φ of stated width (Goldhirsch, Granular Matter 12, 239,
//! 2010; with walls: Weinhart, Thornton, Luding and Bokhove, Granular Matter 14, 289, 2012):
//!
//! - density ρ = Σ mᵢ φᵢ, solid fraction Σ Vᵢ φᵢ, momentum Σ mᵢ vᵢ φᵢ, velocity u = momentum / ρ;
//! - kinetic stress Σ mᵢ (vᵢ - u)⊗(vᵢ - u) φᵢ = Σ mᵢ vᵢ⊗vᵢ φᵢ - ρ u⊗u;
//! - stress of contacts Σ d⊗f ∫ φ(x - xᵢ - s d) ds with s from 0 to 1 along the branch d, which leads to the partner's
//!   centre, or to where a surface is touched; f is the force on the partner, so that compression is positive;
//! - force of surfaces on the particles, Σ f φ at the places of touch. With it momentum is balanced at every point:
//!   at rest ∇·σ = ρ g + that force.
//!
//! Kernels are normalised on the grid's own cells, continued beyond its edges: cells times their volume add up to
//! exactly the mass, momentum and virial of what lies inside, and what a kernel spreads beyond an edge is missing
//! there. Along a periodic axis that the grid covers nothing is missing.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::backend::Detail;
use crate::generate::solid_volume;
use crate::lattice::{add, norm, scale};
use crate::setup::Constants;
use crate::spec::Vec3;
use crate::state::State;

/// Sums of a cell: see the constants below.
const SUMS: usize = 30;
const SOLID: usize = 0;
const DENSITY: usize = 1;
const MOMENTUM: usize = 2;
/// Σ m v⊗v φ: xx, yy, zz, yz, xz, xy.
const FLOW: usize = 5;
const STRESS: usize = 11;
const CONTACTS: usize = 20;
/// Σ n⊗n ∫φ: xx, yy, zz, yz, xz, xy.
const FABRIC: usize = 21;
const SURFACES: usize = 27;

/// Where the components of a symmetric tensor stand, and their order.
const SYMMETRIC: [[usize; 2]; 6] = [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]];
const PLACE: [[usize; 3]; 3] = [[0, 5, 4], [5, 1, 3], [4, 3, 2]];

/// Where a Gaussian is cut, in widths.
const CUT: f64 = 3.0;
/// Gauss' three points and weights on [0, 1].
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];
/// Particles and contacts that are spread at a time, before their sums are added.
const CHUNK: usize = 4096;

/// A field that is measured while a world runs.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldSpec {
    /// Its name in output.
    pub name: String,
    /// Least corner of the grid \[m\].
    pub min: Vec3,
    /// Largest corner of the grid \[m\].
    pub max: Vec3,
    /// Cells along each axis, ≥ 1.
    pub cells: [usize; 3],
    /// How particles and contacts are spread.
    pub kernel: Kernel,
    /// Width of the kernel \[m\], not below the largest spacing of the grid: standard deviation of a Gaussian, radius
    /// of Lucy's support.
    pub width: f64,
    /// Time between two results \[s\].
    pub every: f64,
    /// Time before each result over which it is the mean \[s\], looked at in every row of the series; that moment
    /// alone if absent.
    pub window: Option<f64>,
    /// Axis along which profiles are taken: means over the planes of cells across it.
    pub profile: Option<usize>,
}

/// How a particle is spread over its surroundings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// `exp(-r²/2w²)`, cut off at 3 w.
    #[default]
    Gaussian,
    /// `(1 + 3 r/w)(1 - r/w)³` up to w (Lucy, Astronomical Journal 82, 1013, 1977).
    Lucy,
}

impl Kernel {
    /// Its value at a distance \[m\], not normalised.
    fn at(self, r: f64, width: f64) -> f64 {
        let q = r / width;
        match self {
            Self::Gaussian if q <= CUT => libm::exp(-0.5 * q * q),
            Self::Lucy if q < 1.0 => (1.0 + 3.0 * q) * (1.0 - q).powi(3),
            _ => 0.0,
        }
    }

    /// Where it ends \[m\].
    fn reach(self, width: f64) -> f64 {
        match self {
            Self::Gaussian => CUT * width,
            Self::Lucy => width,
        }
    }

    /// Longest part of a branch over which it counts as a polynomial of degree 5 \[m\].
    fn smooth(self, width: f64) -> f64 {
        match self {
            Self::Gaussian => width,
            Self::Lucy => 0.3 * width,
        }
    }
}

/// What is known of a cell, or of a plane of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Volume of particles over volume \[-\].
    pub solid_fraction: f64,
    /// Mass over volume \[kg/m³\].
    pub density: f64,
    /// Momentum over volume \[kg/(m² s)\].
    pub momentum: Vec3,
    /// Momentum over mass \[m/s\]; 0 where there is none.
    pub velocity: Vec3,
    /// Stress that contacts carry, rows by branch, columns by force \[Pa\].
    pub stress: [Vec3; 3],
    /// Stress of the motion against the mean velocity, of the window too \[Pa\].
    pub kinetic_stress: [Vec3; 3],
    /// Contacts of particles over volume \[1/m³\].
    pub contact_density: f64,
    /// Mean of n⊗n over contacts of particles \[-\]; its trace is 1, or 0 without contacts.
    pub fabric: [Vec3; 3],
    /// Force of surfaces on particles over volume \[N/m³\].
    pub surface_force: Vec3,
}

/// A field: sums over what was looked at since it was cleared.
#[derive(Clone, Debug)]
pub struct Field {
    spec: FieldSpec,
    looks: u64,
    sums: Vec<[f64; SUMS]>,
}

/// Something that is spread: along a branch, or at a place if that is 0.
#[derive(Clone, Copy)]
struct Deposit {
    at: Vec3,
    branch: Vec3,
    values: [f64; SUMS],
}

/// The share that each cell of a box gets of a deposit \[1/m³\].
struct Stamp {
    low: [i64; 3],
    size: [usize; 3],
    weights: Vec<f64>,
    values: [f64; SUMS],
}

impl Field {
    /// One that has looked at nothing.
    pub fn new(spec: FieldSpec) -> Self {
        let cells = spec.cells.iter().product();
        Self { spec, looks: 0, sums: vec![[0.0; SUMS]; cells] }
    }

    /// What it measures.
    pub fn spec(&self) -> &FieldSpec {
        &self.spec
    }
    /// How many moments it has looked at.
    pub fn looks(&self) -> u64 {
        self.looks
    }
    /// Widths of a cell \[m\].
    pub fn spacing(&self) -> Vec3 {
        [0, 1, 2].map(|k| (self.spec.max[k] - self.spec.min[k]) / self.spec.cells[k] as f64)
    }

    /// Forgets what it has seen.
    pub fn clear(&mut self) {
        self.looks = 0;
        self.sums.fill([0.0; SUMS]);
    }

    /// Takes in a moment of a world: its state, the centres of its particles \[m\] and its contacts.
    pub fn look(&mut self, c: &Constants, state: &State, positions: &[Vec3], detail: &Detail) {
        let deposits = deposits(state, positions, detail);
        let layer = self.spec.cells[0] * self.spec.cells[1];
        for chunk in deposits.chunks(CHUNK) {
            let stamps: Vec<Stamp> =
                chunk.par_iter().flat_map_iter(|deposit| self.images(c, deposit)).collect();
            let cells = self.spec.cells;
            // A layer sums in the order of deposits, whichever thread does it.
            self.sums.par_chunks_mut(layer).enumerate().for_each(|(z, sums)| {
                for stamp in &stamps {
                    stamp.add(z, cells, sums);
                }
            });
        }
        self.looks += 1;
    }

    /// The images of a deposit that the grid sees.
    fn images(&self, c: &Constants, deposit: &Deposit) -> Vec<Stamp> {
        let reach = self.spec.kernel.reach(self.spec.width) + norm(deposit.branch);
        // Centres are within the cell, and so is the grid along its periodic axes.
        let turns = [0, 1, 2]
            .map(|k| if c.lattice.periodic[k] { 1 + c.periods_high(k, reach).ceil() as i32 } else { 0 });
        let mut found = Vec::new();
        for x in -turns[0]..=turns[0] {
            for y in -turns[1]..=turns[1] {
                for z in -turns[2]..=turns[2] {
                    let at = c.shifted(deposit.at, [x, y, z]);
                    let near =
                        |k: usize| at[k] + reach > self.spec.min[k] && at[k] - reach < self.spec.max[k];
                    if (0..3).all(near) {
                        found.push(self.stamp(&Deposit { at, ..*deposit }));
                    }
                }
            }
        }
        found
    }

    /// The cells whose centres are within reach of a place along an axis: the first and the last.
    fn span(&self, k: usize, x: f64) -> [i64; 2] {
        let reach = self.spec.kernel.reach(self.spec.width);
        let cell = |x: f64| (x - self.spec.min[k]) / self.spacing()[k] - 0.5;
        [cell(x - reach).ceil() as i64, cell(x + reach).floor() as i64]
    }

    fn stamp(&self, deposit: &Deposit) -> Stamp {
        let Deposit { at, branch, values } = *deposit;
        let end = add(at, branch);
        let ends = [0, 1, 2].map(|k| {
            let [a, b] = [self.span(k, at[k]), self.span(k, end[k])];
            [a[0].min(b[0]), a[1].max(b[1])]
        });
        let low = ends.map(|[low, _]| low);
        let size = ends.map(|[low, high]| (high - low + 1).max(0) as usize);
        let mut stamp = Stamp { low, size, weights: vec![0.0; size.iter().product()], values };
        let length = norm(branch);
        let pieces = (length / self.spec.kernel.smooth(self.spec.width)).ceil().max(1.0) as usize;
        if length == 0.0 {
            self.spread(at, 1.0, &mut stamp);
        } else {
            for piece in 0..pieces {
                for (s, weight) in GAUSS {
                    let s = (piece as f64 + s) / pieces as f64;
                    self.spread(add(at, scale(branch, s)), weight / pieces as f64, &mut stamp);
                }
            }
        }
        stamp
    }

    /// Adds the kernel around a place to a stamp, so that all its cells together have `share`.
    fn spread(&self, x: Vec3, share: f64, stamp: &mut Stamp) {
        let h = self.spacing();
        let spans = [0, 1, 2].map(|k| self.span(k, x[k]));
        let off = |k: usize, cell: i64| self.spec.min[k] + (cell as f64 + 0.5) * h[k] - x[k];
        let value = |i: i64, j: i64, k: i64| {
            self.spec.kernel.at(norm([off(0, i), off(1, j), off(2, k)]), self.spec.width)
        };
        let each = |f: &mut dyn FnMut(i64, i64, i64)| {
            for k in spans[2][0]..=spans[2][1] {
                for j in spans[1][0]..=spans[1][1] {
                    for i in spans[0][0]..=spans[0][1] {
                        f(i, j, k);
                    }
                }
            }
        };
        let mut sum = 0.0;
        each(&mut |i, j, k| sum += value(i, j, k));
        let factor = share / (sum * h[0] * h[1] * h[2]);
        each(&mut |i, j, k| {
            let at = [i, j, k];
            let [a, b, c] = [0, 1, 2].map(|k| (at[k] - stamp.low[k]) as usize);
            stamp.weights[a + stamp.size[0] * (b + stamp.size[1] * c)] += factor * value(i, j, k);
        });
    }

    /// Cells in the order of x, then y, then z; of a field that has looked at nothing, zeros.
    pub fn points(&self) -> Vec<Point> {
        self.sums.iter().map(|sums| point(sums, self.looks as f64)).collect()
    }

    /// Means over the planes of cells across an axis, with the coordinates of their centres \[m\].
    pub fn profile(&self, axis: usize) -> Vec<(f64, Point)> {
        let cells = self.spec.cells;
        let mut planes = vec![[0.0; SUMS]; cells[axis]];
        for (n, sums) in self.sums.iter().enumerate() {
            let at = [n % cells[0], n / cells[0] % cells[1], n / (cells[0] * cells[1])];
            for (sum, x) in planes[at[axis]].iter_mut().zip(sums) {
                *sum += x;
            }
        }
        let in_plane = (self.sums.len() / cells[axis]) as f64;
        let place = |n: usize| self.spec.min[axis] + (n as f64 + 0.5) * self.spacing()[axis];
        planes
            .iter()
            .enumerate()
            .map(|(n, sums)| (place(n), point(sums, self.looks as f64 * in_plane)))
            .collect()
    }

    /// What it has seen, as bytes: the number of moments, then the sums if there are any, little-endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.looks.to_le_bytes().to_vec();
        if self.looks > 0 {
            bytes.extend(self.sums.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
        }
        bytes
    }

    /// Takes back what [`to_bytes`](Self::to_bytes) gave from the front of `bytes`; returns the rest, or nothing if
    /// they end too early.
    pub fn restore<'a>(&mut self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let (looks, mut rest) = bytes.split_first_chunk()?;
        self.clear();
        self.looks = u64::from_le_bytes(*looks);
        if self.looks > 0 {
            for x in self.sums.as_flattened_mut() {
                let (value, after) = rest.split_first_chunk()?;
                *x = f64::from_le_bytes(*value);
                rest = after;
            }
        }
        Some(rest)
    }
}

impl Stamp {
    /// Adds what a layer of the grid gets.
    fn add(&self, z: usize, cells: [usize; 3], sums: &mut [[f64; SUMS]]) {
        let k = z as i64 - self.low[2];
        if !(0..self.size[2] as i64).contains(&k) {
            return;
        }
        let within = |axis: usize| {
            let first = self.low[axis].max(0);
            let end = (self.low[axis] + self.size[axis] as i64).min(cells[axis] as i64);
            first..end
        };
        for y in within(1) {
            let row = self.size[0] * ((y - self.low[1]) as usize + self.size[1] * k as usize);
            for x in within(0) {
                let weight = self.weights[row + (x - self.low[0]) as usize];
                for (sum, value) in sums[x as usize + cells[0] * y as usize].iter_mut().zip(&self.values) {
                    *sum += weight * value;
                }
            }
        }
    }
}

/// What a moment of a world spreads.
fn deposits(state: &State, positions: &[Vec3], detail: &Detail) -> Vec<Deposit> {
    let p = &state.particles;
    let mut all = Vec::with_capacity(p.len() + detail.network.len() + 2 * detail.touches.len());
    let place: HashMap<u32, usize> = p.id.iter().enumerate().map(|(i, id)| (*id, i)).collect();
    for (i, &at) in positions.iter().enumerate() {
        let mass = 1.0 / f64::from(p.velocity[i].inv_mass);
        let v = p.velocity[i].v.map(f64::from);
        let mut values = [0.0; SUMS];
        values[SOLID] = solid_volume(&[f64::from(p.place[i].radius)]);
        values[DENSITY] = mass;
        for k in 0..3 {
            values[MOMENTUM + k] = mass * v[k];
        }
        for (k, [a, b]) in SYMMETRIC.into_iter().enumerate() {
            values[FLOW + k] = mass * v[a] * v[b];
        }
        all.push(Deposit { at, branch: [0.0; 3], values });
    }
    let virial = |branch: Vec3, force: [f32; 3]| {
        let mut values = [0.0; SUMS];
        for a in 0..3 {
            for b in 0..3 {
                values[STRESS + 3 * a + b] = -branch[a] * f64::from(force[b]);
            }
        }
        values
    };
    for link in &detail.network {
        let Some(&i) = place.get(&link.id[0]) else { continue };
        let mut values = virial(link.branch, link.force);
        values[CONTACTS] = 1.0;
        let square = norm(link.branch).powi(2);
        for (k, [a, b]) in SYMMETRIC.into_iter().enumerate() {
            values[FABRIC + k] = link.branch[a] * link.branch[b] / square;
        }
        all.push(Deposit { at: positions[i], branch: link.branch, values });
    }
    for touch in &detail.touches {
        let Some(&i) = place.get(&touch.id) else { continue };
        let at = positions[i];
        all.push(Deposit { at, branch: touch.branch, values: virial(touch.branch, touch.force) });
        let mut values = [0.0; SUMS];
        for k in 0..3 {
            values[SURFACES + k] = f64::from(touch.force[k]);
        }
        all.push(Deposit { at: add(at, touch.branch), branch: [0.0; 3], values });
    }
    all
}

/// What sums over so many looks, or cells, are on average.
fn point(sums: &[f64; SUMS], n: f64) -> Point {
    let mean = |k: usize| if n > 0.0 { sums[k] / n } else { 0.0 };
    let over = |x: f64, y: f64| if y > 0.0 { x / y } else { 0.0 };
    let vector = |first: usize| [0, 1, 2].map(|k| mean(first + k));
    let density = mean(DENSITY);
    let momentum = vector(MOMENTUM);
    let velocity = momentum.map(|x| over(x, density));
    let contact_density = mean(CONTACTS);
    let each = |f: &dyn Fn(usize, usize) -> f64| [0, 1, 2].map(|a| [0, 1, 2].map(|b| f(a, b)));
    Point {
        solid_fraction: mean(SOLID),
        density,
        momentum,
        velocity,
        stress: each(&|a, b| mean(STRESS + 3 * a + b)),
        kinetic_stress: each(&|a, b| mean(FLOW + PLACE[a][b]) - density * velocity[a] * velocity[b]),
        contact_density,
        fabric: each(&|a, b| over(mean(FABRIC + PLACE[a][b]), contact_density)),
        surface_force: vector(SURFACES),
    }
}
