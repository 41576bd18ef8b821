//! How two edges meet: not at all, in a point, or along a common part.
//!
//! In: edges, mm. Out: [`Meeting`], decided by exact orientation predicates; only the position of a
//! crossing is rounded. Not covered: edges of length 0.

use super::Point2;
use super::edge_index::Edge;
use super::predicates::orientation;
use std::cmp::Ordering;

/// How two edges meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meeting {
    /// Apart.
    None,
    /// In one point that is an end of at least one of them.
    Touch(Point2),
    /// In one point inside both.
    Cross(Point2),
    /// Along a stretch, here its middle.
    Along(Point2),
}

/// How edges e and f meet, exactly (but for the rounding of a crossing point).
pub fn meeting(e: Edge, f: Edge) -> Meeting {
    let apart = |k: fn(&Point2) -> f64| {
        k(&e.a).max(k(&e.b)) < k(&f.a).min(k(&f.b)) || k(&f.a).max(k(&f.b)) < k(&e.a).min(k(&e.b))
    };
    if apart(|p| p.x) || apart(|p| p.y) {
        return Meeting::None;
    }
    let (fa, fb) = (orientation(e.a, e.b, f.a), orientation(e.a, e.b, f.b));
    let (ea, eb) = (orientation(f.a, f.b, e.a), orientation(f.a, f.b, e.b));
    if [fa, fb, ea, eb].iter().all(|o| o.is_eq()) {
        return meeting_on_line(e, f);
    }
    if fa == fb || ea == eb {
        return Meeting::None;
    }
    for (side, p) in [(fa, f.a), (fb, f.b), (ea, e.a), (eb, e.b)] {
        if side == Ordering::Equal {
            return Meeting::Touch(p);
        }
    }
    let (d, g) = (e.b - e.a, f.b - f.a);
    let t = (f.a - e.a).perp(&g) / d.perp(&g);
    Meeting::Cross(e.a + d * t.clamp(0.0, 1.0))
}

/// Both edges on one line: the stretch they share.
fn meeting_on_line(e: Edge, f: Edge) -> Meeting {
    let d = e.b - e.a;
    let key = |p: &Point2| if d.x.abs() >= d.y.abs() { p.x } else { p.y };
    let ordered = |g: Edge| {
        if key(&g.a) <= key(&g.b) {
            (g.a, g.b)
        } else {
            (g.b, g.a)
        }
    };
    let ((e0, e1), (f0, f1)) = (ordered(e), ordered(f));
    let low = if key(&e0) >= key(&f0) { e0 } else { f0 };
    let high = if key(&e1) <= key(&f1) { e1 } else { f1 };
    match key(&low).total_cmp(&key(&high)) {
        Ordering::Less => Meeting::Along(low + (high - low) / 2.0),
        Ordering::Equal => Meeting::Touch(low),
        Ordering::Greater => Meeting::None,
    }
}
