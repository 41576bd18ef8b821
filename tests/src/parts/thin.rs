//! Parts of walls and webs: lattices, labyrinths, shells.

use super::Sizes;
use super::drawing::{
    Outline, Pair, band, bar, circle, cut, joined, polar, rectangle, regular, rounded_rectangle,
    wedge,
};
use headway::geometry::boolean::{difference, grown};
use headway::geometry::polygon::Region;
use std::f64::consts::{PI, TAU};

/// A frame around square holes, straight or on their corners.
pub(super) fn lattice(sizes: &mut Sizes) -> Vec<Region> {
    let web = sizes.between(0.7, 3.0);
    let cell = sizes.between(2.5, 9.0);
    let frame = sizes.between(1.0, 4.0);
    let [columns, rows] = [sizes.whole(3, 9), sizes.whole(2, 7)];
    let pitch = cell + web;
    let count = [columns as f64, rows as f64];
    let high = count.map(|n| n * pitch - web + 2.0 * frame);
    let slanted = sizes.coin();
    let mut cuts = Vec::new();
    for i in 0..columns {
        for j in 0..rows {
            let low = [frame + i as f64 * pitch, frame + j as f64 * pitch];
            let middle = low.map(|v| v + 0.5 * cell);
            cuts.push(if slanted {
                regular(middle, 0.5 * cell, 4, 0.0)
            } else {
                rectangle(low, low.map(|v| v + cell))
            });
        }
    }
    cut(&[rectangle([0.0; 2], high)], &cuts)
}

/// A plate of hexagonal holes, whole ones only.
pub(super) fn honeycomb(sizes: &mut Sizes) -> Vec<Region> {
    let web = sizes.between(0.6, 2.4);
    let cell = sizes.between(2.5, 8.0);
    let [columns, rows] = [sizes.whole(3, 10), sizes.whole(3, 8)];
    let pitch = cell + web;
    let rise = pitch * 0.75f64.sqrt();
    let rim = web + sizes.between(0.3, 2.0);
    let high = [
        (columns as f64 + 0.5) * pitch - web + 2.0 * rim,
        (rows - 1) as f64 * rise + cell / 0.75f64.sqrt() + 2.0 * rim,
    ];
    let first = [rim + 0.5 * cell, rim + 0.5 * cell / 0.75f64.sqrt()];
    let cells = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let cuts: Vec<Outline> = cells
        .map(|(i, j)| {
            let shift = 0.5 * (j % 2) as f64;
            let at = [
                first[0] + (i as f64 + shift) * pitch,
                first[1] + j as f64 * rise,
            ];
            regular(at, 0.5 * cell / 0.75f64.sqrt(), 6, PI / 6.0)
        })
        .collect();
    cut(&[rectangle([0.0; 2], high)], &cuts)
}

/// The walls of a maze in which one way leads between any two places.
pub(super) fn labyrinth(sizes: &mut Sizes) -> Vec<Region> {
    let wall = sizes.between(0.8, 2.6);
    let pitch = wall + sizes.between(1.2, 5.0);
    let [columns, rows] = [sizes.whole(5, 13), sizes.whole(4, 10)];
    let at = |(i, j): (usize, usize)| [i as f64 * pitch, j as f64 * pitch];
    // Posts of a grid, each joined to the frame or to one that is, in random order.
    let on_frame = |i: usize, j: usize| i == 0 || j == 0 || i == columns || j == rows;
    let mut held: Vec<Vec<bool>> = (0..=columns)
        .map(|i| (0..=rows).map(|j| on_frame(i, j)).collect())
        .collect();
    let mut walls = Vec::new();
    while held.iter().flatten().any(|held| !held) {
        let (i, j) = (sizes.whole(1, columns - 1), sizes.whole(1, rows - 1));
        let near = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)][sizes.whole(0, 3)];
        if !held[i][j] && held[near.0][near.1] {
            held[i][j] = true;
            let [p, q] = [at((i, j)), at(near)];
            let low = [0, 1].map(|k| p[k].min(q[k]) - 0.5 * wall);
            let high = [0, 1].map(|k| p[k].max(q[k]) + 0.5 * wall);
            walls.push(rectangle(low, high));
        }
    }
    let plate = |by: f64| rectangle([-by; 2], at((columns, rows)).map(|v| v + by));
    let ways = cut(&[plate(-0.5 * wall)], &walls);
    difference(&joined(&[plate(0.5 * wall)]), &ways)
}

/// A box seen from above: thin walls, partitions, screw posts in the corners.
pub(super) fn thin_walled_box(sizes: &mut Sizes) -> Vec<Region> {
    let high = [sizes.between(20.0, 90.0), sizes.between(15.0, 60.0)];
    let wall = sizes.between(0.7, 2.6);
    let corner = sizes.between(2.0, 5.0);
    let inside = rounded_rectangle([wall; 2], high.map(|v| v - wall), (corner - wall).max(0.5));
    let room = joined(&[inside]);
    let mut within = Vec::new();
    let partition = wall * sizes.between(0.7, 1.2);
    for i in 1..=sizes.whole(0, 3) {
        let x = high[0] * i as f64 / 4.3;
        within.push(bar([x, 0.5 * wall], [x, high[1] - 0.5 * wall], partition));
    }
    let post = sizes.between(2.0, 3.5);
    let inset = wall + 0.7 * post;
    let posts: [Pair; 4] = [
        [inset, inset],
        [high[0] - inset, inset],
        [high[0] - inset, high[1] - inset],
        [inset, high[1] - inset],
    ];
    within.extend(posts.iter().map(|c| circle(*c, post)));
    let holes: Vec<Outline> = posts.iter().map(|c| circle(*c, 0.45 * post)).collect();
    // What is left open: the inside without partitions and posts, and the screws' holes.
    let open = difference(&room, &joined(&within));
    let body = difference(&joined(&[rounded_rectangle([0.0; 2], high, corner)]), &open);
    difference(&body, &joined(&holes))
}

/// Six arms with branches.
pub(super) fn snowflake(sizes: &mut Sizes) -> Vec<Region> {
    let radius = sizes.between(10.0, 45.0);
    let width = sizes.between(0.9, 0.12 * radius.max(12.0));
    let branches = sizes.whole(1, 4);
    let lean = sizes.between(0.7, 1.2);
    let longest = radius * sizes.between(0.2, 0.4);
    let thinner = sizes.between(0.6, 1.0);
    let center = [0.0; 2];
    let mut outlines = vec![regular(center, 2.0 * width, 6, 0.0)];
    for arm in 0..6 {
        let angle = PI / 3.0 * f64::from(arm);
        outlines.push(bar(center, polar(center, radius, angle), width));
        for branch in 1..=branches {
            let share = branch as f64 / (branches + 1) as f64;
            let foot = polar(center, radius * (0.25 + 0.7 * share), angle);
            let length = longest * (1.15 - share);
            for side in [-1.0, 1.0] {
                let end = polar(foot, length, angle + side * lean);
                outlines.push(bar(foot, end, thinner * width));
            }
        }
    }
    joined(&outlines)
}

/// A band that winds outwards.
pub(super) fn spiral(sizes: &mut Sizes) -> Vec<Region> {
    let width = sizes.between(0.8, 4.0);
    let gap = sizes.between(0.5, 3.0);
    let turns = sizes.between(1.5, 4.5);
    let start = sizes.between(2.0, 8.0) + width;
    let growth = (width + gap) / TAU;
    let steps = (turns * 90.0) as usize;
    let side = |by: f64| -> Outline {
        (0..=steps)
            .map(|i| TAU * turns * i as f64 / steps as f64)
            .map(|angle| polar([0.0; 2], start + growth * angle + by, angle))
            .collect()
    };
    let mut outlines = vec![band(side(0.5 * width), side(-0.5 * width))];
    if sizes.coin() {
        let end = polar([0.0; 2], start + growth * TAU * turns, TAU * turns);
        outlines.push(circle(end, 0.9 * width));
    }
    joined(&outlines)
}

/// An aerofoil with a sharp trailing edge and cooling cavities.
pub(super) fn blade(sizes: &mut Sizes) -> Vec<Region> {
    let chord = sizes.between(15.0, 80.0);
    let thickness = sizes.between(0.09, 0.2);
    let camber = sizes.between(0.05, 0.25);
    let wall = sizes.between(0.8, 2.5);
    let cavities = sizes.whole(0, 3);
    let middle = |t: f64| [chord * t, chord * camber * 4.0 * t * (1.0 - t)];
    let half = |t: f64| {
        let poly = 0.2969 * t.sqrt() - 0.126 * t - 0.3516 * t.powi(2) + 0.2843 * t.powi(3)
            - 0.1036 * t.powi(4);
        5.0 * chord * thickness * poly
    };
    let side = |from: f64, to: f64, less: f64, sign: f64| -> Outline {
        (0..=80)
            .map(|i| {
                let share = 0.5 - 0.5 * (PI * f64::from(i) / 80.0).cos();
                let t = from + (to - from) * share;
                let slope = camber * 4.0 * (1.0 - 2.0 * t);
                let [x, y] = middle(t);
                let by = sign * (half(t) - less);
                let length = slope.hypot(1.0);
                [x - by * slope / length, y + by / length]
            })
            .collect()
    };
    let outline = band(side(0.0, 1.0, 0.0, -1.0), side(0.0, 1.0, 0.0, 1.0));
    let cuts: Vec<Outline> = (0..cavities)
        .map(|i| {
            [
                0.08 + 0.2 * i as f64,
                0.08 + 0.2 * (i + 1) as f64 - wall / chord,
            ]
        })
        .filter(|[from, to]| to - from > 0.05 && half(*from).min(half(*to)) > wall + 0.3)
        .map(|[from, to]| band(side(from, to, wall, -1.0), side(from, to, wall, 1.0)))
        .collect();
    cut(&[outline], &cuts)
}

/// A thin wall around a flower, a heart or a star.
pub(super) fn cookie_cutter(sizes: &mut Sizes) -> Vec<Region> {
    let radius = sizes.between(10.0, 45.0);
    let wall = sizes.between(0.6, 2.2);
    let petals = sizes.whole(3, 8);
    let depth = sizes.between(0.08, 0.3);
    let kind = sizes.whole(0, 2);
    let flower = |angle: f64| {
        let r = radius * (1.0 + depth * (petals as f64 * angle).cos()) / (1.0 + depth);
        polar([0.0; 2], r, angle)
    };
    let heart = |angle: f64| {
        let x = 16.0 * angle.sin().powi(3);
        let y = 13.0 * angle.cos() - 5.0 * (2.0 * angle).cos() - 2.0 * (3.0 * angle).cos();
        [radius * x / 17.0, radius * y / 17.0]
    };
    let inside: Outline = match kind {
        0 => (0..240)
            .map(|i| flower(TAU * f64::from(i) / 240.0))
            .collect(),
        1 => (0..240)
            .map(|i| heart(TAU * f64::from(i) / 240.0))
            .collect(),
        _ => (0..2 * petals)
            .map(|i| {
                let r = if i % 2 == 0 { 1.0 } else { 1.0 - 1.6 * depth };
                polar([0.0; 2], radius * r, PI * i as f64 / petals as f64)
            })
            .collect(),
    };
    let inside = joined(&[inside]);
    difference(&grown(&inside, wall), &inside)
}

/// A hub with tapered, swept blades.
pub(super) fn impeller(sizes: &mut Sizes) -> Vec<Region> {
    let radius = sizes.between(10.0, 45.0);
    let hub = radius * sizes.between(0.25, 0.4);
    let bore = hub * sizes.between(0.3, 0.6);
    let blades = sizes.whole(4, 11);
    let root = sizes.between(1.0, 3.0);
    let tip = root * sizes.between(0.4, 1.0);
    let sweep = sizes.between(-1.2, 1.2);
    let center = [0.0; 2];
    let mut outlines = vec![circle(center, hub)];
    for blade in 0..blades {
        let first = TAU * blade as f64 / blades as f64;
        let side = |sign: f64| -> Outline {
            (0..=30)
                .map(|i| {
                    let t = f64::from(i) / 30.0;
                    let r = 0.7 * hub + (radius - 0.7 * hub) * t;
                    let half = 0.5 * (root + (tip - root) * t) / r;
                    polar(center, r, first + sweep * t * t + sign * half)
                })
                .collect()
        };
        outlines.push(band(side(-1.0), side(1.0)));
    }
    cut(&outlines, &[circle(center, bore)])
}

/// Two chords with posts and diagonals between them.
pub(super) fn truss(sizes: &mut Sizes) -> Vec<Region> {
    let bays = sizes.whole(3, 8);
    let length = sizes.between(6.0, 13.0);
    let height = length * sizes.between(0.7, 1.4);
    let chord = sizes.between(1.2, 4.0);
    let web = chord * sizes.between(0.4, 0.9);
    let slope = sizes.between(0.0, 0.5) * height / bays as f64;
    let low = |i: usize| [i as f64 * length, 0.0];
    let top = |i: usize| [i as f64 * length, height - slope * i as f64];
    let mut outlines = vec![
        bar(low(0), low(bays), chord),
        wedge(top(0), top(bays), chord, chord),
    ];
    for i in 0..=bays {
        outlines.push(bar(low(i), top(i), web));
    }
    for i in 0..bays {
        let (p, q) = if i % 2 == 0 {
            (low(i), top(i + 1))
        } else {
            (top(i), low(i + 1))
        };
        outlines.push(bar(p, q, web));
    }
    joined(&outlines)
}
