//! Bytes of a scan to its points: rows of numbers (CSV, XYZ), PLY or a height map, read once from front to end.
//!
//! In: a reader, a [`Scale`]. Out: points added to a [`Cloud`]. Of PLY: ASCII and binary of either byte order, vertices first,
//! without lists in them. Height maps: `height_map`. Not covered: meshes' faces (their vertices are the points).

use super::Scale;
use super::cloud::Cloud;
use super::height_map;
use crate::text::refusal::{Refusal, refusal};
use std::io::{BufRead, Read};

/// Longest line, bytes.
const LINE_MAX: u64 = 4096;
/// Most lines of a PLY's header.
const HEADER_LINES_MAX: usize = 200;

/// Reads all of it; PNG, PLY and Klipper's meshes are known by how they begin.
///
/// # Errors
/// A `Refusal` with the line.
pub fn read(input: &mut impl BufRead, scale: &Scale, cloud: &mut Cloud) -> Result<(), Refusal> {
    let start = input.fill_buf();
    let start = start.map_err(|error| refusal!("the scan cannot be read: {error}"))?;
    match (start.starts_with(height_map::PNG), scale.picture) {
        (true, Some(picture)) => return height_map::picture(input, picture, cloud),
        (true, None) => {
            return Err(refusal!(
                "the scan is a picture: give the side of a pixel and the height of a grey level in mm (--pixel 0.02 --level 0.001)"
            ));
        }
        (false, Some(_)) => {
            return Err(refusal!(
                "the scan is no PNG: leave out the side of a pixel and the height of a level (--pixel, --level)"
            ));
        }
        (false, None) => {}
    }
    let mut lines = Lines::of(input);
    let mm_per_unit = scale.mm_per_unit;
    if !lines.next()? {
        return Ok(());
    }
    match lines.text.trim_ascii() == b"ply" {
        true => ply(lines, mm_per_unit, cloud),
        false => rows(lines, mm_per_unit, cloud),
    }
}

pub(super) struct Lines<'a, R> {
    input: &'a mut R,
    pub(super) text: Vec<u8>,
    pub(super) number: u64,
}

impl<'a, R: BufRead> Lines<'a, R> {
    fn of(input: &'a mut R) -> Self {
        Lines {
            input,
            text: Vec::with_capacity(256),
            number: 0,
        }
    }

    /// False at the end.
    pub(super) fn next(&mut self) -> Result<bool, Refusal> {
        self.text.clear();
        self.number += 1;
        let limited = &mut self.input.by_ref().take(LINE_MAX);
        let bytes = limited.read_until(b'\n', &mut self.text);
        match bytes {
            Ok(bytes) if bytes as u64 == LINE_MAX => Err(refusal!(
                "line {} of the scan is longer than {LINE_MAX} bytes: give CSV, XYZ or PLY",
                self.number
            )),
            Ok(bytes) => Ok(bytes > 0),
            Err(error) => Err(refusal!("the scan cannot be read: {error}")),
        }
    }

    pub(super) fn fields(&self) -> impl Iterator<Item = &str> {
        let text = str::from_utf8(&self.text).unwrap_or_default().trim();
        text.split([',', ';', '\t', ' '])
            .filter(|field| !field.is_empty())
    }

    /// The columns of x, y and z of a line of numbers; `None` where it is short of one.
    fn point(&self, columns: [usize; 3]) -> Option<[f64; 3]> {
        let mut found = [f64::NAN; 3];
        let mut left = 3;
        for (column, field) in self.fields().enumerate() {
            if let Some(axis) = columns.iter().position(|of| *of == column) {
                found[axis] = field.parse().ok()?;
                left -= 1;
                if left == 0 {
                    return Some(found);
                }
            }
        }
        None
    }
}

fn add(point: Option<[f64; 3]>, mm_per_unit: f64, cloud: &mut Cloud) -> Result<(), Refusal> {
    cloud.add(point.map_or([f64::NAN; 3], |point| point.map(|x| x * mm_per_unit)))
}

/// Rows of numbers, after a line of names or none; four columns without names are t, x, y, z.
fn rows(
    mut lines: Lines<impl BufRead>,
    mm_per_unit: f64,
    cloud: &mut Cloud,
) -> Result<(), Refusal> {
    let is_number = |field: &str| field.parse::<f64>().is_ok();
    let is_comment = |line: &[u8]| line.trim_ascii().is_empty() || line.starts_with(b"#");
    while is_comment(&lines.text) {
        if height_map::is_section(&lines.text) {
            return height_map::klipper(lines, mm_per_unit, cloud);
        }
        if !lines.next()? {
            return Ok(());
        }
    }
    if height_map::is_section(&lines.text) {
        return height_map::klipper(lines, mm_per_unit, cloud);
    }
    let names: Vec<String> = lines.fields().map(|name| name.to_lowercase()).collect();
    let has_names = !names.iter().all(|name| is_number(name));
    let columns = match (has_names, names.len()) {
        (false, 4) => [1, 2, 3],
        (false, _) => [0, 1, 2],
        (true, _) => {
            let of = |axis: &str| {
                names
                    .iter()
                    .position(|name| name.trim_end_matches("_mm") == axis)
            };
            let [Some(x), Some(y), Some(z)] = ["x", "y", "z"].map(of) else {
                let line = lines.number;
                return Err(refusal!(
                    "line {line} of the scan names no columns x, y and z: give rows of x, y, z"
                ));
            };
            [x, y, z]
        }
    };
    if !has_names {
        add(lines.point(columns), mm_per_unit, cloud)?;
    }
    while lines.next()? {
        if !is_comment(&lines.text) {
            add(lines.point(columns), mm_per_unit, cloud)?;
        }
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Order {
    Text,
    Little,
    Big,
}

fn ply(mut lines: Lines<impl BufRead>, mm_per_unit: f64, cloud: &mut Cloud) -> Result<(), Refusal> {
    let (mut order, mut count, mut properties) = (None, None, Vec::new());
    let mut is_vertex = false;
    loop {
        if !lines.next()? || lines.number > HEADER_LINES_MAX as u64 {
            return Err(refusal!(
                "the PLY's header has no end_header in its first {HEADER_LINES_MAX} lines"
            ));
        }
        let words: Vec<&str> = lines.fields().collect();
        match words[..] {
            ["end_header"] => break,
            ["format", "ascii", _] => order = Some(Order::Text),
            ["format", "binary_little_endian", _] => order = Some(Order::Little),
            ["format", "binary_big_endian", _] => order = Some(Order::Big),
            ["element", "vertex", number] => {
                (is_vertex, count) = (true, number.parse::<u64>().ok())
            }
            ["element", ..] if count.is_none() => {
                return Err(refusal!(
                    "the PLY's first element is no vertex: write its points first"
                ));
            }
            ["element", ..] => is_vertex = false,
            ["property", kind, name] if is_vertex => {
                properties.push((name.to_string(), size_of_type(kind)?));
            }
            ["property", ..] if is_vertex => {
                return Err(refusal!(
                    "the PLY's vertices have a list: write them without"
                ));
            }
            _ => {}
        }
    }
    let place = |axis: &str| properties.iter().position(|(name, _)| name == axis);
    let ([Some(x), Some(y), Some(z)], Some(order), Some(count)) =
        (["x", "y", "z"].map(place), order, count)
    else {
        return Err(refusal!(
            "the PLY's header names no format, or no vertices with x, y and z"
        ));
    };
    let columns = [x, y, z];
    let cut =
        |read: u64| refusal!("the PLY ends after {read} of its {count} points; copy it again");
    let offset = |column: usize| {
        properties[..column]
            .iter()
            .map(|(_, (size, _))| size)
            .sum::<usize>()
    };
    let mut record = vec![0; offset(properties.len())];
    for number in 0..count {
        let point = if order == Order::Text {
            if !lines.next()? {
                return Err(cut(number));
            }
            lines.point(columns)
        } else {
            let read = lines.input.read_exact(&mut record);
            read.map_err(|_| cut(number))?;
            Some(
                columns.map(|column| value(&record[offset(column)..], properties[column].1, order)),
            )
        };
        add(point, mm_per_unit, cloud)?;
    }
    Ok(())
}

/// Bytes of a type, and whether it is a float.
fn size_of_type(kind: &str) -> Result<(usize, bool), Refusal> {
    Ok(match kind {
        "char" | "uchar" | "int8" | "uint8" => (1, false),
        "short" | "ushort" | "int16" | "uint16" => (2, false),
        "int" | "uint" | "int32" | "uint32" => (4, false),
        "float" | "float32" => (4, true),
        "double" | "float64" => (8, true),
        _ => {
            return Err(refusal!(
                "the PLY's header has an unknown type, {}",
                kind.escape_debug()
            ));
        }
    })
}

/// Coordinates are floats: integers are taken as none.
fn value(bytes: &[u8], (size, is_float): (usize, bool), order: Order) -> f64 {
    let mut wide = [0; 8];
    for (k, byte) in wide[..size].iter_mut().enumerate() {
        *byte = bytes[if order == Order::Little {
            k
        } else {
            size - 1 - k
        }];
    }
    let bits = u64::from_le_bytes(wide);
    match (is_float, size) {
        (true, 8) => f64::from_bits(bits),
        (true, _) => f64::from(f32::from_bits(bits as u32)),
        (false, _) => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    //! Goal: the formats are read alike, and what is none is refused with its line. Method: one point in each.
    use super::*;

    fn points(bytes: &[u8]) -> Result<(Vec<[f32; 3]>, [f64; 3]), Refusal> {
        let mut cloud = Cloud::new(0.1);
        read(&mut &bytes[..], &Scale::MM, &mut cloud)?;
        cloud.into_points()
    }

    #[test]
    fn formats_are_read_alike() {
        let head = |format: &str, count: u32| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty uchar r\n\
                 property float y\nproperty float z\nend_header\n"
            )
        };
        let mut binary = head("binary_big_endian", 1).into_bytes();
        for (number, value) in [1f32, 2.0, 3.0].into_iter().enumerate() {
            binary.extend(value.to_be_bytes());
            binary.extend(&[7u8][..usize::from(number == 0)]);
        }
        let ascii = head("ascii", 1) + "1 7 2 3\n";
        for bytes in [
            b"1 2 3\n".as_slice(),
            b"# scan\nt;y_mm;x_mm;z_mm\n0;2;1;3\n",
            b"0.5,1,2,3\n",
            ascii.as_bytes(),
            &binary,
        ] {
            assert_eq!(points(bytes).expect("a point").1, [1.0, 2.0, 3.0]);
        }
        for (bytes, told) in [
            (b"a,b,c\n1,2,3\n".to_vec(), "line 1"),
            (vec![b'1'; 5000], "line 1"),
            (head("ascii", 2).into_bytes(), "0 of its 2 points"),
            (b"ply\nformat ascii 1.0\n".to_vec(), "end_header"),
        ] {
            let refused = points(&bytes).expect_err("no scan").to_string();
            assert!(refused.contains(told), "{refused}");
        }
    }
}
