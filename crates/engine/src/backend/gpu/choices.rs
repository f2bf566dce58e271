//! The laws that a kernel is made for: one in each slot, or two of which a pair of materials has either.

use std::collections::BTreeSet;

use cubecl::prelude::*;
use glebe_physics::kernel::bond::{BondLaw, Held, Hold, Parting, chosen_hold};
use glebe_physics::kernel::cohesion::{Attraction, CohesionLaw, chosen_attraction};
use glebe_physics::kernel::contact::{Coefficients, Memory, Touch};
use glebe_physics::kernel::normal::{NormalForce, NormalLaw, chosen_force};
use glebe_physics::kernel::rolling::{Roll, RollingLaw, Torques, chosen_torques};
use glebe_physics::kernel::tangential::{Spring, TangentialLaw, chosen_spring};
use glebe_physics::{Laws, Layout, Slot};

use crate::setup::Constants;

/// The laws of a slot, in the order of the registry; the same twice where there is one.
pub type Either<L> = [L; 2];

/// The laws of a kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Choices {
    /// Normal force.
    pub normal: Either<NormalLaw>,
    /// Tangential force.
    pub tangential: Either<TangentialLaw>,
    /// Rolling torque.
    pub rolling: Either<RollingLaw>,
    /// Cohesion.
    pub cohesion: Either<CohesionLaw>,
    /// Bonds.
    pub bond: Either<BondLaw>,
    /// Where floats of contacts stand.
    pub layout: Layout,
}

/// The numbers of a slot's laws that pairs of a world have.
fn numbers(c: &Constants, slot: Slot) -> BTreeSet<usize> {
    c.pairs.iter().map(|p| number(p.laws, slot)).collect()
}

fn number(laws: Laws, slot: Slot) -> usize {
    match slot {
        Slot::Normal => laws.normal as usize,
        Slot::Tangential => laws.tangential as usize,
        Slot::Rolling => laws.rolling as usize,
        Slot::Cohesion => laws.cohesion as usize,
        Slot::Bond => laws.bond as usize,
    }
}

impl Choices {
    /// Of a world.
    pub fn of(c: &Constants) -> Self {
        let ends = |slot| {
            let all = numbers(c, slot);
            [all.first(), all.last()].map(|n| n.copied().unwrap_or_default())
        };
        Self {
            normal: ends(Slot::Normal).map(|n| NormalLaw::ALL[n]),
            tangential: ends(Slot::Tangential).map(|n| TangentialLaw::ALL[n]),
            rolling: ends(Slot::Rolling).map(|n| RollingLaw::ALL[n]),
            cohesion: ends(Slot::Cohesion).map(|n| CohesionLaw::ALL[n]),
            bond: ends(Slot::Bond).map(|n| BondLaw::ALL[n]),
            layout: c.layout,
        }
    }

    /// Which of the two laws of each slot a pair of materials has: a bit set for the second.
    pub fn bits(&self, laws: Laws) -> u32 {
        let second = [
            laws.normal != self.normal[0],
            laws.tangential != self.tangential[0],
            laws.rolling != self.rolling[0],
            laws.cohesion != self.cohesion[0],
            laws.bond != self.bond[0],
        ];
        (0..).zip(second).map(|(bit, second)| u32::from(second) << bit).sum()
    }

    /// Why a device cannot run a world's laws.
    pub fn refusal(c: &Constants) -> Option<String> {
        if c.wears() {
            let what = "wear of surfaces (`wear` of a material) is computed by the CPU alone: the sums of a facet would depend \
                        on the order in which a device adds them";
            return Some(what.to_owned());
        }
        Slot::ALL.into_iter().find_map(|slot| {
            let all = numbers(c, slot);
            let names: Vec<_> = all.iter().map(|n| glebe_physics::laws(slot)[*n].name).collect();
            (all.len() > 2).then(|| {
                format!(
                    "pairs of materials of this world have {} different {} laws ({}), of which a device can tell two \
                     apart",
                    all.len(),
                    slot.name(),
                    names.join(", ")
                )
            })
        })
    }
}

/// Whether a pair has the second law of the slot of number `slot`.
#[cube]
pub fn second(bits: u32, #[comptime] slot: u32) -> bool {
    bits & comptime!(1 << slot) != 0u32
}

/// The normal force of a pair with the bits `which`.
#[cube]
pub fn force(
    k: &Coefficients,
    c: Touch,
    m: Memory,
    which: u32,
    #[comptime] laws: Either<NormalLaw>,
) -> NormalForce {
    if comptime!(laws[0] == laws[1]) {
        chosen_force(comptime!(laws[0]), k, c, m)
    } else if second(which, 0u32) {
        chosen_force(comptime!(laws[1]), k, c, m)
    } else {
        chosen_force(comptime!(laws[0]), k, c, m)
    }
}

/// The tangential spring.
#[cube]
pub fn spring(
    k: &Coefficients,
    c: Touch,
    n: NormalForce,
    which: u32,
    #[comptime] laws: Either<TangentialLaw>,
) -> Spring {
    if comptime!(laws[0] == laws[1]) {
        chosen_spring(comptime!(laws[0]), k, c, n)
    } else if second(which, 1u32) {
        chosen_spring(comptime!(laws[1]), k, c, n)
    } else {
        chosen_spring(comptime!(laws[0]), k, c, n)
    }
}

/// The torques of rolling resistance.
#[cube]
pub fn torques(
    k: &Coefficients,
    r: Roll,
    m: Memory,
    which: u32,
    #[comptime] laws: Either<RollingLaw>,
) -> Torques {
    if comptime!(laws[0] == laws[1]) {
        chosen_torques(comptime!(laws[0]), k, r, m)
    } else if second(which, 2u32) {
        chosen_torques(comptime!(laws[1]), k, r, m)
    } else {
        chosen_torques(comptime!(laws[0]), k, r, m)
    }
}

/// The attraction.
#[cube]
pub fn attraction(
    k: &Coefficients,
    c: Touch,
    m: Memory,
    which: u32,
    #[comptime] laws: Either<CohesionLaw>,
) -> Attraction {
    if comptime!(laws[0] == laws[1]) {
        chosen_attraction(comptime!(laws[0]), k, c, m)
    } else if second(which, 3u32) {
        chosen_attraction(comptime!(laws[1]), k, c, m)
    } else {
        chosen_attraction(comptime!(laws[0]), k, c, m)
    }
}

/// What a bond does.
#[cube]
pub fn hold(
    k: &Coefficients,
    strength: Coefficients,
    p: Parting,
    h: Held,
    which: u32,
    #[comptime] laws: Either<BondLaw>,
) -> Hold {
    if comptime!(laws[0] == laws[1]) {
        chosen_hold(comptime!(laws[0]), k, strength, p, h)
    } else if second(which, 4u32) {
        chosen_hold(comptime!(laws[1]), k, strength, p, h)
    } else {
        chosen_hold(comptime!(laws[0]), k, strength, p, h)
    }
}
