//! A loose cloud that is let fall.

use super::relax::pack;
use super::{FillInfo, FillRequest, GenerateError};
use crate::spec::Vec3;

pub(super) const INFO: FillInfo = FillInfo {
    name: "rain",
    summary: "loose disordered cloud from the floor up, sizes mixed at random; no overlap",
    fraction_max: 0.45,
    fraction_default: Some(0.30),
    place,
};

/// Far below random close packing, spheres pushed apart as if larger by this end without any overlap
/// in few steps: at 0.45 they then take 0.52.
const INFLATION: f64 = 1.05;

fn place(request: &FillRequest) -> Result<Vec<Vec3>, GenerateError> {
    pack(INFO.name, request, INFLATION, 0.0)
}
