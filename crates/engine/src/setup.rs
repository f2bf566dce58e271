//! From a specification to what kernels look up: checked, prepared and encoded.

use std::sync::Arc;

use glebe_physics as physics;
use glebe_physics::{Impact, Laws, Layout, PairCoefficients, PairLaws, PairOverride, PairProperties, Slot};

use crate::bonds;
use crate::cell::{self, Cell};
use crate::exchange::{self, Flow, InletState};
use crate::failure::SetupError;
use crate::lattice::{Lattice, Vec3x3, add, cross, dot, mul, norm, scale, sub};
use crate::spec::{
    Action, Class, Component, Frustum, Motion, ParticleSet, Pose, Shape, Side, Stage, Step, Surface,
    Surveyed, TriMesh, Vec3, WorldSpec,
};
use crate::speed;
use crate::state::{MeasureState, Particles, Place, Progress, Spin, State, SurfaceState, Velocity};
use crate::surface::{Bvh, Span, rotate, touch};

/// Largest skin as a share of the mean radius; lists widen their reach up to it when particles move fast.
pub const SKIN_MAX: f64 = 1.0;
/// Most floats that laws may remember per contact.
pub const MEMORY: usize = 12;
/// Smallest skin as a share of the mean radius: below it rebuilds cost more than candidates.
pub const SKIN_MIN: f64 = 0.04;
/// What a rebuild widens the skin by where the last one was soon before; each backend knows what is soon to it.
pub const SKIN_WIDER: f64 = 1.25;
/// Skin that a world starts with, as a share of the mean radius.
pub const SKIN_START: f64 = 0.3;
/// Most particle sizes a list level spans: radii within a level differ at most by this factor.
pub const LEVEL_RATIO: f64 = 2.0;

/// Most samples of a Lacey index; each takes 16 bytes.
const MOST_SAMPLES: usize = 10_000_000;
/// Names of the axes in messages.
const AXES: [char; 3] = ['x', 'y', 'z'];
/// Most periods that a mesh may be long: beyond, a file in the wrong unit is likelier than a tool.
const PERIODS_MAX: f64 = 100.0;
/// Largest sine of the angle between a plane and a periodic axis that counts as parallel: rounding.
const PARALLEL: f64 = 1e-9;

/// A surface as kernels see it: those of the specification, then the domain's walls.
#[derive(Clone, Debug)]
pub struct Boundary {
    /// Name.
    pub name: String,
    /// Material.
    pub material: usize,
    /// Shape.
    pub shape: BoundaryShape,
    /// Index in the specification; `None` for the domain's walls.
    pub surface: Option<usize>,
    /// Pose of the domain's walls.
    pub pose: Pose,
}

/// The shape of a boundary.
#[derive(Clone, Debug)]
pub enum BoundaryShape {
    /// A plane through the frame's origin; particles are on the side of the unit normal.
    Plane(Vec3),
    /// A mesh with its hierarchy.
    Mesh(Arc<TriMesh>, Bvh),
    /// A cylinder or a cone.
    Frustum(Frustum),
}

impl Boundary {
    /// Whether a sphere, or an image of it, comes within `reach` \[m\] of the mesh or shell in `pose`, around which
    /// `span` is; never of a plane. `near` is memory to work with.
    pub(crate) fn touched(
        &self,
        c: &Constants,
        pose: &Pose,
        span: &Span,
        at: Vec3,
        reach: f64,
        near: &mut Vec<u32>,
    ) -> bool {
        let mut touches = |shift: [i32; 3]| {
            let x = pose.inverse(c.shifted(at, shift));
            match &self.shape {
                BoundaryShape::Plane(_) => false,
                BoundaryShape::Mesh(mesh, bvh) => {
                    near.clear();
                    bvh.near(x, reach, near);
                    near.iter().any(|&t| {
                        let corners = mesh.triangles[t as usize];
                        let vertices = corners.map(|v| sub(mesh.vertices[v as usize], x));
                        touch(vertices, t, shift, reach).is_some()
                    })
                }
                BoundaryShape::Frustum(frustum) => (0..frustum.parts())
                    .any(|part| frustum.touch(frustum.axis, x, part, shift, reach).is_some()),
            }
        };
        span.images(c, at, reach).any(&mut touches)
    }
}

impl BoundaryShape {
    /// The corners of a box around it in its frame; `None` for a plane and for a mesh without triangles.
    pub fn corners(&self) -> Option<[Vec3; 8]> {
        match self {
            Self::Plane(_) => None,
            Self::Mesh(_, bvh) => bvh.corners(),
            Self::Frustum(frustum) => Some(frustum.corners()),
        }
    }

    /// The triangles that frames show of it; 1 for a plane.
    pub fn triangles(&self) -> usize {
        match self {
            Self::Plane(_) => 1,
            Self::Mesh(mesh, _) => mesh.triangles.len(),
            Self::Frustum(frustum) => frustum.triangles(),
        }
    }
}

/// What limits the time step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepLimits {
    /// Rayleigh time of the smallest particle \[s\]; infinite where stiffness is not the materials'.
    pub rayleigh: f64,
    /// Shortest elastic impact \[s\].
    pub collision: f64,
    /// What `auto` takes \[s\].
    pub advised: f64,
}

/// Everything about a world that does not change while it runs.
#[derive(Debug)]
pub struct Constants {
    /// The specification, particles emptied into the state.
    pub spec: WorldSpec,
    /// Where the floats that contacts remember stand.
    pub layout: Layout,
    /// Sign of each remembered float when two bodies change roles.
    pub history: Vec<f32>,
    /// Time step \[s\].
    pub dt: f64,
    /// What limits it.
    pub limits: StepLimits,
    /// Positions.
    pub lattice: Lattice,
    /// Coefficients of pair (a, b) at `a * materials + b`.
    pub pairs: Vec<PairCoefficients>,
    /// Surfaces and walls.
    pub boundaries: Vec<Boundary>,
    /// Number of particles at the start.
    pub count: usize,
    /// Least radius \[m\].
    pub radius_min: f64,
    /// Largest radius \[m\].
    pub radius_max: f64,
    /// Mean radius \[m\].
    pub radius_mean: f64,
    /// Mean density of the particles at the start \[kg/m³\].
    pub density_mean: f64,
    /// Interaction distance beyond touch \[m\].
    pub range: f64,
    /// Steps between two acts of the servo of a cell, by stage; 0 where it does not deform.
    pub control_steps: Vec<u64>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Constants {
    /// Coefficients of a pair of materials.
    pub fn pair(&self, a: usize, b: usize) -> &PairCoefficients {
        &self.pairs[a * self.spec.materials.len() + b]
    }
    /// The motion of surface `s` in stage `stage`.
    pub fn motion(&self, s: usize, stage: usize) -> &Motion {
        let moves = self.spec.stages.get(stage).map_or(&[][..], |st| &st.moves);
        moves.iter().find(|(k, _)| *k == s).map_or(&self.spec.surfaces[s].motion, |(_, m)| m)
    }
    /// Whether particles may be bonded.
    pub fn bonds(&self) -> bool {
        !self.layout.place(Slot::Bond).is_empty()
    }
    /// Whether any surface moves in any stage.
    pub fn moves(&self) -> bool {
        let own = self.spec.surfaces.iter().map(|s| &s.motion);
        let of_stages = self.spec.stages.iter().flat_map(|stage| stage.moves.iter().map(|(_, m)| m));
        own.chain(of_stages).any(|motion| !motion.is_fixed())
    }
    /// A position moved by whole periods.
    #[inline]
    pub fn shifted(&self, x: Vec3, shift: [i32; 3]) -> Vec3 {
        if shift == [0; 3] { x } else { add(x, mul(&self.spec.domain.cell, shift.map(f64::from))) }
    }
    /// Steps between two rows of the series.
    pub fn sample_steps(&self) -> u64 {
        (self.spec.sampling.series / self.dt).round().max(1.0) as u64
    }
    /// Steps in an interval of time \[s\] that ends at rows of the series, at least one row.
    pub fn whole_rows(&self, interval: f64) -> u64 {
        let rows = self.sample_steps();
        rows * (interval / (rows as f64 * self.dt)).round().max(1.0) as u64
    }
    /// Whether the cell deforms in any stage.
    pub fn deforms(&self) -> bool {
        self.spec.stages.iter().any(|stage| stage.deformation.is_some())
    }
    /// The cell matrix \[m\] and the strain since the start \[-\].
    pub fn cell(&self, g: &Progress) -> (Vec3x3, Vec3x3) {
        g.cell.map_or((self.spec.domain.cell, [[0.0; 3]; 3]), |cell| (cell.matrix, cell.strain))
    }
    /// Positions in the cell as it is.
    pub fn lattice_now(&self, g: &Progress) -> Lattice {
        g.cell.map_or_else(|| self.lattice.clone(), |cell| self.lattice.deformed(&cell.matrix))
    }
    /// Positions in the cell as it was when lists were made.
    pub fn lattice_then(&self, g: &Progress) -> Lattice {
        g.cell.map_or_else(|| self.lattice.clone(), |cell| self.lattice.deformed(&cell.reference))
    }
    /// Largest distance at which two particles may touch \[m\].
    pub fn touch(&self) -> f64 {
        2.0 * self.radius_max + self.range
    }
    /// Whether the world is a sample: periodic along all axes, without surfaces. Its stress and fabric are measured.
    pub fn is_sample(&self) -> bool {
        self.lattice.periodic == [true; 3] && self.boundaries.is_empty()
    }
    /// A distance \[m\] across an axis, in periods.
    pub fn periods_high(&self, axis: usize, distance: f64) -> f64 {
        distance / (self.lattice.height[axis] * f64::from(self.lattice.windows[axis]))
    }
    /// What gravity does on a unit of mass over a period of each axis, 0 along axes that do not wrap \[J/kg\]: so
    /// much potential energy a particle gains at once that falls through a seam, as the work of the seam.
    pub fn fall(&self) -> Vec3 {
        let along = |k: usize| dot(self.spec.gravity, self.spec.domain.cell.map(|row| row[k]));
        [0, 1, 2].map(|k| if self.lattice.periodic[k] { along(k) } else { 0.0 })
    }
    /// Longest reach of a neighbour list \[m\].
    pub fn cutoff(&self) -> f64 {
        self.touch() + SKIN_MAX * self.radius_mean
    }
}

/// Checks and prepares a world.
pub fn prepare(mut spec: WorldSpec) -> Result<(Arc<Constants>, State), SetupError> {
    // Also where every pair has laws of its own.
    Laws::resolve(&spec.contact)?;
    check_materials(&spec)?;
    check_particles(&spec)?;
    check_references(&spec)?;
    exchange::check(&spec)?;
    let set = std::mem::take(&mut spec.particles);
    let count = set.len();
    let kinds = with_grains_to_come(&spec, &set);
    let (mut radius_min, mut radius_max, mut radius_sum) = (f64::INFINITY, 0.0_f64, 0.0);
    for &r in &kinds.radius {
        radius_min = radius_min.min(r);
        radius_max = radius_max.max(r);
        radius_sum += r;
    }
    let cubes =
        || kinds.radius.iter().zip(&kinds.material).map(|(r, m)| (r.powi(3), spec.materials[*m].density));
    let density_mean = cubes().map(|(v, d)| v * d).sum::<f64>() / cubes().map(|(v, _)| v).sum::<f64>();
    let radius_mean = if kinds.is_empty() { 1e-3 } else { radius_sum / kinds.len() as f64 };
    let [radius_min, radius_max] = if kinds.is_empty() { [1e-3; 2] } else { [radius_min, radius_max] };
    let materials = spec.materials.len();
    let mut pairs = Vec::with_capacity(materials * materials);
    for a in 0..materials {
        for b in 0..materials {
            pairs.push(of_pair(&spec, a, b, radius_max)?);
        }
    }
    let laws: Vec<Laws> = pairs.iter().map(|p| p.laws).collect();
    let layout = Layout::of(&laws);
    if layout.floats() > MEMORY {
        return Err(SetupError::Invalid(format!(
            "these laws remember {} numbers per contact; backends hold {MEMORY}",
            layout.floats()
        )));
    }
    bonds::check(&spec, &pairs, radius_min)?;
    let range = pairs.iter().map(|p| p.range.max(p.bond_range)).fold(0.0, f64::max);
    let cutoff = 2.0 * radius_max + range + SKIN_MAX * radius_mean;
    let window = if spec.stages.iter().any(|s| s.deformation.is_some()) { cell::WINDOW } else { 2.5 };
    let lattice = Lattice::new(&spec.domain, cutoff, window)
        .map_err(|(axis, height)| SetupError::PeriodicTooShort { axis: AXES[axis], height, cutoff })?;
    let boundaries = boundaries(&spec)?;
    let limits = step_limits(&spec, &kinds, &pairs);
    let mut warnings = Vec::new();
    let dt = time_step(&spec, limits, &mut warnings)?;
    let mut constants = Constants {
        spec,
        history: Layout::signs(&laws).into_iter().map(|s| s as f32).collect(),
        layout,
        dt,
        limits,
        lattice,
        pairs,
        boundaries,
        count,
        radius_min,
        radius_max,
        radius_mean,
        density_mean,
        range,
        control_steps: Vec::new(),
        warnings,
    };
    check_periodic(&constants)?;
    let warnings = speed::check(&constants)?;
    constants.warnings.extend(warnings);
    let warnings = cell::check(&constants)?;
    constants.warnings.extend(warnings);
    let every = |stage: &Stage| stage.deformation.as_ref().map_or(0, |d| cell::control_steps(&constants, d));
    constants.control_steps = constants.spec.stages.iter().map(every).collect();
    let warnings = check_start(&constants, &set)?;
    constants.warnings.extend(warnings);
    let warnings = constants.worn_nowhere();
    constants.warnings.extend(warnings);
    let particles = particles(&constants, &set)?;

    let spec = &constants.spec;
    let surfaces = spec
        .surfaces
        .iter()
        .map(|s| SurfaceState { present: !s.absent, base: s.pose, since: 0, reference: s.pose })
        .collect();
    let progress = Progress {
        surfaces,
        path: vec![0.0; spec.surfaces.len()],
        impulse: vec![[0.0; 6]; spec.surfaces.len()],
        measures: vec![MeasureState::default(); spec.stages.first().map_or(0, |s| s.measures.len())],
        inlets: vec![InletState::default(); spec.inlets.len()],
        outlets: vec![Flow::default(); spec.outlets.len()],
        wear: (0..spec.surfaces.len())
            .filter(|_| constants.lists_wear())
            .map(|s| constants.unworn(s))
            .collect(),
        stale: true,
        skin: SKIN_START * radius_mean,
        cell: constants.deforms().then(|| {
            let mut cell = Cell::new(spec.domain.cell);
            cell.begin(spec.stages.first().and_then(|s| s.deformation.as_ref()));
            cell
        }),
        ..Progress::default()
    };
    Ok((Arc::new(constants), State { particles, progress, ..State::default() }))
}

/// The particles at the start, and of each inlet the smallest and the largest that it may bring.
fn with_grains_to_come(spec: &WorldSpec, set: &ParticleSet) -> ParticleSet {
    let mut all = set.clone();
    for inlet in &spec.inlets {
        let Some(grains) = inlet.supply.grains() else { continue };
        let (least, largest) = grains.sizes.limits();
        for radius in [least, largest] {
            all.push_moving([0.0; 3], radius, grains.material, inlet.velocity, [0.0; 3]);
        }
    }
    all
}

/// The particles at the start, encoded.
fn particles(c: &Constants, set: &ParticleSet) -> Result<Particles, SetupError> {
    let (spec, lattice) = (&c.spec, &c.lattice);
    let mut particles = Particles::default();
    for i in 0..set.len() {
        let e = lattice.encode(set.position[i]);
        for k in 0..3 {
            let u = Lattice::units(e.hi[k], e.lo[k]);
            if !lattice.periodic[k] && !(0..=lattice.extent[k]).contains(&u) {
                let why =
                    format!("starts outside the domain along {}; move it or enlarge the domain", AXES[k]);
                return Err(SetupError::Particle { id: i, at: set.position[i], why });
            }
        }
        let r = set.radius[i];
        let mass = 4.0 / 3.0 * std::f64::consts::PI * r.powi(3) * spec.materials[set.material[i]].density;
        particles.id.push(i as u32);
        particles.place.push(Place { lo: e.lo, radius: r as f32 });
        particles.hi.push(e.hi);
        particles.rest.push(e.rest);
        let v = set.velocity.get(i).copied().unwrap_or_default();
        let w = set.spin.get(i).copied().unwrap_or_default();
        particles.velocity.push(Velocity { v: v.map(|x| x as f32), inv_mass: (1.0 / mass) as f32 });
        particles.spin.push(Spin { w: w.map(|x| x as f32), material: set.material[i] as u32 });
    }
    particles.acceleration = vec![[0.0; 3]; set.len()];
    particles.angular = vec![[0.0; 3]; set.len()];
    particles.force = vec![[0.0; 3]; set.len()];
    particles.hi_ref.clone_from(&particles.hi);
    particles.lo_ref = particles.place.iter().map(|p| p.lo).collect();
    Ok(particles)
}

/// The coefficients of a pair of materials, with the overrides that the specification has for it.
fn of_pair(spec: &WorldSpec, a: usize, b: usize, radius: f64) -> Result<PairCoefficients, SetupError> {
    let given = spec.pairs.iter().rposition(|(p, q, _)| (*p, *q) == (a, b) || (*p, *q) == (b, a));
    let over = given.map_or_else(PairOverride::default, |k| spec.pairs[k].2.clone());
    // Sorted, so that both orders give the same bits.
    let (one, other) = (&spec.materials[a.min(b)], &spec.materials[a.max(b)]);
    let properties = PairProperties::new(one, other, &spec.mixing, spec.shear_modulus, &over);
    let model = spec.contact.of_pair(&over.laws);
    let laws = Laws::resolve(&model);
    let prepared = laws.and_then(|laws| laws.prepare(&model, &properties, radius));
    prepared.map_err(|why| match given.filter(|_| over.laws != PairLaws::default()) {
        Some(pair) => SetupError::PairLaw { pair, name: format!("{}-{}", one.name, other.name), why },
        None => SetupError::Law(why),
    })
}

fn check_materials(spec: &WorldSpec) -> Result<(), SetupError> {
    for m in &spec.materials {
        let checks = [
            (m.density > 0.0, "density", m.density, "above 0"),
            (m.youngs_modulus > 0.0, "Young's modulus", m.youngs_modulus, "above 0"),
            (
                m.poissons_ratio > -1.0 && m.poissons_ratio <= 0.5,
                "Poisson's ratio",
                m.poissons_ratio,
                "above -1 and up to 0.5",
            ),
            ((0.0..=1.0).contains(&m.restitution), "restitution", m.restitution, "from 0 to 1"),
            (m.friction >= 0.0, "friction", m.friction, "0 or more"),
            (
                m.static_friction >= m.friction,
                "static friction",
                m.static_friction,
                "at least the sliding friction",
            ),
            (m.rolling_friction >= 0.0, "rolling friction", m.rolling_friction, "0 or more"),
        ];
        for (fine, what, value, allowed) in checks {
            if !fine || !value.is_finite() {
                return Err(SetupError::Invalid(format!(
                    "the {what} of the material `{}` is {value}; allowed is {allowed}",
                    m.name
                )));
            }
        }
    }
    if let Some(k) = spec.wear.iter().find(|k| !(k.is_finite() && **k >= 0.0)) {
        return Err(SetupError::Invalid(format!(
            "the wear of a material is {k} 1/Pa, coefficient over hardness; allowed is 0 or more"
        )));
    }
    if spec.stages.is_empty() {
        return Err(SetupError::Invalid("the world has no stage: nothing would happen".to_owned()));
    }
    if !(0.0..1.0).contains(&spec.local_damping) {
        return Err(SetupError::Invalid(format!(
            "local damping is {}; allowed is 0 up to below 1",
            spec.local_damping
        )));
    }
    Ok(())
}

/// Checks that every number that points into a list does, so that nothing is looked up in vain later.
fn check_references(spec: &WorldSpec) -> Result<(), SetupError> {
    let (materials, surfaces) = (spec.materials.len(), spec.surfaces.len());
    let bad = |what: String| Err(SetupError::Invalid(what));
    let d = &spec.domain;
    let cell = crate::lattice::determinant(&d.cell);
    if !(cell.is_finite() && cell > 0.0) || d.origin.iter().any(|x| !x.is_finite()) {
        return bad(format!("the domain's cell has the volume {cell} m³; it must be above 0"));
    }
    if d.material.is_some_and(|m| m >= materials) {
        return bad("the domain's material does not exist".to_owned());
    }
    if spec.pairs.iter().any(|(a, b, _)| *a >= materials || *b >= materials) {
        return bad("a pair names a material that does not exist".to_owned());
    }
    for (a, b, over) in &spec.pairs {
        if let Some(x) = over.cohesion.filter(|x| !x.is_finite() || *x < 0.0) {
            let [a, b] = [a, b].map(|m| &spec.materials[*m].name);
            return bad(format!("the cohesion of the pair `{a}-{b}` is {x}; allowed is 0 or more"));
        }
    }
    for s in &spec.surfaces {
        let pose = s.pose.translation.iter().chain(&s.pose.rotation);
        if s.material >= materials || pose.into_iter().any(|x| !x.is_finite()) {
            return bad(format!("the surface `{}` has no such material, or no finite pose", s.name));
        }
        if let Shape::Frustum(frustum) = &s.shape
            && let Some(fault) = frustum.fault()
        {
            return bad(format!("the cylinder or cone `{}` has {fault}", s.name));
        }
        if let Shape::Mesh(mesh) = &s.shape {
            let count = mesh.vertices.len();
            let inside = mesh.triangles.iter().flatten().all(|v| (*v as usize) < count);
            if !inside || mesh.vertices.iter().flatten().any(|x| !x.is_finite()) {
                return bad(format!("the mesh of `{}` has a vertex that is missing or not finite", s.name));
            }
        }
    }
    let staged = spec.stages.iter().flat_map(|stage| &stage.moves);
    let motions = spec.surfaces.iter().map(|s| &s.motion).enumerate();
    for (s, motion) in motions.chain(staged.map(|(s, motion)| (*s, motion))) {
        if motion.turns_twice() && s < surfaces {
            return bad(format!(
                "a motion of `{}` has a rotation and a table of poses that turns; put all turns into the table",
                spec.surfaces[s].name
            ));
        }
    }
    for stage in &spec.stages {
        let named = stage.moves.iter().map(|m| m.0).chain(stage.measures.iter().map(|m| m.surface));
        let acted = stage.actions.iter().filter_map(|a| match a {
            Action::Insert(s) | Action::Withdraw(s) => Some(*s),
            Action::RemoveBeyond { .. } | Action::Bond => None,
        });
        if named.chain(acted).any(|s| s >= surfaces) {
            return bad(format!("the stage `{}` names a surface that does not exist", stage.name));
        }
        let axes = stage.measures.iter().filter_map(|m| match m.component {
            Component::Force(k) | Component::Torque(k) => Some(k),
            Component::Draught => None,
        });
        if axes.into_iter().any(|k| k > 2) {
            return bad(format!("a measure of the stage `{}` names an axis above 2", stage.name));
        }
        for survey in &stage.surveys {
            let wrong = match survey.of {
                Surveyed::AngleOfRepose if spec.gravity == [0.0; 3] => {
                    "a slope against gravity, and there is none"
                }
                Surveyed::BulkDensity { min, max } if (0..3).any(|k| min[k] >= max[k]) => {
                    "of a box without a volume"
                }
                Surveyed::LaceyIndex { class, min, max, samples } => {
                    match lacey_wrong(spec, class, [min, max], samples) {
                        Some(wrong) => wrong,
                        None => continue,
                    }
                }
                _ => continue,
            };
            return bad(format!("the survey `{}` of the stage `{}` is {wrong}", survey.name, stage.name));
        }
    }
    Ok(())
}

/// What is wrong with a Lacey index, if anything.
fn lacey_wrong(
    spec: &WorldSpec,
    class: Class,
    [min, max]: [Vec3; 2],
    samples: [usize; 3],
) -> Option<&'static str> {
    let stranger = matches!(class, Class::Material(material) if material >= spec.materials.len());
    let product = samples.iter().try_fold(1_usize, |product, n| product.checked_mul(*n));
    if stranger {
        Some("of a material that does not exist")
    } else if (0..3).any(|k| min[k] >= max[k]) {
        Some("of a box without a volume")
    } else if !product.is_some_and(|n| (2..=MOST_SAMPLES).contains(&n)) {
        Some("over fewer than two samples, or more than ten million")
    } else {
        None
    }
}

fn check_particles(spec: &WorldSpec) -> Result<(), SetupError> {
    let set = &spec.particles;
    if set.len() > u32::MAX as usize / 2 {
        return Err(SetupError::Invalid(format!("{} particles are more than 2^31", set.len())));
    }
    if set.radius.len() != set.len() || set.material.len() != set.len() {
        return Err(SetupError::Invalid("the columns of the particles differ in length".to_owned()));
    }
    let moving = set.velocity.iter().chain(&set.spin).flatten();
    if moving.into_iter().any(|x| !x.is_finite()) {
        return Err(SetupError::Invalid("a particle's velocity is not a finite number".to_owned()));
    }
    for i in 0..set.len() {
        let at = set.position[i];
        let (r, m) = (set.radius[i], set.material[i]);
        let why = if at.iter().any(|x| !x.is_finite()) {
            Some("has a coordinate that is not a finite number".to_owned())
        } else if !(r.is_finite() && r > 0.0) {
            Some(format!("has the radius {r} m; radii are above 0"))
        } else if m >= spec.materials.len() {
            Some(format!("has the material number {m}, but there are {}", spec.materials.len()))
        } else {
            None
        };
        if let Some(why) = why {
            return Err(SetupError::Particle { id: i, at, why });
        }
    }
    Ok(())
}

/// Refuses surfaces that do not repeat with the cell: planes across a periodic axis, now or once they turn, and
/// meshes of very many periods.
fn check_periodic(c: &Constants) -> Result<(), SetupError> {
    let bad = |what: String| Err(SetupError::Invalid(what));
    let instead = "particles would not meet it through the seam; make the sides of that axis walls or open, or \
                   use a mesh, which repeats with the cell";
    let spec = &c.spec;
    for (s, k) in (0..spec.surfaces.len()).flat_map(|s| (0..3).map(move |k| (s, k))) {
        if !c.lattice.periodic[k] {
            continue;
        }
        let Surface { name, pose, motion, .. } = &spec.surfaces[s];
        let axis = AXES[k];
        let normal = match &c.boundaries[s].shape {
            BoundaryShape::Plane(normal) => rotate(pose.rotation, *normal),
            shape => {
                let periods = Span::new(c, shape, pose).map_or(0.0, |span| span.periods(k));
                if periods > PERIODS_MAX {
                    return bad(format!(
                        "the surface `{name}` is {periods:.0} periods long along the periodic axis {axis}, more than \
                         {PERIODS_MAX}; it repeats with the cell, so cut it to one period, or check its unit"
                    ));
                }
                continue;
            }
        };
        let vector = spec.domain.cell.map(|row| row[k]);
        let vector = scale(vector, 1.0 / norm(vector));
        if dot(normal, vector).abs() > PARALLEL {
            return bad(format!(
                "the plane `{name}` is not parallel to the periodic axis {axis}: {instead}, or turn the plane \
                 parallel to {axis}"
            ));
        }
        // A turn about the normal leaves the plane where it is, one about the axis leaves it parallel to that; of
        // both kinds together neither holds.
        let own = motion.turns().map(|(axis, _)| (axis, None));
        let staged = spec.stages.iter().flat_map(|stage| {
            let moves = stage.moves.iter().filter(move |m| m.0 == s);
            moves.flat_map(|m| m.1.turns().map(|(axis, _)| (axis, Some(&stage.name))))
        });
        let turns: Vec<_> = own.chain(staged).collect();
        let about = |x: Vec3, axis: Vec3| norm(cross(x, axis)) <= PARALLEL;
        if turns.iter().all(|(axis, _)| about(normal, *axis)) {
            continue;
        }
        if let Some((_, stage)) = turns.iter().find(|(axis, _)| !about(vector, *axis)) {
            let stage = stage.map_or_else(String::new, |name| format!(" in the stage `{name}`"));
            return bad(format!(
                "the rotation of the plane `{name}`{stage} turns it out of the periodic axis {axis}: {instead}, or \
                 rotate the plane about {axis} or about its normal only"
            ));
        }
    }
    Ok(())
}

/// Refuses particles that start inside a surface that is there from the beginning, deeper than the guard
/// allows; where the guard only warns, they are counted. Returns the warnings.
fn check_start(c: &Constants, set: &ParticleSet) -> Result<Vec<String>, SetupError> {
    let guards = &c.spec.guards;
    let mut warnings = Vec::new();
    let mut near = Vec::new();
    for b in &c.boundaries {
        let Some(span) = Span::new(c, &b.shape, &b.pose) else { continue };
        if b.surface.is_some_and(|s| c.spec.surfaces[s].absent) {
            continue;
        }
        let mut inside = 0;
        for (id, (&at, &r)) in set.position.iter().zip(&set.radius).enumerate() {
            let reach = (1.0 - guards.overlap_limit).max(0.0) * r;
            if !b.touched(c, &b.pose, &span, at, reach, &mut near) {
                continue;
            }
            if guards.overlap_stops {
                let why = format!(
                    "starts inside the surface `{}`, deeper than {:.0} % of its radius; move one of them, or \
                     insert the surface in a later stage",
                    b.name,
                    100.0 * guards.overlap_limit
                );
                return Err(SetupError::Particle { id, at, why });
            }
            inside += 1;
        }
        if inside > 0 {
            warnings.push(format!("{inside} particles start inside the surface `{}`", b.name));
        }
        let closed = match &b.shape {
            BoundaryShape::Plane(_) => false,
            BoundaryShape::Mesh(mesh, _) => mesh.is_closed(),
            BoundaryShape::Frustum(frustum) => frustum.closed,
        };
        if !closed {
            continue;
        }
        // A drum has all of its particles inside, a tool has none: some of them are worth a word, and no more, as
        // a vessel may stand in a bed.
        let enclosed = |at: &&Vec3| {
            let mut images = span.images(c, **at, 0.0);
            images.any(|shift| {
                let x = b.pose.inverse(c.shifted(**at, shift));
                match &b.shape {
                    BoundaryShape::Plane(_) => false,
                    BoundaryShape::Mesh(mesh, bvh) => bvh.encloses(mesh, x),
                    BoundaryShape::Frustum(frustum) => frustum.encloses(x),
                }
            })
        };
        let enclosed = set.position.iter().filter(enclosed).count();
        if enclosed > 0 && enclosed < set.len() {
            warnings.push(format!(
                "{enclosed} of {} particles start within the closed surface `{}`, the others outside of it; if it is a \
                 solid body, move them or insert it in a later stage",
                set.len(),
                b.name
            ));
        }
    }
    Ok(warnings)
}

/// Surfaces of the specification, then a plane for every side of the domain that is a wall.
fn boundaries(spec: &WorldSpec) -> Result<Vec<Boundary>, SetupError> {
    let mut all = Vec::new();
    for (index, s) in spec.surfaces.iter().enumerate() {
        let shape = match &s.shape {
            Shape::Plane { normal } => BoundaryShape::Plane(*normal),
            Shape::Mesh(mesh) => BoundaryShape::Mesh(mesh.clone(), Bvh::new(mesh)),
            Shape::Frustum(frustum) => BoundaryShape::Frustum(*frustum),
        };
        all.push(Boundary {
            name: s.name.clone(),
            material: s.material,
            shape,
            surface: Some(index),
            pose: s.pose,
        });
    }
    let d = &spec.domain;
    for axis in 0..3 {
        if (d.sides[axis][0] == Side::Periodic) != (d.sides[axis][1] == Side::Periodic) {
            return Err(SetupError::Invalid(format!(
                "the axis {} is periodic on one side only; make both sides periodic or neither",
                AXES[axis]
            )));
        }
        // The inward normal of a side is the row of the inverse cell: it is across the two other vectors.
        let columns = [0, 1, 2].map(|k| [d.cell[0][k], d.cell[1][k], d.cell[2][k]]);
        let across = cross(columns[(axis + 1) % 3], columns[(axis + 2) % 3]);
        let sign = dot(across, columns[axis]).signum();
        let normal = scale(across, sign / norm(across));
        for side in 0..2 {
            if d.sides[axis][side] != Side::Wall {
                continue;
            }
            let material = d.material.ok_or_else(|| {
                SetupError::Invalid("the domain has walls but no material; set domain.material".to_owned())
            })?;
            let (point, normal) = if side == 0 {
                (d.origin, normal)
            } else {
                (add(d.origin, columns[axis]), scale(normal, -1.0))
            };
            all.push(Boundary {
                name: format!("domain.{}{}", AXES[axis], ["-", "+"][side]),
                material,
                shape: BoundaryShape::Plane(normal),
                surface: None,
                pose: Pose { translation: point, ..Pose::default() },
            });
        }
    }
    Ok(all)
}

/// Stable-step estimates over the smallest particle of each material against every other and
/// every boundary material.
fn step_limits(spec: &WorldSpec, set: &ParticleSet, pairs: &[PairCoefficients]) -> StepLimits {
    let n = spec.materials.len();
    let mut smallest = vec![f64::INFINITY; n];
    for (&r, &m) in set.radius.iter().zip(&set.material) {
        smallest[m] = smallest[m].min(r);
    }
    let mut rayleigh = f64::INFINITY;
    let mut collision = f64::INFINITY;
    let speed = speed_estimate(spec, set);
    let mass = |m: usize| 4.0 / 3.0 * std::f64::consts::PI * smallest[m].powi(3) * spec.materials[m].density;
    for a in (0..n).filter(|&m| smallest[m].is_finite()) {
        for b in 0..n {
            let pair = &pairs[a * n + b];
            if pair.laws.normal.from_material() {
                rayleigh = rayleigh.min(physics::rayleigh_time(smallest[a], &spec.materials[a]));
            }
            let wall = Impact { m_eff: mass(a), r_eff: smallest[a], diameter: 2.0 * smallest[a] };
            let mut impacts = vec![wall];
            if smallest[b].is_finite() {
                let r_eff = smallest[a] * smallest[b] / (smallest[a] + smallest[b]);
                let m_eff = mass(a) * mass(b) / (mass(a) + mass(b));
                impacts.push(Impact { m_eff, r_eff, diameter: 4.0 * r_eff });
            }
            for i in impacts {
                collision = collision.min(pair.laws.normal.collision_time(&pair.normal, &i, speed));
                collision = collision.min(pair.laws.bond.collision_time(&pair.bond, &i, speed));
            }
        }
    }
    let advised =
        (physics::AUTO_RAYLEIGH_SHARE * rayleigh).min(collision / physics::AUTO_STEPS_PER_COLLISION);
    StepLimits { rayleigh, collision, advised }
}

/// The largest of present speeds, tool speeds and the speed of a fall through the bed's height.
fn speed_estimate(spec: &WorldSpec, set: &ParticleSet) -> f64 {
    let present = set.velocity.iter().map(|v| norm(*v)).fold(0.0, f64::max);
    let motions = spec
        .surfaces
        .iter()
        .enumerate()
        .map(|(i, s)| (i, &s.motion))
        .chain(spec.stages.iter().flat_map(|st| st.moves.iter().map(|(i, m)| (*i, m))));
    let mut tools = 0.0_f64;
    for (i, m) in motions {
        // Points of the surface, and how far it reaches around them.
        let points: Vec<(Vec3, f64)> = match &spec.surfaces[i].shape {
            Shape::Plane { .. } => Vec::new(),
            Shape::Mesh(mesh) => mesh.vertices.iter().map(|x| (*x, 0.0)).collect(),
            Shape::Frustum(frustum) => frustum.rims().to_vec(),
        };
        let pose = &spec.surfaces[i].pose;
        let v = m.fastest(|about| {
            let far = |x: Vec3| match about {
                Some((axis, center)) => norm(cross(axis, sub(pose.apply(x), center))),
                None => norm(x),
            };
            points.iter().map(|(x, around)| far(*x) + around).fold(0.0, f64::max)
        });
        tools = tools.max(v);
    }
    let g = norm(spec.gravity);
    let fall = if g > 0.0 && !set.is_empty() {
        // From the highest particle to the lowest corner of the domain.
        let down = |x: &Vec3| dot(*x, spec.gravity) / g;
        let floor = spec.domain.corners().iter().map(down).fold(f64::NEG_INFINITY, f64::max);
        let highest = set.position.iter().map(down).fold(f64::INFINITY, f64::min);
        (2.0 * g * (floor - highest).max(0.0)).sqrt()
    } else {
        0.0
    };
    present.max(tools).max(fall).max(1e-3)
}

fn time_step(spec: &WorldSpec, l: StepLimits, warnings: &mut Vec<String>) -> Result<f64, SetupError> {
    match spec.time.step {
        Step::Auto if l.advised.is_finite() => Ok(l.advised),
        Step::Auto => Err(SetupError::Invalid(
            "step = \"auto\" needs particles to estimate the stable step from; give time.step in seconds"
                .to_owned(),
        )),
        Step::Fixed(step) if !(step > 0.0 && step.is_finite()) => {
            Err(SetupError::Invalid(format!("the time step is {step} s; allowed is above 0")))
        }
        Step::Fixed(step) => {
            let (stable, limit) = if l.rayleigh.is_finite() {
                (l.rayleigh, "the Rayleigh time of the smallest particle")
            } else {
                let steps = physics::AUTO_STEPS_PER_COLLISION * physics::AUTO_RAYLEIGH_SHARE;
                (l.collision / steps, "from the duration of the shortest impact")
            };
            let share = step / stable;
            if share > 1.0 && !spec.time.force {
                return Err(SetupError::StepTooLarge {
                    step,
                    stable,
                    share: 100.0 * share,
                    limit,
                    advised: l.advised,
                });
            }
            if share > physics::WARN_RAYLEIGH_SHARE {
                warnings.push(format!(
                    "the time step {step:.3e} s is {:.0} % of the stable step {stable:.3e} s ({limit}); \
                     step = \"auto\" would take {:.3e} s",
                    100.0 * share,
                    l.advised
                ));
            }
            Ok(step)
        }
    }
}
