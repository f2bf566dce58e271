//! From names to laws: the choice of a world resolved and prepared for pairs of materials.

use std::ops::Range;

use crate::kernel::bond::BondLaw;
use crate::kernel::cohesion::CohesionLaw;
use crate::kernel::normal::NormalLaw;
use crate::kernel::rolling::RollingLaw;
use crate::kernel::tangential::TangentialLaw;
use crate::{ContactEnd, ContactModel, History, LawChoice, LawError, LawInfo, PairProperties, Preparation};

/// The slots that laws sit in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// Normal force.
    Normal,
    /// Tangential force.
    Tangential,
    /// Rolling torque.
    Rolling,
    /// Cohesive force.
    Cohesion,
    /// Bond between particles.
    Bond,
}

impl Slot {
    /// Every slot.
    pub const ALL: [Self; 5] = [Self::Normal, Self::Tangential, Self::Rolling, Self::Cohesion, Self::Bond];

    /// Name in a scene.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Tangential => "tangential",
            Self::Rolling => "rolling",
            Self::Cohesion => "cohesion",
            Self::Bond => "bond",
        }
    }
}

/// Every registered law of a slot, in the order of the registry.
pub fn laws(slot: Slot) -> &'static [LawInfo] {
    match slot {
        Slot::Normal => NormalLaw::INFO,
        Slot::Tangential => TangentialLaw::INFO,
        Slot::Rolling => RollingLaw::INFO,
        Slot::Cohesion => CohesionLaw::INFO,
        Slot::Bond => BondLaw::INFO,
    }
}

/// The law of each slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Laws {
    /// Normal force.
    pub normal: NormalLaw,
    /// Tangential force.
    pub tangential: TangentialLaw,
    /// Rolling torque.
    pub rolling: RollingLaw,
    /// Cohesion.
    pub cohesion: CohesionLaw,
    /// Bonds.
    pub bond: BondLaw,
}

/// The coefficients of one pair of materials, before rounding to a device's precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairCoefficients {
    /// The laws.
    pub laws: Laws,
    /// Of the normal law.
    pub normal: [f64; 4],
    /// Of the tangential law.
    pub tangential: [f64; 4],
    /// Of the rolling law.
    pub rolling: [f64; 4],
    /// Of the law of cohesion.
    pub cohesion: [f64; 4],
    /// Of the law of bonds.
    pub bond: [f64; 4],
    /// What bonds withstand.
    pub strength: [f64; 4],
    /// Sliding and static friction.
    pub friction: [f64; 2],
    /// 1 if the spring is kept from step to step.
    pub remember: f64,
    /// 1 if the spring is shortened at slip.
    pub truncate: f64,
    /// 1 if the normal force cannot pull.
    pub clip: f64,
    /// Distance beyond touch up to which cohesion acts \[m\].
    pub range: f64,
    /// Distance beyond touch up to which bonds may act \[m\].
    pub bond_range: f64,
}

impl Laws {
    /// The laws that `model` names.
    pub fn resolve(model: &ContactModel) -> Result<Self, LawError> {
        Ok(Self {
            normal: NormalLaw::ALL[find(Slot::Normal, &model.normal)?],
            tangential: TangentialLaw::ALL[find(Slot::Tangential, &model.tangential)?],
            rolling: RollingLaw::ALL[find(Slot::Rolling, &model.rolling)?],
            cohesion: CohesionLaw::ALL[find(Slot::Cohesion, &model.cohesion)?],
            bond: BondLaw::ALL[find(Slot::Bond, &model.bond)?],
        })
    }

    /// What the law of a slot remembers per contact: for each float the sign that it takes when the two bodies change
    /// roles.
    fn remembers(self, slot: Slot) -> &'static [f64] {
        match slot {
            Slot::Normal => self.normal.history(),
            Slot::Tangential => self.tangential.history(),
            Slot::Rolling => self.rolling.history(),
            Slot::Cohesion => self.cohesion.history(),
            Slot::Bond => self.bond.history(),
        }
    }

    /// The coefficients of a pair of materials among bodies of radii up to `radius` \[m\].
    pub fn prepare(
        &self,
        model: &ContactModel,
        pair: &PairProperties,
        radius: f64,
    ) -> Result<PairCoefficients, LawError> {
        if !(0.0..=1.0).contains(&pair.restitution) {
            return Err(LawError::Range {
                law: self.normal.info().name,
                name: "restitution",
                value: pair.restitution,
                allowed: "from 0 to 1".to_owned(),
            });
        }
        fn of<'a>(
            model: &ContactModel,
            pair: &'a PairProperties,
            info: &'static LawInfo,
            given: &'a LawChoice,
        ) -> Preparation<'a> {
            Preparation { pair, end: model.end, info, given: &given.parameters }
        }
        let normal = self.normal.prepare(&of(model, pair, self.normal.info(), &model.normal))?;
        let tangential =
            self.tangential.prepare(&of(model, pair, self.tangential.info(), &model.tangential))?;
        let rolling = self.rolling.prepare(&of(model, pair, self.rolling.info(), &model.rolling))?;
        let cohesion = self.cohesion.prepare(&of(model, pair, self.cohesion.info(), &model.cohesion))?;
        let of_bond = of(model, pair, self.bond.info(), &model.bond);
        let (bond, strength) = (self.bond.prepare(&of_bond)?, self.bond.strength(&of_bond));
        Ok(PairCoefficients {
            laws: *self,
            normal,
            tangential,
            rolling,
            cohesion,
            bond,
            strength,
            friction: [pair.friction, pair.static_friction],
            remember: f64::from(u8::from(model.history != History::None)),
            truncate: f64::from(u8::from(model.history != History::Unbounded)),
            clip: f64::from(u8::from(model.end == ContactEnd::NoTension)),
            range: self.cohesion.range(&cohesion, radius),
            bond_range: bond_range(&bond, &strength, radius),
        })
    }
}

/// How far apart bonded particles of radii up to `radius` may come, and a little more, so that bonds are seen to break: a
/// bond that nothing but tension acts on breaks last.
fn bond_range(bond: &[f64; 4], strength: &[f64; 4], radius: f64) -> f64 {
    if bond[0] > 0.0 { bond[3] + 1.05 * strength[0] / bond[0] + 0.01 * radius } else { 0.0 }
}

/// Where the floats of each slot stand among those that a contact remembers. All contacts of a world have as many, also
/// those of materials whose laws remember less.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Layout {
    lengths: [usize; Self::ORDER.len()],
}

impl Layout {
    /// The tangential spring comes first: of most worlds it is all that is remembered.
    const ORDER: [Slot; 5] = [Slot::Tangential, Slot::Rolling, Slot::Normal, Slot::Cohesion, Slot::Bond];

    /// For contacts of any of these laws.
    pub fn of(laws: &[Laws]) -> Self {
        Self { lengths: Self::ORDER.map(|slot| longest(laws, slot).len()) }
    }

    /// The floats of a slot.
    pub fn place(&self, slot: Slot) -> Range<usize> {
        let rank = Self::ORDER.iter().position(|s| *s == slot).unwrap_or_default();
        let begin = self.lengths[..rank].iter().sum();
        begin..begin + self.lengths[rank]
    }

    /// How many there are.
    pub fn floats(&self) -> usize {
        self.lengths.iter().sum()
    }

    /// For each float the sign that it takes when the two bodies change roles.
    pub fn signs(laws: &[Laws]) -> Vec<f64> {
        Self::ORDER.map(|slot| longest(laws, slot)).concat()
    }
}

/// The longest history of a slot. What shorter ones remember has the same signs (`tests/laws.rs`).
fn longest(laws: &[Laws], slot: Slot) -> &'static [f64] {
    laws.iter().map(|l| l.remembers(slot)).max_by_key(|history| history.len()).unwrap_or_default()
}

/// The index of the chosen law in its slot, its parameters checked.
fn find(slot: Slot, choice: &LawChoice) -> Result<usize, LawError> {
    let known = laws(slot);
    let index = known.iter().position(|l| l.name == choice.law).ok_or_else(|| LawError::Unknown {
        slot: slot.name(),
        name: choice.law.clone(),
        known: known.iter().map(|l| l.name).collect::<Vec<_>>().join(", "),
    })?;
    let law = &known[index];
    for (name, value) in &choice.parameters {
        let p = law.parameters.iter().find(|p| p.name == name).ok_or_else(|| LawError::UnknownParameter {
            law: law.name,
            name: name.clone(),
            known: match law.parameters {
                [] => "none".to_owned(),
                all => all.iter().map(|p| p.name).collect::<Vec<_>>().join(", "),
            },
        })?;
        if !value.is_finite() || *value < p.min {
            let allowed =
                if p.min == f64::MIN_POSITIVE { "above 0".to_owned() } else { format!("{} or more", p.min) };
            return Err(LawError::Range { law: law.name, name: p.name, value: *value, allowed });
        }
    }
    match law.parameters.iter().find(|p| p.required && !choice.parameters.iter().any(|(n, _)| n == p.name)) {
        Some(p) => {
            Err(LawError::MissingParameter { law: law.name, name: p.name, unit: p.unit, summary: p.summary })
        }
        None => Ok(index),
    }
}
