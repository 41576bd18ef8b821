//! Real-like outlines of any size for benches and for hunts of weak places: gears with many teeth,
//! noisy circles, combs, plates with many holes. All drawn here, with a fixed noise,
//! but for the shipped examples.

/// Rings of points, mm, the outside counter-clockwise, holes clockwise.
pub type Rings = crate::layer_oracle::Rings;

/// The rings of a shipped example in polygon JSON, by its name without the ending.
///
/// # Panics
/// Where there is no such example or it is no polygon.
pub fn example(name: &str) -> Rings {
    let path = format!("{}/../examples/{name}.json", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).expect(&path);
    let json: serde_json::Value = serde_json::from_str(&text).expect(&path);
    let ring = |value: &serde_json::Value| -> Vec<[f64; 2]> {
        serde_json::from_value(value.clone()).expect("a ring of points")
    };
    let mut rings = vec![ring(&json["exterior"])];
    rings.extend(json["holes"].as_array().expect("holes").iter().map(ring));
    rings
}

/// Numbers in [0, 1), the same every time.
pub struct Noise(u64);

impl Noise {
    /// A sequence of its own for each seed.
    pub fn new(seed: u64) -> Noise {
        Noise(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(1))
    }

    /// The next number.
    pub fn share(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }
}

/// A gear of about `edges` edges: teeth of 24 edges each, 3.6 mm apart and 3 mm high, so that the
/// part grows with the edges as a real one does; a hole in the middle.
pub fn gear(edges: usize) -> Rings {
    let teeth = (edges / 25).max(6);
    let pitch_mm = 3.6;
    let radius = teeth as f64 * pitch_mm / std::f64::consts::TAU;
    let mut ring = Vec::new();
    for tooth in 0..teeth {
        for step in 0..24 {
            let t = f64::from(step) / 24.0;
            let angle = (tooth as f64 + t) * std::f64::consts::TAU / teeth as f64;
            // Flanks as a rounded square wave.
            let wave = (3.0 * (t * std::f64::consts::TAU).sin()).tanh();
            let r = radius + 1.5 * wave;
            ring.push([r * angle.cos(), r * angle.sin()]);
        }
    }
    // A ring of some beads' width: the inside of a big disc says nothing of the outline.
    let inner = (radius - 8.0).max(0.3 * radius);
    let hole: Vec<[f64; 2]> = (0..teeth)
        .map(|i| -(i as f64) * std::f64::consts::TAU / teeth as f64)
        .map(|angle| [inner * angle.cos(), inner * angle.sin()])
        .collect();
    vec![ring, hole]
}

/// A ring-shaped part whose outlines carry noise of `noise_mm`, `edges` edges in all, each 0.15 mm.
pub fn noisy_ring(edges: usize, noise_mm: f64) -> Rings {
    let mut noise = Noise::new(5);
    let radius = edges as f64 / 2.0 * 0.15 / std::f64::consts::TAU + 3.0;
    let mut circle = |radius: f64, sign: f64| -> Vec<[f64; 2]> {
        (0..edges / 2)
            .map(|i| {
                let angle = sign * i as f64 * std::f64::consts::TAU / (edges / 2) as f64;
                let r = radius + noise_mm * (2.0 * noise.share() - 1.0);
                [r * angle.cos(), r * angle.sin()]
            })
            .collect()
    };
    vec![circle(radius + 2.5, 1.0), circle(radius - 2.5, -1.0)]
}

/// A comb of about `edges` edges: teeth 2 mm wide and 12 mm long, 4 mm apart, on a back of 6 mm.
pub fn comb(edges: usize) -> Rings {
    let teeth = (edges / 4).max(2);
    let mut ring = vec![[0.0, 0.0], [teeth as f64 * 4.0, 0.0]];
    for tooth in (0..teeth).rev() {
        let x = tooth as f64 * 4.0;
        ring.extend([
            [x + 3.0, 6.0],
            [x + 3.0, 18.0],
            [x + 1.0, 18.0],
            [x + 1.0, 6.0],
        ]);
    }
    vec![ring]
}

/// A plate with `count` round holes of 12 edges each, 4 mm apart.
pub fn plate_with_holes(count: usize) -> Rings {
    let columns = (count as f64).sqrt().ceil() as usize;
    let rows = count.div_ceil(columns);
    let (w, h) = (columns as f64 * 4.0 + 2.0, rows as f64 * 4.0 + 2.0);
    let mut rings = vec![vec![[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]];
    for i in 0..count {
        let (x, y) = (
            (i % columns) as f64 * 4.0 + 3.0,
            (i / columns) as f64 * 4.0 + 3.0,
        );
        let hole = (0..12)
            .map(|k| -f64::from(k) * std::f64::consts::TAU / 12.0)
            .map(|angle| [x + 0.9 * angle.cos(), y + 0.9 * angle.sin()]);
        rings.push(hole.collect());
    }
    rings
}

/// A polygon with holes as the planner takes it.
pub fn region(rings: &Rings) -> headway::geometry::polygon::Region {
    let ring = |points: &Vec<[f64; 2]>| headway::geometry::polygon::Ring {
        points: points
            .iter()
            .map(|p| headway::geometry::Point2::new(p[0], p[1]))
            .collect(),
    };
    headway::geometry::polygon::Region {
        exterior: ring(&rings[0]),
        holes: rings[1..].iter().map(ring).collect(),
    }
}

/// A ring 60 mm across and 5 mm wide, drawn with `edges` edges and noise of `noise_mm`.
pub fn fine_ring(edges: usize, noise_mm: f64) -> Rings {
    drawn_ring([30.0, 25.0], edges, noise_mm)
}

/// A ring between two radii, half its edges on either; noise moves each point along its radius.
pub fn drawn_ring(radii_mm: [f64; 2], edges: usize, noise_mm: f64) -> Rings {
    let mut noise = Noise::new(11);
    let mut circle = |radius: f64, count: usize, sign: f64| -> Vec<[f64; 2]> {
        (0..count)
            .map(|i| {
                let angle = sign * i as f64 * std::f64::consts::TAU / count as f64;
                let r = radius + noise_mm * (2.0 * noise.share() - 1.0);
                [r * angle.cos(), r * angle.sin()]
            })
            .collect()
    };
    let [outer, inner] = radii_mm;
    vec![
        circle(outer, edges / 2, 1.0),
        circle(inner, edges / 2, -1.0),
    ]
}

/// A gear of 40 teeth, 60 mm across with a hole of 40 mm, its teeth drawn with ever more edges.
pub fn fine_gear(edges: usize) -> Rings {
    let steps = edges - 60;
    let ring = (0..steps).map(|i| {
        let angle = i as f64 * std::f64::consts::TAU / steps as f64;
        let r = 28.5 + 1.5 * (3.0 * (40.0 * angle).sin()).tanh();
        [r * angle.cos(), r * angle.sin()]
    });
    let hole = (0..60).map(|i| {
        let angle = -f64::from(i) * std::f64::consts::TAU / 60.0;
        [20.0 * angle.cos(), 20.0 * angle.sin()]
    });
    vec![ring.collect(), hole.collect()]
}

/// A coast `across_mm` wide of `edges` edges, seen from one point in its middle: bays and capes of
/// every size down to a few edges.
pub fn coast(edges: usize, across_mm: f64) -> Rings {
    let mut noise = Noise::new(3);
    let waves: Vec<[f64; 3]> = (0..9)
        .map(|octave| {
            let waves = 2f64.powi(octave) + noise.share();
            [
                waves.round(),
                0.16 * 0.72f64.powi(octave),
                7.0 * noise.share(),
            ]
        })
        .collect();
    let ring = (0..edges).map(|i| {
        let angle = i as f64 * std::f64::consts::TAU / edges as f64;
        let shape: f64 = waves
            .iter()
            .map(|[waves, height, phase]| height * (waves * angle + phase).sin())
            .sum();
        let r = 0.5 * across_mm * (0.6 + shape + 0.03 * noise.share()).clamp(0.05, 1.0);
        [r * angle.cos(), r * angle.sin()]
    });
    vec![ring.collect()]
}

/// The rings with their edges divided about every 0.2 mm and each point moved by up to `noise_mm` in x
/// and in y.
pub fn with_noise(rings: &Rings, noise_mm: f64, seed: u64) -> Rings {
    let mut noise = Noise::new(seed);
    let mut noisy = |ring: &Vec<[f64; 2]>| {
        let mut points = Vec::new();
        for (i, &p) in ring.iter().enumerate() {
            let q = ring[(i + 1) % ring.len()];
            let length_mm = (q[0] - p[0]).hypot(q[1] - p[1]);
            let pieces = (length_mm / 0.2).round().max(1.0);
            for k in 0..pieces as usize {
                let t = k as f64 / pieces;
                let mut moved = || noise_mm * (2.0 * noise.share() - 1.0);
                let at = [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])];
                points.push([at[0] + moved(), at[1] + moved()]);
            }
        }
        points
    };
    rings.iter().map(&mut noisy).collect()
}

/// How many edges the rings have.
pub fn edge_count(rings: &Rings) -> usize {
    rings.iter().map(Vec::len).sum()
}
