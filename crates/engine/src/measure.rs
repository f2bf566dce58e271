//! What a sample is like inside: stress, strain, void ratio, coordination and fabric of a world that is periodic along
//! all axes.
//!
//! Stress and strain are positive in compression. Angular momentum of a periodic sample is not conserved, so its stress
//! need not be symmetric at every moment; it is at rest.

use serde::Serialize;

use crate::lattice::{Vec3x3, determinant};
use crate::spec::Vec3;

/// Sums over the contacts and particles of a sample at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tensors {
    /// Particles.
    pub particles: u64,
    /// Contacts.
    pub contacts: u64,
    /// Σ d⊗f over contacts, each once \[J\]: the branch d leads from a particle to the nearest image of its partner,
    /// f is the force on the partner.
    pub contact: Vec3x3,
    /// Σ m v⊗v over particles \[J\], with velocities against the mean deformation.
    pub kinetic: Vec3x3,
    /// Σ n⊗n over contacts \[-\].
    pub fabric: Vec3x3,
    /// Σ k d² over contacts \[J\], k the stiffness of the normal spring.
    pub stiffness: f64,
    /// Volume of the particles \[m³\].
    pub solid: f64,
    /// Particles without any contact, and with one.
    pub rattlers: [u64; 2],
}

impl Tensors {
    /// Takes a contact in: branch \[m\], force on the first particle \[N\], stiffness of the normal spring \[N/m\].
    pub fn add_contact(&mut self, branch: Vec3, force: Vec3, stiffness: f64) {
        self.contacts += 1;
        let square = branch.iter().map(|x| x * x).sum::<f64>();
        for a in 0..3 {
            for b in 0..3 {
                self.contact[a][b] -= branch[a] * force[b];
                self.fabric[a][b] += branch[a] * branch[b] / square;
            }
        }
        self.stiffness += stiffness * square;
    }

    /// Takes a particle in: mass \[kg\], radius \[m\], velocity \[m/s\], number of its contacts.
    pub fn add_particle(&mut self, mass: f64, radius: f64, v: Vec3, contacts: u32) {
        self.particles += 1;
        self.solid += 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
        for a in 0..3 {
            for b in 0..3 {
                self.kinetic[a][b] += mass * v[a] * v[b];
            }
        }
        if let Some(few) = self.rattlers.get_mut(contacts as usize) {
            *few += 1;
        }
    }
}

/// A sample at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interior {
    /// Volume of the cell \[m³\].
    pub volume: f64,
    /// Stress that contacts carry \[Pa\]: `1/V Σ d⊗f`.
    pub stress: Vec3x3,
    /// Stress of the particles' fluctuation \[Pa\]: `1/V Σ m v⊗v`.
    pub kinetic_stress: Vec3x3,
    /// Strain since the start \[-\], logarithmic along axes that do not turn; shear components are halves of the
    /// change of angle.
    pub strain: Vec3x3,
    /// Volume of voids over volume of particles \[-\]; overlaps are counted twice as solid.
    pub void_ratio: f64,
    /// Mean number of contacts of the particles that have two or more, `(2C - N₁)/(N - N₀ - N₁)` (Thornton,
    /// Géotechnique 50, 43, 2000); 0 if there are none.
    pub mechanical_coordination: f64,
    /// Particles with fewer than two contacts.
    pub rattlers: u64,
    /// Mean of n⊗n over contacts \[-\]; its trace is 1, or 0 without contacts.
    pub fabric: Vec3x3,
}

impl Interior {
    /// From the sums over a world whose cell is deformed by `strain`.
    pub fn new(t: &Tensors, cell: &Vec3x3, strain: &Vec3x3) -> Self {
        let volume = determinant(cell);
        let by = |m: &Vec3x3, x: f64| m.map(|row| row.map(|y| y / x));
        let [none, one] = t.rattlers;
        let carrying = (t.particles - none - one) as f64;
        Self {
            volume,
            stress: by(&t.contact, volume),
            kinetic_stress: by(&t.kinetic, volume),
            strain: *strain,
            void_ratio: volume / t.solid.max(f64::MIN_POSITIVE) - 1.0,
            mechanical_coordination: (2 * t.contacts - one) as f64 / carrying.max(1.0),
            rattlers: none + one,
            fabric: by(&t.fabric, t.contacts.max(1) as f64),
        }
    }

    /// Mean stress p = tr σ/3 of the contacts \[Pa\].
    pub fn p(&self) -> f64 {
        trace(&self.stress) / 3.0
    }
    /// Deviatoric stress q = √(3/2 s:s) of the contacts \[Pa\].
    pub fn q(&self) -> f64 {
        (1.5 * deviator(&self.stress)).sqrt()
    }
    /// Volumetric strain ε_v = tr ε \[-\].
    pub fn volumetric_strain(&self) -> f64 {
        trace(&self.strain)
    }
    /// Deviatoric strain ε_q = √(2/3 e:e) \[-\].
    pub fn deviatoric_strain(&self) -> f64 {
        (deviator(&self.strain) / 1.5).sqrt()
    }
}

fn trace(m: &Vec3x3) -> f64 {
    m[0][0] + m[1][1] + m[2][2]
}

/// `s:s` of the deviator s of the symmetric part of a tensor.
fn deviator(m: &Vec3x3) -> f64 {
    let mean = trace(m) / 3.0;
    let s = |a: usize, b: usize| 0.5 * (m[a][b] + m[b][a]) - if a == b { mean } else { 0.0 };
    (0..3).flat_map(|a| (0..3).map(move |b| (a, b))).map(|(a, b)| s(a, b).powi(2)).sum()
}
