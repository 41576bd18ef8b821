//! The two example figures of the method that the planner follows (an ellipse turned by the medial
//! axis), drawn anew and measured: fewer loops than a round nozzle needs, and a narrowing passage in
//! two passes and in one.

use headway::geometry::Point2;
use headway::geometry::aperture::Aperture;
use headway::input::Target;
use headway::plan::pass::{LayerPass, Placement};
use headway::plan_target;
use headway::settings::{Quality, Settings};
use headway_tests::beads;
use headway_tests::outlines::region;

const ELLIPSE: Aperture = Aperture::Ellipse {
    major_mm: 0.6,
    minor_mm: 0.2,
};
const ROUND: Aperture = Aperture::Ellipse {
    major_mm: 0.2,
    minor_mm: 0.2,
};

/// The passes of an outline before they are ordered, joined and filled up.
fn plain_passes(outline: &[[f64; 2]], aperture: Aperture, one_pass: bool) -> Vec<LayerPass> {
    beads::plain_passes(&vec![outline.to_vec()], aperture, one_pass).1
}

/// Covered share of what is reachable, per cent, and the number of passes of the finished plan.
fn planned(outline: &[[f64; 2]], aperture: Aperture) -> (f64, usize) {
    let target = Target {
        name: "figure".to_string(),
        regions: vec![region(&vec![outline.to_vec()])],
    };
    // The figure is about what the beads can cover, not about what covering is worth.
    let settings = Settings {
        aperture,
        quality: Quality::Fine,
        ..Settings::default()
    };
    let figures = plan_target(&target, &settings).expect("a plan").figures;
    (figures.covered_of_reachable_pct, figures.passes)
}

/// A contour 5.4 mm wide whose middle narrows smoothly to `waist_mm`, 36 mm long.
fn waisted(waist_mm: f64) -> Vec<[f64; 2]> {
    let half = |x: f64| {
        let t = (1.0 - (x.abs() - 4.0) / 4.0).clamp(0.0, 1.0);
        let share = t * t * (3.0 - 2.0 * t);
        2.7 + (0.5 * waist_mm - 2.7) * share
    };
    let xs: Vec<f64> = (0..=360).map(|i| -18.0 + 0.1 * f64::from(i)).collect();
    let below = xs.iter().map(|&x| [x, -half(x)]);
    let above = xs.iter().rev().map(|&x| [x, half(x)]);
    below.chain(above).collect()
}

/// Placements with x in a range, with the extent across the passage that each really has.
fn across(passes: &[LayerPass], x_mm: [f64; 2]) -> Vec<(Placement, f64)> {
    let placements = passes.iter().flat_map(|pass| &pass.placements);
    placements
        .filter(|p| (x_mm[0]..=x_mm[1]).contains(&p.at.center.x))
        .map(|p| {
            let up = headway::geometry::Vector2::y();
            (*p, ELLIPSE.extent_mm(p.at.heading_rad, up))
        })
        .collect()
}

/// Goal: the first figure: where a round nozzle as wide as the ellipse is thin needs seven loops,
/// the turned ellipse needs three, and covers more; both go through the narrower passage. Method:
/// loops are counted before they are joined; the coverage is that of the finished plan.
#[test]
fn seven_loops_against_three() {
    let outline = waisted(1.6);
    let loops = |aperture| {
        let passes = plain_passes(&outline, aperture, false);
        passes.iter().map(|pass| pass.channel).max()
    };
    assert_eq!((loops(ROUND), loops(ELLIPSE)), (Some(7), Some(3)));
    let ((round_pct, round), (turned_pct, turned)) =
        (planned(&outline, ROUND), planned(&outline, ELLIPSE));
    println!("round {round_pct:.2} % in {round}, turned {turned_pct:.2} % in {turned}");
    assert!(turned_pct > 99.3 && turned_pct > round_pct && turned <= round);
}

/// Goal: the second figure, left: a passage between the minor and the major diameter wide is
/// resolved in two passes, each tangent to its wall and to the medial axis. Method: the extents of
/// the placements in the waist.
#[test]
fn a_narrowing_passage_in_two_passes() {
    let found = across(&plain_passes(&waisted(1.6), ELLIPSE, false), [-2.0, 2.0]);
    let sides = [-1.0, 1.0].map(|side| {
        let own = found.iter().filter(|(p, _)| p.at.center.y * side > 0.0);
        own.count()
    });
    assert!(sides[0] > 20 && sides[1] > 20, "{sides:?}");
    let mut worst_mm = 0.0_f64;
    for (placement, extent_mm) in found {
        let y = placement.at.center.y.abs();
        worst_mm = worst_mm.max((y - extent_mm).abs());
        assert!(
            (y + extent_mm - 0.8).abs() < 0.01,
            "off the wall: {placement:?}"
        );
    }
    println!("off the axis by {worst_mm:.4} mm at worst");
    // The innermost beads then lie over each other by 0.08 mm at one place.
    assert!(worst_mm < 0.045, "off the axis by {worst_mm}");
}

/// Goal: the second figure, right: a passage narrower than the major diameter is resolved in one
/// pass on the medial axis that touches both walls; at its two ends, where the loops of the wide
/// parts turn back, ground stays unresolved, and the finished plan fills most of it. Method: the
/// placements in the waist; open cells of a raster, counted here.
#[test]
fn a_narrowing_passage_in_one_pass() {
    let outline = waisted(0.8);
    let passes = plain_passes(&outline, ELLIPSE, true);
    let found = across(&passes, [-2.0, 2.0]);
    assert!(found.len() > 20);
    for (placement, extent_mm) in &found {
        assert!(
            placement.at.center.y.abs() < 0.01,
            "off the axis: {placement:?}"
        );
        assert!(
            (extent_mm - 0.4).abs() < 0.02,
            "off the walls: {placement:?}"
        );
    }
    let ends = [[-9.0, -3.0], [3.0, 9.0]].map(|x| open_mm2(&outline, &passes, x));
    let middle = open_mm2(&outline, &passes, [-3.0, 3.0]);
    let (covered_pct, _) = planned(&outline, ELLIPSE);
    println!(
        "open at the ends {ends:.3?} mm², between them {middle:.3}; finished {covered_pct:.2} %"
    );
    assert!(
        ends.iter()
            .all(|open| *open > 0.05 && *open > 10.0 * middle)
    );
    assert!(covered_pct > 98.5);
}

/// Ground of the outline in a range of x, more than 0.03 mm from its walls, that no placement
/// covers, mm².
fn open_mm2(outline: &[[f64; 2]], passes: &[LayerPass], x_mm: [f64; 2]) -> f64 {
    const CELL_MM: f64 = 0.02;
    let inside = |p: Point2| {
        let edge = |i: usize| (outline[i], outline[(i + 1) % outline.len()]);
        let crossings = (0..outline.len()).map(edge).filter(|([ax, ay], [bx, by])| {
            (*ay > p.y) != (*by > p.y) && p.x < ax + (p.y - ay) / (by - ay) * (bx - ax)
        });
        crossings.count() % 2 == 1
    };
    let near = |p: &&Placement| (x_mm[0] - 1.0..=x_mm[1] + 1.0).contains(&p.at.center.x);
    let poses: Vec<&[Placement]> = passes
        .iter()
        .flat_map(|pass| pass.placements.windows(2))
        .collect();
    // Between two placements the aperture is taken at eight places: they are 0.1 mm apart.
    let between = poses.iter().filter(|w| near(&&w[0])).flat_map(|w| {
        (0..8).map(move |k| {
            let t = f64::from(k) / 8.0;
            let center = w[0].at.center + (w[1].at.center - w[0].at.center) * t;
            let turn = ELLIPSE.wrapped_rad(w[1].at.heading_rad - w[0].at.heading_rad);
            (center, w[0].at.heading_rad + turn * t)
        })
    });
    let between: Vec<(Point2, f64)> = between.collect();
    let columns = ((x_mm[1] - x_mm[0]) / CELL_MM) as usize;
    let rows = (5.6 / CELL_MM) as usize;
    let place = |i: usize, j: usize| {
        let at = |k: usize| (k as f64 + 0.5) * CELL_MM;
        Point2::new(x_mm[0] + at(i), -2.8 + at(j))
    };
    let cells = (0..columns).flat_map(|i| (0..rows).map(move |j| (i, j)));
    let open = cells.map(|(i, j)| place(i, j)).filter(|&p| {
        inside(Point2::new(p.x, p.y + 0.03))
            && inside(Point2::new(p.x, p.y - 0.03))
            && !between
                .iter()
                .any(|(c, heading)| ELLIPSE.contains(*heading, p - c))
    });
    open.count() as f64 * CELL_MM * CELL_MM
}
