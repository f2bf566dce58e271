//! Writes what a world reports: rows of the series, frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use glebe_engine::Constants;
use glebe_engine::batch::{Frame, Observer, Sample};
use glebe_engine::lattice::{cross, dot, norm, sub};
use glebe_engine::spec::{Shape, TriMesh, Vec3};
use glebe_engine::state::StageResult;
use glebe_io::output::series::SeriesWriter;
use glebe_io::output::vtp::{Cells, Column, PolyData, Values};
use glebe_io::output::{FrameWriter, OutputDir, OutputError};

use super::fields::Fields;

/// Name of the particles among a frame's parts.
const PARTICLES: &str = "particles";

/// Rows and frames of one run.
pub(super) struct Recorder {
    series: SeriesWriter,
    frames: FrameWriter,
    fields: Fields,
    /// Surface of each part of a frame, and its mesh; the particles come first.
    meshes: Vec<(usize, Arc<TriMesh>)>,
    /// The last row.
    pub(super) last: Option<Sample>,
    /// Time spent writing.
    pub(super) time: Duration,
}

impl Recorder {
    /// Begins, or continues after this many rows and frames, and what a checkpoint holds of fields.
    pub(super) fn new(
        dir: &OutputDir,
        constants: &Constants,
        after: Option<(u64, u64, &[u8])>,
    ) -> Result<Self, OutputError> {
        let surfaces = &constants.spec.surfaces;
        let spec = &constants.spec;
        let doors =
            spec.inlets.iter().map(|i| i.name.as_str()).chain(spec.outlets.iter().map(|o| o.name.as_str()));
        let columns = columns(surfaces.iter().map(|s| s.name.as_str()), doors, constants.is_sample());
        let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
        let shown = |shape: &Shape| match shape {
            Shape::Plane { .. } => None,
            Shape::Mesh(mesh) => Some(mesh.clone()),
            Shape::Frustum(frustum) => Some(Arc::new(frustum.mesh())),
        };
        let meshes: Vec<_> = surfaces
            .iter()
            .enumerate()
            .filter_map(|(s, surface)| Some((s, shown(&surface.shape)?)))
            .collect();
        let mut parts = vec![PARTICLES];
        parts.extend(meshes.iter().map(|(s, _)| surfaces[*s].name.as_str()));
        let (series, frames) = match after {
            None => {
                (SeriesWriter::create(&dir.series(), &columns)?, FrameWriter::create(dir.frames(), &parts)?)
            }
            Some((rows, frames, _)) => (
                SeriesWriter::resume(&dir.series(), &columns, rows)?,
                FrameWriter::resume(dir.frames(), &parts, frames)?,
            ),
        };
        let fields = Fields::new(dir, constants, after.map(|(_, _, fields)| fields))?;
        Ok(Self { series, frames, fields, meshes, last: None, time: Duration::ZERO })
    }

    /// Rows and frames so far, made durable.
    pub(super) fn counts(&self) -> Result<(u64, u64), OutputError> {
        self.series.sync()?;
        Ok((self.series.rows(), self.frames.count()))
    }

    /// What fields have seen, for a checkpoint.
    pub(super) fn seen(&self) -> Vec<u8> {
        self.fields.to_bytes()
    }
}

impl Observer for Recorder {
    type Error = OutputError;

    fn sample(&mut self, _: usize, sample: &Sample) -> Result<(), OutputError> {
        let start = Instant::now();
        self.series.append(&row(sample))?;
        self.last = Some(sample.clone());
        self.time += start.elapsed();
        Ok(())
    }

    fn frame(&mut self, _: usize, frame: &Frame<'_>) -> Result<(), OutputError> {
        let start = Instant::now();
        let particles = ParticleColumns::new(frame);
        let (c, g) = (frame.constants, &frame.state.progress);
        let mut meshes = Vec::new();
        for (k, (s, mesh)) in self.meshes.iter().enumerate() {
            let s = *s;
            if g.surfaces[s].present {
                let pose = g.surfaces[s].placed(c, s, g).pose;
                let vertices: Vec<Vec3> = mesh.vertices.iter().map(|x| pose.apply(*x)).collect();
                let pressure = pressures(mesh, &vertices, &frame.detail.on_triangles[s]);
                meshes.push((1 + k, mesh, vertices, pressure));
            }
        }
        let mut shown = vec![(0, particles.poly_data(frame.positions))];
        shown.extend(meshes.iter().map(|(part, mesh, vertices, pressure)| {
            let data = PolyData {
                points: Values::Vec3F64(vertices),
                cells: Cells::Triangles(&mesh.triangles),
                point_data: Vec::new(),
                cell_data: vec![Column::new("pressure", Values::F32(pressure))],
            };
            (*part, data)
        }));
        self.frames.write(frame.time, &shown)?;
        self.time += start.elapsed();
        Ok(())
    }

    fn wants_look(&self, _: usize, sample: &Sample) -> bool {
        self.fields.look_at(sample)
    }

    fn look(&mut self, _: usize, frame: &Frame<'_>) -> Result<(), OutputError> {
        let start = Instant::now();
        self.fields.look(frame)?;
        self.time += start.elapsed();
        Ok(())
    }

    fn stage_ended(&mut self, _: usize, _: usize, _: &StageResult) -> Result<(), OutputError> {
        Ok(())
    }
}

/// A frame's particles as columns for ParaView.
struct ParticleColumns {
    id: Vec<u32>,
    radius: Vec<f32>,
    material: Vec<u32>,
    velocity: Vec<[f32; 3]>,
    spin: Vec<[f32; 3]>,
    force: Vec<[f32; 3]>,
    coordination: Vec<u32>,
}

impl ParticleColumns {
    fn new(frame: &Frame<'_>) -> Self {
        let p = &frame.state.particles;
        Self {
            id: p.id.clone(),
            radius: p.place.iter().map(|x| x.radius).collect(),
            material: p.spin.iter().map(|x| x.material).collect(),
            velocity: p.velocity.iter().map(|x| x.v).collect(),
            spin: p.spin.iter().map(|x| x.w).collect(),
            force: p.force.clone(),
            coordination: frame.detail.coordination.clone(),
        }
    }

    fn poly_data<'a>(&'a self, positions: &'a [Vec3]) -> PolyData<'a> {
        PolyData {
            points: Values::Vec3F64(positions),
            cells: Cells::Points,
            point_data: vec![
                Column::new("id", Values::U32(&self.id)),
                Column::new("radius", Values::F32(&self.radius)),
                Column::new("material", Values::U32(&self.material)),
                Column::new("velocity", Values::Vec3F32(&self.velocity)),
                Column::new("angular_velocity", Values::Vec3F32(&self.spin)),
                Column::new("force", Values::Vec3F32(&self.force)),
                Column::new("coordination", Values::U32(&self.coordination)),
            ],
            cell_data: Vec::new(),
        }
    }
}

/// Normal force over area of each triangle \[Pa\], whichever side it comes from: meshes are wound as their
/// authors happened to.
fn pressures(mesh: &TriMesh, vertices: &[Vec3], forces: &[Vec3]) -> Vec<f32> {
    let pressure = |(t, force): (&[u32; 3], &Vec3)| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        let twice_area = cross(sub(b, a), sub(c, a));
        let length = norm(twice_area);
        (2.0 * dot(*force, twice_area).abs() / (length * length)) as f32
    };
    mesh.triangles.iter().zip(forces).map(pressure).collect()
}

/// Components of a tensor that columns show, and their names; shear as the mean of both.
pub(super) const SYMMETRIC: [([usize; 2], &str); 6] =
    [([0, 0], "xx"), ([1, 1], "yy"), ([2, 2], "zz"), ([1, 2], "yz"), ([0, 2], "xz"), ([0, 1], "xy")];

/// The names of the series' columns, in the order of [`row`]; those of stress and strain where the world is a `sample`.
fn columns<'a>(
    surfaces: impl Iterator<Item = &'a str>,
    doors: impl Iterator<Item = &'a str>,
    sample: bool,
) -> Vec<String> {
    let doors: Vec<&str> = doors.collect();
    let mut names: Vec<String> = [
        "time",
        "step",
        "stage",
        "particles",
        "kinetic_translation",
        "kinetic_rotation",
        "potential",
        "elastic_normal",
        "elastic_tangential",
        "friction",
        "dashpots",
        "rolling",
        "damping",
        "dissipated",
        "stiffness_change",
        "work",
        "removed",
        "integrator",
        "contacts",
        "surface_contacts",
        "coordination",
        "overlap",
        "speed",
    ]
    .map(str::to_owned)
    .into();
    for surface in surfaces {
        let parts = "fx fy fz tx ty tz draught path present x y z qw qx qy qz";
        names.extend(parts.split(' ').map(|part| format!("{surface}.{part}")));
    }
    if !doors.is_empty() {
        names.push("entered".to_owned());
    }
    for door in doors {
        names.extend(["particles", "mass", "rate"].map(|part| format!("{door}.{part}")));
    }
    if sample {
        let scalars = "p q volumetric_strain deviatoric_strain void_ratio mechanical_coordination rattlers";
        names.extend(scalars.split(' ').map(str::to_owned));
        for tensor in ["stress", "kinetic_stress", "strain", "fabric"] {
            names.extend(SYMMETRIC.map(|(_, component)| format!("{tensor}_{component}")));
        }
    }
    names
}

fn row(s: &Sample) -> Vec<f64> {
    let l = &s.ledger;
    let mut row = vec![
        s.time,
        s.step as f64,
        s.stage as f64,
        s.particles as f64,
        l.translation,
        l.rotation,
        l.potential,
        l.elastic_normal,
        l.elastic_tangential,
        l.friction,
        l.dashpots,
        l.rolling,
        l.damping,
        l.dissipated(),
        l.stiffness_change,
        l.work,
        l.removed,
        l.integrator(),
        s.contacts as f64,
        s.surface_contacts as f64,
        s.coordination,
        s.overlap,
        s.speed,
    ];
    for t in &s.surfaces {
        row.extend(t.force.iter().chain(&t.torque));
        row.extend([t.draught, t.path, f64::from(u8::from(t.present))]);
        row.extend(t.pose.translation.iter().chain(&t.pose.rotation));
    }
    if !s.flows.is_empty() {
        row.push(l.entered);
    }
    for flow in &s.flows {
        row.extend([flow.particles as f64, flow.mass, flow.rate]);
    }
    if let Some(i) = &s.interior {
        row.extend([i.p(), i.q(), i.volumetric_strain(), i.deviatoric_strain(), i.void_ratio]);
        row.extend([i.mechanical_coordination, i.rattlers as f64]);
        for tensor in [&i.stress, &i.kinetic_stress, &i.strain, &i.fabric] {
            row.extend(SYMMETRIC.map(|([a, b], _)| 0.5 * (tensor[a][b] + tensor[b][a])));
        }
    }
    row
}
