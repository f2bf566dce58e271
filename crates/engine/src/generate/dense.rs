//! A random packing nearly as dense as it can be.

use super::relax::pack;
use super::{FillInfo, FillRequest, GenerateError};
use crate::spec::Vec3;

pub(super) const INFO: FillInfo = FillInfo {
    name: "dense",
    summary: "dense random packing by pushing spheres apart; overlaps of at most 1 % of the smaller radius",
    fraction_max: 0.60,
    fraction_default: Some(0.58),
    place,
};

/// Deepest overlap left, as a share of the smaller radius: under the 1 % promised.
const TOLERANCE: f64 = 0.008;

fn place(request: &FillRequest) -> Result<Vec<Vec3>, GenerateError> {
    // Near random close packing there is no room to inflate into.
    pack(INFO.name, request, 1.0, TOLERANCE)
}
