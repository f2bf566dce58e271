//! Particle files as GPUDEM and its users write them, and their mistakes.

#![allow(clippy::unwrap_used, reason = "a test ends there")]

use std::{collections::BTreeMap, fs, path::Path};

use glebe_engine::spec::ParticleSet;
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
        message("no-r", "x,y,z,radius\n0,0,0,1\n"),
        "particle file `FILE`, line 1: no column `R` among `x`, `y`, `z`, `radius`; known are x, y, z, R (needed), \
         vx, vy, vz, wx, wy, wz and material"
    );
    assert!(message("no-vz", "\nx,y,z,R,vx,vy\n0,0,0,1,0,0\n").contains("line 2: no column `vz` among `x`"));
    assert_eq!(
        message("twice", "x,y,z,R,X\n0,0,0,1,0\n"),
        "particle file `FILE`, line 1: two columns are called `X` (case does not matter): rename or remove one"
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
