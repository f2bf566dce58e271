//! Meshes as people export them: the same body in every format, damaged files, and what the report says.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::{
    f64::consts::{FRAC_PI_2, PI},
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use glebe_engine::spec::{TriMesh, Vec3};
use glebe_io::mesh::{MeshReport, StlFormat, Transform, TransformError, read, write_stl};

fn file(name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mesh-{name}"));
    fs::write(&path, content).unwrap();
    path
}

fn plain(path: &Path) -> (TriMesh, MeshReport) {
    read(path, &Transform::default()).unwrap()
}

/// The message for a file called `name`, without its folder.
fn message(name: &str, content: impl AsRef<[u8]>) -> String {
    let path = file(name, content);
    let error = read(&path, &Transform::default()).unwrap_err().to_string();
    error.replace(&path.display().to_string(), "FILE")
}

/// Corners of a box of 0.5 × 0.25 × 0.125 m (exact in binary), numbered by bits x, y, z.
fn corner(index: usize) -> Vec3 {
    let side = |bit: usize, length: f64| if index & bit == 0 { 0.0 } else { length };
    [side(1, 0.5), side(2, 0.25), side(4, 0.125)]
}

/// Faces of the box, counter-clockwise from outside.
const FACES: [[usize; 4]; 6] =
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

fn triangles() -> Vec<[usize; 3]> {
    FACES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

fn ascii(triangles: &[[usize; 3]]) -> String {
    let mut text = "solid box\n".to_owned();
    for triangle in triangles {
        text.push_str("facet normal 0 0 0\n outer loop\n");
        for &index in triangle {
            let [x, y, z] = corner(index);
            writeln!(text, "  vertex {x} {y:e} {z:.9}").unwrap();
        }
        text.push_str(" endloop\nendfacet\n");
    }
    text + "endsolid box\n"
}

fn binary(header: &str, triangles: &[[usize; 3]]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        bytes.extend([0; 12]);
        for &index in triangle {
            bytes.extend(corner(index).iter().flat_map(|c| (*c as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn obj(face: impl Fn(usize) -> String) -> String {
    let mut text = "# a box\no box\n".to_owned();
    for index in 0..8 {
        let [x, y, z] = corner(index);
        writeln!(text, "v {x} {y} {z}").unwrap();
    }
    text.push_str("vt 0 0\nvn 0 0 1\ns off\nusemtl none\n");
    for quad in FACES {
        writeln!(text, "f {}", quad.map(&face).join(" ")).unwrap();
    }
    text
}

#[test]
fn the_same_box_from_every_format() {
    let (mesh, report) = plain(&file("box.stl", ascii(&triangles())));
    assert_eq!(report.triangles, 12);
    assert_eq!(report.vertices, 8);
    assert_eq!(report.parts, 1);
    assert_eq!((report.min, report.max), ([0.0; 3], [0.5, 0.25, 0.125]));
    assert!(report.is_closed());
    assert_eq!((report.flipped, report.degenerate, report.duplicates, report.welded), (0, 0, 0, 0));
    assert_eq!(report.volume, Some(0.5 * 0.25 * 0.125));
    assert_eq!(
        report.to_string(),
        "12 triangles, 8 vertices, 1 part; 500 × 250 × 125 mm, from (0, 0, 0) to (500, 250, 125) mm\n\
         closed, volume 15625 cm³"
    );

    let same = (mesh, report);
    assert_eq!(plain(&file("upper.STL", ascii(&triangles()).to_uppercase().replace("E-", "e-"))), same);
    assert_eq!(plain(&file("crlf.stl", ascii(&triangles()).replace('\n', "\r\n"))), same);
    assert_eq!(plain(&file("bin.stl", binary("exported", &triangles()))), same);
    // Some exporters begin binary files with the word that means text.
    assert_eq!(plain(&file("solid.stl", binary("solid box", &triangles()))), same);
    assert_eq!(plain(&file("v.obj", obj(|i| format!("{}", i + 1)))), same);
    assert_eq!(plain(&file("vt.obj", obj(|i| format!("{}/1", i + 1)))), same);
    assert_eq!(plain(&file("vn.obj", obj(|i| format!("{}//1", i + 1)))), same);
    assert_eq!(plain(&file("vtn.obj", obj(|i| format!("{}/1/1", i + 1)))), same);
    assert_eq!(plain(&file("negative.obj", obj(|i| format!("{}", i as i64 - 8)))), same);
    let continued = obj(|i| format!("{}", i + 1)).replace("f 1 3", "f 1 \\\n3");
    assert_eq!(plain(&file("continued.obj", continued)), same);
}

/// The box as PLY: with properties and elements that nobody asked for.
fn ply(format: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\r\nformat {format} 1.0\ncomment a box\nelement mark 2\nproperty short a\nproperty list uchar double b\n\
         element vertex 8\nproperty float x\nproperty double y\nproperty uchar red\nproperty float64 z\n\
         element face 6\nproperty list uchar int vertex_indices\nproperty int8 group\nend_header\n"
    )
    .into_bytes();
    // Each number with the bytes of its type, in either order or as text.
    let mut put = |value: f64, little: &[u8], ends: bool| match format {
        "ascii" => bytes.extend(format!("{value}{}", if ends { "\n" } else { " " }).into_bytes()),
        "binary_little_endian" => bytes.extend(little),
        _ => bytes.extend(little.iter().rev()),
    };
    for mark in [-300, 7_i16] {
        put(f64::from(mark), &mark.to_le_bytes(), false);
        put(2.0, &[2], false);
        put(0.5, &0.5_f64.to_le_bytes(), false);
        put(1e9, &1e9_f64.to_le_bytes(), true);
    }
    for [x, y, z] in (0..8).map(corner) {
        put(x, &(x as f32).to_le_bytes(), false);
        put(y, &y.to_le_bytes(), false);
        put(200.0, &[200], false);
        put(z, &z.to_le_bytes(), true);
    }
    for face in FACES {
        put(4.0, &[4], false);
        for index in face {
            put(index as f64, &(index as i32).to_le_bytes(), false);
        }
        put(-1.0, &[0xff], true);
    }
    bytes
}

#[test]
fn the_same_box_from_ply() {
    let same = plain(&file("like.stl", ascii(&triangles())));
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        assert_eq!(plain(&file(&format!("{format}.ply"), ply(format))), same, "{format}");
    }
    let other = String::from_utf8(ply("ascii")).unwrap().replace("vertex_indices", "Vertex_Index");
    assert_eq!(plain(&file("index.ply", other)), same);
}

#[test]
fn mistakes_in_ply_files_are_named() {
    let text = String::from_utf8(ply("ascii")).unwrap();
    let changed = |name: &str, from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        message(&format!("{name}.ply"), text.replacen(from, to, 1))
    };
    let lines = text.lines().count();
    for (got, expected) in [
        (message("empty.ply", ""), "is cut short: it ends at byte 0, before `end_header`".to_owned()),
        (message("solid.ply", "solid x\n"), ", line 1: expected `ply`, found `solid x`".to_owned()),
        (
            message("half.ply", &text[..60]),
            "is cut short: it ends at byte 60, before `end_header`".to_owned(),
        ),
        (changed("format", "ascii", "text"), ", line 2: expected `ascii`, `binary_little_endian`".to_owned()),
        (changed("type", "short a", "word a"), ", line 5: expected `property`, a type such as".to_owned()),
        (changed("count", "vertex 8", "vertex many"), ", line 7: expected `element`, a name and".to_owned()),
        (
            changed("less", "float64 z", "float64 w"),
            "expected vertices with the properties x, y and z".to_owned(),
        ),
        (
            changed("list", "vertex_indices", "corners"),
            "expected faces with a list vertex_indices".to_owned(),
        ),
        (changed("word", "0.125", "o.125"), ", line 22: expected a number, found `o.125`".to_owned()),
        (changed("inf", "0.125", "inf"), ", line 22: a coordinate is inf".to_owned()),
        (changed("few", "face 6", "face 7"), format!("is cut short: it ends at line {}", lines + 1)),
        (
            changed("index", "4 0 2 3 1 -1", "4 0 2 8 1 -1"),
            "a face names vertex 8, but the file has vertices 0 to 7".to_owned(),
        ),
        (changed("fraction", "4 0 2 3 1 -1", "4 0 2 .5 1 -1"), "a face names vertex 0.5, but".to_owned()),
    ] {
        assert!(got.contains(&expected), "{got}\ninstead of\n{expected}");
    }
    let binary = ply("binary_little_endian");
    let cut = message("cut.ply", &binary[..binary.len() - 3]);
    assert!(cut.contains(&format!("is cut short: it ends at byte {}", binary.len() - 3)), "{cut}");
    // A count is believed no further than there are bytes.
    let at = binary.windows(8).position(|w| w == b"vertex 8").unwrap();
    let huge = [&binary[..at], b"vertex 18446744073709551615", &binary[at + 8..]].concat();
    assert!(message("huge.ply", huge).contains("is cut short"));
}

/// Area of a flat mesh in the plane z = 0, counted by winding.
fn flat_area(mesh: &TriMesh) -> f64 {
    let corners = mesh.triangles.iter().map(|t| t.map(|i| mesh.vertices[i as usize]));
    corners.map(|[a, b, c]| 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))).sum()
}

#[test]
fn polygons_need_not_be_convex() {
    // An L of three unit squares from each of its corners, upright and lying, wound either way.
    let corners = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]];
    for start in 0..6 {
        let mut turned = corners;
        turned.rotate_left(start);
        for mirrored in [false, true] {
            if mirrored {
                turned.reverse();
            }
            let mut text = String::new();
            for [x, y] in turned {
                writeln!(text, "v {x} {y} 0").unwrap();
            }
            let (mesh, report) = plain(&file("l.obj", text.clone() + "f 1 2 3 4 5 6\n"));
            assert_eq!((report.triangles, report.open_edges, report.flipped), (4, 6, 0));
            let area = flat_area(&mesh);
            assert!((area - if mirrored { -3.0 } else { 3.0 }).abs() < 1e-14, "{start} {mirrored}: {area}");
            // No triangle reaches into the notch.
            for t in &mesh.triangles {
                let [x, y] =
                    [0, 1].map(|k| t.iter().map(|i| mesh.vertices[*i as usize][k]).sum::<f64>() / 3.0);
                assert!(x < 1.0 || y < 1.0, "a triangle about ({x}, {y})");
            }
        }
    }
}

#[test]
fn a_star_of_too_many_corners_is_refused() {
    let mut text = String::new();
    let n = 10_002;
    for k in 0..n {
        let (angle, r) = (2.0 * PI * f64::from(k) / f64::from(n), f64::from(1 + k % 2));
        writeln!(text, "v {} {} 0", r * angle.cos(), r * angle.sin()).unwrap();
    }
    text.push('f');
    (1..=n).for_each(|k| write!(text, " {k}").unwrap());
    let error = message("star.obj", text);
    assert_eq!(
        error,
        "mesh file `FILE`, line 10003: a face of 10002 corners is not convex; cut it into triangles where it was drawn"
    );
}

#[test]
fn convex_polygons_become_fans() {
    // A hexagonal pyramid without its mantle: one face of six corners, area 3√3/2 · r².
    let mut text = String::new();
    for k in 0..6 {
        let angle = f64::from(k) * PI / 3.0;
        writeln!(text, "v {} {} 0", angle.cos(), angle.sin()).unwrap();
    }
    let (mesh, report) = plain(&file("hexagon.obj", text + "f 1 2 3 4 5 6\n"));
    assert_eq!((report.triangles, report.open_edges, report.flipped), (4, 6, 0));
    let area = flat_area(&mesh);
    assert!((area - 1.5 * 3f64.sqrt()).abs() < 1e-14, "{area}");
}

#[test]
fn a_hole_and_a_flipped_triangle_are_reported() {
    let mut faces = triangles();
    faces[5].swap(0, 1);
    faces.remove(11);
    let (_, report) = plain(&file("holed.stl", ascii(&faces)));
    assert_eq!(
        (report.triangles, report.open_edges, report.non_manifold_edges, report.flipped),
        (11, 3, 0, 1)
    );
    assert_eq!(report.volume, None);
    let text = report.to_string();
    assert!(text.ends_with("\nnot closed: 3 open edges, 1 flipped triangle"), "{text}");

    let mut faces = triangles();
    for face in &mut faces {
        face.swap(0, 1);
    }
    let (_, report) = plain(&file("inside-out.stl", binary("", &faces)));
    assert_eq!((report.flipped, report.volume), (0, Some(-0.015625)));
    assert!(report.to_string().ends_with("closed, volume 15625 cm³, normals point inwards"));
}

#[test]
fn unusable_and_repeated_triangles_are_left_out() {
    let mut faces = triangles();
    faces.extend([[0, 1, 1], [0, 2, 3], [2, 0, 3]]); // no area, repeated, repeated the other way round
    let (mesh, report) = plain(&file("repeated.stl", binary("", &faces)));
    assert_eq!((report.degenerate, report.duplicates), (1, 2));
    assert!(report.to_string().ends_with("1 degenerate triangle left out, 2 repeated triangles left out"));
    assert_eq!(mesh, plain(&file("clean.stl", binary("", &triangles()))).0);

    // Collinear without equal corners, and 2e-7 of its length high.
    let text = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 1 4e-7 0\nv 1 1 0\nf 1 2 3\nf 1 3 4\nf 1 3 5\n";
    let (_, report) = plain(&file("slivers.obj", text));
    assert_eq!((report.triangles, report.degenerate), (1, 2));

    // A fin makes an edge of three triangles.
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n";
    let (_, report) = plain(&file("fin.obj", text));
    assert_eq!((report.non_manifold_edges, report.open_edges, report.parts), (1, 6, 3));
    assert!(report.to_string().contains("1 edge of three or more triangles"));
}

#[test]
fn near_vertices_are_joined_and_others_are_not() {
    // Two triangles whose common edge differs by `gap`; the longest side of the box is 1.
    let strip = |gap: f64| {
        format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 {gap:e} 0\nv 1 1 0\nv -0 1 {gap:e}\nf 1 2 3\nf 4 5 6\n")
    };
    let (mesh, report) = plain(&file("near.obj", strip(0.9e-7)));
    assert_eq!((report.vertices, report.welded, report.open_edges), (4, 2, 4));
    assert_eq!(mesh.vertices[1], [1.0, 0.0, 0.0], "the first one stays");
    let (_, report) = plain(&file("far.obj", strip(1.1e-7)));
    assert_eq!((report.vertices, report.welded, report.open_edges), (6, 0, 6));
}

#[test]
fn transform_scales_then_rotates_then_translates() {
    let path = file("placed.stl", ascii(&triangles()));
    let transform = Transform { scale: [2.0, 4.0, 8.0], translate: [10.0, 0.0, 0.0], ..Default::default() }
        .rotated([0.0, 0.0, 3.0], FRAC_PI_2)
        .unwrap()
        .rotated([1.0, 0.0, 0.0], FRAC_PI_2)
        .unwrap();
    // The scaled unit cube; x → y → z, y → -x → -x, z → z → -y.
    let (_, report) = read(&path, &transform).unwrap();
    for (found, wanted) in [(report.min, [9.0, -1.0, 0.0]), (report.max, [10.0, 0.0, 1.0])] {
        assert!((0..3).all(|k| (found[k] - wanted[k]).abs() < 1e-14), "{found:?}");
    }
    assert!((report.volume.unwrap() - 1.0).abs() < 1e-14);

    // A mirror image keeps its outside outside.
    let mirror = Transform { scale: [-1.0, 1.0, 1.0], ..Default::default() };
    assert_eq!(read(&path, &mirror).unwrap().1.volume, Some(0.015625));
    // A quaternion of any length is a rotation.
    let long = Transform { rotate: [0.0, 0.0, 0.0, -7.0], ..Default::default() };
    assert_eq!(read(&path, &long).unwrap().1.min, [-0.5, -0.25, 0.0]);

    let large = read(&path, &Transform::scaled(100.0)).unwrap().1.to_string();
    assert!(large.contains("50 × 25 × 12.5 m,"), "{large}");
    assert!(large.ends_with("if it was drawn in millimetres, set unit = \"mm\""), "{large}");

    let refused = |t: Transform| read(&path, &t).unwrap_err().to_string();
    assert!(refused(Transform::scaled(0.0)).contains("scale [0.0, 0.0, 0.0] flattens the mesh"));
    let zero = Transform { rotate: [0.0; 4], ..Default::default() };
    assert!(refused(zero).contains("rotation [0.0, 0.0, 0.0, 0.0] has no direction"));
    let nan = Transform { translate: [0.0, f64::NAN, 0.0], ..Default::default() };
    assert!(refused(nan).contains("translation [0.0, NaN, 0.0] must be finite"));
    assert!(refused(Transform::scaled(1e200)).contains("reaches beyond 1e100 m"));
    let axis = Transform::default().rotated([0.0; 3], 1.0).unwrap_err();
    assert_eq!(axis, TransformError::Rotation([1.0, 0.0, 0.0, 0.0]));
}

#[test]
fn a_large_sphere_is_read_and_written_in_both_kinds() {
    // Rings of latitude: 2 · 100 · 101 = 20 200 triangles with poles.
    let (rings, sectors) = (102, 100);
    let point = |i: usize, j: usize| {
        let (theta, phi) = (PI * i as f64 / rings as f64, 2.0 * PI * (j % sectors) as f64 / sectors as f64);
        let s = if i == 0 || i == rings { 0.0 } else { theta.sin() };
        [s * phi.cos(), s * phi.sin(), theta.cos()]
    };
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for i in 0..rings {
        for j in 0..sectors {
            let corners = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
            let n = vertices.len() as u32;
            vertices.extend(corners);
            if i + 1 < rings {
                faces.push([n, n + 1, n + 2]);
            }
            if i > 0 {
                faces.push([n, n + 2, n + 3]);
            }
        }
    }
    let sphere = TriMesh { vertices, triangles: faces };
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mesh-sphere.stl");
    write_stl(&path, &sphere, "a sphere", StlFormat::Ascii).unwrap();
    let (mesh, report) = plain(&path);
    assert_eq!((report.triangles, report.vertices), (20_200, 101 * 100 + 2));
    assert!(report.is_closed() && report.flipped == 0 && report.welded == 0);
    let volume = report.volume.unwrap();
    assert!((volume / (4.0 / 3.0 * PI) - 1.0).abs() < 2e-3, "{volume}");

    write_stl(&path, &mesh, "again\nand again", StlFormat::Ascii).unwrap();
    assert_eq!(plain(&path), (mesh.clone(), report), "text keeps every digit");
    assert!(fs::read_to_string(&path).unwrap().starts_with("solid again and again\n"));

    write_stl(&path, &mesh, &"solid ü".repeat(20), StlFormat::Binary).unwrap();
    assert_eq!(fs::metadata(&path).unwrap().len(), 84 + 50 * 20_200);
    let (rounded, report) = plain(&path);
    assert!(report.is_closed() && report.volume.is_some());
    assert_eq!(rounded.triangles, mesh.triangles);
    let as_f32 = |m: &TriMesh| m.vertices.iter().map(|v| v.map(|c| c as f32 + 0.0)).collect::<Vec<_>>();
    assert_eq!(as_f32(&rounded), as_f32(&mesh));
}

#[test]
fn a_mesh_that_cannot_be_written_is_refused() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mesh-unwritable.stl");
    let refused = |vertices: Vec<Vec3>, path: &Path| {
        let mesh = TriMesh { vertices, triangles: vec![[0, 1, 2]] };
        write_stl(path, &mesh, "", StlFormat::Binary).unwrap_err().to_string()
    };
    assert!(refused(vec![[0.0; 3]; 2], &path).ends_with("triangle 0 names a vertex that is not there"));
    let huge = vec![[0.0; 3], [1e39, 0.0, 0.0], [0.0; 3]];
    assert!(refused(huge, &path).ends_with("has a coordinate that is not a finite number of the format"));
    assert!(!path.exists());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("no such folder/x.stl");
    assert!(refused(vec![[0.0; 3]; 3], &folder).starts_with("cannot write mesh file"));
}

#[test]
fn files_that_are_not_there_or_of_another_kind() {
    let at = |name: &str| {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        read(&path, &Transform::default()).unwrap_err().to_string()
    };
    assert!(at("nowhere.stl").ends_with("nowhere.stl` does not exist: check the name and the folder"));
    fs::create_dir_all(Path::new(env!("CARGO_TARGET_TMPDIR")).join("folder.obj")).unwrap();
    assert!(at("folder.obj").starts_with("cannot read mesh file"));
    assert!(
        at("x.step")
            .ends_with("unknown format `.step`; known are .stl, .ply (each ASCII or binary) and .obj")
    );
    assert_eq!(message("empty.stl", ""), "mesh file `FILE` has no triangles");
    assert_eq!(message("none.stl", "solid x\nendsolid x\n"), "mesh file `FILE` has no triangles");
    assert_eq!(message("none-binary.stl", binary("", &[])), "mesh file `FILE` has no triangles");
    assert_eq!(message("points.obj", "v 0 0 0\n"), "mesh file `FILE` has no triangles");
    let flat = message("flat.stl", ascii(&[[0, 1, 0], [2, 2, 2]]));
    assert_eq!(flat, "mesh file `FILE` has no triangles left: all 2 are degenerate (no area)");
}

#[test]
fn files_cut_short() {
    let whole = ascii(&triangles());
    let cut = |text: &str| message("cut.stl", text);
    let upto = |marker: &str| &whole[..whole.find(marker).unwrap()];
    let said = |line: usize, what: &str| {
        format!("mesh file `FILE` is cut short: it ends at line {line}, {what}; copy or export it again")
    };
    assert_eq!(cut(upto("endsolid")), said(85, "where `facet` or `endsolid` should follow or be completed"));
    assert_eq!(cut(upto(" outer")), said(2, "where `outer loop` should follow or be completed"));
    assert_eq!(cut(upto(" endloop")), said(6, "where `endloop` should follow or be completed"));
    assert_eq!(cut(upto("endfacet")), said(7, "where `endfacet` should follow or be completed"));
    // In the middle of a vertex, of a number, of a word.
    let vertex = "where `vertex` and three numbers should follow or be completed";
    assert_eq!(cut("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0"), said(4, vertex));
    assert_eq!(cut("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 1e"), said(4, vertex));
    let word = "where `vertex x y z` should follow or be completed";
    assert_eq!(cut("solid\nfacet normal 0 0 1\nouter loop\nvert"), said(4, word));

    let whole = binary("solid or not", &triangles());
    assert_eq!(
        message("cut-binary.stl", &whole[..300]),
        "mesh file `FILE`: a binary STL of 12 triangles takes 684 bytes, but the file has 300; \
         it is cut short: copy or export it again"
    );
    assert_eq!(
        message("long-binary.stl", [&whole[..], b"more"].concat()),
        "mesh file `FILE`: a binary STL of 12 triangles takes 684 bytes, but the file has 688; \
         it is damaged, or followed by something else: copy or export it again"
    );
    assert_eq!(
        message("head.stl", &whole[70..80]),
        "mesh file `FILE` is cut short: it ends at byte 10, within the 84 bytes that a binary STL begins with; \
         copy or export it again"
    );
    // A count that would need 214 GB must not be believed.
    let mut absurd = whole.clone();
    absurd[80..84].fill(0xFF);
    assert!(message("absurd.stl", absurd).contains("of 4294967295 triangles takes 214748364834 bytes"));

    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    assert_eq!(
        message("cut.obj", format!("{obj}f 1 2")),
        said(5, "where a face of at least three vertices should stand")
    );
    assert_eq!(
        message("cut-v.obj", format!("{obj}v 1 2 ")),
        said(5, "where `v` and three numbers should stand")
    );
}

#[test]
fn mistakes_are_named_with_their_line() {
    let whole = ascii(&triangles());
    let replaced = |from: &str, to: &str| message("wrong.stl", whole.replacen(from, to, 1));
    let start = "mesh file `FILE`, line";
    assert_eq!(
        replaced("vertex 0 0e0", "vertex 0 0,5"),
        format!("{start} 4: expected `vertex` and three numbers, found `vertex 0 0,5 0.000000000`")
    );
    assert_eq!(replaced("outer loop", "loop"), format!("{start} 3: expected `outer loop`, found `loop`"));
    assert_eq!(
        replaced("  vertex", "  vertex 1 2 3\n vertex"),
        format!("{start} 7: expected `endloop` after three vertices, found `vertex 0.5 2.5e-1 0.000000000`")
    );
    assert_eq!(replaced("endfacet", "facet"), format!("{start} 8: expected `endfacet`, found `facet`"));
    assert_eq!(
        replaced("endfacet\n", "endfacet\nhello\n"),
        format!("{start} 9: expected `facet normal …` or `endsolid`, found `hello`")
    );
    assert_eq!(
        message("after.stl", whole.clone() + "hello"),
        format!("{start} 87: expected `solid` or nothing after `endsolid`, found `hello`")
    );

    let finite = "vertices need finite numbers: repair or export the mesh again";
    assert_eq!(
        replaced("vertex 0 0e0", "vertex 0 nan"),
        format!("mesh file `FILE`, line 4: a coordinate is NaN; {finite}")
    );
    let mut bytes = binary("", &triangles());
    let third = 84 + 2 * 50;
    bytes[third + 12..third + 16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    assert_eq!(
        message("inf.stl", bytes),
        format!("mesh file `FILE`, facet 3 (byte 184): a coordinate is inf; {finite}")
    );

    let obj = |line: &str| message("wrong.obj", format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{line}\nf 1 2 3\n"));
    assert_eq!(obj("v 0 -inf 0"), format!("mesh file `FILE`, line 4: a coordinate is -inf; {finite}"));
    assert_eq!(obj("v 0 zero 0"), format!("{start} 4: expected `v` and three numbers, found `v 0 zero 0`"));
    assert_eq!(obj("f 1 2"), format!("{start} 4: expected a face of at least three vertices, found `f 1 2`"));
    assert_eq!(
        obj("f 1 2 x/3"),
        format!("{start} 4: expected `f` and vertex numbers (v, v/vt, v//vn or v/vt/vn), found `f 1 2 x/3`")
    );
    let range = "but the file has vertices 1 to 3";
    assert_eq!(obj("f 1 2 9"), format!("{start} 4: a face names vertex 9, {range}"));
    assert_eq!(obj("f 1 2 0"), format!("{start} 4: a face names vertex 0, {range}"));
    assert_eq!(obj("f 1 2 -4"), format!("{start} 4: a face names vertex -4, but only 3 stand before it"));
    assert_eq!(
        message("no-vertices.obj", "f 1 2 3\n"),
        format!("{start} 1: a face names vertex 1, but the file has no vertices")
    );
}

/// Reads every mesh in the folder named by `GLEBE_EXTRA_MESHES`, for files that cannot be kept here.
#[test]
fn meshes_of_an_extra_folder() {
    let Some(folder) = std::env::var_os("GLEBE_EXTRA_MESHES") else {
        println!("skipped: GLEBE_EXTRA_MESHES names no folder of meshes to read");
        return;
    };
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|p| {
        p.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl") || e.eq_ignore_ascii_case("obj"))
    });
    paths.sort();
    assert!(!paths.is_empty(), "no .stl or .obj file in the folder");
    for path in paths {
        let (mesh, report) = plain(&path);
        println!("{}: {report}\n", path.file_name().unwrap().display());
        // Writing and reading changes nothing, whatever state the mesh is in.
        let copy = file("extra-copy.stl", "");
        write_stl(&copy, &mesh, "copy", StlFormat::Ascii).unwrap();
        let (again, report_again) = plain(&copy);
        assert_eq!(again, mesh);
        assert_eq!((report_again.degenerate, report_again.duplicates, report_again.welded), (0, 0, 0));
    }
}
