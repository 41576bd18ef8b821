//! Options as other programs name them: refused, with the name that they have here.

use clap::Args;
use clap::builder::UnknownArgumentValueParser;

/// A parser of nothing: the option is refused, and another one named.
pub(super) fn named(option: &'static str) -> UnknownArgumentValueParser {
    UnknownArgumentValueParser::suggest_arg(option)
}

/// What slicers call settings that have another name here.
#[derive(Clone, Debug, Default, PartialEq, Args)]
pub(crate) struct OtherNames {
    #[arg(long, hide = true, value_parser = named("--infill-density"))]
    infill: Option<String>,
    #[arg(long, hide = true, value_parser = named("--infill-density"))]
    fill_density: Option<String>,
    #[arg(long, hide = true, value_parser = named("--aperture"))]
    nozzle: Option<String>,
    #[arg(long, hide = true, value_parser = named("--aperture"))]
    nozzle_diameter: Option<String>,
    #[arg(long, hide = true, value_parser = named("--walls"))]
    perimeters: Option<String>,
    #[arg(id = "other-top", long, hide = true, value_parser = named("--top"))]
    top_layers: Option<String>,
    #[arg(id = "other-bottom", long, hide = true, value_parser = named("--bottom"))]
    bottom_layers: Option<String>,
    #[arg(long, hide = true, value_parser = named("--machine"))]
    printer: Option<String>,
}
