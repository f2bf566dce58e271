//! The reference backend, the oracle that every other backend is compared with: each particle meets each
//! other particle and each triangle in every step, and everything is f64. It has no lists, no lanes and no
//! threads, and takes its laws from the f64 twin of the kernel source.
//!
//! A state holds velocities in f32, so a reference that goes on from its own state does so from rounded
//! values.

mod contact;
mod motion;

use std::collections::BTreeMap;
use std::sync::Arc;

use glebe_physics::IntegratorKind;
use glebe_physics::kernel64::contact::{relative_velocity, tangential_part};
use glebe_physics::kernel64::integrate;
use glebe_physics::kernel64::vector::{V3, cross, dot, minus, plus, scaled};

use self::contact::{Meeting, Pull};
use self::motion::{Motion, Moved};
use super::common::{
    Portrait, Standing, narrow_failure, outside, overlap_failure, quoted, runaway_failure, shown, too_deep,
    unload,
};
use super::team::Team;
use super::worlds::{World, Worlds};
use super::{Detail, Link, Moment, Touch};
use crate::failure::Failure;
use crate::lattice::{Lattice, Vec3x3, add, mul, norm, sub};
use crate::measure::Tensors;
use crate::setup::{BoundaryShape, Constants};
use crate::spec::Vec3;
use crate::state::{ContactMemory, Particles, Place, Progress, Spin, State, SurfaceMemory, Velocity};
use crate::surface::{Span, SurfacePoint, physical_contacts};
use crate::wear::Rub;

/// A particle.
#[derive(Clone, Debug)]
struct Body {
    id: u32,
    material: u32,
    radius: f64,
    inv_mass: f64,
    /// Where it was when it was loaded \[m\], and how far it has moved since: far from the origin the small
    /// displacement keeps its digits.
    home: Vec3,
    moved: Vec3,
    v: V3,
    w: V3,
    /// Accelerations of the last step, and the force of its contacts.
    a: V3,
    alpha: V3,
    force: V3,
}

impl Body {
    /// Where it has gone, seams not minded.
    fn x(&self) -> Vec3 {
        add(self.home, self.moved)
    }

    /// How many periods away that is from the cell.
    fn turns(&self, l: &Lattice) -> Vec3 {
        l.periods(sub(self.x(), l.origin)).map(f64::floor)
    }

    /// The centre of its image inside the cell \[m\].
    fn inside(&self, l: &Lattice) -> Vec3 {
        sub(self.x(), mul(&l.cell, self.turns(l)))
    }

    fn inv_inertia(&self) -> f64 {
        2.5 * self.inv_mass / (self.radius * self.radius)
    }

    fn portrait(&self, l: &Lattice) -> Portrait {
        Portrait {
            id: self.id,
            mass: 1.0 / self.inv_mass,
            radius: self.radius,
            x: self.inside(l),
            v: array(self.v),
            w: array(self.w),
        }
    }
}

/// What a contact with a surface remembers: the unit vector into the surface and the history.
type Touched = (Vec3, Vec<f64>);

/// With whom a particle is in contact.
#[derive(Clone, Copy)]
enum Partner {
    /// Another particle, by index.
    Particle(usize),
    /// A triangle of a boundary.
    Surface { boundary: usize, triangle: usize },
}

/// A contact of the present configuration.
struct Contact {
    i: usize,
    with: Partner,
    meeting: Meeting,
    pull: Pull,
    /// From the surface's frame origin to the contact point \[m\]; zero between particles.
    arm: V3,
}

/// Worlds computed by the reference.
pub type ReferenceFleet = Worlds<ReferenceWorld>;

/// A world computed by the reference.
pub struct ReferenceWorld {
    c: Arc<Constants>,
    /// Positions in the cell as it is.
    lattice: Lattice,
    /// Velocity gradient of the cell \[1/s\], if it deforms.
    gradient: Option<Vec3x3>,
    bodies: Vec<Body>,
    standing: Vec<Standing>,
    /// Memory of touching pairs, seen from the lower number.
    pairs: BTreeMap<[u32; 2], Vec<f64>>,
    /// Memory of contacts with surfaces, by particle and boundary.
    surfaces: BTreeMap<(u32, usize), Vec<Touched>>,
}

impl World for ReferenceWorld {
    fn new(c: Arc<Constants>, state: &mut State) -> Self {
        let standing = c.boundaries.iter().map(|_| Standing::default()).collect();
        let mut world = Self {
            lattice: c.lattice.clone(),
            gradient: None,
            c,
            bodies: Vec::new(),
            standing,
            pairs: BTreeMap::new(),
            surfaces: BTreeMap::new(),
        };
        world.load(state);
        world
    }

    fn constants(&self) -> &Arc<Constants> {
        &self.c
    }

    fn step(&mut self, g: &mut Progress, _: &Team) -> Result<(), Failure> {
        let c = self.c.clone();
        let kind = c.spec.time.integrator;
        let split = kind == IntegratorKind::VelocityVerlet;
        if split {
            if !g.primed {
                self.stand(g);
                self.prime();
            }
            let moved = self.motion(g, kind, None);
            self.check(g, &moved)?;
            // The force belongs to the end of the step, for surfaces too.
            g.step += 1;
            self.deform(g)?;
        }
        self.stand(g);
        let contacts = self.contacts_of_step(c.dt);
        let moved = self.motion(g, kind, Some(&self.sums(&contacts)));
        self.account(g, &contacts, &moved, split);
        self.guard(g, &contacts)?;
        self.check(g, &moved)?;
        g.primed = true;
        if !split {
            g.step += 1;
            self.deform(g)?;
        }
        self.release(g);
        Ok(())
    }

    fn observe(&mut self, g: &Progress) -> Moment {
        self.stand(g);
        let mut m = Moment::default();
        let contacts = self.contacts_now();
        for contact in &contacts {
            m.elastic_normal += contact.pull.energy_normal;
            m.elastic_tangential += contact.pull.energy_tangential[1];
            m.overlap = m.overlap.max(contact.depth());
            match contact.with {
                Partner::Particle(_) => m.contacts += 1,
                Partner::Surface { .. } => m.surface_contacts += 1,
            }
        }
        for b in &self.bodies {
            let p = b.portrait(&self.lattice);
            let e = p.energy(&self.c);
            m.translation += e[0];
            m.rotation += e[1];
            m.potential += e[2];
            m.speed = m.speed.max(norm(p.v));
        }
        m.tensors = self.c.is_sample().then(|| self.tensors(&contacts));
        m
    }

    fn detail(&mut self, g: &Progress) -> Detail {
        self.stand(g);
        let mut d = Detail { coordination: vec![0; self.bodies.len()], ..Detail::default() };
        for s in 0..self.c.spec.surfaces.len() {
            d.on_triangles.push(vec![[0.0; 3]; self.c.boundaries[s].shape.triangles()]);
        }
        for contact in self.contacts_now() {
            d.coordination[contact.i] += 1;
            let m = &contact.meeting;
            match contact.with {
                Partner::Particle(j) => {
                    d.coordination[j] += 1;
                    d.network.push(Link {
                        id: [self.bodies[contact.i].id, self.bodies[j].id],
                        branch: array(scaled(m.n, m.arm[0] + m.arm[1])),
                        force: narrow(contact.pull.force),
                    });
                }
                Partner::Surface { boundary, triangle } => {
                    d.touches.push(Touch {
                        id: self.bodies[contact.i].id,
                        surface: boundary as u32,
                        branch: array(scaled(m.n, m.arm[0])),
                        force: narrow(contact.pull.force),
                    });
                    if let Some(s) = self.c.boundaries[boundary].surface {
                        let (shape, standing) = (&self.c.boundaries[boundary], &self.standing[boundary]);
                        let triangle = shown(shape, standing, array(contact.arm), triangle as u32);
                        let on = &mut d.on_triangles[s][triangle as usize];
                        *on = sub(*on, array(contact.pull.force));
                    }
                }
            }
        }
        d
    }

    fn state(&self, g: &Progress) -> State {
        let mut p = Particles::default();
        for b in &self.bodies {
            let e = self.lattice.encode(b.x());
            p.id.push(b.id);
            p.place.push(Place { lo: e.lo, radius: b.radius as f32 });
            p.velocity.push(Velocity { v: narrow(b.v), inv_mass: b.inv_mass as f32 });
            p.spin.push(Spin { w: narrow(b.w), material: b.material });
            p.hi.push(e.hi);
            p.rest.push(e.rest);
            p.acceleration.push(narrow(b.a));
            p.angular.push(narrow(b.alpha));
            p.force.push(narrow(b.force));
            p.hi_ref.push(e.hi);
            p.lo_ref.push(e.lo);
        }
        let floats = |h: &[f64]| h.iter().map(|x| *x as f32).collect();
        let contacts =
            self.pairs.iter().map(|(id, h)| ContactMemory { id: *id, history: floats(h) }).collect();
        let surface_contacts = self
            .surfaces
            .iter()
            .flat_map(|((id, boundary), touched)| {
                touched.iter().map(|(n, h)| SurfaceMemory {
                    id: *id,
                    surface: *boundary as u32,
                    n: n.map(|x| x as f32),
                    history: floats(h),
                })
            })
            .collect();
        // The order is not that of any list: whoever has lists must build them first.
        State { particles: p, contacts, surface_contacts, progress: Progress { stale: true, ..g.clone() } }
    }

    fn load(&mut self, state: &mut State) {
        let p = &state.particles;
        self.take_cell(&state.progress);
        self.bodies = (0..p.len())
            .map(|i| Body {
                id: p.id[i],
                material: p.spin[i].material,
                radius: f64::from(p.place[i].radius),
                inv_mass: f64::from(p.velocity[i].inv_mass),
                home: self.lattice.decode(p.hi[i], p.place[i].lo, p.rest[i]),
                moved: [0.0; 3],
                v: wide(p.velocity[i].v),
                w: wide(p.spin[i].w),
                a: wide(p.acceleration[i]),
                alpha: wide(p.angular[i]),
                force: wide(p.force[i]),
            })
            .collect();
        let floats = |h: &[f32]| h.iter().copied().map(f64::from).collect();
        self.pairs = state.contacts.iter().map(|m| (m.id, floats(&m.history))).collect();
        self.surfaces.clear();
        for m in &state.surface_contacts {
            let touched = (m.n.map(f64::from), floats(&m.history));
            self.surfaces.entry((m.id, m.surface as usize)).or_default().push(touched);
        }
        state.progress.stale = false;
    }

    fn bytes(&self) -> (usize, usize) {
        let floats: usize = self.pairs.values().map(Vec::len).sum();
        let bytes = self.bodies.len() * size_of::<Body>()
            + self.pairs.len() * size_of::<([u32; 2], Vec<f64>)>()
            + floats * size_of::<f64>();
        (bytes, self.bodies.len())
    }
}

impl ReferenceWorld {
    /// Takes up the cell of the present step, and places boundaries.
    fn stand(&mut self, g: &Progress) {
        self.take_cell(g);
        for (standing, boundary) in self.standing.iter_mut().zip(&self.c.boundaries) {
            standing.place(boundary, &self.c, g);
        }
    }

    /// Looks things up in the cell of `g`, if it deforms.
    fn take_cell(&mut self, g: &Progress) {
        if let Some(cell) = &g.cell {
            self.lattice = self.c.lattice.deformed(&cell.matrix);
            self.gradient = Some(cell.gradient);
        }
    }

    /// Moves the cell and all particles with it by a step, if it deforms.
    fn deform(&mut self, g: &mut Progress) -> Result<(), Failure> {
        let Some(cell) = &mut g.cell else { return Ok(()) };
        let (map, origin) = (cell.map(self.c.dt), self.lattice.origin);
        for b in &mut self.bodies {
            b.home = add(origin, mul(&map, sub(b.home, origin)));
            b.moved = mul(&map, b.moved);
        }
        cell.step(self.c.dt);
        self.take_cell(g);
        narrow_failure(&self.c, g, &self.lattice)
    }

    /// Accelerations of the present configuration, without a step.
    fn prime(&mut self) {
        let sums = self.sums(&self.contacts_now());
        let gravity = v3(self.c.spec.gravity);
        for (b, [f, t]) in self.bodies.iter_mut().zip(sums) {
            b.a = minus(plus(scaled(f, b.inv_mass), gravity), carried(self.gradient, b.v));
            b.alpha = scaled(t, b.inv_inertia());
        }
    }

    /// The contacts of the present configuration; memory stays as it is.
    fn contacts_now(&self) -> Vec<Contact> {
        let (mut contacts, dt) = (Vec::new(), 0.0);
        self.particle_contacts(dt, &mut contacts);
        self.surface_contacts(dt, &mut contacts);
        contacts
    }

    /// The contacts in a step `dt` \[s\], after which they are remembered.
    fn contacts_of_step(&mut self, dt: f64) -> Vec<Contact> {
        let mut contacts = Vec::new();
        self.pairs = self.particle_contacts(dt, &mut contacts);
        self.surfaces = self.surface_contacts(dt, &mut contacts);
        contacts
    }

    fn particle_contacts(&self, dt: f64, contacts: &mut Vec<Contact>) -> BTreeMap<[u32; 2], Vec<f64>> {
        let mut memory = BTreeMap::new();
        for (one, a) in self.bodies.iter().enumerate() {
            for (two, b) in self.bodies.iter().enumerate().skip(one + 1) {
                let ((i, a), (j, b)) = if a.id < b.id { ((one, a), (two, b)) } else { ((two, b), (one, a)) };
                let d = v3(self.between(a, b));
                let (sum, distance) = (a.radius + b.radius, dot(d, d).sqrt());
                if distance >= sum + self.c.range {
                    continue;
                }
                // The image moves with the cell.
                let flow = carried(self.gradient, d);
                let delta = sum - distance;
                let r_eff = a.radius * b.radius / sum;
                let meeting = Meeting {
                    n: scaled(d, 1.0 / distance),
                    delta,
                    arm: [a.radius - 0.5 * delta, b.radius - 0.5 * delta],
                    radius: [a.radius, b.radius],
                    inv_mass: [a.inv_mass, b.inv_mass],
                    inv_inertia: [a.inv_inertia(), b.inv_inertia()],
                    v: [a.v, plus(b.v, flow)],
                    w: [a.w, b.w],
                    r_eff,
                    diameter: 4.0 * r_eff,
                    lag: if self.c.spec.time.integrator.lags() { 0.5 * dt / distance } else { 0.0 },
                };
                let id = [a.id, b.id];
                let mut history =
                    self.pairs.get(&id).cloned().unwrap_or_else(|| vec![0.0; self.c.history.len()]);
                let pair = self.c.pair(a.material as usize, b.material as usize);
                let pull = meeting.pull(self.c.layout, pair, &mut history, dt);
                memory.insert(id, history);
                contacts.push(Contact { i, with: Partner::Particle(j), meeting, pull, arm: v3([0.0; 3]) });
            }
        }
        memory
    }

    fn surface_contacts(&self, dt: f64, contacts: &mut Vec<Contact>) -> BTreeMap<(u32, usize), Vec<Touched>> {
        let mut memory = BTreeMap::new();
        for (i, b) in self.bodies.iter().enumerate() {
            for boundary in (0..self.standing.len()).filter(|&k| self.standing[k].present) {
                let key = (b.id, boundary);
                let mut before = self.surfaces.get(&key).cloned().unwrap_or_default();
                let mut now: Vec<Touched> = Vec::new();
                for point in self.surface_points(b, boundary) {
                    let mut history =
                        take_nearest(&mut before, point.n).unwrap_or_else(|| vec![0.0; self.c.history.len()]);
                    let (meeting, arm) = self.on_surface(b, boundary, &point);
                    let pair = self.c.pair(b.material as usize, self.c.boundaries[boundary].material);
                    let pull = meeting.pull(self.c.layout, pair, &mut history, dt);
                    now.push((point.n, history));
                    let with = Partner::Surface { boundary, triangle: point.triangle as usize };
                    contacts.push(Contact { i, with, meeting, pull, arm });
                }
                if !now.is_empty() {
                    memory.insert(key, now);
                }
            }
        }
        memory
    }

    /// Sums over contacts of a sample.
    fn tensors(&self, contacts: &[Contact]) -> Tensors {
        let mut t = Tensors::default();
        let mut counts = vec![0_u32; self.bodies.len()];
        for contact in contacts {
            let m = &contact.meeting;
            let branch = scaled(m.n, m.arm[0] + m.arm[1]);
            t.add_contact(array(branch), array(contact.pull.force), contact.pull.stiffness);
            counts[contact.i] += 1;
            if let Partner::Particle(j) = contact.with {
                counts[j] += 1;
            }
        }
        for (b, n) in self.bodies.iter().zip(counts) {
            t.add_particle(1.0 / b.inv_mass, b.radius, array(b.v), n);
        }
        t
    }

    /// From the centre of `a` to that of the nearest image of `b` \[m\].
    fn between(&self, a: &Body, b: &Body) -> Vec3 {
        let d = add(sub(b.home, a.home), sub(b.moved, a.moved));
        let turns = self.lattice.periods(d).map(f64::round);
        sub(d, mul(&self.lattice.cell, turns))
    }

    /// The physical contacts of a particle, all its images together, with a boundary.
    fn surface_points(&self, b: &Body, boundary: usize) -> Vec<SurfacePoint> {
        let (shape, standing) = (&self.c.boundaries[boundary], &self.standing[boundary]);
        let (center, reach) = (b.inside(&self.lattice), b.radius + self.c.range);
        let mut facets = Vec::new();
        let count = match &shape.shape {
            BoundaryShape::Plane(_) => 0,
            BoundaryShape::Mesh(mesh, _) => mesh.triangles.len() as u32,
            BoundaryShape::Frustum(frustum) => frustum.parts(),
        };
        let span = Span::new(&self.c, &shape.shape, &standing.placed.pose);
        for shift in span.iter().flat_map(|span| span.images(&self.c, center, reach)) {
            facets.extend((0..count).map(|facet| (facet, shift)));
        }
        let mut points = Vec::new();
        standing.touches(&self.c, shape, center, reach, facets.into_iter(), &mut points);
        physical_contacts(&mut points, b.radius);
        points
    }

    /// The contact of `b` with a boundary, and the contact point from the origin of the boundary's frame.
    fn on_surface(&self, b: &Body, boundary: usize, p: &SurfacePoint) -> (Meeting, V3) {
        let placed = &self.standing[boundary].placed;
        let center = self.c.shifted(b.inside(&self.lattice), p.shift);
        let n = v3(p.n);
        let arm = plus(v3(sub(center, placed.pose.translation)), scaled(n, p.distance));
        let spin = v3(placed.spin);
        let meeting = Meeting {
            n,
            delta: b.radius - p.distance,
            arm: [p.distance, 0.0],
            radius: [b.radius, 0.0],
            inv_mass: [b.inv_mass, 0.0],
            inv_inertia: [b.inv_inertia(), 0.0],
            v: [b.v, plus(v3(placed.velocity), cross(spin, arm))],
            w: [b.w, spin],
            r_eff: b.radius,
            diameter: 2.0 * b.radius,
            lag: 0.0,
        };
        (meeting, arm)
    }

    /// Force and torque of the contacts on every particle.
    fn sums(&self, contacts: &[Contact]) -> Vec<[V3; 2]> {
        let mut sums = vec![[V3::default(); 2]; self.bodies.len()];
        for contact in contacts {
            let pull = &contact.pull;
            let [f, t] = &mut sums[contact.i];
            *f = plus(*f, pull.force);
            *t = plus(*t, pull.torque[0]);
            if let Partner::Particle(j) = contact.with {
                let [f, t] = &mut sums[j];
                *f = minus(*f, pull.force);
                *t = plus(*t, pull.torque[1]);
            }
        }
        sums
    }

    /// Moves all particles: with the force, or ahead of it.
    fn motion(&mut self, g: &mut Progress, kind: IntegratorKind, sums: Option<&[[V3; 2]]>) -> Moved {
        let c = self.c.clone();
        let (lattice, gradient) = (&self.lattice, self.gradient);
        let motion = Motion { c: &c, lattice, gradient, bodies: &mut self.bodies, sums, first: !g.primed };
        let moved = integrate::visit(kind, motion);
        g.ledger.work += moved.lifted;
        moved
    }

    /// Dissipation, surface forces and work of the step.
    fn account(&self, g: &mut Progress, contacts: &[Contact], moved: &Moved, split: bool) {
        let c = &self.c;
        let mut forces = vec![[0.0; 6]; c.spec.surfaces.len()];
        let ledger = &mut g.ledger;
        let before = std::mem::take(&mut ledger.elastic_tangential);
        ledger.stiffness_change += before;
        ledger.damping += moved.damped;
        for contact in contacts {
            let (m, pull) = (&contact.meeting, &contact.pull);
            ledger.friction += pull.tangential.friction_loss + pull.lost;
            ledger.elastic_tangential += pull.energy_tangential[0];
            ledger.stiffness_change -= pull.energy_tangential[1];
            // With mid-step velocities the change of kinetic energy is exact for a force held over the step.
            // Velocity Verlet's force acts around the velocity after it.
            let middle = |i: usize| {
                let b = &self.bodies[i];
                let half = |old: V3, new: V3| if split { new } else { scaled(plus(old, new), 0.5) };
                (half(moved.before[i].0, b.v), half(moved.before[i].1, b.w))
            };
            let (vi, wi) = middle(contact.i);
            let (vj, wj) = match contact.with {
                Partner::Particle(j) => {
                    let flow = carried(self.gradient, scaled(m.n, m.arm[0] + m.arm[1]));
                    ledger.work += c.dt * dot(pull.force, flow);
                    let (v, w) = middle(j);
                    (plus(v, flow), w)
                }
                Partner::Surface { boundary, .. } => {
                    if let Some(s) = c.boundaries[boundary].surface {
                        let f = scaled(pull.force, -1.0);
                        let t = plus(cross(contact.arm, f), pull.roll[1]);
                        for (sum, x) in forces[s].iter_mut().zip(array(f).into_iter().chain(array(t))) {
                            *sum += x;
                        }
                        ledger.work -= c.dt * (dot(f, m.v[1]) + dot(pull.roll[1], m.w[1]));
                    }
                    (m.v[1], m.w[1])
                }
            };
            if c.spec.sampling.energy_ledger {
                let u = relative_velocity(vi, vj, wi, wj, m.n, m.arm[0], m.arm[1]);
                ledger.dashpots -= c.dt * dot(pull.dash, u);
                ledger.rolling += pull.roll_lost - c.dt * (dot(pull.brake[0], wi) + dot(pull.brake[1], wj));
            }
        }
        let rubs: Vec<Rub> = contacts.iter().filter_map(|contact| self.rub(contact)).collect();
        g.rub(rubs.iter());
        g.bonds.broken += contacts.iter().filter(|contact| contact.pull.broke).count() as u64;
        g.account(c, &forces);
    }

    /// What a contact rubs off a surface that wears.
    fn rub(&self, contact: &Contact) -> Option<Rub> {
        let Partner::Surface { boundary, triangle } = contact.with else { return None };
        let (shape, standing) = (&self.c.boundaries[boundary], &self.standing[boundary]);
        let surface = shape.surface.filter(|s| self.c.wear_of(*s).is_some())?;
        let facet = shown(shape, standing, array(contact.arm), triangle as u32);
        let m = &contact.meeting;
        let u = relative_velocity(m.v[0], m.v[1], m.w[0], m.w[1], m.n, m.arm[0], m.arm[1]);
        let sliding = array(tangential_part(u, m.n));
        Some(Rub::new(surface, facet, array(contact.pull.force), array(m.n), sliding, self.c.dt))
    }

    /// Stops the world when particles overlap too much.
    fn guard(&self, g: &mut Progress, contacts: &[Contact]) -> Result<(), Failure> {
        let worst = contacts.iter().max_by(|a, b| a.depth().total_cmp(&b.depth()));
        let Some(worst) = worst.filter(|w| too_deep(&self.c, g, w.depth())) else { return Ok(()) };
        let other = match worst.with {
            Partner::Particle(j) => self.describe(j),
            Partner::Surface { boundary, .. } => quoted(&self.c, boundary),
        };
        Err(overlap_failure(&self.c, g, &self.describe(worst.i), &other, worst.depth()))
    }

    /// Stops the world when a particle runs away.
    fn check(&self, g: &Progress, moved: &Moved) -> Result<(), Failure> {
        match moved.runaway {
            None => Ok(()),
            Some(i) => Err(runaway_failure(&self.c, g, &self.describe(i), array(self.bodies[i].v))),
        }
    }

    fn describe(&self, i: usize) -> String {
        let b = &self.bodies[i];
        let pairs = self.pairs.keys().filter(|id| id.contains(&b.id));
        let mut touching: Vec<String> =
            pairs.map(|id| if id[0] == b.id { id[1] } else { id[0] }.to_string()).collect();
        touching.extend(self.surfaces.keys().filter(|k| k.0 == b.id).map(|k| quoted(&self.c, k.1)));
        b.portrait(&self.lattice).describe(touching)
    }

    /// Takes out and lists the particles outside the domain.
    fn release(&mut self, g: &mut Progress) {
        let c = self.c.clone();
        let side = |b: &Body| {
            let e = c.lattice.encode(b.x());
            outside(&c.lattice, e.hi, e.lo)
        };
        let sides: Vec<_> = self.bodies.iter().map(side).collect();
        if sides.iter().all(Option::is_none) {
            return;
        }
        self.stand(g);
        for contact in self.contacts_now() {
            let other = matches!(contact.with, Partner::Particle(j) if sides[j].is_some());
            if sides[contact.i].is_some() || other {
                unload(g, [contact.pull.energy_normal, contact.pull.energy_tangential[1]]);
            }
        }
        let mut left: Vec<_> = self
            .bodies
            .iter()
            .zip(&sides)
            .filter_map(|(b, side)| Some((b.portrait(&self.lattice), (*side)?)))
            .collect();
        left.sort_unstable_by_key(|(p, _)| p.id);
        for (p, side) in left {
            p.leave(&c, side, g);
            self.bodies.retain(|b| b.id != p.id);
            self.pairs.retain(|id, _| !id.contains(&p.id));
            self.surfaces.retain(|key, _| key.0 != p.id);
        }
    }
}

impl Contact {
    /// Overlap as a fraction of the smaller radius.
    fn depth(&self) -> f64 {
        let [i, j] = self.meeting.radius;
        self.meeting.delta / if j > 0.0 { i.min(j) } else { i }
    }
}

/// `U x`, or nothing where the cell does not deform.
fn carried(gradient: Option<Vec3x3>, x: V3) -> V3 {
    gradient.map_or(V3::default(), |u| v3(mul(&u, array(x))))
}

/// The memory of the contact whose normal was nearest to `n`, taken out; none if all were far off.
fn take_nearest(before: &mut Vec<Touched>, n: Vec3) -> Option<Vec<f64>> {
    let cosine = |t: &Touched| crate::lattice::dot(t.0, n);
    let nearest = (0..before.len()).max_by(|&a, &b| cosine(&before[a]).total_cmp(&cosine(&before[b])))?;
    (cosine(&before[nearest]) > 0.5).then(|| before.swap_remove(nearest).1)
}

fn v3([x, y, z]: Vec3) -> V3 {
    V3 { x, y, z }
}

fn array(v: V3) -> Vec3 {
    [v.x, v.y, v.z]
}

fn wide(v: [f32; 3]) -> V3 {
    v3(v.map(f64::from))
}

fn narrow(v: V3) -> [f32; 3] {
    array(v).map(|x| x as f32)
}
