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
            end: ContactEnd::default(),
            history: History::default(),
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
    /// Value when left out; `None` if it must be given.
    pub default: Option<f64>,
    /// Least allowed value.
    pub min: f64,
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
        /// normal, tangential, rolling or cohesion
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
