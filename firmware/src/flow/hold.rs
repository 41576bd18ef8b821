//! Retract and prime while the head rests in the middle of a pass.
//!
//! After a dwell the volume with which the pass was primed is retracted, and primed again before
//! the head continues. Both volumes are the same integer, so no volume is lost or gained.

use headway_protocol::segment::{FlowAction, FlowEvent};

/// State of the melt during a hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Melt {
    /// Where the stream has it.
    AsPlanned,
    /// Retracted by the hold.
    Retracted,
    /// Being pushed again.
    Priming,
}

/// Watches for holds.
#[derive(Clone, Debug)]
pub struct Hold {
    delay_ticks: u32,
    rested_ticks: u32,
    /// The stream's newest prime, while it lasts.
    primed: Option<FlowEvent>,
    melt: Melt,
}

impl Hold {
    /// Retracts after `delay_ticks` of rest.
    pub fn new(delay_ticks: u32) -> Self {
        Self {
            delay_ticks,
            rested_ticks: 0,
            primed: None,
            melt: Melt::AsPlanned,
        }
    }

    /// A flow event of the stream has begun.
    pub fn note(&mut self, event: &FlowEvent) {
        self.primed = match event.action {
            FlowAction::Prime => Some(*event),
            FlowAction::Retract => None,
        };
    }

    /// The head moves.
    pub fn moving(&mut self) {
        self.rested_ticks = 0;
    }

    /// One servo tick at rest on the path. Gives the retract that is due now, if one is.
    pub fn rested(&mut self, flow_active: bool) -> Option<FlowEvent> {
        self.rested_ticks = self.rested_ticks.saturating_add(1);
        let due = self.rested_ticks >= self.delay_ticks && !flow_active;
        if !due || self.melt != Melt::AsPlanned {
            return None;
        }
        let primed = self.primed?;
        self.melt = Melt::Retracted;
        Some(FlowEvent {
            action: FlowAction::Retract,
            ..primed
        })
    }

    /// The stream is abandoned while the head rests: returns the retract, once.
    pub fn leave(&mut self, flow_active: bool) -> Option<FlowEvent> {
        if flow_active || self.melt != Melt::AsPlanned {
            return None;
        }
        let primed = self.primed.take()?;
        self.melt = Melt::Retracted;
        Some(FlowEvent {
            action: FlowAction::Retract,
            ..primed
        })
    }

    /// The path permits the head to continue: true if the melt is ready too. Gives the prime that
    /// is due now, if one is.
    pub fn ready(&mut self, flow_active: bool) -> (bool, Option<FlowEvent>) {
        match self.melt {
            Melt::AsPlanned => (true, None),
            Melt::Retracted if flow_active => (false, None),
            Melt::Retracted => {
                self.melt = Melt::Priming;
                (false, self.primed)
            }
            Melt::Priming if flow_active => (false, None),
            Melt::Priming => {
                self.melt = Melt::AsPlanned;
                (true, None)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use headway_protocol::units::Ticks;

    const PRIME: FlowEvent = FlowEvent {
        span: 3,
        offset_ticks: 0,
        action: FlowAction::Prime,
        volume_units: 700,
        duration_ticks: Ticks(50),
    };

    #[test]
    fn a_long_rest_retracts_once_and_primes_before_going_on() {
        let mut hold = Hold::new(3);
        hold.note(&PRIME);
        assert_eq!(hold.rested(false), None);
        assert_eq!(hold.rested(false), None);
        let retract = hold.rested(false).unwrap();
        assert_eq!(retract.action, FlowAction::Retract);
        assert_eq!(retract.volume_units, PRIME.volume_units);
        assert_eq!(hold.rested(false), None);
        assert_eq!(hold.ready(true), (false, None));
        assert_eq!(hold.ready(false), (false, Some(PRIME)));
        assert_eq!(hold.ready(true), (false, None));
        assert_eq!(hold.ready(false), (true, None));
        assert_eq!(hold.ready(false), (true, None));
    }

    #[test]
    fn a_short_rest_or_one_off_the_passes_leaves_the_melt_alone() {
        let mut hold = Hold::new(3);
        hold.note(&PRIME);
        assert_eq!(hold.rested(false), None);
        assert_eq!(hold.ready(false), (true, None));
        hold.moving();
        hold.note(&FlowEvent {
            action: FlowAction::Retract,
            ..PRIME
        });
        for _ in 0..10 {
            assert_eq!(hold.rested(false), None);
        }
        assert_eq!(hold.ready(false), (true, None));
    }
}
