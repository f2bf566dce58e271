//! Forces: candidates that touch are gathered into lanes, evaluated and scattered.

use super::super::common::{Standing, shown};
use super::lanes::{LANES, Lanes, Pair};
use super::list::{Block, Share, Touching};
use super::pairs::{Workbench, pairs};
use crate::lattice::{Lattice, Vec3x3, add, sub};
use crate::setup::{Constants, MEMORY};
use crate::spec::Vec3;
use crate::state::Particles;
use crate::surface::{SurfacePoint, physical_contacts};
use crate::wear::Rub;

/// What a phase is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Forces of a step; history moves on.
    Step,
    /// Forces without a step: history stays (before the first step of schemes that need accelerations).
    Prime,
    /// Energies and counts of the present configuration; nothing changes.
    Observe,
}

/// The cell as it is.
pub struct Space {
    /// Positions.
    pub lattice: Lattice,
    /// Velocity gradient \[1/s\], if it deforms.
    pub gradient: Option<Vec3x3>,
}

/// What is the same for all blocks in a phase.
pub struct Phase<'a> {
    /// The world.
    pub c: &'a Constants,
    /// The cell as it is.
    pub space: &'a Space,
    /// Coefficients by pair of materials.
    pub pairs: &'a [Pair],
    /// Particles.
    pub p: &'a Particles,
    /// Boundaries.
    pub standing: &'a [Standing],
    /// What for.
    pub purpose: Purpose,
    /// Whether dissipated energy is accounted.
    pub ledger: bool,
    /// Step \[s\]; 0 unless the purpose is a step.
    pub dt: f32,
    /// Quads that hold what a contact remembers.
    pub quads: usize,
}

impl Phase<'_> {
    /// Whether bonds may break.
    #[inline(always)]
    pub fn breaks(&self) -> bool {
        self.purpose == Purpose::Step && self.c.bonds()
    }

    /// By how much velocities are behind the places \[s\].
    #[inline(always)]
    pub fn lag(&self) -> f32 {
        if self.c.spec.time.integrator.lags() { 0.5 * self.dt } else { 0.0 }
    }

    /// Whether anybody asks for energies.
    #[inline(always)]
    pub fn accounts(&self) -> bool {
        self.ledger || self.purpose == Purpose::Observe
    }
}

/// A contact with a surface.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePull {
    /// Particle, counted from the block's first.
    pub local: u32,
    /// Boundary.
    pub boundary: u32,
    /// Triangle; of a shell the one that shows the contact.
    pub triangle: u32,
    /// From the particle to where they touch \[m\].
    pub branch: Vec3,
    /// Force on the particle \[N\].
    pub force: [f32; 3],
    /// Energy of the normal and of the tangential spring before the step's motion \[J\].
    pub energy: [f32; 2],
}

/// A pair in contact.
#[derive(Clone, Copy, Debug)]
pub struct PairSeen {
    /// The two particles.
    pub of: [u32; 2],
    /// From the first to the nearest image of the second \[m\].
    pub branch: Vec3,
    /// Force on the first \[N\].
    pub force: [f32; 3],
    /// Stiffness of the normal spring \[N/m\].
    pub stiffness: f32,
    /// Energy of the normal and of the tangential spring \[J\].
    pub energy: [f32; 2],
}

/// What a block's phase finds.
#[derive(Debug, Default)]
pub struct Found {
    /// Contacts with surfaces, ordered by particle, when observing.
    pub surface: Vec<SurfacePull>,
    /// Force (3) and torque (3) of the particles on each moving or fixed surface of the specification,
    /// torque about its frame's origin \[N\], \[N m\].
    pub on_surface: Vec<[f64; 6]>,
    /// Work done by surfaces on particles in the step \[J\].
    pub work: f64,
    /// Work that dashpots and rolling resistance do, with velocities before the step \[W\].
    pub drain: [f64; 2],
    /// Energy of normal springs and cohesion \[J\].
    pub energy_normal: f64,
    /// Energy of tangential springs \[J\].
    pub energy_tangential: f64,
    /// The same before the step's motion \[J\].
    pub energy_before: f64,
    /// Lost to friction, and where contacts yield and part \[J\].
    pub friction_loss: f64,
    /// Lost where rolling springs slip \[J\].
    pub roll_lost: f64,
    /// Largest overlap as a fraction of the smaller radius, with particle and partner.
    pub worst: (f32, u32, u32),
    /// Pairs in contact, when observing.
    pub pairs: Vec<PairSeen>,
    /// Pairs and surface contacts.
    pub contacts: [u64; 2],
    /// Bonds that broke in the step.
    pub broken: u64,
    /// What rubbed on surfaces that wear in the step.
    pub rubs: Vec<Rub>,
}

/// Working memory of a thread.
#[derive(Default)]
pub struct Scratch {
    lanes: Lanes,
    bench: Workbench,
    near: Vec<SurfacePoint>,
    before: Vec<Touching>,
    meetings: Vec<Meeting>,
}

/// One block's forces. `#[inline(always)]` so that each of the callers below compiles it for its own
/// instruction set; the arithmetic, and so every bit, is the same in all of them.
#[inline(always)]
fn block_phase(
    ph: &Phase<'_>,
    block: &mut Block,
    sums: &mut [Share],
    drains: &mut [Share],
    found: &mut Found,
    scratch: &mut Scratch,
) {
    found.surface.clear();
    found.drain = [0.0; 2];
    found.pairs.clear();
    found.on_surface.clear();
    found.on_surface.resize(ph.c.spec.surfaces.len(), [0.0; 6]);
    found.work = 0.0;
    found.energy_normal = 0.0;
    found.energy_tangential = 0.0;
    found.energy_before = 0.0;
    found.friction_loss = 0.0;
    found.roll_lost = 0.0;
    found.worst = (0.0, 0, 0);
    found.contacts = [0; 2];
    found.broken = 0;
    found.rubs.clear();
    if ph.purpose != Purpose::Observe {
        sums.fill(Share::default());
        drains.fill(Share::default());
    }
    pairs(ph, block, sums, drains, found, &mut scratch.lanes, &mut scratch.bench);
    surfaces(ph, block, sums, drains, found, scratch);
}

impl Found {
    /// Adds the energies of the first `used` lanes.
    #[inline(always)]
    pub fn sum_energies(&mut self, lanes: &Lanes, used: usize) {
        for l in 0..used {
            self.energy_normal += f64::from(lanes.energy_normal[l]);
            self.energy_tangential += f64::from(lanes.energy_tangential[l]);
            self.energy_before += f64::from(lanes.energy_before[l]);
            self.friction_loss += f64::from(lanes.friction_loss[l]);
            self.roll_lost += f64::from(lanes.roll_lost[l]);
            self.drain[0] += f64::from(lanes.dash_power[l]);
            self.drain[1] += f64::from(lanes.roll_power[l]);
        }
    }
}

/// A contact with a surface, to be evaluated.
struct Meeting {
    patch: u32,
    contact: u32,
    i: u32,
    boundary: u32,
    at: SurfacePoint,
    /// From the surface's frame origin to the contact point \[m\].
    arm: Vec3,
    history: [f32; MEMORY],
}

#[inline(always)]
fn surfaces(
    ph: &Phase<'_>,
    block: &mut Block,
    sums: &mut [Share],
    drains: &mut [Share],
    found: &mut Found,
    scratch: &mut Scratch,
) {
    if block.patches.is_empty() {
        return;
    }
    let mut meetings = std::mem::take(&mut scratch.meetings);
    meetings.clear();
    meet_all(ph, block, &mut meetings, &mut scratch.near, &mut scratch.before);
    let lanes = &mut scratch.lanes;
    let materials = ph.c.spec.materials.len();
    let pair_of = |m: &Meeting| {
        ph.p.spin[m.i as usize].material as usize * materials + ph.c.boundaries[m.boundary as usize].material
    };
    for same in meetings.chunk_by(|a, b| pair_of(a) == pair_of(b)) {
        for group in same.chunks(LANES) {
            for (l, m) in group.iter().enumerate() {
                fill_surface(ph, lanes, l, m);
            }
            lanes.on_surfaces(group.len());
            lanes.evaluate(
                group.len(),
                ph.c.layout,
                &ph.pairs[pair_of(&group[0])],
                [ph.dt, 0.0],
                ph.accounts(),
            );
            scatter_surfaces(ph, block, [&mut *sums, &mut *drains], found, lanes, group);
        }
    }
    scratch.meetings = meetings;
}

/// Finds the contacts of a block with surfaces; contacts of the last step hand their history to the nearest
/// normals of this one, whatever triangle they are on.
fn meet_all(
    ph: &Phase<'_>,
    block: &mut Block,
    meetings: &mut Vec<Meeting>,
    near: &mut Vec<SurfacePoint>,
    before: &mut Vec<Touching>,
) {
    for (at, patch) in block.patches.iter_mut().enumerate() {
        let standing = &ph.standing[patch.boundary as usize];
        let i = block.first + patch.local as usize;
        let place = &ph.p.place[i];
        near.clear();
        // Facets are told for the image that the particle was when the list was made.
        let hi = ph.c.lattice.unwrapped((ph.p.hi_ref[i], ph.p.lo_ref[i]), (ph.p.hi[i], place.lo));
        let center = ph.c.lattice.decode(hi, place.lo, ph.p.rest[i]);
        if standing.present {
            let facets = &block.facets[patch.facets.0 as usize..patch.facets.1 as usize];
            let boundary = &ph.c.boundaries[patch.boundary as usize];
            let radius = f64::from(place.radius);
            let facets = facets.iter().map(|f| (f.triangle, f.shift));
            standing.touches(ph.c, boundary, center, radius + ph.c.range, facets, near);
            if near.len() > 1 {
                physical_contacts(near, radius);
            }
        }
        before.clear();
        before.extend_from_slice(&patch.contacts);
        if ph.purpose == Purpose::Step {
            patch.contacts.clear();
        }
        for (contact, q) in near.iter().enumerate() {
            let n = [q.n[0] as f32, q.n[1] as f32, q.n[2] as f32];
            let mut history = [0.0; MEMORY];
            let cosine = |t: &Touching| t.n[0] * n[0] + t.n[1] * n[1] + t.n[2] * n[2];
            let kin = (0..before.len()).max_by(|&a, &b| cosine(&before[a]).total_cmp(&cosine(&before[b])));
            if let Some(k) = kin.filter(|&k| cosine(&before[k]) > KIN) {
                history = before.swap_remove(k).history;
            }
            if ph.purpose == Purpose::Step {
                patch.contacts.push(Touching { n, history });
            }
            let point = add(ph.c.shifted(center, q.shift), crate::lattice::scale(q.n, q.distance));
            meetings.push(Meeting {
                patch: at as u32,
                contact: contact as u32,
                i: i as u32,
                boundary: patch.boundary,
                at: *q,
                arm: sub(point, standing.placed.pose.translation),
                history,
            });
        }
    }
}

/// Least cosine between the normals of a contact before and after a step.
const KIN: f32 = 0.5;

#[inline(always)]
fn fill_surface(ph: &Phase<'_>, lanes: &mut Lanes, l: usize, m: &Meeting) {
    let i = m.i as usize;
    let placed = &ph.standing[m.boundary as usize].placed;
    let turning = crate::lattice::cross(placed.spin, m.arm);
    let (v, w) = (ph.p.velocity[i], ph.p.spin[i]);
    for x in 0..3 {
        lanes.n[x][l] = m.at.n[x] as f32;
        lanes.v[0][x][l] = v.v[x];
        lanes.v[1][x][l] = (placed.velocity[x] + turning[x]) as f32;
        lanes.w[0][x][l] = w.w[x];
        lanes.w[1][x][l] = placed.spin[x] as f32;
    }
    lanes.distance[l] = m.at.distance;
    lanes.radius[0][l] = ph.p.place[i].radius;
    lanes.radius[1][l] = 0.0;
    lanes.inv_mass[0][l] = v.inv_mass;
    lanes.inv_mass[1][l] = 0.0;
    for f in 0..MEMORY {
        lanes.history[f][l] = m.history[f];
    }
}

fn scatter_surfaces(
    ph: &Phase<'_>,
    block: &mut Block,
    [sums, drains]: [&mut [Share]; 2],
    found: &mut Found,
    lanes: &mut Lanes,
    group: &[Meeting],
) {
    found.contacts[1] += group.len() as u64;
    if let Some(l) = lanes.worse_overlap(group.len(), found.worst.0) {
        found.worst = (lanes.ratio[l], group[l].i, u32::MAX - group[l].boundary);
    }
    for (l, m) in group.iter().enumerate() {
        let of = |lane: &[[f32; LANES]; 3]| [lane[0][l], lane[1][l], lane[2][l]];
        let force = of(&lanes.force);
        let local = m.i - block.first as u32;
        if ph.purpose == Purpose::Observe {
            let (boundary, standing) = (m.boundary as usize, &ph.standing[m.boundary as usize]);
            found.surface.push(SurfacePull {
                local,
                boundary: m.boundary,
                triangle: shown(&ph.c.boundaries[boundary], standing, m.arm, m.at.triangle),
                branch: crate::lattice::scale(m.at.n, m.at.distance),
                force,
                energy: [lanes.energy_normal[l], lanes.energy_before[l]],
            });
            continue;
        }
        sums[local as usize].add(force, of(&lanes.torque[0]));
        if ph.ledger {
            drains[local as usize].add(of(&lanes.dash), of(&lanes.drain[0]));
        }
        if ph.purpose != Purpose::Step {
            continue;
        }
        let contact = &mut block.patches[m.patch as usize].contacts[m.contact as usize];
        for f in 0..MEMORY {
            contact.history[f] = lanes.history[f][l];
        }
        let wall = [of(&lanes.v[1]), of(&lanes.w[1])];
        if let Some(s) = ph.c.boundaries[m.boundary as usize].surface {
            if ph.c.wear_of(s).is_some() {
                let (boundary, standing) =
                    (&ph.c.boundaries[m.boundary as usize], &ph.standing[m.boundary as usize]);
                let facet = shown(boundary, standing, m.arm, m.at.triangle);
                let (force, sliding) = (force.map(f64::from), of(&lanes.vt).map(f64::from));
                found.rubs.push(Rub::new(s, facet, force, m.at.n, sliding, ph.c.dt));
            }
            // The reaction: minus the force at the contact point, minus the rolling torque's partner.
            let f = force.map(|x| -f64::from(x));
            let t = add(crate::lattice::cross(m.arm, f), of(&lanes.torque[1]).map(f64::from));
            for x in 0..3 {
                found.on_surface[s][x] += f[x];
                found.on_surface[s][x + 3] += t[x];
                found.work -= f64::from(ph.dt)
                    * (f[x] * f64::from(wall[0][x])
                        + f64::from(lanes.torque[1][x][l]) * f64::from(wall[1][x]));
            }
        }
    }
    if ph.accounts() {
        found.sum_energies(lanes, group.len());
    }
}

/// The forces of one block, with the widest instructions that the machine has.
pub fn run(
    ph: &Phase<'_>,
    block: &mut Block,
    sums: &mut [Share],
    drains: &mut [Share],
    found: &mut Found,
    scratch: &mut Scratch,
) {
    widest!(block_phase(
        ph: &Phase<'_>,
        block: &mut Block,
        sums: &mut [Share],
        drains: &mut [Share],
        found: &mut Found,
        scratch: &mut Scratch,
    ));
}
