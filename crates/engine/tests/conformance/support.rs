//! Worlds for the suites, and ways to run and read them.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::sync::Arc;

use glebe_engine::backend::{Backend, Detail, Fleet, Job, Moment};
use glebe_engine::batch::{Observer, Sample};
use glebe_engine::lattice::{add, cross, dot, norm, scale, sub};
use glebe_engine::spec::{
    Domain, Frustum, Motion, Pose, Shape, Side, Stage, Step, Surface, Time, TriMesh, Vec3, WorldSpec,
};
use glebe_engine::state::{Progress, State};
use glebe_engine::{Constants, Failure, prepare};
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, LawInfo, Laws, Layout, Material, Slot, laws};

/// A backend under test: what its number format holds it to, and what it can afford.
///
/// A new backend is one constant here and its rows at the end of `main.rs`. What physics demands (restitution,
/// creep, closure of the ledger, …) is the same for all and stands at the top of each suite; bounds that follow
/// from rounding stand here, one a quantity.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    pub backend: Backend,
    /// Whether its worlds take the kernels of those of which there are many.
    pub crowded: bool,
    /// Whether its states hold everything that it goes on from, so that a checkpoint changes no bit.
    pub exact_states: bool,
    /// Whether sums of the ledger do not depend on where jobs end.
    pub exact_sums: bool,
    /// Whether forces are summed in an order that the reach of its lists does not change.
    pub exact_reach: bool,
    /// Whether it has the time for every law where kernels are made for each.
    pub every_law: bool,
    pub bounds: Bounds,
    pub budget: Budget,
}

impl Subject {
    /// A world that takes the subject's kernels.
    fn fitted(&self, mut spec: WorldSpec) -> WorldSpec {
        spec.throughput |= self.crowded;
        spec
    }
}

/// Largest differences that rounding may cause.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Force on a particle after one step from a state of the reference, as a share of the sum of its contact
    /// forces' sizes; its torque, as a share of that sum times the radius.
    pub force: f64,
    pub torque: f64,
    /// Error of the distance of two particles, in units of the lattice.
    pub distance: f64,
    /// Trajectories of a packing that is pressed together, after 200 steps, against the reference.
    pub trajectory: Apart,
    /// Relative error of what its ledger says was lost in these steps.
    pub ledger: f64,
    /// Trajectories after 100 steps seen from two frames, or in two cells of the same images.
    /// Velocities as a share of the largest fluctuation.
    pub frame: Apart,
    /// Trajectories over 10 000 steps on a plane and on a mesh of it.
    pub triangulation: Apart,
    /// Change of momentum and angular momentum of an isolated cloud in 200 steps, as a share of the sum of
    /// sizes.
    pub momentum: f64,
    pub angular_momentum: f64,
    /// Relative error of the size of the tangential force of a contact turned rigidly once around in 1000 steps:
    /// the rounded speeds of 1.3 m/s of both ends stretch the spring.
    pub turn: f64,
    /// Relative excess of a tangential force over its cap.
    pub cap: f64,
    /// Relative error of a force against the finite difference of energies.
    pub slope: f64,
    /// Relative error of impulse and work of a surface against momentum and energy of the particles.
    pub balance: f64,
    /// Most steps to an elastic impact at which rounding does not hide an integrator's error: 25 times a power
    /// of two.
    pub finest_impact: f64,
}

/// How far two trajectories may be apart.
#[derive(Clone, Copy, Debug)]
pub struct Apart {
    /// Places, in radii.
    pub place: f64,
    /// Velocities, as a share of the largest.
    pub velocity: f64,
    /// Spins, as a share of the largest.
    pub spin: f64,
}

/// Steps that a backend can afford where a suite may take more or fewer.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Of 1 µs, for creep of two particles.
    pub creep: u64,
    /// Of a packing of some hundred spheres at rest.
    pub at_rest: u64,
    /// Of a gas of 64 spheres.
    pub gas: u64,
    /// Of two spheres that turn about each other, set anew each step; a turn is 1000.
    pub turning: u64,
    /// Of a world of the suite of bits, and how many spheres tumble in it.
    pub tumbling: u64,
    pub tumblers: u32,
}

/// Of forces in f32.
const SINGLE: Bounds = Bounds {
    force: 3e-6,
    torque: 3e-6,
    distance: DISTANCE,
    trajectory: Apart { place: 1e-6, velocity: 2e-4, spin: 2e-4 },
    ledger: 1e-3,
    frame: Apart { place: 2e-6, velocity: 2e-5, spin: 2e-4 },
    triangulation: Apart { place: 2e-5, velocity: 1e-4, spin: 1e-4 },
    momentum: 1e-6,
    angular_momentum: 2e-6,
    turn: 1e-4,
    cap: 1e-5,
    slope: 1e-4,
    balance: 1e-4,
    finest_impact: 200.0,
};

/// f32 after the overlap, threads and vectors.
pub const CPU: Subject = Subject {
    backend: Backend::Cpu,
    crowded: false,
    exact_states: true,
    exact_sums: true,
    exact_reach: true,
    every_law: true,
    bounds: SINGLE,
    budget: Budget {
        creep: 1_000_000,
        at_rest: 10_000,
        gas: 20_000,
        turning: 1000,
        tumbling: 500,
        tumblers: 1500,
    },
};

/// f64, but for the states that are read from it; with itself it agrees.
pub const REFERENCE: Subject = Subject {
    backend: Backend::Reference,
    crowded: false,
    exact_states: false,
    exact_sums: true,
    exact_reach: true,
    every_law: true,
    bounds: Bounds {
        force: 0.0,
        torque: 0.0,
        distance: 0.0,
        trajectory: Apart { place: 0.0, velocity: 0.0, spin: 0.0 },
        ledger: 0.0,
        frame: Apart { place: 1e-7, velocity: 1e-6, spin: 1e-6 },
        triangulation: Apart { place: 1e-6, velocity: 1e-5, spin: 1e-5 },
        momentum: 1e-7,
        angular_momentum: 3e-7,
        turn: 1e-4,
        cap: 1e-6,
        slope: 1e-5,
        balance: 1e-5,
        finest_impact: 1600.0,
    },
    budget: Budget {
        creep: 1_000_000,
        at_rest: 2_000,
        gas: 10_000,
        turning: 1000,
        tumbling: 100,
        tumblers: 200,
    },
};

/// f32 throughout, distances in pairs of them; each particle sums its own side of a contact. The device named by
/// `GLEBE_TEST_DEVICE` (`gpu:N` or `cuda:N`) or the first, be it software; without one its suites are skipped aloud, and
/// fail where CI is set or a device was named.
#[cfg(feature = "gpu")]
pub fn gpu() -> Option<&'static Subject> {
    use std::io::Write as _;
    use std::sync::LazyLock;

    use glebe_engine::backend::gpu::{Accelerator, Choice};

    fn named() -> Option<Choice> {
        let name = std::env::var("GLEBE_TEST_DEVICE").ok()?;
        let choice = match name.split_once(':') {
            Some(("gpu", number)) => number.parse().ok().map(Choice::Adapter),
            Some(("cuda", number)) => number.parse().ok().map(Choice::Cuda),
            _ => None,
        };
        Some(choice.unwrap_or_else(|| panic!("GLEBE_TEST_DEVICE: `{name}` is neither gpu:N nor cuda:N")))
    }
    static FOUND: LazyLock<Option<Subject>> =
        LazyLock::new(|| match Accelerator::open(named().unwrap_or(Choice::Any)) {
            Ok(accelerator) => Some(on_device(Backend::Gpu(accelerator))),
            Err(why) => {
                let must = ["CI", "GLEBE_TEST_DEVICE"].iter().any(|name| std::env::var_os(name).is_some());
                assert!(!must, "the suites of the GPU backend must run: {why}");
                // Not as tests print, which is shown only if they fail.
                let line = format!("SKIPPED: all suites of the GPU backend: {why}\n");
                std::io::stderr().write_all(line.as_bytes()).unwrap();
                None
            }
        });
    FOUND.as_ref()
}

/// The same with the kernels of worlds of which there are many.
#[cfg(feature = "gpu")]
pub fn crowds() -> Option<&'static Subject> {
    use std::sync::LazyLock;

    static FOUND: LazyLock<Option<Subject>> =
        LazyLock::new(|| gpu().map(|on| Subject { crowded: true, ..*on }));
    FOUND.as_ref()
}

#[cfg(feature = "gpu")]
fn on_device(backend: Backend) -> Subject {
    // A device that nobody named may be software.
    let named = std::env::var_os("GLEBE_TEST_DEVICE").is_some();
    Subject {
        backend,
        crowded: false,
        exact_states: true,
        exact_sums: false,
        exact_reach: false,
        every_law: named,
        bounds: Bounds { turn: 2e-4, ..SINGLE },
        budget: Budget {
            creep: if named { 20_000 } else { 5_000 },
            at_rest: 1_000,
            gas: 4_000,
            turning: 100,
            tumbling: 100,
            tumblers: 300,
        },
    }
}

/// Of whole units: each coordinate of both particles is rounded by half a unit, along each of three axes.
const DISTANCE: f64 = 1.732_050_8;

/// Grains: 2500 kg/m³, E = 10 MPa, ν = 0.3.
pub fn grain(restitution: f64, friction: f64) -> Material {
    Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e7,
        poissons_ratio: 0.3,
        restitution,
        friction,
        static_friction: friction,
        rolling_friction: 0.05,
    }
}

/// An empty open cube around `center` with a half side of `half` \[m\], one endless stage and one material.
pub fn open_world(center: Vec3, half: f64, dt: f64, material: Material) -> WorldSpec {
    let h = [half; 3];
    let domain = Domain::aligned(sub(center, h), add(center, h), [[Side::Open; 2]; 3], Some(0));
    let time = Time { step: Step::Fixed(dt), integrator: IntegratorKind::Euler, force: true };
    let mut w = WorldSpec::new(domain, time);
    w.materials = vec![material];
    w.stages = vec![Stage { name: "run".to_owned(), ..Stage::default() }];
    w.guards.overlap_stops = false;
    w
}

pub fn plane(normal: Vec3, point: Vec3) -> Surface {
    surface(Shape::Plane { normal }, Pose { translation: point, ..Pose::default() })
}

pub fn mesh(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>, pose: Pose) -> Surface {
    surface(Shape::Mesh(Arc::new(TriMesh { vertices, triangles })), pose)
}

pub fn frustum(frustum: Frustum, pose: Pose) -> Surface {
    surface(Shape::Frustum(frustum), pose)
}

fn surface(shape: Shape, pose: Pose) -> Surface {
    Surface { name: "surface".to_owned(), material: 0, shape, pose, motion: Motion::default(), absent: false }
}

/// A rectangle in the plane z = 0 of two triangles.
pub fn rectangle(min: [f64; 2], max: [f64; 2]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let ([a, b], [c, d]) = (min, max);
    (vec![[a, b, 0.0], [c, b, 0.0], [c, d, 0.0], [a, d, 0.0]], vec![[0, 1, 2], [0, 2, 3]])
}

/// The law of `info` with the typical values of the parameters that it requires.
pub fn choice(info: &LawInfo) -> LawChoice {
    let required = info.parameters.iter().filter(|p| p.required);
    required.fold(LawChoice::named(info.name), |c, p| c.with(p.name, p.typical))
}

/// Contact models with every registered law of a slot, the other slots at rolling default.
pub fn each_law_of(slot: Slot) -> Vec<ContactModel> {
    let base = ContactModel { rolling: LawChoice::named("constant-torque"), ..ContactModel::default() };
    let with = |info| {
        let mut m = base.clone();
        *slot_of(&mut m, slot) = choice(info);
        m
    };
    laws(slot).iter().map(with).collect()
}

/// The same of every slot.
pub fn each_law() -> Vec<ContactModel> {
    SLOTS.into_iter().flat_map(each_law_of).collect()
}

/// The same, but on a software device that nobody named only the laws whose kernels its compiler has time for.
pub fn each_law_for(on: &Subject) -> Vec<ContactModel> {
    let known = |m: &ContactModel| {
        SLOTS.iter().all(|slot| USUAL.contains(&slot_of(&mut m.clone(), *slot).law.as_str()))
    };
    each_law().into_iter().filter(|m| on.every_law || known(m)).collect()
}

/// The slots that act in every contact; bonds have to be made (`bonds.rs`).
const SLOTS: [Slot; 4] = [Slot::Normal, Slot::Tangential, Slot::Rolling, Slot::Cohesion];

/// Laws that are tested on every device.
pub const USUAL: [&str; 6] = ["hertz", "linear", "mindlin", "none", "constant-torque", "constant"];

/// Normal laws whose contacts yield: their energy depends on the way.
pub const YIELDING: [&str; 2] = ["luding", "eepa"];

/// Combinations of registered laws in which every two laws of different slots meet.
pub fn combinations() -> Vec<ContactModel> {
    let mut models = vec![ContactModel::default()];
    for slot in SLOTS {
        models = models
            .iter()
            .flat_map(|m| {
                laws(slot).iter().map(|info| {
                    let mut m = m.clone();
                    *slot_of(&mut m, slot) = choice(info);
                    m
                })
            })
            .collect();
    }
    let meetings = |m: &ContactModel| {
        let names = SLOTS.map(|slot| slot_of(&mut m.clone(), slot).law.clone());
        let pairs = (0..4).flat_map(|a| (a + 1..4).map(move |b| (a, b)));
        pairs.map(|(a, b)| (a, b, names[a].clone(), names[b].clone())).collect::<Vec<_>>()
    };
    let meetings: Vec<_> = models.iter().map(meetings).collect();
    let mut open: BTreeSet<_> = meetings.iter().flatten().collect();
    let mut chosen = Vec::new();
    while !open.is_empty() {
        let news = |k: &usize| meetings[*k].iter().filter(|x| open.contains(x)).count();
        // The first of those that bring the most.
        let k = (0..models.len()).rev().max_by_key(news).unwrap();
        meetings[k].iter().for_each(|x| {
            open.remove(x);
        });
        chosen.push(models[k].clone());
    }
    chosen
}

fn slot_of(m: &mut ContactModel, slot: Slot) -> &mut LawChoice {
    match slot {
        Slot::Normal => &mut m.normal,
        Slot::Tangential => &mut m.tangential,
        Slot::Rolling => &mut m.rolling,
        Slot::Cohesion => &mut m.cohesion,
        Slot::Bond => &mut m.bond,
    }
}

/// The laws' names, for messages.
pub fn label(m: &ContactModel) -> String {
    format!("{}/{}/{}/{}", m.normal.law, m.tangential.law, m.rolling.law, m.cohesion.law)
}

/// Whether the remembered floats of `m` start with the tangential spring.
pub fn has_spring(m: &ContactModel) -> bool {
    Layout::of(&[Laws::resolve(m).unwrap()]).floats() >= 4
}

/// Numbers in [0, 1) that are the same everywhere (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / 2_f64.powi(53)
    }

    /// A vector in the cube [-size, size]³.
    pub fn vector(&mut self, size: f64) -> Vec3 {
        [0; 3].map(|_| size * (2.0 * self.unit() - 1.0))
    }
}

/// A particle as a state tells it.
#[derive(Clone, Copy, Debug)]
pub struct Body {
    pub x: Vec3,
    pub v: Vec3,
    pub w: Vec3,
    pub mass: f64,
    pub radius: f64,
    /// Of the last step's contacts.
    pub force: Vec3,
    pub torque: Vec3,
}

/// A world that runs.
pub struct Run {
    pub c: Arc<Constants>,
    pub g: Progress,
    fleet: Box<dyn Fleet>,
}

impl Run {
    pub fn new(on: &Subject, spec: WorldSpec) -> Self {
        let (c, state) = prepare(on.fitted(spec)).unwrap();
        Self::resume(on, c, state)
    }

    pub fn resume(on: &Subject, c: Arc<Constants>, mut state: State) -> Self {
        let fleet = on.backend.fleet(vec![(c.clone(), &mut state)]);
        Self { c, g: state.progress, fleet }
    }

    pub fn steps(&mut self, n: u64) -> &mut Self {
        let mut job = [Job { world: 0, steps: n, progress: &mut self.g, outcome: Ok(()) }];
        self.fleet.advance(&mut job);
        let [job] = job;
        job.outcome.unwrap();
        self
    }

    pub fn state(&self) -> State {
        self.fleet.state(0, &self.g)
    }

    /// Replaces the state by an edited copy of it.
    pub fn edit(&mut self, change: impl FnOnce(&Constants, &mut State)) {
        let mut state = self.state();
        change(&self.c, &mut state);
        state.progress.stale = true;
        self.load(state);
    }

    /// Goes on from a state.
    pub fn load(&mut self, mut state: State) {
        self.fleet.load(0, &mut state);
        self.g = state.progress;
    }

    pub fn moment(&mut self) -> Moment {
        self.fleet.moment(0, &self.g)
    }

    pub fn detail(&mut self) -> Detail {
        let state = self.state();
        self.fleet.detail(0, &state)
    }

    /// The particles by their numbers.
    pub fn bodies(&self) -> Vec<Body> {
        bodies(&self.c, &self.state())
    }
}

/// Worlds that run together, each by its own number of steps.
pub struct Together {
    pub worlds: Vec<(Arc<Constants>, Progress)>,
    fleet: Box<dyn Fleet>,
}

impl Together {
    pub fn new(on: &Subject, specs: Vec<WorldSpec>) -> Self {
        Self::resume(on, specs.into_iter().map(|s| prepare(on.fitted(s)).unwrap()).collect())
    }

    pub fn resume(on: &Subject, mut worlds: Vec<(Arc<Constants>, State)>) -> Self {
        let fleet = on.backend.fleet(worlds.iter_mut().map(|(c, s)| (c.clone(), s)).collect());
        Self { worlds: worlds.into_iter().map(|(c, s)| (c, s.progress)).collect(), fleet }
    }

    /// Takes `steps[k]` steps of world k.
    pub fn advance(&mut self, steps: &[u64]) {
        for outcome in self.try_advance(steps) {
            outcome.unwrap();
        }
    }

    /// The same; says how each world with steps to take went.
    pub fn try_advance(&mut self, steps: &[u64]) -> Vec<Result<(), Failure>> {
        let mut jobs: Vec<_> = self
            .worlds
            .iter_mut()
            .zip(steps)
            .enumerate()
            .filter(|(_, (_, steps))| **steps > 0)
            .map(|(world, ((_, progress), &steps))| Job { world, steps, progress, outcome: Ok(()) })
            .collect();
        self.fleet.advance(&mut jobs);
        jobs.into_iter().map(|job| job.outcome).collect()
    }

    /// Takes `n` steps of every world.
    pub fn steps(&mut self, n: u64) {
        self.advance(&vec![n; self.worlds.len()]);
    }

    pub fn state(&self, world: usize) -> State {
        self.fleet.state(world, &self.worlds[world].1)
    }

    pub fn moment(&mut self, world: usize) -> Moment {
        self.fleet.moment(world, &self.worlds[world].1)
    }

    /// The particles of a world by their numbers.
    pub fn bodies(&self, world: usize) -> Vec<Body> {
        bodies(&self.worlds[world].0, &self.state(world))
    }
}

/// Keeps the last sample.
#[derive(Default)]
pub struct Last(pub Option<Sample>);

impl Observer for Last {
    type Error = Infallible;
    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), Infallible> {
        self.0 = Some(sample.clone());
        Ok(())
    }
}

pub fn bodies(c: &Constants, state: &State) -> Vec<Body> {
    let p = &state.particles;
    let lattice = c.lattice_now(&state.progress);
    let mut order: Vec<usize> = (0..p.len()).collect();
    order.sort_unstable_by_key(|&i| p.id[i]);
    order
        .into_iter()
        .map(|i| {
            let mass = 1.0 / f64::from(p.velocity[i].inv_mass);
            let radius = f64::from(p.place[i].radius);
            Body {
                x: lattice.decode(p.hi[i], p.place[i].lo, p.rest[i]),
                v: p.velocity[i].v.map(f64::from),
                w: p.spin[i].w.map(f64::from),
                mass,
                radius,
                force: p.force[i].map(f64::from),
                torque: p.angular[i].map(|x| 0.4 * mass * radius * radius * f64::from(x)),
            }
        })
        .collect()
}

/// `x` turned by `angle` \[rad\] about the unit vector `axis` (Rodrigues).
pub fn turned(x: Vec3, axis: Vec3, angle: f64) -> Vec3 {
    let (s, c) = angle.sin_cos();
    let along = scale(axis, dot(axis, x) * (1.0 - c));
    add(add(scale(x, c), scale(cross(axis, x), s)), along)
}

pub fn unit(x: Vec3) -> Vec3 {
    scale(x, 1.0 / norm(x))
}

/// Asserts `|a - b| ≤ bound`.
pub fn assert_near(what: &str, a: Vec3, b: Vec3, bound: f64) {
    let error = norm(sub(a, b));
    assert!(error <= bound, "{what}: {a:?} instead of {b:?}, off by {error:.3e}, more than {bound:.3e}");
}

/// Mass of a sphere of the material \[kg\].
pub fn sphere_mass(radius: f64, m: &Material) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * m.density
}

/// E* of two bodies of one material \[Pa\].
pub fn e_star(m: &Material) -> f64 {
    0.5 * m.youngs_modulus / (1.0 - m.poissons_ratio * m.poissons_ratio)
}
