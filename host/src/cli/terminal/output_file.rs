//! Results to files: complete or not at all.
//!
//! Output is written to a file in the same folder (`.NAME.xxxxxx.part`), synced to disk, and only then
//! renamed, so that a full disk or the end of the program in mid-write destroys no existing file. A
//! report's folder is written the same way; in an existing report, files replace those of the same
//! names, `index.html` last, so that a report with that page is complete. Files of those names that
//! are not from a report are not replaced, and the report is refused: a page contains its generator's
//! name.
//!
//! Input: a path and bytes, or a function that writes them. Pipes, devices and sockets are written
//! directly. Not covered: the log of a line (`--log`), which has to contain everything up to a crash.
//! A program that is killed leaves its `.part` file.

use crate::cli::error::CliError;
use crate::report::page::PAGE_GENERATOR;
use std::ffi::{OsStr, OsString};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Error, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use tempfile::{Builder, NamedTempFile};

/// The page that makes a report of a folder.
const REPORT_PAGE: &str = "index.html";
/// Names that a report is likely to write; layers have more of their own.
const REPORT_NAMES: [&str; 6] = [
    REPORT_PAGE,
    "report.json",
    "plan.svg",
    "coverage.svg",
    "motion.svg",
    "space.svg",
];
/// Bytes at the start of a page in which its writer's mark is searched.
const PAGE_HEAD_BYTES: u64 = 4096;

/// Writes a file, or names the one that could not be written.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    write_file_with(path, |out| out.write_all(bytes))
}

/// Writes what `write` makes to a file.
pub(crate) fn write_file_with(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), CliError> {
    write_whole(path, write).map_err(|problem| file_error(path, problem))
}

fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> std::io::Result<()> {
    if is_stream(path) {
        let mut out = BufWriter::new(OpenOptions::new().write(true).open(path)?);
        return write(&mut out).and_then(|()| out.flush());
    }
    let place = place_of(path)?;
    let _writing = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
    let mut part = part_beside(&place)?;
    let mut out = BufWriter::new(part.as_file_mut());
    write(&mut out).and_then(|()| out.flush())?;
    drop(out);
    put(part, &place)
}

/// A file without a name near `path`, which is gone with the program.
pub(crate) fn nameless_file(path: &Path) -> Result<File, CliError> {
    let file = match is_stream(path) {
        true => tempfile::tempfile(),
        false => place_of(path).and_then(|place| tempfile::tempfile_in(parent(&place))),
    };
    file.map_err(|problem| file_error(path, problem))
}

/// Held while a file is written: the program ends only after that.
static WRITING: Mutex<()> = Mutex::new(());

/// Ends the program on Ctrl-C without half-written files, after a line that says what remains for the
/// next run.
pub(crate) fn end_whole_on_interrupt(line: String) {
    // Where there is a handler already, that one stays.
    let _ = ctrlc::set_handler(move || {
        let _writing = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = writeln!(std::io::stderr(), "{line}");
        std::process::exit(INTERRUPTED);
    });
}

/// The exit status of shells for an interrupted program.
const INTERRUPTED: i32 = 130;

/// Gives a part that was written its name.
fn put(part: NamedTempFile, place: &Path) -> std::io::Result<()> {
    // Rights that were given to the file that is replaced are kept.
    if let Ok(known) = std::fs::metadata(place) {
        part.as_file().set_permissions(known.permissions())?;
    }
    part.as_file().sync_all()?;
    part.persist(place).map_err(|problem| problem.error)?;
    Ok(())
}

/// Says before the work, not after it, that a file cannot be written there. Existing files are
/// unchanged, and no temporary file remains.
pub(crate) fn check_file(path: &Path) -> Result<(), CliError> {
    if is_stream(path) {
        // Looking would disturb it.
        return Ok(());
    }
    let check = || {
        if path.exists() {
            // A folder, or a file that is kept from being written.
            OpenOptions::new().append(true).open(path)?;
        }
        part_beside(&place_of(path)?).map(drop)
    };
    check().map_err(|problem| file_error(path, problem))
}

/// The same of a folder that is made where it is not there.
pub(crate) fn check_folder(path: &Path) -> Result<(), CliError> {
    let nearest = path.ancestors().find(|folder| folder.exists());
    match nearest {
        Some(found) if !found.is_dir() => Err(CliError::Job(format!(
            "{}: is a file, and a folder is to be made there; name another one",
            found.display()
        ))),
        _ => Ok(()),
    }
}

/// The same for a report's folder: an existing one must be a report.
pub(crate) fn check_report_folder(path: &Path) -> Result<(), CliError> {
    check_folder(path)?;
    check_replaceable(path, REPORT_NAMES.into_iter())
}

/// Refuses to replace files of a folder that has no report's page.
fn check_replaceable<'a>(
    folder: &Path,
    mut names: impl Iterator<Item = &'a str>,
) -> Result<(), CliError> {
    if is_report_page(&folder.join(REPORT_PAGE)) {
        return Ok(());
    }
    // A dangling link is not replaced either.
    let is_there = |name: &&str| folder.join(name).symlink_metadata().is_ok();
    names.find(is_there).map_or(Ok(()), |name| {
        Err(CliError::Job(format!(
            "{}: is not part of a report of headway, so it is not replaced; name another folder for the \
             report, or move that file away",
            folder.join(name).display()
        )))
    })
}

/// A page that a report wrote.
fn is_report_page(page: &Path) -> bool {
    let mut head = Vec::new();
    let read = |file: File| file.take(PAGE_HEAD_BYTES).read_to_end(&mut head);
    page.is_file()
        && File::open(page).and_then(read).is_ok()
        && String::from_utf8_lossy(&head).contains(PAGE_GENERATOR)
}

/// Writes a report's files, names with their texts, into its folder.
pub(crate) fn write_folder(folder: &Path, files: &[(&str, &str)]) -> Result<(), CliError> {
    check_replaceable(folder, files.iter().map(|(name, _)| *name))?;
    write_whole_folder(folder, files).map_err(|problem| file_error(folder, problem))
}

fn write_whole_folder(folder: &Path, files: &[(&str, &str)]) -> std::io::Result<()> {
    let is_new = !folder.exists();
    let home = match parent(folder) {
        parent if is_new => parent,
        // The folder may be a file system of its own.
        _ => folder,
    };
    std::fs::create_dir_all(home)?;
    let parts = Builder::new()
        .prefix(&part_prefix(folder.file_name()))
        .suffix(".part")
        .tempdir_in(home)?;
    for (name, text) in files {
        let mut file = File::create(parts.path().join(name))?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
    }
    if is_new {
        #[cfg(unix)]
        open_to_all(parts.path())?;
        std::fs::rename(parts.path(), folder)?;
        // Nothing is left to clean up.
        let _ = parts.keep();
        return Ok(());
    }
    let page = folder.join(REPORT_PAGE);
    if page.exists() {
        std::fs::remove_file(page)?;
    }
    let (page, others): (Vec<&str>, Vec<&str>) = files
        .iter()
        .map(|(name, _)| *name)
        .partition(|name| *name == REPORT_PAGE);
    for name in others.into_iter().chain(page) {
        std::fs::rename(parts.path().join(name), folder.join(name))?;
    }
    Ok(())
}

/// A folder that was made for its maker alone gets the rights that a new one has.
#[cfg(unix)]
fn open_to_all(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    let like = folder.join("like");
    std::fs::create_dir(&like)?;
    let usual = std::fs::metadata(&like)?.permissions().mode();
    std::fs::remove_dir(&like)?;
    std::fs::set_permissions(folder, std::fs::Permissions::from_mode(usual))
}

/// The real location of a file: a link is followed, so that it stays one.
fn place_of(path: &Path) -> std::io::Result<PathBuf> {
    match std::fs::symlink_metadata(path) {
        Ok(known) if known.file_type().is_symlink() => std::fs::canonicalize(path),
        _ => Ok(path.to_path_buf()),
    }
}

/// An empty file in the folder of `place`.
fn part_beside(place: &Path) -> std::io::Result<NamedTempFile> {
    let prefix = part_prefix(place.file_name());
    let mut builder = Builder::new();
    builder.prefix(&prefix).suffix(".part");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file: the user's mask takes off what it does.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(parent(place)).map_err(|problem| {
        let folder = parent(place).display();
        let hint = match problem.kind() {
            ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
                ": results are first written to a temporary file in the same folder, which must be writable"
            }
            _ => "",
        };
        Error::new(problem.kind(), format!("{folder}: {problem}{hint}"))
    })
}

fn part_prefix(name: Option<&OsStr>) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(name.unwrap_or_default());
    prefix.push(".");
    prefix
}

fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// A pipe, a device, a socket: nothing that is replaced.
fn is_stream(path: &Path) -> bool {
    path.exists() && !path.is_file() && !path.is_dir()
}

fn file_error(path: &Path, problem: Error) -> CliError {
    CliError::File {
        path: path.display().to_string(),
        problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// Goal: a write that fails half-way costs nothing and leaves nothing. Method: a writer that
    /// fails after a few bytes, over a file and where there is none.
    #[test]
    fn a_failed_write_keeps_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("job");
        let fails = |out: &mut dyn Write| {
            out.write_all(&[7; 100_000])?;
            Err(Error::from(ErrorKind::StorageFull))
        };
        assert!(write_file_with(&path, fails).is_err());
        assert_eq!(names(folder.path()), [] as [&str; 0]);
        write_file(&path, b"good").unwrap();
        assert!(write_file_with(&path, fails).is_err());
        check_file(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"good");
        assert_eq!(names(folder.path()), ["job"]);
    }

    /// Goal: rights and links of what is replaced stay, new files are as open as any. Method: modes
    /// and targets before and after.
    #[cfg(unix)]
    #[test]
    fn rights_and_links_stay() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let [path, link, plain] = ["job", "link", "plain"].map(|name| folder.path().join(name));
        std::fs::write(&plain, "").unwrap();
        write_file(&path, b"one").unwrap();
        assert_eq!(mode(&path), mode(&plain));
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write_file(&link, b"two").unwrap();
        assert!(link.is_symlink());
        assert_eq!(
            (std::fs::read(&path).unwrap(), mode(&path)),
            (b"two".to_vec(), 0o640)
        );
        let report = folder.path().join("deep").join("report");
        write_folder(&report, &[("index.html", PAGE_GENERATOR)]).unwrap();
        assert_eq!(mode(&report), mode(&folder.path().join("deep")));
    }

    /// Goal: a report is whole or is none, and other files beside it stay. Method: a folder that is
    /// made, one that is written again, and one in which a file cannot be put.
    #[test]
    fn a_report_is_whole_or_none() {
        let folder = tempfile::tempdir().unwrap();
        let report = folder.path().join("report");
        let text = |text: &str| format!("{PAGE_GENERATOR}{text}");
        let [one, two, three] = ["one", "two", "three"].map(text);
        fn files(text: &str) -> [(&str, &str); 3] {
            ["report.json", "plan.svg", "index.html"].map(|name| (name, text))
        }
        write_folder(&report, &files(&one)).unwrap();
        std::fs::write(report.join("mine"), "mine").unwrap();
        check_report_folder(&report).unwrap();
        write_folder(&report, &files(&two)).unwrap();
        assert_eq!(
            names(&report),
            ["index.html", "mine", "plan.svg", "report.json"]
        );
        for name in ["index.html", "plan.svg", "report.json"] {
            assert_eq!(std::fs::read_to_string(report.join(name)).unwrap(), two);
        }
        assert_eq!(names(folder.path()), ["report"]);
        // A folder in the way of a picture: no page says that there is a report.
        std::fs::remove_file(report.join("plan.svg")).unwrap();
        std::fs::create_dir_all(report.join("plan.svg").join("full")).unwrap();
        assert!(write_folder(&report, &files(&three)).is_err());
        assert_eq!(names(&report), ["mine", "plan.svg", "report.json"]);
        // If even the temporary file cannot be written, the old report is unchanged.
        let bad = [("index.html", "four"), ("no/such/folder", "four")];
        let other = folder.path().join("other");
        write_folder(&other, &files(&one)).unwrap();
        assert!(write_folder(&other, &bad).is_err());
        assert_eq!(
            std::fs::read_to_string(other.join("index.html")).unwrap(),
            one
        );
        assert_eq!(names(&other).len(), 3);
    }

    /// Goal: files that no report wrote stay, whichever of a report's names they have. Method: a
    /// folder of somebody's for each name; the folder before and after.
    #[test]
    fn files_of_others_are_refused_and_stay() {
        let folder = tempfile::tempdir().unwrap();
        let files = [("plan-layer-5.svg", "x"), ("index.html", PAGE_GENERATOR)];
        for name in ["index.html", "report.json", "plan.svg", "plan-layer-5.svg"] {
            let site = folder.path().join(name);
            std::fs::create_dir(&site).unwrap();
            std::fs::write(site.join(name), "mine").unwrap();
            let told = match name {
                // Layers are not known before the plan.
                "plan-layer-5.svg" => write_folder(&site, &files),
                _ => check_report_folder(&site),
            };
            let told = told.unwrap_err().to_string();
            assert!(
                told.contains(name) && told.contains("another folder"),
                "{told}"
            );
            assert_eq!(names(&site), [name]);
            assert_eq!(std::fs::read_to_string(site.join(name)).unwrap(), "mine");
        }
        let own = folder.path().join("own");
        std::fs::create_dir(&own).unwrap();
        std::fs::write(own.join("notes.txt"), "mine").unwrap();
        check_report_folder(&own).unwrap();
        write_folder(&own, &files).unwrap();
        assert_eq!(names(&own).len(), 3);
    }
}
