//! The files of a 3MF package: its models, and the slicers' own files. Limits the unpacked size.

use super::model::{Model, read_model};
use super::roles::{Roles, read_roles};
use super::unfollowed::{self, Unfollowed};
use super::{FORMAT, PARTS_MAX, problem};
use crate::mesh::read::syntax;
use crate::text::refusal::Refusal;
use std::io::{BufReader, Cursor, Read};
use zip::ZipArchive;

/// Most bytes of all model files once unpacked: the text of three million triangles.
const UNPACKED_MAX: u64 = 1 << 28;
/// Maximum size of a file other than the models, bytes.
const NOTES_MAX: u64 = 1 << 24;

/// What a package holds.
#[derive(Debug, Default)]
pub(super) struct Files {
    pub models: Vec<Model>,
    pub roles: Roles,
    pub unfollowed: Unfollowed,
}

/// Reads all models, and the slicers' own files.
pub(super) fn files(bytes: &[u8]) -> Result<Files, Refusal> {
    let unread = |error: zip::result::ZipError| problem(&error.to_string());
    let mut package = ZipArchive::new(Cursor::new(bytes)).map_err(unread)?;
    check_unpacked(&mut package)?;
    let mut files = Files::default();
    let mut declared = 0;
    for number in 0..package.len() {
        let file = package.by_index(number).map_err(unread)?;
        let name = file.name().trim_start_matches('/').to_string();
        if name.ends_with(".model") {
            let model = read_model(&name, BufReader::new(file), PARTS_MAX - declared)?;
            let components = model.objects.iter().map(|object| object.components.len());
            declared += model.objects.len() + model.items.len() + components.sum::<usize>();
            files.models.push(model);
            continue;
        }
        if !is_roles(&name) && !unfollowed::is_known(&name) {
            continue;
        }
        let text = whole(file, &name)?;
        if is_roles(&name) {
            files.roles = read_roles(&text)?;
        } else {
            files.unfollowed.read(&name, &text)?;
        }
    }
    Ok(files)
}

fn is_roles(name: &str) -> bool {
    matches!(
        name,
        "Metadata/Slic3r_PE_model.config" | "Metadata/model_settings.config"
    )
}

fn whole(file: impl Read, name: &str) -> Result<Vec<u8>, Refusal> {
    let mut text = Vec::new();
    let read = file.take(NOTES_MAX + 1).read_to_end(&mut text);
    read.map_err(|error| problem(&error.to_string()))?;
    match text.len() as u64 > NOTES_MAX {
        true => Err(problem(&format!(
            "{name} unpacks to more than {NOTES_MAX} bytes"
        ))),
        false => Ok(text),
    }
}

/// Unpacks to nowhere: what a package states of its sizes need not be true.
fn check_unpacked(package: &mut ZipArchive<Cursor<&[u8]>>) -> Result<(), Refusal> {
    let mut left = UNPACKED_MAX;
    for number in 0..package.len() {
        let file = package.by_index(number);
        let file = file.map_err(|error| problem(&error.to_string()))?;
        if !file.name().ends_with(".model") {
            continue;
        }
        let unpacked = std::io::copy(&mut file.take(left + 1), &mut std::io::sink());
        let unpacked = unpacked.map_err(|error| problem(&error.to_string()))?;
        if unpacked > left {
            let what = format!("its models unpack to more than {UNPACKED_MAX} bytes");
            return Err(syntax(FORMAT, what + "; export with a coarser tolerance"));
        }
        left -= unpacked;
    }
    Ok(())
}
