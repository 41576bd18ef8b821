//! Meshes: STL, OBJ, 3MF.

use super::Want::{Refused, Volume};
use super::{Case, Kind, Want, case};
use headway::mesh::MeshFormat::{Obj, Stl, ThreeMf};
use std::io::{Cursor, Write};

/// A corner cut off three axes at 10 mm: 10³ / 6 mm³.
const CORNERS: [[f32; 3]; 4] = [
    [0.0, 0.0, 0.0],
    [10.0, 0.0, 0.0],
    [0.0, 10.0, 0.0],
    [0.0, 0.0, 10.0],
];
const FACES: [[usize; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
const CORNER_MM3: f64 = 1000.0 / 6.0;

/// As ASCII STL, moved along x.
fn ascii(faces: &[[usize; 3]], x_mm: f32) -> String {
    let facets = faces.iter().map(|face| {
        let corners = face.map(|k| {
            let [x, y, z] = CORNERS[k];
            format!("vertex {} {y} {z}\n", x + x_mm)
        });
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            corners.concat()
        )
    });
    format!("solid part\n{}endsolid part\n", facets.collect::<String>())
}

/// As binary STL whose header says this and that count.
fn binary(header: &[u8], count: u32) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend(count.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        let corners = face.iter().flat_map(|k| CORNERS[*k]);
        corners.for_each(|c| bytes.extend(c.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

fn stl() -> Vec<Case> {
    let of = |what, bytes: Vec<u8>, want: Want| case(what, Kind::Solid(Stl), bytes, want);
    let text = ascii(&FACES, 0.0);
    let inside_out = FACES.map(|[a, b, c]| [a, c, b]);
    let far = binary(b"far", 4);
    let mut no_place = far.clone();
    no_place[96..100].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut beyond = far.clone();
    beyond[96..100].copy_from_slice(&1e30f32.to_le_bytes());
    vec![
        of("ASCII", text.clone().into(), Volume(CORNER_MM3)),
        of(
            "ASCII in capitals, tabs and CR LF",
            text.to_uppercase()
                .replace('\n', "\r\n")
                .replace(' ', "\t")
                .into(),
            Volume(CORNER_MM3),
        ),
        of(
            "normals that are no numbers",
            text.replace("0 0 0\nouter", "nan nan nan\nouter").into(),
            Volume(CORNER_MM3),
        ),
        of(
            "two solids in a file",
            (ascii(&FACES, 0.0) + &ascii(&FACES, 20.0)).into(),
            Volume(2.0 * CORNER_MM3),
        ),
        of(
            "a binary file that begins as a text",
            binary(b"solid part", 4),
            Volume(CORNER_MM3),
        ),
        of(
            "a solid inside out",
            ascii(&inside_out, 0.0).into(),
            Volume(CORNER_MM3),
        ),
        of(
            "a face turned over",
            ascii(&[FACES[0], FACES[1], FACES[2], inside_out[3]], 0.0).into(),
            Volume(CORNER_MM3),
        ),
        of(
            "a solid without a face",
            ascii(&FACES[..3], 0.0).into(),
            Refused("open in 1 place"),
        ),
        of(
            "four thousand million triangles",
            binary(b"claims", u32::MAX),
            Refused("states 4294967295 triangles"),
        ),
        of(
            "a file cut off",
            far[..200].to_vec(),
            Refused("ends at byte 200"),
        ),
        of("a corner that is no place", no_place, Refused("no place")),
        of(
            "a corner beyond all",
            beyond,
            Refused("larger than 10000 mm"),
        ),
        of("nothing", Vec::new(), Refused("0 bytes")),
        of(
            "a solid of nothing",
            b"solid a\nendsolid a\n".to_vec(),
            Refused("no triangle"),
        ),
        of(
            "commas in numbers",
            text.replacen("10 0 0", "10,5 0 0", 1).into(),
            Refused("line 6: a vertex"),
        ),
    ]
}

fn obj() -> Vec<Case> {
    let of = |what, text: &str, want: Want| case(what, Kind::Solid(Obj), text, want);
    let corners: String = CORNERS.map(|[x, y, z]| format!("v {x} {y} {z}\n")).concat();
    let faces = |name: &dyn Fn(usize) -> String| -> String {
        let face = |[a, b, c]: [usize; 3]| format!("f {} {} {}\n", name(a), name(b), name(c));
        FACES.map(face).concat()
    };
    let plain = faces(&|k| (k + 1).to_string());
    let block = "v 0 0 0\nv 2 0 0\nv 2 3 0\nv 0 3 0\nv 0 0 4\nv 2 0 4\nv 2 3 4\nv 0 3 4\n\
                 f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    vec![
        of(
            "corners counted from 1",
            &(corners.clone() + &plain),
            Volume(CORNER_MM3),
        ),
        of(
            "corners counted back",
            &(corners.clone() + &faces(&|k| (k as i64 - 4).to_string())),
            Volume(CORNER_MM3),
        ),
        of("faces of four corners", block, Volume(24.0)),
        of(
            "textures and normals",
            &format!(
                "mtllib a.mtl\n{corners}vt 0 0\nvn 0 0 1\nusemtl a\ns off\n{}",
                faces(&|k| format!("{}/1/1", k + 1))
            ),
            Volume(CORNER_MM3),
        ),
        of(
            "a corner of number 0",
            &(corners.clone() + "f 0 1 2\n"),
            Refused("line 5:"),
        ),
        of(
            "a corner that is not there",
            &(corners.clone() + "f 1 2 9\n"),
            Refused("line 5:"),
        ),
        of(
            "a corner of number four thousand million",
            &(corners.clone() + "f 1 2 4000000000\n"),
            Refused("line 5:"),
        ),
        of(
            "a corner that is no number",
            &("v 0 0 x\n".to_string() + &plain),
            Refused("line 1:"),
        ),
    ]
}

fn packed(model: &[u8]) -> Vec<u8> {
    let mut package = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    let types: &[u8] = b"<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\"><Default \
        Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/><Default \
        Extension=\"model\" ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/></Types>";
    let relations: &[u8] = b"<Relationships \
        xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship \
        Target=\"/3D/3dmodel.model\" Id=\"rel0\" \
        Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>";
    for (name, bytes) in [
        ("[Content_Types].xml", types),
        ("_rels/.rels", relations),
        ("3D/3dmodel.model", model),
    ] {
        package.start_file(name, options).expect("a file");
        package.write_all(bytes).expect("bytes");
    }
    package.finish().expect("a package").into_inner()
}

/// A model of the corner, its other objects, and what is built.
fn model(unit: &str, others: &str, build: &str) -> Vec<u8> {
    let corners = CORNERS.map(|[x, y, z]| format!("<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>"));
    let faces = FACES.map(|[a, b, c]| format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>"));
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model unit=\"{unit}\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"><resources><object id=\"1\" \
         type=\"model\"><mesh><vertices>{}</vertices><triangles>{}</triangles></mesh></object>{others}\
         </resources><build>{build}</build></model>",
        corners.concat(),
        faces.concat()
    );
    packed(text.as_bytes())
}

/// Objects from this number on, of which each is ten of the one before, moved aside.
fn claiming_components(first: usize, depth: usize) -> String {
    let of = |k: usize| {
        let parts = (0..10).map(|n| {
            let x = 20 * n * 10usize.pow(k as u32 % 4);
            format!(
                "<component objectid=\"{}\" transform=\"1 0 0 0 1 0 0 0 1 {x} 0 0\"/>",
                k - 1
            )
        });
        let parts: String = parts.collect();
        format!("<object id=\"{k}\" type=\"model\"><components>{parts}</components></object>")
    };
    (first..first + depth).map(of).collect()
}

fn threemf() -> Vec<Case> {
    let of = |what, bytes: Vec<u8>, want: Want| case(what, Kind::Solid(ThreeMf), bytes, want);
    let item = "<item objectid=\"1\"/>";
    let turning = "<object id=\"2\" type=\"model\"><components><component objectid=\"2\"/></components></object>";
    let doubled = "<item objectid=\"1\" transform=\"2 0 0 0 2 0 0 0 2 0 0 0\"/>";
    vec![
        of(
            "a package",
            model("millimeter", "", item),
            Volume(CORNER_MM3),
        ),
        of(
            "inches",
            model("inch", "", item),
            Volume(CORNER_MM3 * 25.4f64.powi(3)),
        ),
        of(
            "an item twice as large",
            model("millimeter", "", doubled),
            Volume(8.0 * CORNER_MM3),
        ),
        of(
            "nothing built",
            model("millimeter", "", ""),
            Refused("no item"),
        ),
        of(
            "an object that is not there",
            model("millimeter", "", "<item objectid=\"7\"/>"),
            Refused("object 7"),
        ),
        of(
            "an object of itself",
            model("millimeter", turning, "<item objectid=\"2\"/>"),
            Refused("names object 2"),
        ),
        of(
            "a thousand million of nothing",
            model(
                "millimeter",
                &("<object id=\"2\" type=\"model\"><mesh><vertices/><triangles/></mesh></object>"
                    .to_string()
                    + &claiming_components(3, 9)),
                "<item objectid=\"11\"/>",
            ),
            Refused("more than 100000 times"),
        ),
        of(
            "a thousand million objects",
            model(
                "millimeter",
                &claiming_components(2, 9),
                "<item objectid=\"10\"/>",
            ),
            Refused("more than 100000 times"),
        ),
        of(
            "a package that unpacks to a gigabyte",
            packed(&vec![b' '; 300_000_000]),
            Refused("unpack to more than"),
        ),
        of(
            "no package",
            b"PK\x03\x04 and no more".to_vec(),
            Refused("not a readable 3MF"),
        ),
    ]
}

pub fn cases() -> Vec<Case> {
    [stl(), obj(), threemf()].into_iter().flatten().collect()
}
