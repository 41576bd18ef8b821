//! Kinds of results, and how a file of each is recognised: a result replaces an older one of its kind and nothing else.

use crate::job::file::MAGIC;
use crate::joint_export::tables::FIRST_COLUMNS;
use crate::plan::headings::headings_table::HEADER;
use crate::programs::text::WRITTEN_BY;
use crate::report::pose_table::POSE_HEADER;
use crate::settings::directions::FIRST_LINE;
use headway_firmware::settings::BoardSettings;

/// Bytes at the start of a file by which its kind is judged: more than a board's settings have.
pub(crate) const HEAD_BYTES: u64 = 4096;

/// A kind of result.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ResultKind {
    /// What it is, in messages.
    pub name: &'static str,
    /// True for the start of a file that is one.
    pub is_one: fn(&[u8]) -> bool,
    /// Values in it are somebody's own: only the same bytes replace it.
    pub is_kept: bool,
}

const fn kind(name: &'static str, is_one: fn(&[u8]) -> bool) -> ResultKind {
    ResultKind {
        name,
        is_one,
        is_kept: false,
    }
}

impl ResultKind {
    const fn kept(self) -> ResultKind {
        ResultKind {
            is_kept: true,
            ..self
        }
    }
}

pub(crate) const JOB: ResultKind = kind("a job", |head| head.starts_with(MAGIC));
/// The job of a pattern to measure: printed once, read later.
pub(crate) const PATTERN: ResultKind = JOB.kept();
pub(crate) const MACHINE: ResultKind = kind("a machine file", |head| {
    head.starts_with(b"# Headway machine file")
})
.kept();
/// A log is what a print is resumed from: none is ever replaced.
pub(crate) const LOG: ResultKind = kind("an empty file", |_| false).kept();
pub(crate) const PROGRAM: ResultKind = kind("a program of headway", |head| {
    String::from_utf8_lossy(head).contains(WRITTEN_BY)
});
pub(crate) const DIRECTIONS: ResultKind = kind("directions that headway found", |head| {
    head.starts_with(FIRST_LINE.as_bytes())
});
pub(crate) const TABLE: ResultKind = kind("a table of headway", |head| {
    let joints = FIRST_COLUMNS.join(",");
    let heads = [POSE_HEADER, "t_us,motor,dir", HEADER, &joints];
    heads.iter().any(|of| head.starts_with(of.as_bytes()))
});
/// Drawings begin with a sheet of their own; of a drawing program none does.
pub(crate) const PICTURE: ResultKind = kind("a picture of headway", |head| {
    let head = String::from_utf8_lossy(head);
    let sheet = head.split_once("xmlns=\"http://www.w3.org/2000/svg\">\n<rect fill=\"");
    head.starts_with("<svg ")
        && sheet.is_some_and(|(svg, rest)| {
            !svg.contains('>') && rest.contains("height=\"100%\" width=\"100%\"/>")
        })
});
pub(crate) const GCODE: ResultKind =
    kind("G-code of headway", |head| head.starts_with(b";headway "));
pub(crate) const JSON: ResultKind = kind("JSON of headway", |head| {
    let heads: [&[u8]; 3] = [
        b"{\n  \"channels\": [",
        b"{\n  \"columns\": [",
        b"{\"header\": {\"stamp\": {\"sec\": 0",
    ];
    heads.iter().any(|of| head.starts_with(of))
});
pub(crate) const YAML: ResultKind = kind("YAML of headway", |head| {
    head.starts_with(b"header:\n  stamp: {sec: 0")
});
pub(crate) const BED_MESH: ResultKind = kind("a mesh of the bed", |head| {
    head.starts_with(b"# Where the nozzle touches the bed")
});
pub(crate) const BOARD_SETTINGS: ResultKind = kind("a board's settings", |head| {
    BoardSettings::decode(head).is_ok()
});
/// Whoever opens it looks whether it is one.
pub(crate) const FLASH: ResultKind = kind("the flash of a simulated board", |_| true);
pub(crate) const MANUAL: ResultKind = kind("a manual page of headway", |head| {
    String::from_utf8_lossy(head).contains("\n.TH headway")
});
