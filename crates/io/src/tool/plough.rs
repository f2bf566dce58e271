//! A plough's body.

use glebe_engine::spec::{TriMesh, Vec3};

use super::{ToolError, check_range, divisions, sheet};
use crate::mesh::assemble;

/// Share and mouldboard of a plough, as one sheet that turns the furrow slice to the right (-y).
///
/// Its front is a cylindroid, as of the ploughs that Goryachkin described: level lines glide up an arc in the plane of
/// the land side, y = 0, and turn away from the travel as they rise. The arc begins at the point of the share, the
/// origin, with `lift_angle` and ends at `height` with `curl_angle`; the lines begin on it, have `share_angle` from
/// the travel at the cutting edge and `top_angle` at the top, and end at y = -`width`. The rear is the front moved
/// back by the thickness, so that the volume is `width · height · thickness`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plough {
    /// Working width, along y \[m\], 0.01 to 10.
    pub width: f64,
    /// Along z \[m\], 0.01 to 10.
    pub height: f64,
    /// Between the cutting edge and the travel \[deg\], 15 to 90.
    pub share_angle: f64,
    /// Between the upper edge and the travel \[deg\], 15 to 90.
    pub top_angle: f64,
    /// Inclination of the arc at the point, from the ground \[deg\], 5 to 85.
    pub lift_angle: f64,
    /// Inclination of the arc at its upper end \[deg\], above `lift_angle` and up to 150; beyond 90 it hangs over.
    pub curl_angle: f64,
    /// Along the travel \[m\], up to half of the width.
    pub thickness: f64,
    /// Whether it turns the slice to the left (+y) instead.
    pub left: bool,
    /// Length aimed at for the lines of the mesh's grid \[m\], 1/500 to 1 times the longest; the sheet is one cell thick.
    pub resolution: f64,
}

impl Default for Plough {
    fn default() -> Self {
        Self {
            width: 0.35,
            height: 0.35,
            share_angle: 42.0,
            top_angle: 48.0,
            lift_angle: 25.0,
            curl_angle: 105.0,
            thickness: 0.012,
            left: false,
            resolution: 0.025,
        }
    }
}

impl Plough {
    /// The body as a closed mesh \[m\].
    ///
    /// # Errors
    /// The first parameter outside of its range, and that range.
    pub fn mesh(&self) -> Result<TriMesh, ToolError> {
        let range =
            |name, value, unit, limits, reason| check_range("plough", name, value, unit, limits, reason);
        range("width", self.width, "m", [0.01, 10.0], "size of a tool")?;
        range("height", self.height, "m", [0.01, 10.0], "size of a tool")?;
        range("share_angle", self.share_angle, "deg", [15.0, 90.0], "90 deg is across the travel")?;
        range("top_angle", self.top_angle, "deg", [15.0, 90.0], "90 deg is across the travel")?;
        range("lift_angle", self.lift_angle, "deg", [5.0, 85.0], "inclination of the share")?;
        let reason = "the board must rise from the share, and not roll up";
        range("curl_angle", self.curl_angle, "deg", [self.lift_angle + 1.0, 150.0], reason)?;
        let reason = "up to half of the width";
        range("thickness", self.thickness, "m", [1e-4 * self.width, 0.5 * self.width], reason)?;
        let flattest = self.share_angle.min(self.top_angle).to_radians();
        let edge = self.width / flattest.sin();
        let arc = self.radius() * (self.curl_angle - self.lift_angle).to_radians();
        let longest = edge.max(arc);
        let reason = "the longest line divided by 1 to 500";
        range("resolution", self.resolution, "m", [longest / 500.0, longest], reason)?;

        let across = divisions(self.width, edge, self.resolution);
        let up = divisions(1.0, arc, self.resolution);
        let (side, top) = (across.len() - 1, up.len() - 1);
        let at = |j: usize, k: usize, rear: usize| {
            let [x, y, z] = self.front(across[j], up[k]);
            [x - self.thickness * rear as f64, y, z]
        };
        let mut soup = Vec::new();
        // The first index of `across` is the land side, so that it runs against y.
        sheet(&mut soup, 0..top, 0..side, |k, j| at(j, k, 0));
        sheet(&mut soup, 0..side, 0..top, |j, k| at(j, k, 1));
        sheet(&mut soup, 0..side, 0..1, |j, i| at(j, 0, i));
        sheet(&mut soup, 0..1, 0..side, |i, j| at(j, top, i));
        sheet(&mut soup, 0..1, 0..top, |i, k| at(0, k, i));
        sheet(&mut soup, 0..top, 0..1, |k, i| at(side, k, i));
        if self.left {
            for [a, b, c] in &mut soup {
                [*a, *b, *c] = [*a, *c, *b].map(|[x, y, z]| [x, -y, z]);
            }
        }
        Ok(assemble(&soup).0)
    }

    /// Of the arc in the plane of the land side \[m\].
    fn radius(&self) -> f64 {
        self.height / (self.lift_angle.to_radians().cos() - self.curl_angle.to_radians().cos())
    }

    /// The point of the front so far from the land side \[m\], on the line at a share of the arc.
    fn front(&self, across: f64, share: f64) -> Vec3 {
        let [lift, curl] = [self.lift_angle, self.curl_angle].map(f64::to_radians);
        let angle = lift + share * (curl - lift);
        let x = self.radius() * (lift.sin() - angle.sin());
        // Both ends are exact.
        let z = match share {
            0.0 => 0.0,
            1.0 => self.height,
            _ => self.radius() * (lift.cos() - angle.cos()),
        };
        let turn = self.share_angle + (self.top_angle - self.share_angle) * z / self.height;
        [x - across / turn.to_radians().tan(), -across, z]
    }
}
