//! Orients the triangles of a surface consistently.
//!
//! The two triangles of an edge must traverse it in opposite directions. Within a shell (triangles
//! connected by such edges) the orientation of the larger area is used. A shell that encloses a
//! negative volume is a cavity if an odd number of other shells contains it, and inside out
//! otherwise.

use super::half_edges::{Edges, ends};
use super::{Mesh, Point3, volume_mm3};

/// The triangles and shells turned to face outwards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Reoriented {
    /// Triangles with an orientation opposite to their neighbours'.
    pub triangles: usize,
    /// Shells that were completely inside out.
    pub shells: usize,
}

/// Makes neighbours consistent, and shells face outwards.
pub(super) fn orient(mesh: &mut Mesh) -> Reoriented {
    let (shell_of, triangles) = agree(mesh);
    Reoriented {
        triangles,
        shells: turn_shells(mesh, &shell_of),
    }
}

/// Makes neighbours agree: the number of each triangle's shell, and how many were turned.
pub(super) fn agree(mesh: &mut Mesh) -> (Vec<u32>, usize) {
    let neighbours = neighbours(&mesh.triangles);
    let count = mesh.triangles.len();
    const NONE: u32 = u32::MAX;
    let mut shell_of = vec![NONE; count];
    let mut is_turned = vec![false; count];
    let mut shell = Vec::new();
    let (mut shells, mut turned) = (0, 0);
    for first in 0..count {
        if shell_of[first] != NONE {
            continue;
        }
        shell.clear();
        shell.push(first);
        shell_of[first] = shells;
        let mut done = 0;
        while done < shell.len() {
            let triangle = shell[done];
            done += 1;
            for (other, agrees) in neighbours[triangle].into_iter().flatten() {
                if shell_of[other as usize] == NONE {
                    shell_of[other as usize] = shells;
                    is_turned[other as usize] = is_turned[triangle] == agrees;
                    shell.push(other as usize);
                }
            }
        }
        shells += 1;
        turned += turn_minority(mesh, &shell, &is_turned);
    }
    (shell_of, turned)
}

/// Across each edge that has two triangles the other one, and whether the two agree.
fn neighbours(triangles: &[[u32; 3]]) -> Vec<[Option<(u32, bool)>; 3]> {
    let mut neighbours = vec![[None; 3]; triangles.len()];
    for group in Edges::of(triangles).groups() {
        let &[(_, one), (_, other)] = group else {
            continue;
        };
        let agree = ends(triangles, one) != ends(triangles, other);
        for (own, other) in [(one, other), (other, one)] {
            neighbours[own as usize / 3][own as usize % 3] = Some((other / 3, agree));
        }
    }
    neighbours
}

/// Turns those that are marked, or the others, whichever are less area; how many.
fn turn_minority(mesh: &mut Mesh, shell: &[usize], is_turned: &[bool]) -> usize {
    let area = |triangle: usize| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(&(c - a)).norm()
    };
    let mut areas = [0.0; 2];
    if !shell.iter().any(|&t| is_turned[t]) {
        return 0;
    }
    for &triangle in shell {
        areas[usize::from(is_turned[triangle])] += area(triangle);
    }
    let minority = areas[1] <= areas[0];
    let mut turned = 0;
    for &triangle in shell {
        if is_turned[triangle] == minority {
            mesh.triangles[triangle].swap(1, 2);
            turned += 1;
        }
    }
    turned
}

/// Turns shells that are inside out; how many.
fn turn_shells(mesh: &mut Mesh, shell_of: &[u32]) -> usize {
    let shells = shells(shell_of);
    let volumes: Vec<f64> = shells
        .iter()
        .map(|shell| volume_mm3(mesh, shell.iter().copied()))
        .collect();
    let boxes: Vec<[Point3; 2]> = shells.iter().map(|shell| bounds(mesh, shell)).collect();
    let mut turned = Vec::new();
    for (number, shell) in shells.iter().enumerate() {
        if volumes[number] >= 0.0 {
            continue;
        }
        let at = mesh.corners(shell[0])[0];
        let around = (0..shells.len()).filter(|&other| {
            let [low, high] = &boxes[other];
            let in_box = (0..3).all(|i| (low[i]..=high[i]).contains(&at[i]));
            other != number && in_box && contains(mesh, &shells[other], at)
        });
        if around.count() % 2 == 0 {
            turned.push(number);
        }
    }
    for &number in &turned {
        for &triangle in &shells[number] {
            mesh.triangles[triangle].swap(1, 2);
        }
    }
    turned.len()
}

fn shells(shell_of: &[u32]) -> Vec<Vec<usize>> {
    let count = shell_of.iter().max().map_or(0, |&last| last as usize + 1);
    let mut shells = vec![Vec::new(); count];
    for (triangle, &shell) in shell_of.iter().enumerate() {
        shells[shell as usize].push(triangle);
    }
    shells
}

fn bounds(mesh: &Mesh, shell: &[usize]) -> [Point3; 2] {
    let corners = shell.iter().flat_map(|&triangle| mesh.corners(triangle));
    let first = mesh.corners(shell[0])[0];
    corners.fold([first, first], |[low, high], p| [low.inf(&p), high.sup(&p)])
}

/// True where the shell winds around the point: the sum of the solid angles of its triangles (Van
/// Oosterom and Strackee 1983) is 4 pi inside and 0 outside.
fn contains(mesh: &Mesh, shell: &[usize], at: Point3) -> bool {
    let angles = shell.iter().map(|&triangle| {
        let [a, b, c] = mesh.corners(triangle).map(|p| p - at);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let volume = a.dot(&b.cross(&c));
        let rest = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * volume.atan2(rest)
    });
    angles.sum::<f64>().abs() > 2.0 * std::f64::consts::PI
}
