//! Results to files: nothing of somebody's is lost, and a result is complete or not there at all.
//!
//! An output is checked before the work ([`OutputPath`]): it is neither read by the command nor another output
//! of it, its folder is there and can be written, and it replaces nothing but an older result of its kind, anything
//! else with `--force` only. Then it is written to a file in the same folder (`.NAME.xxxxxx.part`), synced to disk, and
//! only then renamed, so that a full disk or the end of the program in mid-write destroys no existing file. A
//! report's folder is written the same way; in an existing report, files replace those of the same
//! names, `index.html` last, so that a report with that page is complete. Files of those names that
//! are not from a report are not replaced, and the report is refused: a page contains its generator's
//! name.
//!
//! Input: a path and bytes, or a function that writes them. Pipes, devices and sockets are written
//! directly. Not covered: the log of a line (`--log`), which has to contain everything up to a crash.
//! A program that is killed leaves its `.part` file.

use crate::cli::args::output_path::OutputPath;
use crate::cli::error::CliError;
use crate::cli::terminal::console::Console;
use crate::cli::terminal::named_files::parent;
use crate::cli::terminal::result_kind::{GCODE, HEAD_BYTES, JOB, ResultKind};
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
const REPORT_NAMES: [&str; 3] = [REPORT_PAGE, "report.json", "plan.svg"];

/// A file that may be written.
#[derive(Clone, Debug)]
pub(crate) struct OutputFile {
    path: PathBuf,
    kind: ResultKind,
    force: bool,
}

/// Endings of what a job is taken for by mistake.
const OTHERS_ENDINGS: [&str; 9] = [
    "gcode", "g", "gco", "nc", "ngc", "csv", "svg", "html", "stl",
];

impl OutputPath {
    /// Says before the work, not after it, that a file cannot or must not be written there. Existing files are
    /// unchanged, and no temporary file remains.
    pub(crate) fn file(&self, kind: ResultKind, console: &Console) -> Result<OutputFile, CliError> {
        let (path, files) = (self.name(), console.files());
        let file = OutputFile {
            path: path.to_path_buf(),
            kind,
            force: files.force,
        };
        // Looking would disturb a stream.
        if !is_stream(path) {
            files.claim(path)?;
            check_file(path)?;
            let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
            let ending = ending.to_str().unwrap_or_default();
            if kind.name == JOB.name && OTHERS_ENDINGS.contains(&ending) {
                return Err(CliError::Usage(format!(
                    "{}: a job is written, which is no .{ending} file: name it .hwj, and `headway export` it",
                    path.display()
                )));
            }
            let other = |head: Vec<u8>| !head.is_empty() && !(kind.is_one)(&head);
            if !file.force && path.exists() && head_of(path).is_none_or(other) {
                return Err(file.not_replaced(&format!("is not {}", kind.name)));
            }
        }
        Ok(file)
    }

    /// The same for a report's folder, which is made if it is missing: an existing one must be a report.
    pub(crate) fn report(&self, console: &Console) -> Result<ReportFolder, CliError> {
        let (folder, files) = (self.name(), console.files());
        check_folder(folder)?;
        files.claim(folder)?;
        let layers = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let layers = layers.filter_map(|entry| entry.file_name().into_string().ok());
        let layers: Vec<String> = layers.filter(|name| name.contains("-layer-")).collect();
        for name in REPORT_NAMES
            .into_iter()
            .chain(layers.iter().map(String::as_str))
        {
            files.claim(&folder.join(name))?;
        }
        let report = ReportFolder {
            folder: folder.to_path_buf(),
            force: files.force,
        };
        report.check_replaceable(REPORT_NAMES.into_iter())?;
        Ok(report)
    }
}

impl OutputFile {
    /// An input that is replaced by its own result.
    pub(crate) fn in_place(path: &Path) -> Result<OutputFile, CliError> {
        check_file(path)?;
        Ok(OutputFile {
            path: path.to_path_buf(),
            kind: GCODE,
            force: true,
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes it, or says why not.
    pub(crate) fn write(&self, bytes: &[u8]) -> Result<(), CliError> {
        self.write_with(|out| out.write_all(bytes))
    }

    /// Writes what `write` makes.
    pub(crate) fn write_with(
        &self,
        write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    ) -> Result<(), CliError> {
        let written = write_whole(&self.path, write, |part| {
            self.keeps_other(|| std::fs::read(part).ok())
        });
        match written.map_err(|problem| file_error(&self.path, problem))? {
            true => Ok(()),
            false => Err(self.not_replaced("has other contents")),
        }
    }

    /// Says before the work that these bytes would replace others that are kept.
    pub(crate) fn check_kept(&self, bytes: &[u8]) -> Result<(), CliError> {
        match !is_stream(&self.path) && self.keeps_other(|| Some(bytes.to_vec())) {
            true => Err(self.not_replaced("has other contents")),
            false => Ok(()),
        }
    }

    /// True where the file is there, is kept, and is not this.
    fn keeps_other(&self, new: impl FnOnce() -> Option<Vec<u8>>) -> bool {
        let is_kept = self.kind.is_kept && !self.force;
        let there = std::fs::read(&self.path).ok().filter(|_| is_kept);
        there.is_some_and(|there| !there.is_empty() && Some(there) != new())
    }

    fn not_replaced(&self, why: &str) -> CliError {
        CliError::Usage(format!(
            "{}: {why}, so it is not replaced; name another file, or replace it with --force",
            self.path.display()
        ))
    }

    /// A file without a name near it, which is gone with the program.
    pub(crate) fn nameless(&self) -> Result<File, CliError> {
        let file = match is_stream(&self.path) {
            true => tempfile::tempfile(),
            false => place_of(&self.path).and_then(|place| tempfile::tempfile_in(parent(&place))),
        };
        file.map_err(|problem| file_error(&self.path, problem))
    }
}

/// Writes a file that is the command's own by its name, or names the one that could not be written.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let written = write_whole(path, |out| out.write_all(bytes), |_| false);
    written
        .map(drop)
        .map_err(|problem| file_error(path, problem))
}

/// False, and nothing is changed, if the file keeps its contents rather than those of the part that was written.
fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
    keeps: impl FnOnce(&Path) -> bool,
) -> std::io::Result<bool> {
    if is_stream(path) {
        let mut out = BufWriter::new(OpenOptions::new().write(true).open(path)?);
        return write(&mut out).and_then(|()| out.flush()).map(|()| true);
    }
    let place = place_of(path)?;
    let _writing = WRITING.lock().unwrap_or_else(PoisonError::into_inner);
    let mut part = part_beside(&place)?;
    let mut out = BufWriter::new(part.as_file_mut());
    write(&mut out).and_then(|()| out.flush())?;
    drop(out);
    if keeps(part.path()) {
        return Ok(false);
    }
    put(part, &place).map(|()| true)
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

/// Says that a file cannot be written there.
pub(crate) fn check_file(path: &Path) -> Result<(), CliError> {
    let named = path.display();
    let told = |what: String| Err(CliError::Job(format!("{named}: {what}")));
    if path.is_dir() {
        return told("is a directory; name a file in it".to_string());
    }
    if path.is_symlink() && !path.exists() {
        return told("is a link to a file that is not there; name that file".to_string());
    }
    let folder = parent(path);
    if !folder.is_dir() {
        let folder = folder.display();
        return told(format!(
            "there is no folder {folder}; make it, or name another one"
        ));
    }
    let check = || {
        if path.exists() {
            // A file that is kept from being written.
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

/// The start of a file; `None` if it cannot be read.
fn head_of(path: &Path) -> Option<Vec<u8>> {
    let mut head = Vec::new();
    let read = |file: File| file.take(HEAD_BYTES).read_to_end(&mut head);
    File::open(path).and_then(read).ok().map(|_| head)
}

/// A page that a report wrote.
fn is_report_page(page: &Path) -> bool {
    let head = page.is_file().then(|| head_of(page)).flatten();
    head.is_some_and(|head| String::from_utf8_lossy(&head).contains(PAGE_GENERATOR))
}

/// A folder to which a report may be written.
#[derive(Clone, Debug)]
pub(crate) struct ReportFolder {
    folder: PathBuf,
    force: bool,
}

impl ReportFolder {
    pub(crate) fn page(&self) -> PathBuf {
        self.folder.join(REPORT_PAGE)
    }

    /// Refuses to replace files of a folder that has no report's page.
    fn check_replaceable<'a>(
        &self,
        mut names: impl Iterator<Item = &'a str>,
    ) -> Result<(), CliError> {
        if self.force || is_report_page(&self.page()) {
            return Ok(());
        }
        // A dangling link is not replaced either.
        let is_there = |name: &&str| self.folder.join(name).symlink_metadata().is_ok();
        names.find(is_there).map_or(Ok(()), |name| {
            Err(CliError::Usage(format!(
                "{}: is not part of a report of headway, so it is not replaced; name another folder for the \
                 report, move that file away, or replace it with --force",
                self.folder.join(name).display()
            )))
        })
    }

    /// Writes a report's files, names with their texts.
    pub(crate) fn write(&self, files: &[(&str, &str)]) -> Result<(), CliError> {
        self.check_replaceable(files.iter().map(|(name, _)| *name))?;
        write_whole_folder(&self.folder, files).map_err(|problem| file_error(&self.folder, problem))
    }
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
    use crate::cli::terminal::named_files::NamedFiles;
    use crate::cli::terminal::result_kind::JOB;
    use crate::job::file::MAGIC;

    fn console() -> Console {
        Console::new(true, NamedFiles::default())
    }

    fn report_of(folder: &Path) -> Result<ReportFolder, CliError> {
        OutputPath::from(folder.to_path_buf()).report(&console())
    }

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
        let output = || {
            OutputPath::from(path.clone())
                .file(JOB, &console())
                .unwrap()
        };
        assert!(output().write_with(fails).is_err());
        assert_eq!(names(folder.path()), [] as [&str; 0]);
        output().write(MAGIC).unwrap();
        assert!(output().write_with(fails).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), MAGIC);
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
        let new = report_of(&report).unwrap();
        new.write(&[("index.html", PAGE_GENERATOR)]).unwrap();
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
        let write = |folder: &Path, files: &[(&str, &str)]| report_of(folder)?.write(files);
        write(&report, &files(&one)).unwrap();
        std::fs::write(report.join("mine"), "mine").unwrap();
        write(&report, &files(&two)).unwrap();
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
        assert!(write(&report, &files(&three)).is_err());
        assert_eq!(names(&report), ["mine", "plan.svg", "report.json"]);
        // If even the temporary file cannot be written, the old report is unchanged.
        let bad = [("index.html", "four"), ("no/such/folder", "four")];
        let other = folder.path().join("other");
        write(&other, &files(&one)).unwrap();
        assert!(write(&other, &bad).is_err());
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
                "plan-layer-5.svg" => report_of(&site).unwrap().write(&files),
                _ => report_of(&site).map(drop),
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
        report_of(&own).unwrap().write(&files).unwrap();
        assert_eq!(names(&own).len(), 3);
    }
}
