//! Goal: programs for robots' controllers do what the job does. Method: each is run by an interpreter of its language that
//! shares nothing with the writer, and held against the job's stream, servo tick by servo tick: tip and tool axes, joints by
//! the configuration that is written, the time by a model of blocks and blends.

use super::singular_places::machine;
use super::wrist::{arm, target};
use headway::joint_export::samples::{JointSample, joint_samples};
use headway::programs::{Language, Program, ProgramJob, ProgramOptions, write_program};
use headway::settings::Settings;
use headway::{Plan, plan_target};
use headway_firmware::configuration::{Frame as ArmFrame, JOINTS_MAX, Kinematics};
use headway_firmware::kinematics::pose::Pose;
use headway_protocol::units::CHANNEL_VOLUME;
use headway_tests::robot_programs::block_time::{BlockLimits, seconds};
use headway_tests::robot_programs::joints::{ArmGeometry, Frame, joints_of};
use headway_tests::robot_programs::krl::run_krl;
use headway_tests::robot_programs::rapid::run_rapid;
use headway_tests::robot_programs::sinumerik::run_sinumerik;
use headway_tests::robot_programs::urscript::run_urscript;
use headway_tests::robot_programs::{Motion, SourceFile, Step, Target};
use nalgebra::{Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Tolerance of the tip and of the nozzle's end in these tests, mm.
const TIP_MM: f64 = 0.008;
/// From the nozzle's axis to its end, mm.
const REACH_MM: f64 = 0.6;
/// What is promised of the points' places, mm,
const POINT_MM: f64 = 0.2 * TIP_MM;
/// and of their directions, degrees.
const POINT_DEG: f64 = 0.05;

pub(super) fn options(language: Language) -> ProgramOptions {
    ProgramOptions {
        language,
        name: "part".to_string(),
        tolerance_mm: TIP_MM,
        reach_mm: REACH_MM,
        tool: None,
        work_object: (language == Language::UrScript).then(|| "bed".to_string()),
        kb_max: None,
    }
}

pub(super) fn written(
    plan: &Plan,
    settings: &Settings,
    options: &ProgramOptions,
) -> Result<Program, headway::text::refusal::Refusal> {
    let job = ProgramJob {
        stream: &plan.stream,
        machine: &settings.machine,
        tip_acceleration_mm_s2: settings.tip_acceleration_mm_s2,
        pump: settings.pump.as_ref(),
    };
    write_program(&job, options)
}

/// The files of a program, as interpreters read them.
pub(super) fn sources(program: &Program) -> Vec<SourceFile> {
    let files = program.files.iter().map(|file| SourceFile {
        name: file.name.clone(),
        text: file.text.clone(),
    });
    files.collect()
}

/// The steps of a program; of several, one after the other.
pub(super) fn run(program: &Program, language: Language) -> Vec<Step> {
    let mut files = sources(program);
    // The submit interpreter's program is no part of it.
    files.retain(|file| !file.name.ends_with(".sub"));
    let mains = |ending: &str| {
        let names = files
            .iter()
            .filter_map(|file| file.name.strip_suffix(ending));
        names.map(str::to_string).collect::<Vec<_>>()
    };
    let ran = match language {
        Language::Rapid => run_rapid(&files, "part_main"),
        Language::Krl => (mains(".src").iter())
            .map(|main| run_krl(&files, main))
            .collect::<Result<Vec<_>, _>>()
            .map(|parts| parts.concat()),
        Language::UrScript => (mains(".script").iter())
            .map(|main| run_urscript(&files, &format!("{main}.script"), &[("bed", [0.0; 6])]))
            .collect::<Result<Vec<_>, _>>()
            .map(|parts| parts.concat()),
        Language::Sinumerik => run_sinumerik(&files, "part.mpf"),
    };
    ran.unwrap_or_else(|error| panic!("{error}"))
}

/// Where the tip is, and the axes of the controller's tool.
type Posed = (Vector3<f64>, Rotation3<f64>);

/// A place of the job at a servo tick.
pub(super) struct Sample {
    pub(super) volume_mm3: f64,
    tip_mm: Vector3<f64>,
    tool: Rotation3<f64>,
    joints_deg: [f64; JOINTS_MAX],
}

fn has_nozzle(settings: &Settings) -> bool {
    matches!(&settings.machine.kinematics, Kinematics::Arm6 { arm, .. } if arm.nozzle)
}

pub(super) fn samples(plan: &Plan, settings: &Settings) -> Vec<Sample> {
    let has_nozzle = has_nozzle(settings);
    let of = |sample: JointSample| {
        let mut pose = Pose::from_channels(&sample.sample.position);
        if has_nozzle {
            // The flange keeps its heading; the nozzle turns by an axis of its own.
            pose.heading_rad = 0.0;
        }
        Sample {
            volume_mm3: sample.sample.position[CHANNEL_VOLUME],
            tip_mm: pose.tip_mm,
            tool: pose.rotation() * Rotation3::from_axis_angle(&Vector3::x_axis(), PI),
            joints_deg: std::array::from_fn(|joint| sample.position[joint].to_degrees()),
        }
    };
    let all = joint_samples(&plan.stream, &settings.machine, 1.0);
    all.map(|sample| of(sample.unwrap())).collect()
}

/// Where a motion leads in the plan's frame.
fn end_of(motion: &Motion, language: Language) -> Option<Posed> {
    let Target::Pose {
        tip_mm, rotation, ..
    } = &motion.target
    else {
        return None;
    };
    let rows = Matrix3::from_fn(|row, column| rotation[row][column]);
    let mut tool = Rotation3::from_matrix_unchecked(rows);
    if language == Language::Sinumerik {
        tool *= Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
    }
    Some((Vector3::from(*tip_mm), tool))
}

fn between(from: &Rotation3<f64>, to: &Rotation3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&(from.inverse() * to))
}

/// From one place to another against the tolerances.
fn away(from: Posed, to: Posed) -> SVector<f64, 6> {
    let tip = (to.0 - from.0) / TIP_MM;
    let turn = between(&from.1, &to.1).scaled_axis() * REACH_MM / TIP_MM;
    SVector::from_iterator(tip.iter().chain(turn.iter()).copied())
}

/// How far a place lies beside a straight block, against the tolerances, and where along it.
fn beside(place: Posed, block: [Posed; 2]) -> (f64, f64) {
    let way = away(block[0], block[1]);
    let off = away(block[0], place);
    let share = (off.dot(&way) / way.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    let left = off - share * way;
    let tip = left.fixed_rows::<3>(0).norm();
    let turn = left.fixed_rows::<3>(3).norm();
    (tip.max(turn), share)
}

/// Holds the motions against the job; returns the tick at which each ends.
fn check_path(ends: &[Posed], job: &[Sample], what: &str) -> Vec<usize> {
    let mut block = 0;
    let mut ticks = vec![0; ends.len()];
    for (tick, sample) in job.iter().enumerate() {
        let place = (sample.tip_mm, sample.tool);
        let ahead = (block..ends.len() - 1).take(4);
        let found: Vec<_> = ahead
            .map(|at| (at, beside(place, [ends[at], ends[at + 1]])))
            .collect();
        // The first within the tolerance: a path comes near itself again.
        let within = found.iter().find(|of| of.1.0 <= 1.0);
        let nearest = || found.iter().min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let best = within.or_else(nearest).unwrap();
        assert!(
            best.1.0 <= 1.0,
            "{what}: tick {tick}, block {}: {} of the tolerance off {:?}",
            best.0,
            best.1.0,
            sample.tip_mm
        );
        for end in &mut ticks[block + 1..=best.0] {
            *end = tick;
        }
        block = best.0;
        ticks[block + 1] = tick;
    }
    assert!(
        block + 2 >= ends.len(),
        "{what}: block {block} of {}",
        ends.len()
    );
    ticks
}

fn frame(of: &ArmFrame) -> Frame {
    Frame {
        rotation: of.rotation,
        origin_mm: of.origin_mm,
    }
}

/// The arm with the tool and the work object as its controller has them.
fn geometry(settings: &Settings) -> (ArmGeometry, [[f64; 2]; 6]) {
    let Kinematics::Arm6 { arm, .. } = &settings.machine.kinematics else {
        panic!("an arm");
    };
    let base = frame(&arm.base);
    let rows = |m: &Matrix3<f64>| std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
    let turned = Matrix3::from_fn(|r, c| base.rotation[r][c]).transpose();
    let origin = turned * -Vector3::from(base.origin_mm);
    let tool = Matrix3::from_fn(|r, c| arm.tool.rotation[r][c]);
    let out = tool * Rotation3::from_axis_angle(&Vector3::x_axis(), PI).matrix();
    let geometry = ArmGeometry {
        a1_mm: arm.a1_mm,
        a2_mm: arm.a2_mm,
        b_mm: arm.b_mm,
        c1_mm: arm.c1_mm,
        c2_mm: arm.c2_mm,
        c3_mm: arm.c3_mm,
        c4_mm: arm.c4_mm,
        offsets_deg: arm.offset_rad.map(f64::to_degrees),
        reversed: std::array::from_fn(|axis| arm.reversed >> axis & 1 != 0),
        tool: Frame {
            rotation: rows(&out),
            origin_mm: arm.tool.origin_mm,
        },
        base: Frame {
            rotation: rows(&turned),
            origin_mm: origin.into(),
        },
    };
    let joints = &settings.machine.joints;
    let ranges = std::array::from_fn(|axis| {
        [joints[axis].position_min, joints[axis].position_max].map(f64::to_degrees)
    });
    (geometry, ranges)
}

/// The motions of a program.
fn motions_of(steps: &[Step]) -> Vec<Motion> {
    let motions = steps.iter().filter_map(|step| match step {
        Step::Move(motion) => Some(motion.clone()),
        _ => None,
    });
    motions.collect()
}

/// A program's motions held against the path of its job.
pub(super) struct OnPath {
    /// Motions with blends as distances.
    pub(super) timed: Vec<Motion>,
    /// Those that lead to a pose (the way to the start may not), the pose, and the tick at which the job is there.
    pub(super) posed: Vec<(Motion, Posed, usize)>,
}

/// Holds the motions against the job's path.
pub(super) fn on_path(job: &[Sample], steps: &[Step], language: Language) -> OnPath {
    let what = language.name();
    let motions = motions_of(steps);
    let posed: Vec<(&Motion, Posed)> = (motions.iter())
        .filter_map(|motion| Some((motion, end_of(motion, language)?)))
        .collect();
    let start = (job[0].tip_mm, job[0].tool);
    let ends: Vec<_> = std::iter::once(start)
        .chain(posed.iter().map(|of| of.1))
        .collect();
    let ticks = check_path(&ends, job, what);
    let timed = match language {
        Language::Sinumerik => with_contour_tolerance(&posed),
        _ => motions.clone(),
    };
    let posed = posed.into_iter().zip(&ticks[1..]);
    let posed =
        posed.map(|((motion, end), &tick)| (motion.clone(), end, at_tick(&end, tick, job, what)));
    OnPath {
        posed: posed.collect(),
        timed,
    }
}

/// Limits by which blocks are timed: the plan's acceleration alone.
pub(super) fn limits(settings: &Settings) -> BlockLimits {
    BlockLimits {
        tip_speed_mm_s: 1e6,
        tip_acceleration_mm_s2: settings.tip_acceleration_mm_s2,
        turn_speed_deg_s: 1e6,
        turn_acceleration_deg_s2: 1e6,
        joint_speed_deg_s: vec![1e6; 6],
        joint_acceleration_deg_s2: 1e6,
    }
}

/// Holds a program against its job.
fn check(plan: &Plan, settings: &Settings, options: &ProgramOptions) {
    let language = options.language;
    let what = language.name();
    let program = written(plan, settings, options).unwrap();
    let steps = run(&program, language);
    let waits_s: f64 = (steps.iter())
        .map(|step| match step {
            Step::Wait { seconds } => *seconds,
            _ => 0.0,
        })
        .sum();
    let job = samples(plan, settings);
    let OnPath { timed, posed } = on_path(&job, &steps, language);
    let took_s = seconds(&timed, &limits(settings)) + waits_s;
    let share = took_s / program.duration_s;
    println!(
        "{what}: {} points, {} bytes, {:.3} of the job's time",
        program.points,
        program
            .files
            .iter()
            .map(|file| file.text.len())
            .sum::<usize>(),
        share
    );
    assert!(
        (share - 1.0).abs() < 0.03,
        "{what}: {took_s} s, {} s",
        program.duration_s
    );
    if has_nozzle(settings) {
        for (motion, _, tick) in &posed {
            let Target::Pose { external, .. } = &motion.target else {
                continue;
            };
            let away_deg = (external[0] - job[*tick].joints_deg[6]).abs();
            assert!(
                away_deg < POINT_DEG,
                "{what}: line {}: {away_deg}",
                motion.line
            );
        }
    } else if language == Language::Rapid {
        check_joints(&posed, &job, settings);
    }
}

/// Motions whose blends are distances: CTOL, which the interpreter gives, is how far a rounded corner may be off. An arc that
/// begins d before a corner of angle c misses it by d tan(c / 4).
fn with_contour_tolerance(posed: &[(&Motion, Posed)]) -> Vec<Motion> {
    let mut motions: Vec<Motion> = posed.iter().map(|of| of.0.clone()).collect();
    for (number, three) in posed.windows(3).enumerate() {
        let comes = three[1].1.0 - three[0].1.0;
        let leaves = three[2].1.0 - three[1].1.0;
        let quarter = (0.25 * comes.angle(&leaves)).tan().max(1e-9);
        let blend_mm = &mut motions[number + 1].blend_mm;
        let half_mm = 0.5 * comes.norm().min(leaves.norm());
        *blend_mm = (*blend_mm / quarter).min(half_mm);
    }
    motions
}

/// The tick near another at which the job is at a point.
fn at_tick(end: &Posed, near: usize, job: &[Sample], what: &str) -> usize {
    // By what is promised of both: while a tip hardly moves, a nozzle may turn through many ticks.
    let away_at = |tick: usize| {
        let turn_deg = between(&end.1, &job[tick].tool).angle().to_degrees();
        let away_mm = (end.0 - job[tick].tip_mm).norm();
        (away_mm / POINT_MM).max(turn_deg / POINT_DEG)
    };
    let around = near.saturating_sub(400)..(near + 400).min(job.len());
    let nearest = around
        .min_by(|a, b| away_at(*a).total_cmp(&away_at(*b)))
        .unwrap();
    let place = &job[nearest];
    let turn_deg = between(&end.1, &place.tool).angle().to_degrees();
    let away_mm = (end.0 - place.tip_mm).norm();
    assert!(away_mm < POINT_MM, "{what}: {end:?}: {away_mm} mm");
    assert!(turn_deg < POINT_DEG, "{what}: {end:?}: {turn_deg} degrees");
    nearest
}

/// The joints by the configurations that are written are the job's, and no block asks for more speed than they have.
fn check_joints(posed: &[(Motion, Posed, usize)], job: &[Sample], settings: &Settings) {
    let (geometry, ranges) = geometry(settings);
    let mut before: Option<[f64; 6]> = None;
    for (number, (motion, end, tick)) in posed.iter().enumerate() {
        let Target::Pose {
            tip_mm,
            rotation,
            configuration: Some(configuration),
            ..
        } = &motion.target
        else {
            panic!("{}:{}: no configuration", motion.file, motion.line);
        };
        let joints = joints_of(&geometry, *tip_mm, *rotation, configuration, &ranges)
            .unwrap_or_else(|error| panic!("{}:{}: {error}", motion.file, motion.line));
        let theirs = job[*tick].joints_deg;
        for (axis, (own, job)) in joints.iter().zip(&theirs).enumerate() {
            assert!(
                (own - job).abs() < 0.01,
                "line {}: {axis}: {own} {job}",
                motion.line
            );
        }
        if let Some(before) = before {
            let from = posed[number - 1].1;
            let length_mm = (end.0 - from.0).norm();
            let turn_deg = between(&from.1, &end.1).angle().to_degrees();
            let block_s = (length_mm / motion.speed_mm_s).max(turn_deg / motion.turn_speed_deg_s);
            let limits = &settings.machine.joints;
            for axis in 0..6 {
                let speed = (joints[axis] - before[axis]).abs() / block_s;
                let most = 1.01 * limits[axis].speed_max.to_degrees();
                assert!(speed < most, "line {}: axis {axis}: {speed}", motion.line);
            }
        }
        before = Some(joints);
    }
}

#[test]
fn programs_do_what_the_job_does() {
    let settings = arm("arm-large.toml", 400.0);
    let plan = plan_target(&target("taper.json"), &settings).unwrap();
    for language in [Language::Rapid, Language::Krl, Language::UrScript] {
        check(&plan, &settings, &options(language));
    }
    // In several files.
    for language in [Language::Rapid, Language::Krl, Language::UrScript] {
        check(
            &plan,
            &settings,
            &ProgramOptions {
                kb_max: Some(16),
                ..options(language)
            },
        );
    }
    let turned = machine("arm-small.toml");
    let plan = plan_target(&target("taper.json"), &turned).unwrap();
    for language in [Language::Rapid, Language::Krl] {
        check(&plan, &turned, &options(language));
    }
    let refused = written(&plan, &turned, &options(Language::UrScript));
    assert!(
        refused
            .as_ref()
            .is_err_and(|error| error.to_string().contains("the job's machine is another")),
        "{refused:?}"
    );
    let gantry = Settings::default();
    let plan = plan_target(&target("taper.json"), &gantry).unwrap();
    check(&plan, &gantry, &options(Language::Sinumerik));
}
