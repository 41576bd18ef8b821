//! Oracle of the headings table: brute force over a grid of heading angles, on the example shapes.
//!
//! Shares no code with the planner: its own reader of the shapes, its own placement of the ellipse
//! (a dense outline pushed until its lowest point is the sample), its own containment (winding of
//! outline points, polygon vertices against the ellipse's equation), its own r (bisection).

use headway::geometry::aperture::Aperture;
use headway::geometry::polygon::{Region, Ring};
use headway::plan::headings::headings_table::{HeadingRow, HeadingsRequest, headings_table};
use headway::settings::{HeadingLaw, PassMode};
use rayon::prelude::*;

type Pair = [f64; 2];

const A: f64 = 0.6;
const B: f64 = 0.2;
/// Step of the grid of alpha: half of what `min_alpha_deg` may be off, see `min_alpha` below.
const STEP_DEG: f64 = 0.25;
/// Outline points; between two of them the ellipse bulges by less than 0.1 µm.
const OUTLINE: usize = 240;
/// How far an outline point may lie outside and still count as in contact: rounding.
const CONTACT_MM: f64 = 1e-7;

/// A shape as rings of points.
struct Shape {
    name: String,
    rings: Vec<Vec<Pair>>,
}

fn shapes() -> Vec<Shape> {
    let mut shapes = Vec::new();
    for name in ["u-part", "bracket", "gear", "taper", "letter", "thin-web"] {
        let path = format!("{}/../examples/{name}.json", env!("CARGO_MANIFEST_DIR"));
        let text = std::fs::read_to_string(&path).expect(&path);
        let json: serde_json::Value = serde_json::from_str(&text).expect(&path);
        assert_eq!(json["units"], "mm", "{path}");
        let ring = |value: &serde_json::Value| -> Vec<Pair> {
            serde_json::from_value(value.clone()).expect("a ring of points")
        };
        let mut rings = vec![ring(&json["exterior"])];
        rings.extend(json["holes"].as_array().expect("holes").iter().map(ring));
        shapes.push(Shape {
            name: name.to_string(),
            rings,
        });
    }
    // Sharp, reflex and narrow everywhere, far from the origin.
    let star = (0..26)
        .map(|i| {
            let (sin, cos) = (f64::from(i) * std::f64::consts::TAU / 26.0).sin_cos();
            let r = [4.0, 1.9, 3.1, 2.6][i as usize % 4];
            [2000.0 + r * cos, -700.0 + r * sin]
        })
        .collect();
    shapes.push(Shape {
        name: "star".to_string(),
        rings: vec![star],
    });
    shapes
}

impl Shape {
    fn region(&self) -> Region {
        let ring = |points: &Vec<Pair>| Ring {
            points: points
                .iter()
                .map(|p| headway::geometry::Point2::new(p[0], p[1]))
                .collect(),
        };
        Region {
            exterior: ring(&self.rings[0]),
            holes: self.rings[1..].iter().map(ring).collect(),
        }
    }

    /// Edges within `reach` of p, relative to p.
    fn edges_near(&self, p: Pair, reach: f64) -> Vec<[Pair; 2]> {
        let mut edges = Vec::new();
        for ring in &self.rings {
            for i in 0..ring.len() {
                let (q, r) = (ring[i], ring[(i + 1) % ring.len()]);
                let edge = [[q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]];
                if distance([0.0, 0.0], edge) <= reach {
                    edges.push(edge);
                }
            }
        }
        edges
    }
}

impl Shape {
    /// Even-odd containment.
    fn contains(&self, p: Pair) -> bool {
        let mut inside = false;
        for ring in &self.rings {
            for i in 0..ring.len() {
                let (q, r) = (ring[i], ring[(i + 1) % ring.len()]);
                if (q[1] > p[1]) != (r[1] > p[1]) {
                    inside ^= p[0] < q[0] + (p[1] - q[1]) / (r[1] - q[1]) * (r[0] - q[0]);
                }
            }
        }
        inside
    }
}

fn distance(p: Pair, [q, r]: [Pair; 2]) -> f64 {
    let d = [r[0] - q[0], r[1] - q[1]];
    let w = [p[0] - q[0], p[1] - q[1]];
    let t = ((w[0] * d[0] + w[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
    (w[0] - t * d[0]).hypot(w[1] - t * d[1])
}

/// Placement of the ellipse tangent at the origin with inward normal n: centre and outline.
fn placed(n: Pair, alpha: f64) -> (Pair, Vec<Pair>) {
    let phi = n[1].atan2(n[0]) + alpha;
    let (sin, cos) = phi.sin_cos();
    let at = |t: f64| {
        let (u, v) = (A * t.cos(), B * t.sin());
        [u * cos - v * sin, u * sin + v * cos]
    };
    let height = |t: f64| at(t)[0] * n[0] + at(t)[1] * n[1];
    // The lowest outline point: coarse, then a ternary search around it.
    let step = std::f64::consts::TAU / OUTLINE as f64;
    let lowest = (0..OUTLINE)
        .min_by(|&i, &j| height(i as f64 * step).total_cmp(&height(j as f64 * step)))
        .expect("points");
    let (mut low, mut high) = ((lowest as f64 - 1.0) * step, (lowest as f64 + 1.0) * step);
    for _ in 0..80 {
        let (s, t) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if height(s) < height(t) {
            high = t
        } else {
            low = s
        }
    }
    let touch = at((low + high) / 2.0);
    let center = [-touch[0], -touch[1]];
    let outline = (0..OUTLINE)
        .map(|i| {
            let q = at(i as f64 * step);
            [q[0] + center[0], q[1] + center[1]]
        })
        .collect();
    (center, outline)
}

/// By how much the placement is cut at worst, roughly in mm (negative: clear); own formulas.
fn cut(shape: &Shape, p: Pair, edges: &[[Pair; 2]], n: Pair, alpha: f64) -> f64 {
    let (center, outline) = placed(n, alpha);
    if !shape.contains([p[0] + center[0], p[1] + center[1]]) {
        return B;
    }
    let (sin, cos) = (n[1].atan2(n[0]) + alpha).sin_cos();
    let mut worst = f64::NEG_INFINITY;
    for edge in edges {
        for q in edge {
            // Depth of the vertex in the ellipse, by the ellipse's equation.
            let d = [q[0] - center[0], q[1] - center[1]];
            let (u, v) = (d[0] * cos + d[1] * sin, d[1] * cos - d[0] * sin);
            let inside = 1.0 - (u / A).hypot(v / B);
            // A vertex next to the contact is in contact itself.
            if q[0] * n[0] + q[1] * n[1] > CONTACT_MM {
                worst = worst.max(inside * B);
            }
        }
        // Depth of outline points beyond the edge, seen from the centre.
        let d = [edge[1][0] - edge[0][0], edge[1][1] - edge[0][1]];
        let length = d[0].hypot(d[1]);
        for q in &outline {
            let beyond = (d[1] * (q[0] - edge[0][0]) - d[0] * (q[1] - edge[0][1])) / length;
            let along = (d[0] * (q[0] - edge[0][0]) + d[1] * (q[1] - edge[0][1])) / length;
            // The way from centre to outline point must not cross the edge.
            let side = |p: Pair| d[1] * (p[0] - edge[0][0]) - d[0] * (p[1] - edge[0][1]);
            if beyond > worst
                && (0.0..=length).contains(&along)
                && (side(center) > 0.0) != (side(*q) > 0.0)
                && crosses(center, *q, edge)
            {
                worst = worst.max(beyond);
            }
        }
    }
    worst
}

fn crosses(c: Pair, q: Pair, [e, f]: &[Pair; 2]) -> bool {
    let side = |p: &Pair| (q[0] - c[0]) * (p[1] - c[1]) - (q[1] - c[1]) * (p[0] - c[0]);
    (side(e) > 0.0) != (side(f) > 0.0)
}

/// r by bisection: the largest disk tangent at the origin with no edge closer than its radius.
fn radius_by_bisection(shape: &Shape, p: Pair, n: Pair) -> f64 {
    let edges = shape.edges_near(p, f64::INFINITY);
    let fits = |r: f64| {
        let c = [n[0] * r, n[1] * r];
        edges
            .iter()
            .all(|e| distance(c, *e) >= r * (1.0 - 1e-12) - 1e-13)
    };
    let (mut low, mut high) = (0.0, 100.0);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if fits(middle) {
            low = middle
        } else {
            high = middle
        }
    }
    low
}

fn half_turn(alpha: f64) -> f64 {
    let pi = std::f64::consts::PI;
    (alpha + pi / 2.0).rem_euclid(pi) - pi / 2.0
}

/// What the oracle says of one row; panics where the table is wrong. Returns whether reachable and
/// whether it is a border case.
fn check(shape: &Shape, row: &HeadingRow, law: HeadingLaw, pass: PassMode) -> (bool, bool) {
    let (p, n) = ([row.point.x, row.point.y], [row.normal.x, row.normal.y]);
    let edges = shape.edges_near(p, 2.0 * A + 0.01);
    let place = format!("{} at {p:?}", shape.name);

    let r = radius_by_bisection(shape, p, n);
    assert!(
        (r - row.radius_mm).abs() < 1e-6,
        "{place}: r {r} {}",
        row.radius_mm
    );
    let expected = oracle_law(r, law, pass);
    let law_alpha = row.law_alpha_rad.to_degrees();
    assert!(
        (law_alpha - expected).abs() < 1e-3,
        "{place}: law {law_alpha} {expected}"
    );

    // The grid; a placement within a few µm of the border could fall to either side of it.
    let mut feasible = Vec::new();
    let mut nearly = false;
    let count = (180.0 / STEP_DEG) as i32;
    for k in 0..count {
        let alpha = (f64::from(k + 1) * STEP_DEG - 90.0).to_radians();
        let worst = cut(shape, p, &edges, n, alpha);
        if worst <= CONTACT_MM {
            feasible.push(alpha);
        }
        nearly |= worst <= B * STEP_DEG.to_radians();
    }
    let Some(choice) = row.reached else {
        assert!(
            feasible.is_empty(),
            "{place}: {} feasible headings",
            feasible.len()
        );
        return (false, nearly);
    };
    // The chosen one is in F(p): outline samples see all but 0.1 µm between them.
    let worst = cut(shape, p, &edges, n, choice.alpha_rad);
    assert!(
        worst <= CONTACT_MM,
        "{place}: cut by {worst} mm at the chosen heading"
    );
    let phi = n[1].atan2(n[0]) + choice.alpha_rad;
    assert!(
        half_turn(phi - choice.configuration.heading_rad).abs() < 1e-9,
        "{place}"
    );
    let (center, _) = placed(n, choice.alpha_rad);
    let off = (p[0] + center[0] - choice.configuration.center.x)
        .hypot(p[1] + center[1] - choice.configuration.center.y);
    assert!(off < 1e-6, "{place}: centre off by {off}");
    if feasible.is_empty() {
        // An interval narrower than the grid: that is the border case.
        return (true, true);
    }
    let min_alpha = feasible
        .iter()
        .map(|a| a.abs())
        .fold(f64::MAX, f64::min)
        .to_degrees();
    let found = choice.min_alpha_rad.to_degrees();
    assert!(
        (min_alpha - found).abs() <= 0.5,
        "{place}: min alpha {found}, grid {min_alpha}"
    );
    let off_law = |alpha: f64| {
        let wanted = row.law_alpha_rad;
        half_turn(alpha - wanted)
            .abs()
            .min(half_turn(alpha + wanted).abs())
    };
    let nearest = feasible
        .iter()
        .map(|a| off_law(*a))
        .fold(f64::MAX, f64::min);
    // The table's end of an interval is contact to 1e-7 rad; the oracle lets 1e-7 mm of cut pass,
    // and what bulges between its outline points, which makes less than half a step of the grid.
    let slack = STEP_DEG.to_radians() / 2.0;
    let off = off_law(choice.alpha_rad);
    assert!(
        off <= nearest + slack,
        "{place}: {off} from the law, grid {nearest}"
    );
    (true, false)
}

/// Weights and laws, written from the published formulas.
fn oracle_law(r: f64, law: HeadingLaw, pass: PassMode) -> f64 {
    let tangent = |e: f64| {
        ((e * e - B * B) / (A * A - B * B))
            .clamp(0.0, 1.0)
            .sqrt()
            .acos()
    };
    match (law, pass) {
        (_, PassMode::Two) if !(2.0 * B..=2.0 * A).contains(&r) => 0.0,
        (HeadingLaw::Tangent, PassMode::Two) => tangent(r / 2.0).to_degrees(),
        (HeadingLaw::Linear, PassMode::Two) => (1.0 - (r - 2.0 * B) / (2.0 * (A - B))) * 90.0,
        (HeadingLaw::Tangent, PassMode::One) => tangent(r.clamp(B, A)).to_degrees(),
        (HeadingLaw::Linear, PassMode::One) => (1.0 - ((r - B) / (A - B)).clamp(0.0, 1.0)) * 90.0,
    }
}

/// Goal: the table agrees with the oracle. Method: every few rows of each example against the oracle, for
/// both passes and both laws in turn.
#[test]
fn table_agrees_with_brute_force() {
    let settings = [
        (HeadingLaw::Tangent, PassMode::Two, 0.25),
        (HeadingLaw::Linear, PassMode::One, 0.9),
    ];
    for shape in shapes() {
        for (law, pass, spacing_mm) in settings {
            let request = HeadingsRequest {
                aperture: Aperture::Ellipse {
                    major_mm: A,
                    minor_mm: B,
                },
                spacing_mm,
                pass,
                law,
            };
            let rows = headings_table(&shape.region(), &request);
            let stride = rows.len().div_ceil(110);
            let results: Vec<(bool, bool)> = rows
                .par_iter()
                .step_by(stride)
                .map(|row| check(&shape, row, law, pass))
                .collect();
            let reached = results.iter().filter(|r| r.0).count();
            let border = results.iter().filter(|r| r.0 && r.1).count();
            println!(
                "{}: {} rows checked of {}, {reached} reachable, {border} narrower than the grid",
                shape.name,
                results.len(),
                rows.len()
            );
            assert!(
                results.len() >= 20 && reached * 2 > results.len(),
                "{}",
                shape.name
            );
            assert!(border * 20 <= results.len(), "border cases must be rare");
        }
    }
}

/// Goal: the same bytes whatever the number of threads. Method: one thread and three.
#[test]
fn table_does_not_depend_on_threads() {
    let shape = &shapes()[1];
    let request = HeadingsRequest {
        aperture: Aperture::Ellipse {
            major_mm: A,
            minor_mm: B,
        },
        spacing_mm: 0.4,
        pass: PassMode::Two,
        law: HeadingLaw::Tangent,
    };
    let text = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads");
        pool.install(|| {
            let mut out = Vec::new();
            let rows = headings_table(&shape.region(), &request);
            headway::plan::headings::headings_table::write_csv(&mut out, &rows).expect("memory");
            out
        })
    };
    let one = text(1);
    assert!(one.len() > 10_000);
    assert!(one == text(3));
}
