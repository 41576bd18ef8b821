//! What of a part can be laid, by every order there is, and every step of an order again: what `space` says against its
//! rules in plain loops. The parts are small or coarse: speed is tested elsewhere.

mod plain;

use headway_reach::space::{LeftOut, Reach};
use plain::ring_directions;
use plain::{Cell, EPSILON, Plain, Setting, Shape, along, plus, random_setting, random_shape};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// How one cell may be laid along one direction; sets of cells are bit masks.
struct Way {
    direction: usize,
    /// Each cell has enough support when one bond stands: when of each of its masks a cell stands.
    bonds: Vec<Vec<u32>>,
    /// What the head meets, by pose.
    heads: Vec<u32>,
}

/// Every way to lay each cell of a small part.
struct Ways {
    by_cell: Vec<Vec<Way>>,
    /// Why a cell has no pose even before anything is laid, along all directions, usable or not.
    lacks: Vec<Option<LeftOut>>,
}

impl Ways {
    fn of(plain: &Plain) -> Ways {
        let shape = plain.shape;
        let mut ways = Ways {
            by_cell: Vec::new(),
            lacks: Vec::new(),
        };
        let by_pose = |k| {
            shape
                .cells
                .iter()
                .map(move |&q| plain.covered(q, k))
                .collect()
        };
        let covered: Vec<Vec<Vec<Cell>>> = (0..plain.set.directions.len()).map(by_pose).collect();
        for &v in &shape.cells {
            let (mut fits, mut above, mut allowed, mut clear) = (false, false, false, false);
            let mut list = Vec::new();
            for k in 0..plain.set.directions.len() {
                let mut heads = Vec::new();
                for (&q, covered) in shape.cells.iter().zip(&covered[k]) {
                    let is_fit = covered.contains(&v);
                    let is_above = is_fit && plain.is_above_bed(q, k);
                    let is_allowed = is_above && plain.is_allowed(q, k);
                    let is_clear = is_allowed && plain.is_clear_of_obstacles(q, k);
                    fits |= is_fit;
                    above |= is_above;
                    allowed |= is_allowed;
                    clear |= is_clear;
                    if is_clear {
                        heads.push(mask(shape, |w| plain.meets(q, k, w)));
                    }
                }
                heads.sort_unstable();
                heads.dedup();
                if plain.is_usable(k) {
                    list.push(Way {
                        direction: k,
                        bonds: bonds(plain, v, k),
                        heads,
                    });
                }
            }
            ways.by_cell.push(list);
            ways.lacks.push(match (fits, above, allowed, clear) {
                (false, ..) => Some(LeftOut::Aperture),
                (_, false, ..) => Some(LeftOut::Bed),
                (_, _, false, _) => Some(LeftOut::Joints),
                (.., false) => Some(LeftOut::Obstacle),
                _ => None,
            });
        }
        ways
    }

    fn count(&self) -> usize {
        self.by_cell.len()
    }

    fn lays(&self, v: usize, standing: u32, head_counts: bool) -> bool {
        let carried = |way: &Way| {
            way.bonds
                .iter()
                .any(|bond| bond.iter().all(|m| m & standing != 0))
        };
        let free = |way: &Way| {
            way.heads
                .iter()
                .any(|head| !head_counts || head & standing == 0)
        };
        self.by_cell[v].iter().any(|way| free(way) && carried(way))
    }

    /// The most cells that any order lays, by all sets that can be laid.
    fn best(&self) -> u32 {
        let all = (1u32 << self.count()) - 1;
        let mut seen = vec![false; 1 << self.count()];
        let mut next = vec![0u32];
        let mut best = 0;
        while let Some(standing) = next.pop() {
            best = best.max(standing.count_ones());
            if standing == all {
                break;
            }
            for v in (0..self.count()).filter(|v| standing >> v & 1 == 0) {
                let more = standing | 1 << v;
                if !seen[more as usize] && self.lays(v, standing, true) {
                    seen[more as usize] = true;
                    next.push(more);
                }
            }
        }
        best
    }

    /// What grows when the head may pass through print.
    fn at_most(&self) -> u32 {
        let mut standing = 0u32;
        loop {
            let fresh = (0..self.count()).filter(|v| standing >> v & 1 == 0);
            let Some(v) = { fresh }.find(|&v| self.lays(v, standing, false)) else {
                return standing;
            };
            standing |= 1 << v;
        }
    }

    /// Whether nothing is enclosed: along one direction alone, everything has a pose and rests on what is lower along
    /// it, so the order by height along it never has print in the head's way.
    fn is_open(&self, plain: &Plain) -> bool {
        (0..plain.set.directions.len()).any(|k| {
            let n = plain.set.directions[k];
            let is_laid = |(v, list): (usize, &Vec<Way>)| {
                let height = along(plain.shape.cells[v], n);
                let lower = mask(plain.shape, |w| along(w, n) < height - EPSILON);
                let stands = |bond: &Vec<u32>| bond.iter().all(|m| m & lower != 0);
                let mut ways = list
                    .iter()
                    .filter(|way| way.direction == k && !way.heads.is_empty());
                ways.any(|way| way.bonds.iter().any(stands))
            };
            self.by_cell.iter().enumerate().all(is_laid)
        })
    }
}

fn mask(shape: &Shape, is: impl Fn(Cell) -> bool) -> u32 {
    let bits = shape.cells.iter().enumerate();
    bits.fold(0, |mask, (bit, &cell)| mask | u32::from(is(cell)) << bit)
}

fn bonds(plain: &Plain, v: Cell, k: usize) -> Vec<Vec<u32>> {
    let mut bonds = Vec::new();
    if plain.stands_on_bed(v, k) {
        bonds.push(Vec::new());
    }
    for &o in &plain.leans[k] {
        if plain.shape.holds(plus(v, o)) {
            let groups = Plain::groups(v, o);
            let bond = groups
                .iter()
                .map(|group| mask(plain.shape, |cell| group.contains(&cell)));
            bonds.push(bond.collect());
        }
    }
    bonds.retain(|bond: &Vec<u32>| !bond.contains(&0));
    bonds
}

/// Asserts that every step of an order is valid on what is laid before it; which cells are laid.
fn replay(plain: &Plain, reach: &Reach, name: &str) -> Vec<bool> {
    let (shape, cells) = (plain.shape, &plain.shape.cells);
    let mut standing = vec![false; shape.solid.len()];
    let mut laid = vec![false; cells.len()];
    let mut order: Vec<Cell> = Vec::new();
    for (index, step) in reach.steps.iter().enumerate() {
        let (v, q, k) = (
            cells[step.cell as usize],
            cells[step.pose as usize],
            usize::from(step.direction),
        );
        let says = format!(
            "{name}, step {index}: {v:?} from {q:?} along {:?}",
            plain.set.directions[k]
        );
        let stands = |cell: Cell| shape.place(cell).is_some_and(|place| standing[place]);
        assert!(!laid[step.cell as usize], "{says}: twice");
        assert!(plain.is_usable(k), "{says}: not usable");
        assert!(plain.covered(q, k).contains(&v), "{says}: aperture");
        assert!(plain.is_above_bed(q, k), "{says}: bed");
        assert!(plain.is_allowed(q, k), "{says}: joints");
        assert!(plain.is_clear_of_obstacles(q, k), "{says}: obstacle");
        assert!(plain.is_supported(v, k, stands), "{says}: support");
        let met = order.iter().find(|&&w| plain.meets(q, k, w));
        assert!(met.is_none(), "{says}: the head meets {met:?}");
        laid[step.cell as usize] = true;
        standing[shape.place(v).unwrap()] = true;
        order.push(v);
    }
    for (cell, &is_laid) in laid.iter().enumerate() {
        assert_eq!(reach.left_out[cell].is_none(), is_laid, "{name}: {cell}");
        assert!(!is_laid || reach.at_most[cell], "{name}: {cell}");
    }
    laid
}

/// Parts on which some of what has a pose and support is always in the way, or the engine misses the best order: about one
/// in 140 of the random ones.
const HARD_SEEDS: [u64; 46] = [
    105, 293, 455, 765, 1038, 1127, 1151, 1373, 1619, 1850, 2228, 2238, 2551, 2564, 2613, 2823,
    2831, 2999, 3002, 3151, 3346, 3539, 3711, 3713, 3830, 3831, 3939, 4049, 4162, 4263, 4552, 4811,
    4878, 5156, 5213, 5236, 5343, 5475, 5502, 5578, 5808, 5875, 7121, 8694, 9961, 11272,
];

/// Asserts that the reach of a part is within the rules; found, best and at most, and whether nothing is enclosed.
fn counts(seed: u64) -> ([usize; 4], bool) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let set = random_setting(&mut random);
    let shape = random_shape(&mut random, seed as u32);
    let name = format!("seed {seed}");
    let plain = Plain::new(&set, &shape);
    let ways = Ways::of(&plain);
    let reach = set.reach(&shape);
    let laid = replay(&plain, &reach, &name);
    let grown = ways.at_most();
    for (cell, &is_laid) in laid.iter().enumerate() {
        let is_grown = grown >> cell & 1 == 1;
        assert_eq!(reach.at_most[cell], is_grown, "{name}: {cell}");
        let late = [LeftOut::Support, LeftOut::Head][usize::from(is_grown)];
        let why = (!is_laid).then_some(ways.lacks[cell].unwrap_or(late));
        assert_eq!(reach.left_out[cell], why, "{name}: {cell}");
    }
    let found = laid.iter().filter(|&&is_laid| is_laid).count();
    let (best, at_most) = (ways.best() as usize, grown.count_ones() as usize);
    ([found, best, at_most, ways.count()], ways.is_open(&plain))
}

/// Goal: what is found is no more than the best order lays and what is said to be at most possible no less; that set and
/// the reasons are those of the rules; each order is valid; where nothing is enclosed, all is found. Method: all sets of
/// cells that can be laid, of random small parts.
#[test]
fn the_best_of_every_order_is_between_found_and_at_most() {
    let [mut short, mut hard, mut open, mut met, mut tight, mut parts] = [0; 6];
    for seed in (0..80).chain(HARD_SEEDS) {
        let ([found, best, at_most, all], is_open) = counts(seed);
        let says = format!("seed {seed}: {found} <= {best} <= {at_most} of {all}");
        assert!(found <= best && best <= at_most, "{says}");
        assert!(!is_open || found == all, "{says}: open");
        if found < at_most {
            println!("{says}");
        }
        parts += 1;
        open += u32::from(is_open);
        short += u32::from(best < all);
        hard += u32::from(best < at_most);
        met += u32::from(found == best);
        tight += u32::from(best == at_most);
    }
    println!("{parts} parts: best < all {short}, best < at most {hard}, open {open}");
    println!("found = best {met}, best = at most {tight}");
    assert!(
        short >= 40 && hard >= 20 && open >= 10,
        "the sample is too easy"
    );
}

fn head_of_a_printer(tilt_max_deg: f64, self_support_deg: f64) -> Setting {
    let knots = vec![[0.0, 0.8], [20.0, 12.35], [20.0, 22.0], [70.0, 22.0]];
    let directions = ring_directions(&knots, tilt_max_deg.to_radians());
    Setting {
        voxel_mm: 2.0,
        knots,
        self_support_rad: self_support_deg.to_radians(),
        semi_mm: [2.2, 0.9],
        directions,
        usable: !0,
        one_in: 1,
    }
}

/// A T, a table, a bottle with a ledge inside, stairs around a column.
fn larger() -> [(&'static str, Shape); 4] {
    let round = |x: i32, y: i32| (f64::from(x) - 8.5).hypot(f64::from(y) - 8.5);
    let bottle = |[x, y, z]: Cell| {
        let outer = if z < 14 {
            8.6
        } else {
            8.6 - 0.6 * f64::from(z - 13).min(7.0)
        };
        let inner = if z < 2 {
            0.0
        } else if z / 2 == 4 {
            4.0
        } else {
            outer - 2.2
        };
        (inner..outer).contains(&round(x, y))
    };
    let stairs = |[x, y, z]: Cell| {
        let around = (f64::from(y) - 8.5).atan2(f64::from(x) - 8.5) - 0.3 * f64::from(z);
        round(x, y) < 2.6 || round(x, y) < 8.6 && z > 1 && around.cos() > 0.8
    };
    let leg = |at: i32| !(3..17).contains(&at);
    [
        (
            "T",
            Shape::of([20, 4, 24], |[x, _, z]| z > 19 || (8..12).contains(&x)),
        ),
        (
            "table",
            Shape::of([20, 20, 14], |[x, y, z]| z > 11 || leg(x) && leg(y)),
        ),
        ("bottle", Shape::of([18, 18, 24], bottle)),
        ("stairs", Shape::of([18, 18, 22], stairs)),
    ]
}

/// Goal: no step of larger orders breaks a rule. Method: each step again, against all that is laid.
#[test]
fn every_step_of_larger_parts_is_valid() {
    for (tilt_max_deg, self_support_deg) in [(30.0, 30.0), (90.0, 30.0)] {
        let set = head_of_a_printer(tilt_max_deg, self_support_deg);
        for (name, shape) in larger() {
            let reach = set.reach(&shape);
            let laid = replay(&Plain::new(&set, &shape), &reach, name);
            let count = |list: &[bool]| list.iter().filter(|&&is| is).count();
            let (found, at_most) = (count(&laid), count(&reach.at_most));
            println!(
                "{name}, {tilt_max_deg} degrees: {found} <= {at_most} of {}",
                laid.len()
            );
            assert!(found >= 400, "{name}: too little to test");
        }
    }
}

/// Goal: a part and its mirror image are alike. Method: directions that are their own mirror image; what is at most
/// possible to the cell; of what is found the count.
#[test]
fn mirror_images_are_alike() {
    let coarse = head_of_a_printer(30.0, 30.0);
    let mut fine = head_of_a_printer(60.0, 60.0);
    fine.knots = vec![[0.0, 0.8], [2.0, 5.0], [30.0, 6.0]];
    fine.directions.retain(|n| n[2] < 0.51 || n[2] > 0.99);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let small = (0..60).map(|kind| ("small", random_shape(&mut random, kind)));
    let mut part_laid = 0;
    for (name, shape) in larger().into_iter().chain(small) {
        let set = if name == "small" { &fine } else { &coarse };
        for &[x, y, z] in &set.directions {
            let is_mirror = |m: &[f64; 3]| {
                (m[0] + x).abs().max((m[1] - y).abs()).max((m[2] - z).abs()) < EPSILON
            };
            assert!(set.directions.iter().any(is_mirror), "{x} {y} {z}");
        }
        let other = shape.mirrored();
        let (one, two) = (set.reach(&shape), set.reach(&other));
        for (&cell, &is) in shape.cells.iter().zip(&one.at_most) {
            let turned = shape.turned(cell);
            let at = other
                .cells
                .iter()
                .position(|&there| there == turned)
                .unwrap();
            assert_eq!(two.at_most[at], is, "{name}: {cell:?}");
        }
        let (one, two) = (one.steps.len(), two.steps.len());
        part_laid += u32::from(one < shape.cells.len());
        println!("{name}: {one} {two} of {}", shape.cells.len());
        // Ties between directions are broken by their index, which a mirror image does not keep: 1 %, or one cell.
        assert!(
            one.abs_diff(two) <= (one / 100).max(1),
            "{name}: {one} {two}"
        );
    }
    assert!(part_laid >= 10, "{part_laid}: too easy");
}
