//! The stages that a study of periodic samples consists of.

use glebe_engine::cell::STRAIN_PER_STEP;
use glebe_engine::spec::{Deformation, Drive, Sampling, Stage, Until, WorldSpec};
use glebe_io::study::{Consolidate, Load, Prepare, Program};

/// Name of the stage in which a sample is made.
pub(super) const PREPARE: &str = "prepare";
/// Name of the stage in which it is consolidated.
pub(super) const CONSOLIDATE: &str = "consolidate";
/// Share of its pressure within which a sample is made.
const PREPARED_WITHIN: f64 = 0.01;
/// What a stage that waits for its stress may take at most: this strain at the rate of its inertial number, then so many
/// times that a grain takes to fall into a hole, `2r √(ρ/p)`.
const STRAIN_AT_MOST: f64 = 5.0;
const FALLS_AT_MOST: f64 = 1000.0;

/// What rates of a world follow from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scales {
    /// Mean diameter \[m\].
    pub(super) diameter: f64,
    /// Mean density \[kg/m³\].
    pub(super) density: f64,
}

impl Scales {
    /// Of the particles of a world; radii weigh alike, densities by volume.
    pub(super) fn of(spec: &WorldSpec) -> Self {
        let set = &spec.particles;
        let cubes = || set.radius.iter().zip(&set.material).map(|(r, m)| (r.powi(3), *m));
        let density = |material: usize| spec.materials.get(material).map_or(f64::NAN, |m| m.density);
        let solid: f64 = cubes().map(|(v, _)| v).sum();
        Self {
            diameter: 2.0 * set.radius.iter().sum::<f64>() / set.len() as f64,
            density: cubes().map(|(v, m)| v * density(m)).sum::<f64>() / solid,
        }
    }

    /// The time that a grain takes to fall into a hole at a pressure \[s\].
    pub(super) fn fall(self, pressure: f64) -> f64 {
        self.diameter * (self.density / pressure).sqrt()
    }

    /// Strain rate of an inertial number at a pressure \[1/s\].
    pub(super) fn rate(self, inertial_number: f64, pressure: f64) -> f64 {
        inertial_number / self.fall(pressure)
    }

    fn patience(self, inertial_number: f64, pressure: f64) -> f64 {
        STRAIN_AT_MOST / self.rate(inertial_number, pressure) + FALLS_AT_MOST * self.fall(pressure)
    }

    fn isotropic(self, name: &str, pressure: f64, within: f64, inertial_number: f64) -> Stage {
        let [x, y, z] = [Drive::Stress(pressure); 3];
        let still = Drive::Rate(0.0);
        Stage {
            name: name.to_owned(),
            deformation: Some(Deformation {
                drive: [x, y, z, still, still, still],
                inertial_number,
                ..Deformation::default()
            }),
            until: Until {
                stress_within: Some(within),
                at_most: Some(self.patience(inertial_number, pressure)),
                ..Until::default()
            },
            ..Stage::default()
        }
    }
}

/// Makes a world one in which a sample is made with a friction.
pub(super) fn preparing(spec: &mut WorldSpec, prepare: &Prepare, friction: f64) {
    for material in &mut spec.materials {
        (material.friction, material.static_friction) = (friction, friction);
        if let Some(youngs_modulus) = prepare.youngs_modulus {
            material.youngs_modulus = youngs_modulus;
        }
    }
    for (_, _, pair) in &mut spec.pairs {
        (pair.friction, pair.static_friction) = (Some(friction), Some(friction));
    }
    let scales = Scales::of(spec);
    let Prepare { pressure, inertial_number, .. } = *prepare;
    spec.stages = vec![scales.isotropic(PREPARE, pressure, PREPARED_WITHIN, inertial_number)];
    spec.sampling = sampling(spec, scales.fall(pressure));
}

/// Makes a world, whose step is `dt` \[s\], one in which a sample is consolidated and loaded.
pub(super) fn loading(spec: &mut WorldSpec, dt: f64, consolidate: &Consolidate, load: Option<&Load>) {
    let scales = Scales::of(spec);
    let Consolidate { pressure, within, inertial_number } = *consolidate;
    let mut stages = vec![scales.isotropic(CONSOLIDATE, pressure, within, inertial_number)];
    let mut series = scales.fall(pressure);
    if let Some(load) = load {
        match load.program {
            Program::Scene => {
                series = spec.sampling.series;
                stages.append(&mut spec.stages);
            }
            Program::IsotropicCompression => stages.extend(compression(scales, consolidate, load)),
            program => {
                // As fast as allowed: what is soft enough may be strained by no more in a step.
                let rate =
                    scales.rate(load.inertial_number, pressure).min((1.0 - 1e-9) * STRAIN_PER_STEP / dt);
                let driven = strained(program, rate, load, pressure);
                let time: f64 = driven.iter().filter_map(|stage| stage.until.at_most).sum();
                series = time / load.points as f64;
                stages.extend(driven);
            }
        }
    }
    spec.stages = stages;
    spec.sampling = sampling(spec, series);
}

fn sampling(spec: &WorldSpec, series: f64) -> Sampling {
    Sampling { series, frames: None, ..spec.sampling }
}

/// Steps of equal ratios to the pressure at the end, each until it is reached.
fn compression(scales: Scales, from: &Consolidate, load: &Load) -> Vec<Stage> {
    let step = |k: u64| {
        let share = k as f64 / load.points as f64;
        let pressure = from.pressure * libm::pow(load.pressure / from.pressure, share);
        scales.isotropic(&format!("step-{k}"), pressure, from.within, load.inertial_number)
    };
    (1..=load.points).map(step).collect()
}

/// One way, or there, back to the other side and home so many times.
fn strained(program: Program, rate: f64, load: &Load, pressure: f64) -> Vec<Stage> {
    let way = |name: String, rate: f64, strain: f64| Stage {
        name,
        deformation: Some(Deformation {
            drive: drive(program, rate, pressure),
            inertial_number: load.inertial_number,
            ..Deformation::default()
        }),
        until: Until { at_most: Some(strain / rate.abs()), ..Until::default() },
        ..Stage::default()
    };
    if load.cycles == 0 {
        return vec![way("load".to_owned(), rate, load.strain)];
    }
    let cycle = |k: u64| {
        [("there", rate, 1.0), ("back", -rate, 2.0), ("home", rate, 1.0)]
            .map(|(name, rate, ways)| way(format!("{name}-{k}"), rate, ways * load.strain))
    };
    (1..=load.cycles).flat_map(cycle).collect()
}

/// What drives the cell: xx, yy, zz, yz, xz, xy.
fn drive(program: Program, rate: f64, pressure: f64) -> [Drive; 6] {
    let (hold, still, along) = (Drive::Stress(pressure), Drive::Rate(0.0), Drive::Rate(rate));
    match program {
        Program::UndrainedTriaxial => {
            let across = Drive::Rate(-0.5 * rate);
            [across, across, along, still, still, still]
        }
        Program::SimpleShear => [still, still, hold, still, along, still],
        _ => [hold, hold, along, still, still, still],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOAD: Load = Load {
        program: Program::DrainedTriaxial,
        strain: 0.1,
        cycles: 0,
        inertial_number: 1e-3,
        pressure: f64::NAN,
        points: 200,
    };

    /// Strain along a component at the end of stages, from their rates and durations.
    fn strain(stages: &[Stage], component: usize) -> f64 {
        let of = |stage: &Stage| match stage.deformation.unwrap().drive[component] {
            Drive::Rate(rate) => rate * stage.until.at_most.unwrap(),
            Drive::Stress(_) => f64::NAN,
        };
        stages.iter().map(of).sum()
    }

    #[test]
    fn programs_strain_as_asked_for() {
        let one_way = strained(Program::DrainedTriaxial, 2.0, &LOAD, 1e5);
        assert!((strain(&one_way, 2) - 0.1).abs() < 1e-15);
        assert!(strain(&one_way, 0).is_nan(), "the stress across is held");
        let undrained = strained(Program::UndrainedTriaxial, 2.0, &LOAD, 1e5);
        let volume: f64 = (0..3).map(|k| strain(&undrained, k)).sum();
        assert!(volume.abs() < 1e-15, "{volume}");
        let cycles = strained(Program::SimpleShear, 2.0, &Load { cycles: 3, ..LOAD }, 1e5);
        assert_eq!(cycles.len(), 9);
        assert!(strain(&cycles, 4).abs() < 1e-15, "cycles end where they began");
        assert!((strain(&cycles[..1], 4) - 0.1).abs() < 1e-15);
        assert!((strain(&cycles[..2], 4) + 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_compression_goes_in_equal_ratios_to_its_end() {
        let scales = Scales { diameter: 2e-3, density: 2650.0 };
        let from = Consolidate { pressure: 1e5, within: 0.01, inertial_number: 1e-2 };
        let load = Load { program: Program::IsotropicCompression, pressure: 8e5, points: 3, ..LOAD };
        let stages = compression(scales, &from, &load);
        let pressures: Vec<f64> =
            stages.iter().map(|s| s.deformation.unwrap().targets().next().unwrap().1).collect();
        for (found, expected) in pressures.iter().zip([2e5, 4e5, 8e5]) {
            assert!((found / expected - 1.0).abs() < 1e-12, "{pressures:?}");
        }
    }

    #[test]
    fn the_inertial_number_sets_the_rate() {
        let scales = Scales { diameter: 2e-3, density: 2500.0 };
        // 2 mm √(2500/1e5) = 316 µs
        assert!((scales.rate(1e-3, 1e5) - 1e-3 / (2e-3 * 0.025_f64.sqrt())).abs() < 1e-9);
    }
}
