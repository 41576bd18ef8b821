//! A model file of a 3MF package: its objects, and the items of its build.
//!
//! Resources may be in any order. Triangles get the colours of base materials and colour groups; textures and mixtures
//! are dropped; triangles painted by slicers are counted.

use super::roles::{KeyValues, Role};
use super::xml::{Part, Tag, read};
use super::{problem, too_many_parts};
use crate::mesh::Point3;
use crate::mesh::read::{TRIANGLES_MAX, too_many};
use crate::text::refusal::Refusal;
use std::collections::HashMap;
use std::io::BufRead;

/// Rows of a transform as the format has them: a point is a row in front of the matrix.
pub(super) type Transform = [f64; 12];
pub(super) const UNMOVED: Transform = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// What slicers paint on triangles, by the attributes of PrusaSlicer and of Bambu Studio and OrcaSlicer.
const PAINTS: [(&str, [&str; 2]); 4] = [
    ("supports", ["custom_supports", "paint_supports"]),
    ("seams", ["custom_seam", "paint_seam"]),
    ("fuzzy skin", ["fuzzy_skin", "paint_fuzzy_skin"]),
    ("colours", ["mmu_segmentation", "paint_color"]),
];

/// Triangles that are painted, by the places of [`PAINTS`].
pub(super) type Painted = [usize; PAINTS.len()];

/// As messages call them.
pub(super) fn paint_names() -> impl Iterator<Item = &'static str> {
    PAINTS.iter().map(|(name, _)| *name)
}

/// A model file.
#[derive(Debug, Default)]
pub(super) struct Model {
    /// Its place in the package.
    pub path: String,
    pub unit_mm: f64,
    pub objects: Vec<Object>,
    pub items: Vec<Item>,
}

/// A mesh, or several others as one.
#[derive(Debug, Default)]
pub(super) struct Object {
    pub id: usize,
    pub name: Option<String>,
    /// Its `type`; empty if it has none.
    pub kind: String,
    pub vertices: Vec<Point3>,
    pub triangles: Vec<[u32; 3]>,
    pub components: Vec<Item>,
    /// What Cura keeps with an object.
    pub settings: KeyValues,
    pub painted: Painted,
    /// The colour of each triangle whose corners have one in common; empty where no triangle has a colour.
    pub colours: Vec<Option<[u8; 3]>>,
    /// The colour of what names none itself.
    colour: Coloured,
    /// Triangles that name one.
    coloured: Vec<(u32, Coloured)>,
}

/// A group of colours, and the ones in it that corners have.
#[derive(Clone, Copy, Debug, Default)]
struct Coloured {
    group: Option<usize>,
    corners: [Option<usize>; 3],
}

/// Groups of colours by their numbers.
type ColourGroups = HashMap<usize, Vec<Option<[u8; 3]>>>;

/// An object that is placed, by the build or by another object.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub object: usize,
    /// The model file with the object, if it is another one.
    pub path: Option<String>,
    pub transform: Transform,
    pub is_printable: bool,
}

impl Object {
    /// The only thing that it is, if it has no triangles of its own.
    pub fn first_instance(&self) -> Option<&Item> {
        match self.components.as_slice() {
            [only] if self.triangles.is_empty() => Some(only),
            _ => None,
        }
    }

    /// The role given by its type or by Cura's settings.
    pub fn role(&self) -> Role {
        match self.kind.as_str() {
            "support" => Role::Support,
            "other" => Role::Other,
            _ => Role::of_cura(&self.settings),
        }
    }
}

/// What has been read of a model, and where in it the reader is.
struct Reading {
    model: Model,
    object: Option<Object>,
    /// The name of the Cura setting whose text is next.
    setting: Option<String>,
    /// Objects, items and components.
    declared: usize,
    declared_max: usize,
    groups: ColourGroups,
    /// The group whose colours are next.
    group: Option<usize>,
}

/// Reads a model.
///
/// # Errors
/// Text that is not XML, values that are not numbers, more than `declared_max` objects and items.
pub(super) fn read_model(
    path: &str,
    text: impl BufRead,
    declared_max: usize,
) -> Result<Model, Refusal> {
    let mut reading = Reading {
        model: Model {
            path: path.to_string(),
            unit_mm: 1.0,
            ..Model::default()
        },
        object: None,
        setting: None,
        declared: 0,
        declared_max,
        groups: ColourGroups::new(),
        group: None,
    };
    read(text, |part| reading.take(part))?;
    let Reading {
        mut model, groups, ..
    } = reading;
    for object in &mut model.objects {
        object.colour_by(&groups);
    }
    Ok(model)
}

impl Reading {
    fn take(&mut self, part: Part) -> Result<(), Refusal> {
        match part {
            Part::Open(tag) => self.open(&tag),
            Part::Close(name) => {
                match name.as_ref() {
                    "object" => self.model.objects.extend(self.object.take()),
                    "basematerials" | "colorgroup" => self.group = None,
                    _ => {}
                }
                self.setting = None;
                Ok(())
            }
            Part::Text(text) => {
                if let (Some(object), Some(name)) = (&mut self.object, self.setting.take()) {
                    object.settings.push((name, text.trim().to_string()));
                }
                Ok(())
            }
        }
    }

    fn open(&mut self, tag: &Tag) -> Result<(), Refusal> {
        match (tag.name().as_ref(), &mut self.object) {
            ("vertex", Some(object)) => {
                let [x, y, z] = tag.numbers(["x", "y", "z"])?;
                object.vertices.push(Point3::new(x, y, z));
            }
            ("triangle", Some(object)) => object.take_triangle(tag)?,
            ("component", Some(_)) => {
                let component = self.item(tag)?;
                if let Some(object) = &mut self.object {
                    object.components.push(component);
                }
            }
            // Cura: `cura:NAME` within a group, or a list of its own in old files.
            ("metadata", Some(_)) => {
                let name = tag.get("name").unwrap_or_default();
                self.setting = name.strip_prefix("cura:").map(str::to_string);
            }
            ("setting", Some(_)) => self.setting = tag.get("key"),
            ("object", None) => {
                self.declare()?;
                self.object = Some(Object {
                    id: tag.number("id")?,
                    name: tag.get("name").filter(|name| !name.is_empty()),
                    kind: tag.get("type").unwrap_or_default(),
                    colour: Coloured {
                        group: tag.number("pid").ok(),
                        corners: [tag.number("pindex").ok(); 3],
                    },
                    ..Object::default()
                });
            }
            ("basematerials" | "colorgroup", None) => self.group = tag.number("id").ok(),
            ("base", None) => self.add_colour(tag.get("displaycolor")),
            ("color", None) => self.add_colour(tag.get("color")),
            ("item", None) => {
                let item = self.item(tag)?;
                self.model.items.push(item);
            }
            ("model", None) => self.model.unit_mm = unit_mm(tag)?,
            _ => {}
        }
        Ok(())
    }

    /// The next colour of its group.
    fn add_colour(&mut self, text: Option<String>) {
        if let Some(group) = self.group {
            let colour = text.and_then(|text| colour_of(&text));
            self.groups.entry(group).or_default().push(colour);
        }
    }

    fn declare(&mut self) -> Result<(), Refusal> {
        self.declared += 1;
        let max = self.declared_max;
        match self.declared > max {
            true => Err(too_many_parts(max)),
            false => Ok(()),
        }
    }

    fn item(&mut self, tag: &Tag) -> Result<Item, Refusal> {
        self.declare()?;
        let printable = tag.get("printable");
        let is_printable = !matches!(printable.as_deref(), Some("0" | "false"));
        Ok(Item {
            object: tag.number("objectid")?,
            path: tag.get("path"),
            transform: transform(tag)?,
            is_printable,
        })
    }
}

impl Object {
    fn take_triangle(&mut self, tag: &Tag) -> Result<(), Refusal> {
        let triangles = self.triangles.len() + 1;
        if triangles > TRIANGLES_MAX {
            return Err(too_many(triangles));
        }
        self.triangles.push(tag.numbers(["v1", "v2", "v3"])?);
        let mut coloured = Coloured::default();
        tag.for_attributes(|name, value| {
            coloured.take(name, value);
            let is_it = |names: &[&str; 2]| names.iter().any(|n| n.as_bytes() == name);
            if let Some(paint) = PAINTS.iter().position(|(_, names)| is_it(names)) {
                self.painted[paint] += 1;
            }
        });
        if coloured.group.is_some() || coloured.corners[0].is_some() {
            self.coloured.push((triangles as u32 - 1, coloured));
        }
        Ok(())
    }

    /// Gives each triangle the colour that its corners have in common.
    fn colour_by(&mut self, groups: &ColourGroups) {
        let own = self.colour.of_all(groups);
        if groups.is_empty() || (own.is_none() && self.coloured.is_empty()) {
            return;
        }
        self.colours = vec![own; self.triangles.len()];
        for (triangle, coloured) in std::mem::take(&mut self.coloured) {
            self.colours[triangle as usize] = coloured.or(&self.colour).of_all(groups);
        }
    }
}

impl Coloured {
    /// From an attribute of a triangle.
    fn take(&mut self, name: &[u8], value: &[u8]) {
        let number = || std::str::from_utf8(value).ok()?.trim().parse().ok();
        match name {
            b"pid" => self.group = number(),
            b"p1" => self.corners[0] = number(),
            b"p2" => self.corners[1] = number(),
            b"p3" => self.corners[2] = number(),
            _ => {}
        }
    }

    /// What a triangle leaves out is its object's, and the second and third corner are as the first.
    fn or(self, object: &Coloured) -> Coloured {
        let first = self.corners[0].or(object.corners[0]);
        Coloured {
            group: self.group.or(object.group),
            corners: self.corners.map(|corner| corner.or(first)),
        }
    }

    /// The colour that all corners have.
    fn of_all(&self, groups: &ColourGroups) -> Option<[u8; 3]> {
        let group = groups.get(&self.group?)?;
        let [a, b, c] = self.corners.map(|corner| *group.get(corner?)?);
        a.filter(|_| a == b && b == c)
    }
}

/// `#RRGGBB` with or without an opacity.
fn colour_of(text: &str) -> Option<[u8; 3]> {
    let digits = text.trim().strip_prefix('#')?;
    let is_one = matches!(digits.len(), 6 | 8) && digits.bytes().all(|b| b.is_ascii_hexdigit());
    let digits = digits.get(..6).filter(|_| is_one)?;
    let [_, colour @ ..] = u32::from_str_radix(digits, 16).ok()?.to_be_bytes();
    Some(colour)
}

fn unit_mm(tag: &Tag) -> Result<f64, Refusal> {
    let unit = tag.get("unit");
    Ok(match unit.as_deref() {
        Some("micron") => 0.001,
        Some("millimeter") | None => 1.0,
        Some("centimeter") => 10.0,
        Some("inch") => 25.4,
        Some("foot") => 304.8,
        Some("meter") => 1000.0,
        Some(other) => return Err(problem(&format!("its unit is `{other}`"))),
    })
}

fn transform(tag: &Tag) -> Result<Transform, Refusal> {
    let Some(text) = tag.get("transform").filter(|text| !text.trim().is_empty()) else {
        return Ok(UNMOVED);
    };
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|n| n.parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| problem(&format!("a transform is not twelve numbers: `{text}`")))
}
