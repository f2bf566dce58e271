//! Sources and sinks: particles that come into a running world through inlets and leave it through outlets.
//!
//! Both act at rows of the series, on the state that a backend gives and takes back: outlets first, then inlets. What
//! comes in is a function of the world's seed, of the inlet and of how many came before, so runs repeat, and go on
//! from checkpoints, bit for bit. Particles keep their numbers, and new ones get the next; what contacts of the others
//! remember stays as it is.

mod ahead;
mod faces;

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use crate::backend::common::Portrait;
use crate::batch::positions;
use crate::failure::SetupError;
use crate::generate::{Purpose, Rng, SizeDistribution, solid_volume};
use crate::lattice::{add, cross, dot, norm, scale, sub};
use crate::setup::{BoundaryShape, Constants};
use crate::spec::{MaterialId, Shape, Side, Vec3, WorldSpec};
use crate::state::{Place, Progress, Spin, State, Velocity};
use crate::surface::{Span, rotate};

/// Places that are tried for a particle before it waits for the next time.
const TRIALS: usize = 200;

/// A source of particles.
#[derive(Clone, Debug, PartialEq)]
pub struct Inlet {
    /// Its name in output.
    pub name: String,
    /// Where they are put, as far as they reach, at random places where there is room.
    pub room: Room,
    /// What comes, and how fast.
    pub supply: Supply,
    /// Velocity of what comes \[m/s\].
    pub velocity: Vec3,
    /// It stops when so much mass has come \[kg\].
    pub most: Option<f64>,
    /// Time between two acts \[s\]; rounded to whole rows of the series.
    pub every: f64,
    /// Stages in which it acts; all if absent.
    pub stages: Option<Vec<usize>>,
}

/// What comes through an inlet.
#[derive(Clone, Debug, PartialEq)]
pub enum Supply {
    /// Mass per time \[kg/s\].
    Mass(f64, Grains),
    /// Particles per time \[1/s\].
    Number(f64, Grains),
    /// What leaves through an outlet (index into [`WorldSpec::outlets`]), as it is.
    Outlet(usize),
}

/// What new particles are.
#[derive(Clone, Debug, PartialEq)]
pub struct Grains {
    /// Their material.
    pub material: MaterialId,
    /// Their radii, each drawn by itself.
    pub sizes: SizeDistribution,
}

/// A sink: takes away particles whose centre is in its room.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlet {
    /// Its name in output.
    pub name: String,
    /// Where it takes them.
    pub room: Room,
    /// Time between two acts \[s\]; rounded to whole rows of the series.
    pub every: f64,
    /// Stages in which it acts; all if absent.
    pub stages: Option<Vec<usize>>,
}

/// A part of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Room {
    /// An axis-aligned box.
    Box {
        /// Least corner \[m\].
        min: Vec3,
        /// Largest corner \[m\].
        max: Vec3,
    },
    /// A cylinder.
    Cylinder {
        /// Where its axis begins \[m\].
        from: Vec3,
        /// Where it ends \[m\].
        to: Vec3,
        /// \[m\]
        radius: f64,
    },
    /// A sphere.
    Sphere {
        /// \[m\]
        center: Vec3,
        /// \[m\]
        radius: f64,
    },
    /// The half-space `x · axis > limit`; for outlets only.
    Beyond {
        /// Unit vector.
        axis: Vec3,
        /// \[m\]
        limit: f64,
    },
    /// The faces of a mesh (index into [`WorldSpec::surfaces`]), on the side of their normals; for inlets only. Faces count
    /// where they stand, whether the mesh is there or waits.
    Surface(usize),
}

/// What has gone through an inlet or outlet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Flow {
    /// Particles since the start.
    pub particles: u64,
    /// Their mass \[kg\].
    pub mass: f64,
    /// Mass since the last row of the series \[kg\].
    pub recent: f64,
}

impl Flow {
    fn count(&mut self, mass: f64) {
        self.particles += 1;
        self.mass += mass;
        self.recent += mass;
    }
}

/// An inlet under way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InletState {
    /// What has come.
    pub flow: Flow,
    /// New particles among them.
    pub made: u64,
    /// Mass \[kg\] or number that should have come and has not.
    pub owed: f64,
    /// Step up to which that is counted.
    pub since: u64,
    /// What an outlet took and has not come yet, in its order.
    pub queue: Vec<Waiting>,
}

/// A particle that waits outside of the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Waiting {
    /// Its number.
    pub id: u32,
    /// \[m\]
    pub radius: f32,
    /// Inverse mass \[1/kg\].
    pub inv_mass: f32,
    /// Index into the world's materials.
    pub material: u32,
}

impl Supply {
    /// What new particles are, if it makes any.
    pub fn grains(&self) -> Option<&Grains> {
        match self {
            Self::Mass(_, grains) | Self::Number(_, grains) => Some(grains),
            Self::Outlet(_) => None,
        }
    }
}

impl Room {
    /// Whether a point is in it.
    pub fn contains(&self, x: Vec3) -> bool {
        match *self {
            Self::Box { min, max } => (0..3).all(|k| (min[k]..=max[k]).contains(&x[k])),
            Self::Cylinder { from, to, radius } => {
                let (axis, length) = axis(from, to);
                let along = dot(sub(x, from), axis);
                (0.0..=length).contains(&along) && norm(sub(sub(x, from), scale(axis, along))) <= radius
            }
            Self::Sphere { center, radius } => norm(sub(x, center)) <= radius,
            Self::Beyond { axis, limit } => dot(x, axis) > limit,
            Self::Surface(_) => false,
        }
    }

    /// A box around it, if it ends anywhere \[m\].
    fn bounds(&self) -> Option<[Vec3; 2]> {
        match *self {
            Self::Box { min, max } => Some([min, max]),
            Self::Cylinder { from, to, radius } => {
                let (axis, _) = axis(from, to);
                let side = axis.map(|a| radius * (1.0 - a * a).max(0.0).sqrt());
                let end =
                    |f: fn(f64, f64) -> f64, sign: f64| [0, 1, 2].map(|k| f(from[k], to[k]) + sign * side[k]);
                Some([end(f64::min, -1.0), end(f64::max, 1.0)])
            }
            Self::Sphere { center, radius } => Some([-radius, radius].map(|r| center.map(|x| x + r))),
            Self::Beyond { .. } | Self::Surface(_) => None,
        }
    }

    /// The radius of a sphere that just fits \[m\].
    fn fits(&self) -> f64 {
        match *self {
            Self::Box { min, max } => 0.5 * (0..3).map(|k| max[k] - min[k]).fold(f64::INFINITY, f64::min),
            Self::Cylinder { from, to, radius } => radius.min(0.5 * norm(sub(to, from))),
            Self::Sphere { radius, .. } => radius,
            Self::Beyond { .. } | Self::Surface(_) => f64::INFINITY,
        }
    }

    /// A random centre of a sphere that lies in it; `wraps` tells axes along which its ends meet.
    fn draw(&self, radius: f64, wraps: [bool; 3], rng: &mut Rng) -> Vec3 {
        match *self {
            Self::Box { min, max } => [0, 1, 2].map(|k| {
                let inset = if wraps[k] { 0.0 } else { radius };
                rng.between(min[k] + inset, (max[k] - inset).max(min[k] + inset))
            }),
            Self::Cylinder { from, to, radius: shell } => {
                let (axis, length) = axis(from, to);
                let aside = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
                let u = cross(axis, aside);
                let u = scale(u, 1.0 / norm(u));
                let w = cross(axis, u);
                let free = (shell - radius).max(0.0);
                let [a, b, _] = in_ball(rng, free, |x| [x[0], x[1], 0.0]);
                let along = rng.between(radius, (length - radius).max(radius));
                add(from, add(scale(axis, along), add(scale(u, a), scale(w, b))))
            }
            Self::Sphere { center, radius: shell } => {
                add(center, in_ball(rng, (shell - radius).max(0.0), |x| x))
            }
            Self::Beyond { .. } | Self::Surface(_) => [0.0; 3],
        }
    }
}

/// A random point of the unit ball, or of the disc that `onto` makes of it, times a radius.
fn in_ball(rng: &mut Rng, radius: f64, onto: impl Fn(Vec3) -> Vec3) -> Vec3 {
    loop {
        let x = onto([0; 3].map(|_| rng.between(-1.0, 1.0)));
        if dot(x, x) <= 1.0 {
            return scale(x, radius);
        }
    }
}

fn axis(from: Vec3, to: Vec3) -> (Vec3, f64) {
    let d = sub(to, from);
    let length = norm(d);
    (scale(d, 1.0 / length), length)
}

fn in_stage(stages: Option<&Vec<usize>>, stage: usize) -> bool {
    stages.is_none_or(|stages| stages.contains(&stage))
}

impl Constants {
    /// Particles in a world: those of the start and those that came, without those that left.
    pub(crate) fn count_now(&self, g: &Progress) -> usize {
        let trimmed: u64 = g.results.iter().map(|r| r.trimmed).sum::<u64>() + g.trimmed;
        let came: u64 = g.inlets.iter().map(|inlet| inlet.flow.particles).sum();
        let left: u64 = g.outlets.iter().map(|flow| flow.particles).sum();
        self.count + came as usize - left as usize - trimmed as usize - g.lost.len()
    }

    /// Numbers that particles have had so far.
    pub(crate) fn numbers(&self, g: &Progress) -> u64 {
        self.count as u64 + g.inlets.iter().map(|inlet| inlet.made).sum::<u64>()
    }

    /// Counts what inlets owe up to now.
    pub(crate) fn accrue(&self, g: &mut Progress) {
        let (step, stage) = (g.step, g.stage);
        for (inlet, state) in self.spec.inlets.iter().zip(&mut g.inlets) {
            let time = (step - state.since) as f64 * self.dt;
            let open = inlet.most.is_none_or(|most| state.flow.mass < most);
            if let Supply::Mass(rate, _) | Supply::Number(rate, _) = &inlet.supply
                && in_stage(inlet.stages.as_ref(), stage)
                && open
            {
                state.owed += rate * time;
            }
            state.since = step;
        }
    }

    /// Whether an inlet or outlet acts at this step; one that has nothing to bring does not.
    pub(crate) fn exchanges(&self, g: &Progress) -> bool {
        let outlets = (0..self.spec.outlets.len()).any(|i| self.takes(i, g));
        outlets || (0..self.spec.inlets.len()).any(|i| self.brings(i, g) && self.next(i, g).is_some())
    }

    fn takes(&self, i: usize, g: &Progress) -> bool {
        let outlet = &self.spec.outlets[i];
        g.step.is_multiple_of(self.whole_rows(outlet.every)) && in_stage(outlet.stages.as_ref(), g.stage)
    }

    fn brings(&self, i: usize, g: &Progress) -> bool {
        let inlet = &self.spec.inlets[i];
        g.step.is_multiple_of(self.whole_rows(inlet.every)) && in_stage(inlet.stages.as_ref(), g.stage)
    }

    /// The particle that an inlet owes now, if any.
    fn next(&self, i: usize, g: &Progress) -> Option<Waiting> {
        let (inlet, state) = (&self.spec.inlets[i], &g.inlets[i]);
        if inlet.most.is_some_and(|most| state.flow.mass >= most) {
            return None;
        }
        let Some(grains) = inlet.supply.grains() else { return state.queue.first().copied() };
        let mut rng = Rng::of(self.spec.seed, Purpose::InletSizes, [i as u64, state.made]);
        // The distribution was checked; a radius that it cannot give is none that is owed.
        let radius = grains.sizes.draw(&mut rng).ok()?;
        let mass = solid_volume(&[radius]) * self.spec.materials[grains.material].density;
        let due = match inlet.supply {
            Supply::Mass(..) => mass,
            _ => 1.0,
        };
        // Numbers of particles are of 32 bits, the largest for no particle.
        let id = u32::try_from(self.numbers(g)).ok().filter(|id| *id < u32::MAX)?;
        (state.owed >= due).then_some(Waiting {
            id,
            radius: radius as f32,
            inv_mass: (1.0 / mass) as f32,
            material: grains.material as u32,
        })
    }

    /// Takes away and brings what is due; returns the energy that came in \[J\], and whether anything changed.
    pub(crate) fn exchange(&self, state: &mut State) -> (f64, bool) {
        let taken = self.take(state);
        let mut entered = 0.0;
        let mut brought = false;
        for i in 0..self.spec.inlets.len() {
            if !self.brings(i, &state.progress) {
                continue;
            }
            let before = state.particles.len();
            entered += self.bring(i, state);
            brought |= state.particles.len() > before;
        }
        (entered, taken || brought)
    }

    fn take(&self, state: &mut State) -> bool {
        let mut any = false;
        for i in 0..self.spec.outlets.len() {
            if !self.takes(i, &state.progress) {
                continue;
            }
            let room = &self.spec.outlets[i].room;
            let keep: Vec<bool> = positions(self, state).iter().map(|x| !room.contains(*x)).collect();
            // In the order of their numbers, whatever the order of storage.
            let p = &state.particles;
            let mut gone: Vec<Waiting> = (0..p.len())
                .filter(|k| !keep[*k])
                .map(|k| Waiting {
                    id: p.id[k],
                    radius: p.place[k].radius,
                    inv_mass: p.velocity[k].inv_mass,
                    material: p.spin[k].material,
                })
                .collect();
            if gone.is_empty() {
                continue;
            }
            any = true;
            gone.sort_unstable_by_key(|particle| particle.id);
            let g = &mut state.progress;
            for particle in &gone {
                g.outlets[i].count(1.0 / f64::from(particle.inv_mass));
            }
            let back = self.spec.inlets.iter().position(|inlet| inlet.supply == Supply::Outlet(i));
            if let Some(back) = back {
                g.inlets[back].queue.extend(gone);
            }
            state.remove(&keep);
        }
        any
    }

    /// Brings what inlet `i` owes, as long as there is room; returns its energy \[J\].
    fn bring(&self, i: usize, state: &mut State) -> f64 {
        let inlet = &self.spec.inlets[i];
        let faces = match inlet.room {
            Room::Surface(s) => self.faces(s, &state.progress),
            _ => None,
        };
        let bounds = faces.as_ref().map_or_else(|| inlet.room.bounds(), |f| Some(f.bounds(self.radius_max)));
        let Some(bounds) = bounds else { return 0.0 };
        let mut rng = Rng::of(self.spec.seed, Purpose::InletPlaces, [i as u64, state.progress.step]);
        let domain = &self.spec.domain;
        let wraps = [0, 1, 2].map(|k| {
            let edge = domain.origin[k] + domain.cell[k][k];
            domain.sides[k][0] == Side::Periodic && bounds[0][k] <= domain.origin[k] && bounds[1][k] >= edge
        });
        let mut crowd = Crowd::new(self, bounds);
        for (x, place) in positions(self, state).into_iter().zip(&state.particles.place) {
            crowd.add(x, f64::from(place.radius));
        }
        let mut entered = 0.0;
        while let Some(next) = self.next(i, &state.progress) {
            let radius = f64::from(next.radius);
            let free = |x: &Vec3| crowd.free(*x, radius) && !self.meets_surface(&state.progress, *x, radius);
            let draw = |_| match &faces {
                Some(faces) => faces.draw(radius, &mut rng),
                None => inlet.room.draw(radius, wraps, &mut rng),
            };
            let found = (0..TRIALS).map(draw).find(|x| self.holds(x, radius) && free(x));
            let Some(x) = found else { break };
            crowd.add(x, radius);
            entered += self.push(state, &next, x, inlet.velocity);
            let came = &mut state.progress.inlets[i];
            let mass = 1.0 / f64::from(next.inv_mass);
            came.flow.count(mass);
            match inlet.supply {
                Supply::Mass(..) => came.owed -= mass,
                Supply::Number(..) => came.owed -= 1.0,
                Supply::Outlet(_) => drop(came.queue.remove(0)),
            }
            came.made += u64::from(inlet.supply.grains().is_some());
        }
        entered
    }

    /// Whether a sphere is within the sides of the domain that are not periodic.
    fn holds(&self, x: &Vec3, radius: f64) -> bool {
        let domain = &self.spec.domain;
        (0..3).filter(|&k| domain.sides[k][0] != Side::Periodic).all(|k| {
            let low = domain.origin[k];
            // What fills a region to its last digit is in it.
            let slack = 1e-9 * domain.cell[k][k];
            x[k] - radius >= low - slack && x[k] + radius <= low + domain.cell[k][k] + slack
        })
    }

    /// Adds a particle; returns its energy \[J\].
    fn push(&self, state: &mut State, new: &Waiting, x: Vec3, v: Vec3) -> f64 {
        let lattice = self.lattice_now(&state.progress);
        let e = lattice.encode(x);
        let p = &mut state.particles;
        p.id.push(new.id);
        p.place.push(Place { lo: e.lo, radius: new.radius });
        p.velocity.push(Velocity { v: v.map(|x| x as f32), inv_mass: new.inv_mass });
        p.spin.push(Spin { w: [0.0; 3], material: new.material });
        p.hi.push(e.hi);
        p.rest.push(e.rest);
        p.hi_ref.push(e.hi);
        p.lo_ref.push(e.lo);
        p.acceleration.push([0.0; 3]);
        p.angular.push([0.0; 3]);
        p.force.push([0.0; 3]);
        Portrait::of(&lattice, p, p.len() - 1).energy(self).iter().sum()
    }

    /// Whether a sphere would touch a surface that is there.
    fn meets_surface(&self, g: &Progress, at: Vec3, radius: f64) -> bool {
        let mut near = Vec::new();
        self.boundaries.iter().any(|b| {
            let pose = match b.surface {
                Some(s) if !g.surfaces[s].present => return false,
                Some(s) => g.surfaces[s].placed(self, s, g).pose,
                None => b.pose,
            };
            if let BoundaryShape::Plane(normal) = &b.shape {
                return dot(rotate(pose.rotation, *normal), sub(at, pose.translation)) < radius;
            }
            Span::new(self, &b.shape, &pose)
                .is_some_and(|span| b.touched(self, &pose, &span, at, radius, &mut near))
        })
    }
}

/// Spheres near a box, so that those that a new one would meet are found.
struct Crowd<'a> {
    c: &'a Constants,
    bounds: [Vec3; 2],
    edge: f64,
    cells: HashMap<[i64; 3], Vec<(Vec3, f64)>>,
}

impl<'a> Crowd<'a> {
    fn new(c: &'a Constants, bounds: [Vec3; 2]) -> Self {
        Self { c, bounds, edge: 2.0 * c.radius_max, cells: HashMap::new() }
    }

    fn cell(&self, x: Vec3) -> [i64; 3] {
        x.map(|x| (x / self.edge).floor() as i64)
    }

    fn add(&mut self, x: Vec3, radius: f64) {
        let turns = self.c.lattice.periodic.map(|periodic| if periodic { -1..=1 } else { 0..=0 });
        let reach = radius + self.c.radius_max;
        for a in turns[0].clone() {
            for b in turns[1].clone() {
                for c in turns[2].clone() {
                    let x = self.c.shifted(x, [a, b, c]);
                    let [low, high] = self.bounds;
                    if (0..3).all(|k| x[k] > low[k] - reach && x[k] < high[k] + reach) {
                        self.cells.entry(self.cell(x)).or_default().push((x, radius));
                    }
                }
            }
        }
    }

    fn free(&self, x: Vec3, radius: f64) -> bool {
        let cell = self.cell(x);
        let offsets = (0..27).map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1]);
        let mut near =
            offsets.filter_map(|d: [i64; 3]| self.cells.get(&[0, 1, 2].map(|k| cell[k] + d[k]))).flatten();
        near.all(|(y, r)| norm(sub(x, *y)) >= radius + r)
    }
}

/// Refuses inlets and outlets that cannot work.
pub(crate) fn check(spec: &WorldSpec) -> Result<(), SetupError> {
    let rooms = spec.outlets.iter().map(|o| ("outlet", &o.name, &o.room, o.every, &o.stages));
    let all = spec.inlets.iter().map(|i| ("inlet", &i.name, &i.room, i.every, &i.stages)).chain(rooms);
    for (kind, name, room, every, stages) in all {
        let bad = |why| Err(SetupError::Door { name: name.to_owned(), why });
        if kind == "outlet" && matches!(room, Room::Surface(_)) {
            return bad(format!("the outlet `{name}` is on a surface; give it a part of space"));
        }
        let numbers = room.bounds().into_iter().flatten().flatten().chain([room.fits(), every]);
        let mut finite = numbers.filter(|x| *x != f64::INFINITY);
        if !(room.fits() > 0.0 && every > 0.0 && finite.all(f64::is_finite)) {
            return bad(format!("the {kind} `{name}` has a region without extent, or no interval above 0"));
        }
        if stages.iter().flatten().any(|stage| *stage >= spec.stages.len()) {
            return bad(format!("the {kind} `{name}` names a stage that does not exist"));
        }
        if spec.stages.iter().any(|stage| stage.deformation.is_some()) {
            return bad(format!("the {kind} `{name}` is in a cell that deforms; leave one of them out"));
        }
    }
    for (i, inlet) in spec.inlets.iter().enumerate() {
        let name = &inlet.name;
        let bad = |why| Err(SetupError::Door { name: name.clone(), why });
        if let Room::Surface(s) = inlet.room {
            let surface = spec.surfaces.get(s);
            if !surface.is_some_and(|surface| matches!(surface.shape, Shape::Mesh(_))) {
                let why = format!(
                    "the inlet `{name}` is on a surface that is no mesh; planes, cylinders and cones have no faces that \
                     particles could come off: take a mesh, or a region beside it"
                );
                return bad(why);
            }
        }
        // Faces may move; what comes off them beyond the domain finds no room.
        let everywhere = [spec.domain.origin; 2];
        let on_faces = matches!(inlet.room, Room::Surface(_)).then_some(everywhere);
        let Some(bounds) = inlet.room.bounds().or(on_faces) else {
            return bad(format!("the inlet `{name}` has no end; give it a box, a cylinder or a sphere"));
        };
        for (k, axis) in ['x', 'y', 'z'].into_iter().enumerate() {
            let [low, high] = [spec.domain.origin[k], spec.domain.origin[k] + spec.domain.cell[k][k]];
            if bounds[0][k] < low || bounds[1][k] > high {
                return bad(format!(
                    "the inlet `{name}` goes from {} to {} m along {axis}, beyond the domain of {low} to {high} m; \
                     shrink it or enlarge the domain",
                    bounds[0][k], bounds[1][k]
                ));
            }
        }
        let most = match &inlet.supply {
            Supply::Mass(rate, grains) | Supply::Number(rate, grains) => {
                if !(rate.is_finite() && *rate > 0.0) || grains.material >= spec.materials.len() {
                    return bad(format!("the inlet `{name}` has no rate above 0, or no such material"));
                }
                if let Err(error) = grains.sizes.sample(1, 0) {
                    return bad(format!("the sizes of the inlet `{name}` cannot be drawn: {error}"));
                }
                grains.sizes.limits().1
            }
            Supply::Outlet(outlet) => {
                let shared = spec.inlets[..i].iter().any(|other| other.supply == Supply::Outlet(*outlet));
                if *outlet >= spec.outlets.len() || shared {
                    return bad(format!(
                        "the inlet `{name}` is fed by an outlet that does not exist, or feeds another inlet"
                    ));
                }
                spec.particles.radius.iter().copied().fold(0.0, f64::max)
            }
        };
        let room = inlet.room.fits();
        if most > room * (1.0 + 1e-9) {
            return bad(format!(
                "a sphere of {most} m does not fit into the region of the inlet `{name}`, which has room for {room} m; \
                 enlarge it, or take smaller particles"
            ));
        }
        if inlet.velocity.iter().any(|x| !x.is_finite()) || inlet.most.is_some_and(f64::is_nan) {
            return bad(format!("the inlet `{name}` has a velocity or a mass that is no number"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
