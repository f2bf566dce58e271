//! Settled beds: the state after the leading stages of a scene, for the worlds that share them, in one batch or in
//! a later run.
//!
//! The leading stages are those before the first that inserts, withdraws or moves a surface. Surfaces that
//! are absent in them ("dormant") cannot touch the bed, so they are no part of its key: another tool finds
//! the same bed. Bits depend on the program and the device that made them, so both are part of the key.

use std::collections::BTreeSet;
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::SystemTime;

use glebe_engine::Constants;
use glebe_engine::backend::Backend;
use glebe_engine::spec::{Action, Motion, Stage, WorldSpec};
use glebe_engine::state::{MeasureState, State, SurfaceState};
use glebe_io::checkpoint::{self, CheckpointError, Header};

use crate::digest::Digest;

/// The cache is kept below this size, the oldest beds going first \[bytes\].
const SIZE_MAX: u64 = 2 << 30;

/// The leading stages of one scene.
pub(crate) struct Bed {
    /// Equal for worlds that have the same bed.
    pub(crate) key: String,
    /// Number of leading stages.
    pub(crate) stages: usize,
    /// For each surface of the scene, whether it is dormant.
    dormant: Vec<bool>,
}

/// The folder that beds are kept in unless another is named: `$GLEBE_CACHE`, else the system's place for
/// caches. None if there is no home to put it in.
pub fn default_folder() -> Option<PathBuf> {
    let named = |name| env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    named("GLEBE_CACHE").or_else(|| {
        let caches = named("XDG_CACHE_HOME")
            .or_else(|| named("LOCALAPPDATA"))
            .or_else(|| named("HOME").map(|home| home.join(".cache")));
        caches.map(|caches| caches.join("glebe").join("beds"))
    })
}

impl Bed {
    /// The bed of a prepared world, or none if it does not begin with stages worth keeping.
    pub(crate) fn of(constants: &Constants, fresh: &State, backend: Backend) -> Option<Self> {
        let spec = &constants.spec;
        let touched = |s: &Stage| {
            !s.moves.is_empty()
                || s.actions.iter().any(|a| matches!(a, Action::Insert(_) | Action::Withdraw(_)))
        };
        let first = spec.stages.iter().position(touched)?;
        // Stages without duration run on into the next, so the state can only be had after one that takes time.
        let stages = spec.stages[..first].iter().rposition(|s| !s.only_acts())? + 1;
        let measured: BTreeSet<usize> =
            spec.stages[..stages].iter().flat_map(|s| &s.measures).map(|m| m.surface).collect();
        let dormant: Vec<bool> = (spec.surfaces.iter().enumerate())
            .map(|(i, s)| s.absent && s.motion.is_fixed() && !measured.contains(&i))
            .collect();
        // A surface that stands there already begins its next motion at the end of the leading stages.
        let moved = spec.stages.get(stages).map_or(&[][..], |s| &s.moves);
        let moved: Vec<usize> =
            moved.iter().map(|(s, _)| *s).filter(|s| !dormant[*s]).map(|s| awake(&dormant, s)).collect();
        let particles = State { particles: fresh.particles.clone(), ..State::default() };
        let key = Digest::default()
            .debug(&env!("CARGO_PKG_VERSION"))
            .debug(&program()?)
            .debug(&backend.maker())
            .debug(&leading(spec, stages, &dormant))
            .debug(&moved)
            .debug(&constants.dt)
            .debug(&particles.hash())
            .finish();
        Some(Self { key, stages, dormant })
    }

    fn path(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.glebe", self.key))
    }

    /// The state after the leading stages, if it is kept in a folder and good.
    pub(crate) fn load(&self, constants: &Constants, folder: &Path) -> Option<State> {
        let path = self.path(folder);
        let mut state = checkpoint::kept(&path, &self.key)?;
        self.wake(constants, &mut state);
        state.belongs_to(constants).ok()?;
        // Beds in use are young.
        let _ = fs::File::open(&path).and_then(|f| f.set_modified(SystemTime::now()));
        Some(state)
    }

    /// Keeps the state after the leading stages, its dormant surfaces [asleep](Self::send_to_sleep), in a folder.
    pub(crate) fn store(&self, state: &State, folder: &Path) -> Result<(), CheckpointError> {
        let header = Header {
            glebe_version: env!("CARGO_PKG_VERSION").to_owned(),
            scene_hash: self.key.clone(),
            step: state.progress.step,
            ..Header::default()
        };
        checkpoint::keep(&self.path(folder), &header, state)?;
        prune(folder, &self.path(folder));
        Ok(())
    }

    /// Takes dormant surfaces out of a state. Domain sides are numbered after all surfaces.
    pub(crate) fn send_to_sleep(&self, state: &mut State) {
        let g = &mut state.progress;
        let stays = |i: usize| !self.dormant[i];
        retain(&mut g.surfaces, stays);
        retain(&mut g.path, stays);
        retain(&mut g.impulse, stays);
        retain(&mut g.wear, stays);
        for memory in &mut state.surface_contacts {
            let i = memory.surface as usize;
            memory.surface = awake(&self.dormant, i) as u32;
        }
    }

    /// Puts dormant surfaces as this scene has them into a state, as they are when the leading stages end.
    pub(crate) fn wake(&self, constants: &Constants, state: &mut State) {
        let g = &mut state.progress;
        let mut new_index = Vec::new();
        for (i, surface) in constants.spec.surfaces.iter().enumerate() {
            if self.dormant[i] {
                // The same arithmetic as of a surface that stood still, so that -0 becomes 0 here too.
                let pose = Motion::default().at(&surface.pose, 0.0).pose;
                let asleep =
                    SurfaceState { present: false, base: pose, since: g.stage_since, reference: pose };
                g.surfaces.insert(i, asleep);
                g.path.insert(i, 0.0);
                g.impulse.insert(i, [0.0; 6]);
                if constants.lists_wear() {
                    g.wear.insert(i, constants.unworn(i));
                }
            } else {
                new_index.push(i as u32);
            }
        }
        for memory in &mut state.surface_contacts {
            let i = memory.surface as usize;
            memory.surface = match new_index.get(i) {
                Some(new) => *new,
                None => memory.surface + (self.dormant.len() - new_index.len()) as u32,
            };
        }
        // Of the stage that comes next, which is not a leading one.
        let measures = constants.spec.stages.get(g.stage).map_or(0, |s| s.measures.len());
        g.measures = vec![MeasureState::default(); measures];
    }
}

/// The number of a surface, or of a side of the domain, when those that are dormant are left out.
fn awake(dormant: &[bool], surface: usize) -> usize {
    surface - dormant.iter().take(surface).filter(|d| **d).count()
}

/// A digest of this program, read once.
fn program() -> Option<&'static str> {
    static PROGRAM: OnceLock<Option<String>> = OnceLock::new();
    let digest = || Some(Digest::default().bytes(&fs::read(env::current_exe().ok()?).ok()?).finish());
    PROGRAM.get_or_init(digest).as_deref()
}

/// What the state after the leading stages depends on, but for the particles.
fn leading(spec: &WorldSpec, stages: usize, dormant: &[bool]) -> WorldSpec {
    let mut spec = spec.clone();
    spec.title.clear();
    spec.fields.clear();
    spec.network = false;
    spec.stages.truncate(stages);
    for stage in &mut spec.stages {
        for measure in &mut stage.measures {
            measure.surface = awake(dormant, measure.surface);
        }
    }
    retain(&mut spec.surfaces, |i| !dormant[i]);
    spec
}

fn retain<T>(items: &mut Vec<T>, keep: impl Fn(usize) -> bool) {
    let mut at = 0;
    items.retain(|_| {
        at += 1;
        keep(at - 1)
    });
}

/// Removes the oldest beds until the folder is small enough. Failing to is no reason to stop a run.
fn prune(folder: &Path, newest: &Path) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut beds: Vec<(SystemTime, u64, PathBuf)> = entries
        .flatten()
        .filter(|e| e.path().extension().is_some_and(|x| x == "glebe") && e.path() != newest)
        .filter_map(|e| e.metadata().ok().and_then(|m| Some((m.modified().ok()?, m.len(), e.path()))))
        .collect();
    beds.sort();
    let mut total: u64 = beds.iter().map(|(_, size, _)| size).sum();
    for (_, size, path) in beds {
        if total <= SIZE_MAX {
            break;
        }
        let _ = fs::remove_file(path);
        total -= size;
    }
}
