//! Size classes: what one search grid takes together. With one grid for all sizes the cells are as wide as the largest
//! particle needs, and the small ones fill them by the thousand; with a grid for each class a cell holds a few.

/// Largest over smallest radius up to which particles share a grid.
const ALIKE: f64 = 3.0;
/// Most classes. Beyond, the last one takes all that is smaller.
pub const MOST: usize = 8;

/// The classes of a world: class 0 holds the largest radii, and each further one begins at half the radius of the one
/// before. The last goes down to the smallest, at most a ratio of 3 below where it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Classes {
    largest: f64,
    count: usize,
}

impl Classes {
    /// As few as radii from `smallest` to `largest` \[m\] need: one up to a ratio of 3.
    pub fn of(smallest: f64, largest: f64) -> Self {
        let mut classes = Self { largest, count: 1 };
        while classes.count < MOST && classes.radius(classes.count - 1) > ALIKE * smallest {
            classes.count += 1;
        }
        classes
    }

    /// How many there are, 1 to [`MOST`].
    pub fn count(self) -> usize {
        self.count
    }

    /// The largest radius of a class \[m\].
    pub fn radius(self, class: usize) -> f64 {
        // Halving is exact, on every device.
        (0..class).fold(self.largest, |radius, _| 0.5 * radius)
    }

    /// The class of a radius \[m\]: the last whose largest radius it does not exceed.
    pub fn class(self, radius: f64) -> usize {
        (1..self.count).take_while(|&class| radius <= self.radius(class)).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_as_few_as_the_grading_needs() {
        let counts = [1.0, 2.0, 3.0, 3.1, 6.0, 6.1, 10.0, 12.0, 20.0, 24.0, 100.0]
            .map(|ratio| Classes::of(1.0, ratio).count());
        assert_eq!(counts, [1, 1, 1, 2, 2, 3, 3, 3, 4, 4, 7]);
        assert_eq!(Classes::of(1e-9, 1.0).count(), MOST);
        assert_eq!(Classes::of(0.0, 1.0).count(), MOST);
    }

    #[test]
    fn a_radius_is_in_the_last_class_that_it_fits_into() {
        let classes = Classes::of(0.001, 0.02);
        let found =
            [0.02, 0.0101, 0.01, 0.0051, 0.005, 0.0026, 0.0025, 0.001].map(|radius| classes.class(radius));
        assert_eq!(found, [0, 0, 1, 1, 2, 2, 3, 3]);
        for radius in [0.02, 0.013, 0.007, 0.003, 0.001] {
            let class = classes.class(radius);
            assert!(radius <= classes.radius(class));
            let least = if class + 1 < classes.count() {
                classes.radius(class) / 2.0
            } else {
                classes.radius(class) / ALIKE
            };
            assert!(radius >= least, "{radius} in class {class}");
        }
    }

    #[test]
    fn particles_alike_are_of_one_class() {
        let classes = Classes::of(1.0, 3.0);
        assert_eq!([1.0, 1.5, 3.0].map(|radius| classes.class(radius)), [0, 0, 0]);
    }
}
