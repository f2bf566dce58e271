//! Tables of poses: what files say, and what is refused, with its line.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail by panicking")]

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use glebe_engine::poses::PoseTable;
use glebe_io::poses::{PoseFileError, parse, read};

fn table(text: &str) -> Result<PoseTable, PoseFileError> {
    parse(Path::new("p.csv"), text.as_bytes())
}

fn refusal(text: &str) -> String {
    table(text).unwrap_err().to_string()
}

#[test]
fn a_path_with_units_is_read() {
    let path = table("# x [mm], T [ms], z, y (cm)\n5, 100, 1, 2\r\n\n10, 300, 3, 2\n").unwrap();
    let at = path.at(0.2);
    for (got, expected) in [(at.pose.translation, [0.0025, 0.0, 1.0]), (at.velocity, [0.025, 0.0, 10.0])] {
        assert!((0..3).all(|k| (got[k] - expected[k]).abs() < 1e-12), "{got:?} instead of {expected:?}");
    }
    assert_eq!(at.spin, [0.0; 3]);
}

/// A quarter of a turn about y in a second, as quaternions, as vectors in radians and in degrees.
#[test]
fn rotations_are_read() {
    let half = (0.5 * FRAC_PI_2).sin();
    let texts = [
        format!("time,x,y,z,qw,qx,qy,qz\n0,0,0,0,2,0,0,0\n1,0,0,0,-{half},0,-{half},0\n"),
        format!("time,x,y,z,rx,ry,rz\n0,0,0,0,0,0,0\n1,0,0,0,0,{FRAC_PI_2},0\n"),
        "time,x,y,z,rx [deg],ry [deg],rz [deg]\n0,0,0,0,0,0,0\n1,0,0,0,0,90,0\n".to_owned(),
    ];
    for text in texts {
        let at = table(&text).unwrap().at(0.5);
        let expected = [(0.25 * FRAC_PI_2).cos(), 0.0, (0.25 * FRAC_PI_2).sin(), 0.0];
        assert!((0..4).all(|k| (at.pose.rotation[k] - expected[k]).abs() < 1e-12), "{at:?} of\n{text}");
        assert!((at.spin[1] - FRAC_PI_2).abs() < 1e-12, "{at:?} of\n{text}");
    }
}

#[test]
fn what_is_wrong_is_told_with_its_line() {
    let known = "known are time, x, y, z (needed) and qw, qx, qy, qz or rx, ry, rz, each with a unit if need be, such \
                 as `x [mm]`";
    let begin = "time,x,y,z\n0,0,0,0\n";
    for (text, expected) in [
        (String::new(), " is empty: it needs a header such as `time,x,y,z` and two lines or more".to_owned()),
        ("0,0,0,0\n1,0,0,0\n".to_owned(), format!(", line 1: no column `time` among `0`, `0`, `0`, `0`; {known}")),
        ("time,x,y\n".to_owned(), format!(", line 1: no column `z` among `time`, `x`, `y`; {known}")),
        (
            "time,x,y,z,qw,qx,qy\n".to_owned(),
            format!(", line 1: no column `qz` among `time`, `x`, `y`, `z`, `qw`, `qx`, `qy`; {known}"),
        ),
        ("time,x,y,z,roll\n".to_owned(), format!(", line 1: no column is called `roll`; {known}")),
        (
            "time,x,y,z,t\n".to_owned(),
            ", line 1: two columns mean `time`: rename or remove one".to_owned(),
        ),
        (
            "time,x,y,z,qw,qx,qy,qz,rx,ry,rz\n".to_owned(),
            ", line 1: rotations as quaternions (qw, qx, qy, qz) and as vectors (rx, ry, rz): remove one".to_owned(),
        ),
        (
            "time [mm],x,y,z\n".to_owned(),
            ", line 1: column `time [mm]`: `mm` is a length, not a time".to_owned(),
        ),
        ("time,x,y,z\n".to_owned(), ": 0 rows of poses: a motion needs two or more".to_owned()),
        (begin.to_owned(), ": 1 rows of poses: a motion needs two or more".to_owned()),
        (format!("{begin}1,0,nan,0\n"), ", line 3, column 3 (y): `nan` is not finite".to_owned()),
        (format!("{begin}1,0,up,0\n"), ", line 3, column 3 (y): `up` is not a number".to_owned()),
        (format!("{begin}1,0,0\n"), ", line 3: 3 fields, but the first line has 4".to_owned()),
        (
            format!("{begin}2,0,0,0\n\n2,0,0,1\n"),
            ", line 5: the time 2 s does not come after 2 s of the row before; times must increase".to_owned(),
        ),
        (
            "time,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0,0,0,0,0\n".to_owned(),
            ", line 3: the quaternion has the length 0 and is no rotation; no rotation at all is 1, 0, 0, 0".to_owned(),
        ),
        (
            "time,x,y,z,rx [deg],ry,rz\n0,0,0,0,0,0,0\n1,0,0,0,180,0,0\n".to_owned(),
            ", line 3: it is half a turn from the row before, which may go either way; rows must be less than half a \
             turn apart, so put one between"
                .to_owned(),
        ),
    ] {
        assert_eq!(refusal(&text), format!("pose table `p.csv`{expected}"), "{text}");
    }
    let error = read(Path::new("no/such/file.csv")).unwrap_err().to_string();
    assert!(error.starts_with("cannot read pose table `no/such/file.csv`: "), "{error}");
}
