//! Forces: candidates that touch are gathered into lanes, evaluated and scattered.

use super::super::common::{Standing, shown};
use super::lanes::{LANES, Lanes, Pair};
use super::list::{Block, Pull, Touching};
use crate::lattice::{Lattice, Vec3x3, add, mul, sub};
use crate::setup::{Constants, MEMORY};
use crate::spec::Vec3;
use crate::state::Particles;
use crate::surface::{SurfacePoint, physical_contacts};

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
}

/// Force and torque of one surface contact.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePull {
    /// Particle, counted from the block's first.
    pub local: u32,
    /// Boundary.
    pub boundary: u32,
    /// Triangle, or part of a shell in a step, else the triangle that shows it.
    pub triangle: u32,
    /// Force on the particle \[N\].
    pub force: [f32; 3],
    /// Torque on the particle \[N m\].
    pub torque: [f32; 3],
    /// The dissipating part of both.
    pub drain: [[f32; 3]; 2],
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
    /// Contacts with surfaces, ordered by particle.
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
    /// Lost to friction \[J\].
    pub friction_loss: f64,
    /// Largest overlap as a fraction of the smaller radius, with particle and partner.
    pub worst: (f32, u32, u32),
    /// Pairs in contact, when observing.
    pub pairs: Vec<PairSeen>,
    /// Pairs and surface contacts.
    pub contacts: [u64; 2],
}

/// Whom a lane belongs to.
#[derive(Clone, Copy, Default)]
struct Owner {
    i: u32,
    j: u32,
    /// Candidate.
    k: u32,
}

/// Working memory of a thread.
pub struct Scratch {
    lanes: Lanes,
    owner: [Owner; LANES],
    near: Vec<SurfacePoint>,
    meetings: Vec<Meeting>,
}

impl Default for Scratch {
    fn default() -> Self {
        let owner = [Owner::default(); LANES];
        Self { lanes: Lanes::default(), owner, near: Vec::new(), meetings: Vec::new() }
    }
}

/// One block's forces. `#[inline(always)]` so that each of the callers below compiles it for its own
/// instruction set; the arithmetic, and so every bit, is the same in all of them.
#[inline(always)]
fn block_phase(
    ph: &Phase<'_>,
    block: &mut Block,
    pull: &mut [Pull],
    drain: &mut [Pull],
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
    found.worst = (0.0, 0, 0);
    found.contacts = [0; 2];
    pairs(ph, block, pull, drain, found, scratch);
    surfaces(ph, block, found, scratch);
}

#[inline(always)]
fn pairs(
    ph: &Phase<'_>,
    block: &mut Block,
    pull: &mut [Pull],
    drain: &mut [Pull],
    found: &mut Found,
    scratch: &mut Scratch,
) {
    let Scratch { lanes, owner, .. } = scratch;
    let (p, materials) = (ph.p, ph.c.spec.materials.len());
    let h = ph.c.history.len();
    let unit = &ph.space.lattice.unit;
    let (ux, uy, uz) = (unit[0][0], unit[1][1], unit[2][2]);
    let orthogonal = ph.space.lattice.orthogonal;
    let count = block.start.len() - 1;
    let places = &p.place[block.first..block.first + count];
    let mut used = 0;
    let mut current = usize::MAX;
    for (local, pi) in places.iter().enumerate() {
        let i = block.first + local;
        let (vi, wi) = (p.velocity[i], p.spin[i]);
        for k in block.start[local] as usize..block.start[local + 1] as usize {
            let j = block.partner[k] as usize;
            let pj = &p.place[j];
            let a = f64::from(pj.lo[0].wrapping_sub(pi.lo[0]) as i32);
            let b = f64::from(pj.lo[1].wrapping_sub(pi.lo[1]) as i32);
            let c = f64::from(pj.lo[2].wrapping_sub(pi.lo[2]) as i32);
            let d = if orthogonal { [a * ux, b * uy, c * uz] } else { mul(unit, [a, b, c]) };
            let reach = f64::from(pi.radius) + f64::from(pj.radius) + ph.c.range;
            if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] >= reach * reach {
                if block.touching[k] && ph.purpose == Purpose::Step {
                    // The next contact of this pair is born without memory, and adds nothing until then.
                    block.touching[k] = false;
                    block.history[k * h..(k + 1) * h].fill(0.0);
                    pull[k] = Pull::default();
                    if ph.ledger {
                        drain[k] = Pull::default();
                    }
                }
                continue;
            }
            let wj = &p.spin[j];
            let pair = wi.material as usize * materials + wj.material as usize;
            if used == LANES || (pair != current && used > 0) {
                flush_pairs(ph, current, block, pull, drain, found, lanes, &owner[..used]);
                used = 0;
            }
            current = pair;
            let vj = &p.velocity[j];
            // Always below LANES; the mask tells the compiler so.
            let l = used & (LANES - 1);
            for x in 0..3 {
                lanes.d[x][l] = d[x];
                lanes.v[0][x][l] = vi.v[x];
                lanes.v[1][x][l] = vj.v[x];
                lanes.w[0][x][l] = wi.w[x];
                lanes.w[1][x][l] = wj.w[x];
            }
            if let Some(gradient) = &ph.space.gradient {
                // The image moves with the cell.
                let flow = mul(gradient, d);
                for x in 0..3 {
                    lanes.v[1][x][l] += flow[x] as f32;
                }
            }
            lanes.radius[0][l] = pi.radius;
            lanes.radius[1][l] = pj.radius;
            lanes.inv_mass[0][l] = vi.inv_mass;
            lanes.inv_mass[1][l] = vj.inv_mass;
            for (lane, x) in lanes.history.iter_mut().zip(&block.history[k * h..(k + 1) * h]) {
                lane[l] = *x;
            }
            owner[l] = Owner { i: i as u32, j: j as u32, k: k as u32 };
            used += 1;
        }
    }
    if used > 0 {
        flush_pairs(ph, current, block, pull, drain, found, lanes, &owner[..used]);
    }
}

#[inline(always)]
fn flush_pairs(
    ph: &Phase<'_>,
    pair: usize,
    block: &mut Block,
    pull: &mut [Pull],
    drain: &mut [Pull],
    found: &mut Found,
    lanes: &mut Lanes,
    owner: &[Owner],
) {
    let used = owner.len().min(LANES);
    lanes.pad(used);
    lanes.between_spheres(used);
    lanes.evaluate(used, ph.c.laws, &ph.pairs[pair], ph.dt);
    found.contacts[0] += used as u64;
    sum_energies(found, lanes, used);
    let worst = lanes.worst_overlap(used);
    if lanes.ratio[worst] > found.worst.0 {
        found.worst = (lanes.ratio[worst], owner[worst].i, owner[worst].j);
    }
    let of = |lane: &[[f32; LANES]; 3], l: usize| [lane[0][l], lane[1][l], lane[2][l]];
    if ph.purpose == Purpose::Observe {
        found.pairs.extend((0..used).map(|l| PairSeen {
            of: [owner[l].i, owner[l].j],
            branch: [0, 1, 2].map(|x| lanes.d[x][l]),
            force: of(&lanes.force, l),
            stiffness: lanes.stiffness[l],
            energy: [lanes.energy_normal[l], lanes.energy_before[l]],
        }));
        return;
    }
    if let Some(gradient) = &ph.space.gradient {
        for l in 0..used {
            let flow = mul(gradient, [0, 1, 2].map(|x| lanes.d[x][l]));
            let force = of(&lanes.force, l).map(f64::from);
            found.work += f64::from(ph.dt) * crate::lattice::dot(force, flow);
        }
    }
    let h = ph.c.history.len();
    for l in 0..used {
        let k = owner[l].k as usize;
        pull[k] = Pull {
            force: of(&lanes.force, l),
            torque: of(&lanes.torque[0], l),
            torque_other: of(&lanes.torque[1], l),
        };
        block.touching[k] = true;
        if ph.purpose == Purpose::Step {
            for (x, lane) in block.history[k * h..(k + 1) * h].iter_mut().zip(&lanes.history) {
                *x = lane[l];
            }
        }
    }
    if ph.ledger {
        for l in 0..used {
            drain[owner[l].k as usize] = Pull {
                force: of(&lanes.dash, l),
                torque: of(&lanes.drain[0], l),
                torque_other: of(&lanes.drain[1], l),
            };
        }
    }
}

#[inline(always)]
fn sum_energies(found: &mut Found, lanes: &Lanes, used: usize) {
    for l in 0..used {
        found.energy_normal += f64::from(lanes.energy_normal[l]);
        found.energy_tangential += f64::from(lanes.energy_tangential[l]);
        found.energy_before += f64::from(lanes.energy_before[l]);
        found.friction_loss += f64::from(lanes.friction_loss[l]);
        found.drain[0] += f64::from(lanes.dash_power[l]);
        found.drain[1] += f64::from(lanes.roll_power[l]);
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
fn surfaces(ph: &Phase<'_>, block: &mut Block, found: &mut Found, scratch: &mut Scratch) {
    let mut meetings = std::mem::take(&mut scratch.meetings);
    meetings.clear();
    meet_all(ph, block, &mut meetings, &mut scratch.near);
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
            lanes.pad(group.len());
            lanes.on_surfaces(group.len());
            lanes.evaluate(group.len(), ph.c.laws, &ph.pairs[pair_of(&group[0])], ph.dt);
            scatter_surfaces(ph, block, found, lanes, group);
        }
    }
    scratch.meetings = meetings;
}

/// Finds the contacts of a block with surfaces; contacts of the last step hand their history to the nearest
/// normals of this one, whatever triangle they are on.
fn meet_all(ph: &Phase<'_>, block: &mut Block, meetings: &mut Vec<Meeting>, near: &mut Vec<SurfacePoint>) {
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
            physical_contacts(near, radius);
        }
        let mut before = patch.contacts.clone();
        if ph.purpose == Purpose::Step {
            patch.contacts.clear();
        }
        for (contact, q) in near.iter().enumerate() {
            let n = q.n.map(|x| x as f32);
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
    found: &mut Found,
    lanes: &mut Lanes,
    group: &[Meeting],
) {
    found.contacts[1] += group.len() as u64;
    lanes.worst_overlap(group.len());
    for (l, m) in group.iter().enumerate() {
        if lanes.ratio[l] > found.worst.0 {
            found.worst = (lanes.ratio[l], m.i, u32::MAX - m.boundary);
        }
        let of = |lane: &[[f32; LANES]; 3]| [lane[0][l], lane[1][l], lane[2][l]];
        let (force, torque) = (of(&lanes.force), of(&lanes.torque[0]));
        let local = m.i - block.first as u32;
        found.surface.push(SurfacePull {
            local,
            boundary: m.boundary,
            triangle: if ph.purpose == Purpose::Step {
                m.at.triangle
            } else {
                let b = m.boundary as usize;
                shown(&ph.c.boundaries[b], &ph.standing[b], m.arm, m.at.triangle)
            },
            force,
            torque,
            drain: [of(&lanes.dash), of(&lanes.drain[0])],
            energy: [lanes.energy_normal[l], lanes.energy_before[l]],
        });
        if ph.purpose != Purpose::Step {
            continue;
        }
        let contact = &mut block.patches[m.patch as usize].contacts[m.contact as usize];
        for f in 0..MEMORY {
            contact.history[f] = lanes.history[f][l];
        }
        let wall = [of(&lanes.v[1]), of(&lanes.w[1])];
        if let Some(s) = ph.c.boundaries[m.boundary as usize].surface {
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
    sum_energies(found, lanes, group.len());
}

/// The forces of one block, with the widest instructions that the machine has.
pub fn run(
    ph: &Phase<'_>,
    block: &mut Block,
    pull: &mut [Pull],
    drain: &mut [Pull],
    found: &mut Found,
    scratch: &mut Scratch,
) {
    widest!(block_phase(
        ph: &Phase<'_>,
        block: &mut Block,
        pull: &mut [Pull],
        drain: &mut [Pull],
        found: &mut Found,
        scratch: &mut Scratch,
    ));
}
