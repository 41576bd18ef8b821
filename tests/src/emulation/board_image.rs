//! Images of the boards, built as they are flashed, once for all tests.

use crate::elf::Elf;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

const TARGET: &str = "thumbv7em-none-eabihf";
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// One emulator at a time: each takes a core.
static ALONE: Mutex<()> = Mutex::new(());

pub fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Why nothing can be emulated here, if so.
pub fn missing() -> Option<String> {
    let has_qemu = Command::new("qemu-system-arm").arg("--version").output();
    if has_qemu.is_err() {
        return Some("qemu-system-arm is not installed".to_string());
    }
    let libraries = Command::new("rustc")
        .args(["--print", "target-libdir", "--target", TARGET])
        .output();
    let libraries = libraries.map(|output| output.stdout).unwrap_or_default();
    let libraries = String::from_utf8_lossy(&libraries).into_owned();
    let found = !libraries.is_empty() && Path::new(libraries.trim()).is_dir();
    (!found).then(|| format!("the Rust target {TARGET} is not installed"))
}

/// True, after saying why, where a test is skipped; `HEADWAY_DEMAND_EMULATOR=1` makes that a failure.
pub fn skipped() -> bool {
    static MISSING: OnceLock<Option<String>> = OnceLock::new();
    let Some(reason) = MISSING.get_or_init(missing) else {
        return false;
    };
    let demanded = std::env::var_os("HEADWAY_DEMAND_EMULATOR").is_some();
    assert!(!demanded, "the emulator is demanded, but {reason}");
    println!("skipped: {reason}");
    true
}

/// Builds a binary of the firmware as it is flashed; its file, which another build of the same binary with other
/// features does not replace.
///
/// # Errors
///
/// What failed, where cargo does not build it.
pub fn image(bin: &str, features: &str) -> Result<PathBuf, String> {
    // Two builds would wait for each other's lock and take each other's output.
    static BUILDING: Mutex<()> = Mutex::new(());
    let _building = BUILDING.lock().unwrap_or_else(PoisonError::into_inner);
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(ROOT).join("target"), PathBuf::from);
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let built = Command::new(cargo)
        .current_dir(ROOT)
        .args(["build", "--quiet", "--locked", "--profile", "firmware"])
        .args(["-p", "headway-firmware", "--target", TARGET, "--bin", bin])
        .args(["--features", features])
        .status();
    if !built.is_ok_and(|status| status.success()) {
        return Err(format!("{bin} with features {features:?} does not build"));
    }
    let firmware = target.join(TARGET).join("firmware");
    let images = firmware.join("images");
    let kept = images.join(format!("{bin}-{}", features.replace(',', "-")));
    std::fs::create_dir_all(&images)
        .and_then(|()| std::fs::copy(firmware.join(bin), &kept))
        .map_err(|error| format!("{}: {error}", kept.display()))?;
    Ok(kept)
}

/// The same, read.
///
/// # Panics
///
/// Where it does not build.
pub fn build(bin: &str, features: &str) -> Elf {
    let file = image(bin, features).unwrap_or_else(|error| panic!("{error}"));
    Elf::read(&file).expect("an ELF file")
}
