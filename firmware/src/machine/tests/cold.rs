//! Goal: melt never moves while the hot end is too cold for it: by hand, in a stream, after its target was
//! removed; permission to do so applies to one stream or extrusion. Method: the machine with heaters of
//! one mass, the extruder's steps counted.
use super::*;
use crate::configuration::heat::EXTRUDE_MIN_C;
use headway_protocol::message::ColdHeater;

/// Motor of the extruder.
const EXTRUDER: usize = 4;

impl Hot {
    fn extrude(&mut self) {
        self.host.control(HostMessage::Control(Control::Extrude {
            action: FlowAction::Prime,
            volume_units: 100_000,
            duration_ticks: Ticks(2000),
        }));
        self.run(4000);
    }

    fn allow_cold(&mut self, allowed: bool) {
        self.host
            .control(HostMessage::Control(Control::ExtrudeCold(allowed)));
        self.run(10);
    }

    fn extruded(&self) -> i64 {
        self.host.machine.motion().counts()[EXTRUDER]
    }

    /// The heater's readings have come.
    fn read(celsius: f32) -> Self {
        let mut hot = Self::new(celsius);
        hot.run(2200);
        hot
    }

    /// No stream is open any more.
    fn end_stream(&mut self) {
        self.host.control(HostMessage::Control(Control::Abort));
        self.run(2000);
    }

    fn stream(&mut self, job: &Job, rounds: usize) {
        for _ in 0..rounds {
            self.host.send(job, 8, 16);
            self.run(200);
        }
    }
}

#[test]
fn melt_by_hand_is_refused_below_the_least_temperature() {
    let mut hot = Hot::read(25.0);
    hot.end_stream();
    hot.extrude();
    let [RefusalReason::Cold(cold)] = hot.host.refusals[..] else {
        panic!("{:?}", hot.host.refusals);
    };
    let least_decidegrees = (EXTRUDE_MIN_C * 10.0) as u16;
    assert_eq!(
        (cold.heater, cold.least_decidegrees),
        (0, least_decidegrees)
    );
    // A degree: noise of a count of the converter.
    assert!((i32::from(cold.decidegrees) - 250).abs() <= 10, "{cold:?}");
    // On its way is not there.
    hot.heat(0, 2000, false);
    hot.extrude();
    assert_eq!(hot.host.refusals.len(), 2);
    assert_eq!(hot.extruded(), 0);

    let mut hot = Hot::read(200.0);
    hot.end_stream();
    hot.extrude();
    assert_eq!(hot.host.refusals, []);
    assert!(hot.extruded() > 0);
}

#[test]
fn a_stream_without_heat_ends_before_any_melt_has_moved() {
    let job = flower();
    let mut hot = Hot::read(25.0);
    hot.stream(&job, 15);
    assert_eq!(hot.host.faults[0].cause, FaultCause::ColdExtrusion);
    // In 0.01 °C.
    assert!((hot.host.faults[0].value - 2500).abs() <= 100);
    assert_eq!(hot.extruded(), 0);
    assert_eq!(hot.host.state, DeviceState::Faulted);
}

#[test]
fn a_stream_waits_for_a_hot_end_that_heats_though_nobody_asked_it_to() {
    let job = flower();
    let mut hot = Hot::new(160.0);
    hot.heat(0, 2000, false);
    hot.stream(&job, 3);
    assert_eq!(hot.host.state, DeviceState::Heating);
    assert_eq!((hot.extruded(), hot.host.counter.steps), (0, 0));
    let mut rounds = 0;
    while hot.extruded() == 0 && rounds < 400 {
        hot.stream(&job, 1);
        rounds += 1;
    }
    assert!(hot.extruded() > 0);
    // A round is a tenth of a second: not before, and the reading is in tenths.
    assert!(hot.celsius[0] > EXTRUDE_MIN_C - 0.5, "{}", hot.celsius[0]);
    assert_eq!(hot.host.faults, []);
}

#[test]
fn a_stream_comes_to_rest_where_its_hot_end_goes_cold() {
    let job = flower();
    let mut hot = Hot::new(200.0);
    hot.heat(0, 2000, false);
    hot.stream(&job, 10);
    assert_eq!(hot.host.state, DeviceState::Running);
    hot.heat(0, 0, false);
    // As if the fan had done it.
    hot.celsius[0] = 150.0;
    hot.stream(&job, 30);
    assert_eq!(hot.host.faults[0].cause, FaultCause::ColdExtrusion);
    let rests_at = hot.extruded();
    hot.run(2000);
    assert!(hot.host.machine.motion().is_at_rest());
    assert_eq!(hot.extruded(), rests_at);
}

#[test]
fn leave_to_extrude_cold_is_for_one_run() {
    let job = flower();
    let mut hot = Hot::read(25.0);
    // The stream is open: what is given now is for it.
    hot.allow_cold(true);
    hot.stream(&job, 20);
    assert_eq!(hot.host.faults, []);
    assert!(hot.extruded() > 0);
    hot.end_stream();
    let before = hot.extruded();
    hot.extrude();
    assert!(matches!(hot.host.refusals[..], [RefusalReason::Cold(_)]));
    // By hand once, and not again.
    hot.allow_cold(true);
    hot.extrude();
    let once = hot.extruded();
    assert!(once > before);
    hot.extrude();
    // Given and taken back, and given and not used for half a minute.
    hot.allow_cold(true);
    hot.allow_cold(false);
    hot.extrude();
    hot.allow_cold(true);
    hot.run(62_000);
    hot.extrude();
    assert_eq!(hot.extruded(), once);
    assert_eq!(hot.host.refusals.len(), 4);
}

/// Goal: a machine says for itself from where its melt may move, or that it does not pass a hot end.
/// Method: 30 °C, and 0.
#[test]
fn the_least_temperature_is_the_settings() {
    let configuration = HeatConfiguration::standard();
    let melt = |extrude_min_c: f32, reading_c: f32| {
        let mut heat = configuration.clone();
        heat.heaters[0].extrude_min_c = extrude_min_c;
        let mut panel = crate::motion::heat_panel::HeatPanel::default();
        panel.set_up(&heat);
        panel.note(0, Some(reading_c), 0.0, 0.0);
        panel.melt()
    };
    use crate::motion::heat_panel::Melt;
    let cold = ColdHeater {
        heater: 0,
        decidegrees: 290,
        least_decidegrees: 300,
    };
    assert_eq!(melt(30.0, 29.0), Melt::Cold(cold));
    assert_eq!(melt(30.0, 30.0), Melt::Ready);
    assert_eq!(melt(0.0, 20.0), Melt::Ready);
}
