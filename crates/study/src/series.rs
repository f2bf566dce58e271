//! The series of a world as rows of numbers.

use glebe_engine::Constants;
use glebe_engine::batch::Sample;
use glebe_io::output::columns::{self, Shown};

/// The columns of the `series.csv` of a world.
pub fn names(c: &Constants) -> Vec<String> {
    let spec = &c.spec;
    let inlets = spec.inlets.iter().map(|i| i.name.as_str());
    columns::series(&Shown {
        surfaces: spec
            .surfaces
            .iter()
            .enumerate()
            .map(|(s, surface)| (&*surface.name, c.wear_of(s).is_some()))
            .collect(),
        doors: inlets.chain(spec.outlets.iter().map(|o| o.name.as_str())).collect(),
        bonds: c.bonds(),
        sample: c.is_sample(),
    })
}

/// A row of `series.csv`, in the order of [`names`], with those of `bonds` where there may be some.
pub fn row(s: &Sample, bonds: bool) -> Vec<f64> {
    let l = &s.ledger;
    let mut row = vec![
        s.time,
        s.step as f64,
        s.stage as f64,
        s.particles as f64,
        l.translation,
        l.rotation,
        l.potential,
        l.elastic_normal,
        l.elastic_tangential,
        l.friction,
        l.dashpots,
        l.rolling,
        l.damping,
        l.dissipated(),
        l.stiffness_change,
        l.work,
        l.removed,
        l.integrator(),
        s.contacts as f64,
        s.surface_contacts as f64,
        s.coordination,
        s.overlap,
        s.speed,
    ];
    if bonds {
        row.extend([s.bonds.made as f64, s.bonds.broken as f64]);
    }
    for t in &s.surfaces {
        row.extend(t.force.iter().chain(&t.torque));
        row.extend([t.draught, t.path, f64::from(u8::from(t.present))]);
        row.extend(t.pose.translation.iter().chain(&t.pose.rotation));
        row.extend(t.wear);
    }
    if !s.flows.is_empty() {
        row.push(l.entered);
    }
    for flow in &s.flows {
        row.extend([flow.particles as f64, flow.mass, flow.rate]);
    }
    if let Some(i) = &s.interior {
        row.extend([i.p(), i.q(), i.volumetric_strain(), i.deviatoric_strain(), i.void_ratio]);
        row.extend([i.mechanical_coordination, i.rattlers as f64]);
        for tensor in [&i.stress, &i.kinetic_stress, &i.strain, &i.fabric] {
            row.extend(columns::SYMMETRIC.map(|([a, b], _)| 0.5 * (tensor[a][b] + tensor[b][a])));
        }
    }
    row
}
