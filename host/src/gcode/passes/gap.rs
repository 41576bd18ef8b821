//! Retract and prime between two beads, of all that is pulled and pushed there.
//!
//! In: pulls and pushes in order, mm³; `None` is the machine's own. Out: one retract, the deepest that it
//! comes to, and one prime, from there to where the next bead begins: a pair that is done twice is no pair of
//! double depth.

use crate::gcode::Push;

/// Since the last bead.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gap {
    /// Pulled now, more than at the last bead, and at most.
    out_mm3: f64,
    deepest_mm3: f64,
    has_pulled: bool,
    has_pushed: bool,
    /// Some of it is the machine's own, which is out now.
    is_own: bool,
    own_is_out: bool,
    /// Rates of the first.
    pull_mm3_s: Option<f64>,
    push_mm3_s: Option<f64>,
}

impl Gap {
    /// A pull; true where it comes after a prime.
    pub fn pull(&mut self, mm3: Option<f64>, rate_mm3_s: Option<f64>) -> bool {
        let is_again = self.has_pulled && self.has_pushed;
        if !self.has_pulled {
            self.pull_mm3_s = rate_mm3_s;
        }
        self.has_pulled = true;
        match mm3 {
            Some(mm3) => self.out_mm3 += mm3,
            None => (self.is_own, self.own_is_out) = (true, true),
        }
        self.deepest_mm3 = self.deepest_mm3.max(self.out_mm3);
        is_again
    }

    /// A push.
    pub fn push(&mut self, mm3: Option<f64>, rate_mm3_s: Option<f64>) {
        if !self.has_pushed {
            self.push_mm3_s = rate_mm3_s;
        }
        self.has_pushed = true;
        match mm3 {
            Some(mm3) => self.out_mm3 -= mm3,
            None => (self.is_own, self.own_is_out) = (true, false),
        }
    }

    /// What the bead before ends with.
    pub fn retract(&self) -> Option<Push> {
        let mm3 = (!self.is_own).then_some(self.deepest_mm3);
        self.has_pulled.then_some(Push {
            mm3,
            rate_mm3_s: self.pull_mm3_s,
        })
    }

    /// What the next bead begins with.
    pub fn prime(&self) -> Option<Push> {
        let mm3 = (!self.is_own).then_some((self.deepest_mm3 - self.out_mm3).max(0.0));
        let is_back = self.has_pushed && !self.own_is_out;
        is_back.then_some(Push {
            mm3,
            rate_mm3_s: self.push_mm3_s,
        })
    }
}

#[cfg(test)]
mod tests {
    //! Goal: depths and what is given back. Method: sequences as files have them.
    use super::*;

    fn of(steps: &[f64]) -> [Option<f64>; 2] {
        let mut gap = Gap::default();
        for mm3 in steps {
            match *mm3 < 0.0 {
                true => {
                    gap.pull(Some(-mm3), None);
                }
                false => gap.push(Some(*mm3), None),
            }
        }
        [gap.retract(), gap.prime()].map(|push| push.and_then(|push| push.mm3))
    }

    #[test]
    fn pairs_are_as_deep_as_one() {
        assert_eq!(of(&[-2.0, 2.0]), [Some(2.0), Some(2.0)]);
        assert_eq!(of(&[-2.0, 2.0, -2.0, 2.0]), [Some(2.0), Some(2.0)]);
        assert_eq!(of(&[-1.0, -1.5, 2.0]), [Some(2.5), Some(2.0)]);
        assert_eq!(of(&[-2.0, 2.5]), [Some(2.0), Some(2.5)]);
        assert_eq!(of(&[-2.0]), [Some(2.0), None]);
        let mut own = Gap::default();
        own.pull(None, None);
        own.push(None, None);
        assert!(own.pull(None, None));
        // It stays retracted.
        assert_eq!((own.retract(), own.prime()), (Some(Push::default()), None));
    }
}
