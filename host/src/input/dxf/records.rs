//! The text of a DXF file -> the entities that are read, units, a list of what is ignored.
//!
//! A DXF file is pairs of lines, a group code and its value. An entity is complete, has finite numbers and
//! knows its first line's number, or is refused with it. In: bytes, chosen layers. Out: entities by their
//! groups, in the file's unit.
//! Source: AutoCAD DXF reference, "Group code value types". Not covered: blocks, objects and tables
//! other than that of the layers.

use super::syntax;
use crate::input::names::{part_name, shortened};
use crate::text::refusal::{Refusal, refusal};
use std::collections::{BTreeMap, HashMap};

/// Most entities that are read, corners of old polylines among them: each is joined to its neighbours.
const ENTITIES_MAX: usize = 300_000;
/// Most names of layers and kinds of entities in a message.
const NAMES_MAX: usize = 20;
/// The entities that are read: the groups that each must have, and those that it may have.
const KINDS: [(&str, &[i32], &[i32]); 8] = [
    ("LINE", &[10, 20, 11, 21], &[]),
    ("CIRCLE", &[10, 20, 40], &[210, 220, 230]),
    ("ARC", &[10, 20, 40, 50, 51], &[210, 220, 230]),
    ("LWPOLYLINE", &[10, 20], &[42, 70, 210, 220, 230]),
    ("POLYLINE", &[], &[70, 210, 220, 230]),
    ("VERTEX", &[10, 20], &[42, 70]),
    ("ELLIPSE", &[10, 20, 11, 21, 40], &[41, 42, 210, 220, 230]),
    ("SPLINE", &[10, 20, 40, 71], &[41]),
];

/// A group code and its value.
#[derive(Clone, Copy)]
struct Pair<'a> {
    code: i32,
    value: &'a str,
    line: usize,
}

/// One entity, or a polyline with its corners.
pub(super) struct Entity<'a> {
    pub kind: &'a str,
    /// For messages: `LINE of line 12`.
    pub what: String,
    /// Group codes and numbers that are read, in the order of the file.
    groups: Vec<(i32, f64)>,
}

impl Entity<'_> {
    /// All numbers of a group.
    pub fn all(&self, code: i32) -> impl Iterator<Item = f64> {
        let of_code = self.groups.iter().filter(move |group| group.0 == code);
        of_code.map(|group| group.1)
    }

    /// The number of a group that occurs once: where it is repeated, the last one counts.
    pub fn one(&self, code: i32, default: f64) -> f64 {
        self.all(code).last().unwrap_or(default)
    }

    /// The bulge of each corner of a polyline: group 10 begins a corner.
    pub fn bulges(&self) -> Vec<f64> {
        let mut bulges = Vec::new();
        for &(code, number) in &self.groups {
            match (code, bulges.last_mut()) {
                (10, _) => bulges.push(0.0),
                (42, Some(last)) => *last = number,
                _ => {}
            }
        }
        bulges
    }
}

/// What a file holds.
#[derive(Default)]
pub(super) struct Found<'a> {
    pub entities: Vec<Entity<'a>>,
    /// `$INSUNITS`, where the header has it.
    pub units: Option<i32>,
    pub notes: Vec<String>,
}

/// How a layer is.
#[derive(Clone, Default)]
struct Layer {
    name: String,
    is_hidden: bool,
}

/// Findings of the scan through the entities.
#[derive(Default)]
struct Reader<'a> {
    chosen: Vec<String>,
    layers: HashMap<String, Layer>,
    found: Found<'a>,
    count: usize,
    left_out: BTreeMap<&'a str, usize>,
    on_hidden: BTreeMap<String, usize>,
    on_others: usize,
    of_paper: usize,
    unseen: usize,
    wide: usize,
    heights: Option<[f64; 2]>,
}

/// Reads the entities of a file.
pub(super) fn read<'a>(text: &'a str, layers: &[String]) -> Result<Found<'a>, Refusal> {
    let pairs = pairs(text)?;
    let mut reader = Reader {
        chosen: layers.iter().map(|name| name.to_lowercase()).collect(),
        ..Reader::default()
    };
    let sections = sections(&pairs)?;
    for (name, pairs) in &sections {
        match *name {
            "HEADER" => reader.header(pairs)?,
            "TABLES" => reader.tables(pairs),
            _ => {}
        }
    }
    let entities = || sections.iter().filter(|(name, _)| *name == "ENTITIES");
    for (_, pairs) in entities() {
        reader.name_layers(pairs);
    }
    reader.check_layers(layers)?;
    for (_, pairs) in entities() {
        reader.entities(pairs)?;
    }
    reader.tell();
    Ok(reader.found)
}

/// All pairs up to the end mark.
fn pairs(text: &str) -> Result<Vec<Pair<'_>>, Refusal> {
    let mut lines = text.lines().zip(1..);
    let mut pairs = Vec::new();
    let mut last = 0;
    while let Some((code, line)) = lines.next() {
        last = line;
        let number = code.trim().parse::<i32>().map_err(|_| {
            let code = shortened(code.trim());
            syntax(format!("line {line}: '{code}' where a group code is due"))
        })?;
        let Some((value, _)) = lines.next() else {
            break;
        };
        let value = value.trim();
        if number == 0 && value == "EOF" {
            return Ok(pairs);
        }
        // Comments.
        if number != 999 {
            pairs.push(Pair {
                code: number,
                value,
                line,
            });
        }
    }
    Err(syntax(format!(
        "it ends at line {last} without its end mark (EOF): it is cut off; write it again"
    )))
}

/// The sections, by name.
fn sections<'a, 'b>(pairs: &'b [Pair<'a>]) -> Result<Vec<(&'a str, &'b [Pair<'a>])>, Refusal> {
    let mut sections = Vec::new();
    let mut rest: &[Pair] = pairs;
    while let Some(first) = rest.first() {
        let line = first.line;
        let name = match rest {
            [start, name, ..] if (start.code, start.value, name.code) == (0, "SECTION", 2) => {
                name.value
            }
            _ => return Err(syntax(format!("line {line}: a section is due here"))),
        };
        let is_end = |pair: &Pair| pair.code == 0 && pair.value == "ENDSEC";
        let Some(end) = rest.iter().position(is_end) else {
            let name = shortened(name);
            return Err(syntax(format!(
                "the section {name} of line {line} has no end: the file is damaged; write it again"
            )));
        };
        sections.push((name, &rest[2.min(end)..end]));
        rest = &rest[end + 1..];
    }
    Ok(sections)
}

/// Pairs from one code 0 to the next.
fn groups<'a, 'b>(pairs: &'b [Pair<'a>]) -> impl Iterator<Item = &'b [Pair<'a>]> {
    let first = pairs.iter().position(|pair| pair.code == 0);
    let pairs = &pairs[first.unwrap_or(pairs.len())..];
    pairs.chunk_by(|_, next| next.code != 0)
}

fn value<'a>(group: &[Pair<'a>], code: i32) -> Option<&'a str> {
    let pair = group.iter().find(|pair| pair.code == code)?;
    Some(pair.value)
}

fn layer_of<'a>(group: &[Pair<'a>]) -> &'a str {
    value(group, 8).unwrap_or("0")
}

fn number(pair: &Pair) -> Result<f64, Refusal> {
    let found = pair.value.parse::<f64>().ok();
    found.filter(|number| number.is_finite()).ok_or_else(|| {
        let (line, value) = (pair.line + 1, shortened(pair.value));
        syntax(format!("line {line}: '{value}' is no finite number"))
    })
}

fn whole(pair: &Pair) -> Result<i16, Refusal> {
    pair.value.parse::<i16>().map_err(|_| {
        let (line, value) = (pair.line + 1, shortened(pair.value));
        syntax(format!("line {line}: '{value}' is no whole number"))
    })
}

fn is_wide(kind: &str) -> bool {
    kind.ends_with("POLYLINE") || kind == "VERTEX"
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let all: Vec<&str> = names.collect();
    let shown = all.iter().take(NAMES_MAX);
    let shown: Vec<String> = shown
        .map(|name| shortened(&part_name(name).unwrap_or_default()))
        .collect();
    let more = all.len().saturating_sub(NAMES_MAX);
    match more {
        0 => shown.join(", "),
        more => format!("{} and {more} more", shown.join(", ")),
    }
}

impl<'a> Reader<'a> {
    fn header(&mut self, pairs: &[Pair]) -> Result<(), Refusal> {
        for two in pairs.windows(2) {
            if (two[0].code, two[0].value, two[1].code) == (9, "$INSUNITS", 70) {
                self.found.units = Some(i32::from(whole(&two[1])?));
            }
        }
        Ok(())
    }

    fn tables(&mut self, pairs: &[Pair]) {
        for group in groups(pairs) {
            if group[0].value != "LAYER" {
                continue;
            }
            let Some(name) = value(group, 2) else {
                continue;
            };
            let number = |code| value(group, code).and_then(|text| text.parse::<i32>().ok());
            let is_frozen = number(70).is_some_and(|flags| flags & 1 != 0);
            let is_off = number(62).is_some_and(|colour| colour < 0);
            let layer = Layer {
                name: name.to_string(),
                is_hidden: is_frozen || is_off,
            };
            self.layers.insert(name.to_lowercase(), layer);
        }
    }

    /// Layers that entities name and the table does not.
    fn name_layers(&mut self, pairs: &[Pair]) {
        for group in groups(pairs) {
            let name = layer_of(group);
            let layer = self.layers.entry(name.to_lowercase()).or_default();
            if layer.name.is_empty() {
                layer.name = name.to_string();
            }
        }
    }

    fn check_layers(&self, asked: &[String]) -> Result<(), Refusal> {
        for (name, key) in asked.iter().zip(&self.chosen) {
            if !self.layers.contains_key(key) {
                let mut there: Vec<&str> = self.layers.values().map(|l| l.name.as_str()).collect();
                there.sort_unstable();
                return Err(refusal!(
                    "there is no layer '{given}'; the drawing has {there}",
                    given = shortened(name),
                    there = listed(there.into_iter())
                ));
            }
        }
        Ok(())
    }

    fn entities(&mut self, pairs: &[Pair<'a>]) -> Result<(), Refusal> {
        if pairs.first().is_some_and(|first| first.code != 0) {
            let line = pairs[0].line;
            return Err(syntax(format!("line {line}: an entity is due here")));
        }
        let mut groups = groups(pairs).peekable();
        while let Some(group) = groups.next() {
            let (kind, line) = (group[0].value, group[0].line);
            let corners = std::iter::from_fn(|| {
                groups.next_if(|next| kind == "POLYLINE" && next[0].value == "VERTEX")
            });
            let corners: Vec<&[Pair]> = corners.collect();
            if matches!(kind, "SEQEND" | "ATTRIB") || !self.is_wanted(group)? {
                continue;
            }
            let what = format!("{kind} of line {line}");
            let mut entity = self.entity(group, what)?;
            for corner in &corners {
                let corner = self.entity(corner, String::new())?;
                // Flag 16 marks the control points of a polyline that was made a spline.
                if corner.one(70, 0.0) as i32 & 16 == 0 {
                    let of_corner = [10, 20, 42].map(|code| (code, corner.one(code, 0.0)));
                    entity.groups.extend(of_corner);
                }
            }
            self.count += 1 + corners.len();
            if self.count > ENTITIES_MAX {
                return Err(syntax(format!(
                    "more than {ENTITIES_MAX} entities: choose layers with --dxf-layer, or simplify \
                     the drawing"
                )));
            }
            self.found.entities.push(entity);
        }
        Ok(())
    }

    /// True for an entity that is to be read; the others are counted.
    fn is_wanted(&mut self, group: &[Pair<'a>]) -> Result<bool, Refusal> {
        let (kind, line) = (group[0].value, group[0].line);
        let key = layer_of(group).to_lowercase();
        let is_set = |code, bits: i32| {
            let flags = value(group, code).and_then(|text| text.parse::<i32>().ok());
            flags.is_some_and(|flags| flags & bits != 0)
        };
        if !self.chosen.is_empty() && !self.chosen.contains(&key) {
            self.on_others += 1;
        } else if let (true, Some(layer)) = (
            self.chosen.is_empty(),
            self.layers.get(&key).filter(|layer| layer.is_hidden),
        ) {
            *self.on_hidden.entry(layer.name.clone()).or_default() += 1;
        } else if is_set(67, 1) {
            self.of_paper += 1;
        } else if is_set(60, 1) {
            self.unseen += 1;
        } else if kind == "VERTEX" {
            return Err(syntax(format!("line {line}: a VERTEX of no POLYLINE")));
        } else if !KINDS.iter().any(|known| known.0 == kind) {
            *self.left_out.entry(kind).or_default() += 1;
        } else if kind == "POLYLINE" && is_set(70, 16 | 64) {
            *self.left_out.entry("POLYLINE of a mesh").or_default() += 1;
        } else {
            return Ok(true);
        }
        Ok(false)
    }

    /// An entity of the groups that are read, with each number checked.
    fn entity(&mut self, group: &[Pair<'a>], what: String) -> Result<Entity<'a>, Refusal> {
        let (kind, line) = (group[0].value, group[0].line);
        let known = KINDS.iter().find(|known| known.0 == kind);
        let (needed, more) = known.map_or((&[][..], &[][..]), |known| (known.1, known.2));
        let count = |code: i32| group.iter().filter(|pair| pair.code == code).count();
        if let Some(code) = needed.iter().find(|code| count(**code) == 0) {
            return Err(syntax(match (kind, count(11)) {
                ("SPLINE", 1..) => format!(
                    "the SPLINE of line {line} has points that it runs through and no control points: \
                     save it with control points, or as a polyline"
                ),
                _ => format!("the {kind} of line {line} is not whole: it has no group {code}"),
            }));
        }
        if count(10) != count(20) {
            let (x, y) = (count(10), count(20));
            return Err(syntax(format!(
                "the {kind} of line {line} is not whole: {x} x and {y} y coordinates"
            )));
        }
        let first = group.iter().find(|pair| matches!(pair.code, 10 | 42));
        if kind == "LWPOLYLINE" && first.is_some_and(|pair| pair.code == 42) {
            return Err(syntax(format!(
                "the {kind} of line {line} has its groups in an order that cannot be read: a bulge \
                 (42) before its corner (10)"
            )));
        }
        let mut groups = Vec::new();
        for pair in &group[1..] {
            match pair.code {
                code if needed.contains(&code) || more.contains(&code) => {
                    let number = match code {
                        70 | 71 => f64::from(whole(pair)?),
                        _ => number(pair)?,
                    };
                    groups.push((code, number));
                }
                30 | 31 | 38 => self.height(number(pair)?),
                40 | 41 | 43 if is_wide(kind) && number(pair)? != 0.0 => self.wide += 1,
                _ => {}
            }
        }
        Ok(Entity { kind, what, groups })
    }

    fn height(&mut self, z: f64) {
        let [low, high] = self.heights.unwrap_or([z; 2]);
        self.heights = Some([low.min(z), high.max(z)]);
    }

    /// What the user should know.
    fn tell(&mut self) {
        let notes = &mut self.found.notes;
        if !self.left_out.is_empty() {
            let each = self.left_out.iter();
            let counts: Vec<String> = each.map(|(kind, n)| format!("{n} {kind}")).collect();
            let has_blocks = self.left_out.contains_key("INSERT");
            let advice = match has_blocks {
                true => " (explode blocks, INSERT, in the drawing program)",
                false => "",
            };
            notes.push(format!(
                "entities that are not read were left out: {}{advice}",
                listed(counts.iter().map(String::as_str))
            ));
        }
        if !self.on_hidden.is_empty() {
            let count: usize = self.on_hidden.values().sum();
            notes.push(format!(
                "{count} entities on layers that are frozen or off were left out: {} (--dxf-layer reads \
                 them)",
                listed(self.on_hidden.keys().map(String::as_str))
            ));
        }
        for (count, what) in [
            (self.on_others, "entities on layers that were not chosen"),
            (self.of_paper, "entities of the paper space"),
            (self.unseen, "invisible entities"),
        ] {
            if count > 0 {
                notes.push(format!("{count} {what} were left out"));
            }
        }
        if self.wide > 0 {
            notes.push(
                "widths of polylines were passed over: their centre lines are read".to_string(),
            );
        }
        if let Some([low, high]) = self.heights.filter(|[low, high]| low != high) {
            notes.push(format!(
                "heights were passed over: z from {low} to {high} in the file"
            ));
        }
    }
}
