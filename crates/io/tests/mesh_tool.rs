//! Tools made from parameters are solids of the promised size.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::f64::consts::TAU;
use std::{collections::HashMap, path::Path};

use glebe_engine::spec::{TriMesh, Vec3};
use glebe_io::{
    mesh::{MeshReport, StlFormat, Transform, read, write_stl},
    tool::{Blade, Drum, Mixer, Plough, Sweep, Tool, Wheel},
};

/// Asserts that every edge is run along once in each direction, without the library's own report, that the body has
/// no hole through it, and that its normals point outwards.
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
    assert!(volume(mesh) > 0.0, "normals point inwards");
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
    let blade = Blade { width: 0.4, height: 0.2, thickness: 0.01, resolution: 0.03, ..Blade::default() };
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

/// Area of a polygon of equal pieces: so many of them, each seen under this angle from the axis.
fn pieces(radius: f64, n: u32, angle: f64) -> f64 {
    0.5 * radius * radius * f64::from(n) * angle.sin()
}

/// Area of the polygon that `fins` with parallel sides leave of a circle, with `between` flat pieces between two.
fn finned_polygon(radius: f64, fins: u32, thickness: f64, between: u32) -> f64 {
    let fin = 2.0 * (0.5 * thickness / radius).asin();
    let piece = (TAU / f64::from(fins) - fin) / f64::from(between);
    pieces(radius, fins, fin) + pieces(radius, fins * between, piece)
}

/// Area of a fin between two radii: a rectangle.
fn fin(radii: [f64; 2], thickness: f64) -> f64 {
    let [inner, outer] = radii.map(|r| (r * r - 0.25 * thickness * thickness).sqrt());
    thickness * (outer - inner)
}

fn close(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-12, "{found} instead of {expected}");
}

#[test]
fn a_blade_with_a_rake_is_as_thick_as_it_should_be() {
    for (rake_angle, least) in [(30.0, -0.2 * 3f64.sqrt() - 0.02), (120.0, -0.02 / 3f64.sqrt())] {
        let blade = Blade { width: 0.4, height: 0.2, thickness: 0.01, rake_angle, resolution: 0.05 };
        let mesh = blade.mesh().unwrap();
        assert_watertight(&mesh);
        assert_symmetric(&mesh);
        let most = if rake_angle < 90.0 { 0.0 } else { 0.2 / 3f64.sqrt() };
        assert_bounds(&mesh, [least, -0.2, 0.0], [most, 0.2, 0.2], 1e-12);
        close(volume(&mesh), 0.4 * 0.2 * 0.01 / f64::to_radians(rake_angle).sin());
    }
}

#[test]
fn a_plough_turns_what_it_lifts_to_its_side() {
    let plough = Plough::default();
    for (left, low, high) in [(false, -0.35, 0.0), (true, 0.0, 0.35)] {
        let mesh = Plough { left, ..plough }.mesh().unwrap();
        assert_watertight(&mesh);
        // The point is the foremost on the ground, the share goes back from it at its angle.
        let ground: Vec<_> = mesh.vertices.iter().filter(|v| v[2] == 0.0).collect();
        let foremost = ground.iter().map(|v| v[0]).fold(f64::NEG_INFINITY, f64::max);
        assert!(foremost == 0.0 && ground.contains(&&[0.0; 3]));
        let rearmost = ground.iter().map(|v| v[0]).fold(0.0, f64::min);
        assert!((rearmost + 0.35 / 42f64.to_radians().tan() + 0.012).abs() < 1e-12);
        let across = |f: fn(f64, f64) -> f64| mesh.vertices.iter().map(|v| v[1]).fold(0.0, f);
        assert!((across(f64::min) - low).abs() < 1e-12 && (across(f64::max) - high).abs() < 1e-12);
        let top = mesh.vertices.iter().map(|v| v[2]).fold(0.0, f64::max);
        assert!(top == 0.35, "{top}");
        // Moved back by its thickness: what it covers seen along the travel, times that.
        close(volume(&mesh), 0.35 * 0.35 * 0.012);
        // The front pushes forward and to the side; its lowest part lifts, and its top hangs over.
        let to_side = if left { 1.0 } else { -1.0 };
        for [a, b, c] in corners(&mesh).filter(|t| t.iter().all(|v| in_front(&plough, *v))) {
            let (u, v) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
            let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
            assert!(n[0] > 0.0 && to_side * n[1] > 0.0, "{n:?}");
            let middle = (a[2] + b[2] + c[2]) / 3.0;
            assert!(if middle < 0.2 { n[2] > 0.0 } else { middle < 0.33 || n[2] < 0.0 }, "{middle}: {n:?}");
        }
    }
    // 21 columns of 25 mm along the share, 17 rows along the arc, 1 layer.
    let triangles = plough.mesh().unwrap().triangles.len();
    assert_eq!(triangles, 4 * (21 * 17 + 21 + 17));
}

/// Whether a vertex is on the front of the plough: on the arc of its height, moved back by the slant of its line.
fn in_front(p: &Plough, [x, y, z]: Vec3) -> bool {
    let [lift, curl] = [p.lift_angle, p.curl_angle].map(f64::to_radians);
    let radius = p.height / (lift.cos() - curl.cos());
    let angle = (lift.cos() - z / radius).acos();
    let slant = (p.share_angle + (p.top_angle - p.share_angle) * z / p.height).to_radians();
    (x - radius * (lift.sin() - angle.sin()) + y.abs() / slant.tan()).abs() < 1e-9
}

#[test]
fn a_wheel_is_a_prism_of_rim_and_grousers() {
    let wheel = Wheel::default();
    let mesh = wheel.mesh().unwrap();
    assert_watertight(&mesh);
    assert_symmetric(&mesh);
    let tip = 0.16_f64;
    assert!(mesh.vertices.iter().all(|v| v[0].hypot(v[2]) <= tip + 1e-12));
    assert_bounds(&mesh, [-tip, -0.08, -tip], [tip, 0.08, tip], 1e-4);
    let (n, t) = (wheel.grousers, wheel.grouser_thickness);
    let area = finned_polygon(0.15, n, t, 3) + f64::from(n) * fin([0.15, tip], t);
    close(volume(&mesh), 0.16 * area);
    // Halves of 3 triangles for each of the 72 pieces of the rim and 9 for each grouser.
    assert_eq!(mesh.triangles.len(), 2 * (3 * 72 + 9 * 24));

    let smooth = Wheel { grousers: 0, segments: 90, ..wheel }.mesh().unwrap();
    assert_watertight(&smooth);
    close(volume(&smooth), 0.16 * pieces(0.15, 90, TAU / 90.0));
    assert_eq!(smooth.triangles.len(), 2 * 3 * 90);
}

#[test]
fn a_drum_has_its_lifters_inside() {
    for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.6, 0.8]] {
        let smooth = Drum { axis, segments: 90, ..Drum::smooth(0.5, 2.0) };
        let mesh = smooth.mesh().unwrap();
        assert_watertight(&mesh);
        close(volume(&mesh), 2.0 * pieces(0.5, 90, TAU / 90.0));
        assert_eq!(mesh.triangles.len(), 4 * 90);

        let lifted = Drum { lifters: 6, lifter_height: 0.05, lifter_thickness: 0.04, ..smooth };
        let mesh = lifted.mesh().unwrap();
        assert_watertight(&mesh);
        // What is left inside: the shell less the lifters.
        close(volume(&mesh), 2.0 * (finned_polygon(0.5, 6, 0.04, 15) - 6.0 * fin([0.45, 0.5], 0.04)));
        let along = |v: &Vec3| (0..3).map(|k| v[k] * axis[k]).sum::<f64>();
        for v in &mesh.vertices {
            let r = (v.iter().map(|x| x * x).sum::<f64>() - along(v).powi(2)).max(0.0).sqrt();
            assert!(r < 1e-9 || (r - 0.5).abs() < 1e-9 || (r - 0.45).abs() < 1e-9, "{r}");
            assert!((along(v).abs() - 1.0).abs() < 1e-12);
        }
        // Without ends only these edges are open: those around and those of the lifters' sides.
        let open = Drum { ends: false, ..lifted }.mesh().unwrap();
        assert_eq!(open.triangles.len(), 6 * (2 * 15 + 2 + 4));
    }
}

#[test]
fn a_mixer_is_a_shaft_with_blades() {
    let mixer = Mixer { rows: 3, first_row: 0.02, ..Mixer::default() };
    let mesh = mixer.mesh().unwrap();
    assert_watertight(&mesh);
    assert_bounds(&mesh, [-0.1, -0.1, 0.0], [0.1, 0.1, 0.3], 1e-4);
    let (shaft, blade) = (finned_polygon(0.015, 4, 0.006, 8), fin([0.015, 0.1], 0.006));
    close(volume(&mesh), 0.3 * shaft + f64::from(3 * 4) * 0.04 * blade);

    // A pitch turns what stands above what; it neither adds nor takes more than facets do.
    let pitched = Mixer { pitch: 45.0, ..mixer }.mesh().unwrap();
    assert_watertight(&pitched);
    assert!((volume(&pitched) / volume(&mesh) - 1.0).abs() < 0.01, "{}", volume(&pitched));
    // At the tips the lower edge of a blade leads that rises while it turns positively: 45° of its height.
    let tips = |z: f64| -> Vec<f64> {
        let at = |v: &&Vec3| (v[2] - z).abs() < 1e-9 && v[0].hypot(v[1]) > 0.099;
        pitched.vertices.iter().filter(at).map(|v| v[1].atan2(v[0])).collect()
    };
    let (low, high) = (tips(0.02), tips(0.06));
    assert!(low.len() == 8 && high.len() == 8);
    let turned =
        |a: f64| high.iter().any(|b| (a - b - 0.4).rem_euclid(TAU).min((b + 0.4 - a).rem_euclid(TAU)) < 1e-9);
    assert!(low.iter().all(|a| turned(*a)), "{low:?} {high:?}");
    for shape in [
        Mixer { blades: 1, ..mixer },
        Mixer { pitch: -60.0, blades: 3, ..mixer },
        Mixer { rows: 1, first_row: 0.26, ..mixer },
        Mixer { rows: 1, first_row: 0.0, blade_height: 0.3, ..mixer },
    ] {
        assert_watertight(&shape.mesh().unwrap());
    }
}

#[test]
fn tools_out_of_range_are_refused_with_the_range() {
    let (wheel, drum) = (Wheel::default(), Drum::smooth(0.2, 0.3));
    let (plough, mixer) = (Plough::default(), Mixer::default());
    let lifted = Drum { lifters: 8, lifter_height: 0.02, lifter_thickness: 0.01, ..drum };
    let refused = |tool: Tool| tool.mesh().unwrap_err().to_string();
    assert_eq!(
        refused(Tool::Wheel(Wheel { grouser_thickness: 0.05, ..wheel })),
        "wheel: grouser_thickness = 0.05 m is not allowed; it must lie between 1.5e-5 and 0.0353 m \
         (a tenth of the rim must be left between the grousers)"
    );
    for (name, tool) in [
        ("rake_angle", Tool::Blade(Blade { rake_angle: 5.0, ..Blade::default() })),
        ("width", Tool::Plough(Plough { width: f64::NAN, ..plough })),
        ("height", Tool::Plough(Plough { height: 11.0, ..plough })),
        ("share_angle", Tool::Plough(Plough { share_angle: 10.0, ..plough })),
        ("top_angle", Tool::Plough(Plough { top_angle: 91.0, ..plough })),
        ("lift_angle", Tool::Plough(Plough { lift_angle: 86.0, ..plough })),
        ("curl_angle", Tool::Plough(Plough { curl_angle: 25.0, ..plough })),
        ("thickness", Tool::Plough(Plough { thickness: 0.2, ..plough })),
        ("resolution", Tool::Plough(Plough { resolution: 1e-5, ..plough })),
        ("radius", Tool::Wheel(Wheel { radius: 0.0, ..wheel })),
        ("width", Tool::Wheel(Wheel { width: f64::INFINITY, ..wheel })),
        ("segments", Tool::Wheel(Wheel { segments: 2, ..wheel })),
        ("grousers", Tool::Wheel(Wheel { grousers: 1, ..wheel })),
        ("grouser_height", Tool::Wheel(Wheel { grouser_height: 0.2, ..wheel })),
        ("radius", Tool::Drum(Drum { radius: -1.0, ..drum })),
        ("length", Tool::Drum(Drum { length: 0.0, ..drum })),
        ("segments", Tool::Drum(Drum { segments: 100_001, ..drum })),
        ("lifters", Tool::Drum(Drum { lifters: 1, ..lifted })),
        ("lifter_height", Tool::Drum(Drum { lifter_height: 0.19, ..lifted })),
        ("lifter_thickness", Tool::Drum(Drum { lifter_thickness: 0.2, ..lifted })),
        ("radius", Tool::Mixer(Mixer { radius: 1e3, ..mixer })),
        ("shaft_radius", Tool::Mixer(Mixer { shaft_radius: 0.1, ..mixer })),
        ("shaft_length", Tool::Mixer(Mixer { shaft_length: 0.0, ..mixer })),
        // As fine as it would be, this takes more memory than there is.
        ("shaft_length", Tool::Mixer(Mixer { shaft_length: 100.0, pitch: 75.0, ..mixer })),
        (
            "resolution",
            Tool::Plough(Plough { width: 0.01, height: 10.0, thickness: 1e-3, resolution: 1e-4, ..plough }),
        ),
        ("blades", Tool::Mixer(Mixer { blades: 0, ..mixer })),
        ("blade_height", Tool::Mixer(Mixer { blade_height: 0.31, ..mixer })),
        ("blade_thickness", Tool::Mixer(Mixer { blade_thickness: 0.03, ..mixer })),
        ("pitch", Tool::Mixer(Mixer { pitch: 80.0, ..mixer })),
        ("rows", Tool::Mixer(Mixer { rows: 0, ..mixer })),
        ("first_row", Tool::Mixer(Mixer { first_row: 0.27, ..mixer })),
        ("row_spacing", Tool::Mixer(Mixer { rows: 2, row_spacing: 0.04, ..mixer })),
        ("segments", Tool::Mixer(Mixer { segments: 0, ..mixer })),
    ] {
        assert_eq!(tool.mesh().unwrap_err().name, name, "{tool:?}");
    }
}
