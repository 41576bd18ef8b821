//! Meshes are compared with formulas, hard cases with their original, broken ones with their error
//! message.

use super::clean::with_shared_vertices;
use super::close_gaps::{GAP_MAX_MM, close_gaps};
use super::slice::{Section, Slicer};
use super::test_meshes::*;
use super::{LoadedMesh, Mesh, MeshFormat, MeshOptions, Point3, Vector3, read};
use crate::geometry::polygon::Region;
use crate::geometry::test_shapes::random_numbers;
use crate::geometry::validity::validate_all;
use crate::text::refusal::Refusal;
use std::f64::consts::{PI, TAU};

fn load(mesh: &Mesh) -> Result<LoadedMesh, Refusal> {
    read(
        &to_stl(mesh),
        "part",
        MeshFormat::Stl,
        &MeshOptions::default(),
    )
}

fn sections(mesh: &Mesh, heights_mm: &[f64]) -> Vec<Section> {
    let sections = Slicer::new(mesh).sections(heights_mm);
    for section in &sections {
        assert_eq!(validate_all(&section.regions), Ok(()));
    }
    sections
}

fn area_mm2(section: &Section) -> f64 {
    section.regions.iter().map(Region::area_mm2).sum()
}

/// Area of a polygon of `n` corners on a circle against the circle's.
fn polygon_share(n: u32) -> f64 {
    let n = f64::from(n);
    n / TAU * (TAU / n).sin()
}

/// Heights of layers of 0.1 mm, in their middles.
fn middles_mm(low_mm: f64, count: u32) -> Vec<f64> {
    (0..count)
        .map(|k| low_mm + 0.1 * (f64::from(k) + 0.5))
        .collect()
}

/// Goal: sections of curved bodies have the areas of the formulas. Method: the bodies have their
/// corners on circles around z and so finely by height that a chord of the profile stays within
/// the bound; what corners around take off is known exactly.
#[test]
fn areas_are_those_of_the_formulas() {
    let (n, rows) = (180, 2000);
    let share = polygon_share(n);
    let radius_mm = 5.0;
    let sphere: Vec<[f64; 2]> = (0..=rows)
        .map(|k| {
            let (sin, cos) = (PI * f64::from(k) / f64::from(rows)).sin_cos();
            // The poles are points.
            let sin = if k == rows { 0.0 } else { sin };
            [radius_mm * sin, -radius_mm * cos]
        })
        .collect();
    let sphere = load(&revolved(&sphere, n)).expect("a sphere").mesh;
    let heights = middles_mm(-5.0, 100);
    for (z, section) in heights.iter().zip(sections(&sphere, &heights)) {
        let expected = share * PI * (radius_mm * radius_mm - z * z);
        // A chord lies under its arc by up to R (pi / rows)² / 8 = 1.5 µm, around 31 mm of outline.
        assert!(
            (area_mm2(&section) - expected).abs() < 0.0015 * TAU * radius_mm,
            "{z}"
        );
    }
    let cone = load(&revolved(&[[0.0, 0.0], [4.0, 0.0], [0.0, 8.0]], n)).expect("a cone");
    let heights = middles_mm(0.0, 80);
    for (z, section) in heights.iter().zip(sections(&cone.mesh, &heights)) {
        let expected = share * PI * (4.0 - z / 2.0).powi(2);
        // Single-precision coordinates.
        assert!((area_mm2(&section) - expected).abs() < 1e-4, "{z}");
    }
    let ring = load(&torus(6.0, 2.0, 600)).expect("a torus").mesh;
    let heights = middles_mm(-2.0, 40);
    for (z, section) in heights.iter().zip(sections(&ring, &heights)) {
        let half_mm = (4.0 - z * z).sqrt();
        let expected = 4.0 * PI * 6.0 * half_mm;
        assert_eq!(
            (section.regions.len(), section.regions[0].holes.len()),
            (1, 1)
        );
        // 600 corners: 2 % of 1 %, and near the top chords of the tube.
        assert!((area_mm2(&section) / expected - 1.0).abs() < 5e-4, "{z}");
    }
}

/// Goal: the rule for what lies in the plane. Method: a stack of two boxes of different size cut at
/// its bottom, at the step, and at its top: each face in the plane bounds what is above it.
#[test]
fn a_face_in_the_plane_bounds_what_is_above() {
    let steps = [
        [0.0, 0.0],
        [4.0, 0.0],
        [4.0, 1.0],
        [2.0, 1.0],
        [2.0, 2.0],
        [0.0, 2.0],
    ];
    let stack = load(&revolved(&steps, 4)).expect("two boxes").mesh;
    let found = sections(&stack, &[-0.1, 0.0, 0.5, 1.0, 1.5, 2.0, 2.1]);
    let areas: Vec<f64> = found.iter().map(area_mm2).collect();
    for (area, expected) in areas.iter().zip([0.0, 32.0, 32.0, 8.0, 8.0, 0.0, 0.0]) {
        assert!((area - expected).abs() < 1e-5, "{areas:?}");
    }
}

/// Goal: vertices on planes, edges in planes and saddles make closed loops. Method: an octahedron
/// and a sphere cut at the heights of all of their vertices, against planes a little above.
#[test]
fn vertices_on_planes() {
    let profile: Vec<[f64; 2]> = (0..=16)
        .map(|k| {
            let z = f64::from(k) * 0.25 - 2.0;
            [(4.0 - z * z).sqrt(), z]
        })
        .collect();
    for n in [4, 7, 30] {
        let body = load(&revolved(&profile, n)).expect("a body").mesh;
        let on: Vec<f64> = profile.iter().map(|p| p[1]).collect();
        let above: Vec<f64> = on.iter().map(|z| z + 1e-7).collect();
        for (a, b) in sections(&body, &on).iter().zip(sections(&body, &above)) {
            // 2e-7 mm of the steepest slope around 13 mm, at the pole the root of it.
            assert!((area_mm2(a) - area_mm2(&b)).abs() < 1e-4);
            // At the lower pole the section is a point, which is no region.
            let is_point = area_mm2(&b) < 1e-4;
            assert!(a.regions.len() == b.regions.len() || is_point);
        }
    }
}

/// Goal: T-junctions, cracks of 1 µm, moved patches, flipped and copied triangles leave sections
/// as they were. Method: a box of many triangles, harmed in each way; areas and volume against the
/// whole one's, and a note that says what was done.
#[test]
fn harmed_meshes_are_mended() {
    let whole = cuboid([1.0, 2.0, 0.0], [10.0, 8.0, 6.0]);
    let raw: Vec<[Point3; 3]> = (0..12).map(|t| whole.corners(t)).collect();
    let soup = |triangles: &[[Point3; 3]]| {
        let vertices: Vec<Point3> = triangles.iter().flatten().copied().collect();
        let count = triangles.len() as u32;
        Mesh {
            vertices,
            triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        }
    };
    // One triangle of a side in two: its corner in the middle of a neighbour's edge.
    let [a, b, c] = raw[4];
    let middle = nalgebra::center(&a, &c);
    let mut junction = raw.clone();
    junction[4] = [a, b, middle];
    junction.push([middle, b, c]);
    let mut crack = raw.clone();
    for p in &mut crack[4] {
        *p += Vector3::new(0.0, -0.001, 0.0006);
    }
    let mut both = junction.clone();
    for t in [4, 12] {
        for p in &mut both[t] {
            *p += Vector3::new(0.0004, -0.0007, 0.0005);
        }
    }
    let mut flipped = raw.clone();
    for t in [1, 4, 9] {
        flipped[t].swap(0, 1);
    }
    let mut inside_out = raw.clone();
    for t in &mut inside_out {
        t.swap(0, 1);
    }
    let mut copied = raw.clone();
    copied.extend([raw[3], raw[3], [raw[5][1], raw[5][0], raw[5][2]]]);
    let mut sheet = raw.clone();
    let wall = [
        Point3::new(1.0, 2.0, 0.0),
        Point3::new(11.0, 2.0, 0.0),
        Point3::new(5.0, 5.0, 3.0),
    ];
    sheet.extend([wall, [wall[0], wall[2], wall[1]]]);
    let mut collapsed = raw.clone();
    collapsed.push([a, a, b]);
    for (harmed, said) in [
        (junction, "divided"),
        (crack, "gaps up to 0.05 mm closed"),
        (both, "gaps up to 0.05 mm closed"),
        (flipped, "3 triangles looked the other way"),
        (inside_out, "1 shell looked inwards"),
        (copied, "3 copied triangles"),
        (sheet, "2 copied triangles"),
        (collapsed, "1 triangle with two corners"),
    ] {
        let loaded = load(&soup(&harmed)).expect(said);
        assert!(
            loaded.notes.join("; ").contains(said),
            "{said}: {:?}",
            loaded.notes
        );
        // A crack of 1.2 µm moves 80 mm² of side by that at most.
        assert!((loaded.mesh.volume_mm3() - 480.0).abs() < 0.1, "{said}");
        for section in sections(&loaded.mesh, &[0.1, 2.9, 5.9]) {
            assert!((area_mm2(&section) - 80.0).abs() < 0.02, "{said}");
        }
    }
}

/// Goal: slivers whose corners lie closer together than a slit is long are closed where they were torn, and keep
/// their corners (found on a plate with small holes: four slits of 24 mm were left). Method: a drop with a round
/// end of edges of 13 µm and a far tip, all corners moved by up to 0.5 µm, every third edge of the end divided
/// on one side alone; the widest gap by how far two corners were moved apart.
#[test]
fn torn_slivers_are_closed() {
    let (count, radius_mm, far_mm, high_mm) = (100, 0.4, 24.0, 5.0);
    let mut outline: Vec<[f64; 2]> = (0..=count)
        .map(|k| {
            let (sin, cos) = (PI * (0.5 + f64::from(k) / f64::from(count))).sin_cos();
            [radius_mm * cos, radius_mm * sin]
        })
        .collect();
    outline.push([far_mm, 0.0]);
    let at = |k: usize, z: f64| {
        let [x, y] = outline[k % outline.len()];
        Point3::new(x, y, z)
    };
    let tip = outline.len() - 1;
    let mut torn: Vec<[Point3; 3]> = Vec::new();
    for k in 0..tip - 1 {
        let (low, next) = (at(k, 0.0), at(k + 1, 0.0));
        if k % 3 == 1 {
            let middle = nalgebra::center(&low, &next);
            torn.extend([[at(tip, 0.0), middle, low], [at(tip, 0.0), next, middle]]);
        } else {
            torn.push([at(tip, 0.0), next, low]);
        }
        torn.push([at(tip, high_mm), at(k, high_mm), at(k + 1, high_mm)]);
    }
    for k in 0..=tip {
        let (low, next) = (at(k, 0.0), at(k + 1, 0.0));
        let (above, next_above) = (at(k, high_mm), at(k + 1, high_mm));
        torn.extend([[low, next, next_above], [low, next_above, above]]);
    }
    let mut random = random_numbers(7);
    for x in torn.iter_mut().flatten().flat_map(|p| p.iter_mut()) {
        *x += 1e-3 * (random() - 0.5);
    }
    let numbers = 0..torn.len() as u32;
    let mut mesh = with_shared_vertices(&Mesh {
        vertices: torn.into_iter().flatten().collect(),
        triangles: numbers.map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
    });
    let closed = close_gaps(&mut mesh).expect("closed");
    // Two corners 1 µm apart along each axis, at most.
    assert!(closed.widest_mm < 3f64.sqrt() * 1e-3, "{closed:?}");
    let area_mm2 = |[p, q]: [[f64; 2]; 2]| 0.5 * (p[0] * q[1] - p[1] * q[0]);
    let pairs = (0..=tip).map(|k| [outline[k], outline[(k + 1) % outline.len()]]);
    let volume_mm3 = high_mm * pairs.map(area_mm2).sum::<f64>();
    let ratio = mesh.volume_mm3() / volume_mm3;
    assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
}

/// Goal: a cavity stays hollow whichever way the file turns it, a body in the cavity is solid.
/// Method: three nested boxes; the areas by hand.
#[test]
fn cavities_stay_hollow() {
    let turned = |mut mesh: Mesh| {
        mesh.triangles.iter_mut().for_each(|t| t.swap(0, 1));
        mesh
    };
    let (outer, cavity, inner) = (
        cuboid([0.0; 3], [10.0; 3]),
        cuboid([2.0; 3], [6.0; 3]),
        cuboid([4.0; 3], [2.0; 3]),
    );
    let nested = joined(joined(outer, &turned(cavity)), &turned(inner));
    let loaded = load(&nested).expect("nested boxes");
    assert_eq!(loaded.notes, ["1 shell looked inwards all over; turned"]);
    let found = sections(&loaded.mesh, &[1.0, 3.0, 5.0]);
    let areas: Vec<f64> = found.iter().map(area_mm2).collect();
    for (area, expected) in areas.iter().zip([100.0, 64.0, 68.0]) {
        assert!((area - expected).abs() < 1e-5, "{areas:?}");
    }
}

/// Goal: bodies that overlap are united, and it is told where. Method: two boxes a third into each
/// other, two that share a face, two that share an edge.
#[test]
fn overlapping_shells_are_united() {
    let one = cuboid([0.0; 3], [6.0; 3]);
    for (place, area, overlap) in [
        ([4.0, 0.0, 0.0], 60.0, Some(12.0)),
        ([6.0, 0.0, 0.0], 72.0, None),
        ([6.0, 6.0, 0.0], 72.0, None),
    ] {
        let loaded = load(&joined(one.clone(), &cuboid(place, [6.0; 3]))).expect("two boxes");
        let section = &sections(&loaded.mesh, &[3.0])[0];
        assert!((area_mm2(section) - area).abs() < 1e-5, "{place:?}");
        let found = section.overlap.map(|(mm2, _)| mm2.round());
        assert_eq!(found, overlap, "{place:?}");
    }
}

/// Goal: formats agree, units, scale and turns are applied, 3MF places what its build names. Method:
/// one body in all formats; a 3MF of two items and a component against boxes by hand.
#[test]
fn formats_agree() {
    let body = cuboid([1.0, 2.0, 0.5], [4.0, 3.0, 2.0]);
    let object = object_3mf(1, &body);
    let item = "<item objectid=\"1\"/>";
    let model = model_3mf("millimeter", &object, item);
    let marked = format!("\u{feff}{model}");
    let wide: Vec<u8> = marked.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let package = |model: &[u8]| to_package(&[("3D/3dmodel.model", model)]);
    let files: [(Vec<u8>, MeshFormat); 6] = [
        (package(marked.as_bytes()), MeshFormat::ThreeMf),
        (package(&wide), MeshFormat::ThreeMf),
        (to_stl(&body), MeshFormat::Stl),
        (to_ascii_stl(&body).into_bytes(), MeshFormat::Stl),
        (to_obj(&body).into_bytes(), MeshFormat::Obj),
        (
            to_3mf(&model_3mf("millimeter", &object, item)),
            MeshFormat::ThreeMf,
        ),
    ];
    let options = MeshOptions {
        scale: 2.0,
        rotate_rad: [PI / 2.0, 0.0, 0.0],
        ..MeshOptions::default()
    };
    for (bytes, format) in &files {
        let loaded = read(bytes, "part", *format, &options).expect("a box");
        assert!(
            (loaded.mesh.volume_mm3() - 192.0).abs() < 1e-9,
            "{format:?}"
        );
        // y up to where z was, z to -y.
        let [low, high] = loaded.mesh.bounds_mm();
        assert_eq!([low.z, high.z], [4.0, 10.0]);
        assert_eq!([low.y, high.y], [-5.0, -1.0]);
        assert!(loaded.notes.is_empty());
    }
    let parts = object
        + "<object id=\"2\"><components><component objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 5 0 0\"/>\
           <component objectid=\"1\" transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/></components></object>";
    let items = "<item objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 0 20 0\"/>\
                 <item objectid=\"2\" transform=\"0 1 0 -1 0 0 0 0 1 0 0 0\"/>";
    let bytes = to_3mf(&model_3mf("centimeter", &parts, items));
    let mm = MeshOptions {
        unit_mm: Some(1.0),
        ..MeshOptions::default()
    };
    let loaded = read(&bytes, "part", MeshFormat::ThreeMf, &mm).expect("three boxes");
    assert_eq!(loaded.notes, ["2 build items"]);
    assert!((loaded.mesh.volume_mm3() - 72.0).abs() < 1e-9);
    let section = &sections(&loaded.mesh, &[1.5])[0];
    let mut boxes: Vec<[f64; 4]> = section
        .regions
        .iter()
        .map(Region::bounds)
        .map(|b| [b.min.x, b.max.x, b.min.y, b.max.y].map(|x| (x * 1e6).round() / 1e6))
        .collect();
    boxes.sort_by(|p, q| p[2].total_cmp(&q[2]));
    assert_eq!(
        boxes,
        [
            [-5.0, -2.0, -5.0, -1.0],
            [-5.0, -2.0, 6.0, 10.0],
            [1.0, 5.0, 22.0, 25.0]
        ]
    );
    let in_cm = read(&bytes, "part", MeshFormat::ThreeMf, &MeshOptions::default());
    assert!((in_cm.expect("three boxes").mesh.volume_mm3() - 72e3).abs() < 1e-6);
}

/// Goal: files that are readable are read: normals that are no numbers, lines that end with CR alone,
/// materials without a name. Method: a box in each manner, by its volume.
#[test]
fn readable_files_are_read() {
    let body = cuboid([1.0, 2.0, 0.5], [4.0, 3.0, 2.0]);
    let ascii = to_ascii_stl(&body);
    let normal = "facet normal 0 0 0";
    let no_number = ascii
        .replacen(normal, "facet normal nan inf -nan", 4)
        .replacen(normal, "facet normal -1.#IND 1.#QNAN 0", 2);
    let obj = to_obj(&body);
    let material = format!("mtllib\nusemtl\no part\nusemtl \n{obj}usemtl");
    let mut binary = to_stl(&body);
    binary[84..88].copy_from_slice(&f32::NAN.to_le_bytes());
    binary[88..92].copy_from_slice(&f32::INFINITY.to_le_bytes());
    use MeshFormat::{Obj, Stl};
    for (what, format, bytes) in [
        ("normals", Stl, no_number.into_bytes()),
        ("binary normals", Stl, binary),
        ("CR", Stl, ascii.replace('\n', "\r").into_bytes()),
        ("CR LF", Stl, ascii.replace('\n', "\r\n").into_bytes()),
        ("OBJ CR", Obj, obj.replace('\n', "\r").into_bytes()),
        (
            "no material",
            Obj,
            material.replace('\n', "\r\n").into_bytes(),
        ),
        ("nor here", Obj, material.into_bytes()),
    ] {
        let loaded = read(&bytes, "part", format, &MeshOptions::default());
        let volume_mm3 = loaded.map(|loaded| loaded.mesh.volume_mm3().round());
        assert_eq!(volume_mm3, Ok(24.0), "{what}");
    }
}

/// Goal: an STL is read by what it holds, not by its first bytes or its count. Method: a box, written so that one of
/// them is wrong; what is cut off is still refused.
#[test]
fn an_stl_is_read_by_its_contents() {
    let body = cuboid([1.0, 2.0, 0.5], [4.0, 3.0, 2.0]);
    let stated = |count: u32, rest: &[u8]| {
        let mut bytes = to_stl(&body);
        bytes[80..84].copy_from_slice(&count.to_le_bytes());
        [&bytes, rest].concat()
    };
    let mut solid = stated(0, &[]);
    solid[..11].copy_from_slice(b"solid part\n");
    let mut whole = stated(12, &[]);
    whole[..80].fill(b' ');
    whole[..5].copy_from_slice(b"solid");
    let text = to_ascii_stl(&body);
    let wide: Vec<u8> = format!("\u{feff}{text}")
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    for (what, bytes, note) in [
        (
            "a count of 0",
            stated(0, &[]),
            "states 0 triangles and has 12",
        ),
        (
            "a count of 5",
            stated(5, &[]),
            "states 5 triangles and has 12",
        ),
        (
            "a count of 0 behind solid",
            solid,
            "states 0 triangles and has 12",
        ),
        ("solid", whole, ""),
        (
            "bytes behind it",
            stated(12, b"colour"),
            "6 bytes behind the 12 triangles",
        ),
        (
            "no numbers behind it",
            stated(12, &[0xff; 50]),
            "50 bytes behind the 12 triangles",
        ),
        ("a mark", format!("\u{feff}{text}").into_bytes(), ""),
        ("UTF-16", wide, ""),
        (
            "a name in Latin-1",
            text.replacen("part", "@", 1)
                .bytes()
                .map(|b| if b == b'@' { 0xe4 } else { b })
                .collect(),
            "",
        ),
    ] {
        let loaded = read(&bytes, "part", MeshFormat::Stl, &MeshOptions::default());
        let loaded = loaded.unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(loaded.mesh.volume_mm3().round(), 24.0, "{what}");
        assert!(
            loaded.notes.join("; ").contains(note),
            "{what}: {:?}",
            loaded.notes
        );
        assert_eq!(
            loaded.notes.is_empty(),
            note.is_empty(),
            "{what}: {:?}",
            loaded.notes
        );
    }
}

/// Goal: faces are read as the format permits them; other elements are left out with a note. Method: a prism over
/// an L, its end faces concave, of 384 mm³, written in each manner.
#[test]
fn obj_faces_are_read_in_every_manner() {
    let corners = "v 20 0 0\nv 20 4 0\nv 4 4 0\nv 4 16 0\nv 0 16 0\nv 0 0 0\nv 20 0 3\nv 20 4 3\nv 4 4 3\n\
                   v 4 16 3\nv 0 16 3\nv 0 0 3\n";
    let sides = "f 1 2 8 7\nf 2 3 9 8\nf 3 4 10 9\nf 4 5 11 10\nf 5 6 12 11\nf 6 1 7 12\n";
    let ends = "f 6 5 4 3 2 1\nf 7 8 9 10 11 12\n";
    let whole = format!("{corners}{ends}{sides}");
    let with = |find: &str, by: &str| {
        assert!(whole.contains(find), "{find}");
        whole.replace(find, by)
    };
    let continued = "f 7 \\\n 8 \\\n 9 \\\n 10 \\\n 11 \\\n 12\n";
    let bridged = "f 7 8 9 10 11 12\nv 9 9 9\nl 1 2 13\nl 3 4\np 1\nf 1 2\n";
    for (what, text, note) in [
        ("as it is", whole.clone(), ""),
        ("continued", with("f 7 8 9 10 11 12\n", continued), ""),
        (
            "continued CR LF",
            with("f 7 8 9 10 11 12\n", continued).replace('\n', "\r\n"),
            "",
        ),
        (
            "continued CR",
            with("f 7 8 9 10 11 12\n", continued).replace('\n', "\r"),
            "",
        ),
        ("a vertex continued", with("v 4 4 0", "v 4 \\\n4 0"), ""),
        (
            "lines and points",
            with("f 7 8 9 10 11 12\n", bridged),
            "1 faces of two corners, 2 lines, 1 points",
        ),
        (
            "negative",
            with("f 7 8 9 10 11 12", "f -6 -5 -4 -3 -2 -1"),
            "",
        ),
        (
            "normals",
            with(
                "f 7 8 9 10 11 12",
                "vn 0 0 1\nf 7//1 8//1 9//1 10//1 11//1 12//1",
            ),
            "",
        ),
        (
            "textures",
            with("f 1 2 8 7", "vt 0 0\nf 1/1 2/1 8/1 7/1"),
            "",
        ),
        (
            "an old word",
            with("f 1 2 8 7", "fo 1/1/1 2/1/1 8/1/1 7/1/1"),
            "",
        ),
        (
            "from another corner",
            with("f 7 8 9 10 11 12", "f 8 9 10 11 12 7"),
            "",
        ),
        (
            "weights, colours",
            with("v 4 4 0", "v 4 4 0 1 0.5 0.5 0.5"),
            "",
        ),
        ("faces first", format!("{ends}{sides}{corners}"), ""),
        (
            "a comment behind",
            with("f 1 2 8 7", "f 1 2 8 7 # side"),
            "",
        ),
        ("a mark", format!("\u{feff}{whole}"), ""),
    ] {
        let loaded = read(
            text.as_bytes(),
            "part",
            MeshFormat::Obj,
            &MeshOptions::default(),
        );
        let loaded = loaded.unwrap_or_else(|error| panic!("{what}: {error}"));
        // Whole numbers: only rounding is left.
        assert!((loaded.mesh.volume_mm3() - 384.0).abs() < 1e-9, "{what}");
        assert_eq!(
            loaded.notes.join("; ").contains("left out"),
            !note.is_empty(),
            "{what}"
        );
        assert!(
            loaded.notes.join("; ").contains(note),
            "{what}: {:?}",
            loaded.notes
        );
        let area_mm2 = (0..loaded.mesh.triangles.len()).map(|triangle| {
            let [a, b, c] = loaded.mesh.corners(triangle);
            (b - a).cross(&(c - a)).norm() / 2.0
        });
        // Triangles that overlap within a face have more area than the prism: 2 x 128 mm², 72 mm x 3 mm.
        assert!((area_mm2.sum::<f64>() - 472.0).abs() < 1e-9, "{what}");
    }
}

/// Goal: a part in inches or metres is known by its size, and nothing is changed of it. Method: boxes in
/// these units, with and without the option that the note gives; a small part in mm.
#[test]
fn inches_and_metres_are_known_by_their_size() {
    let noted = |size: [f64; 3], unit_mm: Option<f64>| {
        let options = MeshOptions {
            unit_mm,
            ..MeshOptions::default()
        };
        let bytes = to_stl(&cuboid([0.0; 3], size));
        read(&bytes, "part", MeshFormat::Stl, &options).map(|loaded| loaded.notes.join("; "))
    };
    let inches = noted([1.0, 0.8, 0.5], None).expect("a part");
    assert!(
        inches.contains("1 x 0.8 x 0.5 mm")
            && inches.contains("--units in makes it 25.4 x 20.32 x 12.7 mm"),
        "{inches}"
    );
    let metres = noted([0.2, 0.02, 0.03], None).expect("a part");
    assert!(
        metres.contains("--units m makes it 200 x 20 x 30 mm"),
        "{metres}"
    );
    let tiny = noted([0.02, 0.02, 0.03], None)
        .expect_err("too small")
        .to_string();
    assert!(tiny.contains("--units m, it is 20 x 20 x 30 mm"), "{tiny}");
    for (size, unit_mm) in [([1.0, 0.8, 0.5], Some(25.4)), ([3.0, 3.0, 1.1], None)] {
        assert_eq!(noted(size, unit_mm), Ok(String::new()));
    }
}

/// Goal: what is open by more than a gap is refused with its place, what is open by less is closed.
/// Method: a box whose lid's corner is lifted by 0.9 and by 1.1 gaps, one without a triangle.
#[test]
fn only_gaps_are_closed() {
    let whole = cuboid([0.0; 3], [10.0; 3]);
    let lifted = |by_mm: f64| {
        let mut mesh = whole.clone();
        mesh.vertices.push(Point3::new(10.0, 10.0, 10.0 + by_mm));
        for triangle in &mut mesh.triangles[2..4] {
            for vertex in triangle.iter_mut().filter(|v| **v == 7) {
                *vertex = 8;
            }
        }
        mesh
    };
    assert!(load(&lifted(0.9 * GAP_MAX_MM)).is_ok());
    let error = load(&lifted(3.0 * GAP_MAX_MM)).expect_err("open");
    let text = error.to_string();
    assert!(
        text.starts_with("the surface is open in 1 place: "),
        "{text}"
    );
    let mut holed = whole.clone();
    holed.triangles.remove(5);
    let text = load(&holed).expect_err("open").to_string();
    assert!(
        text.contains("open in 1 place")
            && text.contains("of 3 edges near (5.000, 0.000, 5.000) mm"),
        "{text}"
    );
}

/// Goal: thirty broken files are refused with what is wrong and what to do. Method: a word of each
/// message.
#[test]
fn broken_files_are_refused() {
    let body = cuboid([0.0; 3], [10.0; 3]);
    let stl = to_stl(&body);
    let with = |at: usize, number: f32| {
        let mut bytes = stl.clone();
        bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
        bytes
    };
    let mut too_many = stl.clone();
    too_many[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    let mut one_more = stl.clone();
    one_more[80] = 13;
    let scaled = |by: f64| {
        let mut mesh = body.clone();
        mesh.vertices.iter_mut().for_each(|p| *p *= by);
        to_stl(&mesh)
    };
    let shifted = |by: f64| {
        let mut mesh = body.clone();
        mesh.vertices.iter_mut().for_each(|p| p.x += by);
        to_stl(&mesh)
    };
    let without = |triangles: std::ops::Range<usize>| {
        let mut mesh = body.clone();
        mesh.triangles.drain(triangles);
        to_stl(&mesh)
    };
    let empty = to_stl(&Mesh::default());
    let mut flat = body.clone();
    flat.triangles = vec![[0, 1, 2], [0, 2, 1]];
    let ascii = to_ascii_stl(&body);
    let obj = to_obj(&body);
    let object = object_3mf(1, &body);
    let item = "<item objectid=\"1\"/>";
    let package = |unit: &str, objects: &str, items: &str| to_3mf(&model_3mf(unit, objects, items));
    let good = package("millimeter", &object, item);
    let loops = "<object id=\"1\"><components><component objectid=\"2\"/></components></object>\
                 <object id=\"2\"><components><component objectid=\"1\"/></components></object>";
    let bomb = to_3mf(&" ".repeat((1 << 28) + 1));
    use MeshFormat::{Obj, Stl, ThreeMf};
    let files: Vec<(&str, MeshFormat, Vec<u8>, &str)> = vec![
        ("no byte", Stl, Vec::new(), "0 bytes"),
        ("a few bytes", Stl, stl[..60].to_vec(), "60 bytes"),
        ("a cut header", Stl, stl[..83].to_vec(), "83 bytes"),
        (
            "a cut triangle",
            Stl,
            stl[..400].to_vec(),
            "ends at byte 400",
        ),
        ("one triangle too few", Stl, one_more, "13 triangles"),
        ("a count of all ones", Stl, too_many, "4294967295 triangles"),
        ("no triangle", Stl, empty, "no triangle"),
        (
            "a NaN",
            Stl,
            with(84 + 50 * 3 + 12, f32::NAN),
            "corner of triangle 3",
        ),
        (
            "an infinity",
            Stl,
            with(84 + 12, f32::INFINITY),
            "corner of triangle 0",
        ),
        ("a far corner", Stl, with(84 + 12, 3e38), "larger than"),
        ("metres for mm", Stl, scaled(1e-3), "smaller than 0.1 mm"),
        ("mm for metres", Stl, scaled(1e4), "larger than 10000 mm"),
        ("nothing but one place", Stl, scaled(0.0), "smaller than"),
        ("far away", Stl, shifted(1e6), "farther than"),
        ("a triangle missing", Stl, without(0..1), "open in 1 place"),
        (
            "a side missing",
            Stl,
            without(2..4),
            "of 4 edges near (5.000, 5.000, 10.000)",
        ),
        ("one triangle", Stl, without(1..12), "open"),
        ("a sheet", Stl, to_stl(&flat), "enclose nothing"),
        (
            "an ASCII that ends",
            Stl,
            ascii.as_bytes()[..300].to_vec(),
            "export it again",
        ),
        (
            "a word for a number",
            Stl,
            ascii.replacen("vertex 10", "vertex ten", 1).into_bytes(),
            "export it again",
        ),
        (
            "an ASCII NaN",
            Stl,
            ascii.replacen("vertex 10", "vertex nan", 1).into_bytes(),
            "NaN",
        ),
        (
            "an OBJ of nothing",
            Obj,
            b"# nothing\n".to_vec(),
            "no triangle",
        ),
        (
            "an OBJ of vertices",
            Obj,
            b"v 0 0 0\nv 1 0 0\n".to_vec(),
            "no triangle",
        ),
        (
            "an OBJ vertex of two",
            Obj,
            obj.replacen("v 0 0 0", "v 0 0", 1).into_bytes(),
            "line 1: a vertex",
        ),
        (
            "an OBJ face out of bounds",
            Obj,
            (obj.clone() + "f 1 2 99\n").into_bytes(),
            "line 21: vertex 99 of 8 is out of bounds",
        ),
        (
            "an OBJ NaN",
            Obj,
            obj.replacen("v 0 0 0", "v nan 0 0", 1).into_bytes(),
            "corner of triangle",
        ),
        (
            "no package",
            ThreeMf,
            b"not a zip at all".to_vec(),
            "not a readable 3MF",
        ),
        (
            "a cut package",
            ThreeMf,
            good[..good.len() / 2].to_vec(),
            "not a readable 3MF",
        ),
        (
            "no item",
            ThreeMf,
            package("millimeter", &object, ""),
            "no item",
        ),
        (
            "an unknown object",
            ThreeMf,
            package("millimeter", &object, "<item objectid=\"7\"/>"),
            "object 7",
        ),
        (
            "an unknown unit",
            ThreeMf,
            package("cubit", &object, item),
            "not a readable 3MF",
        ),
        (
            "a vertex out of bounds",
            ThreeMf,
            package(
                "millimeter",
                &object.replacen("v1=\"0\"", "v1=\"88\"", 1),
                item,
            ),
            "vertex 88 of 8",
        ),
        (
            "objects that contain each other",
            ThreeMf,
            package("millimeter", loops, item),
            "nest deeper",
        ),
        (
            "cut XML",
            ThreeMf,
            to_3mf("<model unit=\"millimeter\"><resources>"),
            "not a readable 3MF",
        ),
        ("a bomb", ThreeMf, bomb, "unpack to more"),
    ];
    assert!(files.len() >= 30);
    for (what, format, bytes, word) in files {
        let text = match read(&bytes, "part", format, &MeshOptions::default()) {
            Ok(_) => panic!("{what} was read"),
            Err(error) => error.to_string(),
        };
        assert!(text.contains(word), "{what}: {text}");
    }
}
