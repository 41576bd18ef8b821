//! `--axes` and `[gcode] axes` -> the axes of the machine that G-code was written for.

use crate::cli::error::CliError;
use crate::cli::reading::load;
use crate::gcode::axes::{FileAxes, FileMachine};
use crate::input::Format;
use crate::settings::axes_words::{AxesWords, MachineWord};
use crate::settings::{Settings, joint_names};
use crate::text::refusal::Refusal;
use std::path::Path;
use std::sync::Arc;

/// The axes of the option, or of the machine file; none for other formats.
pub(crate) fn of(
    option: Option<&str>,
    format: Format,
    settings: &Settings,
) -> Result<Option<Arc<FileAxes>>, CliError> {
    if format != Format::Gcode {
        return match option {
            Some(_) => Err(CliError::Usage(
                "--axes goes with G-code: what else is planned has no letters of axes".to_string(),
            )),
            None => Ok(None),
        };
    }
    let name = if option.is_some() {
        "--axes"
    } else {
        "[gcode] axes"
    };
    let Some(text) = option.or(settings.gcode_axes.as_deref()) else {
        return Ok(None);
    };
    let wrong = |error: Refusal| CliError::Usage(format!("{name} \"{text}\": {error}"));
    let words = AxesWords::parse(text).map_err(wrong)?;
    let of_file = match &words.machine {
        Some(MachineWord::File(file)) => Some(load::machine(Path::new(file))?),
        _ => None,
    };
    let settings = of_file.as_ref().unwrap_or(settings);
    let kinematics = &settings.machine.kinematics;
    let machine = FileMachine {
        kinematics,
        joints: joint_names(kinematics),
    };
    let machine = words.machine.is_some().then_some(&machine);
    let axes = FileAxes::new(&words, machine).map_err(wrong)?;
    Ok(Some(Arc::new(axes)))
}
