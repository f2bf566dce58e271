//! The furrow that a tool leaves: the height of the surface across its path.

use crate::axis::Axis;
use crate::plot::{Plot, Series, Style};

/// From where the surface is looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FurrowView {
    /// Axis of the tool's path, 0-2.
    pub along: usize,
    /// Axis across the path, 0-2.
    pub across: usize,
    /// Axis upwards, 0-2.
    pub up: usize,
    /// Particles count whose centre is in this range along the path \[m\].
    pub section: [f64; 2],
    /// The profile's range across the path \[m\].
    pub range: [f64; 2],
    /// Number of bins in it.
    pub bins: usize,
}

/// Height of a surface across a path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Profile {
    /// Middles of the bins \[m\], rising.
    pub across: Vec<f64>,
    /// Highest point of any particle in the bin \[m\]; not a number where there is none.
    pub height: Vec<f64>,
}

/// The surface of particles with these centres and radii \[m\]: in each bin the highest point of any sphere,
/// seen along the path, so that bins may be narrower than particles.
///
/// Columns of unequal length are read as far as both go; axes beyond 2, an empty range or no bins give an
/// empty profile.
pub fn furrow_profile(position: &[[f64; 3]], radius: &[f64], view: &FurrowView) -> Profile {
    let [first, last] = view.range;
    if [view.along, view.across, view.up].iter().any(|&axis| axis > 2)
        || first >= last
        || !(last - first).is_finite()
        || view.bins == 0
    {
        return Profile::default();
    }
    let width = (last - first) / view.bins as f64;
    let edge = |k: usize| first + k as f64 * width;
    let mut height = vec![f64::NAN; view.bins];
    for (x, &r) in position.iter().zip(radius) {
        if !(view.section[0]..=view.section[1]).contains(&x[view.along]) {
            continue;
        }
        let (middle, centre) = (x[view.across], x[view.up]);
        // Casts saturate: a sphere outside the range meets no bin.
        let from = ((middle - r - first) / width).floor() as usize;
        let to = ((middle + r - first) / width).ceil().max(0.0) as usize;
        for (k, top) in height.iter_mut().enumerate().take(to.min(view.bins)).skip(from) {
            let aside = (edge(k) - middle).max(middle - edge(k + 1)).max(0.0);
            if aside < r {
                *top = top.max(centre + (r * r - aside * aside).sqrt());
            }
        }
    }
    Profile { across: (0..view.bins).map(|k| edge(k) + 0.5 * width).collect(), height }
}

impl Profile {
    /// Mean height \[m\] of the bins that hold particles: of an undisturbed surface, its level. None
    /// without any.
    pub fn level(&self) -> Option<f64> {
        let heights = || self.height.iter().filter(|h| h.is_finite());
        let count = heights().count();
        (count > 0).then(|| heights().sum::<f64>() / count as f64)
    }

    /// The profile as an SVG file, with the level \[m\] that the surface had before.
    pub fn plot(&self, undisturbed: Option<f64>) -> String {
        let ends = [self.across.first(), self.across.last()].map(|x| x.copied().unwrap_or(0.0));
        let level = undisturbed.map(|level| [level; 2]);
        let before =
            level.as_ref().map(|y| Series { name: "undisturbed level", x: &ends, y, style: Style::Dashed });
        let after =
            Series { name: "surface after the tool", x: &self.across, y: &self.height, style: Style::Line };
        Plot {
            title: "Furrow profile",
            x: Axis::new("across the path", "m"),
            y: Axis::new("height", "m"),
            series: std::iter::once(after).chain(before).collect(),
            equal_units: true,
            ..Plot::default()
        }
        .to_svg()
    }
}
