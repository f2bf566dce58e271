//! A disordered periodic packing in balance under a given pressure, computed in f64.

use glebe_engine::generate::{FillRequest, Region, generate, solid_volume};
use glebe_engine::lattice::{add, norm, scale, sub};
use glebe_engine::spec::Vec3;

use crate::support::Random;

/// Spheres in balance in a periodic cube.
#[derive(Clone, Debug)]
pub struct Packing {
    /// Side of the cube \[m\].
    pub side: f64,
    /// Radii \[m\], representable in f32 as states hold them.
    pub radius: Vec<f64>,
    /// Centres \[m\], from 0 to `side`.
    pub x: Vec<Vec3>,
    /// Touching pairs, ascending.
    pub contacts: Vec<Contact>,
}

/// Two spheres in contact: `F = stiffness overlap^power`.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// The lower number first.
    pub pair: [usize; 2],
    /// \[m\]
    pub overlap: f64,
    stiffness: f64,
    power: f64,
}

impl Contact {
    /// The force that it would have with another overlap \[N\].
    pub fn with(&self, overlap: f64) -> f64 {
        self.stiffness * overlap.powf(self.power)
    }
}

/// A repulsion `F = K δ^power`, with K from the two radii.
#[derive(Clone, Copy)]
pub struct Repulsion<'a> {
    pub stiffness: &'a dyn Fn(f64, f64) -> f64,
    pub power: f64,
    /// Largest force out of balance that is left, as a share of the mean contact force. A linear spring's
    /// stiffness jumps where a contact opens: near the least number of contacts that hold a packing, balance is
    /// hard to find.
    pub tolerance: f64,
}

impl Packing {
    /// `count` spheres of radii from `least` to 1.5 `least` without friction, compressed from a random fill to
    /// the mean stress `pressure` \[Pa\] in stages of falling pressure: in each the enthalpy `U + p V` is
    /// minimised over all centres and the side of the cube.
    pub fn compressed(count: usize, least: f64, pressure: f64, law: Repulsion) -> Self {
        let mut r = Random(50);
        let radius: Vec<f64> =
            (0..count).map(|_| f64::from((least * (1.0 + 0.5 * r.unit())) as f32)).collect();
        let side = (solid_volume(&radius) / 0.58).cbrt();
        let region = Region { min: [0.0; 3], max: [side; 3], periodic: [true; 3] };
        let x = generate("dense", &FillRequest::new(region, &radius, 1)).unwrap();
        let mut descent = Descent {
            packing: Self { side, radius, x, contacts: Vec::new() },
            law,
            near: Vec::new(),
            listed_at: (Vec::new(), side),
            force: vec![[0.0; 3]; count],
            virial: 0.0,
        };
        for decade in (0..=6).rev() {
            let tolerance = if decade > 0 { 1e-2 } else { law.tolerance };
            descent.minimise(pressure * 10_f64.powi(decade), tolerance);
        }
        let mut p = descent.packing;
        p.contacts.sort_unstable_by_key(|c| c.pair);
        p.x.iter_mut().for_each(|x| *x = x.map(|x| x.rem_euclid(p.side)));
        p
    }

    /// From the centre of i to that of the nearest image of j \[m\].
    fn between(&self, i: usize, j: usize) -> Vec3 {
        nearest(sub(self.x[j], self.x[i]), self.side)
    }
}

/// The nearest image of a difference of places in a periodic cube.
pub fn nearest(d: Vec3, side: f64) -> Vec3 {
    d.map(|d| d - side * (d / side).round())
}

/// FIRE (Bitzek et al. 2006, Phys. Rev. Lett. 97, 170201) over the centres and the logarithm of the side.
struct Descent<'a> {
    packing: Packing,
    law: Repulsion<'a>,
    /// Pairs that may meet before a sphere has moved or the cube has shrunk too far, and where they were then
    /// relative to the cube, and its side.
    near: Vec<[usize; 2]>,
    listed_at: (Vec<Vec3>, f64),
    force: Vec<Vec3>,
    /// Work of the contacts per relative growth of the side \[J\].
    virial: f64,
}

impl Descent<'_> {
    const MOST_STEPS: usize = 400_000;

    /// Goes downhill until no force out of balance is above `share` of the mean contact force, nor the difference
    /// to the pressure above that share of it.
    fn minimise(&mut self, pressure: f64, share: f64) {
        let n = self.packing.x.len();
        let mean = self.packing.radius.iter().sum::<f64>() / n as f64;
        let typical = pressure * (2.0 * mean).powi(2);
        let k = (self.law.stiffness)(mean, mean);
        let stiffness = self.law.power * typical / (typical / k).powf(1.0 / self.law.power);
        // Masses are 1 kg; that of the side makes growth as slow as the motion of a sphere.
        let unit = 1.0 / stiffness.sqrt();
        let inertia = n as f64 * (0.5 * self.packing.side).powi(2);
        let (mut v, mut rate) = (vec![[0.0; 3]; n], 0.0_f64);
        let (mut dt, mut mixing, mut downhill) = (0.1, 0.1, 0);
        for _ in 0..Self::MOST_STEPS {
            self.forces();
            let growth = self.virial - 3.0 * pressure * self.packing.side.powi(3);
            let worst = self.force.iter().map(|f| norm(*f)).fold(0.0, f64::max);
            let contacts = &self.packing.contacts;
            let load = contacts.iter().map(|c| c.with(c.overlap)).sum::<f64>() / contacts.len() as f64;
            let open = growth.abs() / (3.0 * pressure * self.packing.side.powi(3));
            if worst < share * load && open < share {
                return;
            }
            let (mut power, mut speed, mut pull) =
                (rate * growth, inertia * rate * rate, growth * growth / inertia);
            for (f, v) in self.force.iter().zip(&v) {
                for a in 0..3 {
                    power += f[a] * v[a];
                    speed += v[a] * v[a];
                    pull += f[a] * f[a];
                }
            }
            let (mut turn, mut keep) = (0.0, 0.0);
            if power > 0.0 {
                turn = mixing * (speed / pull).sqrt();
                keep = 1.0 - mixing;
                downhill += 1;
                if downhill > 5 {
                    dt = f64::min(dt * 1.1, 0.4);
                    mixing *= 0.99;
                }
            } else {
                (downhill, dt, mixing) = (0, f64::max(0.5 * dt, 0.01), 0.1);
            }
            let t = dt * unit;
            rate = keep * rate + (turn + t) * growth / inertia;
            let stretch = (rate * t).clamp(-1e-3, 1e-3);
            for i in 0..n {
                v[i] = add(scale(v[i], keep), scale(self.force[i], turn + t));
                let dx = v[i].map(|v| (v * t).clamp(-0.05 * mean, 0.05 * mean));
                self.packing.x[i] = add(scale(self.packing.x[i], 1.0 + stretch), dx);
            }
            self.packing.side *= 1.0 + stretch;
        }
        panic!("no balance at {pressure} Pa");
    }

    /// Contacts and their forces.
    fn forces(&mut self) {
        let skin = 0.3 * self.packing.radius[0];
        let relative: Vec<Vec3> = self.packing.x.iter().map(|x| scale(*x, 1.0 / self.packing.side)).collect();
        let far = |(a, b): (&Vec3, &Vec3)| norm(sub(*a, *b)) * self.packing.side > 0.4 * skin;
        let (places, side) = &self.listed_at;
        let shrunk = self.packing.side < 0.99 * side;
        if places.is_empty() || shrunk || relative.iter().zip(places).any(far) {
            self.near.clear();
            for j in 0..relative.len() {
                for i in 0..j {
                    let reach = self.packing.radius[i] + self.packing.radius[j] + skin;
                    if norm(self.packing.between(i, j)) < reach {
                        self.near.push([i, j]);
                    }
                }
            }
            self.listed_at = (relative, self.packing.side);
        }
        let p = &mut self.packing;
        self.force.fill([0.0; 3]);
        self.virial = 0.0;
        p.contacts.clear();
        for &[i, j] in &self.near {
            let d = p.between(i, j);
            let (sum, square) = (p.radius[i] + p.radius[j], d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            if square >= sum * sum {
                continue;
            }
            let distance = square.sqrt();
            let overlap = (sum * sum - square) / (sum + distance);
            let stiffness = (self.law.stiffness)(p.radius[i], p.radius[j]);
            let contact = Contact { pair: [i, j], overlap, stiffness, power: self.law.power };
            let f = contact.with(overlap);
            let push = scale(d, f / distance);
            self.force[i] = sub(self.force[i], push);
            self.force[j] = add(self.force[j], push);
            self.virial += f * distance;
            p.contacts.push(contact);
        }
    }
}
