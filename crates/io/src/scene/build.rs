//! From a checked scene to a world: reads the files it names, generates particles, turns names into
//! indices. What goes wrong points at the line of the scene that asked for it.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glebe_engine::SetupError;
use glebe_engine::backend::BYTES_PER_PARTICLE;
use glebe_engine::generate::{FillRequest, Region, SizeDistribution, generate, solid_volume, worst_overlap};
use glebe_engine::spec::{
    Action, Domain, Frustum, Measure, Motion, ParticleSet, Pose, Shape, Side, Stage, Surface, Survey, Vec3,
    WorldSpec,
};
use glebe_physics::Material;

use super::error::{Place, SceneError};
use super::model::{
    GeometryPart, GeometryShape, MotionPart, Origin, ParticlePart, Scene, ScenePlaces, StagePart,
};
use super::shapes;
use crate::mesh::{self, MeshReport, Transform, assemble};
use crate::{input, particles, poses};

/// Meshes longer than this were probably drawn in another unit \[m\].
const LONGEST: f64 = 20.0;

/// A world, and what was found on the way to it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BuiltScene {
    /// What the engine runs.
    pub world: WorldSpec,
    /// The meshes, in the order of the scene.
    pub meshes: Vec<PlacedMesh>,
    /// What looks wrong but does not stop a run: of the file and of what it names.
    pub warnings: Vec<SceneError>,
    /// For the log.
    pub notes: Vec<String>,
    blame: Blame,
}

/// A mesh of the scene.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct PlacedMesh {
    /// Name of the geometry.
    pub name: String,
    /// What was found in it, in its own frame: after `scale`, before `rotate` and `translate`.
    pub report: MeshReport,
    /// Least coordinates where it stands at the start \[m\].
    pub min: Vec3,
    /// Largest coordinates where it stands at the start \[m\].
    pub max: Vec3,
}

/// Where the engine's errors belong.
#[derive(Clone, Debug)]
struct Blame {
    step: Place,
    contact: Place,
    domain: Place,
    pairs: Vec<Place>,
    doors: Vec<(String, Place)>,
    /// Particles of each group, and the value that made or names them.
    groups: Vec<(Range<usize>, Place)>,
}

impl BuiltScene {
    /// The engine's refusal of this world, with the place in the scene that is to be changed.
    pub fn locate(&self, error: &SetupError) -> SceneError {
        let blame = &self.blame;
        let group =
            |id: &usize| blame.groups.iter().find(|(range, _)| range.contains(id)).map(|(_, place)| place);
        let (place, label) = match error {
            SetupError::StepTooLarge { .. } | SetupError::SurfaceTooFast { .. } => (&blame.step, "too large"),
            SetupError::Law(_) => (&blame.contact, "these laws"),
            SetupError::PairLaw { pair, .. } => {
                (blame.pairs.get(*pair).unwrap_or(&blame.contact), "these laws")
            }
            SetupError::Door { name, .. } => {
                let door = blame.doors.iter().find(|(other, _)| other == name).map(|(_, place)| place);
                (door.unwrap_or(&blame.domain), "this one")
            }
            SetupError::Particle { id, .. } => (group(id).unwrap_or(&blame.domain), "one of these"),
            _ => (&blame.domain, "this world"),
        };
        SceneError::new("setup", place, error.to_string()).label(label)
    }
}

impl Scene {
    /// How many particles are to be generated; those of files are not known before they are read.
    pub fn generated(&self) -> usize {
        let count = |part: &ParticlePart| match part.origin {
            Origin::Generated { count, .. } => count,
            Origin::File(_) => 0,
        };
        self.particles.iter().map(count).sum()
    }

    /// Reads the meshes and particle files (relative to `base_dir`, the scene's folder) and makes a world.
    ///
    /// # Errors
    /// Everything that is wrong: files, particles outside of the domain or inside each other, generators
    /// that find no room.
    pub fn build(&self, base_dir: &Path) -> Result<BuiltScene, Vec<SceneError>> {
        let mut build = Build {
            scene: self,
            base_dir,
            found: Vec::new(),
            meshes: Vec::new(),
            notes: self.notes.clone(),
            groups: Vec::new(),
        };
        let mut world = WorldSpec::new(self.domain(), self.time);
        world.title.clone_from(&self.title);
        world.seed = self.seed;
        world.throughput = self.throughput.unwrap_or(false);
        world.search = self.search;
        world.materials =
            self.materials.iter().cloned().map(|m| Material { density: weight(m.density), ..m }).collect();
        world.mixing = self.mixing;
        world.shear_modulus = self.shear_modulus;
        world.pairs = self
            .pairs
            .iter()
            .map(|p| (self.material_id(&p.materials[0]), self.material_id(&p.materials[1]), p.values.clone()))
            .collect();
        world.contact = self.contact.clone();
        world.gravity = self.gravity;
        world.local_damping = self.local_damping;
        world.guards = self.guards;
        world.surfaces = self.geometry.iter().filter_map(|g| build.surface(g)).collect();
        world.particles = build.particles();
        let row = self.sampling.series;
        world.inlets =
            self.inlets.iter().map(|inlet| inlet.inlet(|name| self.material_id(name), row)).collect();
        world.outlets.clone_from(&self.outlets);
        world.stages = self.stages.iter().map(|stage| build.stage(stage)).collect();
        world.sampling = self.sampling;
        world.fields.clone_from(&self.fields);
        world.network = self.network;
        world.wear.clone_from(&self.wear);

        let Build { found, meshes, notes, groups, .. } = build;
        let (warnings, errors): (Vec<_>, Vec<_>) = found.into_iter().partition(SceneError::is_warning);
        if !errors.is_empty() {
            return Err(errors);
        }
        let warnings = self.warnings.iter().cloned().chain(warnings).collect();
        let ScenePlaces { step, contact, domain, pairs, doors } = self.places.clone();
        Ok(BuiltScene {
            world,
            meshes,
            warnings,
            notes,
            blame: Blame { step, contact, domain, pairs, doors, groups },
        })
    }

    fn domain(&self) -> Domain {
        let part = &self.domain;
        Domain::aligned(part.min, part.max, part.sides, part.material.as_ref().map(|m| self.material_id(m)))
    }

    // The names below were checked; an index of 0 for a stranger is never reached.
    fn material_id(&self, name: &str) -> usize {
        self.materials.iter().position(|m| m.name == name).unwrap_or_default()
    }

    fn surface_id(&self, name: &str) -> usize {
        self.geometry.iter().position(|g| g.name.value == name).unwrap_or_default()
    }

    /// Whether a surface is absent at the start: the first stage that names it inserts it.
    fn starts_absent(&self, name: &str) -> bool {
        let has = |names: &[String]| names.iter().any(|n| n == name);
        self.stages.iter().find(|s| has(&s.withdraw) || has(&s.insert)).is_some_and(|s| !has(&s.withdraw))
    }
}

struct Build<'a> {
    scene: &'a Scene,
    base_dir: &'a Path,
    found: Vec<SceneError>,
    meshes: Vec<PlacedMesh>,
    notes: Vec<String>,
    groups: Vec<(Range<usize>, Place)>,
}

impl Build<'_> {
    fn bad_file(&mut self, place: &Place, message: String) {
        self.found.push(SceneError::new("file", place, message).label("this file"));
    }

    fn bad_shape(&mut self, place: &Place, message: String) {
        self.found.push(SceneError::new("shape", place, message).label("this shape"));
    }

    fn surface(&mut self, part: &GeometryPart) -> Option<Surface> {
        let place = &part.shape.place;
        let mut soup = Vec::new();
        let mut turned = Transform::default();
        for (axis, angle) in &part.rotate {
            match turned.rotated(*axis, *angle) {
                Ok(more) => turned = more,
                Err(error) => self.bad_shape(place, error.to_string()),
            }
        }
        let mut pose = Pose { translation: part.translate, rotation: turned.rotate };
        let read = match &part.shape.value {
            GeometryShape::Plane { point, normal } => {
                pose.translation = [0, 1, 2].map(|k| point[k] + part.translate[k]);
                return Some(self.placed(part, pose, Shape::Plane { normal: *normal }));
            }
            GeometryShape::Round(frustum) => {
                self.notes.push(round_note(&part.name.value, frustum, &pose));
                return Some(self.placed(part, pose, Shape::Frustum(*frustum)));
            }
            GeometryShape::File(path) => {
                let transform = Transform { scale: part.scale, ..Transform::default() };
                mesh::read(&self.base_dir.join(path), &transform)
                    .map_err(|error| self.bad_file(place, error.to_string()))
                    .ok()
            }
            GeometryShape::Tool(tool) => match tool.mesh() {
                Ok(mesh) => {
                    let corner = |i: u32| mesh.vertices[i as usize];
                    soup.extend(mesh.triangles.iter().map(|t| t.map(corner)));
                    None
                }
                Err(error) => {
                    self.bad_shape(place, error.to_string());
                    return None;
                }
            },
            GeometryShape::Box { min, max } => {
                soup = shapes::cuboid(*min, *max);
                None
            }
            GeometryShape::Hopper { outlet_radius, top_radius, height, segments } => {
                soup = shapes::hopper(*outlet_radius, *top_radius, *height, *segments);
                None
            }
        };
        let (mesh, report) = match read {
            Some(read) => read,
            None if soup.is_empty() => return None,
            None => {
                let scaled = |x: Vec3| [0, 1, 2].map(|k| x[k] * part.scale[k]);
                assemble(&soup.iter().map(|corners| corners.map(scaled)).collect::<Vec<_>>())
            }
        };
        if mesh.triangles.is_empty() {
            self.bad_shape(place, format!("geometry `{}` has no triangle with an area", part.name.value));
            return None;
        }
        let placed: Vec<Vec3> = mesh.vertices.iter().map(|x| place_point(&pose, *x)).collect();
        let fold = |start: f64, f: fn(f64, f64) -> f64| {
            [0, 1, 2].map(|k| placed.iter().map(|x| x[k]).fold(start, f))
        };
        self.doubt_unit(part, &report);
        self.meshes.push(PlacedMesh {
            name: part.name.value.clone(),
            report,
            min: fold(f64::INFINITY, f64::min),
            max: fold(f64::NEG_INFINITY, f64::max),
        });
        Some(self.placed(part, pose, Shape::Mesh(Arc::new(mesh))))
    }

    /// Files of meshes do not say their unit; most tools draw in millimetres.
    fn doubt_unit(&mut self, part: &GeometryPart, report: &MeshReport) {
        let longest = report.size().into_iter().fold(0.0, f64::max);
        if longest > LONGEST && matches!(part.shape.value, GeometryShape::File(_)) {
            let message = format!("geometry `{}` is {longest:.1} m long", part.name.value);
            let warning = SceneError::new("unit", &part.shape.place, message)
                .label("this file")
                .help("if it was drawn in millimetres, set unit = \"mm\"");
            self.found.push(warning.warning());
        }
    }

    fn stage(&mut self, part: &StagePart) -> Stage {
        let scene = self.scene;
        let mut actions = Vec::new();
        actions.extend(part.remove.map(|(axis, limit)| Action::RemoveBeyond { axis, limit }));
        actions.extend(part.withdraw.iter().map(|name| Action::Withdraw(scene.surface_id(name))));
        actions.extend(part.insert.iter().map(|name| Action::Insert(scene.surface_id(name))));
        actions.extend(part.bond.then_some(Action::Bond));
        let moves = part.moves.iter().map(|(name, motion)| {
            let surface = scene.surface_id(name);
            (surface, self.motion(motion, scene.geometry[surface].translate))
        });
        let moves = moves.collect();
        let measures = part.measures.iter().map(|m| Measure {
            name: m.name.clone(),
            surface: scene.surface_id(&m.surface),
            component: m.component,
            window: m.window,
        });
        Stage {
            name: part.name.value.clone(),
            actions,
            until: part.until,
            moves,
            measures: measures.collect(),
            surveys: part.surveys.iter().map(|s| Survey { name: s.name.clone(), of: s.of }).collect(),
            deformation: part.deformation,
        }
    }

    /// A motion of a surface whose frame stands at `origin`.
    fn motion(&mut self, part: &MotionPart, origin: Vec3) -> Motion {
        let mut motion = part.motion.clone();
        if let (Some(rotation), true) = (&mut motion.rotation, part.about_origin) {
            rotation.center = origin;
        }
        let Some(file) = &part.poses else { return motion };
        match poses::read(&self.base_dir.join(&file.value)) {
            Ok(table) => motion.poses = Some(Arc::new(table)),
            Err(error) => self.bad_file(&file.place, error.to_string()),
        }
        if motion.turns_twice() {
            let message = format!("`{}` turns, and the motion has a rotation too", file.value.display());
            let error = SceneError::new("conflict", &file.place, message).label("this table");
            self.found.push(error.help("put all turns into the table, or leave its rotation columns out"));
        }
        motion
    }

    fn placed(&mut self, part: &GeometryPart, pose: Pose, shape: Shape) -> Surface {
        Surface {
            name: part.name.value.clone(),
            material: self.scene.material_id(&part.material),
            shape,
            pose,
            motion: self.motion(&part.motion, part.translate),
            absent: self.scene.starts_absent(&part.name.value),
        }
    }

    fn particles(&mut self) -> ParticleSet {
        let mut all = ParticleSet::default();
        for (index, part) in self.scene.particles.iter().enumerate() {
            let first = all.len();
            let place = match &part.origin {
                Origin::File(path) => {
                    self.read(part, &path.value, &path.place, &mut all);
                    &path.place
                }
                Origin::Generated { place, .. } => {
                    self.generate(part, index, &mut all);
                    place
                }
            };
            self.groups.push((first..all.len(), place.clone()));
        }
        self.have_densities(&all);
        self.inside_domain(&all);
        self.apart(&all);
        all
    }

    fn read(&mut self, part: &ParticlePart, path: &Path, place: &Place, all: &mut ParticleSet) {
        let columns = match particles::read(&self.base_dir.join(path)) {
            Ok(columns) => columns,
            Err(error) => return self.bad_file(place, error.to_string()),
        };
        let names = self.scene.materials.iter().enumerate().map(|(id, m)| (m.name.clone(), id)).collect();
        let default = part.material.as_ref().map(|m| self.scene.material_id(m));
        match columns.into_set(&names, default) {
            Ok(set) if !self.fits(part, all.len() + set.len(), place) => {}
            Ok(set) => {
                for i in 0..set.len() {
                    let velocity = set.velocity.get(i).copied().unwrap_or(part.velocity);
                    let spin = set.spin.get(i).copied().unwrap_or_default();
                    all.push_moving(set.position[i], set.radius[i], set.material[i], velocity, spin);
                }
                self.notes.push(format!(
                    "particles `{}`: {} read from {}",
                    part.name.value,
                    set.len(),
                    path.display()
                ));
            }
            Err(error) => self.bad_file(place, error.to_string()),
        }
    }

    /// Whether there is memory for so many particles; if not, that is an error of this group.
    fn fits(&mut self, part: &ParticlePart, count: usize, place: &Place) -> bool {
        let needed = (count as f64 * BYTES_PER_PARTICLE) as u64;
        let Some(free) = input::free_memory().filter(|free| needed > *free) else { return true };
        let message = format!(
            "with `{}` there are {count} particles, which take about {} of memory; {} are free",
            part.name.value,
            input::size(needed),
            input::size(free)
        );
        self.found.push(
            SceneError::new("memory", place, message)
                .label("too many")
                .help("take fewer particles, or a machine with more memory"),
        );
        false
    }

    fn generate(&mut self, part: &ParticlePart, index: usize, all: &mut ParticleSet) {
        let Origin::Generated { count, sizes, fill, region, solid_fraction, seed, place } = &part.origin
        else {
            return;
        };
        let domain = &self.scene.domain;
        let [min, max] = region.unwrap_or([domain.min, domain.max]);
        let periodic = [0, 1, 2].map(|k| {
            domain.sides[k][0] == Side::Periodic && min[k] == domain.min[k] && max[k] == domain.max[k]
        });
        let cannot = |why: String| {
            let message = format!("particles `{}` cannot be generated: {why}", part.name.value);
            SceneError::new("generate", place, message).label("this many")
        };
        if !self.fits(part, all.len() + count, place) {
            return;
        }
        // Before anything is drawn: the search for room that is not there takes long.
        let (needed, volume) =
            (*count as f64 * solid_volume(&[small_radius(sizes)]), Region::walled(min, max).volume());
        if needed > volume {
            let why = format!(
                "{count} spheres have a volume of at least {needed:.3e} m³, the region only {volume:.3e} m³; \
                 enlarge the region, take fewer or smaller spheres"
            );
            self.found.push(cannot(why));
            return;
        }
        let seed = seed.unwrap_or_else(|| self.scene.seed.wrapping_add(index as u64));
        let gravity = self.scene.gravity.map(f64::abs);
        let up = if gravity == [0.0; 3] {
            2
        } else {
            (0..3).max_by(|a, b| gravity[*a].total_cmp(&gravity[*b])).unwrap_or(2)
        };
        let made = sizes.sample(*count, seed).and_then(|radii| {
            let request = FillRequest {
                up,
                solid_fraction: *solid_fraction,
                ..FillRequest::new(Region { min, max, periodic }, &radii, seed)
            };
            generate(fill, &request).map(|positions| (positions, radii))
        });
        match made {
            Ok((positions, radii)) => {
                let material = part.material.as_ref().map_or(0, |m| self.scene.material_id(m));
                for (x, r) in positions.into_iter().zip(radii) {
                    all.push_moving(x, r, material, part.velocity, [0.0; 3]);
                }
                self.notes.push(format!(
                    "particles `{}`: {count} generated (`{fill}`, seed {seed})",
                    part.name.value
                ));
            }
            Err(error) => self.found.push(cannot(error.to_string())),
        }
    }

    /// A particle file may name materials that were given no density.
    fn have_densities(&mut self, all: &ParticleSet) {
        for (range, place) in &self.groups {
            let lacks = |i: &usize| self.scene.materials[all.material[*i]].density <= 0.0;
            let Some(first) = range.clone().find(lacks) else { continue };
            let name = &self.scene.materials[all.material[first]].name;
            let message = format!("particles are made of `{name}`, which has no density");
            let help = format!("write density = … in [material.{name}], for example \"1850 kg/m^3\"");
            self.found.push(SceneError::new("missing", place, message).label("these particles").help(help));
        }
    }

    /// Particles whose centre is outside of the domain would be lost at the first step, those deep in a
    /// wall thrown out of it.
    fn inside_domain(&mut self, all: &ParticleSet) {
        let domain = &self.scene.domain;
        let guards = self.scene.guards;
        // Least distance of the centre from a side, over all sides that `counts` lets through.
        let clearance = |i: usize, counts: fn(Side) -> bool| {
            let of_axis = |k: usize| {
                let x = all.position[i][k];
                let [low, high] = domain.sides[k].map(counts);
                let free = |counted: bool, distance: f64| if counted { distance } else { f64::INFINITY };
                free(low, x - domain.min[k]).min(free(high, domain.max[k] - x))
            };
            of_axis(0).min(of_axis(1)).min(of_axis(2))
        };
        let outside = |i: &usize| clearance(*i, |side| side != Side::Periodic) < 0.0;
        let depth = |i: &usize| 1.0 - clearance(*i, |side| side == Side::Wall) / all.radius[*i];
        let in_wall = |i: &usize| !outside(i) && depth(i) > guards.overlap_limit;
        for (range, place) in &self.groups {
            let mut tell = |kind, wrong: Vec<usize>, how: &str| {
                let first = wrong.first()?;
                let message = format!(
                    "{} of {} particles start {how}; the first is number {} at {:?} m",
                    wrong.len(),
                    range.len(),
                    first - range.start,
                    all.position[*first]
                );
                let help = format!(
                    "the domain goes from {:?} to {:?} m; check the unit, move them, or enlarge it",
                    domain.min, domain.max
                );
                let error = SceneError::new(kind, place, message).label("these particles").help(help);
                let fatal = kind == "outside" || guards.overlap_stops;
                self.found.push(if fatal { error } else { error.warning() });
                Some(())
            };
            tell("outside", range.clone().filter(outside).collect(), "outside of the domain");
            tell("overlap", range.clone().filter(in_wall).collect(), "inside a wall of the domain");
        }
    }

    /// Particles that start too deep in each other would stop the run, or blow up.
    fn apart(&mut self, all: &ParticleSet) {
        let domain = &self.scene.domain;
        let largest = all.radius.iter().copied().fold(0.0, f64::max);
        let periodic = [0, 1, 2]
            .map(|k| domain.sides[k][0] == Side::Periodic && domain.max[k] - domain.min[k] >= 4.0 * largest);
        let region = Region { min: domain.min, max: domain.max, periodic };
        let Some((a, b, overlap)) = worst_overlap(&all.position, &all.radius, &region) else { return };
        let guards = self.scene.guards;
        if overlap <= guards.overlap_limit {
            return;
        }
        let Some((range, place)) = self.groups.iter().find(|(range, _)| range.contains(&b)) else { return };
        let number = |i: usize| {
            let group = self.groups.iter().position(|(r, _)| r.contains(&i)).unwrap_or_default();
            format!("{} of `{}`", i - self.groups[group].0.start, self.scene.particles[group].name.value)
        };
        let message = format!(
            "particles start inside each other: number {} and {} by {:.0} % of the smaller radius",
            number(a),
            number(b),
            100.0 * overlap
        );
        let help = format!(
            "at {:?} and {:?} m; allowed is {:.0} % (overlap_limit in [time]); move them apart, or check the unit of R",
            all.position[a],
            all.position[b],
            100.0 * guards.overlap_limit
        );
        let error = SceneError::new("overlap", place, message)
            .label(format!("these {} particles", range.len()))
            .help(help);
        self.found.push(if guards.overlap_stops { error } else { error.warning() });
    }
}

/// What `check` says of a cylinder or a cone: its radii, and where its ends are.
fn round_note(name: &str, frustum: &Frustum, pose: &Pose) -> String {
    let [(from, start), (to, end)] = frustum.rims();
    let place = |x: Vec3| place_point(pose, x).map(|c| format!("{c:.4}")).join(", ");
    let kind = if start == end {
        format!("cylinder of radius {start} m")
    } else {
        format!("cone of radius {start} m to {end} m")
    };
    let closed = if frustum.closed { "closed" } else { "open" };
    format!("geometry `{name}`: {kind}, {closed}, from ({}) to ({}) m", place(from), place(to))
}

/// A radius whose volume many spheres exceed on average \[m\]: the least of the distribution, or of one with
/// a bulge inside its limits a quarter of the bulge's radius.
fn small_radius(sizes: &SizeDistribution) -> f64 {
    match *sizes {
        SizeDistribution::Normal { mean: middle, min, max, .. }
        | SizeDistribution::LogNormal { median: middle, min, max, .. }
            if (min..=max).contains(&middle) =>
        {
            min.max(0.25 * middle)
        }
        _ => sizes.limits().0,
    }
}

/// The density of a material, or, of walls that were given none, any number above 0: it is not used, but
/// the engine wants one.
fn weight(density: f64) -> f64 {
    if density > 0.0 { density } else { 1000.0 }
}

/// Where a point of a surface's frame stands.
fn place_point(pose: &Pose, x: Vec3) -> Vec3 {
    let [w, u @ ..] = pose.rotation;
    let cross =
        |a: Vec3, b: Vec3| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let t = cross(u, x).map(|c| 2.0 * c);
    let tt = cross(u, t);
    [0, 1, 2].map(|k| pose.translation[k] + x[k] + w * t[k] + tt[k])
}
