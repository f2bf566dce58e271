//! The contact network of a frame: a line for each contact, with its force and its laws.

use std::collections::HashMap;

use glebe_engine::Constants;
use glebe_engine::batch::Frame;
use glebe_engine::lattice::{add, dot, norm, scale, sub};
use glebe_engine::spec::Vec3;
use glebe_io::output::vtp::{Cells, Column, PolyData, Values};
use glebe_physics::{Laws, Slot, laws};

/// Lines of a frame, from each particle to its partner's nearest image or to where it touches a surface.
#[derive(Default)]
pub(super) struct Network {
    points: Vec<Vec3>,
    lines: Vec<[u32; 2]>,
    normal: Vec<f32>,
    tangential: Vec<f32>,
    force: Vec<[f32; 3]>,
    first: Vec<i32>,
    second: Vec<i32>,
    surface: Vec<i32>,
    materials: [Vec<u32>; 2],
    laws: Vec<u32>,
}

/// One contact.
struct Contact {
    first: u32,
    /// Number of the partner, or that of the surface.
    with: With,
    branch: Vec3,
    /// On the first particle \[N\].
    force: [f32; 3],
}

enum With {
    Particle(u32),
    Surface(u32),
}

impl Network {
    /// Of a frame; contacts in the order of their particles' numbers, those with surfaces behind.
    pub(super) fn new(frame: &Frame<'_>) -> Self {
        let (c, p, detail) = (frame.constants, &frame.state.particles, frame.detail());
        let place: HashMap<u32, usize> = p.id.iter().enumerate().map(|(i, id)| (*id, i)).collect();
        let numbers = numbers(c);
        let mut contacts: Vec<Contact> = detail
            .network
            .iter()
            .map(|l| Contact {
                first: l.id[0],
                with: With::Particle(l.id[1]),
                branch: l.branch,
                force: l.force,
            })
            .collect();
        contacts.extend(detail.touches.iter().map(|t| Contact {
            first: t.id,
            with: With::Surface(t.surface),
            branch: t.branch,
            force: t.force,
        }));
        // The order of lists is no part of the physics.
        contacts.sort_by_key(|contact| match contact.with {
            With::Particle(j) => (false, contact.first, j),
            With::Surface(s) => (true, contact.first, s),
        });
        let mut network = Self::default();
        for contact in contacts {
            let Some(&i) = place.get(&contact.first) else { continue };
            let material = p.spin[i].material;
            let (partner, surface, other) = match contact.with {
                With::Particle(id) => {
                    let Some(&j) = place.get(&id) else { continue };
                    (id as i32, -1, p.spin[j].material)
                }
                With::Surface(s) => (-1, s as i32, c.boundaries[s as usize].material as u32),
            };
            let number = numbers[material as usize * c.spec.materials.len() + other as usize];
            network.push(frame.positions[i], &contact, [partner, surface], [material, other], number);
        }
        network
    }

    fn push(
        &mut self,
        at: Vec3,
        contact: &Contact,
        [partner, surface]: [i32; 2],
        materials: [u32; 2],
        laws: u32,
    ) {
        let start = self.points.len() as u32;
        self.points.extend([at, add(at, contact.branch)]);
        self.lines.push([start, start + 1]);
        let (normal, tangential) = parts(contact.branch, contact.force.map(f64::from));
        self.normal.push(normal as f32);
        self.tangential.push(tangential as f32);
        self.force.push(contact.force);
        self.first.push(contact.first as i32);
        self.second.push(partner);
        self.surface.push(surface);
        for (column, material) in self.materials.iter_mut().zip(materials) {
            column.push(material);
        }
        self.laws.push(laws);
    }

    pub(super) fn poly_data(&self) -> PolyData<'_> {
        PolyData {
            points: Values::Vec3F64(&self.points),
            cells: Cells::Lines(&self.lines),
            point_data: Vec::new(),
            cell_data: vec![
                Column::new("normal_force", Values::F32(&self.normal)),
                Column::new("tangential_force", Values::F32(&self.tangential)),
                Column::new("force", Values::Vec3F32(&self.force)),
                Column::new("first", Values::I32(&self.first)),
                Column::new("second", Values::I32(&self.second)),
                Column::new("surface", Values::I32(&self.surface)),
                Column::new("first_material", Values::U32(&self.materials[0])),
                Column::new("second_material", Values::U32(&self.materials[1])),
                Column::new("laws", Values::U32(&self.laws)),
            ],
        }
    }
}

/// Force along the branch, positive where the two press on each other, and across it \[N\]. Without a branch all of it
/// counts as normal.
fn parts(branch: Vec3, force: Vec3) -> (f64, f64) {
    let length = norm(branch);
    if length == 0.0 {
        return (norm(force), 0.0);
    }
    let n = scale(branch, 1.0 / length);
    let along = dot(force, n);
    (-along, norm(sub(force, scale(n, along))))
}

/// Which laws hold for each pair of materials: numbers from 0 in the order in which pairs have them first.
fn numbers(c: &Constants) -> Vec<u32> {
    let different = different(c);
    let number = |laws: &Laws| different.iter().position(|other| other == laws).unwrap_or_default() as u32;
    c.pairs.iter().map(|pair| number(&pair.laws)).collect()
}

fn different(c: &Constants) -> Vec<Laws> {
    let mut different: Vec<Laws> = Vec::new();
    for pair in &c.pairs {
        if !different.contains(&pair.laws) {
            different.push(pair.laws);
        }
    }
    different
}

/// What the numbers of `laws` and materials mean, for the summary.
pub(super) fn legend(c: &Constants) -> String {
    let names = |l: &Laws| {
        let of = |slot: Slot, number: usize| laws(slot)[number].name;
        [
            of(Slot::Normal, l.normal as usize),
            of(Slot::Tangential, l.tangential as usize),
            of(Slot::Rolling, l.rolling as usize),
            of(Slot::Cohesion, l.cohesion as usize),
            of(Slot::Bond, l.bond as usize),
        ]
        .join(" ")
    };
    let list = |names: Vec<String>| {
        names.iter().enumerate().map(|(k, name)| format!("{k} {name}")).collect::<Vec<_>>().join(", ")
    };
    let materials = list(c.spec.materials.iter().map(|m| m.name.clone()).collect());
    let laws = list(different(c).iter().map(names).collect());
    format!(
        "contacts in frames: laws are {laws} (normal, tangential, rolling, cohesion, bond); materials are {materials}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_force_has_a_part_along_the_branch_and_one_across() {
        assert_eq!(parts([0.0, 0.0, -2.0], [3.0, -4.0, 7.0]), (7.0, 5.0));
        assert_eq!(parts([1.0, 0.0, 0.0], [2.0, 0.0, 0.0]), (-2.0, 0.0));
        assert_eq!(parts([0.0; 3], [0.0, 0.0, 2.0]), (2.0, 0.0));
    }
}
