//! Goal: a job resumed from a pass equals that part of the original. Method: two spirals, one above the other, cut
//! by hand.

use super::rest::{check_flat, pass_at, pass_of_layer, printed_between, rest_of};
use super::*;
use crate::drive::test_streams::{planar, spiral};
use crate::job::heat::{BED, HOT_END, HeatOrder};
use crate::job::{Mark, MotionState};
use crate::text::refusal::Refusal;
use headway_protocol::segment::{FlowAction, Knot};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME, CHANNEL_Z, Units, to_units};
use std::f64::consts::TAU;

/// Two turns of a spiral, up by 2 mm to another two turns; primes and passes as a planner marks them.
fn job() -> SegmentStream {
    let mut stream = SegmentStream::default();
    for layer in 0..2 {
        let mut turns = spiral(2.0);
        let up = (2e4 * f64::from(layer)) as i32;
        turns.start[CHANNEL_Z] += up;
        turns
            .knots
            .iter_mut()
            .for_each(|knot| knot.control[CHANNEL_Z] += up);
        let [whole] = turns.marks[..] else {
            panic!("one mark");
        };
        // Eight knots stand: two spans of eight ticks, then of 24.
        let begins = 2 * 8 + 4 * 24;
        let mark = |ticks: [u64; 2], state, pass| Mark {
            start_tick: ticks[0],
            end_tick: ticks[1],
            state,
            layer,
            pass,
        };
        turns.marks = vec![
            mark([0, 16], MotionState::Hold, None),
            mark([16, begins], MotionState::Prime, None),
            mark([begins, whole.end_tick], MotionState::Print, Some(0)),
        ];
        turns.events[0].span = 2;
        if layer == 1 {
            bring(&mut stream, turns.start);
        }
        stream.append(turns, layer);
    }
    stream
}

/// To the next layer's start.
fn bring(stream: &mut SegmentStream, to: headway_protocol::units::ChannelPoint) {
    let control = stream.knots.last().unwrap().control;
    let mut knots: Vec<Knot> = Vec::new();
    let at = |share: f64| {
        let place = std::array::from_fn(|channel| {
            control[channel] + (f64::from(to[channel] - control[channel]) * share).round() as i32
        });
        Knot {
            control: place,
            duration_ticks: 200,
        }
    };
    knots.extend((0..=20).map(|k| at(f64::from(k) / 20.0)));
    knots.extend([at(1.0); 3]);
    // The rest that ends a piece is the short one that the next begins with.
    for knot in knots.iter_mut().rev().take(2) {
        knot.duration_ticks = 8;
    }
    let from = stream.marks.last().unwrap().end_tick;
    stream.knots.extend(knots);
    stream.marks.push(Mark {
        start_tick: from,
        end_tick: ticks(stream),
        state: MotionState::Travel,
        layer: 1,
        pass: None,
    });
}

fn ticks(stream: &SegmentStream) -> u64 {
    let spans = stream.spans();
    spans.map(|span| u64::from(span.duration_ticks)).sum()
}

/// Place of the tip at a tick.
fn at(stream: &SegmentStream, tick: u64) -> [f64; 7] {
    let mut spans = stream.spans();
    let span = spans.find(|span| tick < span.start_tick + u64::from(span.duration_ticks));
    let span = span.expect("a tick of the stream");
    span.position((tick - span.start_tick) as f64)
}

#[test]
fn the_rest_is_the_very_same_curve() {
    let job = job();
    let fan = |fan_pct| HeatOrder::Fan { fan_pct };
    let rest = rest_of(&job, &[], 1).unwrap();
    assert_eq!((rest.pass, rest.layer, rest.primed), (1, 1, false));
    let shift = |tick: u64| tick - rest.cut_tick + rest.lead_ticks;
    let end = ticks(&job);
    assert_eq!(ticks(&rest.stream), shift(end));
    for tick in (rest.cut_tick..end).step_by(7) {
        let (whole, left) = (at(&job, tick), at(&rest.stream, shift(tick)));
        let apart = whole.iter().zip(left).map(|(a, b)| (a - b).abs());
        let apart = apart.fold(0.0, f64::max);
        assert!(apart < 1e-9, "{tick}: {apart}");
    }
    // Its own prime and retract, at their places.
    let actions: Vec<FlowAction> = rest
        .stream
        .events
        .iter()
        .map(|event| event.action)
        .collect();
    assert_eq!(actions, [FlowAction::Prime, FlowAction::Retract]);
    let states: Vec<MotionState> = rest.stream.marks.iter().map(|mark| mark.state).collect();
    use MotionState::{Hold, Prime, Print};
    assert_eq!(states, [Hold, Hold, Prime, Print]);
    assert!(
        rest.stream
            .marks
            .windows(2)
            .all(|pair| pair[0].end_tick == pair[1].start_tick)
    );
    // Heat: the latest before it, the hot end waited for, the fan with the first move; then what comes behind.
    let event = |tick, order| HeatEvent { tick, order };
    let orders = [
        event(0, HeatOrder::wait_for(BED, 60.0)),
        event(0, HeatOrder::wait_for(HOT_END, 215.0)),
        event(5, fan(30.0)),
        event(rest.cut_tick, HeatOrder::target(HOT_END, 205.0)),
        event(rest.cut_tick + 10, fan(80.0)),
        event(end, HeatOrder::target(HOT_END, 0.0)),
    ];
    let heat = rest_of(&job, &orders, 1).unwrap().heat;
    let expected = [
        event(0, HeatOrder::wait_for(BED, 60.0)),
        event(0, HeatOrder::wait_for(HOT_END, 205.0)),
        event(1, fan(30.0)),
        event(shift(rest.cut_tick + 10), fan(80.0)),
        event(shift(end), HeatOrder::target(HOT_END, 0.0)),
    ];
    assert_eq!(heat, expected);
}

#[test]
fn a_pass_without_a_prime_gets_one() {
    let mut job = job();
    let second = job
        .events
        .iter()
        .rposition(|event| event.action == FlowAction::Prime);
    let prime = job.events.remove(second.unwrap());
    let rest = rest_of(&job, &[], 1).unwrap();
    assert!(rest.primed);
    let first = rest.stream.events[0];
    assert_eq!(
        (first.span, first.action, first.volume_units),
        (2, FlowAction::Prime, prime.volume_units)
    );
    // It has its time before anything moves.
    assert_eq!(rest.lead_ticks, 16 + u64::from(first.duration_ticks.0));
    let moves = rest
        .stream
        .marks
        .iter()
        .find(|mark| mark.state == MotionState::Print)
        .unwrap();
    assert!(moves.start_tick >= rest.lead_ticks);
    let end = ticks(&job);
    let place = at(&rest.stream, end - 100 - rest.cut_tick + rest.lead_ticks);
    assert_eq!(place, at(&job, end - 100));
}

#[test]
fn places_are_passes_and_what_is_no_place_is_refused() {
    let job = job();
    let [first, second] = [0, 1].map(|pass| {
        let mark = job
            .marks
            .iter()
            .find(|mark| mark.pass == Some(pass))
            .unwrap();
        [mark.start_tick, mark.end_tick]
    });
    for (tick, pass) in [
        (0, 0),
        (first[0] + 5, 0),
        (first[1] - 1, 0),
        (first[1], 1),
        (second[0] + 1, 1),
    ] {
        assert_eq!(pass_at(&job, tick), Ok(pass), "{tick}");
    }
    let refused = |of: Result<String, Refusal>, words: &str| {
        let text = of.expect_err(words).to_string();
        assert!(text.contains(words), "{text}");
    };
    let pass = |of: Result<u32, Refusal>| of.map(|pass| pass.to_string());
    let rest = |of: &SegmentStream, number: u32| rest_of(of, &[], number).map(|_| String::new());
    refused(pass(pass_at(&job, second[1])), "nothing is left");
    assert_eq!(pass_of_layer(&job, 2), Ok(1));
    let none = "prints nothing in layer 0: it has layers 1 to 2";
    refused(pass(pass_of_layer(&job, 0)), none);
    refused(rest(&job, 2), "no pass 2: they are counted from 0 to 1");
    refused(rest(&SegmentStream::default(), 0), "nothing is left");
    let mut broken = job.clone();
    for mark in &mut broken.marks[4..] {
        mark.start_tick += 1;
    }
    refused(rest(&broken, 1), "pass 1 does not begin at rest");
    let reached = Reached {
        done_tick: second[0] + 3000,
        sent_tick: second[0] + 4000,
    };
    let again = resume(&job, &[], 1, Some(reached), None, &planar()).unwrap();
    let Parts {
        left_out,
        again: twice,
        perhaps_again,
        to_come,
    } = again.parts;
    assert!((left_out.time_s - (first[1] - first[0]) as f64 / 2000.0).abs() < 0.03);
    assert!((twice.time_s - 1.5).abs() < 0.03 && (perhaps_again.time_s - 0.5).abs() < 0.03);
    assert!(
        (left_out.length_mm - to_come.length_mm).abs() < 1e-3,
        "the same turns"
    );
    // Turns of radius 10 to 13.8 mm.
    assert!((140.0..160.0).contains(&left_out.length_mm), "{left_out:?}");
    let whole = printed_between(&job, [0, u64::MAX], 2000.0);
    assert!((whole.length_mm - 2.0 * left_out.length_mm).abs() < 1e-3);
}

#[test]
fn a_pass_that_lies_on_itself_is_not_begun_again() {
    let job = job();
    assert_eq!(check_flat(&job, 0, 0.2), Ok(()));
    // The second layer as a part of the first pass: right above its own start, 2 mm higher.
    let mut tower = job;
    for mark in &mut tower.marks {
        mark.pass = mark.pass.map(|_| 0);
    }
    let refused = check_flat(&tower, 0, 0.2).expect_err("stacked").to_string();
    let rise = refused
        .split_once("it comes back ")
        .and_then(|(_, rest)| rest.split_once(" mm"));
    let rise_mm: f64 = rise
        .and_then(|(rise, _)| rise.parse().ok())
        .expect(&refused);
    assert!((1.9..2.2).contains(&rise_mm), "{rise_mm}");
    let machine = to_units(&[0.0; 7]);
    assert_ne!(machine, tower.start);
}

/// Goal: the board is sent to where a job of coarse units goes on, in its own units. Method: the same job in both.
#[test]
fn the_way_to_a_job_of_coarse_units_is_in_base_units() {
    let units = Units {
        length_exponent: 3,
        angle_exponent: 0,
        volume_exponent: 6,
    };
    let mut coarse = job();
    coarse.units = units;
    coarse.start = units.of_base(&coarse.start);
    for knot in &mut coarse.knots {
        knot.control = units.of_base(&knot.control);
    }
    let [fine, coarse] = [job(), coarse].map(|job| resume(&job, &[], 1, None, None, &planar()));
    let (fine, coarse) = (fine.unwrap(), coarse.unwrap());
    assert_eq!(coarse.rest.stream.units, units);
    assert_eq!(coarse.way.start, units.to_base(&coarse.rest.stream.start));
    for channel in 0..=CHANNEL_Z {
        // Half a unit of 8.
        assert!((coarse.way.start[channel] - fine.way.start[channel]).abs() <= 4);
        assert!((coarse.way.above[channel] - fine.way.above[channel]).abs() <= 8);
    }
    assert!((coarse.parts.to_come.length_mm - fine.parts.to_come.length_mm).abs() < 0.1);
}

/// Goal: a heading that wound beyond the wire's 32 bits is resumed as the nozzle stands. Method: the job with a nozzle
/// that turns on with every knot that moves, by 20 rad either way; before, the rest was turned by 156.5°.
#[test]
fn a_heading_that_wound_beyond_32_bits_is_resumed_as_the_nozzle_stands() {
    for turn_units in [20_000_000i32, -20_000_000] {
        let mut wound = job();
        let (mut before, mut heading) = (wound.start, 0i32);
        for knot in &mut wound.knots {
            if knot.control != before {
                heading = heading.wrapping_add(turn_units);
            }
            before = knot.control;
            knot.control[CHANNEL_HEADING] = heading;
            knot.control[CHANNEL_VOLUME] = heading;
        }
        let again = resume(&wound, &[], 1, None, None, &planar()).unwrap();
        let rest = &again.rest;
        let [whole, left] = [at(&wound, rest.cut_tick), at(&rest.stream, rest.lead_ticks)];
        let heading_rad = whole[CHANNEL_HEADING];
        assert!(heading_rad.abs() > 2147.0, "not wound: {heading_rad}");
        let turns = (heading_rad - left[CHANNEL_HEADING]) / TAU;
        // A microradian of the wire.
        assert!((turns - turns.round()).abs() < 1e-6 / TAU, "{turns}");
        let sent_rad = f64::from(again.way.start[CHANNEL_HEADING]) * 1e-6;
        assert!((sent_rad - left[CHANNEL_HEADING]).abs() < 1e-9);
        // From there on the same turns and the same volume.
        let span = wound.displacement();
        assert!(span[CHANNEL_HEADING].abs() > 1 << 32, "{span:?}");
        let end = ticks(&rest.stream) - 1;
        let [by, of_rest] = [
            at(&wound, end + rest.cut_tick - rest.lead_ticks),
            at(&rest.stream, end),
        ];
        for channel in [CHANNEL_HEADING, CHANNEL_VOLUME] {
            let turned = (by[channel] - whole[channel]) - (of_rest[channel] - left[channel]);
            assert!(turned.abs() < 1e-6, "{channel}: {turned}");
        }
    }
}
