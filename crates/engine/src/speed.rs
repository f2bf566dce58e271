//! How far surfaces go in a step: one that goes too far passes through grains unseen.

use crate::backend::common::failure;
use crate::failure::{Failure, SetupError};
use crate::lattice::{cross, norm, sub};
use crate::setup::{BoundaryShape, Constants};
use crate::spec::{Action, Motion, Pose, Vec3};
use crate::state::Progress;
use crate::surface::rotate;

/// The part of the smallest radius that a surface may go in a step at most. Particles may then go so much less.
pub(crate) const MOST: f64 = 0.5;
/// The part beyond which the user is told: contacts begin with overlaps up to it.
const TOLD: f64 = 0.1;

impl Motion {
    /// A bound on the speed of any point that it moves \[m/s\]. `arm` is the largest distance \[m\] of a point from an
    /// axis, given by its direction and a point of it, or from the frame's origin.
    pub(crate) fn fastest(&self, arm: impl Fn(Option<(Vec3, Vec3)>) -> f64) -> f64 {
        let mut v = norm(self.velocity);
        if let Some(o) = self.oscillation {
            v += norm(o.amplitude) * std::f64::consts::TAU * o.frequency;
        }
        if let Some(r) = self.rotation {
            v += r.rate.abs() * arm(Some((r.axis, r.center)));
        }
        if let Some(poses) = &self.poses {
            v += poses.speed() + arm(None) * poses.turns().map(|(_, rate)| rate).fold(0.0, f64::max);
        }
        v
    }
}

/// A bound on the speed with which surface `s` comes towards a grain \[m/s\], in a motion that begins with the surface
/// at `base`. A shell that turns about its own axis comes towards none; of a plane the part in the domain counts.
fn approach(c: &Constants, s: usize, motion: &Motion, base: &Pose) -> f64 {
    motion.fastest(|about| {
        let far = |x: Vec3| match about {
            Some((axis, center)) => norm(cross(axis, sub(base.apply(x), center))),
            None => norm(x),
        };
        let points: Vec<f64> = match &c.boundaries[s].shape {
            BoundaryShape::Plane(_) => {
                c.spec.domain.corners().into_iter().map(|x| far(base.inverse(x))).collect()
            }
            BoundaryShape::Mesh(mesh, _) => mesh.vertices.iter().map(|x| far(*x)).collect(),
            BoundaryShape::Frustum(frustum) => {
                let own = rotate(base.rotation, frustum.axis);
                let tilt = about.map_or(1.0, |(axis, _)| norm(cross(axis, own)));
                frustum.rims().into_iter().map(|(x, radius)| far(x) + tilt * radius).collect()
            }
        };
        points.into_iter().fold(0.0, f64::max)
    })
}

/// The part of the smallest radius that a speed is in a step.
fn share(c: &Constants, speed: f64) -> f64 {
    speed * c.dt / c.radius_min
}

/// A surface with its speed, in words.
fn described(c: &Constants, s: usize, speed: f64) -> String {
    format!(
        "the surface `{}` moves up to {speed:.3e} m/s, {:.3e} m in a step of {:.3e} s, which is {:.0} % of the smallest \
         radius",
        c.boundaries[s].name,
        speed * c.dt,
        c.dt,
        100.0 * share(c, speed)
    )
}

/// The step with which it goes as far as nobody has to be told \[s\].
fn advised(c: &Constants, speed: f64) -> f64 {
    TOLD * c.radius_min / speed
}

/// Looks at all motions before the start; returns what the user should know. What depends on where a surface gets to
/// is left to [`too_fast`].
///
/// # Errors
/// [`SetupError::SurfaceTooFast`].
pub(crate) fn check(c: &Constants) -> Result<Vec<String>, SetupError> {
    let surfaces = &c.spec.surfaces;
    let mut present: Vec<bool> = surfaces.iter().map(|s| !s.absent).collect();
    let mut moved = vec![false; surfaces.len()];
    let mut fastest = vec![0.0_f64; surfaces.len()];
    for (k, stage) in c.spec.stages.iter().enumerate() {
        for action in &stage.actions {
            match action {
                Action::Insert(s) => present[*s] = true,
                Action::Withdraw(s) => present[*s] = false,
                Action::RemoveBeyond { .. } | Action::Bond => {}
            }
        }
        for s in (0..surfaces.len()).filter(|s| present[*s] && !stage.only_acts()) {
            let motion = c.motion(s, k);
            let speed = approach(c, s, motion, &surfaces[s].pose);
            if share(c, speed) > MOST && (motion.rotation.is_none() || !moved[s]) {
                return Err(SetupError::SurfaceTooFast {
                    what: described(c, s, speed),
                    stage: stage.name.clone(),
                    most: 100.0 * MOST,
                    advised: advised(c, speed),
                });
            }
            fastest[s] = fastest[s].max(speed);
            moved[s] |= !motion.is_fixed();
        }
    }
    let told = fastest.iter().enumerate().filter(|(_, speed)| share(c, **speed) > TOLD);
    Ok(told
        .map(|(s, speed)| {
            format!(
                "{}: contacts may begin with such an overlap; a step of {:.3e} s makes it {:.0} %",
                described(c, s, *speed),
                advised(c, *speed),
                100.0 * TOLD
            )
        })
        .collect())
}

/// The failure of a world in whose present stage a surface would move too far in a step, from where it stands.
pub(crate) fn too_fast(c: &Constants, g: &Progress) -> Option<Failure> {
    let speeds = g.surfaces.iter().enumerate().filter(|(_, surface)| surface.present).map(|(s, surface)| {
        let speed = approach(c, s, c.motion(s, g.stage), &surface.base);
        (s, speed)
    });
    let (s, speed) = speeds.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, v)| share(c, *v) > MOST)?;
    let stage = &c.spec.stages[g.stage].name;
    let cause = format!(
        "the step is too large for this motion, more than {:.0} % let grains pass through unseen; take a time.step of \
         {:.3e} s or less, or move it more slowly in `{stage}`",
        100.0 * MOST,
        advised(c, speed)
    );
    Some(failure(c, g, described(c, s, speed), &cause))
}
