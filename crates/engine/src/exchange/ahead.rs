//! How many particles inlets will bring.

use super::{Grains, Supply, in_stage};
use crate::generate::{Purpose, Rng, solid_volume};
use crate::setup::Constants;
use crate::spec::Stage;

/// Particles of an inlet that are counted one by one ahead of a run.
const COUNTED: u64 = 1_000_000;

impl Constants {
    /// Particles that inlets bring at most; none if one of them has neither an end in time nor in mass. What an outlet gives
    /// back is not counted. Up to a million of an inlet they are counted as they will be drawn, beyond that in proportion.
    pub fn most_to_come(&self) -> Option<u64> {
        let longest = |stage: &Stage| {
            let until = &stage.until;
            let waits = until.kinetic_energy_below.is_some() || until.stress_within.is_some();
            until.at_most.or((!waits).then_some(0.0))
        };
        let mut all = 0;
        for (i, inlet) in self.spec.inlets.iter().enumerate() {
            let (Supply::Mass(rate, grains) | Supply::Number(rate, grains)) = &inlet.supply else { continue };
            let stages = self.spec.stages.iter().enumerate();
            let open = stages.filter(|(k, _)| in_stage(inlet.stages.as_ref(), *k));
            let time: Option<f64> = open.map(|(_, stage)| longest(stage)).sum();
            let owed = time.map(|time| rate * time);
            if owed.is_none() && inlet.most.is_none() {
                return None;
            }
            all += self.drawn(i, grains, owed, matches!(inlet.supply, Supply::Mass(..)));
        }
        Some(all)
    }

    /// Particles of an inlet until what it owes, mass or number, or its mass is used up.
    fn drawn(&self, i: usize, grains: &Grains, owed: Option<f64>, by_mass: bool) -> u64 {
        let density = self.spec.materials[grains.material].density;
        let limit = self.spec.inlets[i].most.unwrap_or(f64::INFINITY);
        let owed = owed.unwrap_or(f64::INFINITY);
        let (mut made, mut mass) = (0_u64, 0.0);
        let used = |made: u64, mass: f64| if by_mass { mass } else { made as f64 };
        while made < COUNTED && mass < limit {
            let mut rng = Rng::of(self.spec.seed, Purpose::InletSizes, [i as u64, made]);
            // The distribution was checked; a radius that it cannot give is none that is owed.
            let Ok(radius) = grains.sizes.draw(&mut rng) else { break };
            let more = solid_volume(&[radius]) * density;
            if used(made + 1, mass + more) > owed {
                return made;
            }
            made += 1;
            mass += more;
        }
        if mass >= limit || made < COUNTED {
            return made;
        }
        let share = (owed / used(made, mass)).min(limit / mass);
        (made as f64 * share).ceil() as u64
    }
}
