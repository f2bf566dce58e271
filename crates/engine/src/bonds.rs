//! Bonds between particles: where they are made, and how many each particle has.

use glebe_physics::{PairCoefficients, Slot};

use crate::backend::cpu::near_pairs;
use crate::failure::SetupError;
use crate::setup::Constants;
use crate::spec::{Action, WorldSpec};
use crate::state::{ContactMemory, History, State};

/// Refuses bonds that reach too far for lists, and such as cannot be made because no law says how.
pub fn check(spec: &WorldSpec, pairs: &[PairCoefficients], radius_min: f64) -> Result<(), SetupError> {
    let bad = |what: String| Err(SetupError::Invalid(what));
    let farthest = pairs.iter().map(|p| p.bond_range).fold(0.0, f64::max);
    if farthest > radius_min {
        return bad(format!(
            "bonds would hold particles up to {farthest:.3e} m apart, farther than the smallest radius of \
             {radius_min:.3e} m: their gap and what they stretch until they break, tensile_strength over \
             normal_stiffness, are too much; make them stiffer, weaker, or the gap smaller"
        ));
    }
    let makes = spec.stages.iter().find(|stage| stage.actions.contains(&Action::Bond));
    match makes {
        Some(stage) if farthest == 0.0 => bad(format!(
            "the stage `{}` bonds particles, but no law of bonds is given; set contact.bond, or that of a pair",
            stage.name
        )),
        _ => Ok(()),
    }
}

impl State {
    /// Bonds every two particles whose surfaces are as close as the gap of their materials' law of bonds allows, and
    /// which are not bonded yet. New bonds carry no load.
    pub fn bond(&mut self, c: &Constants) {
        if !c.bonds() {
            return;
        }
        let rest = c.layout.place(Slot::Bond).start;
        let mut new = Vec::new();
        for ([i, j], distance) in near_pairs(c, self) {
            let p = &self.particles;
            let pair = c.pair(p.spin[i].material as usize, p.spin[j].material as usize);
            let gap = distance - f64::from(p.place[i].radius) - f64::from(p.place[j].radius);
            if pair.bond[0] == 0.0 || gap > pair.bond[3] {
                continue;
            }
            let id = [p.id[i].min(p.id[j]), p.id[i].max(p.id[j])];
            match self.contacts.binary_search_by(|m| m.id.cmp(&id)) {
                Ok(k) if self.contacts[k].history[rest] > 0.0 => continue,
                Ok(k) => self.contacts[k].history[rest] = distance as f32,
                Err(_) => {
                    let mut history = History::from_elem(0.0, c.history.len());
                    history[rest] = distance as f32;
                    new.push(ContactMemory { id, history });
                }
            }
            self.progress.bonds.made += 1;
        }
        self.contacts.append(&mut new);
        self.contacts.sort_unstable_by_key(|m| m.id);
    }

    /// The number of bonds of each particle, in the order of storage; none where there are no bonds.
    pub fn bonds_of(&self, c: &Constants) -> Option<Vec<u32>> {
        if !c.bonds() {
            return None;
        }
        let rest = c.layout.place(Slot::Bond).start;
        let mut of = vec![0; c.count];
        for m in self.contacts.iter().filter(|m| m.history[rest] > 0.0) {
            m.id.iter().for_each(|id| of[*id as usize] += 1);
        }
        Some(self.particles.id.iter().map(|id| of[*id as usize]).collect())
    }
}
