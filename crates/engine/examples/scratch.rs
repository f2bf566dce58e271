#![allow(missing_docs, clippy::all, clippy::pedantic, clippy::unwrap_used)]
use glebe_engine::backend::*;
use glebe_engine::batch::*;
use glebe_engine::generate::*;
use glebe_engine::spec::*;
use glebe_engine::state::*;
use glebe_physics::*;
struct P;
impl Observer for P {
    type Error = ();
    fn sample(&mut self, _: usize, s: &Sample) -> Result<(), ()> {
        let l = s.ledger;
        println!(
            "t {:.4} n {} z {:.2} kin {:.3e} pot {:.4e} el {:.3e} et {:.3e} fr {:.3e} da {:.3e} ro {:.3e} st {:.2e} W {:.2e} int {:.3e} diss {:.3e} ov {:.3}",
            s.time,
            s.contacts,
            s.coordination,
            l.translation + l.rotation,
            l.potential,
            l.elastic_normal,
            l.elastic_tangential,
            l.friction,
            l.dashpots,
            l.rolling,
            l.stiffness_change,
            l.work,
            l.integrator(),
            l.dissipated(),
            s.overlap
        );
        Ok(())
    }
    fn frame(&mut self, _: usize, _: &Frame<'_>) -> Result<(), ()> {
        Ok(())
    }
    fn stage_ended(&mut self, _: usize, _: usize, r: &StageResult) -> Result<(), ()> {
        println!("{r:?}");
        Ok(())
    }
}
fn main() {
    let n: usize = std::env::args().nth(1).unwrap().parse().unwrap();
    let ledger = std::env::args().nth(2).is_some();
    let r = SizeDistribution::Uniform { min: 1.6e-3, max: 2.4e-3 }.sample(n, 1).unwrap();
    let vol: f64 = r.iter().map(|r| 4.19 * r.powi(3)).sum::<f64>() / 0.6;
    let side = vol.cbrt();
    let h = 1.3 * side;
    let region = Region::walled([0.0; 3], [side, side, h]);
    let x = generate("dense", &FillRequest { region, up: 2, radii: &r, seed: 1, solid_fraction: Some(0.58) })
        .unwrap();
    let d = Domain::aligned(
        [0.0; 3],
        [side, side, 1.2 * h],
        [[Side::Wall; 2], [Side::Wall; 2], [Side::Wall, Side::Open]],
        Some(0),
    );
    let mut w =
        WorldSpec::new(d, Time { step: Step::Fixed(2e-5), integrator: IntegratorKind::Euler, force: false });
    w.materials = vec![Material {
        name: "g".into(),
        density: 2600.0,
        youngs_modulus: 2e7,
        poissons_ratio: 0.3,
        restitution: 0.5,
        friction: 0.5,
        static_friction: 0.5,
        rolling_friction: 0.01,
    }];
    w.contact.rolling = LawChoice::named("constant-torque");
    w.gravity = [0.0, 0.0, -9.81];
    w.sampling.energy_ledger = ledger;
    w.sampling.series = 2e-2;
    for (p, r) in x.iter().zip(&r) {
        w.particles.push(*p, *r, 0);
    }
    w.stages.push(Stage {
        name: "settle".into(),
        until: Until { kinetic_energy_below: None, at_most: Some(0.1) },
        ..Default::default()
    });
    let mut b = Batch::new(vec![w], Backend::Cpu).map_err(|e| e.1.to_string()).unwrap();
    println!("{:?}", b.constants(0).limits);
    while b.running() {
        let t = std::time::Instant::now();
        let s0 = b.progress(0).step;
        b.advance(&mut P).unwrap();
        let ds = b.progress(0).step - s0;
        println!(
            "   rate {:.2}e6 rebuilds {} skin {:.2e}",
            ds as f64 * n as f64 / t.elapsed().as_secs_f64() / 1e6,
            b.progress(0).rebuilds,
            b.progress(0).skin
        );
    }
    println!("{:?} {:?} {}", b.status(0), b.times(0), b.state(0).hash());
}
