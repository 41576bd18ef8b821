//! The named values of options.

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
    /// A run of the tip: x y z nx ny nz [heading_deg] on each line.
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
    /// A slicer's file: its centre lines, with the nozzle turned for their widths.
    Gcode,
}
