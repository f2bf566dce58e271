//! The state of a world: everything that its future depends on, the same on every backend.

use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use smallvec::SmallVec;

use crate::bytes::BytesError;
use crate::cell::Cell;
use crate::exchange::{Flow, InletState};
use crate::lattice::{Encoded, norm};
use crate::setup::Constants;
use crate::spec::{Component, Pose, Vec3, Window};
use crate::surface::Placed;

/// Where a particle is within its window, and how large it is: 16 bytes that contact search reads.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Place {
    /// Fraction of the window.
    pub lo: [u32; 3],
    /// Radius \[m\].
    pub radius: f32,
}

/// Velocity and what turns force into it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Velocity {
    /// \[m/s\]
    pub v: [f32; 3],
    /// Inverse mass \[1/kg\].
    pub inv_mass: f32,
}

/// Angular velocity and material.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Spin {
    /// \[rad/s\]
    pub w: [f32; 3],
    /// Index into the world's materials.
    pub material: u32,
}

/// Particles as columns of equal length, in the order of the last rebuild.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Particles {
    /// Persistent number: the particle's index in the world's specification; those that come later go on from there.
    pub id: Vec<u32>,
    /// Place and radius.
    pub place: Vec<Place>,
    /// Velocity and inverse mass.
    pub velocity: Vec<Velocity>,
    /// Spin and material.
    pub spin: Vec<Spin>,
    /// Windows.
    pub hi: Vec<[i32; 3]>,
    /// Rest below one unit.
    pub rest: Vec<[f32; 3]>,
    /// Acceleration of the last step, gravity and damping included \[m/s²\].
    pub acceleration: Vec<[f32; 3]>,
    /// Angular acceleration of the last step \[rad/s²\].
    pub angular: Vec<[f32; 3]>,
    /// Force of the last step's contacts \[N\].
    pub force: Vec<[f32; 3]>,
    /// Windows at the last rebuild.
    pub hi_ref: Vec<[i32; 3]>,
    /// Fractions at the last rebuild.
    pub lo_ref: Vec<[u32; 3]>,
}

macro_rules! each_column {
    ($self:ident, $column:ident => $body:expr) => {
        each_column!(@ $self, $column => $body;
            id place velocity spin hi rest acceleration angular force hi_ref lo_ref)
    };
    (@ $self:ident, $column:ident => $body:expr; $($name:ident)*) => { $({
        let $column = &mut $self.$name;
        $body;
    })* };
}

impl Particles {
    /// Number of particles.
    pub fn len(&self) -> usize {
        self.id.len()
    }
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }
    /// Keeps the particles for which `keep` is true, in order.
    pub fn retain(&mut self, keep: &[bool]) {
        each_column!(self, column => {
            let mut at = 0;
            column.retain(|_| { at += 1; keep[at - 1] });
        });
    }
    /// Puts particle `order[k]` at place k.
    pub fn reorder(&mut self, order: &[u32]) {
        each_column!(self, column => {
            *column = order.iter().map(|&i| column[i as usize]).collect();
        });
    }
}

/// What a contact remembers: the laws' history, of which that of one spring takes no memory of its own.
pub type History = SmallVec<[f32; 4]>;

/// What two touching particles remember, seen from `id[0] < id[1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactMemory {
    /// The particles' persistent numbers.
    pub id: [u32; 2],
    /// The laws' history.
    pub history: History,
}

/// What a particle remembers of one contact with a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceMemory {
    /// The particle's persistent number.
    pub id: u32,
    /// The surface; domain sides come after the specification's surfaces.
    pub surface: u32,
    /// Unit vector into the surface when last touched.
    pub n: [f32; 3],
    /// The laws' history.
    pub history: History,
}

/// State of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceState {
    /// Whether it is there.
    pub present: bool,
    /// Pose when its present motion began.
    pub base: Pose,
    /// Step at which its present motion began.
    pub since: u64,
    /// Pose at the last rebuild.
    pub reference: Pose,
}

impl SurfaceState {
    /// Where surface `s` stands at the step of `g`; an absent one waits where it was.
    pub fn placed(&self, c: &Constants, s: usize, g: &Progress) -> Placed {
        self.placed_at(c, s, g.stage, g.step)
    }

    /// Where surface `s` stands at a step of a stage.
    pub fn placed_at(&self, c: &Constants, s: usize, stage: usize, step: u64) -> Placed {
        if !self.present {
            return Placed { pose: self.base, ..Placed::default() };
        }
        c.motion(s, stage).at(&self.base, (step - self.since) as f64 * c.dt)
    }
}

/// A particle that left the domain.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lost {
    /// Persistent number.
    pub id: u32,
    /// Time \[s\].
    pub time: f64,
    /// Where it was found \[m\].
    pub position: Vec3,
    /// Axis and side (0 low, 1 high) through which it left.
    pub side: [usize; 2],
}

/// Energy accounts \[J\], sums since the start but for the first five, which are of the moment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Kinetic energy of translation.
    pub translation: f64,
    /// Kinetic energy of rotation.
    pub rotation: f64,
    /// Potential energy in gravity, zero at the domain's origin.
    pub potential: f64,
    /// Energy of normal springs and cohesion.
    pub elastic_normal: f64,
    /// Energy of tangential and rolling springs.
    pub elastic_tangential: f64,
    /// Lost to sliding friction, and where contacts yield and what held them parts.
    pub friction: f64,
    /// Lost in dashpots.
    pub dashpots: f64,
    /// Lost to rolling resistance.
    pub rolling: f64,
    /// Lost to local damping.
    pub damping: f64,
    /// Lost because the stiffness of a stretched tangential spring changed (Mindlin's spring is not
    /// conservative); negative where it gained.
    pub stiffness_change: f64,
    /// Work done on the particles by moving surfaces, and by the seams of periodic axes that gravity has a part
    /// along: a particle that falls through re-enters as high as it began.
    pub work: f64,
    /// Energy taken out with particles that were removed or lost, and with the springs of their contacts.
    pub removed: f64,
    /// Energy that came in with particles through inlets.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub entered: f64,
    /// Energy at the start.
    pub initial: f64,
}

/// Whether an account was never used: it is then left out of states.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
fn is_zero(x: &f64) -> bool {
    *x == 0.0
}

impl Ledger {
    /// Mechanical energy of the moment \[J\].
    pub fn mechanical(&self) -> f64 {
        self.translation + self.rotation + self.potential + self.elastic_normal + self.elastic_tangential
    }
    /// Energy dissipated since the start \[J\].
    pub fn dissipated(&self) -> f64 {
        self.friction + self.dashpots + self.rolling + self.damping
    }
    /// What the accounts leave open \[J\]: the error of the integrator.
    pub fn integrator(&self) -> f64 {
        self.initial + self.work + self.entered
            - self.mechanical()
            - self.dissipated()
            - self.stiffness_change
            - self.removed
    }
}

/// Progress of a measure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeasureState {
    /// Steps counted; of a survey 1, or 0 if there was no such thing.
    pub n: u64,
    /// Mean, in the SI unit of what is measured.
    pub mean: f64,
    /// Sum of squared deviations (Welford).
    pub m2: f64,
}

impl MeasureState {
    /// Counts one value.
    pub fn add(&mut self, x: f64) {
        self.n += 1;
        let d = x - self.mean;
        self.mean += d / self.n as f64;
        self.m2 += d * (x - self.mean);
    }
    /// Sample standard deviation; 0 for fewer than two values.
    pub fn std(&self) -> f64 {
        if self.n < 2 { 0.0 } else { (self.m2 / (self.n - 1) as f64).sqrt() }
    }
}

/// Why a stage ended.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageResult {
    /// Its name.
    pub name: String,
    /// "duration", "kinetic energy" or "at most"; "actions" for one that only acts.
    pub ended_by: String,
    /// Simulated time at its end \[s\].
    pub time: f64,
    /// Particles removed by its actions.
    pub trimmed: u64,
    /// Its measures, then its surveys, in the order of the specification.
    pub measures: Vec<MeasureState>,
}

/// Bonds between particles so far. Those that went with particles that left are neither whole nor broken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bonds {
    /// How many were made.
    pub made: u64,
    /// How many broke.
    pub broken: u64,
}

impl Bonds {
    /// Whether there were none.
    pub fn none(&self) -> bool {
        *self == Self::default()
    }
}

/// The part of the state that is not columns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Steps done.
    pub step: u64,
    /// Stage in progress; the number of stages when all are done.
    pub stage: usize,
    /// Step at which it began.
    pub stage_since: u64,
    /// Whether its actions were done.
    pub stage_begun: bool,
    /// Particles removed by its actions.
    pub trimmed: u64,
    /// Whether the kinetic energy has been above the stage's limit.
    pub was_above: bool,
    /// Kinetic energy at the last sample of a stage that waits for it to fall \[J\].
    pub kinetic: f64,
    /// Its measures.
    pub measures: Vec<MeasureState>,
    /// Stages that ended.
    pub results: Vec<StageResult>,
    /// Surfaces, without the domain's sides.
    pub surfaces: Vec<SurfaceState>,
    /// Path of each surface since the stage began \[m\].
    pub path: Vec<f64>,
    /// Particles that left the domain.
    pub lost: Vec<Lost>,
    /// Energy accounts.
    pub ledger: Ledger,
    /// Largest overlap seen, as a fraction of the smaller radius.
    pub worst_overlap: f64,
    /// Whether neighbour lists must be rebuilt before the next step.
    pub stale: bool,
    /// Whether accelerations of the present configuration are known.
    pub primed: bool,
    /// Distance added to the reach of neighbour lists \[m\].
    pub skin: f64,
    /// Step of the last rebuild.
    pub rebuilt: u64,
    /// Rebuilds done.
    pub rebuilds: u64,
    /// Sums of surface forces since the last sample: fx, fy, fz, tx, ty, tz of each surface.
    pub impulse: Vec<[f64; 6]>,
    /// Steps in `impulse`.
    pub impulse_steps: u64,
    /// Samples taken.
    pub samples: u64,
    /// Frames taken.
    pub frames: u64,
    /// Bonds.
    #[serde(default, skip_serializing_if = "Bonds::none")]
    pub bonds: Bonds,
    /// Inlets, in the order of the specification.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inlets: Vec<InletState>,
    /// What outlets took, in the order of the specification.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outlets: Vec<Flow>,
    /// Work of sliding on each facet of each surface \[J\]; empty for those that do not wear, and altogether where nothing
    /// does.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub wear: Vec<Vec<f64>>,
    /// The cell, where it deforms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<Cell>,
}

impl Progress {
    /// Makes surfaces and cell, as they are at this step, those that lists are made of.
    pub fn refer(&mut self, c: &Constants) {
        for s in 0..self.surfaces.len() {
            self.surfaces[s].reference = self.surfaces[s].placed(c, s, self).pose;
        }
        if let Some(cell) = &mut self.cell {
            cell.refer();
        }
        self.rebuilt = self.step;
    }

    /// Takes in the forces of one step on the surfaces (force \[N\], torque about the frame's origin
    /// \[N m\]): sums of the sample, path and measures.
    pub fn account(&mut self, c: &Constants, forces: &[[f64; 6]]) {
        for (s, f) in forces.iter().enumerate() {
            for k in 0..6 {
                self.impulse[s][k] += f[k];
            }
        }
        self.impulse_steps += 1;
        let Some(stage) = c.spec.stages.get(self.stage) else { return };
        let time = (self.step - self.stage_since) as f64 * c.dt;
        for (m, measure) in stage.measures.iter().enumerate() {
            let s = measure.surface;
            let counts = match measure.window {
                Window::Stage => true,
                Window::Time(from, to) => (from..=to).contains(&time),
                Window::Displacement(from, to) => (from..=to).contains(&self.path[s]),
            };
            if !counts {
                continue;
            }
            let value = match measure.component {
                Component::Force(k) => forces[s][k],
                Component::Torque(k) => forces[s][k + 3],
                Component::Draught => {
                    let v = self.surfaces[s].placed(c, s, self).velocity;
                    draught(&forces[s], v)
                }
            };
            self.measures[m].add(value);
        }
        for s in 0..forces.len() {
            self.path[s] += norm(self.surfaces[s].placed(c, s, self).velocity) * c.dt;
        }
    }
}

/// The force against a velocity, `-F·v/|v|` \[N\]; 0 at rest.
pub fn draught(force: &[f64; 6], v: Vec3) -> f64 {
    let speed = norm(v);
    if speed > 0.0 { -(force[0] * v[0] + force[1] * v[1] + force[2] * v[2]) / speed } else { 0.0 }
}

/// The complete state of a world.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Particles.
    pub particles: Particles,
    /// Touching pairs, ascending by numbers.
    pub contacts: Vec<ContactMemory>,
    /// Touching surfaces, ascending by particle and surface.
    pub surface_contacts: Vec<SurfaceMemory>,
    /// All else.
    pub progress: Progress,
}

impl State {
    /// Tells the sample in a cell that leans less, see [`Cell::leaning`], if its own leans too much.
    pub fn upright(&mut self, c: &Constants) {
        let Some(cell) = &mut self.progress.cell else { return };
        let Some([yz, xz, xy]) = cell.leaning() else { return };
        cell.upright([yz, xz, xy]);
        let p = &mut self.particles;
        for i in 0..p.len() {
            let mut e = Encoded { hi: p.hi[i], lo: p.place[i].lo, rest: p.rest[i] };
            for (onto, of, periods) in [(1, 2, yz), (0, 2, xz), (0, 1, xy)] {
                if periods != 0 {
                    e = c.lattice.turned(e, onto, of, periods);
                }
            }
            (p.hi[i], p.place[i].lo, p.rest[i]) = (e.hi, e.lo, e.rest);
        }
        // The places of the lists are those in the cell before.
        self.progress.stale = true;
    }

    /// The particles of this sample with their contacts at the beginning of another world, which was prepared with the
    /// same particles as `fresh`: masses are those of the other world, the cell keeps its shape, and clock, strain and
    /// accounts begin anew.
    ///
    /// # Errors
    /// [`BytesError::OtherWorld`] if the other world's particles, windows or laws are not these.
    pub fn begin_anew(&self, c: &Constants, fresh: &Self) -> Result<Self, BytesError> {
        let mut inverse_mass = vec![f32::NAN; self.particles.len().max(fresh.particles.len())];
        for (id, velocity) in fresh.particles.id.iter().zip(&fresh.particles.velocity) {
            if let Some(place) = inverse_mass.get_mut(*id as usize) {
                *place = velocity.inv_mass;
            }
        }
        let mut state = Self {
            particles: self.particles.clone(),
            contacts: self.contacts.clone(),
            surface_contacts: Vec::new(),
            progress: fresh.progress.clone(),
        };
        for (id, velocity) in state.particles.id.iter().zip(&mut state.particles.velocity) {
            velocity.inv_mass = inverse_mass.get(*id as usize).copied().unwrap_or(f32::NAN);
        }
        if let (Some(cell), Some(shaped)) = (&mut state.progress.cell, &self.progress.cell) {
            *cell = Cell::new(shaped.matrix);
            cell.begin(c.spec.stages.first().and_then(|stage| stage.deformation.as_ref()));
        }
        state.progress.stale = true;
        // Accelerations are those of other materials.
        state.progress.primed = false;
        state.belongs_to(c)?;
        Ok(state)
    }

    /// A digest of the complete state over particles sorted by number: equal runs have equal hashes.
    pub fn hash(&self) -> String {
        let mut h = Sha256::new();
        let p = &self.particles;
        let mut order: Vec<usize> = (0..p.len()).collect();
        order.sort_unstable_by_key(|&i| p.id[i]);
        for &i in &order {
            let (x, v, w) = (p.place[i], p.velocity[i], p.spin[i]);
            h.update(p.id[i].to_le_bytes());
            x.lo.iter().for_each(|u| h.update(u.to_le_bytes()));
            p.hi[i].iter().for_each(|u| h.update(u.to_le_bytes()));
            let floats = [&p.rest[i], &v.v, &w.w, &p.acceleration[i], &p.angular[i], &p.force[i]];
            floats.into_iter().flatten().for_each(|f| h.update(f.to_bits().to_le_bytes()));
            h.update(x.radius.to_bits().to_le_bytes());
            h.update(v.inv_mass.to_bits().to_le_bytes());
            h.update(w.material.to_le_bytes());
        }
        for c in &self.contacts {
            c.id.iter().for_each(|u| h.update(u.to_le_bytes()));
            c.history.iter().for_each(|f| h.update(f.to_bits().to_le_bytes()));
        }
        for c in &self.surface_contacts {
            h.update(c.id.to_le_bytes());
            h.update(c.surface.to_le_bytes());
            c.n.iter().chain(&c.history).for_each(|f| h.update(f.to_bits().to_le_bytes()));
        }
        // Serialising plain data to a string cannot fail but for non-finite keys, of which there are none.
        h.update(serde_json::to_vec(&self.progress).unwrap_or_default());
        h.finalize().iter().fold(String::new(), |mut hex, b| {
            // Writing to a string cannot fail.
            let _ = write!(hex, "{b:02x}");
            hex
        })
    }
}
