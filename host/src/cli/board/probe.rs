//! `headway board probe` and `headway board mesh`: the height of the bed, at a point or over a
//! grid.
//!
//! In: a machine file with `[probe]`, positions on the bed in machine coordinates. Out: Z at which the nozzle
//! touches it there. One joint moves at a time; every position is checked before the first move. The board
//! stops at the contact by itself, so that a lost line drives nothing into the bed.

use crate::bed_mesh::{
    BedMesh, FADE_HEIGHT_MM, FADE_START_MM, LAYER_SHARE_MAX, from_toml, to_toml,
};
use crate::cli::args::board::{BoardMachineArgs, MeshArgs, PortArgs, ProbeArgs};
use crate::cli::board::jog::jog;
use crate::cli::board::settings;
use crate::cli::board::talk::Talk;
use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::result_kind::BED_MESH;
use crate::settings::joint_names;
use crate::settings::probe::ProbeSettings;
use headway_firmware::configuration::{JOINTS_MAX, MachineConfiguration};
use headway_firmware::kinematics::forward;
use headway_protocol::message::{Control, ProbeResult, Status};
use serde_json::json;
use std::path::Path;

/// The joint that moves down.
const Z: usize = 2;
/// 0.1 µm.
const UNITS_PER_MM: f64 = 1e4;
/// Share of a joint's speed limit that going to a point uses.
const SPEED_SHARE: f64 = 0.5;
/// A point of a grid is no further below the one before it, mm: a probe that fails breaks nothing then.
const FURTHER_MM: f64 = 2.0;
/// What a joint may differ from the tip, mm and mm a mm: the frames are one.
const SAME: f64 = 1e-6;

/// Result of the touches of a point, mm.
#[derive(Clone, Debug)]
struct Point {
    touches_mm: Vec<f64>,
}

impl Point {
    fn height_mm(&self) -> f64 {
        self.touches_mm.iter().sum::<f64>() / self.touches_mm.len().max(1) as f64
    }

    fn range_mm(&self) -> f64 {
        let touches = self.touches_mm.iter();
        let [low, high] = touches.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| {
            [low.min(*z), high.max(*z)]
        });
        high - low
    }

    fn standard_deviation_mm(&self) -> f64 {
        let mean = self.height_mm();
        let squares = self.touches_mm.iter().map(|z| (z - mean) * (z - mean));
        let others = self.touches_mm.len().saturating_sub(1).max(1);
        (squares.sum::<f64>() / others as f64).sqrt()
    }
}

/// A board that probes.
struct Prober {
    talk: Talk<'static>,
    machine: MachineConfiguration,
    probe: ProbeSettings,
    /// Where the nozzle is.
    tip_mm: [f64; 3],
    /// What joints X, Y and Z have more than the tip.
    joints_ahead_mm: [f64; 3],
}

pub(crate) fn probe(args: &ProbeArgs, console: &Console) -> Result<(), CliError> {
    let mut prober = Prober::open(&args.machine, &args.port)?;
    let place = match &args.at {
        Some(text) => pair("--at", text)?,
        None => prober.below_probe(),
    };
    prober.check_reach(&[place])?;
    let point = prober.safely(|prober| prober.point(place, args.repeat, None))?;
    if args.json {
        let value = json!({
            "x_mm": place[0],
            "y_mm": place[1],
            "height_mm": point.height_mm(),
            "range_mm": point.range_mm(),
            "standard_deviation_mm": point.standard_deviation_mm(),
            "touches_mm": point.touches_mm,
        });
        return console.result(&format!("{value:#}\n"));
    }
    console.result(&format!(
        "the bed at {}, {} is at Z {:.4} mm: {} touches within {:.4} mm, standard deviation {:.4} mm\n",
        place[0],
        place[1],
        point.height_mm(),
        point.touches_mm.len(),
        point.range_mm(),
        point.standard_deviation_mm(),
    ))
}

pub(crate) fn mesh(args: &MeshArgs, console: &Console) -> Result<(), CliError> {
    let (low, high) = corners(&args.area)?;
    let [columns, rows] = args.points;
    let output = args.output.file(BED_MESH, console)?;
    let mut prober = Prober::open(&args.machine, &args.port)?;
    let at = |axis: usize, number: u32, of: u32| {
        low[axis] + (high[axis] - low[axis]) * f64::from(number) / f64::from(of - 1)
    };
    // To and fro, row by row.
    let places: Vec<[f64; 2]> = (0..rows)
        .flat_map(|row| {
            (0..columns).map(move |step| {
                let column = if row % 2 == 0 {
                    step
                } else {
                    columns - 1 - step
                };
                [at(0, column, columns), at(1, row, rows)]
            })
        })
        .collect();
    prober.check_reach(&places)?;
    let points = prober.safely(|prober| prober.points(&places, console))?;
    let mut heights: Vec<f64> = points.iter().map(Point::height_mm).collect();
    let mut heights_mm = Vec::new();
    for (row, heights) in heights.chunks_mut(columns as usize).enumerate() {
        if row % 2 == 1 {
            heights.reverse();
        }
        heights_mm.push(heights.to_vec());
    }
    let mut mesh = BedMesh {
        machine_hash: prober.machine.hash(),
        min_mm: low,
        max_mm: high,
        heights_mm,
        fade_start_mm: FADE_START_MM,
        fade_height_mm: FADE_HEIGHT_MM,
    };
    // As high as a bed that is far off needs.
    let needed_mm = (mesh.fade_start_mm + mesh.deviation_mm() / LAYER_SHARE_MAX).ceil();
    mesh.fade_height_mm = args.fade_height.unwrap_or(FADE_HEIGHT_MM.max(needed_mm));
    let text = to_toml(&mesh);
    let place = output.path().display();
    from_toml(&text).map_err(|error| CliError::Job(format!("{place}: {error}")))?;
    output.write(text.as_bytes())?;
    let [lowest, highest] = mesh.range_mm();
    console.result(&format!(
        "{place}: {columns} x {rows} points from {lowest:.4} to {highest:.4} mm, mean {:.4} mm; touches within \
         {:.4} mm\n",
        mesh.mean_mm(),
        points.iter().map(Point::range_mm).fold(0.0, f64::max),
    ))
}

/// A mesh from its file.
pub(crate) fn read_mesh(path: &Path) -> Result<BedMesh, CliError> {
    let text = load::read_text(path)?;
    from_toml(&text).map_err(|error| CliError::Job(format!("{}: {error}", path.display())))
}

fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N], CliError> {
    let read: Vec<f64> = text
        .split(',')
        .filter_map(|part| part.trim().parse().ok())
        .filter(|number: &f64| number.is_finite())
        .collect();
    let wanted = text.split(',').count() == N;
    let read = <[f64; N]>::try_from(read).ok().filter(|_| wanted);
    read.ok_or_else(|| CliError::Usage(format!("{option} {text}: {N} numbers in mm with commas")))
}

fn pair(option: &str, text: &str) -> Result<[f64; 2], CliError> {
    numbers(option, text)
}

fn corners(text: &str) -> Result<([f64; 2], [f64; 2]), CliError> {
    let [x0, y0, x1, y1] = numbers("--area", text)?;
    if x1 - x0 < 1.0 || y1 - y0 < 1.0 {
        return Err(CliError::Usage(format!(
            "--area {text}: the lower corner, then the upper one, at least 1 mm above it"
        )));
    }
    Ok(([x0, y0], [x1, y1]))
}

impl Prober {
    /// Finds out where the machine is; it must be homed.
    fn open(machine: &BoardMachineArgs, port: &PortArgs) -> Result<Prober, CliError> {
        let settings = settings(machine)?;
        let Some(probe) = settings.probe else {
            return Err(CliError::Usage(
                "the machine file has no [probe]: say there where the probe is (docs/guide/boards.md), and give \
                 the file (--machine)"
                    .to_string(),
            ));
        };
        let machine = settings.machine;
        let mut talk = Talk::open(port)?;
        talk.check_machine(&machine)?;
        let status = talk.status()?;
        let joints = joints_of(&machine, &status);
        let tip_mm = tip_of(&machine, &joints);
        // X, Y and Z move the tip along x, y and z and nothing else: an arm's do not.
        for axis in 0..3 {
            let mut moved = joints;
            moved[axis] += 1.0;
            let there = tip_of(&machine, &moved);
            let along = |a: usize| there[a] - tip_mm[a] - f64::from(u8::from(a == axis));
            if (0..3).any(|a| along(a).abs() > SAME) {
                return Err(CliError::Job(
                    "the first three joints of this machine, as it stands, are not X, Y and Z of the tip; \
                     bring the tool upright, or probe with another machine"
                        .to_string(),
                ));
            }
        }
        let names = joint_names(&machine.kinematics);
        // The nozzle's own turn moves no tip; a tilt that is not known does.
        let needed = if names.len() > 4 {
            machine.joints.len()
        } else {
            3
        };
        let unknown: Vec<&str> = (0..needed)
            .filter(|joint| status.referenced >> joint & 1 == 0)
            .filter_map(|joint| names.get(joint).copied())
            .collect();
        if !unknown.is_empty() {
            return Err(CliError::Job(format!(
                "the board does not know where {} is: home it first (headway board home)",
                unknown.join(", ")
            )));
        }
        Ok(Prober {
            talk,
            machine,
            probe,
            tip_mm,
            joints_ahead_mm: std::array::from_fn(|axis| joints[axis] - tip_mm[axis]),
        })
    }

    /// The place below the probe at present.
    fn below_probe(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.tip_mm[axis] + self.probe.offset_mm[axis])
    }

    /// Where the nozzle is while the probe is at a place.
    fn nozzle_at(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| place[axis] - self.probe.offset_mm[axis])
    }

    /// Height of the nozzle between points, at least.
    fn clear_mm(&self) -> f64 {
        self.probe.z_offset_mm + self.probe.lift_mm
    }

    /// Refuses the first place that a joint does not reach.
    fn check_reach(&self, places: &[[f64; 2]]) -> Result<(), CliError> {
        let names = joint_names(&self.machine.kinematics);
        let check = |axis: usize, tip_mm: f64, what: String| {
            let joint = self.machine.joints.get(axis);
            let at = tip_mm + self.joints_ahead_mm[axis];
            // As near to an end as a step a jog may be refused.
            let reaches = joint.is_some_and(|j| {
                let step = 1.0 / j.steps_per_unit;
                at >= j.position_min + step && at <= j.position_max - step
            });
            if reaches {
                return Ok(());
            }
            let range = joint.map_or([0.0; 2], |j| [j.position_min, j.position_max]);
            Err(CliError::Job(format!(
                "{what}: joint {} would be at {at:.3} mm, its range is {} to {} mm; nothing has moved",
                names.get(axis).copied().unwrap_or("?"),
                range[0],
                range[1]
            )))
        };
        for place in places {
            let nozzle = self.nozzle_at(*place);
            for (axis, tip_mm) in nozzle.into_iter().enumerate() {
                let what = format!(
                    "the probe at {:.3}, {:.3} (nozzle at {:.3}, {:.3})",
                    place[0], place[1], nozzle[0], nozzle[1]
                );
                check(axis, tip_mm, what)?;
            }
        }
        check(Z, self.clear_mm(), "above the bed".to_string())
    }

    /// Lifts the head where something goes wrong.
    fn safely<T>(
        &mut self,
        work: impl FnOnce(&mut Prober) -> Result<T, CliError>,
    ) -> Result<T, CliError> {
        let result = work(self);
        if result.is_err() {
            // It may be a fault, with which nothing moves: then that is reported.
            let _ = self.rise();
        }
        result
    }

    /// Up where probe and nozzle are clear of the bed.
    fn rise(&mut self) -> Result<(), CliError> {
        let clear_mm = self.clear_mm();
        if self.tip_mm[Z] < clear_mm {
            self.move_to(Z, clear_mm)?;
        }
        Ok(())
    }

    /// All points, each from above the one before.
    fn points(&mut self, places: &[[f64; 2]], console: &Console) -> Result<Vec<Point>, CliError> {
        let bar = console.bar("probing", places.len() as u64);
        let mut points: Vec<Point> = Vec::new();
        for place in places {
            let before = points.last().map(Point::height_mm);
            points.push(self.point(*place, None, before)?);
            bar.inc(1);
        }
        bar.finish_and_clear();
        self.rise()?;
        Ok(points)
    }

    /// One point: `repeat` touches, or the machine file's number, which must be close to each other.
    fn point(
        &mut self,
        place_mm: [f64; 2],
        repeat: Option<u32>,
        expected_mm: Option<f64>,
    ) -> Result<Point, CliError> {
        self.rise()?;
        for (axis, tip_mm) in self.nozzle_at(place_mm).into_iter().enumerate() {
            self.move_to(axis, tip_mm)?;
        }
        let mut point = Point {
            touches_mm: Vec::new(),
        };
        for _ in 0..repeat.unwrap_or(self.probe.samples) {
            let expected_mm = point.touches_mm.last().copied().or(expected_mm);
            point.touches_mm.push(self.touch(place_mm, expected_mm)?);
        }
        // From here to the next point.
        let clear_mm = point.height_mm() + self.clear_mm();
        self.move_to(Z, clear_mm.max(self.tip_mm[Z]))?;
        let (range_mm, tolerance_mm) = (point.range_mm(), self.probe.tolerance_mm);
        if repeat.is_none() && range_mm > tolerance_mm {
            return Err(CliError::Job(format!(
                "the touches at {:.3}, {:.3} lie {range_mm:.4} mm apart, more than probe.tolerance_mm, \
                 {tolerance_mm}; look for melt on the nozzle and play in the probe, or touch slower",
                place_mm[0], place_mm[1]
            )));
        }
        Ok(point)
    }

    /// One touch: Z at which the nozzle is at the bed, mm.
    fn touch(&mut self, place: [f64; 2], expected_mm: Option<f64>) -> Result<f64, CliError> {
        let ahead_mm = self.joints_ahead_mm[Z];
        // Counts are whole steps, the board's place is not: a step short of the end.
        let end_mm = self
            .machine
            .joints
            .get(Z)
            .map_or(0.0, |z| z.position_min + 1.0 / z.steps_per_unit - ahead_mm);
        let lowest_mm = match expected_mm {
            Some(mm) => (mm + self.probe.z_offset_mm - FURTHER_MM).max(end_mm),
            None => end_mm,
        };
        let way_mm = (self.tip_mm[Z] - lowest_mm).max(0.0);
        let units = |mm: f64| (mm * UNITS_PER_MM).round();
        self.talk.order(Control::Probe {
            joint: Z as u8,
            distance_units: -units(way_mm) as i32,
            fast_units_s: units(self.probe.fast_mm_s) as u32,
            slow_units_s: units(self.probe.slow_mm_s) as u32,
            back_off_units: units(self.probe.back_off_mm) as u32,
        })?;
        let status = self.talk.wait_for_rest()?;
        self.take_place(&status);
        let what = match status.probe {
            ProbeResult::Touched(units) => {
                let tip_mm = f64::from(units) / UNITS_PER_MM - ahead_mm;
                return Ok(tip_mm - self.probe.z_offset_mm);
            }
            ProbeResult::NotFound => format!(
                "the probe did not trip on {way_mm:.2} mm down; is it plugged in, and in the right sense \
                 (normally_open)?"
            ),
            ProbeResult::Pressed => {
                "the probe is pressed before anything moves; is it plugged in, and in the right sense?"
                    .to_string()
            }
            ProbeResult::StaysPressed => {
                "the probe stays pressed during the retreat; a longer back_off_mm may free it".to_string()
            }
            ProbeResult::None => "the probing was broken off".to_string(),
        };
        Err(CliError::Job(format!(
            "at {:.3}, {:.3}: {what}",
            place[0], place[1]
        )))
    }

    /// Moves the tip along one axis.
    fn move_to(&mut self, axis: usize, tip_mm: f64) -> Result<(), CliError> {
        let way_mm = tip_mm - self.tip_mm[axis];
        let Some(joint) = self.machine.joints.get(axis) else {
            return Ok(());
        };
        // Nearer than a step there is nothing to do.
        if way_mm.abs() * joint.steps_per_unit < 1.0 {
            return Ok(());
        }
        let speed = SPEED_SHARE * joint.speed_max;
        let order = jog(&self.machine, &axis.to_string(), way_mm, Some(speed))?;
        self.talk.order(order)?;
        let status = self.talk.wait_for_rest()?;
        self.take_place(&status);
        Ok(())
    }

    fn take_place(&mut self, status: &Status) {
        self.tip_mm = tip_of(&self.machine, &joints_of(&self.machine, status));
    }
}

/// Positions of the joints, mm and rad.
fn joints_of(machine: &MachineConfiguration, status: &Status) -> [f64; JOINTS_MAX] {
    let mut joints = [0.0; JOINTS_MAX];
    let count = |motor: usize| status.counts_steps.get(motor).copied();
    let steps = std::array::from_fn(|motor| f64::from(count(motor).unwrap_or_default()));
    let steps = machine.motors.joint_steps(&steps);
    let counted = machine.joints.iter().zip(steps);
    for (place, (joint, count)) in joints.iter_mut().zip(counted) {
        *place = count / joint.steps_per_unit;
    }
    joints
}

fn tip_of(machine: &MachineConfiguration, joints: &[f64; JOINTS_MAX]) -> [f64; 3] {
    let tip = forward(&machine.kinematics, joints).tip_mm;
    [tip.x, tip.y, tip.z]
}

/// A job over the bed of a mesh, if a mesh is given.
pub(crate) fn over_bed(
    job: crate::cli::reading::job::Job,
    mesh: Option<&Path>,
) -> Result<crate::cli::reading::job::Job, CliError> {
    let Some(path) = mesh else {
        return Ok(job);
    };
    let place = |problem: String| CliError::Job(format!("{}: {problem}", path.display()));
    let mesh = read_mesh(path)?;
    job.over_bed(&mesh).map_err(place)
}
