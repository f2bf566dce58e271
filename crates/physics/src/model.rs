//! Which laws a world uses, by name and with their parameters: what a scene's `[contact]` says.

/// The choice of laws of one world. Names are those of the registry ([`crate::laws`]).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ContactModel {
    /// Law of the normal force.
    pub normal: LawChoice,
    /// Law of the tangential force.
    pub tangential: LawChoice,
    /// Law of the rolling torque.
    pub rolling: LawChoice,
    /// Law of cohesion.
    pub cohesion: LawChoice,
    /// Law of bonds between particles.
    pub bond: LawChoice,
    /// What a contact does when the dashpot outweighs the spring.
    pub end: ContactEnd,
    /// What becomes of the tangential spring when a contact slips.
    pub history: History,
}

impl Default for ContactModel {
    fn default() -> Self {
        Self {
            normal: LawChoice::named("hertz"),
            tangential: LawChoice::named("mindlin"),
            rolling: LawChoice::named("none"),
            cohesion: LawChoice::named("none"),
            bond: LawChoice::named("none"),
            end: ContactEnd::default(),
            history: History::default(),
        }
    }
}

/// Laws that a pair of materials sets itself; slots left out have the world's.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PairLaws {
    /// Law of the normal force.
    pub normal: Option<LawChoice>,
    /// Law of the tangential force.
    pub tangential: Option<LawChoice>,
    /// Law of the rolling torque.
    pub rolling: Option<LawChoice>,
    /// Law of cohesion.
    pub cohesion: Option<LawChoice>,
    /// Law of bonds between particles.
    pub bond: Option<LawChoice>,
}

impl ContactModel {
    /// The choice of a pair of materials that sets some of the laws itself.
    pub fn of_pair(&self, own: &PairLaws) -> Self {
        let or = |own: &Option<LawChoice>, world: &LawChoice| own.as_ref().unwrap_or(world).clone();
        Self {
            normal: or(&own.normal, &self.normal),
            tangential: or(&own.tangential, &self.tangential),
            rolling: or(&own.rolling, &self.rolling),
            cohesion: or(&own.cohesion, &self.cohesion),
            bond: or(&own.bond, &self.bond),
            end: self.end,
            history: self.history,
        }
    }
}

/// A law and the parameters given to it; those left out take their defaults.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LawChoice {
    /// The law's registered name.
    pub law: String,
    /// Parameter values by name, in SI units.
    pub parameters: Vec<(String, f64)>,
}

impl LawChoice {
    /// A law with default parameters.
    pub fn named(law: &str) -> Self {
        Self { law: law.to_owned(), parameters: Vec::new() }
    }

    /// The same with a parameter set.
    #[must_use]
    pub fn with(mut self, name: &str, value: f64) -> Self {
        self.parameters.push((name.to_owned(), value));
        self
    }
}

/// What a contact does when the dashpot outweighs the spring.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ContactEnd {
    /// The contact ends at `δ ≤ 0`; the normal force may pull before (default). With it the measured
    /// restitution equals the prescribed one.
    #[default]
    Tension,
    /// The normal force is clipped at zero; β is inverted from a table so that restitution still holds.
    NoTension,
}

/// What becomes of the tangential spring.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum History {
    /// Shortened to the slip limit (default).
    #[default]
    Truncated,
    /// Never shortened, as GPUDEM does.
    Unbounded,
    /// Forgotten each step.
    None,
}

/// A law as users meet it: its name, source and parameters. Schema, `check`, docs and messages are made
/// from it.
#[derive(Clone, Copy, Debug)]
pub struct LawInfo {
    /// Name in a scene.
    pub name: &'static str,
    /// One line.
    pub summary: &'static str,
    /// Paper and equation.
    pub source: &'static str,
    /// Parameters beyond the materials' own values.
    pub parameters: &'static [ParameterInfo],
}

/// A parameter of a law.
#[derive(Clone, Copy, Debug)]
pub struct ParameterInfo {
    /// Name in a scene.
    pub name: &'static str,
    /// SI unit, empty if dimensionless.
    pub unit: &'static str,
    /// Whether it must be given.
    pub required: bool,
    /// Value when left out; `None` for a required parameter, and for one that then follows from the
    /// materials as its summary says.
    pub default: Option<f64>,
    /// Least allowed value.
    pub min: f64,
    /// A usual value for grains of some millimetres: an example in the schema, and what the conformance
    /// suites run with.
    pub typical: f64,
    /// One line.
    pub summary: &'static str,
}

/// Why a law cannot be prepared for a pair of materials.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LawError {
    /// No such law.
    #[error("there is no {slot} law named `{name}`; known are {known}")]
    Unknown {
        /// normal, tangential, rolling, cohesion or bond
        slot: &'static str,
        /// As written.
        name: String,
        /// Comma-separated names.
        known: String,
    },
    /// A parameter that the law does not have.
    #[error("the law `{law}` has no parameter `{name}`; it has {known}")]
    UnknownParameter {
        /// The law.
        law: &'static str,
        /// As written.
        name: String,
        /// Comma-separated names.
        known: String,
    },
    /// A parameter that must be given.
    #[error("the law `{law}` needs the parameter `{name}` [{unit}]: {summary}")]
    MissingParameter {
        /// The law.
        law: &'static str,
        /// The parameter.
        name: &'static str,
        /// Its unit.
        unit: &'static str,
        /// What it is.
        summary: &'static str,
    },
    /// A value out of range.
    #[error("`{name}` of the law `{law}` is {value}; allowed is {allowed}")]
    Range {
        /// The law.
        law: &'static str,
        /// The parameter or material value.
        name: &'static str,
        /// As given.
        value: f64,
        /// The range in words.
        allowed: String,
    },
}

/// The integration schemes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum IntegratorKind {
    /// Semi-implicit Euler: the new velocity moves the position (GPUDEM eq. 34-36). Default.
    #[default]
    Euler,
    /// Constant acceleration over the step (GPUDEM eq. 37); anti-damped.
    Exact,
    /// Adams-Bashforth 2 for velocities, trapezoid for positions (GPUDEM eq. 38-40).
    Adams,
    /// Velocity Verlet.
    VelocityVerlet,
}

/// Two bodies about to touch.
#[derive(Clone, Copy, Debug)]
pub struct Impact {
    /// Effective mass m* \[kg\].
    pub m_eff: f64,
    /// Effective radius R* \[m\].
    pub r_eff: f64,
    /// 4R* between spheres, 2R on a wall \[m\].
    pub diameter: f64,
}

/// What a law may take its coefficients from when it is prepared for a pair of materials.
#[derive(Clone, Copy, Debug)]
pub struct Preparation<'a> {
    /// The pair.
    pub pair: &'a crate::PairProperties,
    /// Contact end of the world.
    pub end: ContactEnd,
    /// The law as registered.
    pub info: &'static LawInfo,
    /// Parameters given.
    pub given: &'a [(String, f64)],
}

impl Preparation<'_> {
    /// The parameter `name` in SI units: as given, else its default, else `None`.
    pub fn parameter(&self, name: &str) -> Option<f64> {
        let given = self.given.iter().find(|(n, _)| n == name).map(|(_, v)| *v);
        given.or_else(|| self.info.parameters.iter().find(|p| p.name == name).and_then(|p| p.default))
    }

    /// A parameter that is required or has a default: [`crate::Laws::resolve`] has checked that it is there.
    pub fn value(&self, name: &str) -> f64 {
        self.parameter(name).unwrap_or(f64::NAN)
    }
}

/// The host's side of a law: what it is called and how its coefficients follow from the materials.
///
/// A law has four coefficients for each pair of materials; what each means is said in its file.
pub trait Law {
    /// Name, source, parameters.
    const INFO: LawInfo;
    /// What is remembered per contact, at most four floats but for bonds: for each the sign that it takes when the two bodies change
    /// roles.
    const HISTORY: &'static [f64] = &[];
    /// The coefficients for a pair.
    fn prepare(p: &Preparation<'_>) -> Result<[f64; 4], LawError>;
    /// What a bond withstands; other laws have none.
    fn strength(_p: &Preparation<'_>) -> [f64; 4] {
        [0.0; 4]
    }
    /// Whether stiffness follows from the materials, so that the Rayleigh time limits the step.
    const FROM_MATERIAL: bool = true;
    /// Duration of an elastic impact at `speed` \[m/s\]; infinite for laws that do not limit the step.
    fn collision_time(_coefficients: &[f64; 4], _impact: &Impact, _speed: f64) -> f64 {
        f64::INFINITY
    }
    /// Distance beyond touch up to which a law of cohesion acts between bodies of radii up to `radius` \[m\];
    /// laws of the other slots act in touch only.
    fn range(_coefficients: &[f64; 4], _radius: f64) -> f64 {
        0.0
    }
}

impl IntegratorKind {
    /// Every scheme.
    pub const ALL: [Self; 4] = [Self::Euler, Self::Exact, Self::Adams, Self::VelocityVerlet];

    /// Name in a scene.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Euler => "euler",
            Self::Exact => "exact",
            Self::Adams => "adams",
            Self::VelocityVerlet => "velocity-verlet",
        }
    }

    /// Whether velocities, as forces see them, belong to the instant half a step before the places.
    pub const fn lags(self) -> bool {
        matches!(self, Self::Euler | Self::VelocityVerlet)
    }
}
