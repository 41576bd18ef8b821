//! A mesh -> its job in curved layers.

use crate::cli::args::{PlaceArgs, SettingsArgs};
use crate::cli::error::CliError;
use crate::cli::plan::planned::{finished, plan_error};
use crate::cli::reading::copies;
use crate::cli::terminal::console::Console;
use crate::input::Target;
use crate::mesh::LoadedMesh;
use crate::pipeline::planned::Planned;
use crate::pipeline::surface::curved_layers::{CurvedLayers, SKIN_LAYERS, plan_curved_layers};
use crate::settings::Settings;
use std::path::Path;
use std::time::Instant;

/// Maximum number of curved layers.
const SKIN_LAYERS_MAX: u32 = 100;

/// Plans a mesh in curved layers.
pub(crate) fn from_mesh(
    path: &Path,
    loaded: LoadedMesh,
    (place, settings_args): (&PlaceArgs, &SettingsArgs),
    settings: Settings,
    console: &Console,
) -> Result<Planned, CliError> {
    let asked = asked(place.curved_layers.as_deref().unwrap_or_default())?;
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

/// Which layers are to be curved.
fn asked(text: &str) -> Result<CurvedLayers, CliError> {
    let skin = |count: &str| {
        count
            .parse()
            .ok()
            .filter(|count| (1..=SKIN_LAYERS_MAX).contains(count))
    };
    let asked = match text.split_once(':') {
        None if text == "auto" => Some(CurvedLayers::Auto),
        None if text == "all" => Some(CurvedLayers::All),
        None if text == "skin" => Some(CurvedLayers::Skin(SKIN_LAYERS)),
        Some(("skin", count)) => skin(count).map(CurvedLayers::Skin),
        _ => None,
    };
    asked.ok_or_else(|| {
        CliError::Usage(format!(
            "--curved-layers {text}: write auto, all, skin or skin:M with M from 1 to {SKIN_LAYERS_MAX}, as in skin:3"
        ))
    })
}

/// What does not go with curved layers, and what to do.
fn other_option(
    loaded: &LoadedMesh,
    place: &PlaceArgs,
    settings_args: &SettingsArgs,
) -> Option<String> {
    let layers = &place.layers;
    let given = [
        ("--keep-out", place.keep_out.is_some()),
        ("--layer-range", layers.layer_range.is_some()),
        ("--layer-heights", layers.layer_heights.is_some()),
        ("--first-layer-height", layers.first_layer_height.is_some()),
        ("--first-layer-speed", place.first_layer_speed.is_some()),
        ("--cache", place.cache.is_some()),
        ("--copies or a second --at", copies::option(place).is_some()),
    ];
    let given = given.iter().find(|(_, given)| *given);
    if let Some((option, _)) = given {
        return Some(format!(
            "{option} does not go with --curved-layers: leave one of them out"
        ));
    }
    if !loaded.carved.is_empty() {
        return Some(
            "--curved-layers: the file cuts volumes away from its objects; export the part as one mesh".to_string(),
        );
    }
    let has_layers = settings_args.options.layers.is_some();
    has_layers.then(|| "--layers goes with outlines: a mesh has its own".to_string())
}
