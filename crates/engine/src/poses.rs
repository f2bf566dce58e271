//! Poses over time as a table: a motion that was recorded, or computed elsewhere.

use std::f64::consts::PI;

use crate::lattice::{norm, scale, sub};
use crate::spec::{Pose, Vec3};
use crate::surface::{Placed, compose, quaternion, reversed};

/// Rows closer than this to half a turn apart \[rad\] do not say which way it goes.
const HALF_TURN: f64 = 1e-6;

/// A row of a table of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// Since the motion began \[s\].
    pub time: f64,
    /// Where the surface's frame stands; the quaternion may have any length but zero.
    pub pose: Pose,
}

/// How a surface moves away from where it stood, in legs between the rows of a table.
///
/// Between two rows the frame's origin moves evenly along a line, and the frame turns evenly about one axis through its
/// origin, the shorter way round (slerp). Velocity and angular velocity are those of the leg; at a row they are those of
/// the leg that begins. Before the first row the surface rests as the first row has it, after the last as the last.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseTable {
    legs: Vec<Leg>,
    end: f64,
    last: Pose,
}

/// From one row to the next; poses are relative to the first row.
#[derive(Clone, Debug, PartialEq)]
struct Leg {
    begin: f64,
    from: Pose,
    velocity: Vec3,
    /// Unit vector in the world.
    axis: Vec3,
    /// \[rad/s\]
    rate: f64,
}

/// Why rows are not a motion.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PoseTableError {
    /// Too few rows.
    #[error("{0} rows of poses: a motion needs two or more")]
    Few(usize),
    /// A number that is not finite.
    #[error("a number is not finite")]
    NotFinite(usize),
    /// A time that is not after that of the row before.
    #[error("the time {time} s does not come after {before} s of the row before; times must increase")]
    Order {
        /// Row, from 0.
        row: usize,
        /// Its time \[s\].
        time: f64,
        /// Time of the row before \[s\].
        before: f64,
    },
    /// A quaternion of length zero.
    #[error("the quaternion has the length 0 and is no rotation; no rotation at all is 1, 0, 0, 0")]
    NoRotation(usize),
    /// Half a turn from the row before.
    #[error(
        "it is half a turn from the row before, which may go either way; rows must be less than half a turn apart, so \
         put one between"
    )]
    HalfTurn(usize),
}

impl PoseTableError {
    /// The row concerned, from 0; none if it is the table.
    pub fn row(&self) -> Option<usize> {
        match *self {
            Self::Few(_) => None,
            Self::NotFinite(row) | Self::NoRotation(row) | Self::HalfTurn(row) | Self::Order { row, .. } => {
                Some(row)
            }
        }
    }
}

impl PoseTable {
    /// The motion through `rows`.
    ///
    /// # Errors
    /// See [`PoseTableError`].
    pub fn new(rows: &[TimedPose]) -> Result<Self, PoseTableError> {
        let [first, ..] = rows else { return Err(PoseTableError::Few(0)) };
        if rows.len() < 2 {
            return Err(PoseTableError::Few(rows.len()));
        }
        let mut poses = Vec::with_capacity(rows.len());
        let mut back = [0.0; 4];
        for (k, row) in rows.iter().enumerate() {
            let numbers = row.pose.translation.iter().chain(&row.pose.rotation).chain([&row.time]);
            if numbers.into_iter().any(|x| !x.is_finite()) {
                return Err(PoseTableError::NotFinite(k));
            }
            let turn = unit(row.pose.rotation).ok_or(PoseTableError::NoRotation(k))?;
            if k == 0 {
                back = reversed(turn);
            }
            poses.push(Pose {
                translation: sub(row.pose.translation, first.pose.translation),
                rotation: compose(turn, back),
            });
        }
        let legs = (1..rows.len())
            .map(|k| {
                let [before, time] = [rows[k - 1].time, rows[k].time];
                let duration = time - before;
                if duration <= 0.0 {
                    return Err(PoseTableError::Order { row: k, time, before });
                }
                let turn = compose(poses[k].rotation, reversed(poses[k - 1].rotation));
                // Both signs are the same rotation; the one with w ≥ 0 goes the shorter way.
                let sign = if turn[0] < 0.0 { -1.0 } else { 1.0 };
                let about = [sign * turn[1], sign * turn[2], sign * turn[3]];
                let sine = norm(about);
                let angle = 2.0 * sine.atan2(turn[0].abs());
                if angle > PI - HALF_TURN {
                    return Err(PoseTableError::HalfTurn(k));
                }
                Ok(Leg {
                    begin: before,
                    from: poses[k - 1],
                    velocity: sub(poses[k].translation, poses[k - 1].translation).map(|x| x / duration),
                    axis: if sine > 0.0 { scale(about, 1.0 / sine) } else { [0.0, 0.0, 1.0] },
                    rate: angle / duration,
                })
            })
            .collect::<Result<Vec<_>, _>>()?;
        let fast = |leg: &Leg| !leg.rate.is_finite() || leg.velocity.iter().any(|v| !v.is_finite());
        if let Some(leg) = legs.iter().position(fast) {
            return Err(PoseTableError::NotFinite(leg + 1));
        }
        let (end, last) = (rows[rows.len() - 1].time, poses[poses.len() - 1]);
        Ok(Self { legs, end, last })
    }

    /// How far the frame has gone and turned at `t` \[s\] from where it stood, and how fast it moves.
    pub fn at(&self, t: f64) -> Placed {
        let still = |pose: Pose| Placed { pose, ..Placed::default() };
        if t >= self.end {
            return still(self.last);
        }
        let after = self.legs.partition_point(|leg| leg.begin <= t);
        let Some(leg) = after.checked_sub(1).and_then(|k| self.legs.get(k)) else {
            return still(Pose::default());
        };
        let since = t - leg.begin;
        let turn = quaternion(leg.axis, leg.rate * since);
        let translation = [0, 1, 2].map(|k| leg.from.translation[k] + leg.velocity[k] * since);
        Placed {
            pose: Pose { translation, rotation: compose(turn, leg.from.rotation) },
            velocity: leg.velocity,
            spin: scale(leg.axis, leg.rate),
        }
    }

    /// The axes about which it turns, unit vectors, with the rates \[rad/s\], leg by leg.
    pub fn turns(&self) -> impl Iterator<Item = (Vec3, f64)> {
        self.legs.iter().filter(|leg| leg.rate > 0.0).map(|leg| (leg.axis, leg.rate))
    }

    /// Largest speed of the frame's origin \[m/s\].
    pub fn speed(&self) -> f64 {
        self.legs.iter().map(|leg| norm(leg.velocity)).fold(0.0, f64::max)
    }

    /// From the first row to the last, divided by the time between \[m/s\].
    pub fn mean_velocity(&self) -> Vec3 {
        let begin = self.legs.first().map_or(0.0, |leg| leg.begin);
        scale(self.last.translation, 1.0 / (self.end - begin))
    }
}

/// A quaternion of length 1; none for one of length zero.
fn unit(q: [f64; 4]) -> Option<[f64; 4]> {
    let largest = q.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    // Scaled first: squares of very small or large numbers are not numbers any more.
    let q = q.map(|x| x / largest);
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    (largest > 0.0).then(|| q.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use crate::lattice::{add, dot};
    use crate::surface::rotate;

    fn row(time: f64, translation: Vec3, rotation: [f64; 4]) -> TimedPose {
        TimedPose { time, pose: Pose { translation, rotation } }
    }

    const NONE: [f64; 4] = [1.0, 0.0, 0.0, 0.0];

    /// Three turns and a half about an askew axis, a fifth of a turn from row to row.
    #[test]
    fn many_turns_are_followed() {
        let axis = scale([2.0, -1.0, 2.0], 1.0 / 3.0);
        let rows: Vec<_> = (0..36)
            .map(|k| {
                let t = 0.1 * f64::from(k) + 2.0;
                row(t, scale([1.0, 2.0, 3.0], t), quaternion(axis, 0.2 * PI * f64::from(k) + 0.4))
            })
            .collect();
        let table = PoseTable::new(&rows).unwrap();
        for k in 0..350 {
            let t = 2.0 + 0.01 * f64::from(k) + 0.003;
            let at = table.at(t);
            let expected = rotate(quaternion(axis, 2.0 * PI * (t - 2.0)), [0.3, 0.5, -0.7]);
            let off = sub(rotate(at.pose.rotation, [0.3, 0.5, -0.7]), expected);
            assert!(norm(off) < 1e-13, "turned at {t} s: off by {off:?}");
            assert!(norm(sub(at.pose.translation, scale([1.0, 2.0, 3.0], t - 2.0))) < 1e-13, "{at:?}");
            assert!(norm(sub(at.spin, scale(axis, 2.0 * PI))) < 1e-11, "{at:?}");
            assert!(norm(sub(at.velocity, [1.0, 2.0, 3.0])) < 1e-12, "{at:?}");
        }
    }

    #[test]
    fn it_rests_before_the_first_and_after_the_last_row() {
        let turned = quaternion([0.0, 0.0, 1.0], 1.0);
        let table = PoseTable::new(&[row(1.0, [5.0; 3], turned), row(3.0, [6.0; 3], NONE)]).unwrap();
        assert_eq!(table.at(0.0), Placed::default());
        let end = table.at(7.0);
        assert_eq!((end.pose.translation, end.velocity, end.spin), ([1.0; 3], [0.0; 3], [0.0; 3]));
        assert_eq!(end, table.at(3.0));
        let expected = quaternion([0.0, 0.0, 1.0], -1.0);
        assert!((0..4).all(|k| (end.pose.rotation[k] - expected[k]).abs() < 1e-15), "{end:?}");
        // At the first row the first leg begins.
        assert_eq!(table.at(1.0).velocity, [0.5; 3]);
        assert!((dot(table.at(1.0).spin, [0.0, 0.0, 1.0]) + 0.5).abs() < 1e-15);
    }

    /// The velocity of any point is the slope of its path.
    #[test]
    fn velocities_are_slopes() {
        let rows = [
            row(0.0, [0.0; 3], NONE),
            row(0.5, [0.1, 0.0, -0.2], quaternion([0.0, 1.0, 0.0], 2.0)),
            row(0.8, [0.0, 0.3, 0.0], scale4(quaternion([0.6, 0.0, 0.8], -1.0), -3.0)),
        ];
        let table = PoseTable::new(&rows).unwrap();
        let point = |t: f64| table.at(t).pose.apply([0.2, -0.1, 0.3]);
        for t in [0.1, 0.3, 0.499, 0.6, 0.79] {
            let step = 1e-6;
            let slope = scale(sub(point(t + step), point(t - step)), 0.5 / step);
            let at = table.at(t);
            let arm = sub(point(t), at.pose.translation);
            let expected = add(at.velocity, crate::lattice::cross(at.spin, arm));
            assert!(norm(sub(slope, expected)) < 1e-8, "at {t} s: {slope:?} instead of {expected:?}");
        }
    }

    fn scale4(q: [f64; 4], s: f64) -> [f64; 4] {
        q.map(|x| x * s)
    }

    #[test]
    fn rows_that_are_no_motion_are_refused() {
        let start = row(0.0, [0.0; 3], NONE);
        let refused = |rows: &[TimedPose]| PoseTable::new(rows).unwrap_err();
        assert_eq!(refused(&[]), PoseTableError::Few(0));
        assert_eq!(refused(&[start]), PoseTableError::Few(1));
        let order = PoseTableError::Order { row: 1, time: 0.0, before: 0.0 };
        assert_eq!(refused(&[start, start]), order);
        let nan = row(1.0, [0.0, f64::NAN, 0.0], NONE);
        assert_eq!(refused(&[start, nan]), PoseTableError::NotFinite(1));
        assert_eq!(refused(&[start, row(f64::INFINITY, [0.0; 3], NONE)]), PoseTableError::NotFinite(1));
        assert_eq!(refused(&[start, row(1.0, [0.0; 3], [0.0; 4])]), PoseTableError::NoRotation(1));
        let half = row(1.0, [0.0; 3], quaternion([0.0, 1.0, 0.0], 2.0 * FRAC_PI_2));
        assert_eq!(refused(&[start, half]), PoseTableError::HalfTurn(1));
        assert_eq!(refused(&[start, row(1e-320, [1e10; 3], NONE)]), PoseTableError::NotFinite(1));
        // Tiny and huge quaternions are rotations too.
        for size in [1e-200, 1e200] {
            let far = row(1.0, [0.0; 3], scale4(quaternion([0.0, 1.0, 0.0], 1.0), size));
            let end = PoseTable::new(&[start, far]).unwrap().at(2.0).pose.rotation;
            assert!((end[2] - 0.5_f64.sin()).abs() < 1e-15, "{end:?}");
        }
    }
}
