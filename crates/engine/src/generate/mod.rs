//! Particles made, not read: radii from a distribution, and where they lie at the start.
//!
//! All in f64 and by arithmetic that is the same everywhere: one seed gives the same bits on every
//! platform. Nothing is read or written.
//!
//! A new fill is **one file and one row**: a file beside this one with a `pub(super) const INFO:
//! FillInfo`, its module below, and its row in `FILLS`. Scenes, `check`, the schema and the test
//! suite follow from the row.

mod dense;
mod grid;
mod lattice;
mod rain;
mod random;
mod region;
mod relax;
mod rng;
mod sizes;

pub use region::{Region, solid_fraction, solid_volume, worst_overlap};
pub use rng::{Purpose, Rng};
pub use sizes::SizeDistribution;

use crate::spec::Vec3;

/// Every fill there is.
const FILLS: &[FillInfo] = &[lattice::INFO, random::INFO, dense::INFO, rain::INFO];

/// All registered fills, in the order in which they are documented.
pub fn fills() -> &'static [FillInfo] {
    FILLS
}

/// A way to place spheres.
pub struct FillInfo {
    /// Its name in scenes.
    pub name: &'static str,
    /// What it does, in a line.
    pub summary: &'static str,
    /// Largest solid fraction it may be asked for \[-\].
    pub fraction_max: f64,
    /// Solid fraction if none is asked for \[-\]; if absent, what the region and the spheres give.
    pub fraction_default: Option<f64>,
    /// Centres for a checked request whose `solid_fraction` is the one to be used.
    place: fn(&FillRequest) -> Result<Vec<Vec3>, GenerateError>,
}

/// Spheres to be placed.
#[derive(Clone, Copy, Debug)]
pub struct FillRequest<'a> {
    /// Where. Spheres stay inside its walls; along periodic axes centres do, and nearest images count.
    pub region: Region,
    /// The axis along which spheres are piled, 0-2, from the floor at `region.min` up: opposite to
    /// gravity.
    pub up: usize,
    /// Radii \[m\], one per sphere, > 0.
    pub radii: &'a [f64],
    /// Seed of all that is random.
    pub seed: u64,
    /// Share of the filled part's volume that spheres take \[-\], in (0, `fraction_max`]. The filled part
    /// has the region's footprint and the height that this needs (at least the largest sphere's
    /// diameter); along a periodic `up` it is the region, and this must agree with it.
    pub solid_fraction: Option<f64>,
}

impl<'a> FillRequest<'a> {
    /// Spheres piled along z at the fill's own solid fraction.
    pub fn new(region: Region, radii: &'a [f64], seed: u64) -> Self {
        Self { region, up: 2, radii, seed, solid_fraction: None }
    }
}

/// Why particles could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// No fill of this name.
    #[error("no fill is called `{name}`; choose one of: {allowed}")]
    UnknownFill {
        /// As asked for.
        name: String,
        /// What there is.
        allowed: String,
    },
    /// A value outside its range.
    #[error("{what} is {value}: it must be {allowed}")]
    Invalid {
        /// Which value.
        what: String,
        /// The value.
        value: f64,
        /// Its range and unit.
        allowed: String,
    },
    /// Size limits that the distribution practically never meets.
    #[error(
        "none of {draws} radii drawn lay between min = {min} m and max = {max} m; widen the limits or move \
         the distribution between them"
    )]
    LimitsNeverMet {
        /// Smallest radius \[m\].
        min: f64,
        /// Largest radius \[m\].
        max: f64,
        /// Values drawn for one particle.
        draws: usize,
    },
    /// The region is too small for the spheres at the solid fraction.
    #[error(
        "{count} spheres need {needed:.3e} m³ at a solid fraction of {fraction:.3}, {share:.0} % of the region's \
         {volume:.3e} m³; enlarge the region, take fewer or smaller spheres{denser}"
    )]
    DoesNotFit {
        /// How many spheres.
        count: usize,
        /// Volume that they need \[m³\].
        needed: f64,
        /// Solid fraction \[-\].
        fraction: f64,
        /// Needed volume, in percent of the region's.
        share: f64,
        /// The region's volume \[m³\].
        volume: f64,
        /// What else helps.
        denser: String,
    },
    /// A fill reached its limit before the last sphere.
    #[error(
        "`{fill}` found no room for more than {placed} of {count} spheres: solid fraction {reached:.3} of \
         {asked:.3}; {advice}"
    )]
    NoRoom {
        /// The fill.
        fill: &'static str,
        /// Spheres placed.
        placed: usize,
        /// Spheres asked for.
        count: usize,
        /// Solid fraction reached \[-\].
        reached: f64,
        /// Solid fraction needed \[-\].
        asked: f64,
        /// What to do.
        advice: String,
    },
    /// Spheres could not be pushed apart.
    #[error(
        "`{fill}` could not push {count} spheres apart at a solid fraction of {asked:.3}: overlaps of \
         {overlap:.2} % of the smaller radius remain; ask for a lower solid fraction, or for a region more \
         spheres wide, whose walls disturb the packing less"
    )]
    Jammed {
        /// The fill.
        fill: &'static str,
        /// Spheres asked for.
        count: usize,
        /// Solid fraction needed \[-\].
        asked: f64,
        /// Deepest overlap, in percent of the smaller radius.
        overlap: f64,
    },
}

impl GenerateError {
    fn invalid(what: &str, value: f64, allowed: impl Into<String>) -> Self {
        Self::Invalid { what: what.to_owned(), value, allowed: allowed.into() }
    }
}

/// Centres \[m\] of the request's spheres, in the order of its radii, placed by the fill called `name`.
///
/// # Errors
/// An unknown name, a value outside its range, spheres that do not fit the region, or a solid fraction
/// that the fill does not reach.
pub fn generate(name: &str, request: &FillRequest) -> Result<Vec<Vec3>, GenerateError> {
    let fill = FILLS.iter().find(|fill| fill.name == name).ok_or_else(|| GenerateError::UnknownFill {
        name: name.to_owned(),
        allowed: FILLS.iter().map(|fill| fill.name).collect::<Vec<_>>().join(", "),
    })?;
    request.check()?;
    if request.radii.is_empty() {
        return Ok(Vec::new());
    }
    let solid_fraction = fill.fraction(request)?;
    (fill.place)(&FillRequest { solid_fraction, ..*request })
}

impl FillInfo {
    /// The solid fraction to be used: asked for or the default, within what the fill and the region allow.
    fn fraction(&self, request: &FillRequest) -> Result<Option<f64>, GenerateError> {
        let whole = solid_fraction(request.radii, &request.region);
        let most = self.fraction_max;
        if let Some(asked) = request.solid_fraction {
            if !(asked > 0.0 && asked <= most) {
                let allowed = format!("above 0 and at most {most:.2} for the fill `{}` [-]", self.name);
                return Err(GenerateError::invalid("solid_fraction", asked, allowed));
            }
            if request.region.periodic[request.up] && (asked / whole - 1.0).abs() > 0.01 {
                let allowed = format!(
                    "{whole:.4}, or left out: the region is periodic along `up`, so its volume and the spheres \
                     set the solid fraction; change the region's height or the number of spheres"
                );
                return Err(GenerateError::invalid("solid_fraction", asked, allowed));
            }
        }
        let whole_region = request.region.periodic[request.up];
        let fraction = request.solid_fraction.or(self.fraction_default).filter(|_| !whole_region);
        // Rounding must not refuse a region made to measure.
        let limit = fraction.unwrap_or(most) * (1.0 + 1e-9);
        if whole > limit {
            let fraction = fraction.unwrap_or(most);
            let volume = request.region.volume();
            let needed = solid_volume(request.radii) / fraction;
            let denser = if fraction < most {
                format!(", or ask for a solid fraction of up to {most:.2}")
            } else {
                String::new()
            };
            let (count, share) = (request.radii.len(), 100.0 * needed / volume);
            return Err(GenerateError::DoesNotFit { count, needed, fraction, share, volume, denser });
        }
        Ok(fraction)
    }
}

impl FillRequest<'_> {
    /// The part of the region that is filled: from the floor to the height that `solid_fraction` needs,
    /// or all of it.
    fn filled(&self) -> Region {
        let mut filled = self.region;
        if let Some(fraction) = self.solid_fraction {
            let share = solid_fraction(self.radii, &self.region) / fraction;
            let height = (share * self.region.width(self.up)).max(2.0 * self.largest());
            filled.max[self.up] = (self.region.min[self.up] + height).min(self.region.max[self.up]);
        }
        filled
    }

    fn largest(&self) -> f64 {
        self.radii.iter().copied().fold(0.0, f64::max)
    }

    fn check(&self) -> Result<(), GenerateError> {
        if self.up > 2 {
            return Err(GenerateError::invalid("up", self.up as f64, "an axis, 0, 1 or 2"));
        }
        if let Some((i, &r)) = self.radii.iter().enumerate().find(|(_, r)| !(r.is_finite() && **r > 0.0)) {
            let what = format!("radius of particle {i}");
            return Err(GenerateError::Invalid { what, value: r, allowed: "finite and above 0 [m]".into() });
        }
        for k in 0..3 {
            let Region { min, max, periodic } = self.region;
            let axis = ["x", "y", "z"][k];
            if !min[k].is_finite() {
                return Err(GenerateError::invalid(
                    &format!("region.min along {axis}"),
                    min[k],
                    "finite [m]",
                ));
            }
            if !(max[k].is_finite() && max[k] > min[k]) {
                let allowed = format!("finite and above min = {} [m]", min[k]);
                return Err(GenerateError::invalid(&format!("region.max along {axis}"), max[k], allowed));
            }
            // Of a periodic axis: a sphere must not meet two images of another.
            let (diameters, reason) = if periodic[k] {
                (2.0, "two diameters (the axis is periodic)")
            } else {
                (1.0, "the diameter")
            };
            let least = 2.0 * self.largest() * diameters;
            if self.region.width(k) < least * (1.0 - 1e-9) {
                let allowed =
                    format!("at least {reason} of the largest sphere, {least} m; enlarge the region");
                let what = format!("the region's width along {axis}");
                return Err(GenerateError::Invalid { what, value: self.region.width(k), allowed });
            }
        }
        Ok(())
    }
}
