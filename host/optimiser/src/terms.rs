//! The minimised sum, by its terms.
//!
//! In and out: numbers in the optimiser's units (times in mean spans, areas in a²).

/// Parts of the objective at one place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Terms {
    /// Printing time.
    pub time: f64,
    /// Area left open, a²; not a part of the sum by itself.
    pub open: f64,
    /// Area laid twice, a²; not a part of the sum by itself.
    pub twice: f64,
    /// Cost of area left open and laid twice, smoothed.
    pub ground: f64,
    /// What motion beyond the limits costs.
    pub excess: f64,
    /// What leaving the walls costs.
    pub outside: f64,
    /// Regularising terms.
    pub smooth: f64,
}

impl Terms {
    /// The objective.
    pub fn sum(&self) -> f64 {
        self.time + self.ground + self.excess + self.outside + self.smooth
    }

    /// The same with more printing time.
    pub fn later(self, time: f64) -> Terms {
        Terms {
            time: self.time + time,
            ..self
        }
    }
}
