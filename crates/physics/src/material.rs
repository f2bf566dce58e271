//! Materials, and how the values of a pair of materials follow from them.

use std::fmt;

/// The elastic, frictional and dissipative properties of one material. SI units.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Material {
    /// Name in the scene.
    pub name: String,
    /// Density of the solid \[kg/m³\], > 0. Unused for walls and tools.
    pub density: f64,
    /// Young's modulus E \[Pa\], > 0.
    pub youngs_modulus: f64,
    /// Poisson's ratio ν \[-\], in (-1, 0.5].
    pub poissons_ratio: f64,
    /// Coefficient of restitution e \[-\], in [0, 1].
    pub restitution: f64,
    /// Coefficient of sliding friction μ \[-\], ≥ 0.
    pub friction: f64,
    /// Coefficient of static friction μ0 \[-\], ≥ μ.
    pub static_friction: f64,
    /// Coefficient of rolling friction μr \[-\], ≥ 0.
    pub rolling_friction: f64,
}

impl Material {
    /// Shear modulus `G = E / (2 (1 + ν))` \[Pa\]: it follows from E and ν, so that a material cannot
    /// contradict itself.
    pub fn shear_modulus(&self) -> f64 {
        self.youngs_modulus / (2.0 * (1.0 + self.poissons_ratio))
    }
}

/// How a quantity of a pair follows from the values of its two materials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum MixingRule {
    /// The smaller value.
    Min,
    /// The larger value.
    Max,
    /// The arithmetic mean.
    #[default]
    Mean,
    /// The harmonic mean `2ab/(a+b)`.
    Harmonic,
    /// The geometric mean `√(ab)`.
    Geometric,
}

impl MixingRule {
    /// Every rule, in the order of the documentation.
    pub const ALL: [Self; 5] = [Self::Min, Self::Max, Self::Mean, Self::Harmonic, Self::Geometric];

    /// The rule's name in a scene.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Min => "min",
            Self::Max => "max",
            Self::Mean => "mean",
            Self::Harmonic => "harmonic",
            Self::Geometric => "geometric",
        }
    }

    /// The mixed value of `a` and `b`, both ≥ 0.
    pub fn mix(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Min => a.min(b),
            Self::Max => a.max(b),
            Self::Mean => 0.5 * (a + b),
            Self::Harmonic if a + b == 0.0 => 0.0,
            Self::Harmonic => 2.0 * a * b / (a + b),
            Self::Geometric => (a * b).sqrt(),
        }
    }
}

impl fmt::Display for MixingRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The rule of each quantity that a pair may leave to its materials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Mixing {
    /// For the coefficient of restitution.
    pub restitution: MixingRule,
    /// For sliding friction.
    pub friction: MixingRule,
    /// For static friction.
    pub static_friction: MixingRule,
    /// For rolling friction.
    pub rolling_friction: MixingRule,
}

/// Which expression gives the effective shear modulus G* of a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ShearModulusRule {
    /// Mindlin: `1/G* = 2(2-νᵢ)(1+νᵢ)/Eᵢ + 2(2-νⱼ)(1+νⱼ)/Eⱼ`.
    #[default]
    Mindlin,
    /// Eq. 2.4 of the GPUDEM thesis (2023), `G* = E*/(2+νᵢ+νⱼ)`: larger by a factor of 1.87-2.0.
    Gpudem,
}

/// Values that a pair sets itself instead of mixing them.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PairOverride {
    /// Coefficient of restitution e.
    pub restitution: Option<f64>,
    /// Sliding friction μ.
    pub friction: Option<f64>,
    /// Static friction μ0.
    pub static_friction: Option<f64>,
    /// Rolling friction μr.
    pub rolling_friction: Option<f64>,
    /// Strength of cohesion as a share of what the law says.
    pub cohesion: Option<f64>,
    /// Contact laws.
    pub laws: crate::PairLaws,
}

/// The properties of one pair of materials that contact laws take their coefficients from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairProperties {
    /// Effective Young's modulus E* \[Pa\]: `1/E* = (1-νᵢ²)/Eᵢ + (1-νⱼ²)/Eⱼ`.
    pub e_star: f64,
    /// Effective shear modulus G* \[Pa\], see [`ShearModulusRule`].
    pub g_star: f64,
    /// Coefficient of restitution e \[-\].
    pub restitution: f64,
    /// Sliding friction μ \[-\].
    pub friction: f64,
    /// Static friction μ0 \[-\], ≥ μ.
    pub static_friction: f64,
    /// Rolling friction μr \[-\].
    pub rolling_friction: f64,
    /// Young's modulus E \[Pa\], the harmonic mean: what laws take that have no E*.
    pub youngs_modulus: f64,
    /// Poisson's ratio ν \[-\], the mean.
    pub poissons_ratio: f64,
    /// Strength of cohesion as a share of what the law says \[-\]; 1 where the pair says nothing.
    pub cohesion: f64,
}

impl PairProperties {
    /// The properties of the pair (`a`, `b`): what `over` names, the rest mixed.
    ///
    /// Static friction is never below sliding friction: where only μ is overridden and exceeds the
    /// mixed μ0, μ0 is raised to it.
    pub fn new(
        a: &Material,
        b: &Material,
        mixing: &Mixing,
        shear: ShearModulusRule,
        over: &PairOverride,
    ) -> Self {
        let (ea, eb) = (a.youngs_modulus, b.youngs_modulus);
        let (na, nb) = (a.poissons_ratio, b.poissons_ratio);
        let e_star = 1.0 / ((1.0 - na * na) / ea + (1.0 - nb * nb) / eb);
        let g_star = match shear {
            ShearModulusRule::Mindlin => {
                1.0 / (2.0 * (2.0 - na) * (1.0 + na) / ea + 2.0 * (2.0 - nb) * (1.0 + nb) / eb)
            }
            ShearModulusRule::Gpudem => e_star / (2.0 + na + nb),
        };
        let friction = over.friction.unwrap_or_else(|| mixing.friction.mix(a.friction, b.friction));
        Self {
            e_star,
            g_star,
            restitution: over
                .restitution
                .unwrap_or_else(|| mixing.restitution.mix(a.restitution, b.restitution)),
            friction,
            static_friction: over
                .static_friction
                .unwrap_or_else(|| mixing.static_friction.mix(a.static_friction, b.static_friction))
                .max(friction),
            rolling_friction: over
                .rolling_friction
                .unwrap_or_else(|| mixing.rolling_friction.mix(a.rolling_friction, b.rolling_friction)),
            youngs_modulus: MixingRule::Harmonic.mix(ea, eb),
            poissons_ratio: MixingRule::Mean.mix(na, nb),
            cohesion: over.cohesion.unwrap_or(1.0),
        }
    }
}

/// Damping ratio of a linear oscillator from the restitution `e` in (0, 1]:
/// `β = -ln e / √(ln²e + π²)`, in [0, 1); 1 for `e = 0`.
pub fn damping_ratio(e: f64) -> f64 {
    if e <= 0.0 {
        return 1.0;
    }
    let l = e.ln();
    (-l / (l * l + std::f64::consts::PI.powi(2)).sqrt()).max(0.0)
}
