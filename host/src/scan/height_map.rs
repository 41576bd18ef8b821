//! Height maps to points: a grey picture (PNG), or a bed mesh as Klipper saves it.
//!
//! In: a picture with the size of its pixels and levels, the lines of a configuration. Out: points added to a [`Cloud`]. A
//! picture's first row has the greatest y, and a pixel of level 0 was not seen: so height maps are written by profilers. Not
//! covered: colours, pictures of floats, interlaced ones.

use super::PictureScale;
use super::cloud::Cloud;
use super::read::Lines;
use crate::text::refusal::{Refusal, refusal};
use png::{BitDepth, ColorType, Decoder, Limits};
use std::io::BufRead;

/// How a PNG begins.
pub(super) const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Most pixels: what a picture of a few hundred kilobytes may claim to hold takes minutes.
const PIXELS_MAX: u64 = 400_000_000;
/// Most bytes that the decoder may hold: rows.
const DECODER_BYTES_MAX: usize = 64 << 20;
/// Most values of a mesh.
const MESH_VALUES_MAX: usize = 10_000_000;
/// What Klipper writes before the lines that it saves by itself.
const SAVED: &str = "#*#";

/// Adds the pixels of a PNG, row by row.
///
/// # Errors
/// A `Refusal` for a picture that is not grey, cut off, or too large.
pub(super) fn picture(
    input: &mut impl BufRead,
    scale: PictureScale,
    cloud: &mut Cloud,
) -> Result<(), Refusal> {
    let broken = |error: png::DecodingError| refusal!("the PNG cannot be read: {error}");
    let limits = Limits {
        bytes: DECODER_BYTES_MAX,
    };
    let mut reader = Decoder::new_with_limits(input, limits)
        .read_info()
        .map_err(broken)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let bytes = match (info.color_type, info.bit_depth, info.interlaced) {
        (ColorType::Grayscale, BitDepth::Eight, false) => 1,
        (ColorType::Grayscale, BitDepth::Sixteen, false) => 2,
        _ => {
            return Err(refusal!(
                "the PNG is no height map: write it grey, 8 or 16 bits a pixel, not interlaced"
            ));
        }
    };
    let pixels = u64::from(width) * u64::from(height);
    if pixels > PIXELS_MAX {
        return Err(refusal!(
            "the PNG has {width} x {height} pixels, {PIXELS_MAX} are read at most: cut it to the layer"
        ));
    }
    let mut row = 0u32;
    while let Some(own) = reader.next_row().map_err(broken)? {
        for (column, level) in own.data().chunks_exact(bytes).enumerate() {
            let level = level
                .iter()
                .fold(0u32, |level, byte| level << 8 | u32::from(*byte));
            let z_mm = match level {
                0 => f64::NAN,
                _ => f64::from(level) * scale.level_mm,
            };
            let [x_mm, y_mm] = [column as f64, f64::from(height - 1 - row)];
            cloud.add([x_mm * scale.pixel_mm, y_mm * scale.pixel_mm, z_mm])?;
        }
        row += 1;
    }
    Ok(())
}

/// The line of a configuration without what marks saved ones.
fn text(line: &[u8]) -> &str {
    let text = str::from_utf8(line).unwrap_or_default();
    text.strip_prefix(SAVED).unwrap_or(text).trim()
}

/// Whether a line begins a section of a configuration.
pub(super) fn is_section(line: &[u8]) -> bool {
    text(line).starts_with('[')
}

/// A mesh while its section is read.
#[derive(Default)]
struct Mesh {
    name: String,
    heights: Vec<f64>,
    keys: std::collections::BTreeMap<String, f64>,
}

/// Adds the points of the first mesh with a name (`[bed_mesh NAME]`).
///
/// # Errors
/// A `Refusal` for a configuration without a mesh, with several, or with one that is not complete.
pub(super) fn klipper(
    mut lines: Lines<impl BufRead>,
    mm_per_unit: f64,
    cloud: &mut Cloud,
) -> Result<(), Refusal> {
    let mut meshes: Vec<Mesh> = Vec::new();
    let (mut is_mesh, mut are_points) = (false, false);
    loop {
        let line = text(&lines.text);
        if line.starts_with('[') {
            let words: Vec<&str> = line.trim_matches(['[', ']']).split_whitespace().collect();
            // Without a name it is how to probe, not what was.
            is_mesh = words.len() > 1 && words[0] == "bed_mesh";
            if is_mesh {
                let name = words[1..].join(" ");
                if let Some(mesh) = meshes.first() {
                    return Err(refusal!(
                        "line {}: the scan has a second mesh, {name}, beside {}: leave one",
                        lines.number,
                        mesh.name
                    ));
                }
                meshes.push(Mesh {
                    name,
                    ..Mesh::default()
                });
            }
        } else if let (true, Some(mesh)) = (is_mesh, meshes.last_mut()) {
            mesh.take(line, lines.number, &mut are_points)?;
        }
        if !lines.next()? {
            break;
        }
    }
    let mesh = meshes.first().ok_or_else(|| {
        refusal!(
            "the scan is a configuration without [bed_mesh NAME]: save the mesh first (SAVE_CONFIG)"
        )
    })?;
    mesh.add_to(mm_per_unit, cloud)
}

impl Mesh {
    fn take(&mut self, line: &str, number: u64, are_points: &mut bool) -> Result<(), Refusal> {
        let values = match line.split_once(['=', ':']) {
            Some((key, value)) => {
                *are_points = key.trim() == "points";
                if let Ok(value) = value.trim().parse() {
                    self.keys.insert(key.trim().to_string(), value);
                }
                if *are_points { value } else { "" }
            }
            None if *are_points => line,
            None => "",
        };
        for value in values.split(',').map(str::trim) {
            if value.is_empty() {
                continue;
            }
            let height = value.parse().map_err(|_| {
                let value = value.escape_debug();
                refusal!("line {number}: {value} is no height of the mesh")
            })?;
            self.heights.push(height);
        }
        match self.heights.len() > MESH_VALUES_MAX {
            true => Err(refusal!(
                "line {number}: the mesh has more than {MESH_VALUES_MAX} heights"
            )),
            false => Ok(()),
        }
    }

    fn add_to(&self, mm_per_unit: f64, cloud: &mut Cloud) -> Result<(), Refusal> {
        let lacks = |key: &str| refusal!("the mesh {} has no {key}: save it again", self.name);
        let key = |key: &str| self.keys.get(key).copied().ok_or_else(|| lacks(key));
        let [columns, rows] = [key("x_count")?, key("y_count")?];
        let ends = [
            [key("min_x")?, key("max_x")?],
            [key("min_y")?, key("max_y")?],
        ];
        let heights = self.heights.len();
        if columns < 2.0 || rows < 2.0 || columns * rows != heights as f64 {
            return Err(refusal!(
                "the mesh {} has {heights} heights and not {columns} x {rows}: save it again",
                self.name
            ));
        }
        let columns = columns as usize;
        let at = |[least, most]: [f64; 2], k: usize, count: usize| {
            least + (most - least) * k as f64 / (count - 1) as f64
        };
        for (number, height) in self.heights.iter().enumerate() {
            let x = at(ends[0], number % columns, columns);
            let y = at(ends[1], number / columns, heights / columns);
            cloud.add([x, y, *height].map(|x| x * mm_per_unit))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    //! Goal: height maps have their points where they are. Method: small ones by hand, and what is none.
    use super::super::Scale;
    use super::*;

    fn points(bytes: &[u8], scale: &Scale) -> Result<Vec<[f64; 3]>, Refusal> {
        let mut cloud = Cloud::new(0.01);
        super::super::read::read(&mut &bytes[..], scale, &mut cloud)?;
        let (points, first) = cloud.into_points()?;
        let whole = |p: &[f32; 3]| {
            [0, 1, 2].map(|k| ((f64::from(p[k]) + first[k]) * 1e4).round() / 1e4 + 0.0)
        };
        let mut all: Vec<[f64; 3]> = points.iter().map(whole).collect();
        all.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
        Ok(all)
    }

    fn png(color: ColorType, depth: BitDepth, size: [u32; 2], data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, size[0], size[1]);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(data).expect("as many as it has");
        writer.finish().expect("an end");
        bytes
    }

    fn scale() -> Scale {
        let picture = PictureScale {
            pixel_mm: 0.5,
            level_mm: 0.01,
        };
        Scale {
            picture: Some(picture),
            ..Scale::MM
        }
    }

    #[test]
    fn pictures_have_their_first_row_at_the_back() {
        let wide = png(
            ColorType::Grayscale,
            BitDepth::Sixteen,
            [2, 2],
            &[1, 0, 0, 0, 0, 3, 0, 4],
        );
        let expected = [[0.0, 0.0, 0.03], [0.0, 0.5, 2.56], [0.5, 0.0, 0.04]];
        assert_eq!(points(&wide, &scale()).expect("points"), expected);
        let narrow = png(ColorType::Grayscale, BitDepth::Eight, [2, 1], &[7, 255]);
        let expected = [[0.0, 0.0, 0.07], [0.5, 0.0, 2.55]];
        assert_eq!(points(&narrow, &scale()).expect("points"), expected);
    }

    #[test]
    fn what_is_no_height_map_is_refused() {
        let colours = png(ColorType::Rgb, BitDepth::Eight, [1, 1], &[1, 2, 3]);
        let grey = png(ColorType::Grayscale, BitDepth::Eight, [2, 2], &[1, 2, 3, 4]);
        let mut huge = grey.clone();
        // Width and height, 65,535 each; the sum over the header is wrong as well, but a maker of bombs would mend it.
        huge[16..24].copy_from_slice(&[0, 0, 255, 255, 0, 0, 255, 255]);
        let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&huge[12..29]);
        huge[29..33].copy_from_slice(&sum.to_be_bytes());
        for (bytes, scale, told) in [
            (&colours[..], scale(), "write it grey"),
            (&grey[..grey.len() - 20], scale(), "cannot be read"),
            (&huge[..], scale(), "65535 x 65535"),
            (&grey[..], Scale::MM, "--pixel"),
            (b"1 2 3\n", scale(), "is no PNG"),
        ] {
            let refused = points(bytes, &scale).expect_err(told).to_string();
            assert!(refused.contains(told), "{refused}");
        }
    }

    const SAVED_MESH: &str = "[bed_mesh]\nspeed: 120\nmesh_min: 5, 5\n\n#*# <---------------------- SAVE_CONFIG\n\
        #*# [bed_mesh default]\n#*# version = 1\n#*# points =\n#*# \t0.1, 0.2, 0.3\n#*# \t-0.1, 0.0, 0.25\n\
        #*# x_count = 3\n#*# y_count = 2\n#*# algo = lagrange\n#*# min_x = 10\n#*# max_x = 30\n\
        #*# min_y = 5\n#*# max_y = 25\n#*# [bltouch]\n#*# z_offset = 1.5\n";

    #[test]
    fn a_mesh_has_its_rows_from_front_to_back() {
        let expected = [
            [10.0, 5.0, 0.1],
            [10.0, 25.0, -0.1],
            [20.0, 5.0, 0.2],
            [20.0, 25.0, 0.0],
            [30.0, 5.0, 0.3],
            [30.0, 25.0, 0.25],
        ];
        let found = points(SAVED_MESH.as_bytes(), &Scale::MM);
        assert_eq!(found.expect("points"), expected);
    }

    #[test]
    fn meshes_that_are_none_are_refused() {
        let without = |what: &str| SAVED_MESH.replace(what, "");
        let second = SAVED_MESH.replace("[bltouch]", "[bed_mesh hot]");
        for (text, told) in [
            (without("#*# max_x = 30\n"), "has no max_x"),
            (without("-0.1, "), "5 heights and not 3 x 2"),
            (SAVED_MESH.replace("0.25", "x"), "line 10: x is no height"),
            (
                SAVED_MESH.replace("[bed_mesh default]", "[other]"),
                "SAVE_CONFIG",
            ),
            (second, "line 18: the scan has a second mesh, hot"),
        ] {
            let refused = points(text.as_bytes(), &Scale::MM).expect_err(told);
            assert!(refused.to_string().contains(told), "{refused}");
        }
    }
}
