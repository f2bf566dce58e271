//! The friction with which a sample is made, found by bisection: denser without it, looser with more of it.

use glebe_io::study::{Aim, Prepare};

/// A friction that was tried, with the void ratio that it led to, or why there is none.
pub(super) type Tried = (f64, Result<f64, String>);

/// What follows from what was tried.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Next {
    /// These are to be tried.
    Try(Vec<f64>),
    /// This one is taken.
    Take { friction: f64, void_ratio: f64 },
    /// There is none.
    GiveUp(String),
}

/// What comes next in a preparation of which so much was tried. It depends on that alone, so a search that was
/// interrupted goes on as if it had not been.
pub(super) fn next(prepare: &Prepare, tried: &[Tried]) -> Next {
    let of = |friction: f64| tried.iter().find(|(f, _)| *f == friction).map(|(_, found)| found);
    let (target, tolerance, between, rounds) = match prepare.aim {
        Aim::Friction(friction) => {
            return match of(friction) {
                None => Next::Try(vec![friction]),
                Some(Ok(void_ratio)) => Next::Take { friction, void_ratio: *void_ratio },
                Some(Err(why)) => Next::GiveUp(why.clone()),
            };
        }
        Aim::VoidRatio { target, tolerance, between, rounds } => (target, tolerance, between, rounds),
    };
    let untried: Vec<f64> = between.into_iter().filter(|f| of(*f).is_none()).collect();
    if !untried.is_empty() {
        return Next::Try(untried);
    }
    let found = |friction: f64| of(friction).cloned().unwrap_or_else(|| Err(String::new()));
    let (densest, loosest) = match (found(between[0]), found(between[1])) {
        (Ok(densest), Ok(loosest)) => (densest, loosest),
        (Err(why), _) | (_, Err(why)) => return Next::GiveUp(why),
    };
    let [mut low, mut high] = between;
    let mut nearest =
        if (densest - target).abs() <= (loosest - target).abs() { (low, densest) } else { (high, loosest) };
    let near = |e: f64| (e - target).abs() <= tolerance;
    if !near(nearest.1) && !(densest..=loosest).contains(&target) {
        return Next::GiveUp(format!(
            "a void ratio of {target} is out of reach at {} Pa: a friction of {low} gives {densest:.4}, one of {high} \
             gives {loosest:.4}; for denser samples raise the pressure or lower Young's modulus, for looser ones raise \
             `prepare.between` or the rolling resistance",
            prepare.pressure
        ));
    }
    for _ in 0..rounds {
        if near(nearest.1) {
            break;
        }
        let middle = 0.5 * (low + high);
        match of(middle) {
            None => return Next::Try(vec![middle]),
            Some(Err(why)) => return Next::GiveUp(why.clone()),
            Some(&Ok(e)) => {
                if (e - target).abs() < (nearest.1 - target).abs() {
                    nearest = (middle, e);
                }
                if e < target { low = middle } else { high = middle }
            }
        }
    }
    let (friction, void_ratio) = nearest;
    if near(void_ratio) {
        return Next::Take { friction, void_ratio };
    }
    Next::GiveUp(format!(
        "a void ratio of {target} was not met within {tolerance} in {rounds} rounds: the nearest was {void_ratio:.4}, at a \
         friction of {friction:.6}; raise `prepare.tolerance`, or take more particles, whose void ratios scatter less"
    ))
}

/// The one of those that were tried which a search would take if it ended now.
pub(super) fn nearest(prepare: &Prepare, tried: &[Tried]) -> Option<f64> {
    let target = match prepare.aim {
        Aim::Friction(friction) => return Some(friction),
        Aim::VoidRatio { target, .. } => target,
    };
    let off = |found: &Result<f64, String>| found.as_ref().map_or(f64::INFINITY, |e| (e - target).abs());
    tried.iter().min_by(|a, b| off(&a.1).total_cmp(&off(&b.1))).map(|(friction, _)| *friction)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn prepare(target: f64, tolerance: f64, rounds: u64) -> Prepare {
        let text = format!(
            "scene = \"example.toml\"\n[consolidate]\npressure = 1e5\n[prepare]\nvoid_ratio = {target:?}\n\
             tolerance = {tolerance:?}\nrounds = {rounds}\n"
        );
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../io/tests/scene_common");
        let study = glebe_io::study::Study::parse("study.toml", &text, &folder, &[]).unwrap();
        study.rve.unwrap().prepare.unwrap()
    }

    /// Goes on until the search ends; the void ratio is a known function of the friction.
    fn ended(prepare: &Prepare, e: impl Fn(f64) -> Result<f64, String>) -> (Next, usize) {
        let mut tried = Vec::new();
        loop {
            match next(prepare, &tried) {
                Next::Try(frictions) => tried.extend(frictions.into_iter().map(|f| (f, e(f)))),
                end => return (end, tried.len()),
            }
        }
    }

    #[test]
    fn bisection_finds_the_friction_of_a_void_ratio() {
        // e = 0.55 + 0.2 √μ, so e = 0.65 at μ = 0.25, and 0.68 at 0.4225.
        let curve = |f: f64| Ok(0.55 + 0.2 * f.sqrt());
        let (end, tries) = ended(&prepare(0.68, 1e-3, 12), curve);
        let Next::Take { friction, void_ratio } = end else { panic!("{end:?}") };
        assert!((void_ratio - 0.68).abs() <= 1e-3 && (friction - 0.4225).abs() < 0.01, "{friction}");
        assert!(tries <= 2 + 8, "{tries}");
        // The ends count as well.
        assert_eq!(ended(&prepare(0.75, 1e-3, 12), curve).1, 2);
    }

    #[test]
    fn what_is_out_of_reach_is_told_with_the_range() {
        let curve = |f: f64| Ok(0.55 + 0.2 * f.sqrt());
        for target in [0.5, 0.8] {
            let (end, tries) = ended(&prepare(target, 5e-3, 12), curve);
            let Next::GiveUp(why) = end else { panic!("{end:?}") };
            assert!(
                why.contains("0.5500") && why.contains("0.7500") && why.contains("out of reach"),
                "{why}"
            );
            assert_eq!(tries, 2);
        }
        // A jump over the target is no friction of it.
        let jump = |f: f64| Ok(if f < 0.3 { 0.6 } else { 0.7 });
        let Next::GiveUp(why) = ended(&prepare(0.65, 5e-3, 6), jump).0 else { panic!() };
        assert!(why.contains("6 rounds") && why.contains("prepare.tolerance"), "{why}");
        let failing = |f: f64| if f > 0.4 { Err("it burst".to_owned()) } else { Ok(0.6) };
        assert_eq!(ended(&prepare(0.65, 5e-3, 6), failing).0, Next::GiveUp("it burst".to_owned()));
    }

    #[test]
    fn a_search_goes_on_from_what_was_tried_in_any_order() {
        let curve = |f: f64| Ok(0.55 + 0.2 * f.sqrt());
        let aim = prepare(0.68, 1e-3, 12);
        let mut tried: Vec<Tried> = Vec::new();
        let end = loop {
            match next(&aim, &tried) {
                Next::Try(frictions) => {
                    tried.extend(frictions.into_iter().map(|f| (f, curve(f))));
                    tried.reverse();
                }
                end => break end,
            }
        };
        assert_eq!(end, ended(&aim, curve).0);
    }
}
