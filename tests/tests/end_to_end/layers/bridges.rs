//! Goal: what spans open space between two anchors is printed across it, from anchor to anchor, at the speed and
//! with the flow of its own, and nothing else is. Method: a table (two legs and a plate) turned about z, cut
//! by hand into layers; the finished stream over the gap by its own samples: directions, speeds, the volume
//! against the same plan at another flow. A shelf, held at one end, has no bridge. Spans of other sizes and angles
//! by a raster of the finished motion; the lid of an empty box.

use headway::geometry::Point2;
use headway::geometry::polygon::{Region, Ring};
use headway::job::MotionState;
use headway::mesh::layers::{SlicedPart, TargetLayer};
use headway::pipeline::layer_uses::Use;
use headway::pipeline::mesh::{FirstLayer, PartPlan, plan_part};
use headway::report::pose_table::{StreamSample, samples_within};
use headway::settings::kinds::{KindSettings, Kinds};
use headway::settings::{Infill, Settings};
use headway_protocol::units::{CHANNEL_HEADING, CHANNEL_VOLUME};

/// How the table lies, and where its gap is in its own frame: between the legs, inside the walls.
const TURN_DEG: f64 = 17.3;
const GAP_MM: [[f64; 2]; 2] = [[5.5, 2.0], [14.5, 6.0]];
/// Legs and plate, layers of 0.2 mm.
const LEG_LAYERS: u32 = 1;
const LAYERS: u32 = 3;
const SPEED_MM_S: f64 = 20.0;

fn turned(x: f64, y: f64, turn_deg: f64) -> Point2 {
    let (sin, cos) = turn_deg.to_radians().sin_cos();
    Point2::new(x * cos - y * sin, x * sin + y * cos)
}

fn box_of([x, y]: [f64; 2], [u, v]: [f64; 2]) -> Region {
    let corners = [[x, y], [u, y], [u, v], [x, v]];
    Region {
        exterior: Ring {
            points: corners.map(|[x, y]| turned(x, y, TURN_DEG)).to_vec(),
        },
        holes: Vec::new(),
    }
}

/// A plate of 20 x 8 mm on these legs.
fn table(legs: &[Region]) -> SlicedPart {
    let layers = (0..LAYERS).map(|number| TargetLayer {
        number,
        height_mm: 0.2,
        top_mm: 0.2 * f64::from(number + 1),
        regions: match number < LEG_LAYERS {
            true => legs.to_vec(),
            false => vec![box_of([0.0, 0.0], [20.0, 8.0])],
        },
    });
    SlicedPart {
        layers: layers.collect(),
        wanted: 0..LAYERS,
        notes: Vec::new(),
    }
}

fn legs() -> [Region; 2] {
    [
        box_of([0.0, 0.0], [4.0, 8.0]),
        box_of([16.0, 0.0], [20.0, 8.0]),
    ]
}

fn planned(part: &SlicedPart, density_pct: f64, bridge: KindSettings) -> PartPlan {
    let settings = Settings {
        infill: Some(Infill {
            density_pct,
            bottom_layers: Some(0),
            top_layers: Some(0),
            ..Infill::solid(1)
        }),
        kinds: Kinds {
            bridge,
            ..Kinds::default()
        },
        ..Settings::default()
    };
    plan_part(part, &[], FirstLayer::default(), &settings, &()).expect("a plan")
}

/// Samples of the beads over the middle of the gap on a layer.
fn over_gap(plan: &PartPlan, layer: u32) -> Vec<StreamSample> {
    let servo_hz = f64::from(Settings::default().machine.servo_hz);
    let [low, high] = GAP_MM;
    let ticks = plan.printed.stream.ticks_of_layer(layer);
    let is_in = |sample: &StreamSample| {
        let [x, y, _] = [0, 1, 2].map(|i| sample.position[i] - plan.transform.offset_mm[i]);
        let at = turned(x, y, -TURN_DEG);
        (low[0]..high[0]).contains(&at.x) && (low[1]..high[1]).contains(&at.y)
    };
    let samples = samples_within(&plan.printed.stream, servo_hz, 4.0, ticks);
    let prints = samples.filter(|sample| sample.mark.state == MotionState::Print);
    prints.filter(is_in).collect()
}

fn of_kind(plan: &PartPlan, what: Use) -> (f64, Vec<u32>) {
    let uses = plan.printed.uses.iter().filter(|used| used.what == what);
    let volume_mm3 = uses.clone().map(|used| used.volume_mm3).sum();
    (volume_mm3, uses.map(|used| used.layer).collect())
}

#[test]
fn a_bridge_goes_from_anchor_to_anchor_as_it_is_asked() {
    let part = table(&legs());
    let thin = KindSettings {
        speed_mm_s: Some(SPEED_MM_S),
        flow_factor: Some(0.8),
        ..KindSettings::default()
    };
    for density_pct in [20.0, 100.0] {
        let plan = planned(&part, density_pct, thin);
        let samples = over_gap(&plan, LEG_LAYERS);
        assert!(samples.len() > 200, "{}", samples.len());
        let (mut off_deg, mut fastest, mut rate_mm2) = (0.0f64, 0.0f64, Vec::new());
        for sample in &samples {
            let along_deg = sample.velocity[1].atan2(sample.velocity[0]).to_degrees();
            let off = (along_deg - TURN_DEG).rem_euclid(180.0);
            off_deg = off_deg.max(off.min(180.0 - off));
            fastest = fastest.max(sample.speed_mm_s());
            rate_mm2.push(sample.velocity[CHANNEL_VOLUME] / sample.speed_mm_s());
        }
        println!(
            "{density_pct} %: {off_deg:.4} deg, {fastest:.2} mm/s, {} samples",
            samples.len()
        );
        assert!(off_deg < 1.0, "{off_deg}");
        // The plan's share of what is asked.
        let asked = SPEED_MM_S * Settings::default().plan_share;
        assert!(
            fastest <= asked * 1.001 && fastest > 0.98 * asked,
            "{fastest}"
        );
        // Only the layer over the gap is bridged.
        let (thin_mm3, layers) = of_kind(&plan, Use::Bridge);
        assert_eq!(layers, [LEG_LAYERS]);
        // The bead over the gap: rows tile what the walls leave, so that width times height is asked.
        let mean_mm2 = rate_mm2.iter().sum::<f64>() / rate_mm2.len() as f64;
        let width_mm = mean_mm2 / (0.8 * 0.2);
        assert!((0.4..=1.201).contains(&width_mm), "{width_mm}");
        // The layer above lies on it.
        let above = over_gap(&plan, LEG_LAYERS + 1);
        let fastest_above = above
            .iter()
            .map(StreamSample::speed_mm_s)
            .fold(0.0, f64::max);
        assert!(fastest_above > 1.5 * SPEED_MM_S, "{fastest_above}");
        if density_pct < 100.0 {
            continue;
        }
        let full = planned(&part, density_pct, KindSettings::default());
        let (full_mm3, _) = of_kind(&full, Use::Bridge);
        assert!(
            (thin_mm3 / full_mm3 - 0.8).abs() < 1e-4,
            "{thin_mm3} {full_mm3}"
        );
        for what in [Use::Walls, Use::Solid, Use::Sparse] {
            let [thin, full] = [&plan, &full].map(|plan| of_kind(plan, what).0);
            assert!(
                (thin - full).abs() < 1e-6 * full.max(1.0),
                "{what:?}: {thin} {full}"
            );
        }
    }
}

#[test]
fn what_is_held_at_one_end_is_no_bridge() {
    let shelf = table(&legs()[..1]);
    let plan = planned(&shelf, 20.0, KindSettings::default());
    assert!(of_kind(&plan, Use::Bridge).1.is_empty());
    assert!(plan.overhangs[LEG_LAYERS as usize].area_mm2 > 100.0);
}

/// A plate on two piers: the span, its width, how it is turned, in mm and degrees.
#[derive(Clone, Copy, Debug)]
struct Span {
    length_mm: f64,
    width_mm: f64,
    turn_deg: f64,
}

/// What lies on either side of a span, mm.
const PIER_MM: f64 = 4.0;

impl Span {
    fn part(self) -> SlicedPart {
        let Span {
            length_mm,
            width_mm,
            turn_deg,
        } = self;
        let end_mm = 2.0 * PIER_MM + length_mm;
        let strip = |from: f64, to: f64| {
            let corners = [[from, 0.0], [to, 0.0], [to, width_mm], [from, width_mm]];
            Region {
                exterior: Ring {
                    points: corners.map(|[x, y]| turned(x, y, turn_deg)).to_vec(),
                },
                holes: Vec::new(),
            }
        };
        let layer = |number: u32, regions: Vec<Region>| TargetLayer {
            number,
            height_mm: 0.2,
            top_mm: 0.2 * f64::from(number + 1),
            regions,
        };
        let piers = vec![strip(0.0, PIER_MM), strip(end_mm - PIER_MM, end_mm)];
        SlicedPart {
            layers: vec![layer(0, piers), layer(1, vec![strip(0.0, end_mm)])],
            // The bridge alone is planned.
            wanted: 1..2,
            notes: Vec::new(),
        }
    }

    /// Share of the span that no pose of the finished motion covers, walls over it included, and bridge beads
    /// that end in mid-air.
    fn open_share(self, plan: &PartPlan) -> (f64, usize) {
        const CELL_MM: f64 = 0.05;
        let settings = Settings::default();
        let (a, b) = (settings.aperture.major_mm(), settings.aperture.minor_mm());
        let count = |mm: f64| (mm / CELL_MM).round() as usize;
        let (columns, rows) = (count(self.length_mm), count(self.width_mm));
        let mut is_covered = vec![false; columns * rows];
        let servo_hz = f64::from(settings.machine.servo_hz);
        let ticks = plan.printed.stream.ticks_of_layer(1);
        let samples = samples_within(&plan.printed.stream, servo_hz, 1.0, ticks);
        let in_air = |at: Point2| {
            let inside = |v: f64, to: f64| v > 2.0 * b && v < to - 2.0 * b;
            inside(at.x, self.length_mm) && inside(at.y, self.width_mm)
        };
        let (mut ends, mut last): (usize, Option<(u32, Point2)>) = (0, None);
        for sample in samples.filter(|s| s.mark.state == MotionState::Print) {
            let [x, y, _] = [0, 1, 2].map(|i| sample.position[i] - plan.transform.offset_mm[i]);
            let at = turned(x, y, -self.turn_deg) - nalgebra::Vector2::new(PIER_MM, 0.0);
            let heading_rad = sample.position[CHANNEL_HEADING] - self.turn_deg.to_radians();
            let (sin, cos) = heading_rad.sin_cos();
            let span = |at_mm: f64, most: usize| {
                let [low, high] = [at_mm - a, at_mm + a].map(|mm| (mm / CELL_MM).max(0.0) as usize);
                low..(high + 1).min(most)
            };
            for row in span(at.y, rows) {
                for column in span(at.x, columns) {
                    let [u, v] = [(column, at.x), (row, at.y)]
                        .map(|(cell, middle)| (cell as f64 + 0.5) * CELL_MM - middle);
                    let (along, across) = (u * cos + v * sin, v * cos - u * sin);
                    is_covered[row * columns + column] |=
                        (along / a).powi(2) + (across / b).powi(2) <= 1.0;
                }
            }
            let pass = sample.mark.pass.unwrap_or_default();
            match last {
                Some((known, end)) if known != pass => {
                    ends += usize::from(in_air(end)) + usize::from(in_air(at));
                }
                None => ends += usize::from(in_air(at)),
                _ => {}
            }
            last = Some((pass, at));
        }
        ends += usize::from(last.is_some_and(|(_, end)| in_air(end)));
        let open = is_covered.iter().filter(|covered| !**covered).count();
        (open as f64 / is_covered.len() as f64, ends)
    }
}

/// Goal: every row of a bridge goes from pier to pier, and no more of the span than 1 % stays open; what
/// does is reported, and a bridge does not hang. Method: a raster of the finished motion, which the planner's
/// figures have no part in.
fn spans_are_closed(spans: &[Span]) {
    for &span in spans {
        let plan = planned(&span.part(), 20.0, KindSettings::default());
        let (open_share, ends) = span.open_share(&plan);
        let span_mm2 = span.length_mm * span.width_mm;
        let told_mm2: f64 = plan.printed.open.iter().map(|piece| piece.area_mm2).sum();
        println!(
            "{span:?}: {:.3} % open, {:.2} mm² told, {ends} ends in mid-air",
            100.0 * open_share,
            told_mm2
        );
        assert!(open_share <= 0.01, "{span:?}: {open_share}");
        assert_eq!(ends, 0, "{span:?}");
        // Cells of the raster at the border of what is covered.
        assert!(told_mm2 > 0.5 * open_share * span_mm2 - 0.2, "{told_mm2}");
        let hanging_mm2 = plan.overhangs[1].area_mm2;
        assert!(hanging_mm2 < 1e-3, "{span:?}: {hanging_mm2}");
    }
}

fn span(length_mm: f64, width_mm: f64, turn_deg: f64) -> Span {
    Span {
        length_mm,
        width_mm,
        turn_deg,
    }
}

#[test]
fn spans_are_closed_from_pier_to_pier() {
    spans_are_closed(&[span(20.0, 12.0, 0.0), span(8.0, 5.0, 17.3)]);
}

#[test]
#[ignore = "a minute: cargo test -p headway-tests --test end_to_end -- --ignored twelve_spans"]
fn twelve_spans_at_four_angles_are_closed() {
    let sizes = [[20.0, 12.0], [30.0, 12.0], [8.0, 5.0]];
    let angles = [0.0, 17.3, 45.0, 90.0];
    let all = sizes.iter().flat_map(|[length, width]| {
        let turned = move |turn_deg| span(*length, *width, turn_deg);
        angles.map(turned)
    });
    spans_are_closed(&all.collect::<Vec<_>>());
}

/// Goal: the first solid layer over a sparse or empty inside is a bridge, and nothing of it hangs; over lines that cover
/// half the ground it is laid as everywhere else. Method: the lid of a box of 12 mm, alone; its kinds, what
/// stays open of it.
#[test]
fn a_roof_over_nothing_is_a_bridge() {
    let layers = (0..4).map(|number| TargetLayer {
        number,
        height_mm: 0.2,
        top_mm: 0.2 * f64::from(number + 1),
        regions: vec![box_of([0.0, 0.0], [12.0, 12.0])],
    });
    let part = SlicedPart {
        layers: layers.collect(),
        wanted: 3..4,
        notes: Vec::new(),
    };
    for (density_pct, is_bridge) in [(0.0, true), (15.0, true), (20.0, true), (50.0, false)] {
        let settings = Settings {
            infill: Some(Infill {
                density_pct,
                bottom_layers: Some(1),
                top_layers: Some(1),
                ..Infill::solid(1)
            }),
            ..Settings::default()
        };
        let plan = plan_part(&part, &[], FirstLayer::default(), &settings, &()).expect("a plan");
        let [bridge_mm3, solid_mm3] = [Use::Bridge, Use::Solid].map(|kind| of_kind(&plan, kind).0);
        // One wall of 1.2 mm leaves 9.6 mm.
        let inside_mm3 = 9.6 * 9.6 * 0.2;
        let [laid_mm3, other_mm3] = match is_bridge {
            true => [bridge_mm3, solid_mm3],
            false => [solid_mm3, bridge_mm3],
        };
        println!("{density_pct} %: {bridge_mm3:.2} and {solid_mm3:.2} mm³ of {inside_mm3:.2}");
        assert!(laid_mm3 > 0.9 * inside_mm3, "{density_pct}: {laid_mm3}");
        assert!(other_mm3 < 0.05 * inside_mm3, "{density_pct}: {other_mm3}");
        assert!(plan.overhangs[3].area_mm2 < 1e-3);
        // Places that are no specks: corners that no bead reaches, and what is left along a wall, are.
        let open_mm2 = plan.open_mm2;
        assert!(open_mm2 < 0.01 * 144.0, "{density_pct}: {open_mm2}");
    }
}

/// Ground that a layer covers, in cells about the machine's origin.
struct Covered {
    cells: std::collections::HashSet<[i32; 2]>,
}

/// How the roof of a box lies on the layer below: passes and turns in mid-air, and the longest way over nothing.
#[derive(Debug, Default)]
struct Roof {
    ends_in_air: usize,
    bent_in_air: usize,
    spans: usize,
    longest_mm: f64,
}

impl Covered {
    const CELL_MM: f64 = 0.1;

    /// The cells of the nozzle at a pose.
    fn nozzle(sample: &StreamSample) -> impl Iterator<Item = [i32; 2]> + use<> {
        let aperture = Settings::default().aperture;
        let (a, b) = (aperture.major_mm(), aperture.minor_mm());
        let [x, y, _] = [0, 1, 2].map(|i| sample.position[i]);
        let (sin, cos) = sample.position[CHANNEL_HEADING].sin_cos();
        let reach = (a / Self::CELL_MM).ceil() as i32 + 1;
        let [column, row] = [x, y].map(|mm| (mm / Self::CELL_MM).floor() as i32);
        let near = (-reach..=reach).flat_map(move |i| (-reach..=reach).map(move |j| [i, j]));
        near.map(move |[i, j]| [column + i, row + j])
            .filter(move |[column, row]| {
                let [u, v] = [(*column, x), (*row, y)]
                    .map(|(cell, middle)| (f64::from(cell) + 0.5) * Self::CELL_MM - middle);
                let (along, across) = (u * cos + v * sin, v * cos - u * sin);
                (along / a).powi(2) + (across / b).powi(2) <= 1.0
            })
    }

    fn by(plan: &PartPlan, layer: u32) -> Covered {
        let servo_hz = f64::from(Settings::default().machine.servo_hz);
        let ticks = plan.printed.stream.ticks_of_layer(layer);
        let samples = samples_within(&plan.printed.stream, servo_hz, 1.0, ticks);
        let prints = samples.filter(|sample| sample.mark.state == MotionState::Print);
        Covered {
            cells: prints.flat_map(|sample| Self::nozzle(&sample)).collect(),
        }
    }

    /// True if the bead at a pose is on something, or beside it by a cell.
    fn holds(&self, sample: &StreamSample) -> bool {
        Self::nozzle(sample).any(|[column, row]| {
            let mut near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [column + i, row + j]));
            near.any(|cell| self.cells.contains(&cell))
        })
    }

    /// The ways of a layer's bridge passes over nothing.
    fn roof(&self, plan: &PartPlan, layer: u32) -> Roof {
        let servo_hz = f64::from(Settings::default().machine.servo_hz);
        let ticks = plan.printed.stream.ticks_of_layer(layer);
        let samples = samples_within(&plan.printed.stream, servo_hz, 1.0, ticks);
        let is_roof = |sample: &StreamSample| {
            let pass = sample.mark.pass.unwrap_or_default() as usize;
            sample.mark.state == MotionState::Print
                && (plan.printed.pass_uses.get(pass)).is_some_and(|own| own.first == Use::Bridge)
        };
        let mut passes: Vec<(u32, Vec<(Point2, bool)>)> = Vec::new();
        for sample in samples.filter(is_roof) {
            let pass = sample.mark.pass.unwrap_or_default();
            let at = Point2::new(sample.position[0], sample.position[1]);
            let place = (at, self.holds(&sample));
            match passes.last_mut() {
                Some((known, path)) if *known == pass => path.push(place),
                _ => passes.push((pass, vec![place])),
            }
        }
        let mut roof = Roof::default();
        for (_, path) in &passes {
            let (path, is_held): (Vec<Point2>, Vec<bool>) = path.iter().copied().unzip();
            let ends = [is_held.first(), is_held.last()];
            roof.ends_in_air += ends.into_iter().flatten().filter(|held| !**held).count();
            let mut at = 0;
            while at < path.len() {
                let end = (at..path.len()).find(|&i| is_held[i] != is_held[at]);
                let end = end.unwrap_or(path.len());
                if !is_held[at] {
                    let way_mm: f64 = path[at..end].windows(2).map(|w| (w[1] - w[0]).norm()).sum();
                    let chord_mm = (path[end - 1] - path[at]).norm();
                    roof.spans += 1;
                    roof.longest_mm = roof.longest_mm.max(way_mm);
                    roof.bent_in_air += usize::from(way_mm > 1.01 * chord_mm + 0.05);
                }
                at = end;
            }
        }
        roof
    }
}

/// Goal: every line of a roof is held at both its ends, and from wall to wall goes straight from one to the other; what it
/// spans is no more than the gap of the infill below, or the box from wall to wall. Method: a box of 20 mm at four
/// densities; a raster of the finished motion of the layer below, and the finished motion of the roof over it.
#[test]
fn every_line_of_a_roof_is_held_at_both_ends() {
    let layers = (0..4).map(|number| TargetLayer {
        number,
        height_mm: 0.2,
        top_mm: 0.2 * f64::from(number + 1),
        regions: vec![box_of([0.0, 0.0], [20.0, 20.0])],
    });
    let part = SlicedPart {
        layers: layers.collect(),
        wanted: 2..4,
        notes: Vec::new(),
    };
    // Walls of 2.4 mm leave 15.2 mm.
    for (density_pct, most_mm) in [(0.0, 15.2), (5.0, 15.2), (15.0, 6.8), (20.0, 4.8)] {
        let settings = Settings {
            infill: Some(Infill {
                density_pct,
                bottom_layers: Some(1),
                top_layers: Some(1),
                ..Infill::solid(2)
            }),
            ..Settings::default()
        };
        let plan = plan_part(&part, &[], FirstLayer::default(), &settings, &()).expect("a plan");
        let roof = Covered::by(&plan, 2).roof(&plan, 3);
        println!("{density_pct} %: {roof:?}");
        assert!(roof.spans >= 10, "{density_pct}: {roof:?}");
        assert_eq!(roof.ends_in_air, 0, "{density_pct}: {roof:?}");
        // From wall to wall all lines are straight; what fills the corners beyond the last line below may turn there.
        if density_pct < 10.0 {
            assert_eq!(roof.bent_in_air, 0, "{density_pct}: {roof:?}");
        }
        assert!(roof.longest_mm <= most_mm, "{density_pct}: {roof:?}");
        let open_mm2 = plan
            .printed
            .open
            .first()
            .map_or(0.0, |piece| piece.area_mm2);
        assert!(open_mm2 < 0.2, "{density_pct}: {open_mm2}");
        assert_eq!(plan.roofs.wide, []);
    }
}
