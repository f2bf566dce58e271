//! Builds without graphics processors.

use glebe_engine::backend::{Backend, Unavailable};

use super::Found;

fn none() -> Unavailable {
    Unavailable::new(
        "gpu",
        "this build of glebe has no GPU backend",
        "build it without --no-default-features, or give --device cpu",
    )
}

pub(super) fn best() -> Result<Backend, Unavailable> {
    Err(none())
}

pub(super) fn gpu(_: Option<usize>) -> Result<Backend, Unavailable> {
    Err(none())
}

pub(super) fn cuda(_: usize) -> Result<Backend, Unavailable> {
    Err(none())
}

pub(super) fn found() -> (Vec<Found>, Vec<Unavailable>) {
    (Vec::new(), vec![none()])
}
