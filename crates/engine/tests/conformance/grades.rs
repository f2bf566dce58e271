//! Every pair is found, whatever the sizes and the search.

use glebe_engine::lattice::{add, norm, scale, sub};
use glebe_engine::spec::{Deformation, Domain, Drive, Search, Side, Stage, Until, Vec3, WorldSpec};
use glebe_physics::{ContactModel, IntegratorKind, LawChoice, Material};

use crate::support::{Body, CPU, Random, Run, Subject, Together, grain, open_world};

const LARGE: f64 = 2e-3;
const SIDE: f64 = 0.016;

/// The difference of two places in a box that is periodic along x and y.
fn apart(a: Vec3, b: Vec3) -> Vec3 {
    let d = sub(a, b);
    [d[0] - SIDE * (d[0] / SIDE).round(), d[1] - SIDE * (d[1] / SIDE).round(), d[2]]
}

/// 8 large spheres, 24 of half to a tenth of their radius and `few` of 1/`ratio` of it, which touch one of them each, all
/// moving, in a box that is periodic along x and y.
fn graded(ratio: f64, few: usize, seed: u64) -> WorldSpec {
    // So soft that they touch as long as the run lasts.
    let soft = Material { youngs_modulus: 1e5, ..grain(0.5, 0.4) };
    let mut w = open_world([0.0; 3], 0.1, 2e-7, soft);
    let sides = [[Side::Periodic; 2], [Side::Periodic; 2], [Side::Open; 2]];
    w.domain = Domain::aligned([0.0, 0.0, -SIDE], [SIDE, SIDE, 2.0 * SIDE], sides, Some(0));
    w.time.integrator = IntegratorKind::ALL[seed as usize % 4];
    let mut r = Random(seed);
    let least = ratio.recip().max(0.1);
    let mut bodies: Vec<(Vec3, f64)> = Vec::new();
    for i in 0..8 {
        let at = [i % 2, i / 2 % 2, i / 4].map(|k| 0.5 * SIDE * (0.02 + f64::from(k)));
        bodies.push((at, LARGE));
    }
    while bodies.len() < 32 + few {
        let radius =
            if bodies.len() < 32 { LARGE * (least + (0.5 - least) * r.unit()) } else { LARGE / ratio };
        let (on, size) = bodies[(r.unit() * bodies.len().min(32) as f64) as usize];
        let way = r.vector(1.0);
        let x = add(on, scale(way, (size + 0.9 * radius) / norm(way)));
        let x = [x[0].rem_euclid(SIDE), x[1].rem_euclid(SIDE), x[2]];
        if bodies.iter().all(|(y, s)| norm(apart(x, *y)) > s + radius - 0.13 * radius.min(*s)) {
            bodies.push((x, radius));
        }
    }
    for (x, radius) in bodies {
        // Faster than lists last, and slowly apart.
        w.particles.push_moving(x, radius, 0, add([9.0, -6.0, 4.0], r.vector(0.05)), r.vector(20.0));
    }
    w
}

/// After rebuilds of its own a backend finds the forces that the CPU finds.
pub fn wide_gradings_step_as_on_the_cpu(on: &Subject) {
    for (ratio, few, deforms) in [(2.5, 40, false), (10.0, 300, false), (20.0, 600, false), (10.0, 300, true)]
    {
        let mut spec = graded(ratio, few, 3);
        if deforms {
            let sides = [[Side::Periodic; 2]; 3];
            spec.domain = Domain::aligned([0.0, 0.0, -SIDE], [SIDE, SIDE, 2.0 * SIDE], sides, Some(0));
            spec.time.integrator = IntegratorKind::ALL[0];
            let rates = [-20.0, 5.0, 0.0, 0.0, 30.0, 0.0];
            let deformation = Deformation { drive: rates.map(Drive::Rate), ..Deformation::default() };
            let until = Until { at_most: Some(1.0), ..Until::default() };
            spec.stages = vec![Stage {
                name: "shear".to_owned(),
                until,
                deformation: Some(deformation),
                ..Stage::default()
            }];
        }
        let name = format!("1:{ratio}, deforms {deforms}");
        let mut run = Run::new(on, spec.clone());
        let mut same = Run::new(&CPU, spec);
        run.steps(200);
        same.steps(200);
        // Spins tell whether springs were kept.
        let (mine, theirs) = (run.bodies(), same.bodies());
        let fastest = theirs.iter().map(|b| norm(b.w)).fold(0.0, f64::max);
        for (i, (a, b)) in mine.iter().zip(&theirs).enumerate() {
            let off = norm(sub(a.w, b.w));
            assert!(off <= on.bounds.trajectory.spin * fastest, "{name}: spin of {i} off by {off:.2e} rad/s");
        }
        let state = run.state();
        assert!(state.progress.rebuilds > 1, "{name}: lists were never rebuilt");
        let mut other = Run::resume(&CPU, run.c.clone(), state);
        assert!(other.detail().network.len() > few / 2, "{name}: {} contacts", other.detail().network.len());
        run.steps(1);
        other.steps(1);
        let (mine, theirs) = (run.bodies(), other.bodies());
        let largest = theirs.iter().map(|b| norm(b.force)).fold(0.0, f64::max);
        assert!(largest > 0.0);
        for (i, (a, b)) in mine.iter().zip(&theirs).enumerate() {
            let off = norm(sub(a.force, b.force));
            assert!(
                off <= on.bounds.force * largest,
                "{name}: force on {i} off by {off:.2e} of {largest:.2e} N"
            );
        }
    }
}

/// Worlds of a batch may have other classes, one among them.
pub fn graded_worlds_equal_themselves_in_a_batch(on: &Subject) {
    equal_themselves(
        on,
        &[graded(10.0, 100, 2), graded(20.0, 150, 5), graded(2.5, 30, 2), graded(10.0, 60, 6)],
    );
}

/// Worlds of a batch may find their neighbours in other ways, and there may be several sizes of a hierarchy.
pub fn worlds_of_every_search_equal_themselves_in_a_batch(on: &Subject) {
    let found = |search, ratio, few| searched(search, graded(ratio, few, 5));
    equal_themselves(
        on,
        &[
            found(Search::Bvh, 2.5, 30),
            found(Search::AllPairs, 10.0, 100),
            found(Search::Grid, 2.5, 20),
            found(Search::Bvh, 10.0, 400),
            found(Search::Bvh, 20.0, 150),
        ],
    );
}

fn searched(search: Search, mut spec: WorldSpec) -> WorldSpec {
    spec.search = search;
    spec
}

/// Worlds end alone, and in parts of which one begins with a state that was stored, as they do together.
fn equal_themselves(on: &Subject, specs: &[WorldSpec]) {
    let steps = 150;
    let mut batch = Together::new(on, specs.to_vec());
    // Where jobs end devices round what they account.
    let (part, rest) = (60, steps - 60);
    batch.steps(part);
    batch.steps(rest);
    for (w, spec) in specs.iter().enumerate() {
        let mut alone = Run::new(on, spec.clone());
        alone.steps(part);
        let mut resumed = Run::resume(on, alone.c.clone(), alone.state());
        alone.steps(rest);
        assert_eq!(batch.state(w).hash(), alone.state().hash(), "world {w}");
        resumed.steps(rest);
        assert_eq!(batch.state(w).hash(), resumed.state().hash(), "world {w} resumed");
    }
}

/// How the radii of a cloud are spread from the largest down.
#[derive(Clone, Copy, Debug)]
enum Spread {
    /// Evenly by number.
    Even,
    /// Evenly in ratios of size.
    Log,
    /// One large for nine small.
    Two,
    /// Halves of halves, where classes begin, and the smallest.
    Halves,
}

/// Stiffness of the clouds' springs \[N/m\]: they hardly change how spheres move.
const SOFT: f64 = 1e-3;

/// Spheres anywhere, through each other, each on its way, in a cell that may be skewed.
fn cloud(ratio: f64, spread: Spread, count: usize, periodic: [bool; 3], skew: f64, seed: u64) -> WorldSpec {
    let mut r = Random(seed);
    let mut w = open_world([0.0; 3], 0.1, 1e-6, grain(1.0, 0.0));
    let size = [0; 3].map(|_| LARGE * (6.3 + 3.0 * r.unit()));
    let sides = periodic.map(|wraps| [if wraps { Side::Periodic } else { Side::Open }; 2]);
    w.domain = Domain::aligned([0.0; 3], size, sides, Some(0));
    w.domain.cell[0][1] = skew * size[1];
    w.domain.cell[1][2] = -skew * size[2];
    w.contact = ContactModel {
        normal: LawChoice::named("linear").with("stiffness", SOFT),
        tangential: LawChoice::named("none"),
        rolling: LawChoice::named("none"),
        ..ContactModel::default()
    };
    for i in 0..count {
        let least = LARGE / ratio;
        let radius = match spread {
            Spread::Even => least + (LARGE - least) * r.unit(),
            Spread::Log => least * ratio.powf(r.unit()),
            Spread::Two => {
                if i % 10 == 0 {
                    LARGE
                } else {
                    least
                }
            }
            Spread::Halves => (LARGE * 0.5_f64.powi((5.0 * r.unit()) as i32)).max(least),
        };
        // Off the ends of open axes.
        let at = [0, 1, 2].map(|k| if periodic[k] { r.unit() } else { 0.05 + 0.9 * r.unit() });
        let x = [0, 1, 2].map(|k| (0..3).map(|q| w.domain.cell[k][q] * at[q]).sum());
        w.particles.push_moving(x, if i == 0 { LARGE } else { radius }, 0, r.vector(1.0), [0.0; 3]);
    }
    w
}

/// The forces of all pairs, and the sums of their sizes.
fn of_all_pairs(spec: &WorldSpec, bodies: &[Body]) -> Vec<(Vec3, f64)> {
    let cell = spec.domain.cell;
    let images = [0, 1, 2].map(|k| if spec.domain.sides[k][0] == Side::Periodic { -1..=1 } else { 0..=0 });
    let mut shifts = Vec::new();
    for a in images[0].clone() {
        for b in images[1].clone() {
            for c in images[2].clone() {
                let n = [a, b, c].map(f64::from);
                shifts.push([0, 1, 2].map(|k| (0..3).map(|q| cell[k][q] * n[q]).sum::<f64>()));
            }
        }
    }
    let mut forces = vec![([0.0; 3], 0.0); bodies.len()];
    for (i, a) in bodies.iter().enumerate() {
        for (j, b) in bodies.iter().enumerate().take(i) {
            let between = sub(a.x, b.x);
            for shift in &shifts {
                let d = add(between, *shift);
                let deep = a.radius + b.radius - norm(d);
                if deep > 0.0 {
                    let force = scale(d, SOFT * deep / norm(d));
                    forces[i] = (add(forces[i].0, force), forces[i].1 + norm(force));
                    forces[j] = (sub(forces[j].0, force), forces[j].1 + norm(force));
                }
            }
        }
    }
    forces
}

const ALL: [bool; 3] = [true; 3];
const SOME: [bool; 3] = [true, false, true];
const NONE: [bool; 3] = [false; 3];

/// Radii from the largest to this share of it, how they are spread, spheres, periodic axes and skew of a cloud.
type Cloud = (f64, Spread, usize, [bool; 3], f64);

/// Clouds of many gradings feel what all their pairs do, found without lists, and go on to while lists are made anew.
pub fn gradings_feel_all_pairs(on: &Subject) {
    use Spread::{Even, Halves, Log, Two};
    let clouds = [
        (1.0, Even, 60, ALL, 0.0),
        (3.05, Even, 80, SOME, 0.0),
        (3.5, Two, 150, ALL, 0.0),
        (5.0, Log, 150, NONE, 0.0),
        (6.5, Halves, 200, ALL, 0.0),
        (10.0, Log, 300, SOME, 0.0),
        (10.0, Two, 900, NONE, 0.0),
        (14.0, Halves, 250, [false, true, false], 0.0),
        (20.0, Even, 60, ALL, 0.0),
        (20.0, Log, 500, ALL, 0.0),
        (20.0, Two, 400, SOME, 0.0),
        (100.0, Log, 300, ALL, 0.0),
        (5.0, Log, 150, ALL, 0.2),
        (12.0, Two, 600, NONE, 0.1),
        (20.0, Log, 400, ALL, 0.2),
    ];
    feel_all_pairs(on, &clouds.map(|cloud| (cloud, Search::Grid)));
}

/// So do those whose neighbours are found without a grid.
pub fn searches_feel_all_pairs(on: &Subject) {
    use Spread::{Even, Halves, Log, Two};
    let clouds = [
        (1.0, Even, 60, ALL, 0.0),
        (3.0, Even, 20, SOME, 0.0),
        (6.5, Halves, 200, ALL, 0.0),
        (10.0, Log, 300, SOME, 0.0),
        (10.0, Two, 900, NONE, 0.0),
        (100.0, Log, 600, ALL, 0.0),
        (12.0, Two, 600, NONE, 0.1),
        (20.0, Log, 400, ALL, 0.2),
    ];
    let searches = [Search::Bvh, Search::AllPairs];
    let both: Vec<_> = clouds.iter().flat_map(|cloud| searches.map(|search| (*cloud, search))).collect();
    feel_all_pairs(on, &both);
}

fn feel_all_pairs(on: &Subject, clouds: &[(Cloud, Search)]) {
    let specs: Vec<WorldSpec> = (1..)
        .zip(clouds)
        .map(|(seed, ((ratio, spread, count, periodic, skew), search))| {
            searched(*search, cloud(*ratio, *spread, *count, *periodic, *skew, seed))
        })
        .collect();
    let mut worlds = Together::new(on, specs.clone());
    for _ in 0..3 {
        let before: Vec<Vec<Body>> = (0..specs.len()).map(|w| worlds.bodies(w)).collect();
        worlds.steps(1);
        for (w, spec) in specs.iter().enumerate() {
            let right = of_all_pairs(spec, &before[w]);
            assert!(
                right.iter().filter(|(_, size)| *size > 0.0).count() > right.len() / 4,
                "{:?}",
                clouds[w]
            );
            for (i, (b, (force, size))) in worlds.bodies(w).iter().zip(&right).enumerate() {
                let off = norm(sub(b.force, *force));
                assert!(off <= 1e-4 * size, "{:?}: force on {i} off by {:.2e}", clouds[w], off / size);
            }
        }
        worlds.steps(99);
    }
    for (w, (_, progress)) in worlds.worlds.iter().enumerate() {
        assert!(progress.rebuilds > 1, "{:?}: lists were never rebuilt", clouds[w]);
    }
}
