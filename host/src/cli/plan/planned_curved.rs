//! A mesh -> its job in curved layers.

use crate::cli::args::{PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::planned::{finished, plan_error};
use crate::cli::reading::copies;
use crate::cli::terminal::console::Console;
use crate::input::Target;
use crate::mesh::LoadedMesh;
use crate::pipeline::planned::Planned;
use crate::pipeline::surface::curved_layers::{Beside, plan_curved_layers};
use crate::settings::Settings;
use crate::settings::curved_layers::CurvedLayers;
use std::path::Path;
use std::str::FromStr;
use std::time::Instant;

/// Plans a mesh in curved layers.
pub(crate) fn from_mesh(
    path: &Path,
    loaded: LoadedMesh,
    (place, settings_args): (&PlaceArgs, &SettingsArgs),
    settings: Settings,
    console: &Console,
) -> Result<Planned, CliError> {
    let asked = place.curved_layers.as_deref().unwrap_or_default();
    let asked =
        CurvedLayers::from_str(asked).map_err(|error| CliError::Usage(error.to_string()))?;
    if let Some(problem) = other_option(&loaded, place, settings_args) {
        return Err(CliError::Usage(problem));
    }
    let (bar, begun) = (console.planning(), Instant::now());
    let planned = plan_curved_layers(&loaded.mesh, asked, &settings, &bar);
    let plan_s = begun.elapsed().as_secs_f64();
    bar.clear();
    let plan = planned.map_err(|error| plan_error(path, &error))?;
    let target = Target {
        name: loaded.name,
        regions: Vec::new(),
    };
    Ok(finished(
        plan,
        plan_s,
        target,
        loaded.notes,
        settings,
        console,
    ))
}

/// What does not go with curved layers, and what to do.
fn other_option(
    loaded: &LoadedMesh,
    place: &PlaceArgs,
    settings_args: &SettingsArgs,
) -> Option<String> {
    let layers = &place.layers;
    let given = [
        (Beside::KeepOut, place.keep_out.is_some()),
        (Beside::LayerRange, layers.layer_range.is_some()),
        (Beside::LayerHeights, layers.layer_heights.is_some()),
        (
            Beside::FirstLayerHeight,
            layers.first_layer_height.is_some(),
        ),
        (Beside::FirstLayerSpeed, place.first_layer_speed.is_some()),
        (Beside::Cache, place.cache.is_some()),
        (Beside::Copies, copies::option(place).is_some()),
        (Beside::Carved, !loaded.carved.is_empty()),
    ];
    if let Some((beside, _)) = given.iter().find(|(_, given)| *given) {
        return Some(beside.refusal().to_string());
    }
    let has_layers = settings_args.options.layers.is_some();
    has_layers.then(|| "--layers goes with outlines: a mesh has its own".to_string())
}
