//! The joint solution of a route, and the turns of the joints at the start of each move.
//!
//! In: the route and the machine. Out: the machine in the solution that is fastest by its joints'
//! speeds, and for every move the joints' turns at its start. The joints are followed along the
//! complete route, as the controller will follow them: a solution that leaves a range, or in which a
//! joint would have to jump, is rejected; if all are, the error is that of the one that came furthest.
//! Between two solutions there is a singular pose, so a route keeps to one; a change between two passes
//! would cost a stop and is not considered.

use crate::plan::motion::joint_limits::{MotionLimits, check_range, tip_mm};
use crate::plan::motion::motion_error::{MotionError, bad_limit, no_pose};
use crate::plan::route::moves::{PathCurve, Route};
use crate::settings::{Settings, joint_names};
use crate::text::refusal::refusal;
use headway_firmware::configuration::JOINTS_MAX;
use headway_firmware::kinematics::pose::Pose;
use headway_firmware::kinematics::winding::Winding;
use headway_firmware::kinematics::{inverse, winds};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_TILT_X, CHANNELS};

/// Longest distance and turn between two samples at first.
const LOOK_MM: f64 = 2.0;
const LOOK_RAD: f64 = 0.05;
/// Fewest and most samples of each span.
const LOOKS_PER_SPAN: [f64; 2] = [2.0, 4000.0];
/// Turn of a joint between two samples above which it is sampled more closely, and the number of halvings
/// before it counts as a jump: to steps of a thousandth of a sample.
const CLOSER_RAD: f64 = 0.5;
const HALVINGS_MAX: u32 = 10;

/// Joint turns at the start of each move.
pub type Windings = Vec<Winding<f64>>;

/// A route followed in one joint solution.
#[derive(Clone, Debug)]
pub struct Followed {
    /// Least time by the speeds of tip and joints, s.
    pub seconds: f64,
    /// Least time by the joints' limits alone: of two solutions that the tip's speed limits, the one
    /// whose joints move less is better.
    joint_seconds: f64,
    /// Turns at the start of each move.
    pub windings: Windings,
}

impl Followed {
    fn is_faster_than(&self, other: &Followed) -> bool {
        (self.seconds, self.joint_seconds) < (other.seconds, other.joint_seconds)
    }
}

/// The settings with the best joint solution of the machine, and the turns in it.
///
/// # Errors
/// [`MotionError`] of the solution that came furthest.
pub fn choose_solution(
    route: &Route,
    settings: &Settings,
) -> Result<(Settings, Windings), MotionError> {
    if winds(&settings.machine.kinematics) == 0 {
        let windings = vec![Winding::default(); route.moves.len()];
        return Ok((settings.clone(), windings));
    }
    fastest(route, settings).map(|(with_it, followed)| (with_it, followed.windings))
}

/// The settings with the joint solution in which the route is fastest, and its joint turns.
///
/// # Errors
/// [`MotionError`] of the solution that came furthest.
pub fn fastest(route: &Route, settings: &Settings) -> Result<(Settings, Followed), MotionError> {
    let kinematics = settings.machine.kinematics;
    let mut best: Option<(Settings, Followed)> = None;
    let mut furthest: Option<(usize, MotionError, Settings)> = None;
    for solution in 0..kinematics.solutions() {
        let mut with_it = settings.clone();
        with_it.machine.kinematics = kinematics.with_solution(solution);
        match follow(route, &with_it) {
            Ok(followed) => {
                if best
                    .as_ref()
                    .is_none_or(|(_, best)| followed.is_faster_than(best))
                {
                    best = Some((with_it, followed));
                }
            }
            Err((looks, error)) => {
                if furthest.as_ref().is_none_or(|(most, ..)| looks > *most) {
                    furthest = Some((looks, error, with_it));
                }
            }
        }
    }
    match (best, furthest) {
        (Some(best), _) => Ok(best),
        (None, Some((_, error, with_it))) => match error {
            MotionError::OutsideJointRange { .. } => Err(worst_outside(route, &with_it, error)),
            _ => Err(error),
        },
        (None, None) => Err(bad_limit("number of joint solutions")),
    }
}

/// The error of the place at which a joint is furthest outside its range.
fn worst_outside(route: &Route, settings: &Settings, first: MotionError) -> MotionError {
    let mut outside = Outside::Worst(None);
    // Where no joints can be followed any further is behind the places that count.
    let _ = followed(route, settings, &mut outside);
    match outside {
        Outside::Worst(Some((_, error))) => error,
        _ => first,
    }
}

/// What becomes of a joint outside its range.
enum Outside {
    /// It ends the way.
    Ends,
    /// The way goes on, and the error of the place furthest outside is kept, with by how much, mm or rad.
    Worst(Option<(f64, MotionError)>),
}

impl Outside {
    fn of(&mut self, error: MotionError) -> Result<(), MotionError> {
        match (self, error) {
            (
                Outside::Worst(worst),
                error @ MotionError::OutsideJointRange {
                    position,
                    minimum,
                    maximum,
                    ..
                },
            ) => {
                let by = (minimum - position).max(position - maximum);
                if worst.as_ref().is_none_or(|(most, _)| by > *most) {
                    *worst = Some((by, error));
                }
                Ok(())
            }
            (_, error) => Err(error),
        }
    }
}

/// Follows the joints along the route in the settings' joint solution.
///
/// # Errors
/// The number of samples until the failure, and its reason.
pub fn follow(route: &Route, settings: &Settings) -> Result<Followed, (usize, MotionError)> {
    followed(route, settings, &mut Outside::Ends)
}

fn followed(
    route: &Route,
    settings: &Settings,
    outside: &mut Outside,
) -> Result<Followed, (usize, MotionError)> {
    let mut windings = Vec::with_capacity(route.moves.len());
    let mut follower: Option<Follower<'_>> = None;
    for route_move in &route.moves {
        let limits = MotionLimits::of(settings, route_move.state).map_err(|error| (0, error))?;
        let Some(start) = route_move.curve.control.first() else {
            windings.push(follower.as_ref().map_or(Winding::default(), |f| f.winding));
            continue;
        };
        if follower.is_none() {
            follower = Some(Follower::at_rest(start, settings).map_err(|error| (0, error))?);
        }
        let Some(follower) = &mut follower else {
            continue;
        };
        windings.push(follower.winding);
        if let Err(error) = follower.along(&route_move.curve, &limits, outside) {
            return Err((follower.looks, error));
        }
    }
    let [seconds, joint_seconds] = follower.map_or([0.0; 2], |follower| follower.seconds);
    Ok(Followed {
        seconds,
        joint_seconds,
        windings,
    })
}

/// The joints at the last sample.
struct Follower<'a> {
    settings: &'a Settings,
    winding: Winding<f64>,
    position: [f64; JOINTS_MAX],
    looks: usize,
    tip_mm: [f64; 3],
    /// By tip and joints, and by joints alone.
    seconds: [f64; 2],
}

impl<'a> Follower<'a> {
    fn at_rest(start: &[f64; CHANNELS], settings: &'a Settings) -> Result<Self, MotionError> {
        let machine = &settings.machine;
        let mut follower = Self {
            settings,
            winding: Winding::default(),
            position: [0.0; JOINTS_MAX],
            looks: 0,
            tip_mm: tip_mm(start),
            seconds: [0.0; 2],
        };
        let position = follower.wound(start)?;
        follower.winding = Winding::at_rest(&machine.kinematics, &position, &machine.ranges());
        follower.position = position;
        let kinematics = machine.kinematics;
        follower
            .winding
            .unwound(&kinematics, &mut follower.position);
        Ok(follower)
    }

    fn wound(&self, channels: &[f64; CHANNELS]) -> Result<[f64; JOINTS_MAX], MotionError> {
        let kinematics = &self.settings.machine.kinematics;
        let joints = inverse(kinematics, &Pose::from_channels(channels));
        joints
            .map(|joints| joints.position)
            .map_err(|error| no_pose(error, tip_mm(channels)))
    }

    fn along(
        &mut self,
        curve: &PathCurve,
        limits: &MotionLimits,
        outside: &mut Outside,
    ) -> Result<(), MotionError> {
        if curve.control.len() < 2 {
            return Ok(());
        }
        for span in 0..curve.span_count() {
            let (a, b) = (&curve.control[span], &curve.control[span + 1]);
            let off = |channel: usize| (a[channel] - b[channel]).abs();
            let way_mm = (0..3).map(off).fold(0.0, f64::max);
            let turn_rad = (CHANNEL_TILT_X..=CHANNEL_HEADING)
                .map(off)
                .fold(0.0, f64::max);
            let [least, most] = LOOKS_PER_SPAN;
            let looks = (way_mm / LOOK_MM)
                .max(turn_rad / LOOK_RAD)
                .clamp(least, most);
            let looks = looks.ceil() as usize;
            for look in 1..=looks {
                let part = |look: usize| span as f64 + look as f64 / looks as f64;
                self.step(curve, limits, [part(look - 1), part(look)], 0, outside)?;
            }
        }
        Ok(())
    }

    /// To the end of the piece of the curve, in steps in which no joint turns far.
    fn step(
        &mut self,
        curve: &PathCurve,
        limits: &MotionLimits,
        [from, to]: [f64; 2],
        halvings: u32,
        outside: &mut Outside,
    ) -> Result<(), MotionError> {
        let channels = curve.evaluate(to).value;
        let kinematics = &self.settings.machine.kinematics;
        let mut position = self.wound(&channels)?;
        let mut winding = self.winding;
        winding.unwound(kinematics, &mut position);
        let turns = (0..limits.joints.len())
            .filter(|joint| limits.joints[*joint].rotary)
            .map(|joint| (joint, (position[joint] - self.position[joint]).abs()));
        let (joint, turn_rad) = turns.fold(
            (0, 0.0),
            |most, turn| {
                if turn.1 > most.1 { turn } else { most }
            },
        );
        if turn_rad > CLOSER_RAD {
            if halvings == HALVINGS_MAX {
                let names = joint_names(kinematics);
                return Err(MotionError::Refused(refusal!(
                    "joint {name} would have to turn by {:.0}° at once with the tip at \
                     {at_mm:.3?} mm (machine coordinates), where two rotary axes line up; move \
                     or turn the part, or let the tool axis be led past this direction \
                     (--axis-tolerance)",
                    turn_rad.to_degrees(),
                    name = names.get(joint).copied().unwrap_or("?"),
                    at_mm = tip_mm(&channels)
                )));
            }
            let middle = 0.5 * (from + to);
            self.step(curve, limits, [from, middle], halvings + 1, outside)?;
            return self.step(curve, limits, [middle, to], halvings + 1, outside);
        }
        check_range(limits, tip_mm(&channels), &position).or_else(|error| outside.of(error))?;
        let way = std::array::from_fn(|joint| position[joint] - self.position[joint]);
        let seconds = limits.bounded([&way]);
        let seconds = seconds.map(|(limit, [way])| way.abs() / limit.speed_max);
        let by_joints = seconds.fold(0.0, f64::max);
        let tip = tip_mm(&channels);
        let way_mm = (0..3)
            .map(|i| (tip[i] - self.tip_mm[i]).powi(2))
            .sum::<f64>()
            .sqrt();
        self.seconds[0] += by_joints.max(way_mm / limits.tip_speed_mm_s);
        self.seconds[1] += by_joints;
        self.tip_mm = tip;
        self.looks += 1;
        (self.winding, self.position) = (winding, position);
        Ok(())
    }
}
