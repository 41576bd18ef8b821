//! Noise that no eye can see does not change how wide the beads are printed: widths and headings along
//! the curves of a noisy part against those of the same part without noise.

use headway::geometry::aperture::Aperture;
use headway::geometry::plane_curve::curve_at;
use headway::geometry::{Point2, Vector2};
use headway::input::Target;
use headway::plan_target;
use headway::settings::Settings;
use headway_tests::layer_oracle::Rings;
use headway_tests::outlines::{region, with_noise};
use rayon::prelude::*;

/// An L of two arms, 9 mm wide.
const L: [[f64; 2]; 6] = [
    [0.0, 0.0],
    [40.0, 0.0],
    [40.0, 9.0],
    [9.0, 9.0],
    [9.0, 30.0],
    [0.0, 30.0],
];
const NOISE_MM: f64 = 0.005;
/// Most places of a hundred that may be further apart than that. None was while turning weighed
/// little and the corridor was narrow, which cost a third of the printing time; 17 and 21 with the
/// first two noises: beads hand on what the ones before them miss. Headings are told, not held, for
/// the same reason.
const WIDER_PCT_MAX: usize = 30;
/// What no width may differ by, mm: an eighth of the widest bead.
const WIDTH_MAX_MM: f64 = 0.15;
const SEEDS: [u64; 4] = [8101, 8102, 8103, 8104];
/// What a width may differ by: noise moves either wall of a channel by 5 um, and the beads before
/// it hand their errors on once. The most here is 15.1 um, over forty other noises 19.8 um.
const WIDTH_MM: f64 = 0.02;
/// The same for headings: most that are compared are of innermost beads, 1.1 mm wide, where 1
/// degree is 8 um of width. The most here is 1.01 degrees, over forty other noises 1.6.
const HEADING_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// How far from the narrowest and the widest bead headings are compared: there the width hardly
/// depends on them.
const FROM_ENDS_MM: f64 = 0.1;
/// How far from a corner of either pass, mm: in a corner a pass may swing one way or the other.
const FROM_BENDS_MM: f64 = 1.0;
/// How far from a corner of the part, mm: there walls of other directions share the channel.
const FROM_CORNERS_MM: f64 = 3.5;
/// A placement this far from the other pass has no fellow in it.
const FELLOW_MM: f64 = 0.15;

/// A placement of a pass.
struct Place {
    at: Point2,
    along: Vector2,
    heading_rad: f64,
    width_mm: f64,
    /// Way along the pass to its nearest corner.
    from_bend_mm: f64,
}

/// How far two plans lie apart.
#[derive(Debug, Default)]
struct Apart {
    compared: usize,
    headings: usize,
    alone: usize,
    width_mm: f64,
    heading_rad: f64,
    /// Places of those whose widths and headings are further apart than they should be.
    wider: usize,
    turned: usize,
}

/// Poses of the curves that are printed, pass by pass.
fn passes(rings: &Rings, settings: &Settings) -> Vec<Vec<Place>> {
    let target = Target {
        name: "part".to_string(),
        regions: vec![region(rings)],
    };
    let plan = plan_target(&target, settings).expect("a plan");
    let offset = plan.transform.offset_mm;
    let places = plan.curves.iter().map(|pass| {
        // Four poses of a span, which is 0.24 mm long.
        let spans = pass.control.len() - 1;
        let points = (0..4 * spans).map(|k| {
            let [x, y, heading] = curve_at(&pass.control, k / 4, 0.25 * (k % 4) as f64);
            (Point2::new(x - offset[0], y - offset[1]), heading)
        });
        places(&points.collect::<Vec<_>>(), &settings.aperture)
    });
    places.collect()
}

fn places(points: &[(Point2, f64)], aperture: &Aperture) -> Vec<Place> {
    let last = points.len() - 1;
    let along: Vec<Vector2> = (0..=last)
        .map(|i| points[(i + 1).min(last)].0 - points[i.saturating_sub(1)].0)
        .map(|step| step.try_normalize(1e-9).unwrap_or(Vector2::x()))
        .collect();
    let mut ways_mm = vec![0.0];
    for pair in points.windows(2) {
        ways_mm.push(ways_mm[ways_mm.len() - 1] + (pair[1].0 - pair[0].0).norm());
    }
    // A corner is where the direction turns by more than 20 degrees within 0.6 mm.
    let mut bends_mm = Vec::new();
    for i in 0..=last {
        let behind = ways_mm.partition_point(|&way| way < ways_mm[i] + 0.6);
        let behind = behind.min(last);
        if along[i].angle(&along[behind]) > 20f64.to_radians() {
            bends_mm.extend([ways_mm[i], ways_mm[behind]]);
        }
    }
    let place = |i: usize| {
        let normal = Vector2::new(-along[i].y, along[i].x);
        let to_bend = bends_mm.iter().map(|bend| (bend - ways_mm[i]).abs());
        Place {
            at: points[i].0,
            along: along[i],
            heading_rad: points[i].1,
            width_mm: 2.0 * aperture.extent_mm(points[i].1, normal),
            from_bend_mm: to_bend.fold(f64::INFINITY, f64::min),
        }
    };
    (0..=last).map(place).collect()
}

/// Distance, width and heading of the nearest place between the placements of passes that runs
/// along with this one; and how far it is from a corner.
fn fellow(place: &Place, passes: &[Vec<Place>]) -> Option<[f64; 4]> {
    let pairs = passes.iter().flat_map(|pass| pass.windows(2));
    let pairs = pairs.filter(|pair| pair[0].along.dot(&place.along).abs() > 0.9);
    let fellows = pairs.filter_map(|pair| {
        let step = pair[1].at - pair[0].at;
        let share = (place.at - pair[0].at).dot(&step) / step.norm_squared();
        let t = if share.is_finite() {
            share.clamp(0.0, 1.0)
        } else {
            0.0
        };
        let off_mm = (place.at - (pair[0].at + step * t)).norm();
        let mix = |p: f64, q: f64| p + t * (q - p);
        (off_mm < FELLOW_MM).then(|| {
            [
                off_mm,
                mix(pair[0].width_mm, pair[1].width_mm),
                mix(pair[0].heading_rad, pair[1].heading_rad),
                pair[0].from_bend_mm.min(pair[1].from_bend_mm),
            ]
        })
    });
    fellows.min_by(|p, q| p[0].total_cmp(&q[0]))
}

fn apart(own: &[Vec<Place>], noisy: &[Vec<Place>], aperture: &Aperture) -> Apart {
    let corners = L.map(|[x, y]| Point2::new(x, y));
    let is_far = |at: Point2| corners.iter().all(|c| (at - c).norm() > FROM_CORNERS_MM);
    let ends_mm = [aperture.minor_mm(), aperture.major_mm()].map(|half| 2.0 * half);
    let mut apart = Apart::default();
    let places = own.iter().flatten().filter(|place| is_far(place.at));
    for place in places.filter(|place| place.from_bend_mm >= FROM_BENDS_MM) {
        let Some([_, width_mm, heading_rad, from_bend_mm]) = fellow(place, noisy) else {
            apart.alone += 1;
            continue;
        };
        if from_bend_mm < FROM_BENDS_MM {
            continue;
        }
        apart.compared += 1;
        let off_mm = (width_mm - place.width_mm).abs();
        apart.width_mm = apart.width_mm.max(off_mm);
        apart.wider += usize::from(off_mm >= WIDTH_MM);
        if ends_mm
            .iter()
            .all(|end| (place.width_mm - end).abs() >= FROM_ENDS_MM)
        {
            apart.headings += 1;
            let turn_rad = aperture.wrapped_rad(heading_rad - place.heading_rad).abs();
            apart.heading_rad = apart.heading_rad.max(turn_rad);
            apart.turned += usize::from(turn_rad >= HEADING_RAD);
        }
    }
    apart
}

/// Goal: noise of 5 um changes few widths by more than 20 um away from corners. Method: an L, its
/// edges divided every 0.2 mm, with noise against without.
#[test]
fn invisible_noise_keeps_most_widths() {
    let settings = Settings::default();
    let clean = vec![L.to_vec()];
    let own = passes(&clean, &settings);
    let found: Vec<(usize, Apart)> = SEEDS
        .par_iter()
        .map(|&seed| {
            let noisy = passes(&with_noise(&clean, NOISE_MM, seed), &settings);
            (noisy.len(), apart(&own, &noisy, &settings.aperture))
        })
        .collect();
    for (seed, (passes, apart)) in SEEDS.iter().zip(&found) {
        println!("seed {seed}: {passes} passes, {apart:?}");
        assert_eq!(*passes, own.len(), "seed {seed}");
        // Some 3600 are that far from corners, 391 of them with a heading that counts.
        assert!(apart.compared > 2500, "seed {seed}: {apart:?}");
        assert!(apart.headings > 300, "seed {seed}: {apart:?}");
        assert!(apart.alone * 100 < apart.compared, "seed {seed}: {apart:?}");
        assert!(apart.width_mm < WIDTH_MAX_MM, "seed {seed}: {apart:?}");
        assert!(
            apart.wider * 100 <= apart.compared * WIDER_PCT_MAX,
            "seed {seed}: {apart:?}"
        );
    }
}
