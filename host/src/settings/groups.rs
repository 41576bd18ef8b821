//! The keys of a machine file that are numbers, names and switches, each declared once.
//!
//! In: nothing. Out: by [`keys!`] the reader, the writer and the check of each group. Keys in the order in which they are
//! written, with the comments that stand above them. Leaves out joints, axes, motors, drivers, switches and wiring, whose
//! keys depend on the kinematics.

use super::heat::{Material, PAUSE_HEAT_MAX_MIN_MOST};
use super::keys::{
    ApertureWords, Asked, AskedSwitch, Count, CountFromTwo, Degrees, FlowRange, Form, Known,
    KnownCount, Milliradians, Named, Plain, Points, Range, Required, Switch, Words, keys,
};
use super::measure::{FlowController, Measure};
use super::probe::ProbeSettings;
use super::pump::{PumpKind, PumpOutput};
use super::wide_beads::{LAYER_TIME_MAX_S, RATIO_RANGE};
use super::{HeadingLaw, Infill, LAYERS_MAX, PassMode, Quality, SeamPlace, Settings};
use crate::text::refusal::Refusal;
use Range::{Above0, Any, Within};
use headway_firmware::configuration::MachineConfiguration;
use headway_protocol::control::DECIDEGREES_MAX;

/// Of the tip, mm/s: up to that of a nozzle half a metre wide that moves by its width as fast as the smallest do.
const TIP_SPEED_RANGE_MM_S: [f64; 2] = [0.01, 1e5];
/// Of melt, mm³: up to a cubic metre a second, as nozzles half a metre wide would need.
pub(super) const MELT_SPEED_RANGE: [f64; 2] = [1e-4, 1e9];
const MELT_ACCELERATION_RANGE: [f64; 2] = [1e-4, 1e12];
/// Fewest and most steps a unit.
pub(super) const STEPS_RANGE: [f64; 2] = [1e-6, 1e9];
/// Of a bridge, mm.
const BRIDGE_RANGE_MM: [f64; 2] = [0.01, 1e5];
const HOTTEST_C: f64 = DECIDEGREES_MAX as f64 / 10.0;

const TIP_SPEED: Range = Within(TIP_SPEED_RANGE_MM_S[0], TIP_SPEED_RANGE_MM_S[1]);
const LAYER_COUNT: Range = Within(0.0, LAYERS_MAX as f64);
const TURN: Range = Within(-360.0, 360.0);
/// Ahead of the flow, s.
const PUMP_LEAD: Range = Within(0.0, 30.0);
const HEAT: Range = Within(0.0, HOTTEST_C);

keys! {
    /// The command line overrides these (--aperture, --speed, ...).
    PrintKeys of Settings, "print" {
        /// ellipse:LxW, stadium:LxW (full sizes, the long one along tool X), circle:D, rect:LxWxR (with
        /// the corner radius) or polygon:FILE (corners about the tool's axis, beside this file)
        aperture: ApertureWords = aperture, Any;
        /// All of the same outline.
        layers: CountFromTwo = layers, Within(1.0, LAYERS_MAX as f64);
        layer_height_mm: Plain = layer_height_mm, Within(0.001, 500.0);
        /// Of a mesh in flat layers.
        first_layer_height_mm: Known = first_layer_height_mm, Within(0.001, 500.0);
        speed_mm_s: Plain = speed_mm_s, TIP_SPEED;
        travel_speed_mm_s: Plain = travel_speed_mm_s, TIP_SPEED;
        tip_acceleration_mm_s2: Plain = tip_acceleration_mm_s2, Within(1.0, 1e7);
        /// Travel moves are lifted by this much.
        lift_mm: Plain = lift_mm, Within(0.0, 1000.0);
        layer_time_min_s: Asked = layer_time_min_s, Within(0.0, 3600.0);
        slow_speed_min_mm_s: Plain = slow_speed_min_mm_s, Within(0.1, 10_000.0), when |s| s.layer_time_min_s > 0.0;
        outer_inner_ratio_max: Asked = wide_beads|outer_inner_ratio_max, Within(RATIO_RANGE[0], RATIO_RANGE[1]);
        layer_time_max_s: Asked = wide_beads|layer_time_max_s, Within(0.0, LAYER_TIME_MAX_S);
        continuous_z: AskedSwitch = wide_beads|continuous_z, Any;
        overlap_pct: Plain = overlap_pct, Within(0.0, 50.0);
        /// Longest span of a bridge; a sparse infill below a roof is denser where it has to be.
        bridge_max_mm: Known = bridge_max_mm, Above0(BRIDGE_RANGE_MM);
        /// Of what must keep out of keep-outs, about the tool's axis; 0: the aperture alone.
        nozzle_body_radius_mm: Plain = nozzle_body_radius_mm, Within(0.0, 1000.0);
        /// Travel stays inside the part where there is a way.
        avoid_crossing: Switch = avoid_crossing, Any;
        /// Where loops begin and end: nearest, aligned or sharpest.
        seam: Named<SeamPlace> = seam|place, Any;
        seam_direction_deg: Degrees = seam|direction_rad, TURN;
        pass: Named<PassMode> = pass_mode, Any;
        law: Named<HeadingLaw> = heading_law, Any;
        /// What ground left open or laid twice is worth in seconds of printing: fine, standard or fast.
        quality: Named<Quality> = quality, Any;
    }
}

keys! {
    FlowKeys of Settings, "flow" {
        factor: Plain = flow_factor, Within(0.01, 10.0);
        flow_max_mm3_s: Plain = flow_max_mm3_s, Any;
        rate_of_change_max_mm3_s2: Plain = flow_rate_of_change_max_mm3_s2, Above0(MELT_ACCELERATION_RANGE);
        /// Rates are peaks. A retract begins its lead before the pass ends,
        /// a pass starts to move its lead before the prime is done.
        retract_mm3: Plain = prime_retract|retract_mm3, Any;
        retract_rate_mm3_s: Plain = prime_retract|retract_rate_mm3_s, Above0(MELT_SPEED_RANGE);
        retract_lead_s: Plain = prime_retract|retract_lead_s, Within(0.0, 10.0);
        prime_mm3: Plain = prime_retract|prime_mm3, Any;
        prime_rate_mm3_s: Plain = prime_retract|prime_rate_mm3_s, Above0(MELT_SPEED_RANGE);
        prime_lead_s: Plain = prime_retract|prime_lead_s, Within(0.0, 10.0);
        pump_start_mm: Asked = wide_beads|pump_start_mm, Any;
        pump_stop_mm: Asked = wide_beads|pump_stop_mm, Any;
    }
}

keys! {
    TolerancesKeys of Settings, "tolerances" {
        /// How far a placed aperture may leave the outline.
        outside_mm: Plain = tolerances|outside_mm, Within(1e-5, 1.0);
        /// Finished segments against the path.
        tip_mm: Plain = tolerances|tip_mm, Within(1e-4, 1.0);
        axis_mrad: Milliradians = tolerances|axis_rad, Within(0.01, 100.0);
        heading_mrad: Milliradians = tolerances|heading_rad, Within(0.01, 100.0);
        /// Curves of the input become polygons this close.
        flatten_mm: Plain = tolerances|flatten_mm, Within(1e-5, 1.0);
        /// Corners of runs of waypoints are rounded within this; small roundings can take longer than rests.
        corner_mm: Asked = tolerances|corner_mm, Any;
    }
}

keys! {
    /// Walls with straight lines inside, in place of beads along the outline all the way in.
    InfillKeys of Infill, "infill" {
        walls: Required<Count> = walls, Within(1.0, 1000.0);
        density_pct: Plain = density_pct, Within(0.0, 100.0), when |infill| infill.spacing_mm.is_none();
        spacing_mm: Known = spacing_mm, Any;
        angle_deg: Degrees = angle_rad, TURN;
        bottom_layers: KnownCount = bottom_layers, LAYER_COUNT;
        top_layers: KnownCount = top_layers, LAYER_COUNT;
    }
}

keys! {
    /// Loops around the part, printed before it: at a distance, and touching it (brim).
    SkirtKeys of Settings, "skirt" {
        loops: Count = skirt|loops, Within(0.0, 100.0);
        brim_loops: Count = skirt|brim_loops, Within(0.0, 100.0);
        distance_mm: Plain = skirt|distance_mm, Within(0.0, 1000.0);
    }
}

keys! {
    /// Steps count deposited volume. e = V + K dV/dt.
    ExtruderKeys of MachineConfiguration, "extruder" {
        steps_per_mm3: Required<Plain> = extruder|steps_per_mm3, Above0(STEPS_RANGE);
        speed_max_mm3_s: Required<Plain> = extruder|speed_max_mm3_s, Above0(MELT_SPEED_RANGE);
        acceleration_max_mm3_s2: Required<Plain> = extruder|acceleration_max_mm3_s2, Above0(MELT_ACCELERATION_RANGE);
        pressure_advance_s: Plain = extruder|pressure_advance_s, Within(0.0, 5.0), when |m| m.curves.advance.is_empty();
        pressure_advance_window_ms: Plain = extruder|pressure_advance_window_ms, Within(1.0, 200.0);
        /// [mm3_s, share]: what of the asked flow does not arrive.
        flow_loss: Points = curves|loss, Any;
        /// [mm3_s, s]: K by flow, in place of pressure_advance_s.
        advance: Points = curves|advance, Any;
    }
}

keys! {
    /// Set before the job, which waits for it, and switched off after it.
    MaterialKeys of Material, "material" {
        hot_end_c: Required<Plain> = hot_end_c, HEAT;
        bed_c: Plain = bed_c, HEAT;
        fan_pct: Plain = fan_pct, Within(0.0, 100.0);
        fan_from_layer: KnownCount = fan_from_layer, Within(1.0, LAYERS_MAX as f64);
        first_layer_hot_end_c: Known = first_layer_hot_end_c, HEAT;
        first_layer_bed_c: Known = first_layer_bed_c, HEAT;
        pause_heat_max_min: Known = pause_heat_max_min, Within(0.0, PAUSE_HEAT_MAX_MIN_MOST);
        density_g_cm3: Known = density_g_cm3, Within(1e-3, 30.0);
        price_per_kg: Known = price_per_kg, Within(1e-3, 1e6);
        melt_max_mm3_s: Known = melt_max_mm3_s, Above0(MELT_SPEED_RANGE);
        diameter_mm: Known = diameter_mm, Within(1e-3, 20.0);
        self_support_deg: Known = self_support_deg, Within(0.0, 89.0);
    }
}

keys! {
    /// Where the probe touches, from the nozzle; how high the nozzle is then. Touches, and what they may lie
    /// apart.
    ProbeKeys of ProbeSettings, "probe" {
        offset_x_mm: Plain = offset_mm[0], Within(-500.0, 500.0);
        offset_y_mm: Plain = offset_mm[1], Within(-500.0, 500.0);
        z_offset_mm: Plain = z_offset_mm, Within(-20.0, 20.0);
        fast_mm_s: Plain = fast_mm_s, Any;
        slow_mm_s: Plain = slow_mm_s, Any;
        back_off_mm: Plain = back_off_mm, Within(0.05, 20.0);
        lift_mm: Plain = lift_mm, Any;
        samples: Count = samples, Within(1.0, 50.0);
        tolerance_mm: Plain = tolerance_mm, Within(0.0005, 5.0);
    }
}

keys! {
    /// Output of a robot's or a gantry's controller that drives the pump, and by how much it comes before the flow.
    PumpKeys of PumpOutput, "pump" {
        /// Name of the signal, or number of the output.
        output: Required<Words> = output, Any;
        /// analog or digital.
        kind: Named<PumpKind> = kind, Any;
        mm3_s_per_unit: Known = mm3_s_per_unit, Above0(MELT_SPEED_RANGE);
        lag_s: Plain = lag_s, PUMP_LEAD;
        start_lead_s: Plain = start_lead_s, PUMP_LEAD;
        stop_lead_s: Plain = stop_lead_s, PUMP_LEAD;
        rate_min_mm3_s: Plain = rate_min_mm3_s, Within(0.0, MELT_SPEED_RANGE[1]);
        rate_max_mm3_s: Known = rate_max_mm3_s, Above0(MELT_SPEED_RANGE);
    }
}

keys! {
    /// What corrects the flow while a job prints (headway stream --sensor), and how far.
    MeasureKeys of Measure, "measure" {
        /// flow (the sensor program's own), layer (scans of layers) or pressure (of the pump).
        controller: Named<FlowController> = controller, Any;
        /// Shares of the planned flow.
        flow_range: FlowRange = flow_range, Any;
        flow_change_per_s: Plain = flow_change_per_s, Within(1e-4, 1.0);
        silent_s: Plain = silent_s, Within(0.1, 3600.0);
        height_noise_mm: Plain = height_noise_mm, Within(1e-4, 50.0);
        recovery_layers: Plain = recovery_layers, Within(1.0, 100.0);
        /// In the sensor's unit.
        pressure: Known = pressure, Above0([1e-9, 1e12]);
        pressure_gain_per_s: Plain = pressure_gain_per_s, Within(1e-5, 1.0);
    }
}
