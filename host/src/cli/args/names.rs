//! What options choose between by name.

use crate::settings::Place;
use clap::ValueEnum;

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum FormatName {
    /// Polygon JSON: {"units","exterior","holes"}.
    #[value(alias = "json")]
    Polygon,
    /// Polygons of a GeoJSON file.
    Geojson,
    /// Filled shapes of an SVG page.
    Svg,
    /// Contours of an ASCII DXF drawing.
    Dxf,
    /// A run of the tip: x y z nx ny nz [heading_deg] a line.
    #[value(alias = "wpt")]
    Waypoints,
    /// A curve: {"degree","control_points","weights","knots"}.
    Nurbs,
    /// Triangles of a solid, binary or ASCII.
    Stl,
    /// 3D Manufacturing Format.
    #[value(name = "3mf")]
    ThreeMf,
    /// Wavefront triangles or polygons of a solid.
    Obj,
    /// What a slicer wrote: its centre lines, with the nozzle turned for their widths.
    Gcode,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum UnitName {
    Mm,
    Cm,
    M,
    Um,
    In,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum PlaceName {
    /// Its box centred over the work area.
    Centre,
    /// Where the machine reaches all of it and takes least time.
    Best,
}

impl PlaceName {
    /// As the settings have it.
    pub(crate) fn place(self) -> Place {
        match self {
            PlaceName::Centre => Place::Centre,
            PlaceName::Best => Place::Best,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum PassName {
    /// Two passes, one along either wall, one where two do not fit.
    Two,
    /// One pass between the walls wherever the aperture spans them.
    One,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum QualityName {
    /// Hardly anything stays open: the longest print.
    Fine,
    /// Small voids that the material closes are left where filling them takes long.
    Standard,
    /// Voids of some tenths of a mm² are left.
    Fast,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum SeamName {
    /// The smooth place nearest to where the head is.
    Nearest,
    /// Farthest along a direction.
    Aligned,
    /// In the sharpest corner.
    Sharpest,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub(crate) enum LawName {
    /// The angle at which the aperture just touches what it should.
    Tangent,
    /// (1 - w) 90°, as published.
    Linear,
}
