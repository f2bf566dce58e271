//! Wear of surfaces by Archard's law (Journal of Applied Physics 24, 981, 1953): the volume that is lost grows with the
//! work of sliding, `V = k/H ∫ Fₙ |vₜ| dt`, with the coefficient k and the hardness H of the softer body.
//!
//! Fₙ is what presses a particle on the surface (a contact that pulls wears nothing), vₜ the tangential velocity of the
//! two bodies where they touch, spins included: a sphere that rolls without slip wears nothing. Work is kept by facet, the
//! shape of the surface stays as it is.

use crate::lattice::{dot, norm};
use crate::setup::Constants;
use crate::spec::Vec3;
use crate::state::Progress;

/// A particle that rubs on a facet in a step.
#[derive(Clone, Copy, Debug)]
pub struct Rub {
    /// The surface.
    pub surface: usize,
    /// Its facet: the triangle of a mesh, the piece that shows a round one; 0 of a plane.
    pub facet: usize,
    /// Pressing force times the sliding of the step \[J\].
    pub work: f64,
}

impl Rub {
    /// From the force on the particle \[N\], the unit vector into the surface, the tangential velocity \[m/s\] and the
    /// step \[s\].
    pub fn new(surface: usize, facet: u32, force: Vec3, n: Vec3, sliding: Vec3, dt: f64) -> Self {
        let pressing = (-dot(force, n)).max(0.0);
        Self { surface, facet: facet as usize, work: pressing * norm(sliding) * dt }
    }
}

impl Constants {
    /// What a surface loses over the work of sliding on it, k/H \[1/Pa\], if it wears.
    pub fn wear_of(&self, surface: usize) -> Option<f64> {
        let material = self.spec.surfaces[surface].material;
        self.spec.wear.get(material).copied().filter(|k| *k > 0.0)
    }

    /// Whether any surface wears.
    pub fn wears(&self) -> bool {
        (0..self.spec.surfaces.len()).any(|s| self.wear_of(s).is_some())
    }

    /// Whether states of this world have a list of wear for each surface, be it empty: so says the table of materials
    /// alone, so that a settled bed does not depend on which tools wait outside.
    pub fn lists_wear(&self) -> bool {
        self.spec.wear.iter().any(|k| *k > 0.0)
    }

    /// Materials whose wear nothing tells, because no surface has them.
    pub fn worn_nowhere(&self) -> Vec<String> {
        let bare = |m: &usize| !self.spec.surfaces.iter().any(|surface| surface.material == *m);
        let worn = (0..self.spec.wear.len()).filter(|m| self.spec.wear[*m] > 0.0).filter(bare);
        let told = worn.map(|m| {
            format!(
                "the material `{}` wears, but no surface has it: wear is told of surfaces in `geometry`, not of particles \
                 or sides of the domain",
                self.spec.materials[m].name
            )
        });
        told.collect()
    }

    /// The work of sliding on each facet of a surface at the start; empty if it does not wear.
    pub fn unworn(&self, surface: usize) -> Vec<f64> {
        let facets = self.boundaries[surface].shape.triangles();
        vec![0.0; self.wear_of(surface).map_or(0, |_| facets)]
    }
}

impl Progress {
    /// Takes in what particles rub off in a step.
    pub(crate) fn rub<'a>(&mut self, rubs: impl Iterator<Item = &'a Rub>) {
        for rub in rubs {
            self.wear[rub.surface][rub.facet] += rub.work;
        }
    }

    /// The volume that each facet of a surface has lost since the start \[m³\], if it wears.
    pub fn worn(&self, c: &Constants, surface: usize) -> Option<Vec<f64>> {
        let k = c.wear_of(surface)?;
        Some(self.wear[surface].iter().map(|work| k * work).collect())
    }
}
