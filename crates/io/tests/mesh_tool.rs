//! Tools made from parameters are solids of the promised size.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::{collections::HashMap, path::Path};

use glebe_engine::spec::{TriMesh, Vec3};
use glebe_io::{
    mesh::{MeshReport, StlFormat, Transform, read, write_stl},
    tool::{Blade, Sweep},
};

/// Asserts that every edge is run along once in each direction, without the library's own report.
fn assert_watertight(mesh: &TriMesh) {
    let mut edges: HashMap<(u32, u32), [usize; 2]> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            edges.entry((a.min(b), a.max(b))).or_default()[usize::from(a < b)] += 1;
        }
    }
    assert!(edges.values().all(|n| *n == [1, 1]));
    // Euler's formula for a body without holes.
    assert_eq!(mesh.vertices.len() + mesh.triangles.len(), edges.len() + 2);
}

fn corners(mesh: &TriMesh) -> impl Iterator<Item = [Vec3; 3]> {
    mesh.triangles.iter().map(|t| t.map(|i| mesh.vertices[i as usize]))
}

fn volume(mesh: &TriMesh) -> f64 {
    corners(mesh)
        .map(|[a, b, c]| {
            a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0])
        })
        .sum::<f64>()
        / 6.0
}

fn assert_bounds(mesh: &TriMesh, min: Vec3, max: Vec3, tolerance: f64) {
    for k in 0..3 {
        let least = mesh.vertices.iter().map(|v| v[k]).fold(f64::INFINITY, f64::min);
        let most = mesh.vertices.iter().map(|v| v[k]).fold(f64::NEG_INFINITY, f64::max);
        assert!((least - min[k]).abs() < tolerance, "axis {k}: {least}");
        assert!((most - max[k]).abs() < tolerance, "axis {k}: {most}");
    }
}

fn assert_symmetric(mesh: &TriMesh) {
    let bits = |v: Vec3, sign: f64| [v[0] + 0.0, sign * v[1] + 0.0, v[2] + 0.0].map(f64::to_bits);
    let key = |t: [Vec3; 3], sign: f64| {
        let mut key = t.map(|v| bits(v, sign));
        key.sort_unstable();
        key
    };
    let mut own: Vec<_> = corners(mesh).map(|t| key(t, 1.0)).collect();
    let mut image: Vec<_> = corners(mesh).map(|t| key(t, -1.0)).collect();
    own.sort_unstable();
    image.sort_unstable();
    assert_eq!(own, image);
}

fn reread(mesh: &TriMesh, name: &str, format: StlFormat) -> MeshReport {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    write_stl(&path, mesh, "tool", format).unwrap();
    read(&path, &Transform::default()).unwrap().1
}

#[test]
fn the_default_sweep_is_a_closed_body_of_313_by_289_mm() {
    for resolution in [0.289, 0.05, 0.012, 0.006] {
        let sweep = Sweep { resolution, ..Sweep::default() };
        let mesh = sweep.mesh().unwrap();
        assert_watertight(&mesh);
        assert_symmetric(&mesh);
        assert_bounds(&mesh, [-0.289, -0.1565, 0.0], [0.0, 0.1565, 0.4], 1e-12);
        // The nose is the only point at x = 0 on the ground.
        let nose = mesh.vertices.iter().filter(|v| v[0] == 0.0 && v[2] == 0.0).collect::<Vec<_>>();
        assert_eq!(nose, [&[0.0; 3]]);
        for format in [StlFormat::Ascii, StlFormat::Binary] {
            let report = reread(&mesh, &format!("sweep-{resolution}.stl"), format);
            assert_eq!(
                (report.triangles, report.degenerate, report.duplicates),
                (mesh.triangles.len(), 0, 0)
            );
            assert!(report.is_closed() && report.flipped == 0 && report.parts == 1);
            assert!(report.volume.unwrap() > 0.0);
        }
    }
}

#[test]
fn the_volume_is_plate_plus_shank() {
    // Without bevel and lift: plan area × thickness + foot × height above the plate.
    let sweep = Sweep {
        lift_angle: 0.0,
        edge_thickness: 0.006,
        thickness: 0.006,
        shank_lean: 20.0,
        resolution: 0.02,
        ..Sweep::default()
    };
    let wing_end = 0.289 - 0.1565 / 33f64.to_radians().tan();
    let plate = f64::midpoint(0.150, wing_end) * 0.313 * 0.006;
    let shank = 0.05 * 0.02 * (0.4 - 0.006);
    let found = volume(&sweep.mesh().unwrap());
    assert!((found / (plate + shank) - 1.0).abs() < 1e-12, "{found}");
}

#[test]
fn resolution_reaches_the_models_of_the_paper() {
    // GPUDEM (2024), Fig. A.17: 500 triangles in the reduced model, 14 304 in the scan.
    let count = |resolution| Sweep { resolution, ..Sweep::default() }.mesh().unwrap().triangles.len();
    assert!((400..=600).contains(&count(0.050)), "{}", count(0.050));
    assert!((14_304..=17_000).contains(&count(0.006)), "{}", count(0.006));
}

#[test]
fn every_allowed_shape_is_a_closed_body() {
    let base = Sweep { resolution: 0.02, ..Sweep::default() };
    let shapes = [
        Sweep { sweep_angle: 90.0, ..base },
        Sweep { sweep_angle: 150.0, bevel: 0.02, ..base },
        Sweep { lift_angle: 0.0, ..base },
        Sweep { lift_angle: 60.0, shank_lean: -45.0, ..base },
        Sweep { shank_lean: 45.0, ..base },
        Sweep { body_length: 0.289, shank_setback: 0.15, ..base },
        Sweep { edge_thickness: base.thickness, ..base },
        Sweep { shank_thickness: 0.06, shank_setback: 0.09, ..base },
        Sweep {
            width: 0.05,
            length: 0.06,
            body_length: 0.04,
            thickness: 0.001,
            edge_thickness: 0.0002,
            bevel: 0.001,
            shank_width: 0.01,
            shank_thickness: 0.004,
            shank_height: 0.05,
            shank_setback: 0.015,
            ..base
        },
    ];
    for shape in shapes {
        let mesh = shape.mesh().unwrap();
        assert_watertight(&mesh);
        assert!(volume(&mesh) > 0.0);
        let (half, end) = (0.5 * shape.width, shape.shank_height);
        let across = |k: usize, f: fn(f64, f64) -> f64| mesh.vertices.iter().map(|v| v[k]).fold(0.0, f);
        assert!((across(1, f64::max) - half).abs() < 1e-12);
        assert!((across(2, f64::max) - end).abs() < 1e-12);
        assert!(across(2, f64::min) == 0.0);
    }
}

#[test]
fn measures_out_of_range_are_refused_with_the_range() {
    let base = Sweep::default();
    let refused = |sweep: Sweep| sweep.mesh().unwrap_err().to_string();
    assert_eq!(
        refused(Sweep { width: -0.3, ..base }),
        "sweep: width = -0.3 m is not allowed; it must lie between 0.0100 and 10.0000 m (size of a tool)"
    );
    assert_eq!(
        refused(Sweep { sweep_angle: 50.0, ..base }),
        "sweep: sweep_angle = 50 deg is not allowed; it must lie between 59.3683 and 150.0000 deg \
         (leading edges must reach the width within 95 % of the length)"
    );
    for (name, sweep) in [
        ("length", Sweep { length: f64::NAN, ..base }),
        ("lift_angle", Sweep { lift_angle: 61.0, ..base }),
        ("body_length", Sweep { body_length: 0.3, ..base }),
        ("thickness", Sweep { thickness: 0.0, ..base }),
        ("edge_thickness", Sweep { edge_thickness: 0.007, ..base }),
        ("bevel", Sweep { bevel: 0.03, ..base }),
        ("shank_thickness", Sweep { shank_thickness: 0.2, ..base }),
        ("shank_setback", Sweep { shank_setback: 0.01, ..base }),
        ("shank_width", Sweep { shank_width: 0.1, ..base }),
        ("shank_height", Sweep { shank_height: 0.03, ..base }),
        ("shank_lean", Sweep { shank_lean: f64::INFINITY, ..base }),
        ("resolution", Sweep { resolution: 0.0, ..base }),
    ] {
        assert_eq!(sweep.mesh().unwrap_err().name, name);
    }
}

#[test]
fn a_blade_is_a_closed_box() {
    let blade = Blade { width: 0.4, height: 0.2, thickness: 0.01, resolution: 0.03 };
    let mesh = blade.mesh().unwrap();
    assert_watertight(&mesh);
    assert_symmetric(&mesh);
    assert_bounds(&mesh, [-0.01, -0.2, 0.0], [0.0, 0.2, 0.2], 1e-12);
    assert!((volume(&mesh) / 8e-4 - 1.0).abs() < 1e-12);
    // 14 columns, 7 rows, 1 layer.
    assert_eq!(mesh.triangles.len(), 4 * (14 * 7 + 14 + 7));
    let error = Blade { resolution: 1.0, ..blade }.mesh().unwrap_err();
    assert_eq!((error.name, error.max), ("resolution", 0.4));
}
