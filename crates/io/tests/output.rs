//! What runs leave on disk: whole files, nobody else's touched, and read by others' programs.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends there")]

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use glebe_io::output::series::{Series, SeriesWriter};
use glebe_io::output::summary::{Lost, Measure, Particles, Performance, Provenance, Stage, Status, Summary};
use glebe_io::output::vti::ImageData;
use glebe_io::output::vtp::{Cells, Column, Part, PolyData, Values};
use glebe_io::output::{
    Cell, FrameWriter, Journal, OutputDir, OutputError, SVG_MARK, pvd, write_atomic, write_table,
};

/// A fresh place for one test, which does not exist yet.
fn place(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("output").join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    path
}

/// The same, as an existing folder.
fn folder(name: &str) -> PathBuf {
    let path = place(name);
    fs::create_dir_all(&path).unwrap();
    path
}

/// All files below a folder, with `/`, but for the one that is locked.
fn files(dir: &Path) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            found.extend(files(&path).into_iter().map(|file| format!("{name}/{file}")));
        } else {
            found.push(name);
        }
    }
    found.retain(|name| name != ".glebe-lock");
    found.sort();
    found
}

fn touch(path: &Path, content: &str) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, content).unwrap();
}

mod atomic {
    use super::*;

    #[test]
    fn a_file_is_replaced_whole() {
        let path = folder("replaced").join("a.txt");
        for text in ["first, and longer", "second"] {
            write_atomic(&path, |out| out.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(files(path.parent().unwrap()), ["a.txt"]);
    }

    /// A disk that fills up in the middle of a file: what was there stays, and nothing half is left.
    #[test]
    fn a_full_disk_leaves_the_old_file() {
        let path = folder("full-disk").join("a.txt");
        fs::write(&path, "old").unwrap();
        let error = write_atomic(&path, |out| {
            out.write_all(&vec![b'x'; 100_000])?;
            Err(ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(files(path.parent().unwrap()), ["a.txt"]);
        let text = error.to_string();
        assert!(text.starts_with(path.to_str().unwrap()), "{text}");
        assert!(text.contains("cannot write this file") && text.contains("free some space"), "{text}");
    }

    #[test]
    fn a_closure_that_panics_leaves_the_old_file() {
        let path = folder("panic").join("a.txt");
        fs::write(&path, "old").unwrap();
        let panicked = std::panic::catch_unwind(|| {
            write_atomic(&path, |out| {
                out.write_all(&vec![b'x'; 100_000])?;
                panic!("as if the process were killed here")
            })
        });
        assert!(panicked.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
    }

    #[test]
    fn places_that_cannot_be_written_to_get_advice() {
        let dir = folder("advice");
        fs::write(dir.join("file"), "").unwrap();
        for (path, advice) in [
            (dir.join("absent/a.txt"), "the folder it should be in does not exist"),
            (dir.join("file/a.txt"), "a part of this path is a file"),
        ] {
            let text = write_atomic(&path, |_| Ok(())).unwrap_err().to_string();
            assert!(text.starts_with(path.to_str().unwrap()) && text.contains(advice), "{text}");
        }
        for (kind, advice) in [
            (ErrorKind::ReadOnlyFilesystem, "mounted read-only"),
            (ErrorKind::PermissionDenied, "change the folder's permissions"),
        ] {
            let text = write_atomic(&dir.join("a.txt"), |_| Err(kind.into())).unwrap_err().to_string();
            assert!(text.contains(advice), "{text}");
        }
        assert_eq!(files(&dir), ["file"]);
    }
}

mod dir {
    use super::*;

    #[test]
    fn a_folder_with_something_in_it_is_refused() {
        let path = place("occupied");
        OutputDir::create(&path, false).unwrap();
        // An empty one is as good as a new one, also with what a crash left in it.
        touch(&path.join(".glebe-partial-1-2"), "");
        OutputDir::create(&path, false).unwrap();

        touch(&path.join("thesis.docx"), "");
        let error = OutputDir::create(&path, false).unwrap_err();
        assert!(
            matches!(&error, OutputError::NotEmpty { example, .. } if example == "thesis.docx"),
            "{error}"
        );
        let text = error.to_string();
        for word in ["--force", "--out", "--resume", path.to_str().unwrap()] {
            assert!(text.contains(word), "{text}");
        }

        let file = path.join("thesis.docx");
        assert!(matches!(OutputDir::create(&file, true), Err(OutputError::NotAFolder { .. })));
    }

    #[test]
    fn force_removes_only_what_glebe_writes() {
        let path = place("forced");
        let own_svg = format!("{SVG_MARK}\n<svg/>");
        for own in [
            "series.csv",
            "summary.json",
            "frames.pvd",
            "frames/000000_particles.vtp",
            "frames/.glebe-partial-7-0",
            "checkpoint/000012.glebe",
            ".glebe-partial-7-1",
        ] {
            touch(&path.join(own), "");
        }
        touch(&path.join("energies.svg"), &own_svg);
        let foreign = [
            "checkpoint/notes.txt",
            "drawing.svg",
            "frames/mine.vtp",
            "frames/old/000000_a.vtp",
            "scene.toml",
            "series.csv.bak",
            "tool.stl",
        ];
        for name in foreign {
            touch(&path.join(name), "");
        }
        OutputDir::create(&path, true).unwrap();
        assert_eq!(files(&path), foreign);
    }

    #[test]
    fn force_leaves_no_empty_folders_of_its_own() {
        let path = place("forced-clean");
        touch(&path.join("frames/000000_particles.vtp"), "");
        touch(&path.join("checkpoint/000012.glebe"), "");
        OutputDir::create(&path, true).unwrap();
        assert!(cfg!(not(unix)) || fs::read_dir(&path).unwrap().count() == 0);
    }

    /// A linked frames folder may hold somebody else's files.
    #[cfg(unix)]
    #[test]
    fn force_does_not_follow_links() {
        let path = folder("forced-link");
        let elsewhere = folder("forced-link-target");
        touch(&elsewhere.join("000000_a.vtp"), "");
        std::os::unix::fs::symlink(&elsewhere, path.join("frames")).unwrap();
        std::os::unix::fs::symlink(elsewhere.join("000000_a.vtp"), path.join("series.csv")).unwrap();
        OutputDir::create(&path, true).unwrap();
        assert_eq!(files(&elsewhere), ["000000_a.vtp"]);
        assert!(path.join("series.csv").is_symlink());
    }

    #[test]
    fn resuming_needs_a_checkpoint() {
        let path = place("resumed");
        let why = |path: &Path| OutputDir::open_existing(path).unwrap_err().to_string();
        assert!(why(&path).contains("does not exist"), "{}", why(&path));
        touch(&path.join("checkpoint/notes.txt"), "");
        assert!(why(&path).contains("holds no checkpoint"), "{}", why(&path));
        touch(&path.join("checkpoint/000000.glebe"), "");
        assert_eq!(OutputDir::open_existing(&path).unwrap().path(), path);
    }

    #[test]
    fn scenes_that_it_wrote_are_replaced_and_no_others() {
        let path = folder("scenes");
        let dir = OutputDir::create(&path, false).unwrap();
        let written = dir.write_scene("best", "seed = 1\n", "the best\nof all").unwrap();
        assert_eq!(fs::read_to_string(&written).unwrap(), "# written by glebe: the best of all\nseed = 1\n");
        dir.write_scene("best", "seed = 2\n", "another").unwrap();
        touch(&path.join("mine.toml"), "seed = 3\n");
        assert!(matches!(dir.write_scene("mine", "", ""), Err(OutputError::Foreign { .. })));
        touch(&path.join("evaluations.csv"), "");
        drop(dir);
        OutputDir::create(&path, true).unwrap();
        assert_eq!(files(&path), ["mine.toml"]);
    }

    #[test]
    fn the_copy_of_a_study_is_known_again_and_no_other_is_touched() {
        let path = folder("study");
        let study = path.join("study.toml");
        let dir = OutputDir::create(&path, false).unwrap();
        dir.write_study("scene = \"s\"\n", &["points=4\nseed=1".to_owned()]).unwrap();
        assert_eq!(
            fs::read_to_string(&study).unwrap(),
            "# copied by glebe\n# --set points=4 seed=1\nscene = \"s\"\n"
        );
        assert!(OutputDir::is_vacant(&path).unwrap(), "there is no journal yet");
        touch(&path.join("journal.jsonl"), "");
        assert!(!OutputDir::is_vacant(&path).unwrap());
        drop(dir);
        assert_eq!(OutputDir::open_study(&path).unwrap().path(), path);
        OutputDir::create(&path, true).unwrap();
        assert_eq!(files(&path), [""; 0]);
        touch(&study, "scene = \"mine\"\n");
        let dir = OutputDir::create(&path, true).unwrap();
        assert!(matches!(dir.write_study("", &[]), Err(OutputError::Foreign { .. })));
        assert_eq!(fs::read_to_string(&study).unwrap(), "scene = \"mine\"\n");
        drop(dir);
        assert!(OutputDir::open_study(&path).unwrap_err().to_string().contains("holds no journal"));
    }

    #[test]
    fn a_folder_in_use_is_refused_whatever_is_asked_for() {
        let path = place("in-use");
        let first = OutputDir::create(&path, false).unwrap();
        touch(&path.join("checkpoint/000000.glebe"), "");
        touch(&path.join("journal.jsonl"), "");
        touch(&path.join("frames/.glebe-partial-7-2"), "being written");
        let before = files(&path);
        let tries = [
            OutputDir::create(&path, false),
            OutputDir::create(&path, true),
            OutputDir::open_existing(&path),
            OutputDir::open_study(&path),
        ];
        for tried in tries {
            let error = tried.unwrap_err();
            assert!(matches!(error, OutputError::InUse { .. }) && error.is_input(), "{error}");
            let text = error.to_string();
            for word in ["another run", "--out", path.to_str().unwrap()] {
                assert!(text.contains(word), "{text}");
            }
        }
        assert_eq!(files(&path), before, "the other run's files were touched");
        // As long as a copy of it lives.
        let copy = first.clone();
        drop(first);
        assert!(OutputDir::open_existing(&path).is_err());
        drop(copy);
        OutputDir::open_existing(&path).unwrap();
        // What is refused for another reason is not locked, nor is a file left in it.
        let other = folder("not-locked");
        touch(&other.join("thesis.docx"), "");
        assert!(OutputDir::create(&other, false).is_err() && OutputDir::open_existing(&other).is_err());
        assert_eq!(fs::read_dir(&other).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_run_left_unfinished_goes() {
        let path = place("killed");
        for left in ["frames/.glebe-partial-7-2", "checkpoint/.glebe-partial-7-3", ".glebe-partial-7-1"] {
            touch(&path.join(left), "half");
        }
        touch(&path.join("checkpoint/000004.glebe"), "");
        OutputDir::open_existing(&path).unwrap();
        assert_eq!(files(&path), ["checkpoint/000004.glebe"]);
    }

    #[test]
    fn a_run_killed_before_its_first_checkpoint_leaves_a_folder_as_good_as_new() {
        let path = place("vacant");
        assert!(!OutputDir::is_vacant(&path).unwrap(), "there is no folder");
        touch(&path.join(".glebe-partial-7-0"), "");
        touch(&path.join("checkpoint/.glebe-partial-7-1"), "half");
        assert!(OutputDir::is_vacant(&path).unwrap());
        OutputDir::create(&path, false).unwrap();
        assert_eq!(files(&path), [""; 0]);
        touch(&path.join("checkpoint/000000.glebe"), "");
        assert!(!OutputDir::is_vacant(&path).unwrap());
        assert!(OutputDir::create(&path, false).is_err());
    }
}

mod studies {
    use super::*;

    #[test]
    fn a_journal_loses_its_unfinished_line_alone() {
        let path = folder("journal").join("journal.jsonl");
        let mut journal = Journal::create(&path, &"head").unwrap();
        journal.append(&[1.0, f64::NAN]).unwrap();
        journal.append(&[0.1 + 0.2]).unwrap();
        fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(b"[3.0, 4").unwrap();
        let (head, entries, mut journal) = Journal::resume::<String, Vec<Option<f64>>>(&path).unwrap();
        assert_eq!((head.as_str(), entries), ("head", vec![vec![Some(1.0), None], vec![Some(0.1 + 0.2)]]));
        journal.append(&[5.0]).unwrap();
        assert_eq!(
            fs::read_to_string(&path).unwrap(),
            "\"head\"\n[1.0,null]\n[0.30000000000000004]\n[5.0]\n"
        );
        let wrong = Journal::resume::<String, String>(&path).unwrap_err().to_string();
        assert!(wrong.contains("line 2 is not of a journal"), "{wrong}");
    }

    #[test]
    fn tables_hold_numbers_counts_and_texts() {
        let path = folder("table").join("worlds.csv");
        let header = ["a", "b", "c"].map(str::to_owned);
        let rows = [
            vec![Cell::Number(0.1), Cell::Count(3), Cell::Text("one, \"two\"\nthree".to_owned())],
            vec![Cell::Number(f64::NAN), Cell::Number(2e6), Cell::Text(String::new())],
        ];
        write_table(&path, &header, &rows).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert_eq!(text, "a,b,c\n0.1,3,\"one, \"\"two\"\" three\"\n,2000000,\n");
        let short = write_table(&path, &header, &[vec![Cell::Count(1)]]);
        assert!(matches!(short, Err(OutputError::Columns { .. })));
    }
}

mod series_csv {
    use super::*;

    const VALUES: [f64; 12] = [
        0.0,
        -0.0,
        1e-7,
        0.1 + 0.2,
        1e15,
        12345.0,
        -2.5,
        f64::MIN_POSITIVE,
        f64::MAX,
        f64::INFINITY,
        1.0 / 3.0,
        9007199254740993.0,
    ];

    #[test]
    fn numbers_come_back_to_the_bit() {
        let path = folder("series").join("series.csv");
        let names = ["time", "step", "tool, \"left\".fx"];
        let mut writer = SeriesWriter::create(&path, &names).unwrap();
        writer.append(&VALUES[..3]).unwrap();
        writer.append(&VALUES[3..]).unwrap();
        writer.append(&[]).unwrap();
        writer.append(&[f64::NAN, 0.0, 0.0]).unwrap();
        assert_eq!(writer.rows(), 5);

        let series = Series::read(&path).unwrap();
        assert_eq!(series.names, names);
        for (k, value) in VALUES.iter().enumerate() {
            assert_eq!(series.columns[k % 3][k / 3].to_bits(), value.to_bits());
        }
        assert!(series.column("time").unwrap()[4].is_nan());
        assert_eq!((series.rows(), series.column("absent")), (5, None));
        let text = fs::read_to_string(&path).unwrap();
        assert!(
            text.starts_with("time,step,\"tool, \"\"left\"\".fx\"\n0,-0,1e-7\n0.30000000000000004,"),
            "{text}"
        );
    }

    #[test]
    fn resuming_cuts_off_what_came_after_the_checkpoint() {
        let path = folder("series-resume").join("series.csv");
        let names = ["time", "energy"];
        let mut writer = SeriesWriter::create(&path, &names).unwrap();
        let row = |k: usize| [k as f64 * 1e-3, 1.0 / (k as f64 + 1.0)];
        for k in 0..10 {
            writer.append(&row(k)).unwrap();
        }
        drop(writer);
        let whole = fs::read(&path).unwrap();
        // As if the machine had stopped in the middle of a row.
        fs::OpenOptions::new().append(true).open(&path).unwrap().write_all(b"0.01,0.0").unwrap();
        assert_eq!(Series::read(&path).unwrap().rows(), 10);

        for keep in [10_u64, 7, 0] {
            let mut writer = SeriesWriter::resume(&path, &names, keep).unwrap();
            assert_eq!(Series::read(&path).unwrap().rows() as u64, keep);
            for k in keep as usize..10 {
                writer.append(&row(k)).unwrap();
            }
            writer.sync().unwrap();
            assert_eq!(writer.rows(), 10);
            assert_eq!(fs::read(&path).unwrap(), whole);
        }

        let few = SeriesWriter::resume(&path, &names, 11).unwrap_err().to_string();
        assert!(few.contains("holds 10 rows, but the checkpoint was taken after 11"), "{few}");
        let other = SeriesWriter::resume(&path, &["time", "force"], 7).unwrap_err().to_string();
        assert!(other.contains("its columns are not those of this scene"), "{other}");
        assert_eq!(fs::read(&path).unwrap(), whole, "a refused file is not touched");
    }

    #[test]
    fn wrong_columns_and_wrong_files_are_told() {
        let path = folder("series-wrong").join("series.csv");
        assert!(matches!(SeriesWriter::create(&path, &[]), Err(OutputError::Columns { .. })));
        let twice = SeriesWriter::create(&path, &["a", "b", "a"]).unwrap_err().to_string();
        assert!(twice.contains("`a` stands twice"), "{twice}");
        let mut writer = SeriesWriter::create(&path, &["a", "b"]).unwrap();
        assert!(matches!(writer.append(&[1.0, 2.0, 3.0]), Err(OutputError::Columns { .. })));

        for (text, expected) in [
            ("", "holds no header line"),
            ("a,b\n1,2\n3,x\n", "line 3, column `b`: `x` is not a number"),
            ("a,b\n1\n", "line 2 has 1 values for 2 columns"),
            ("a,b\n1,2,3\n", "line 2 has 3 values for 2 columns"),
        ] {
            fs::write(&path, text).unwrap();
            let error = Series::read(&path).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        fs::write(&path, [0xff, 0xfe, 0x00]).unwrap();
        assert!(matches!(Series::read(&path), Err(OutputError::Malformed { .. })));
    }
}

mod summary_json {
    use super::*;

    fn summary() -> Summary {
        let draught = Measure { mean: 309.5, std: 14.5, n: 401 };
        Summary {
            title: "A sweep through sandy soil".to_owned(),
            status: Status::Interrupted,
            reason: Some("stopped by Ctrl-C".to_owned()),
            provenance: Provenance {
                version: "0.1.0".to_owned(),
                commit: None,
                scene_hash: "abc".to_owned(),
                seed: u64::MAX,
            },
            device: "cpu (2 threads)".to_owned(),
            state_hash: "0123".to_owned(),
            particles: Particles {
                count: 38912,
                lost: vec![Lost { id: 7, time: 0.1, position: [1.0, 2.0, 3.0], side: "+z".to_owned() }],
                removed: 12,
            },
            stages: vec![Stage {
                name: "till".to_owned(),
                ended_by: "time".to_owned(),
                start: 1.5,
                duration: 0.8,
                measures: [("draught_force".to_owned(), draught)].into(),
            }],
            performance: Performance {
                particle_steps_per_second: 1.6e7,
                wall_s: 62.5,
                steps: 8000,
                phases: [("contacts".to_owned(), 40.0)].into(),
            },
            warnings: vec!["the step is large".to_owned()],
            notes: vec!["the bed was reused".to_owned()],
        }
    }

    #[test]
    fn scripts_find_the_fixed_names() {
        let path = folder("summary").join("summary.json");
        summary().write(&path).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        for (pointer, expected) in [
            ("/state_hash", serde_json::json!("0123")),
            ("/status", "interrupted".into()),
            ("/device", "cpu (2 threads)".into()),
            ("/warnings/0", "the step is large".into()),
            ("/particles/count", 38912.into()),
            ("/particles/lost/0/id", 7.into()),
            ("/particles/lost/0/time", 0.1.into()),
            ("/particles/lost/0/position/2", 3.0.into()),
            ("/particles/lost/0/side", "+z".into()),
            ("/stages/0/name", "till".into()),
            ("/stages/0/ended_by", "time".into()),
            ("/stages/0/measures/draught_force/mean", 309.5.into()),
            ("/stages/0/measures/draught_force/std", 14.5.into()),
            ("/stages/0/measures/draught_force/n", 401.into()),
            ("/performance/particle_steps_per_second", 1.6e7.into()),
            ("/performance/wall_s", 62.5.into()),
            ("/performance/phases/contacts", 40.0.into()),
            ("/provenance/version", "0.1.0".into()),
            ("/provenance/commit", serde_json::Value::Null),
            ("/provenance/scene_hash", "abc".into()),
            ("/provenance/seed", u64::MAX.into()),
        ] {
            assert_eq!(json.pointer(pointer), Some(&expected), "{pointer}");
        }
        assert_eq!(Summary::read(&path).unwrap(), summary());
    }

    #[test]
    fn a_mean_of_nothing_is_null() {
        let path = folder("summary-nan").join("summary.json");
        let mut empty = summary();
        let nothing = Measure { mean: f64::NAN, std: f64::NAN, n: 0 };
        empty.stages[0].measures.insert("nothing".to_owned(), nothing);
        empty.write(&path).unwrap();
        let json: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        assert_eq!(json.pointer("/stages/0/measures/nothing/mean"), Some(&serde_json::Value::Null));
        let back = Summary::read(&path).unwrap();
        assert!(back.stages[0].measures["nothing"].mean.is_nan());

        fs::write(&path, "{\"status\": 3}").unwrap();
        let error = Summary::read(&path).unwrap_err().to_string();
        assert!(error.contains("line 1 column"), "{error}");
    }
}

mod frames {
    use super::*;

    const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.1], [1.0, 0.0, 0.2], [1.0, 1.0, 0.3], [0.0, 1.0, 1.0 / 3.0]];
    const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 3]];
    const PRESSURE: [f32; 2] = [1.25e5, -0.0];

    /// Columns of a cloud of `n` particles, with values that f32 cannot round away.
    struct Cloud {
        position: Vec<[f64; 3]>,
        id: Vec<u32>,
        radius: Vec<f32>,
        material: Vec<i32>,
        velocity: Vec<[f32; 3]>,
        energy: Vec<f64>,
    }

    impl Cloud {
        fn new(n: u32) -> Self {
            let x = |k: u32, c: u32| (f64::from(k) * 1.37 + f64::from(c)).sin() / 3.0;
            Self {
                position: (0..n).map(|k| [x(k, 0), x(k, 1), x(k, 2)]).collect(),
                id: (0..n).map(|k| u32::MAX - k).collect(),
                radius: (0..n).map(|k| 0.0085 + k as f32 * 1e-7).collect(),
                material: (0..n).map(|k| -(k as i32 % 3)).collect(),
                velocity: (0..n).map(|k| [x(k, 3) as f32, x(k, 4) as f32, f32::MIN_POSITIVE]).collect(),
                energy: (0..n).map(|k| x(k, 5) * 1e-12).collect(),
            }
        }

        fn data(&self) -> PolyData<'_> {
            PolyData {
                points: Values::Vec3F64(&self.position),
                cells: Cells::Points,
                point_data: vec![
                    Column::new("id", Values::U32(&self.id)),
                    Column::new("radius", Values::F32(&self.radius)),
                    Column::new("material", Values::I32(&self.material)),
                    Column::new("velocity", Values::Vec3F32(&self.velocity)),
                    Column::new("energy <J> & \"more\"", Values::F64(&self.energy)),
                ],
                cell_data: Vec::new(),
            }
        }
    }

    fn mesh() -> PolyData<'static> {
        PolyData {
            points: Values::Vec3F64(&CORNERS),
            cells: Cells::Triangles(&TRIANGLES),
            point_data: Vec::new(),
            cell_data: vec![Column::new("pressure", Values::F32(&PRESSURE))],
        }
    }

    /// What VTK makes of a collection. Without python3 and its `vtk` package there is nothing to
    /// compare: an error in CI, a notice elsewhere.
    fn read_with_vtk(collection: &Path) -> Option<serde_json::Value> {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/output_vtk.py");
        let python = std::env::var("GLEBE_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let output = Command::new(python).arg(script).arg(collection).output();
        match output {
            Ok(output) if output.status.success() => Some(serde_json::from_slice(&output.stdout).unwrap()),
            Ok(output) if output.status.code() != Some(77) => {
                panic!("the script failed: {}", String::from_utf8_lossy(&output.stderr))
            }
            _ => {
                let notice =
                    "not compared with VTK's reader: needs python3 with the package vtk (run scripts/test)";
                assert!(std::env::var_os("CI").is_none(), "{notice}");
                eprintln!("NOTICE: {notice}");
                None
            }
        }
    }

    fn numbers<T: std::str::FromStr<Err: std::fmt::Debug>>(values: &serde_json::Value) -> Vec<T> {
        values.as_array().unwrap().iter().map(|v| v.as_str().unwrap().parse().unwrap()).collect()
    }

    fn column(data: &serde_json::Value, name: &str, kind: &str, components: u64) -> serde_json::Value {
        let column = &data[name];
        assert_eq!((&column["type"], &column["components"]), (&kind.into(), &components.into()), "{name}");
        column["values"].clone()
    }

    #[test]
    fn vtk_reads_back_what_was_written() {
        let dir = OutputDir::create(&place("vtk"), false).unwrap();
        let mut writer = FrameWriter::create(dir.frames(), &["particles", "the <tool>"]).unwrap();
        // None, one, and enough for several compressed blocks with a whole and a broken last one.
        let clouds = [0, 1, 32768, 40001].map(Cloud::new);
        for (k, cloud) in clouds.iter().enumerate() {
            let mut parts = vec![(0, cloud.data())];
            if k > 0 {
                parts.push((1, mesh()));
            }
            writer.write(k as f64 * 0.02, &parts).unwrap();
        }
        let Some(found) = read_with_vtk(&dir.frames().list) else { return };
        let found = found.as_array().unwrap();
        assert_eq!(found.len(), 7);
        for set in found {
            assert_eq!(set["errors"], serde_json::json!([]));
            assert_eq!(set["field_data"]["TimeValue"]["values"][0], set["timestep"]);
        }

        let sets = found.iter().filter(|set| set["part"] == "0");
        for (cloud, set) in clouds.iter().zip(sets) {
            let n = cloud.id.len() as u64;
            assert_eq!(numbers::<f64>(&set["points"]), cloud.position.as_flattened());
            let verts: Vec<serde_json::Value> = (0..n).map(|k| serde_json::json!([k])).collect();
            assert_eq!(set["verts"], serde_json::Value::from(verts));
            assert_eq!(set["polys"], serde_json::json!([]));
            let data = &set["point_data"];
            assert_eq!(numbers::<u32>(&column(data, "id", "unsigned int", 1)), cloud.id);
            assert_eq!(numbers::<i32>(&column(data, "material", "int", 1)), cloud.material);
            assert_eq!(numbers::<f64>(&column(data, "energy <J> & \"more\"", "double", 1)), cloud.energy);
            // Python prints the float's value as a double, which is exact.
            let single = |name, components| -> Vec<f32> {
                let wide = numbers::<f64>(&column(data, name, "float", components));
                wide.iter().map(|&x| x as f32).collect()
            };
            assert_eq!(single("radius", 1), cloud.radius);
            assert_eq!(single("velocity", 3), cloud.velocity.as_flattened());
        }

        let tools: Vec<_> = found.iter().filter(|set| set["part"] == "1").collect();
        assert_eq!(tools.len(), 3);
        for set in tools {
            assert_eq!(set["name"], "the <tool>");
            assert_eq!(numbers::<f64>(&set["points"]), CORNERS.as_flattened());
            assert_eq!(set["polys"], serde_json::json!(TRIANGLES));
            assert_eq!(set["verts"], serde_json::json!([]));
            let pressure = numbers::<f64>(&column(&set["cell_data"], "pressure", "float", 1));
            assert_eq!(pressure, [1.25e5, 0.0]);
        }
    }

    #[test]
    fn the_same_columns_give_the_same_file_whatever_the_threads() {
        let dir = folder("threads");
        let cloud = Cloud::new(200_000);
        let bytes = [1, 3].map(|threads| {
            let path = dir.join(format!("{threads}.vtp"));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| cloud.data().write(&path, 0.1)).unwrap();
            fs::read(path).unwrap()
        });
        assert!(bytes[0] == bytes[1]);
    }

    #[test]
    fn vtk_reads_fields_and_lines() {
        let dir = OutputDir::create(&place("vtk-fields"), false).unwrap();
        let cells = [3_usize, 2, 4];
        let n = cells.iter().product::<usize>();
        let x = |k: usize, c: usize| (k as f64 * 1.37 + c as f64).sin() / 3.0;
        let density: Vec<f64> = (0..n).map(|k| x(k, 0)).collect();
        let velocity: Vec<[f64; 3]> = (0..n).map(|k| [x(k, 1), x(k, 2), x(k, 3)]).collect();
        let stress: Vec<[[f64; 3]; 3]> = (0..n).map(|k| [0, 3, 6].map(|c| [x(k, c), x(k, 4), 0.1])).collect();
        let image = ImageData {
            origin: [-0.1, 0.2, 0.0],
            spacing: [0.1, 0.25, 0.5],
            cells,
            cell_data: vec![
                Column::new("density", Values::F64(&density)),
                Column::new("velocity", Values::Vec3F64(&velocity)),
                Column::new("stress", Values::TensorF64(&stress)),
            ],
        };
        let mut writer = FrameWriter::create(dir.field("core 1"), &["core-1"]).unwrap();
        writer.write(0.5, &[(0, image.clone())]).unwrap();
        let few = ImageData { cells: [3, 2, 3], ..image };
        let refused = writer.write(1.0, &[(0, few)]).unwrap_err().to_string();
        assert!(refused.contains("column `density` has 24 values for 18 cells"), "{refused}");
        assert_eq!(files(dir.path()), ["fields/000000_core-1.vti", "fields/core-1.pvd"]);
        let force = [[0.0, 1.0, 2.0_f32], [3.0, 4.0, 5.0]];
        let lines = PolyData {
            points: Values::Vec3F64(&CORNERS),
            cells: Cells::Lines(&[[0, 1], [2, 3]]),
            point_data: Vec::new(),
            cell_data: vec![Column::new("force", Values::Vec3F32(&force))],
        };
        let mut frames = FrameWriter::create(dir.frames(), &["contacts"]).unwrap();
        frames.write(0.5, &[(0, lines)]).unwrap();
        let (field, frames) = (dir.field("core 1").list, dir.frames().list);
        let (Some(field), Some(contacts)) = (read_with_vtk(&field), read_with_vtk(&frames)) else { return };
        let (field, contacts) = (&field[0], &contacts[0]);
        assert_eq!((&field["errors"], &contacts["errors"]), (&serde_json::json!([]), &serde_json::json!([])));
        assert_eq!(field["dimensions"], serde_json::json!([4, 3, 5]));
        let bounds = numbers::<f64>(&field["bounds"]);
        let expected = [-0.1, 0.2, 0.2, 0.7, 0.0, 2.0];
        assert!(bounds.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{bounds:?}");
        let data = &field["cell_data"];
        assert_eq!(numbers::<f64>(&column(data, "density", "double", 1)), density);
        assert_eq!(numbers::<f64>(&column(data, "velocity", "double", 3)), velocity.as_flattened());
        let tensors = numbers::<f64>(&column(data, "stress", "double", 9));
        assert_eq!(tensors, stress.as_flattened().as_flattened());
        assert_eq!(field["field_data"]["TimeValue"]["values"][0], field["timestep"]);
        assert_eq!(contacts["lines"], serde_json::json!([[0, 1], [2, 3]]));
        assert_eq!(
            numbers::<f32>(&column(&contacts["cell_data"], "force", "float", 3)),
            force.as_flattened()
        );
        // They are ours: another run may take their place.
        let path = dir.path().to_owned();
        drop(dir);
        assert!(files(OutputDir::create(&path, true).unwrap().path()).is_empty());
    }

    #[test]
    fn columns_that_do_not_fit_are_refused() {
        let path = folder("misfit").join("a.vtp");
        let why = |data: PolyData| data.write(&path, 0.0).unwrap_err().to_string();
        let mut data = mesh();
        data.cell_data = vec![Column::new("pressure", Values::F32(&PRESSURE[..1]))];
        assert!(why(data).contains("column `pressure` has 1 values for 2 cells"));
        let mut data = mesh();
        data.point_data = vec![Column::new("height", Values::F32(&PRESSURE))];
        assert!(why(data).contains("column `height` has 2 values for 4 points"));
        let mut data = mesh();
        data.points = Values::Vec3F64(&CORNERS[..3]);
        assert!(why(data).contains("a cell uses point 3 beyond the 3 points"));
        let mut data = mesh();
        data.points = Values::F32(&PRESSURE);
        assert!(why(data).contains("points must be vectors"));
        assert!(!path.exists());
    }

    #[test]
    fn frames_continue_after_a_checkpoint() {
        let dir = OutputDir::create(&place("frames-resume"), false).unwrap();
        let names = ["particles", "Tool/1", "tool_1", "a & b"];
        let mut writer = FrameWriter::create(dir.frames(), &names).unwrap();
        assert_eq!(pvd::read(&dir.frames().list).unwrap(), []);
        let cloud = Cloud::new(3);
        let write = |writer: &mut FrameWriter, k: u32| {
            let parts: Vec<_> = (0..4).map(|p| (p, if p == 0 { cloud.data() } else { mesh() })).collect();
            writer.write(f64::from(k) / 3.0, &parts).unwrap();
        };
        for k in 0..4 {
            write(&mut writer, k);
        }
        assert_eq!(writer.count(), 4);
        let whole = fs::read(dir.frames().list).unwrap();
        let entries = pvd::read(&dir.frames().list).unwrap();
        assert_eq!(entries.len(), 16);
        assert_eq!((entries[4].time, entries[7].name.as_str()), (1.0 / 3.0, "a & b"));
        for (k, entry) in entries.iter().enumerate() {
            assert_eq!(entry.part, k % 4);
            assert!(dir.path().join(&entry.file).is_file());
        }
        // Names that differ by a sign or their case only must not share a file.
        let mut unique: Vec<_> = entries.iter().map(|e| e.file.to_lowercase()).collect();
        unique.sort();
        unique.dedup();
        assert_eq!(unique.len(), 16);

        let mut writer = FrameWriter::resume(dir.frames(), &names, 2).unwrap();
        assert_eq!(pvd::read(&dir.frames().list).unwrap(), entries[..8]);
        write(&mut writer, 2);
        write(&mut writer, 3);
        assert_eq!(fs::read(dir.frames().list).unwrap(), whole);

        // The list is somebody's to delete while the run goes on; no new one pretends to be whole.
        fs::remove_file(dir.frames().list).unwrap();
        let parts = [(0, cloud.data())];
        let gone = writer.write(2.0, &parts).unwrap_err().to_string();
        assert!(gone.contains("frames.pvd: is gone") && gone.contains("--resume"), "{gone}");
        assert!(!dir.frames().list.exists() && writer.count() == 4);
        fs::write(dir.frames().list, &whole).unwrap();

        let few = FrameWriter::resume(dir.frames(), &names, 5).unwrap_err().to_string();
        assert!(few.contains("lists 4 frames, but the checkpoint was taken after 5"), "{few}");
        let mut writer = FrameWriter::create(dir.frames(), &names[..1]).unwrap();
        assert!(matches!(writer.write(0.0, &[(1, mesh())]), Err(OutputError::Columns { .. })));
        assert_eq!(writer.count(), 0);
    }
}
