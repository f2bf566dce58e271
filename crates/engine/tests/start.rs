//! Where particles are when a world begins.

// Clippy's permission for tests does not reach their helpers.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;

use glebe_engine::prepare;
use glebe_engine::spec::{
    Domain, Motion, Pose, Shape, Side, Stage, Step, Surface, Time, TriMesh, Vec3, WorldSpec,
};
use glebe_engine::surface::quaternion;
use glebe_physics::{IntegratorKind, Material};

/// The warnings of a world with grains of 1 mm `at` these places and a block of 0.2 m, turned askew around
/// (0.5, 0.5, `z`), in a box of one metre that is periodic along z. `missing` triangles are taken out.
fn warnings(at: &[Vec3], z: f64, missing: usize) -> Vec<String> {
    let sides = [[Side::Wall; 2], [Side::Wall; 2], [Side::Periodic; 2]];
    let domain = Domain::aligned([0.0; 3], [1.0; 3], sides, Some(0));
    let time = Time { step: Step::Fixed(1e-6), integrator: IntegratorKind::Euler, force: false };
    let mut w = WorldSpec::new(domain, time);
    w.materials.push(Material {
        name: "grain".to_owned(),
        density: 2500.0,
        youngs_modulus: 1e7,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.0,
    });
    w.stages = vec![Stage::default()];
    let vertices = (0..8).map(|k| [0, 1, 2].map(|a| if k >> a & 1 == 0 { -0.1 } else { 0.1 })).collect();
    let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let mut triangles: Vec<[u32; 3]> =
        faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    triangles.truncate(12 - missing);
    let pose = Pose { translation: [0.5, 0.5, z], rotation: quaternion([0.6, 0.0, 0.8], 0.4) };
    w.surfaces = vec![Surface {
        name: "block".to_owned(),
        material: 0,
        shape: Shape::Mesh(Arc::new(TriMesh { vertices, triangles })),
        pose,
        motion: Motion::default(),
        absent: false,
    }];
    for x in at {
        w.particles.push(*x, 1e-3, 0);
    }
    prepare(w).unwrap().0.warnings.clone()
}

#[test]
fn grains_deep_inside_a_tool_are_told() {
    let within = [[0.5, 0.5, 0.5], [0.55, 0.45, 0.52], [0.43, 0.56, 0.44]];
    let outside = [[0.5, 0.5, 0.2], [0.5, 0.8, 0.5], [0.1, 0.1, 0.1], [0.65, 0.65, 0.65], [0.5, 0.5, 0.75]];
    let all = [&within[..], &outside[..]].concat();
    let told = warnings(&all, 0.5, 0);
    assert!(told.len() == 1 && told[0].contains("3 of 8") && told[0].contains("`block`"), "{told:?}");
    // A vessel that holds them all, a tool that holds none, and a surface without an inside.
    let nothing: [String; 0] = [];
    assert_eq!(warnings(&within, 0.5, 0), nothing);
    assert_eq!(warnings(&outside, 0.5, 0), nothing);
    assert_eq!(warnings(&all, 0.5, 1), nothing);
    // Through the seam of z: the block stands two periods up, half of it below the seam.
    let told = warnings(&[[0.5, 0.5, 0.05], [0.5, 0.5, 0.95], [0.5, 0.5, 0.5]], 2.0, 0);
    assert!(told.len() == 1 && told[0].contains("2 of 3"), "{told:?}");
}

/// Among many triangles the ray finds those that it crosses.
#[test]
fn a_ball_encloses_what_is_nearer_than_its_radius() {
    let (rings, sectors) = (24_u32, 48_u32);
    let point = |i: u32, j: u32| {
        let (a, b) = (
            std::f64::consts::PI * f64::from(i) / f64::from(rings),
            std::f64::consts::TAU * f64::from(j) / f64::from(sectors),
        );
        [a.sin() * b.cos(), a.sin() * b.sin(), a.cos()]
    };
    let mut vertices = vec![[0.0, 0.0, 1.0]];
    for i in 1..rings {
        vertices.extend((0..sectors).map(|j| point(i, j)));
    }
    vertices.push([0.0, 0.0, -1.0]);
    let south = vertices.len() as u32 - 1;
    let at = |i: u32, j: u32| match i {
        0 => 0,
        i if i == rings => south,
        i => 1 + (i - 1) * sectors + j % sectors,
    };
    let mut triangles = Vec::new();
    for (i, j) in (0..rings).flat_map(|i| (0..sectors).map(move |j| (i, j))) {
        let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        triangles.extend((i + 1 < rings).then_some([quad[0], quad[1], quad[2]]));
        triangles.extend((i > 0).then_some([quad[0], quad[2], quad[3]]));
    }
    let mesh = TriMesh { vertices, triangles };
    assert!(mesh.is_closed());
    let bvh = glebe_engine::surface::Bvh::new(&mesh);
    let mut seen = [0; 2];
    for k in 0..21_u32.pow(3) {
        let x = [k % 21, k / 21 % 21, k / 441].map(|a| 0.12 * (f64::from(a) - 10.0));
        let r = glebe_engine::lattice::norm(x);
        // Facets lie up to 1 % below the sphere.
        if !(0.99..=1.0).contains(&r) {
            assert_eq!(bvh.encloses(&mesh, x), r < 1.0, "{x:?}");
            seen[usize::from(r < 1.0)] += 1;
        }
    }
    assert!(seen.iter().all(|&n| n > 2000), "{seen:?}");
}
