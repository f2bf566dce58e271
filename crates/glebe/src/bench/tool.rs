//! Tools that are drawn or turned through a bed.

use std::sync::Arc;

use glebe_engine::generate::Region;
use glebe_engine::spec::{Motion, Pose, Rotation, Shape, Surface, TriMesh, Vec3};
use glebe_io::tool::{Sweep, ToolError};

use super::bed::GRAVITY;
use super::grading::BedKind;

/// Particles of the main job, whose box and sweep have their own size; both shrink with the bed.
pub const MAIN_JOB: usize = 38_912;
/// Size of the main job's box \[m\].
const BOX: Vec3 = [0.7, 0.6, 1.6];
/// Depth of the nose: its height above the floor \[m\].
const NOSE: f64 = 0.15;
/// Speed at which the sweep is drawn \[m/s\].
const SPEED: f64 = 0.7;
/// Way of the sweep before it is timed: then it is wholly in the soil \[m\].
const ENTERED: f64 = 0.30;
/// ω²R/g at the tips of the rotor.
const FROUDE: f64 = 0.1;
/// Cells of a blade along its height and its radius, one across: 964 triangles, and 2892 for three.
const BLADE: [u32; 2] = [10, 21];
const BLADES: u32 = 3;

/// A tool in a bed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Tool {
    /// A sweep of 452 triangles, drawn through soil.
    Sweep,
    /// The same sweep in 16 432 triangles.
    FineSweep,
    /// Three blades of 2892 triangles, turning in mono spheres.
    Rotor,
}

impl Tool {
    /// Every tool.
    pub const ALL: [Self; 3] = [Self::Sweep, Self::FineSweep, Self::Rotor];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sweep => "sweep",
            Self::FineSweep => "fine-sweep",
            Self::Rotor => "rotor",
        }
    }

    /// The spheres that it moves in.
    pub fn kind(self) -> BedKind {
        match self {
            Self::Sweep | Self::FineSweep => BedKind::Soil,
            Self::Rotor => BedKind::Mono,
        }
    }

    /// The tool among `count` spheres of volume `solid` \[m³\].
    pub fn placed(self, count: usize, solid: f64) -> Result<Placed, ToolError> {
        match self {
            Self::Sweep => sweep(count, 50e-3),
            Self::FineSweep => sweep(count, 6e-3),
            Self::Rotor => Ok(rotor(solid, self.kind().radii()[1])),
        }
    }
}

/// A tool with its box, and how it moves.
pub struct Placed {
    /// The box, with its floor at z = 0.
    pub region: [Vec3; 2],
    /// Where the cloud is that falls at the start.
    pub cloud: Region,
    /// The tool, present from the start.
    pub surface: Surface,
    /// How it moves once it does.
    pub motion: Motion,
    /// Whether the bed settles before.
    pub waits: bool,
    /// Time from its first motion until it is timed \[s\].
    pub develop: f64,
    /// Triangles.
    pub triangles: usize,
}

fn surface(name: &str, mesh: TriMesh, pose: Pose) -> Surface {
    Surface {
        name: name.to_owned(),
        material: 0,
        shape: Shape::Mesh(Arc::new(mesh)),
        pose,
        motion: Motion::default(),
        absent: false,
    }
}

/// The main job's sweep, just outside the near wall while the soil settles.
fn sweep(count: usize, resolution: f64) -> Result<Placed, ToolError> {
    let s = (count as f64 / MAIN_JOB as f64).cbrt();
    let mut mesh = Sweep { resolution, ..Sweep::default() }.mesh()?;
    mesh.vertices.iter_mut().flatten().for_each(|x| *x *= s);
    let triangles = mesh.triangles.len();
    let [half_x, half_y, height] = [0.5 * BOX[0] * s, 0.5 * BOX[1] * s, BOX[2] * s];
    let region = [[-half_x, -half_y, 0.0], [half_x, half_y, height]];
    let pose = Pose { translation: [-half_x - 0.01 * s, 0.0, NOSE * s], ..Pose::default() };
    Ok(Placed {
        region,
        cloud: Region::walled(region[0], region[1]),
        surface: surface("sweep", mesh, pose),
        motion: Motion { velocity: [SPEED, 0.0, 0.0], ..Motion::default() },
        waits: true,
        develop: ENTERED * s / SPEED,
        triangles,
    })
}

/// Blades above the floor, on which the spheres fall while they turn. None is as near to a blade as to be crushed
/// between it and a wall.
fn rotor(solid: f64, radius: f64) -> Placed {
    // When the spheres have fallen to a solid fraction of 0.57 they fill about a cube.
    let w = (solid / 0.57).cbrt();
    let gap = (0.05 * w).max(3.0 * radius);
    let inner = 0.05 * w;
    let outer = 0.5 * w - gap;
    let mut mesh = TriMesh::default();
    for k in 0..BLADES {
        let angle = 2.0 * std::f64::consts::PI * f64::from(k) / f64::from(BLADES);
        add_blade(&mut mesh, angle, [inner, outer], [gap, gap + 0.3 * w], 0.02 * w);
    }
    let triangles = mesh.triangles.len();
    let top = gap + 0.35 * w;
    let region = [[-0.5 * w, -0.5 * w, 0.0], [0.5 * w, 0.5 * w, 3.0 * w]];
    let rate = (FROUDE * GRAVITY / outer).sqrt();
    let fall = (2.0 * 2.0 * w / GRAVITY).sqrt();
    Placed {
        region,
        cloud: Region::walled([region[0][0], region[0][1], top], region[1]),
        surface: surface("rotor", mesh, Pose::default()),
        motion: Motion {
            rotation: Some(Rotation { axis: [0.0, 0.0, 1.0], center: [0.0; 3], rate }),
            ..Motion::default()
        },
        waits: false,
        develop: fall + 1.5 / rate,
        triangles,
    }
}

/// Adds an upright plate along a radius, closed, its normals outwards.
fn add_blade(mesh: &mut TriMesh, angle: f64, radius: [f64; 2], height: [f64; 2], thick: f64) {
    let (sin, cos) = angle.sin_cos();
    let [rows, columns] = BLADE;
    let begin = mesh.vertices.len() as u32;
    let at = |side: u32, i: u32, j: u32| begin + (side * (rows + 1) + i) * (columns + 1) + j;
    for side in 0..2 {
        let y = (f64::from(side) - 0.5) * thick;
        for i in 0..=rows {
            let z = height[0] + (height[1] - height[0]) * f64::from(i) / f64::from(rows);
            for j in 0..=columns {
                let x = radius[0] + (radius[1] - radius[0]) * f64::from(j) / f64::from(columns);
                mesh.vertices.push([cos * x - sin * y, sin * x + cos * y, z]);
            }
        }
    }
    // Corners in turn around the outward normal.
    let mut quad = |a, b, c, d| mesh.triangles.extend([[a, b, c], [a, c, d]]);
    for i in 0..rows {
        for j in 0..columns {
            quad(at(0, i, j), at(0, i, j + 1), at(0, i + 1, j + 1), at(0, i + 1, j));
            quad(at(1, i, j), at(1, i + 1, j), at(1, i + 1, j + 1), at(1, i, j + 1));
        }
        quad(at(0, i, 0), at(0, i + 1, 0), at(1, i + 1, 0), at(1, i, 0));
        quad(at(0, i, columns), at(1, i, columns), at(1, i + 1, columns), at(0, i + 1, columns));
    }
    for j in 0..columns {
        quad(at(0, 0, j), at(1, 0, j), at(1, 0, j + 1), at(0, 0, j + 1));
        quad(at(0, rows, j), at(0, rows, j + 1), at(1, rows, j + 1), at(1, rows, j));
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glebe_engine::lattice::{cross, dot, sub};

    use super::*;

    #[test]
    fn tools_have_the_triangles_that_they_are_named_by_and_are_closed() {
        for (tool, triangles) in [(Tool::Sweep, 452), (Tool::FineSweep, 16_432), (Tool::Rotor, 2892)] {
            let placed = tool.placed(1000, 1e-3).unwrap();
            assert_eq!(placed.triangles, triangles, "{}", tool.name());
            let Shape::Mesh(mesh) = &placed.surface.shape else { panic!("a mesh") };
            let mut edges = BTreeMap::<[u32; 2], i32>::new();
            let mut volume = 0.0;
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
                volume += dot(a, cross(sub(b, a), sub(c, a))) / 6.0;
                for k in 0..3 {
                    let (from, to) = (t[k], t[(k + 1) % 3]);
                    *edges.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|n| *n == 0), "{} is not closed", tool.name());
            assert!(volume > 0.0, "{} is inside out", tool.name());
        }
    }

    #[test]
    fn blades_stay_clear_of_the_walls_and_below_the_cloud() {
        let placed = Tool::Rotor.placed(1000, 1e-3).unwrap();
        let Shape::Mesh(mesh) = &placed.surface.shape else { panic!("a mesh") };
        let wall = placed.region[1][0];
        for v in &mesh.vertices {
            assert!(v[0].hypot(v[1]) < wall && v[2] > 0.0 && v[2] < placed.cloud.min[2]);
        }
    }
}
