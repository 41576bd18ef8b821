//! Part, machine and options -> how much of the part can be printed at most, before any planning.

use super::part::What;
use super::{Error, Machine, Options, Part};
use crate::input::Input;
use crate::pipeline::reach::{PartReach, ReachOptions, part_reach};

/// The greatest share of a mesh that the machine can print with material laid voxel by voxel, in bounds that often meet; of the
/// options only the aperture matters.
///
/// # Errors
/// [`Error::Part`] for what is no mesh, [`Error::Options`], and [`Error::Plan`] where it does not fit.
pub fn reach(
    part: &Part,
    machine: &Machine,
    options: &Options,
    asked: &ReachOptions,
) -> Result<PartReach, Error> {
    let What::Input(Input::Mesh(mesh)) = &part.what else {
        let text = "only a mesh fills a space: give an STL, 3MF or OBJ file";
        return Err(Error::Part(text.to_string()));
    };
    let mut settings = options.over(machine.settings.clone());
    if let (Ok(settings), Some(at_mm)) = (&mut settings, part.at_mm.first()) {
        settings.at_mm = Some(*at_mm);
    }
    let settings = settings.map_err(|error| Error::Options(error.to_string()))?;
    part_reach(mesh, &settings, asked).map_err(|error| Error::Plan(error.to_string()))
}
