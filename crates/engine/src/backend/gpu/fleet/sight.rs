//! What is seen of worlds.

use cubecl::prelude::*;

use super::super::device::Device;
use super::super::layout::{INNER, LOOK, SIGHTS, inner, status};
use super::super::step::Purpose;
use super::super::sums;
use super::Group;
use crate::backend::Moment;
use crate::measure::Tensors;
use crate::state::Progress;

impl Group {
    /// Looks at worlds.
    pub(super) fn observe<R: Runtime>(
        &mut self,
        device: &Device<R>,
        asked: &[(usize, &Progress)],
    ) -> Vec<Moment> {
        let mut jobs = vec![None; self.worlds.len()];
        for w in 0..self.worlds.len() {
            self.set_state(w, status::BASE, 0);
            self.set_state(w, status::TARGET, 0);
        }
        for (w, g) in asked {
            jobs[*w] = Some((*g, 0, false));
            self.set_state(*w, status::ASKED, LOOK);
        }
        self.prepare(device, &jobs);
        if device.broken().is_some() {
            return Vec::new();
        }
        self.look(device, Purpose::Observe);
        self.over_blocks(device, self.signature.sights(), false, &self.b.sights);
        let seen: Vec<f32> = device.read(&self.b.gathered, 0, self.b.gathered.len);
        for (w, _) in asked {
            self.set_state(*w, status::ASKED, 0);
        }
        asked.iter().map(|(w, _)| self.moment(*w, &seen)).collect()
    }

    /// What was seen of a world.
    fn moment(&self, w: usize, seen: &[f32]) -> Moment {
        let of = |q: u32| {
            let at = (w * self.signature.sights() as usize + q as usize) * 2;
            f64::from(seen[at]) + f64::from(seen[at + 1])
        };
        let contacts = (0.5 * of(5)).round() as u64;
        let tensors = self.signature.sample.then(|| {
            let inside = std::array::from_fn(|q| of(SIGHTS + q as u32));
            tensors(&inside, self.counts[w] as u64, contacts)
        });
        Moment {
            translation: of(0),
            rotation: of(1),
            potential: of(2),
            elastic_normal: of(3),
            elastic_tangential: of(4),
            contacts,
            surface_contacts: of(6) as u64,
            overlap: of(sums::OVERLAP),
            speed: of(sums::SPEED).sqrt(),
            tensors,
        }
    }
}

/// The sums over a sample, from those of [`inner`].
fn tensors(sums: &[f64; INNER as usize], particles: u64, contacts: u64) -> Tensors {
    let at = |k: u32| sums[k as usize];
    let symmetric = |k: u32| {
        let [xx, yy, zz, xy, yz, zx] = [0, 1, 2, 3, 4, 5].map(|q| at(k + q));
        [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
    };
    Tensors {
        particles,
        contacts,
        contact: [0, 3, 6].map(|row| [0, 1, 2].map(|k| at(inner::CONTACT + row + k))),
        kinetic: symmetric(inner::KINETIC),
        fabric: symmetric(inner::FABRIC),
        stiffness: at(inner::STIFFNESS),
        solid: 4.0 / 3.0 * std::f64::consts::PI * at(inner::CUBES),
        rattlers: [0, 1].map(|k| at(inner::RATTLERS + k).round() as u64),
    }
}
