//! Units of the streams that are planned with these settings.
//!
//! In: nozzle, tolerance, layer, machine. Out: the powers of two by which a stream is coarser than the wire's base
//! units, which are those of the built-in nozzle. A nozzle that is larger lays more than base units hold in a span, and
//! needs no tenths of a micrometre. Smaller nozzles keep base units.

use super::Settings;
use super::defaults::{LAYER_HEIGHT_MM, TOLERANCES};
use headway_protocol::control::EVENT_VOLUME_UNITS_MAX;
use headway_protocol::units::{
    CHANNEL_VOLUME, CHANNEL_X, UNIT_EXPONENT_MAX, UNITS_PER_NATURAL, Units,
};

impl Settings {
    /// Units of a stream planned with these settings: a unit goes with the nozzle, but not beyond what the tolerances
    /// are to it with the built-in one, nor beyond a motor's step.
    pub fn units(&self) -> Units {
        let unit = self.aperture.unit_mm();
        let tolerance = self.tolerances.tip_mm / TOLERANCES.tip_mm;
        let bead = unit * (self.layer_height_mm / LAYER_HEIGHT_MM);
        let machine = &self.machine;
        let linear = machine.joints.iter().filter(|joint| !joint.rotary);
        let finest = linear.map(|joint| joint.steps_per_unit).fold(0.0, f64::max);
        let steps = UNITS_PER_NATURAL[CHANNEL_X] / finest;
        let melt_steps = UNITS_PER_NATURAL[CHANNEL_VOLUME] / machine.extruder.steps_per_mm3;
        let volume = (unit * unit * unit).min(tolerance * bead);
        Units {
            length_exponent: exponent(unit.min(tolerance).min(steps)),
            angle_exponent: 0,
            volume_exponent: exponent(volume.min(melt_steps)),
        }
    }

    /// Most volume of a span, mm³: the wire carries differences over two spans in 32 bits.
    pub fn span_volume_mm3(&self) -> f64 {
        span_volume_mm3(&self.units())
    }

    /// Most that a prime or a retract moves, mm³.
    pub fn push_max_mm3(&self) -> f64 {
        f64::from(EVENT_VOLUME_UNITS_MAX) / self.units().per_natural(CHANNEL_VOLUME)
    }
}

/// The same in these units.
pub(crate) fn span_volume_mm3(units: &Units) -> f64 {
    0.9 * f64::from(1 << 30) / units.per_natural(CHANNEL_VOLUME)
}

/// The largest power of two up to this many base units; 0 for none, or no number.
fn exponent(units: f64) -> u8 {
    let fits = |exponent: &u8| f64::from(1u32 << exponent) <= units;
    (1..=UNIT_EXPONENT_MAX).take_while(fits).last().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    //! Goal: units go with the nozzle, and are base units where something else is finer. Method: the built-in nozzle,
    //! larger by known factors.
    use super::*;
    use crate::geometry::aperture::Aperture;

    fn larger(factor: f64) -> Settings {
        let aperture = Aperture::Ellipse {
            major_mm: 0.6 * factor,
            minor_mm: 0.2 * factor,
        };
        let mut settings = Settings {
            aperture,
            ..Settings::default()
        };
        settings.layer_height_mm *= factor;
        settings.tolerances.tip_mm *= factor;
        for joint in settings
            .machine
            .joints
            .iter_mut()
            .filter(|joint| !joint.rotary)
        {
            joint.steps_per_unit /= factor;
        }
        settings.machine.extruder.steps_per_mm3 /= factor.powi(3);
        settings
    }

    fn exponents(settings: &Settings) -> [u8; 3] {
        let units = settings.units();
        [
            units.length_exponent,
            units.angle_exponent,
            units.volume_exponent,
        ]
    }

    #[test]
    fn units_go_with_the_nozzle() {
        assert_eq!(Settings::default().units(), Units::BASE);
        for (factor, expected) in [
            (0.5, [0, 0, 0]),
            (1.0, [0, 0, 0]),
            (4.0, [2, 0, 6]),
            (10.0, [3, 0, 9]),
            (100.0, [6, 0, 19]),
        ] {
            assert_eq!(exponents(&larger(factor)), expected, "{factor}");
        }
    }

    #[test]
    fn units_are_no_coarser_than_tolerances_and_steps() {
        let fine = |change: fn(&mut Settings)| {
            let mut settings = larger(100.0);
            change(&mut settings);
            exponents(&settings)
        };
        // A hundredth of the tolerance; 10 steps a mm³ are a step in 10⁵ base units, 80 a mm one in 125.
        assert_eq!(fine(|s| s.tolerances.tip_mm /= 100.0), [0, 0, 13]);
        assert_eq!(
            fine(|s| s.machine.extruder.steps_per_mm3 = 10.0),
            [6, 0, 16]
        );
        assert_eq!(
            fine(|s| s.machine.joints[2].steps_per_unit = 400.0),
            [4, 0, 19]
        );
    }

    /// Goal: what no message carries is refused where it is set, in the stream's unit. Method: primes on either side of
    /// the bound, by the built-in nozzle and by one four times as wide; before, 1,000 to 2,147 mm³ were let pass here
    /// and refused by the board.
    #[test]
    fn primes_beyond_a_message_are_refused_at_the_door() {
        for (factor, prime_mm3, is_taken) in [
            (1.0, 999.0, true),
            (1.0, 1001.0, false),
            (4.0, 63_900.0, true),
            (4.0, 64_100.0, false),
        ] {
            let mut settings = larger(factor);
            let extruder = &mut settings.machine.extruder;
            extruder.speed_max_mm3_s = prime_mm3;
            extruder.acceleration_max_mm3_s2 = extruder.speed_max_mm3_s;
            settings.prime_retract.prime_rate_mm3_s = 0.1 * prime_mm3;
            settings.prime_retract.prime_mm3 = prime_mm3;
            let checked = settings.check().map_err(|error| error.to_string());
            match is_taken {
                true => assert_eq!(checked, Ok(())),
                false => assert!(checked.unwrap_err().contains("flow.prime_mm3")),
            }
        }
    }
}
