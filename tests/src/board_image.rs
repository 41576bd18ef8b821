//! Images of the boards, built as they are flashed.

use super::elf::Elf;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, MutexGuard, OnceLock};

const TARGET: &str = "thumbv7em-none-eabihf";
const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// One emulator, and one build, at a time.
static ALONE: Mutex<()> = Mutex::new(());

pub fn alone() -> MutexGuard<'static, ()> {
    ALONE
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Why nothing can be emulated here, if so.
fn missing() -> Option<String> {
    let has_qemu = Command::new("qemu-system-arm").arg("--version").output();
    if has_qemu.is_err() {
        return Some("qemu-system-arm is not installed".to_string());
    }
    let libraries = Command::new("rustc")
        .args(["--print", "target-libdir", "--target", TARGET])
        .output()
        .expect("rustc runs");
    let libraries = String::from_utf8_lossy(&libraries.stdout).into_owned();
    let found = Path::new(libraries.trim()).is_dir();
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

/// Builds a binary of the firmware.
pub fn build(bin: &str, features: &str) -> Elf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(ROOT).join("target"), PathBuf::from);
    let built = Command::new(env!("CARGO"))
        .current_dir(ROOT)
        .args(["build", "--quiet", "--locked", "--profile", "firmware"])
        .args(["-p", "headway-firmware", "--target", TARGET, "--bin", bin])
        .args(["--features", features])
        .status()
        .expect("cargo runs");
    assert!(built.success(), "{bin} does not build");
    Elf::read(&target.join(TARGET).join("firmware").join(bin)).expect("an ELF file")
}
