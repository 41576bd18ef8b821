//! What is set for one job over the machine's own settings.
//!
//! In: [`Settings`] of a machine, and options, `None` where the machine's stay. Out: settings, checked
//! as a whole. The same for the command and for library users. Leaves out where the input lies.

use super::aperture_text::parse_aperture;
use super::check::in_range;
use super::curved_layers::CurvedLayers;
use super::directions::Directions;
use super::{
    AXIS_TOLERANCE_MAX_DEG, HeadingLaw, Infill, PassMode, Place, Quality, SeamPlace, Settings,
};
use crate::text::refusal::{Refusal, refusal};

/// What an option sets.
trait Over<T> {
    fn over(&mut self, given: T);
}

impl<T> Over<T> for T {
    fn over(&mut self, given: T) {
        *self = given;
    }
}

impl<T> Over<T> for Option<T> {
    fn over(&mut self, given: T) {
        *self = Some(given);
    }
}

/// Declares the options: help, name on the command line with the name of its value, field, type, and the settings that it
/// goes over; then those that the command declares with the place of the input, and such numbers that only it knows.
macro_rules! options {
    (
        $(
            $(#[doc = $help:literal])* $long:literal $value:literal $field:ident: $kind:ty [$($argument:tt)*]
            $(=> $($($place:ident)|+),+)?;
        )+
        placed
        $($(#[doc = $text:literal])* $option:literal $placed:ident: $of:ty [];)+
        inner
        $($(#[doc = $told:literal])* $inner:ident = $name:literal;)+
    ) => {
        /// Options of a job; each `None` leaves what the machine file or the default says.
        ///
        /// Made by [`Options::default`] and changed field by field, so that new ones break nobody. The texts are the
        /// command's help; units are those of the names, on the command line degrees for rad.
        #[derive(Clone, Debug, Default, PartialEq)]
        #[cfg_attr(feature = "command", derive(clap::Args))]
        #[cfg_attr(feature = "command", command(next_help_heading = "Settings"))]
        #[non_exhaustive]
        pub struct Options {
            /// The nozzle's aperture, full sizes in mm: `ellipse:LxW`, `circle:D`, `stadium:LxW`, `rect:LxWxR`
            /// (with the corner radius), `polygon:[[x,y],...]` (corners about the tool's axis).
            #[cfg_attr(feature = "command", arg(skip))]
            pub aperture: Option<String>,
            $(
                $(#[doc = $help])*
                #[cfg_attr(
                    feature = "command",
                    arg(id = $long, long = $long, value_name = $value, $($argument)*)
                )]
                pub $field: Option<$kind>,
            )+
            $(
                $(#[doc = $text])*
                #[cfg_attr(feature = "command", arg(skip))]
                pub $placed: Option<$of>,
            )+
            $(
                $(#[doc = $told])*
                #[cfg_attr(feature = "command", arg(skip))]
                pub(crate) $inner: Option<f64>,
            )+
        }

        impl Options {
            /// Sets what one setting or more take as it is given.
            fn set(&self, settings: &mut Settings) {
                $($($(
                    if let Some(given) = self.$field {
                        settings.$($place).+.over(given);
                    }
                )+)?)+
            }

            /// The options that are given, as the command calls them.
            pub(crate) fn given(&self) -> Vec<&'static str> {
                let all = [
                    $((concat!("--", $long), self.$field.is_some()),)+
                    $((concat!("--", $option), self.$placed.is_some()),)+
                    $((concat!("--", $name), self.$inner.is_some()),)+
                ];
                let given = all.into_iter().filter(|(_, is_given)| *is_given);
                given.map(|(name, _)| name).collect()
            }
        }

        /// The names of options on the command line, and of their fields.
        pub const OPTION_NAMES: &[(&str, &str)] = &[$(($long, stringify!($field)),)+ $(($option, stringify!($placed))),+];
    };
}

/// Degrees of the command line.
#[cfg(feature = "command")]
fn radians(text: &str) -> Result<f64, std::num::ParseFloatError> {
    text.parse().map(f64::to_radians)
}

options! {
    /// Tip speed while printing, mm/s.
    "speed" "MM_S" speed_mm_s: f64 [allow_negative_numbers = true]
        => speed_mm_s;
    /// Tip speed of the walls, below --speed, mm/s.
    "wall-speed" "MM_S" wall_speed_mm_s: f64 [allow_negative_numbers = true]
        => kinds|walls|speed_mm_s;
    /// Tip speed of the lines of filled ground, below --speed, mm/s.
    "solid-speed" "MM_S" solid_speed_mm_s: f64 [allow_negative_numbers = true]
        => kinds|solid|speed_mm_s;
    /// Tip speed of the lines of a sparse infill, below --speed, mm/s.
    "sparse-speed" "MM_S" sparse_speed_mm_s: f64 [allow_negative_numbers = true]
        => kinds|sparse|speed_mm_s;
    /// Least time of a layer, s: shorter ones are printed slower [default: 0].
    "min-layer-time" "S" layer_time_min_s: f64 [allow_negative_numbers = true]
        => layer_time_min_s;
    /// Most time of a layer, s: longer ones are reported, since their joints are cold; --refuse layer-time
    /// refuses the job [default: 0, any].
    "max-layer-time" "S" layer_time_max_s: f64 [allow_negative_numbers = true]
        => wide_beads|layer_time_max_s;
    /// Most that a wide bead may lay on the outside of a curve against the inside, as in 1.2 for concrete: paths are
    /// rounded for it where they can be [default: 0, any].
    "max-outer-inner-ratio" "RATIO" outer_inner_ratio_max: f64 [allow_negative_numbers = true]
        => wide_beads|outer_inner_ratio_max;
    /// Layers of one closed bead rise along it and follow each other without a rest (vase mode); walls of a solid part
    /// with --walls 1 --infill-density 0 --top 0.
    "continuous-z" "BOOL" continuous_z: bool [
        num_args = 0..=1, require_equals = true, default_missing_value = "true", visible_alias = "vase"
    ] => wide_beads|continuous_z;
    /// Layer height, mm.
    "layer-height" "MM" layer_height_mm: f64 [allow_negative_numbers = true]
        => layer_height_mm;
    /// Layers of an outline, all the same [default: 1]; a mesh has its own.
    "layers" "N" layers: u32 [allow_negative_numbers = true]
        => layers;
    /// Passes across a narrow passage.
    "pass" "PASS" pass_mode: PassMode []
        => pass_mode;
    /// How the local width becomes a heading angle.
    "law" "LAW" heading_law: HeadingLaw []
        => heading_law;
    /// What a mm² of ground left open or laid twice is worth in seconds of printing [default:
    /// standard].
    "quality" "QUALITY" quality: Quality []
        => quality;
    /// How far the aperture may leave the outline, the segments the path, and chords the curves of
    /// the input, mm.
    "tolerance" "MM" tolerance_mm: f64 [allow_negative_numbers = true]
        => tolerances|outside_mm, tolerances|tip_mm, tolerances|flatten_mm;
    /// Controlled overlap of neighbouring passes, per cent of the bead width.
    "overlap" "PCT" overlap_pct: f64 [allow_negative_numbers = true]
        => overlap_pct;
    /// Loops along the outline, with straight lines inside [default: loops all the way in].
    "walls" "N" walls: u32 [allow_negative_numbers = true];
    /// Share of the ground inside the walls that lines cover, per cent [default: 100].
    "infill-density" "PCT" infill_density_pct: f64 [allow_negative_numbers = true];
    /// From the middle of a line of the infill to that of the next, mm, in place of --infill-density.
    "infill-spacing" "MM" infill_spacing_mm: f64 [allow_negative_numbers = true];
    /// Longest span of a bridge, mm [default: 25 of the widest beads]: a sparse infill below a roof is denser where it
    /// has to be, and longer spans are reported.
    "bridge-max" "MM" bridge_max_mm: f64 [allow_negative_numbers = true]
        => bridge_max_mm;
    /// Solid layers at the bottom of a print with walls [default: 4, of several layers].
    "bottom" "N" bottom_layers: u32 [allow_negative_numbers = true];
    /// Solid layers at the top of a print with walls [default: 5, of several layers].
    "top" "N" top_layers: u32 [allow_negative_numbers = true];
    /// Direction of the infill's lines against the x axis, degrees; every other layer's lie across
    /// [default: 45].
    "infill-angle" "DEG" infill_angle_rad: f64 [allow_negative_numbers = true, value_parser = radians];
    /// Loops around the first layer, at a distance, printed before it.
    "skirt" "N" skirt_loops: u32 [allow_negative_numbers = true]
        => skirt|loops;
    /// From the part (or its brim) to the innermost loop of the skirt, mm [default: 3].
    "skirt-distance-mm" "MM" skirt_distance_mm: f64 [allow_negative_numbers = true]
        => skirt|distance_mm;
    /// Loops around the first layer that touch it, printed before it.
    "brim" "N" brim_loops: u32 [allow_negative_numbers = true]
        => skirt|brim_loops;
    /// Travel stays inside the part where there is a way.
    "avoid-crossing" "BOOL" avoid_crossing: bool [num_args = 0..=1, require_equals = true, default_missing_value = "true"]
        => avoid_crossing;
    /// Where loops begin and end.
    "seam" "PLACE" seam: SeamPlace []
        => seam|place;
    /// Direction of aligned seams against the x axis, degrees [default: 90].
    "seam-direction" "DEG" seam_direction_rad: f64 [allow_negative_numbers = true, value_parser = radians]
        => seam|direction_rad;
    placed
    /// Height of a mesh's first layer.
    "first-layer-height" first_layer_height_mm: f64 [];
    /// First and last layer of a mesh that are wanted, from 1.
    "layer-range" layer_range: [u32; 2] [];
    /// Layers of a mesh that follow its tops.
    "curved-layers" curved_layers: CurvedLayers [];
    /// Pieces of a mesh with build directions of their own.
    "directions" directions: Directions [];
    /// How wide the beads along centre lines are.
    "bead-width" bead_width_mm: f64 [];
    /// How many of the part, in rows.
    "copies" copies: u32 [];
    /// Between their boxes; goes with copies.
    "copy-gap" copy_gap_mm: f64 [];
    /// Waypoints further apart end a pass.
    "gap" gap_mm: f64 [];
    /// How far the corners of a run of waypoints may be rounded.
    "corner-tolerance" corner_tolerance_mm: f64 [];
    /// Where an outline, a mesh or a run of waypoints lies.
    "place" place: Place [];
    inner
    /// How far a run of waypoints is turned about Z.
    turn_deg = "turn";
    /// How far tool axes may be off.
    axis_tolerance_deg = "axis-tolerance";
    /// How far the tool axes of a run of waypoints may be tilted.
    tilt_max_deg = "tilt-max";
    /// Tip speed of a mesh's first layer.
    first_layer_speed_mm_s = "first-layer-speed";
}

/// Options that only outlines and meshes know.
pub(crate) const OF_OUTLINES: &str = "--layers, --copies, --copy-gap, --walls, --wall-speed, --solid-speed, --sparse-speed, \
    --min-layer-time, --continuous-z, --max-layer-time, --skirt, --brim, --avoid-crossing, --seam, --seam-direction, \
    --skirt-distance-mm, --bridge-max, --pass, --law, --quality, --overlap";

/// Lines, and no walls that they are inside of.
fn no_walls() -> Refusal {
    refusal!(
        "lines and solid layers fill the ground inside the walls: say how many with --walls \
         (without it every layer is solid)"
    )
}

/// Density and spacing of the same lines.
fn spacing_and_density() -> Refusal {
    refusal!("--infill-spacing and --infill-density say the same in two ways: give one of them")
}

/// Slowest tip speed, mm/s, as machine files have it.
const SPEED_MIN_MM_S: f64 = 0.01;

impl Options {
    /// The settings with these options.
    ///
    /// # Errors
    /// [`Refusal`]; the settings were checked, so that what fails is an option.
    pub(crate) fn over(&self, mut settings: Settings) -> Result<Settings, Refusal> {
        if let Some(text) = &self.aperture {
            settings.aperture = parse_aperture(text)?;
        }
        self.set(&mut settings);
        settings.infill = self.infill(settings.infill)?;
        self.set_runs(&mut settings)?;
        settings.space_lines();
        settings.check()?;
        let most_mm_s = settings.speed_mm_s;
        match self.first_layer_speed_mm_s {
            Some(speed_mm_s) if !(SPEED_MIN_MM_S..=most_mm_s).contains(&speed_mm_s) => {
                Err(refusal!(
                    "--first-layer-speed {speed_mm_s}: write a speed of {SPEED_MIN_MM_S} mm/s \
                     up to that of the other layers, {most_mm_s} mm/s (--speed)"
                ))
            }
            _ => Ok(settings),
        }
    }

    /// Sets how runs of waypoints are taken.
    fn set_runs(&self, settings: &mut Settings) -> Result<(), Refusal> {
        if let Some(gap_mm) = self.gap_mm {
            if !(gap_mm > 0.0 && gap_mm.is_finite()) {
                return Err(refusal!(
                    "--gap {gap_mm}: write a length in mm above 0, as in --gap 5"
                ));
            }
            settings.gap_mm = Some(gap_mm);
        }
        in_range("--turn", self.turn_deg.unwrap_or(0.0), -360.0, 360.0)?;
        let corner_mm = &mut settings.tolerances.corner_mm;
        *corner_mm = self.corner_tolerance_mm.unwrap_or(*corner_mm);
        settings.place = self.place.unwrap_or(settings.place);
        let tilt_max_rad = self.tilt_max_deg.map(f64::to_radians);
        settings.tilt_max_rad = tilt_max_rad.or(settings.tilt_max_rad);
        if let Some(degrees) = self.axis_tolerance_deg {
            in_range("--axis-tolerance", degrees, 0.0, AXIS_TOLERANCE_MAX_DEG)?;
            settings.axis_tolerance_rad = degrees.to_radians();
        }
        Ok(())
    }

    /// Walls and lines as the options change them.
    fn infill(&self, of_file: Option<Infill>) -> Result<Option<Infill>, Refusal> {
        let base = match (self.walls, of_file) {
            (Some(walls), None) => Some(Infill::solid(walls)),
            (Some(walls), Some(infill)) => Some(Infill { walls, ..infill }),
            (None, of_file) => of_file,
        };
        let Some(mut infill) = base else {
            let of_lines = self.infill_density_pct.is_some()
                || self.infill_spacing_mm.is_some()
                || self.infill_angle_rad.is_some();
            let of_solid = self.bottom_layers.is_some() || self.top_layers.is_some();
            return match of_lines || of_solid {
                true => Err(no_walls()),
                false => Ok(None),
            };
        };
        if self.infill_density_pct.is_some() {
            if self.infill_spacing_mm.is_some() {
                return Err(spacing_and_density());
            }
            infill.spacing_mm = None;
        }
        infill.density_pct = self.infill_density_pct.unwrap_or(infill.density_pct);
        infill.spacing_mm = self.infill_spacing_mm.or(infill.spacing_mm);
        infill.angle_rad = self.infill_angle_rad.unwrap_or(infill.angle_rad);
        infill.bottom_layers = self.bottom_layers.or(infill.bottom_layers);
        infill.top_layers = self.top_layers.or(infill.top_layers);
        Ok(Some(infill))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::machine_file::{from_toml, to_toml};

    /// Goal: options change what they name and nothing else; what cannot be is refused with the key.
    #[test]
    fn options_go_over_the_settings() {
        let plain = Settings::default();
        assert_eq!(Options::default().over(plain.clone()), Ok(plain.clone()));
        let options = Options {
            speed_mm_s: Some(40.0),
            walls: Some(2),
            infill_density_pct: Some(30.0),
            ..Options::default()
        };
        let expected = Settings {
            speed_mm_s: 40.0,
            infill: Some(Infill {
                density_pct: 30.0,
                ..Infill::solid(2)
            }),
            ..plain.clone()
        };
        assert_eq!(options.over(plain.clone()), Ok(expected));
        let without_walls = Options {
            top_layers: Some(3),
            ..Options::default()
        };
        assert_eq!(without_walls.over(plain.clone()), Err(no_walls()));
        let still = Options {
            speed_mm_s: Some(0.0),
            ..Options::default()
        };
        let refused = still.over(plain).unwrap_err().to_string();
        assert!(refused.contains("speed"), "{refused}");
    }

    /// Goal: lines at a spacing have the density of the widest bead at it, with every nozzle, from an option or the file; two
    /// densities and beads upon each other are refused. Method: 6 mm with beads of 1.2 and 1.8 mm.
    #[test]
    fn lines_may_be_given_by_their_spacing() {
        let options = Options {
            walls: Some(2),
            infill_spacing_mm: Some(6.0),
            ..Options::default()
        };
        let settings = options.over(Settings::default()).expect("settings");
        let density_pct = |settings: &Settings| settings.infill.map(|infill| infill.density_pct);
        assert_eq!(density_pct(&settings), Some(20.0));
        let text = to_toml(&settings);
        assert!(
            text.contains("spacing_mm = 6\n") && !text.contains("\ndensity_pct"),
            "{text}"
        );
        let read = from_toml(&text).expect("a machine");
        assert_eq!(read, settings);
        let wider = Options {
            aperture: Some("ellipse:1.8x0.6".to_string()),
            ..Options::default()
        };
        let wide = wider.over(read).expect("settings");
        let pct = density_pct(&wide).unwrap_or_default();
        assert!((pct - 30.0).abs() < 1e-9, "{pct}");
        let denser = Options {
            infill_density_pct: Some(40.0),
            ..Options::default()
        };
        let denser = denser.over(wide.clone()).expect("settings").infill;
        assert_eq!(
            denser.map(|i| (i.density_pct, i.spacing_mm)),
            Some((40.0, None))
        );
        let both = Options {
            infill_density_pct: Some(40.0),
            ..options.clone()
        };
        assert_eq!(both.over(wide), Err(spacing_and_density()));
        let both = text.replace("spacing_mm = 6\n", "spacing_mm = 6\ndensity_pct = 20\n");
        let refused = from_toml(&both).expect_err("two densities").to_string();
        assert!(refused.contains("not both"), "{refused}");
        for (spacing_mm, part) in [
            (1.1, "at least 1.2"),
            (f64::NAN, "NaN"),
            (1e9, "at most 100000"),
        ] {
            let other = Options {
                infill_spacing_mm: Some(spacing_mm),
                ..options.clone()
            };
            let refused = other.over(Settings::default()).expect_err(part).to_string();
            assert!(
                refused.contains("infill.spacing_mm") && refused.contains(part),
                "{refused}"
            );
        }
    }
}
