//! The plots of a run: energies, and for each mesh that a stage moved its draught force and furrow.

use glebe_engine::Constants;
use glebe_engine::batch::{Batch, positions};
use glebe_engine::spec::{Component, Pose, Shape, Vec3, Window};
use glebe_engine::state::{StageResult, State};
use glebe_io::output::series::Series;
use glebe_io::output::{OutputDir, OutputError, file_word};
use glebe_report::{Draught, FurrowView, Profile, draught_force, energies, furrow_profile};

/// Bins of a furrow profile.
const BINS: usize = 120;
/// Share of the section that is left out at either end: there the tool dives in and comes out.
const ENDS: f64 = 0.15;

/// A mesh that a stage moves.
struct Moved {
    stage: usize,
    surface: usize,
    /// Where it leads \[m/s\].
    heading: Vec3,
}

/// The furrows that tools leave, found while the run goes on.
#[derive(Default)]
pub(super) struct Furrows {
    /// Tools on their way.
    under_way: Vec<Track>,
    stage: Option<usize>,
    done: Vec<(usize, usize, Profile, Option<f64>)>,
}

/// A tool on its way through the bed.
struct Track {
    moved: Moved,
    view: FurrowView,
    /// Extent of the tool along its path when it set out \[m\].
    from: [f64; 2],
    /// Level of the surface then \[m\].
    level: Option<f64>,
}

impl Furrows {
    /// Looks at the bed when a stage that moves meshes begins and when it ends. To be called after every
    /// advance.
    pub(super) fn look(&mut self, batch: &Batch) {
        let (c, g) = (batch.constants(0), batch.progress(0));
        if let Some(stage) = self.stage
            && stage != g.stage
        {
            let state = batch.state(0);
            let (centres, radii) = (positions(c, &state), radii(&state));
            for track in std::mem::take(&mut self.under_way) {
                let s = track.moved.surface;
                let to = extent(c, s, &g.surfaces[s].base, track.view.along);
                if let Some(section) = passed(c, &track, to) {
                    let view = FurrowView { section, ..track.view };
                    let profile = furrow_profile(&centres, &radii, &view);
                    self.done.push((stage, s, profile, track.level));
                }
            }
            self.stage = None;
        }
        if self.stage.is_none() && g.stage_begun && g.stage < c.spec.stages.len() {
            self.stage = Some(g.stage);
            let tracks = moved(c, g.stage).into_iter().filter_map(|m| Some((view(c, m.heading)?, m)));
            let tracks: Vec<_> = tracks.collect();
            if tracks.is_empty() {
                return;
            }
            let state = batch.state(0);
            let (centres, radii) = (positions(c, &state), radii(&state));
            for (view, moved) in tracks {
                let from = extent(c, moved.surface, &g.surfaces[moved.surface].base, view.along);
                let level = furrow_profile(&centres, &radii, &view).level();
                self.under_way.push(Track { moved, view, from, level });
            }
        }
    }
}

fn radii(state: &State) -> Vec<f64> {
    state.particles.place.iter().map(|p| f64::from(p.radius)).collect()
}

/// The meshes that a stage moves along a line.
fn moved(c: &Constants, stage: usize) -> Vec<Moved> {
    let moves = &c.spec.stages[stage].moves;
    moves
        .iter()
        .filter(|(s, m)| matches!(c.spec.surfaces[*s].shape, Shape::Mesh(_)) && m.heading() != [0.0; 3])
        .map(|(surface, motion)| Moved { stage, surface: *surface, heading: motion.heading() })
        .collect()
}

/// How the furrow of a tool is looked at, with the middle half of the domain as section; none without
/// gravity or for a motion straight up or down.
fn view(c: &Constants, heading: Vec3) -> Option<FurrowView> {
    let up = largest(c.spec.gravity, None)?;
    let along = largest(heading, Some(up))?;
    let across = 3 - up - along;
    let side = |axis: usize| [c.spec.domain.origin[axis], c.spec.domain.cell[axis][axis]];
    let ([x, length], [y, width]) = (side(along), side(across));
    Some(FurrowView {
        along,
        across,
        up,
        section: [x + 0.25 * length, x + 0.75 * length],
        range: [y, y + width],
        bins: BINS,
    })
}

/// The axis along which a vector is largest, but for one; none if it is zero.
fn largest(v: Vec3, except: Option<usize>) -> Option<usize> {
    let axes = (0..3).filter(|k| Some(*k) != except && v[*k] != 0.0);
    axes.max_by(|a, b| v[*a].abs().total_cmp(&v[*b].abs()))
}

/// From where to where a surface that stands at `pose` reaches along an axis \[m\].
fn extent(c: &Constants, surface: usize, pose: &Pose, axis: usize) -> [f64; 2] {
    let Shape::Mesh(mesh) = &c.spec.surfaces[surface].shape else { return [0.0; 2] };
    let along = mesh.vertices.iter().map(|x| pose.apply(*x)[axis]);
    along.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], x| [lo.min(x), hi.max(x)])
}

/// The part of the path inside the domain that the whole tool has passed.
fn passed(c: &Constants, track: &Track, to: [f64; 2]) -> Option<[f64; 2]> {
    let axis = track.view.along;
    let from = track.from;
    let [near, far] = if to[0] > from[0] { [from[1], to[0]] } else { [to[1], from[0]] };
    let origin = c.spec.domain.origin[axis];
    let (near, far) = (near.max(origin), far.min(origin + c.spec.domain.cell[axis][axis]));
    let length = far - near;
    (length > 4.0 * c.radius_max).then_some([near + ENDS * length, far - ENDS * length])
}

/// Reads the series back and writes all plots.
pub(super) fn write(
    dir: &OutputDir,
    c: &Constants,
    results: &[StageResult],
    furrows: &Furrows,
) -> Result<(), OutputError> {
    let series = Series::read(&dir.series())?;
    let column = |name: &str| series.column(name).unwrap_or_default();
    let sum =
        |a: &str, b: &str| -> Vec<f64> { column(a).iter().zip(column(b)).map(|(a, b)| a + b).collect() };
    let kinetic = sum("kinetic_translation", "kinetic_rotation");
    let elastic = sum("elastic_normal", "elastic_tangential");
    let accounts: Vec<(&str, &[f64])> = vec![
        ("kinetic", &kinetic),
        ("elastic", &elastic),
        ("potential", column("potential")),
        ("dissipated", column("dissipated")),
    ];
    let time = column("time");
    // Stages before the first row (of a bed that was reused) would squeeze the plot.
    let first = time.first().copied().unwrap_or(0.0);
    let begins = std::iter::once(0.0).chain(results.iter().map(|r| r.time));
    let names = c.spec.stages.iter().map(|s| s.name.as_str());
    let marks: Vec<(f64, &str)> = begins.zip(names).filter(|(t, _)| *t >= first).collect();
    dir.write_plot("energies", &energies(time, &accounts, &marks, true))?;

    for stage in 0..c.spec.stages.len() {
        for moved in moved(c, stage) {
            let rows: Vec<usize> =
                (0..time.len()).filter(|k| column("stage")[*k] == moved.stage as f64).collect();
            let surface = &c.spec.surfaces[moved.surface].name;
            let pick = |part: &str| -> Vec<f64> {
                let all = column(&format!("{surface}.{part}"));
                rows.iter().map(|k| all[*k]).collect()
            };
            let (path, force) = (pick("path"), pick("draught"));
            if path.len() < 2 {
                continue;
            }
            let spec = &c.spec.stages[stage];
            let measure = spec
                .measures
                .iter()
                .position(|m| m.surface == moved.surface && m.component == Component::Draught);
            let window = measure.and_then(|m| match spec.measures[m].window {
                Window::Displacement(from, to) => Some([from, to]),
                _ => None,
            });
            let mean_std = measure
                .and_then(|m| results.get(stage)?.measures.get(m))
                .filter(|m| m.n > 0)
                .map(|m| [m.mean, m.std()]);
            let draught = Draught { displacement: &path, force: &force, window, mean_std };
            dir.write_plot(&file_name(c, stage, moved.surface, "draught"), &draught_force(&draught))?;
        }
    }
    for (stage, surface, profile, level) in &furrows.done {
        dir.write_plot(&file_name(c, *stage, *surface, "furrow"), &profile.plot(*level))?;
    }
    Ok(())
}

/// `till_sweep_draught`
fn file_name(c: &Constants, stage: usize, surface: usize, what: &str) -> String {
    let [stage, surface] = [&c.spec.stages[stage].name, &c.spec.surfaces[surface].name].map(|n| file_word(n));
    format!("{stage}_{surface}_{what}")
}
