//! Particle files as GPUDEM and its users write them, and their mistakes.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::{collections::BTreeMap, fs, path::Path};

use glebe_engine::spec::ParticleSet;
use glebe_io::output::vtp::{Cells, Column, Part, PolyData, Values};
use glebe_io::particles::{ParticleColumns, ParticleError, read};

fn parse(name: &str, content: &str) -> Result<ParticleColumns, ParticleError> {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("particles-{name}.csv"));
    fs::write(&path, content).unwrap();
    read(&path)
}

fn message(name: &str, content: &str) -> String {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("particles-{name}.csv"));
    let error = parse(name, content).unwrap_err().to_string();
    error.replace(&path.display().to_string(), "FILE")
}

fn materials() -> BTreeMap<String, usize> {
    [("soil".to_owned(), 2), ("steel".to_owned(), 0)].into()
}

#[test]
fn positions_and_radii() {
    let expected = ParticleSet {
        position: vec![[0.1, -0.2, 3e-1], [1.0, 2.0, 3.0]],
        radius: vec![0.0085, 0.01],
        material: vec![7, 7],
        ..Default::default()
    };
    for (name, content) in [
        ("gpudem", "x,y,z,R\n0.1,-0.2,3e-1,0.0085\n1,2,3,0.01\n"),
        ("spaces", "  X , Y, Z,  r\n 0.1, -0.2 ,3e-1,0.0085 \n1,2,3,0.01"),
        ("crlf", "x,y,z,R\r\n0.1,-0.2,3e-1,0.0085\r\n\r\n1,2,3,0.01\r\n\r\n  \r\n"),
        ("order", "R,z,x,y\n0.0085,3e-1,0.1,-0.2\n0.01,3,1,2\n"),
        ("quoted", "\"x\",\"y\",\"z\",\"R\"\n0.1,-0.2,3e-1,0.0085\n1,2,3,0.01\n"),
        ("bom", "\u{FEFF}x,y,z,R\n0.1,-0.2,3e-1,0.0085\n1,2,3,0.01\n"),
        ("numpy", "# x,y,z,R\n0.1,-0.2,3e-1,0.0085\n1,2,3,0.01\n"),
        ("headerless", "0.1,-0.2,3e-1,0.0085\n1,2,3,0.01\n"),
    ] {
        let columns = parse(name, content).unwrap();
        assert_eq!(columns.len(), 2);
        assert!(columns.ignored.is_empty());
        assert_eq!(columns.into_set(&BTreeMap::new(), Some(7)).unwrap(), expected, "{name}");
    }
}

#[test]
fn headings_with_units_and_as_paraview_writes_them() {
    let columns = parse(
        "units",
        "x [mm],y (cm),z,R[um],vx [km/h],vy [m/s],vz,wx [rpm],wy,wz\n8.5,20,3,850,3.6,1,2,60,0,0\n",
    );
    let set = columns.unwrap().into_set(&BTreeMap::new(), Some(0)).unwrap();
    assert_eq!((set.position[0], set.radius[0]), ([0.0085, 0.2, 3.0], 0.00085));
    assert!(
        (set.velocity[0][0] - 1.0).abs() < 1e-15 && (set.spin[0][0] - std::f64::consts::TAU).abs() < 1e-14
    );

    let spreadsheet = "\"Point ID\",\"Points:0\",\"Points:1\",\"Points:2\",\"Points_Magnitude\",\"radius\",\
                       \"velocity:0\",\
                       \"velocity:1\",\"velocity:2\"\n0,1,2,3,3.74,0.5,4,5,6\n";
    for (name, text) in [("colon", spreadsheet.to_owned()), ("underscore", spreadsheet.replace(':', "_"))] {
        let columns = parse(name, &text).unwrap();
        assert_eq!(columns.ignored, ["Point ID", "Points_Magnitude"]);
        assert_eq!((columns.position[0], columns.radius[0]), ([1.0, 2.0, 3.0], 0.5));
        assert_eq!(columns.velocity, [[4.0, 5.0, 6.0]]);
    }

    assert_eq!(
        message("furlong", "x [furlong],y,z,R\n0,0,0,1\n"),
        "particle file `FILE`, line 1: column `x [furlong]`: `furlong` is not a known unit"
    );
    assert_eq!(
        message("mass", "x,y,z,R [kg]\n0,0,0,1\n"),
        "particle file `FILE`, line 1: column `R [kg]`: `kg` is a mass, not a length"
    );
    assert!(message("both", "x,y,z,R,radius [mm]\n").contains("two columns mean `R`"));
}

/// As GPUDEM writes its particles: text in tabs and columns, no more than points and radii.
const GPUDEM: &str = "<?xml version=\"1.0\"?>\n\
    <VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
    \t<UnstructuredGrid>\n\t\t<Piece NumberOfPoints=\"2\" NumberOfCells=\"0\">\n\t\t\t<!-- Particle positions -->\n\
    \t\t\t<Points>\n<DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\n\
    \t  -0.5  0.25 4\n\t 1e-1 2  .5\n\
    \t</DataArray>\n</Points>\n<Cells>\n\
    <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">\n</DataArray>\n</Cells>\n\
    <PointData Scalars=\"Radius\">\n<DataArray type=\"Float32\" Name=\"Radius\" format=\"ascii\">\n0.125\n0.01\n\
    </DataArray>\n</PointData>\n<CellData>\n</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";

#[test]
fn vtu_as_gpudem_writes_it_and_vtp_as_we_do() {
    let columns = parse("gpudem-vtu", GPUDEM).unwrap();
    assert_eq!(columns.position, [[-0.5, 0.25, 4.0], [0.1, 2.0, 0.5]]);
    assert_eq!(columns.radius, [0.125, 0.01]);
    assert!(columns.velocity.is_empty() && columns.spin.is_empty() && columns.ignored.is_empty());
    let error = columns.clone().into_set(&materials(), None).unwrap_err().to_string();
    assert!(error.contains("has no column `material`"), "{error}");
    assert_eq!(columns.into_set(&materials(), Some(2)).unwrap().material, [2, 2]);

    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("particles-own.vtp");
    let (positions, speeds) = ([[0.1, 0.2, 1.0 / 3.0], [0.5, 0.0, -0.0]], [[1.0_f32, 2.0, 3.0], [0.0; 3]]);
    let own = PolyData {
        points: Values::Vec3F64(&positions),
        cells: Cells::Points,
        point_data: vec![
            Column::new("id", Values::U32(&[7, 8])),
            Column::new("radius", Values::F32(&[0.5, 0.25])),
            Column::new("material", Values::U32(&[1, 0])),
            Column::new("velocity", Values::Vec3F32(&speeds)),
            Column::new("angular_velocity", Values::Vec3F32(&speeds)),
        ],
        cell_data: Vec::new(),
    };
    own.write(&path, 0.5).unwrap();
    let columns = read(&path).unwrap();
    assert_eq!(columns.ignored, ["id"]);
    let set = columns.clone().into_set(&materials(), None).unwrap();
    assert_eq!((set.position, set.radius, set.material), (positions.to_vec(), vec![0.5, 0.25], vec![1, 0]));
    assert_eq!((set.velocity[0], set.spin[0]), ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]));
    assert_eq!(
        columns.clone().into_set(&materials(), Some(2)).unwrap().material,
        [2, 2],
        "the scene's word counts"
    );
    let few = [("soil".to_owned(), 0)].into();
    let error = columns.into_set(&few, None).unwrap_err().to_string();
    assert!(
        error.contains(
            "particle 0 (from 0): its material is number 1, but the scene has the materials 0 to 0"
        ),
        "{error}"
    );
}

#[test]
fn mistakes_in_vtk_files_are_named() {
    let changed = |name: &str, from: &str, to: &str| {
        assert!(GPUDEM.contains(from), "{from}");
        message(name, &GPUDEM.replacen(from, to, 1))
    };
    for (got, expected) in [
        (changed("v-word", "0.25", "O.25"), ", line 10: the array holds `O.25`, which is not a number"),
        (
            changed("v-few", "NumberOfPoints=\"2\"", "NumberOfPoints=\"3\""),
            "the array has 6 values where 9 should be",
        ),
        (changed("v-many", "0.125", "0.125 3"), "`Radius` has 3 values where 2 should be"),
        (changed("v-zero", "0.125", "0"), "particle 0 (from 0): Radius is 0; it must be greater than 0"),
        (changed("v-nan", "0.01", "nan"), "particle 1 (from 0): Radius is NaN; numbers must be finite"),
        (
            changed("v-inf", "1e-1", "1e999"),
            "particle 1 (from 0): a coordinate is inf; numbers must be finite",
        ),
        (changed("v-none", "Name=\"Radius\"", "Name=\"size\""), "no array `radius` belongs to its points"),
        (
            changed("v-flat", "NumberOfComponents=\"3\"", "NumberOfComponents=\"2\""),
            "has 2 coordinates for each point instead of 3",
        ),
        (changed("v-type", "Float32", "Float16"), "`Float16` is not a type of numbers"),
        (
            changed("v-format", "format=\"ascii\"", "format=\"words\""),
            "has the format `words`; known are ascii",
        ),
        (
            changed("v-grid", "UnstructuredGrid", "ImageData"),
            "line 2: this holds `ImageData`; particles are read from",
        ),
        (
            changed("v-appended", "format=\"ascii\"", "format=\"appended\" offset=\"0\""),
            "the file ends before the appended data",
        ),
        (changed("v-tag", "</Points>", "</Point>"), "this is not XML"),
        (
            changed("v-huge", "NumberOfPoints=\"2\"", "NumberOfPoints=\"9223372036854775807\""),
            "cannot be that long",
        ),
        (message("v-cut", &GPUDEM[..GPUDEM.find("0.125").unwrap()]), "is cut short: it ends within an array"),
        (message("v-other", "<html></html>"), "there is no element VTKFile"),
        (message("v-start", "<"), "this is not XML"),
    ] {
        assert!(got.contains(expected), "{got}\ninstead of\n{expected}");
    }
}

#[test]
fn velocities_spins_and_materials() {
    let content = "id,x,y,z,R,VX,vy,vz,wx,wy,wz,Material\n\
                   1,0,0,0,1,1,2,3,4,5,6,steel\n2,0,0,5,1,0,0,0,0,0,0,soil\n3,0,0,9,1,0,0,0,0,0,0,steel\n";
    let columns = parse("full", content).unwrap();
    assert_eq!(columns.ignored, ["id"]);
    assert!(columns.material_names().eq(["steel", "soil"]));
    let set = columns.into_set(&materials(), Some(1)).unwrap();
    assert_eq!(set.material, [0, 2, 0]);
    assert_eq!((set.velocity[0], set.spin[0]), ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]));
    assert_eq!((set.velocity.len(), set.spin.len()), (3, 3));
}

#[test]
fn materials_that_are_not_defined() {
    let columns = parse("unknown", "x,y,z,R,material\n0,0,0,1,soil\n0,0,5,1,sand\n").unwrap();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("particles-unknown.csv");
    assert_eq!(
        columns.clone().into_set(&materials(), Some(0)).unwrap_err().to_string(),
        format!(
            "particle file `{}`, line 3: material `sand` is not defined; defined are soil, steel",
            path.display()
        )
    );
    let error = columns.into_set(&BTreeMap::new(), None).unwrap_err().to_string();
    assert!(error.ends_with("line 2: material `soil` is not defined; defined are none"), "{error}");
    let error = parse("no-material", "0,0,0,1\n").unwrap().into_set(&materials(), None).unwrap_err();
    assert!(error.to_string().contains("has no column `material`: add one, or set"), "{error}");
}

#[test]
fn mistakes_are_named_with_line_and_column() {
    let empty = "particle file `FILE` is empty: it needs a header `x,y,z,R` and a line for each particle";
    assert_eq!(message("empty", ""), empty);
    assert_eq!(message("blank", "\n \n\r\n"), empty);
    assert_eq!(message("header-only", "x,y,z,R\n"), empty);

    assert_eq!(
        message("no-r", "x,y,z,diameter\n0,0,0,1\n"),
        "particle file `FILE`, line 1: no column `R` among `x`, `y`, `z`, `diameter`; known are x, y, z, R (needed), \
         vx, vy, vz, wx, wy, wz and material, each with a unit if need be, such as `R [mm]`"
    );
    assert!(message("no-vz", "\nx,y,z,R,vx,vy\n0,0,0,1,0,0\n").contains("line 2: no column `vz` among `x`"));
    assert_eq!(
        message("twice", "x,y,z,R,X\n0,0,0,1,0\n"),
        "particle file `FILE`, line 1: two columns mean `x`: rename or remove one"
    );
    assert_eq!(
        message("three", "0,0,1\n"),
        "particle file `FILE` has no header and 3 columns: without a header there must be four (x, y, z, R); \
         add a header"
    );

    let at = |line: usize, column: usize, name: &str, what: &str| {
        format!("particle file `FILE`, line {line}, column {column} ({name}): {what}")
    };
    assert_eq!(message("word", "x,y,z,R\n0,0,0,1\n0,0,o,1\n"), at(3, 3, "z", "`o` is not a number"));
    assert_eq!(message("gap", "x,y,z,R\n0,,0,1\n"), at(2, 2, "y", "`` is not a number"));
    // Blank lines and carriage returns count as lines.
    assert_eq!(
        message("nan", "x,y,z,R\r\n\r\n0,0,0,1\r\nnan,0,0,1\r\n"),
        at(4, 1, "x", "`nan` is not finite")
    );
    assert_eq!(
        message("inf", "R,x,y,z,wx,wy,wz\n1,0,0,0,0,1e999,0\n"),
        at(2, 6, "wy", "`1e999` is not finite")
    );
    let radius = "is no radius: it must be greater than 0";
    assert_eq!(message("negative", "0,0,0,1\n\n\n0,0,0,-1\n"), at(4, 4, "R", &format!("`-1` {radius}")));
    assert_eq!(message("zero", "R,x,y,z\n0,0,0,0\n"), at(2, 1, "R", &format!("`0` {radius}")));
    assert_eq!(
        message("nameless", "x,y,z,R,material\n0,0,0,1,\n"),
        at(2, 5, "material", "`` is no name: every particle needs its material")
    );
    assert_eq!(
        message("ragged", "x,y,z,R\n0,0,0,1\n0,0,0\n"),
        "particle file `FILE`, line 3: 3 fields, but the first line has 4"
    );

    let error = read(Path::new("no/such/file.csv")).unwrap_err().to_string();
    assert!(error.starts_with("cannot read particle file `no/such/file.csv`: "), "{error}");
}

/// As text and as both binaries, with properties in another order and other elements around.
#[test]
fn ply_of_every_encoding_is_read() {
    let header = |format: &str| {
        format!(
            "ply\r\nformat {format} 1.0\r\nelement camera 1\r\nproperty list uchar short view\r\nelement vertex 2\r\n\
             property float Radius\r\nproperty double z\r\nproperty double x\r\nproperty double y\r\nproperty float wx\r\n\
             property float wy\r\nproperty float wz\r\nproperty uchar material\r\nproperty uchar red\r\nend_header\r\n"
        )
    };
    let rows = [
        (0.5_f32, [3.0_f64, 1.0, 2.0], [4.0_f32, 5.0, 6.0], [1_u8, 9]),
        (0.25, [0.1, -0.2, 0.3], [0.0; 3], [0, 7]),
    ];
    let mut text = header("ascii") + "2 7 -8\n";
    let mut little = header("binary_little_endian").into_bytes();
    let mut big = header("binary_big_endian").into_bytes();
    little.extend([2, 7, 0, 248, 255]);
    big.extend([2, 0, 7, 255, 248]);
    for (radius, zxy, spin, bytes) in rows {
        text += &format!("{radius} {zxy:?} {spin:?} {bytes:?}\n").replace(['[', ']', ','], " ");
        little.extend(radius.to_le_bytes());
        big.extend(radius.to_be_bytes());
        for x in zxy {
            little.extend(x.to_le_bytes());
            big.extend(x.to_be_bytes());
        }
        for x in spin {
            little.extend(x.to_le_bytes());
            big.extend(x.to_be_bytes());
        }
        little.extend(bytes);
        big.extend(bytes);
    }
    for (name, content) in [("text", text.as_bytes()), ("little", &little[..]), ("big", &big[..])] {
        let columns = glebe_io::particles::parse(Path::new("p.ply"), content).unwrap();
        assert_eq!(columns.position, [[1.0, 2.0, 3.0], [-0.2, 0.3, 0.1]], "{name}");
        assert_eq!((columns.radius.as_slice(), columns.velocity.len()), (&[0.5, 0.25][..], 0), "{name}");
        assert_eq!(
            (columns.spin[0], columns.ignored.as_slice()),
            ([4.0, 5.0, 6.0], &["red".to_owned()][..]),
            "{name}"
        );
        assert_eq!(columns.into_set(&materials(), None).unwrap().material, [1, 0], "{name}");
    }
}

#[test]
fn ply_that_is_no_bed_is_refused() {
    let ply = |properties: &str, rows: &str| {
        let properties =
            properties.split(' ').fold(String::new(), |all, p| format!("{all}property float {p}\n"));
        let text = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n{rows}");
        glebe_io::particles::parse(Path::new("p.ply"), text.as_bytes()).unwrap_err().to_string()
    };
    for (error, expected) in [
        (
            ply("x y z", "0 0 0\n"),
            ", line 1: expected vertices with the properties x, y, z and radius, found `element vertex`",
        ),
        (
            ply("x y z radius vx", "0 0 0 1 0\n"),
            ", line 1: expected vertices with vx, vy and vz, or none of them, found `element vertex`",
        ),
        (ply("x y z radius", "0 0 0 -1\n"), ", particle 0 (from 0): radius is -1; it must be greater than 0"),
        (
            ply("x y z radius", "0 nan 0 1\n"),
            ", particle 0 (from 0): a number is NaN; numbers must be finite",
        ),
        (ply("x y z radius", "0 up 0 1\n"), ", line 9: expected a number, found `up`"),
        (
            ply("x y z radius", "0 0\n"),
            " is cut short: it ends at line 10, where more numbers should follow; copy or export it again",
        ),
    ] {
        assert_eq!(error, format!("particle file `p.ply`{expected}"));
    }
    let empty = "ply\nformat ascii 1.0\nend_header\n";
    let error = glebe_io::particles::parse(Path::new("p.ply"), empty.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("is empty"), "{error}");
}
