//! Solid parts: brackets, plates, gears, tools.

use super::Sizes;
use super::drawing::{
    Outline, Pair, arc, band, bar, circle, cut, joined, polar, rectangle, regular,
    rounded_rectangle, slot, stroke, wedge,
};
use headway::geometry::boolean::difference;
use headway::geometry::polygon::Region;
use std::f64::consts::{PI, TAU};

/// A star with or without a hole in its middle.
pub(super) fn star_plate(sizes: &mut Sizes) -> Vec<Region> {
    let points = sizes.whole(5, 12);
    let outer = sizes.between(8.0, 45.0);
    let inner = outer * sizes.between(0.35, 0.75);
    let angle = |i: usize| PI * i as f64 / points as f64;
    let star = (0..2 * points)
        .map(|i| polar([0.0; 2], if i % 2 == 0 { outer } else { inner }, angle(i)))
        .collect();
    let hole = circle([0.0; 2], inner * sizes.between(0.2, 0.6));
    let holes = if sizes.coin() { vec![hole] } else { Vec::new() };
    cut(&[star], &holes)
}

/// Teeth on a back, straight or tapered.
pub(super) fn comb_plate(sizes: &mut Sizes) -> Vec<Region> {
    let teeth = sizes.whole(4, 16);
    let width = sizes.between(0.9, 3.5);
    let gap = sizes.between(0.8, 3.5);
    let height = sizes.between(5.0, 25.0);
    let back = sizes.between(2.5, 9.0);
    let tip = width * sizes.between(0.5, 1.0);
    let pitch = width + gap;
    let length = (teeth as f64 * pitch - gap).max(8.0);
    let mut outlines = vec![rectangle([0.0, -back], [length, 0.0])];
    outlines.extend((0..teeth).map(|i| {
        let x = i as f64 * pitch + 0.5 * width;
        wedge([x, -0.5 * back], [x, height], width, tip)
    }));
    cut(&outlines, &[])
}

/// A spur gear with a bore, a keyway and perhaps lightening holes.
pub(super) fn gear(sizes: &mut Sizes) -> Vec<Region> {
    let teeth = sizes.whole(10, 44);
    let module = sizes.between(0.8, 2.4);
    let radius = 0.5 * module * teeth as f64;
    let pitch = TAU / teeth as f64;
    let profile = [(-1.25, -0.34), (0.0, -0.25), (1.0, -0.12)];
    let mut ring = Outline::new();
    for tooth in 0..teeth {
        let middle = tooth as f64 * pitch;
        let flank = |&(height, share): &(f64, f64), side: f64| {
            polar(
                [0.0; 2],
                radius + height * module,
                middle - side * share * pitch,
            )
        };
        ring.extend(profile.iter().map(|p| flank(p, -1.0)));
        ring.extend(profile.iter().rev().map(|p| flank(p, 1.0)));
    }
    ring.reverse();
    let root = radius - 1.25 * module;
    let bore = root * sizes.between(0.15, 0.35);
    let mut cuts = vec![
        circle([0.0; 2], bore),
        rectangle([0.0, -0.25 * bore], [1.3 * bore, 0.25 * bore]),
    ];
    let count = sizes.whole(3, 6);
    let hole = root * sizes.between(0.1, 0.18);
    if sizes.coin() {
        cuts.extend(
            regular([0.0; 2], 0.68 * root, count, 0.4)
                .iter()
                .map(|c| circle(*c, hole)),
        );
    }
    cut(&[ring], &cuts)
}

/// An angle bracket with a gusset, screw holes in one arm and a slot in the other.
pub(super) fn bracket(sizes: &mut Sizes) -> Vec<Region> {
    let [length, height] = [sizes.between(15.0, 70.0), sizes.between(15.0, 70.0)];
    let width = sizes.between(4.0, 12.0).min(0.4 * length.min(height));
    let gusset = sizes.between(0.2, 1.0) * (length.min(height) - width);
    let outlines = vec![
        rounded_rectangle([0.0; 2], [length, width], 0.2 * width),
        rounded_rectangle([0.0; 2], [width, height], 0.2 * width),
        vec![
            [0.8 * width, 0.8 * width],
            [width + gusset, 0.8 * width],
            [0.8 * width, width + gusset],
        ],
    ];
    let hole = sizes.between(0.15, 0.35) * width;
    let count = sizes.whole(1, 3);
    let x = |i: usize| {
        width + (length - 1.6 * width) * (i as f64 + 0.8) / count as f64
            - 0.1 * length / count as f64
    };
    let mut cuts: Vec<Outline> = (0..count)
        .map(|i| circle([x(i).min(length - 0.5 * width), 0.5 * width], hole))
        .collect();
    let [from, to] = [
        height - width * sizes.between(1.2, 2.0),
        height - 0.6 * width,
    ];
    cuts.push(slot(
        [0.5 * width, from],
        [0.5 * width, to],
        width * sizes.between(0.2, 0.5),
    ));
    cut(&outlines, &cuts)
}

/// A plate with round holes of several sizes wherever there is room.
pub(super) fn plate_with_holes(sizes: &mut Sizes) -> Vec<Region> {
    let high = [sizes.between(15.0, 70.0), sizes.between(12.0, 50.0)];
    let wall = sizes.between(0.7, 3.0);
    let widest = sizes.between(1.0, 5.0);
    let mut holes: Vec<(Pair, f64)> = Vec::new();
    for _ in 0..sizes.whole(20, 300) {
        let radius = widest * sizes.between(0.3, 1.0);
        let room = radius + wall;
        let at = high.map(|h| sizes.between(room, h - room));
        let apart = |(c, r): &(Pair, f64)| (c[0] - at[0]).hypot(c[1] - at[1]) > r + room;
        if holes.iter().all(apart) {
            holes.push((at, radius));
        }
    }
    let cuts: Vec<Outline> = holes.iter().map(|(at, r)| circle(*at, *r)).collect();
    cut(&[rounded_rectangle([0.0; 2], high, wall)], &cuts)
}

/// A plate to hang on screws: round holes that run out into slots.
pub(super) fn keyhole_plate(sizes: &mut Sizes) -> Vec<Region> {
    let count = sizes.whole(1, 4);
    let head = sizes.between(1.5, 5.0);
    let neck = head * sizes.between(0.8, 1.3);
    let length = head * sizes.between(1.5, 3.0);
    let rim = sizes.between(1.2, 6.0);
    let pitch = 2.0 * head + rim;
    let high = [
        count as f64 * pitch + rim + 4.0,
        2.0 * (head + rim) + length,
    ];
    let centers = (0..count).map(|i| [rim + 2.0 + head + i as f64 * pitch, rim + head]);
    let cuts: Vec<Outline> = centers
        .flat_map(|c| [circle(c, head), slot(c, [c[0], c[1] + length], neck)])
        .collect();
    cut(&[rounded_rectangle([0.0; 2], high, 0.8 * rim)], &cuts)
}

/// A hinge's leaf: knuckles along one side, countersunk screws in the other.
pub(super) fn hinge_leaf(sizes: &mut Sizes) -> Vec<Region> {
    let knuckles = sizes.whole(2, 5);
    let pitch = sizes.between(3.0, 11.0);
    let play = sizes.between(0.1, 0.4);
    let depth = sizes.between(3.0, 9.0);
    let leaf = sizes.between(8.0, 35.0);
    let high = [(2 * knuckles - 1) as f64 * pitch, leaf];
    let mut outlines = vec![rounded_rectangle([0.0; 2], high, 1.5)];
    outlines.extend((0..knuckles).map(|i| {
        let x = 2.0 * i as f64 * pitch;
        rectangle([x + play, leaf - 2.0], [x + pitch - play, leaf + depth])
    }));
    let hole = sizes.between(0.8, 0.2 * leaf.min(high[0]));
    let screws = sizes.whole(1, 3);
    let x = |i: usize| high[0] * (i as f64 + 0.5) / screws as f64;
    let fits = hole < 0.35 * high[0] / screws as f64;
    let cuts: Vec<Outline> = (0..screws)
        .filter(|_| fits)
        .map(|i| circle([x(i), leaf * if i % 2 == 0 { 0.35 } else { 0.55 }], hole))
        .collect();
    cut(&outlines, &cuts)
}

/// A hook with an eye, thicker in the bend than at the tip.
pub(super) fn hook(sizes: &mut Sizes) -> Vec<Region> {
    let bend = sizes.between(4.0, 20.0);
    let width = bend * sizes.between(0.3, 0.9);
    let shank = sizes.between(8.0, 40.0);
    let eye = width * sizes.between(0.6, 1.2);
    let tip = width * sizes.between(0.2, 0.8);
    let sweep = PI * sizes.between(0.9, 1.4);
    let side = |sign: f64| -> Outline {
        (0..=60)
            .map(|i| {
                let t = f64::from(i) / 60.0;
                let half = 0.5 * (width + (tip - width) * t * t);
                polar([0.0; 2], bend + sign * half, -sweep * t)
            })
            .collect()
    };
    let body = band(side(1.0), side(-1.0));
    let end = polar([0.0; 2], bend, -sweep);
    let outlines = [
        body,
        circle(end, 0.5 * tip),
        bar([bend, -0.01], [bend, shank], width),
        circle([bend, shank], eye + 0.5 * width),
    ];
    cut(&outlines, &[circle([bend, shank], eye * 0.8)])
}

/// The side of a phone stand: foot, back and lip.
pub(super) fn phone_stand(sizes: &mut Sizes) -> Vec<Region> {
    let foot = sizes.between(30.0, 70.0);
    let wall = sizes.between(1.6, 7.0);
    let lean = sizes.between(1.1, 1.35);
    let back = foot * sizes.between(0.8, 1.2);
    let pocket = sizes.between(8.0, 14.0);
    let lip = sizes.between(5.0, 12.0);
    let heel = [0.25 * foot, 0.0];
    let seat = polar(heel, 0.3 * back, lean);
    let top = polar(heel, back, lean);
    let front = polar(seat, pocket, lean + 0.5 * PI);
    let run = [[0.0, 0.0], [foot, 0.0], top];
    let mut outlines = stroke(&run, wall);
    outlines.extend(stroke(&[heel, top], wall));
    outlines.extend(stroke(&[seat, front, polar(front, lip, lean)], wall));
    joined(&outlines)
}

/// An open spanner: a handle between a jaw and a ring.
pub(super) fn spanner(sizes: &mut Sizes) -> Vec<Region> {
    let length = sizes.between(30.0, 75.0);
    let nut = length * sizes.between(0.08, 0.14);
    let head = nut * sizes.between(1.5, 1.9);
    let handle = nut * sizes.between(0.7, 1.6);
    let turn = sizes.between(0.0, 0.5);
    let ring = [length, 0.0];
    let outlines = [
        circle([0.0; 2], head),
        circle(ring, 0.9 * head),
        bar([0.0; 2], ring, handle),
    ];
    let cuts = [
        bar(
            polar([0.0; 2], 0.4 * nut, turn),
            polar([0.0; 2], 2.0 * head, PI + turn),
            1.6 * nut,
        ),
        regular(ring, 0.8 * nut, 6, 0.2),
        slot([0.35 * length, 0.0], [0.65 * length, 0.0], 0.4 * handle),
    ];
    cut(&outlines, &cuts)
}

/// A wheel: rim, spokes, hub with a bore.
pub(super) fn wheel(sizes: &mut Sizes) -> Vec<Region> {
    let radius = sizes.between(8.0, 45.0);
    let rim = radius * sizes.between(0.06, 0.2);
    let hub = radius * sizes.between(0.2, 0.4);
    let bore = hub * sizes.between(0.3, 0.7);
    let spokes = sizes.whole(3, 9);
    let width = sizes.between(0.9, 0.5 * hub.max(2.0));
    let taper = sizes.between(0.5, 1.0);
    let center = [0.0; 2];
    let inside = cut(&[circle(center, radius - rim)], &[circle(center, hub)]);
    let outlines: Vec<Outline> = (0..spokes)
        .map(|i| TAU * i as f64 / spokes as f64)
        .map(|angle| wedge(center, polar(center, radius, angle), width, taper * width))
        .collect();
    let windows = difference(&inside, &joined(&outlines));
    let disc = cut(&[circle(center, radius)], &[circle(center, bore)]);
    difference(&disc, &windows)
}

/// Runs of points on a field of 4 x 6.
fn glyph(letter: char) -> Vec<Outline> {
    let bow = |center: Pair, radius: f64, from: f64, to: f64| arc(center, radius, from, to);
    match letter {
        'A' => vec![
            vec![[0.0, 0.0], [2.0, 6.0], [4.0, 0.0]],
            vec![[0.7, 2.0], [3.3, 2.0]],
        ],
        'E' => vec![
            vec![[4.0, 0.0], [0.0, 0.0], [0.0, 6.0], [4.0, 6.0]],
            vec![[0.0, 3.0], [3.2, 3.0]],
        ],
        'K' => vec![
            vec![[0.0, 0.0], [0.0, 6.0]],
            vec![[4.0, 6.0], [0.0, 2.6]],
            vec![[1.4, 3.8], [4.0, 0.0]],
        ],
        'R' => vec![
            vec![[0.0, 0.0], [0.0, 6.0], [2.4, 6.0]],
            bow([2.4, 4.5], 1.5, 0.5 * PI, -0.5 * PI),
            vec![[0.0, 3.0], [2.4, 3.0], [4.0, 0.0]],
        ],
        'S' => vec![
            bow([2.0, 4.4], 1.6, 0.2 * PI, 1.5 * PI),
            bow([2.0, 1.4], 1.4, 0.5 * PI, -0.8 * PI),
        ],
        'W' => vec![vec![
            [0.0, 6.0],
            [1.0, 0.0],
            [2.0, 4.0],
            [3.0, 0.0],
            [4.0, 6.0],
        ]],
        _ => vec![
            bow([2.0, 4.5], 1.4, 0.0, TAU),
            bow([2.0, 1.5], 1.6, 0.0, TAU),
        ],
    }
}

/// A word of one to four letters with round stroke ends.
pub(super) fn letters(sizes: &mut Sizes) -> Vec<Region> {
    let scale = sizes.between(1.8, 6.0);
    let width = scale * sizes.between(0.4, 1.1);
    let mut outlines = Vec::new();
    for place in 0..sizes.whole(1, 4) {
        let letter = ['A', 'E', 'K', 'R', 'S', 'W', '8'][sizes.whole(0, 6)];
        let shift = place as f64 * 6.0;
        for run in glyph(letter) {
            let run: Outline = run
                .iter()
                .map(|p| [scale * (p[0] + shift), scale * p[1]])
                .collect();
            outlines.extend(stroke(&run, width));
        }
    }
    joined(&outlines)
}
