//! Primes and retracts: firmware retraction, M227 and M228, or the extruder's axis.
//!
//! In: volumes (mm³) and durations (ticks) of the stream's events. Out: lines of the dialect.

use super::dialect::{Dialect, Retraction};
use super::limits::{AXES, EXTRUDER};
use super::{WriteError, Writer, short};
use std::io::Write;

impl<W: Write> Writer<'_, W> {
    /// The extruder alone.
    fn push(&mut self, by_mm: f64, seconds: f64) -> Result<(), WriteError> {
        let word = self.extrusion(self.e_mm + by_mm);
        if word.is_empty() {
            return Ok(());
        }
        self.time_push(by_mm, seconds);
        let feed = match self.options.dialect.is_machine_tool() {
            true => 60.0 / seconds.max(1e-3),
            false => 60.0 * by_mm.abs() / seconds.max(1e-3),
        };
        self.feed = format!(" F{}", short(feed, 2));
        writeln!(self.out, "G1{word}{}", self.feed)?;
        Ok(())
    }

    /// A push of the extruder alone, for the controller's time and checks.
    fn time_push(&mut self, by_mm: f64, seconds: f64) {
        let mut by = [0.0; AXES];
        by[EXTRUDER] = by_mm;
        self.time.add(by, 0.0, seconds.max(1e-3));
        let area_mm2 = self.filament_mm2();
        let heading = self.at.turn_deg[2];
        self.written.demands.add(&by, 0.0, area_mm2, heading);
    }

    /// `primed` where the job primes again: what a controller retracts by itself and does not give back, it holds
    /// for retracted at the next print, and does not retract then.
    pub(super) fn retract(
        &mut self,
        volume_mm3: f64,
        ticks: f64,
        primed: bool,
    ) -> Result<(), WriteError> {
        let (length_mm, seconds) = (volume_mm3 / self.filament_mm2(), ticks / self.servo_hz);
        match self.style() {
            Retraction::Source => {
                self.time_push(-length_mm, seconds);
                writeln!(self.out, "M228")?;
            }
            Retraction::Firmware if primed => {
                self.retracted_mm = Some(length_mm);
                self.time_push(-length_mm, seconds);
                let speed_mm_s = length_mm / seconds.max(1e-3);
                self.set_retraction(length_mm, speed_mm_s, 0.0)?;
                writeln!(self.out, "G10")?;
            }
            Retraction::Firmware | Retraction::Extruder => self.push(-length_mm, seconds)?,
        }
        Ok(())
    }

    pub(super) fn prime(&mut self, volume_mm3: f64, ticks: f64) -> Result<(), WriteError> {
        let (length_mm, seconds) = (volume_mm3 / self.filament_mm2(), ticks / self.servo_hz);
        let retracted_mm = self.retracted_mm.take();
        match (self.style(), retracted_mm) {
            (Retraction::Source, _) => {
                self.time_push(length_mm, seconds);
                writeln!(self.out, "M227")?;
            }
            // Firmware retraction has nothing to give back before the first retract.
            (Retraction::Extruder, _) | (_, None) => return self.push(length_mm, seconds),
            (Retraction::Firmware, Some(retracted_mm)) => {
                self.time_push(length_mm, seconds);
                self.give_back(retracted_mm, length_mm, seconds)?;
            }
        }
        Ok(())
    }

    /// G11, and what it gives more or less than was retracted. Klipper forgets that the filament is back when its
    /// lengths are set, and takes no extra length below 0: there the rest is a push of its own.
    fn give_back(
        &mut self,
        retracted_mm: f64,
        length_mm: f64,
        seconds: f64,
    ) -> Result<(), WriteError> {
        let (speed_mm_s, extra_mm) = (length_mm / seconds.max(1e-3), length_mm - retracted_mm);
        if self.options.dialect != Dialect::Klipper {
            self.set_retraction(retracted_mm, speed_mm_s, extra_mm)?;
            writeln!(self.out, "G11")?;
            return Ok(());
        }
        writeln!(self.out, "G11")?;
        let word = self.extrusion(self.e_mm + extra_mm);
        if !word.is_empty() {
            self.feed = format!(" F{}", short(60.0 * speed_mm_s, 2));
            writeln!(self.out, "G1{word}{}", self.feed)?;
        }
        Ok(())
    }

    /// What the controller retracts by, where it changes.
    fn set_retraction(
        &mut self,
        length_mm: f64,
        speed_mm_s: f64,
        extra_mm: f64,
    ) -> Result<(), WriteError> {
        let [length, speed, extra] =
            [(length_mm, 5), (speed_mm_s, 2), (extra_mm, 5)].map(|(n, d)| short(n, d));
        let minute = short(60.0 * speed_mm_s, 1);
        let text = match self.options.dialect {
            Dialect::Klipper => format!(
                "SET_RETRACTION RETRACT_LENGTH={length} RETRACT_SPEED={speed} UNRETRACT_SPEED={speed} \
                 UNRETRACT_EXTRA_LENGTH={extra}"
            ),
            Dialect::RepRapFirmware => format!("M207 S{length} R{extra} F{minute}"),
            _ => format!("M207 S{length} F{minute}\nM208 S{extra} F{minute}"),
        };
        if text != self.retraction {
            writeln!(self.out, "{text}")?;
            self.retraction = text;
        }
        Ok(())
    }
}
