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
use glebe_study::series::{names, row};

use super::fields::Fields;
use super::network::Network;

/// Name of the particles among a frame's parts.
const PARTICLES: &str = "particles";
/// And of the contacts.
const CONTACTS: &str = "contacts";

/// Rows and frames of one run.
pub(super) struct Recorder {
    series: SeriesWriter,
    frames: FrameWriter,
    fields: Fields,
    /// Surface of each part of a frame, and its mesh; the particles come first.
    meshes: Vec<(usize, Arc<TriMesh>)>,
    /// Whether frames show contacts, behind the meshes.
    network: bool,
    /// Whether particles may be bonded.
    bonds: bool,
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
        let columns = names(constants);
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
        let network = constants.spec.network;
        parts.extend(network.then_some(CONTACTS));
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
        let bonds = constants.bonds();
        Ok(Self { series, frames, fields, meshes, network, bonds, last: None, time: Duration::ZERO })
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
        self.series.append(&row(sample, self.bonds))?;
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
                let pressure = pressures(mesh, &vertices, &frame.detail().on_triangles[s]);
                let depth = g.worn(c, s).map(|volumes| depths(mesh, &volumes));
                meshes.push((1 + k, mesh, vertices, pressure, depth));
            }
        }
        let mut shown = vec![(0, particles.poly_data(frame.positions))];
        shown.extend(meshes.iter().map(|(part, mesh, vertices, pressure, depth)| {
            let wear = depth.iter().map(|depth| Column::new("wear_depth", Values::F64(depth)));
            let data = PolyData {
                points: Values::Vec3F64(vertices),
                cells: Cells::Triangles(&mesh.triangles),
                point_data: Vec::new(),
                cell_data: std::iter::once(Column::new("pressure", Values::F32(pressure)))
                    .chain(wear)
                    .collect(),
            };
            (*part, data)
        }));
        let network = self.network.then(|| Network::new(frame));
        shown.extend(network.iter().map(|network| (1 + self.meshes.len(), network.poly_data())));
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
    bonds: Option<Vec<u32>>,
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
            coordination: frame.detail().coordination.clone(),
            bonds: frame.state.bonds_of(frame.constants),
        }
    }

    fn poly_data<'a>(&'a self, positions: &'a [Vec3]) -> PolyData<'a> {
        let mut data = PolyData {
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
        };
        data.point_data.extend(self.bonds.iter().map(|bonds| Column::new("bonds", Values::U32(bonds))));
        data
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

/// What each triangle has lost, over its area \[m\].
fn depths(mesh: &TriMesh, volumes: &[f64]) -> Vec<f64> {
    let depth = |(t, volume): (&[u32; 3], &f64)| {
        let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
        2.0 * volume / norm(cross(sub(b, a), sub(c, a)))
    };
    mesh.triangles.iter().zip(volumes).map(depth).collect()
}
