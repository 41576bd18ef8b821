//! Goal: a part that is planned in blocks is one motion: nothing jumps where one block ends and the next begins, the
//! heading takes the shorter way there and stays within its stops, material is only added; and shards planned in any
//! order give the same job. Method: a pyramid, whose layers all differ, so that it is four blocks; the finished stream,
//! tick by tick, by its own positions.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::job::{MotionState, SegmentStream};
use headway::mesh::layers::{SlicedPart, TargetLayer};
use headway::pipeline::mesh::{FirstLayer, PartContext, PartPlan, plan_part, plan_part_in_pieces};
use headway::pipeline::piece::{Piece, PieceCache};
use headway::pipeline::shards::{PlannedBlock, Shard, plan_shard};
use headway::report::pose_table::{StreamSample, samples_within};
use headway::settings::Settings;
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;

const LAYERS: u32 = 20;
/// Layers of each block: the first may be another, then eight different ones at a time.
const BLOCKS: [std::ops::Range<u32>; 4] = [0..1, 1..9, 9..17, 17..20];

fn pyramid() -> SlicedPart {
    let layers = (0..LAYERS).map(|number| {
        let half_mm = 2.5 - 0.05 * f64::from(number);
        let corners = [[-1.0, -0.7], [1.0, -0.7], [1.0, 0.7], [-1.0, 0.7]];
        let points = corners.map(|[x, y]| Point2::new(half_mm * x, half_mm * y));
        TargetLayer {
            number,
            height_mm: 0.2,
            top_mm: 0.2 * f64::from(number + 1),
            regions: vec![Region {
                exterior: Ring {
                    points: points.to_vec(),
                },
                holes: Vec::new(),
            }],
        }
    });
    SlicedPart {
        layers: layers.collect(),
        wanted: 0..LAYERS,
        notes: Vec::new(),
    }
}

fn planned(settings: &Settings) -> PartPlan {
    let first = FirstLayer::default();
    plan_part(&pyramid(), &[], first, settings, &()).expect("a plan")
}

fn samples(stream: &SegmentStream, settings: &Settings) -> Vec<StreamSample> {
    let servo_hz = f64::from(settings.machine.servo_hz);
    let end = stream.marks.last().expect("marks").end_tick;
    samples_within(stream, servo_hz, 1.0, [0, end]).collect()
}

/// Start and end of the travel to the first pass of each block but the first, as numbers of samples.
fn links(samples: &[StreamSample]) -> Vec<[usize; 2]> {
    let begins = BLOCKS[1..].iter().map(|layers| {
        let is_first = |sample: &StreamSample| {
            sample.mark.layer == layers.start && sample.mark.state != MotionState::Travel
        };
        let end = samples.iter().position(is_first).expect("a pass");
        let back = samples[..end].iter().rev();
        let length = back.take_while(|sample| sample.mark.state == MotionState::Travel);
        [end - length.count(), end]
    });
    begins.collect()
}

#[test]
fn blocks_of_a_part_are_one_motion() {
    let settings = Settings::default();
    let plan = planned(&settings);
    let samples = samples(&plan.printed.stream, &settings);
    let servo_hz = f64::from(settings.machine.servo_hz);
    for pair in samples.windows(2) {
        for channel in 0..=CHANNEL_VOLUME {
            let moved = pair[1].position[channel] - pair[0].position[channel];
            let rate = pair[0].velocity[channel]
                .abs()
                .max(pair[1].velocity[channel].abs());
            // A tick of the greater of both rates, and what an acceleration adds in one.
            let room = rate / servo_hz * 1.1 + 2e-4;
            assert!(
                moved.abs() < room,
                "channel {channel}: {moved} of {room}: {:?}",
                pair[1]
            );
        }
        let laid = pair[1].position[CHANNEL_VOLUME] - pair[0].position[CHANNEL_VOLUME];
        assert!(laid > -1e-5, "{laid}: {:?}", pair[1]);
    }
    let links = links(&samples);
    let heading = |number: usize| samples[number].position[CHANNEL_HEADING];
    // Without stops the heading goes on winding, so that a block begins far from where it was planned, at 0.
    assert!(
        links
            .iter()
            .any(|[_, end]| heading(*end).abs() > 2.0 * FRAC_PI_2)
    );
    for [from, to] in links {
        let turn_rad = heading(to) - heading(from);
        assert!(turn_rad.abs() < FRAC_PI_2 + 1e-3, "{turn_rad}");
    }
}

#[test]
fn blocks_keep_the_heading_between_its_stops() {
    let mut settings = Settings::default();
    let stop_rad = 500.0_f64.to_radians();
    settings.machine.joints[3].position_min = -stop_rad;
    settings.machine.joints[3].position_max = stop_rad;
    let plan = planned(&settings);
    let samples = samples(&plan.printed.stream, &settings);
    let headings = samples
        .iter()
        .map(|sample| sample.position[CHANNEL_HEADING]);
    let most_rad = headings.map(f64::abs).fold(0.0, f64::max);
    assert!(most_rad <= stop_rad && most_rad > FRAC_PI_2, "{most_rad}");
}

/// Blocks in memory.
#[derive(Default)]
struct Kept(BTreeMap<u128, Vec<u8>>);

impl PieceCache for Kept {
    fn keeps(&self) -> bool {
        true
    }

    fn get(&mut self, key: u128) -> Option<Piece> {
        self.0.get(&key).and_then(|bytes| Piece::from_bytes(bytes))
    }

    fn put(&mut self, key: u128, piece: &Piece) {
        self.0.insert(key, piece.to_bytes().expect("bytes"));
    }
}

#[test]
fn shards_in_any_order_give_the_same_job() {
    let (part, first, settings) = (pyramid(), FirstLayer::default(), Settings::default());
    let mut kept = Kept::default();
    let shard = |number: usize, kept: &mut Kept| -> Vec<PlannedBlock> {
        let shard = Shard { number, count: 3 };
        let planned = plan_shard(&part, &[], first, &settings, shard, (kept, "p"), &());
        let planned = planned.expect("blocks");
        assert_eq!(planned.blocks, BLOCKS.len());
        planned.own
    };
    let of = |block: &PlannedBlock| block.layers[0] - 1..block.layers[1];
    let layers = |blocks: &[PlannedBlock]| blocks.iter().map(of).collect::<Vec<_>>();
    assert_eq!(layers(&shard(3, &mut kept)), &BLOCKS[2..3]);
    assert_eq!(
        layers(&shard(1, &mut kept)),
        [BLOCKS[0].clone(), BLOCKS[3].clone()]
    );
    assert_eq!(layers(&shard(2, &mut kept)), &BLOCKS[1..2]);
    assert!(shard(1, &mut kept).iter().all(|block| block.was_known));
    assert_eq!(kept.0.len(), BLOCKS.len());

    let mut stream = SegmentStream::default();
    let mut take = |piece: SegmentStream, first_pass| {
        stream.append(piece, first_pass);
        Ok(())
    };
    let context = PartContext {
        progress: &(),
        cache: &mut kept,
        program: "p",
        take: &mut take,
    };
    let of_shards = plan_part_in_pieces(&part, &[], first, &settings, context).expect("a plan");
    assert_eq!(kept.0.len(), BLOCKS.len(), "nothing was planned again");
    let at_once = planned(&settings);
    assert!(stream == at_once.printed.stream);
    assert_eq!(of_shards.printed.figures, at_once.printed.figures);
}
